"""Causes in refused messages, links, sinks and this computer."""

from collections.abc import Iterator
from typing import Final

from onboard.health.causes_camera import MIN_JUDGED_COUNT, of_camera, stamp_reading
from onboard.health.needs import Moment
from onboard.health.words import NOTHING, WORDS
from onboard.messages import DOUBT_CAUSES, Advice, Severity
from onboard.messages.causes import Cause
from onboard.units import NS_PER_S

COUNT_WINDOW_NS: Final = 10 * NS_PER_S
MAX_TIMER_LAG_S: Final = 0.15  # by which the daemon's timer may be late
STALLED_LAG_S: Final = 1.0  # by which it is late when the program did not run at all, or hardly
MIN_STORAGE_BYTES: Final = 200_000_000
MIN_MEMORY_BYTES: Final = 100_000_000
# of a silent autopilot, which has advice of its own
WITHOUT_AUTOPILOT: Final = (Cause.BEFORE_HEARTBEAT, Cause.NO_TIME_BASE)
BY_STAMP: Final = (Cause.TOO_OLD, Cause.TOO_NEW, Cause.NO_POSE, Cause.DUPLICATE)
WITHOUT_MOTION: Final = ("filter_has_no_position", "filter_has_no_velocity")  # by the autopilot's own filter
# Causes that refuse single images of a sound camera: the leader is at the edge or too far away to show its wing,
# our own motion has just begun, or a detector gives one aircraft two boxes.
RARE_CAUSES: Final = (Cause.OUT_OF_VIEW, Cause.NO_POSE, Cause.DIRECTION_ONLY, Cause.DUPLICATE)
USED: Final = ("fused", "fused_late")
MIN_REFUSED_RATIO: Final = 0.3  # of all images, for a rare cause that is named
ROOM: Final = "make room (`df -h`, `du -sh *`), or set `path` of [recorder]"


def refused(m: Moment) -> Iterator[Advice]:
    """Messages that were refused, by their cause."""
    for refusal in reversed(m.now.refusals):
        if not 0 <= m.now.t_recv_ns - refusal.t_recv_ns <= COUNT_WINDOW_NS or refusal.t_recv_ns <= m.stood_ns:
            continue
        if _has_own_advice(m, refusal.cause) or _is_rare(m, refusal.cause):
            continue
        remedy = WORDS.get(refusal.cause, NOTHING).refusal
        what = "" if refusal.cause in DOUBT_CAUSES else "refused from "
        yield Advice(
            kind=remedy.advice,
            severity=remedy.severity,
            about=f"{refusal.source}: {refusal.reason}",
            what=f"{what}{refusal.source}: {refusal.reason}",
            count=refusal.count,
            remedy=of_camera(m, refusal.source.removeprefix("camera "), remedy.words),
            text=f"{_shortened(refusal.source)}: {remedy.short}",
        )


def _has_own_advice(m: Moment, cause: Cause) -> bool:
    """Whether a refusal follows from what has advice of its own: no autopilot, no motion, another clock."""
    if cause in WITHOUT_AUTOPILOT or not m.now.followed:
        return cause in WITHOUT_AUTOPILOT
    if cause in BY_STAMP and any(stamp_reading(m, *camera) is not None for camera in m.now.cameras.items()):
        return True
    is_over = not m.verdicts(f"leader.{Cause.NO_POSE}")
    return cause is Cause.NO_POSE and (is_over or not m.has_motion or any(map(m.rejected, WITHOUT_MOTION)))


def _is_rare(m: Moment, cause: Cause) -> bool:
    """Whether the refused images of a cause are so few that they show nothing of the set-up.

    Of wrong pixels or stamps, more than a few are refused from the start.
    """
    if cause not in RARE_CAUSES:
        return False
    refused, *used = (m.now.verdicts.get(f"leader.{verdict}", 0) for verdict in (cause, *USED))
    is_few = cause is not Cause.OUT_OF_VIEW and refused < MIN_JUDGED_COUNT
    return refused < MIN_REFUSED_RATIO * (refused + sum(used)) or is_few


def links(m: Moment) -> Iterator[Advice]:
    """A link without its peer, and datagrams that are lost."""
    for name, health in m.now.links.items():
        before = m.before.links.get(name, health)
        if health.cause is Cause.NAME_SHARED:
            yield Advice(
                kind="name",
                severity=Severity.ERROR,
                about=f"link {name}",
                what=health.error,
                remedy="give each its own `vehicle` of [zenoh] (`onboard init --vehicle NAME`), and start it anew",
                text="two vehicles have one name",
                over="the vehicle's name is its own",
            )
        elif health.error:
            cause = "tls" if health.cause is Cause.TLS else "link"
            yield Advice(
                kind=cause,
                severity=Severity.WARNING,
                about=f"link {name}",
                what=f"link {name}: {health.error}; trying again",
                remedy=_link_remedy(m, name, cause),
                text=f"link {name} is not connected",
                over=f"link {name}: connected",
            )
        if health.refused > before.refused:
            yield Advice(
                kind="link",
                severity=Severity.WARNING,
                about=f"link {name}",
                what=f"link {name}: refused a connection from {health.refused_from}: another peer still sends",
                remedy="close one of the two, or give each a [[link]] of its own",
                text=f"link {name}: second peer refused",
            )


