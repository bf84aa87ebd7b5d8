"""Whose a message must be: of every message that the decoder reads, what a stranger sends changes nothing."""

import math
import struct
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Datagram, Encoding, GimbalAttitude, MountAttitude, TargetPoints
from onboard.wire.mavlink.records import CONVERT
from tests.support.mavlink_frames import frame
from tests.support.streams import CIRCLE, EPOCH, FOCAL_LENGTH_PX, MS, Item, S, Stream, encode, feed, make_config

KINDS: Final = {kind.msgname: kind for kind in dialect.mavlink_map.values()}
# Those that any component of our own vehicle may send
ANY_COMPONENT: Final = {
    *("LANDING_TARGET", "CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_FOV_STATUS", "DISTANCE_SENSOR"),
    *("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "ADSB_VEHICLE"),
}
NAMES: Final = sorted({*CONVERT, *ANY_COMPONENT} & KINDS.keys())
VALUES: Final = {"hfov": 20.0, "autopilot": 12, "type": 2, "tc1": 3 * S, "ts1": EPOCH + 9 * S, "fix_type": 3}
FROM_NS: Final = 10 * S
CONFIG: Final = make_config(
    "camera.tracker=100", "camera.gimbal=154", "delay.camera_s=0.06", "estimator.own_state.publish_rate_hz=5.0"
)


def tracked(image: TargetPoints) -> bytes:
    """An image as CAMERA_TRACKING_IMAGE_STATUS of the camera on our own vehicle."""
    (u, v), half = image.center, 0.5 * math.dist(image.left, image.right)
    sides = (320 + FOCAL_LENGTH_PX * (u - half)) / 640, (240 + FOCAL_LENGTH_PX * v - 4) / 480
    sides += (320 + FOCAL_LENGTH_PX * (u + half)) / 640, (240 + FOCAL_LENGTH_PX * v + 4) / 480
    return frame(275, 126, struct.pack("<7f4B", *[math.nan] * 3, *sides, 1, 2, 4, 0), component=100)


def flight() -> list[Datagram]:
    """Own motion with an IMU, a camera on a gimbal that is level with us, and its images."""
    stream, items = Stream(t0=5.0, t1=14.0, sparse=True), list[Item]()
    for t_recv_ns, m in stream.items():
        items.append(Item(t_recv_ns, m))
        if type(m).__name__ == "Attitude":
            mount = MountAttitude(q=CIRCLE.attitude(m.t_ns).q_nb, frame="earth")
            gimbal = GimbalAttitude(
                t_ns=m.t_ns, t_recv_ns=t_recv_ns, system=1, component=154, device=154, mount=mount
            )
            items += [Item(t_recv_ns, gimbal), Item(t_recv_ns, CIRCLE.imu(m.t_ns))]
    found = []
    for datagram, (_, m) in zip(encode(items), items, strict=True):
        is_image = isinstance(m, TargetPoints)
        found.append(_datagram(datagram.t_recv_ns, tracked(m)) if is_image else datagram)
    return found


def _datagram(t_recv_ns: int, data: bytes) -> Datagram:
    return Datagram(channel="udp", encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=data)


def foreign(name: str, t_ns: int, system: int, component: int) -> bytes:
    """A message of another sender, with plausible values that are not ours."""
    kind = KINDS[name]
    message = kind.__new__(kind)
    args = []
    for field, form, count in zip(kind.fieldnames, kind.fieldtypes, _lengths(kind), strict=True):
        value: Any = VALUES.get(field, 0.5 if form in ("float", "double") else 1)
        value = {"time_boot_ms": t_ns // MS - 700, "time_usec": t_ns // 1000 - 700_000}.get(field, value)
        args.append(b"WPNAV_SPEED"[:count] if form == "char" else [value] * count if count else value)
    kind.__init__(message, *args)
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component)))


def _lengths(kind: Any) -> list[int]:
    """The lengths of the fields' arrays, 0 for a single value."""
    return [kind.array_lengths[kind.ordered_fieldnames.index(field)] for field in kind.fieldnames]


def flown(names: list[str], system: int, component: int) -> str:
    """The outputs of the flight beside which these messages of another sender come."""
    sent = []
    for datagram in flight():
        sent.append(datagram)
        if datagram.t_recv_ns - EPOCH > FROM_NS and len(sent) % 5 == 0:
            at = datagram.t_recv_ns
            sent += [_datagram(at, foreign(name, at - EPOCH, system, component)) for name in names]
    return repr(feed(sent, CONFIG).outputs)


def test_every_message_that_is_read_is_tried() -> None:
    assert {*CONVERT, *ANY_COMPONENT} - {*NAMES} <= {"CURRENT_MODE"}, "pymavlink's dialect does not have it"


def test_what_a_stranger_sends_changes_nothing() -> None:
    """Another system's autopilot and camera, and another component of our own."""
    alone = flown([], 0, 0)
    assert alone.count("valid=True") > 100
    for system, component in ((66, 1), (66, 100), (1, 66)):
        names = [name for name in NAMES if system == 66 or name not in ANY_COMPONENT]
        if flown(names, system, component) != alone:
            changed = [name for name in names if flown([name], system, component) != alone]
            raise AssertionError((system, component, changed))


def test_what_our_own_vehicle_sends_counts() -> None:
    """So that the test above says something of each message: no sender that may send it is turned away."""
    for name in NAMES:
        senders = [(1, 1), (1, 66)] if name in ANY_COMPONENT else [(1, 1)]
        for system, component in senders:
            at = EPOCH + FROM_NS
            sent = [*flight()[:20], _datagram(at, foreign(name, FROM_NS, system, component))]
            rejected = feed(sent, CONFIG).rejected
            assert not {"other_system", "other_component"} & rejected.keys(), (name, component)
