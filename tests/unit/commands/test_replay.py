"""A replay's own parts: whose estimates are scored as the leader's."""

from pathlib import Path

import msgspec

from onboard.commands.log_replay import replay
from onboard.messages import CameraPoints, Clock, Datagram, Encoding, Intrinsics, Pixel, TargetPoints
from onboard.sinks.recorder import Recorder
from tests.support.streams import F_PX, Stream, encode, make_config

SIDE = 0.25  # the second aircraft is so far to the right in the image


def as_json(image: TargetPoints, target: str) -> bytes:
    """The image as a vision process publishes it, of another aircraft to the right."""
    pixels = (Pixel(u_px=F_PX * (u + SIDE), v_px=F_PX * v) for u, v in (image.center, image.left, image.right))
    center, left, right = pixels
    points = CameraPoints(
        t_ns=image.t_ns,
        clock=Clock.BOOT,
        camera="front",
        intrinsics=Intrinsics(fx_px=F_PX, fy_px=F_PX, cx_px=0.0, cy_px=0.0),
        center=center,
        left=left,
        right=right,
        target=target,
    )
    return msgspec.json.encode(points)


def test_a_second_leader_called_wingman_is_not_scored_as_the_leader(tmp_path: Path) -> None:
    items = Stream(t1=8.0).items()
    datagrams = []
    for item, datagram in zip(items, encode(items), strict=True):
        datagrams.append(datagram)
        if isinstance(item.message, TargetPoints):
            data = as_json(item.message, "wingman")
            datagrams.append(
                Datagram(channel="points", encoding=Encoding.POINTS, t_recv_ns=item.t_recv_ns, data=data)
            )
    recorder = Recorder(tmp_path / "flight.mcap")
    recorder.open()
    recorder.write(datagrams)
    recorder.close()
    every: set[str] = set()
    replayed = replay(
        tmp_path / "flight.mcap", make_config(), take=lambda output: every.add(getattr(output, "target", ""))
    )
    assert {"leader", "wingman"} <= every
    assert {estimate.target for estimate in replayed.estimates} == {"leader"}
