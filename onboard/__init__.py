"""The companion-computer daemon. The flow, start to end; every arrow is one function call:

    bytes on a link                  links/        -> Datagram(channel, t_recv_ns, data)
    -> messages, in SI units         wire/         MavlinkDecoder.decode, points.decode_points
    -> on one time base              clocks/       Clocks.align: t_ns = when it was true, boot clock
    -> our own pose and motion       ownship/      Ownship.receive; pose_at the image's own time
    -> the estimate                  estimators/   rewind if late, predict, gate, update, predict to now
    -> Estimate, OwnPose             sinks/        Zenoh, recorder; the view is a client of what they publish

`pipeline.Pipeline.feed(datagram)` IS the program: no clock, no socket, no thread, so a recorded flight gives
the same bytes again. `daemon.py` runs it with links and sinks in flight, `onboard replay` on a recording.
docs/architecture.md draws the house.
"""

__version__ = "0.2.0"


class UserError(Exception):
    """Something the user can mend: a flag, a file, a port. Its message is one line that says where and how; a
    command shows it without a traceback."""


def with_extra(extra: str) -> str:
    """Return how to install us with an extra, from the clone or the wheel's file."""
    return f"in the clone `pip install '.[{extra}]'`, of a wheel `pip install \"$(ls ./wingline-*.whl)[{extra}]\"`"