def _link_remedy(m: Moment, name: str, cause: str) -> str:
    if cause == "tls":
        return (
            "check `ca_file`, `certificate_file` and `private_key_file` of [zenoh], and the clock of this computer"
        )
    if name == "zenoh":
        return "start `onboard router CONFIG.toml` there, or set `connect` of [zenoh]"
    url = next((link.url for link in m.needs.links if link.name == name), "")
    if url.startswith("serial:"):
        return f"plug the device in, or set `url` of [[link]] {name}: `ls /dev/serial/by-id` lists them"
    return f"start what is at its other end, or set `url` of [[link]] {name} (now {url})"


def sinks(m: Moment) -> Iterator[Advice]:
    """A sink that fails: a recording may be missing."""
    for name, health in m.now.sinks.items():
        if health.error:
            yield Advice(
                kind="disk" if health.cause is Cause.DISK_FULL else "sink",
                severity=Severity.WARNING,
                about=name,
                what=f"{name}: {health.error}",
                remedy=ROOM if name == "recorder" else "",
                text=f"{name}: {health.error}",
                over=f"{name}: works again",
            )


def slow(m: Moment) -> Iterator[Advice]:
    """This computer is too slow for what comes."""
    signs, load = [], m.now.computer
    has_stood = load.lag > STALLED_LAG_S  # what was skipped then shows no slow computer afterwards
    for name, health in m.now.links.items():
        before = m.before.links.get(name, health)
        if health.dropped > before.dropped:
            signs.append(f"link {name} lost {health.dropped - before.dropped} datagrams")
        if health.skipped > before.skipped and (has_stood or m.before.t_recv_ns >= m.stood_ns):
            count = health.skipped - before.skipped
            signs.append(f"link {name}: {count} datagrams had waited too long and were left out")
        if health.shed > before.shed:
            signs.append(f"link {name}: too many messages; {health.shed - before.shed} were left out")
    for name, sink in m.now.sinks.items():
        before_it = m.before.sinks.get(name, sink)
        lost = sink.dropped_important - before_it.dropped_important
        if lost > 0 and not (sink.error or before_it.error or (name == "recorder" and _is_full(m))):
            signs.append(f"{name} lost {lost} records")
    if load.lag > MAX_TIMER_LAG_S and m.before.computer.lag > MAX_TIMER_LAG_S and m.before is not m.now:
        signs.append(f"the daemon is {load.lag:.2f} s late")
    if has_stood:
        yield Advice(
            kind="slow",
            severity=Severity.WARNING,
            about="pause",
            what=", ".join([f"this program stood still for {load.lag:.1f} s", *signs]),
            remedy="let nothing pause it (`docker pause`, suspend); give it storage that does not stall (`dmesg`),"
            " memory without swap, and a share of the processor",
            text=f"companion program stood still {load.lag:.0f} s",
            over="this program runs again",
        )
    elif signs:
        busy = "" if load.cpu is None else f" (all cores {load.cpu:.0f} % busy)"
        yield Advice(
            kind="slow",
            severity=Severity.WARNING,
            about="computer",
            what="this computer is too slow for what comes: " + ", ".join(signs) + busy,
            remedy="stop other programs (`top`), send fewer images or targets, or lower `particles` and "
            "`publish_rate_hz` of [estimator.leader]",
            text="companion computer too slow",
        )


def storage(m: Moment) -> Iterator[Advice]:
    """Storage or memory that is about to run out."""
    load = m.now.computer
    if load.storage_free is not None and _is_full(m):
        yield Advice(
            kind="disk",
            severity=Severity.WARNING,
            about="storage",
            what=f"{load.storage_free / 1e6:.0f} MB of storage are free: the recording ends when they are used up",
            remedy=ROOM,
            text=f"storage: {load.storage_free / 1e6:.0f} MB left",
        )
    if load.memory_free is not None and load.memory_free < MIN_MEMORY_BYTES:
        yield Advice(
            kind="slow",
            severity=Severity.WARNING,
            about="memory",
            what=f"{load.memory_free / 1e6:.0f} MB of memory are free",
            remedy="stop other programs (`top`), or lower `max_targets` of [estimator.leader]",
            text="companion computer: little memory",
        )


def _is_full(m: Moment) -> bool:
    """Whether a recording has little room, and loses records for that."""
    free = m.now.computer.storage_free
    return "recorder" in m.now.sinks and free is not None and free < MIN_STORAGE_BYTES


def _shortened(source: str) -> str:
    """A source in few letters: the last parts of a key."""
    return source if len(source) <= 24 else source[-24:].partition("/")[2] or source[:24]
