"""Every field of all messages that are sent in a flight made by hand, and in answer to a request of each kind."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.parameters import Parameters
from onboard.config import parse_config
from onboard.messages import Cause, Estimate, Heartbeat, LandedState, Lifecycle
from tests.support.emitted import LEADER, LINK, NOW_TIME_NS, answered, computer, everything, frames, sent
from tests.support.golden import assert_golden, numbers, rounded
from tests.support.leader import AUTOPILOT, S, T, estimate, origin, own_global, own_pose
from tests.support.vehicle_records import INTRUDER, TRAFFIC, nav_state

TICK_NS = 40_000_000
LED, NOT_LED = {3: 4, 12: 6 << 16}, {3: 5, 12: 4 << 16 | 3 << 24}  # GUIDED, OFFBOARD; LOITER, Hold
SENT = {"link": LINK, "rates_hz": dict.fromkeys(LEADER, 5.0) | {"SET_POSITION_TARGET_LOCAL_NED": 25.0}}


def leader(t: float) -> Estimate:
    """It flies off north-east, turns right, stops, comes towards us, is lost for 4 s, and climbs away."""
    speed = 6.0 if t < 12.0 else 0.0 if t < 18.0 else -4.0 if t < 24.0 else 8.0
    course = 0.6 + 0.15 * max(min(t, 12.0) - 5.0, 0.0)
    lost = 25.0 <= t < 29.0
    ahead = 30.0 + (3.0 * t if t < 12.0 else 36.0 - 2.5 * (t - 12.0) if t < 24.0 else 6.0 + 2.0 * (t - 24.0))
    v = (speed * math.cos(course) - 4.0, speed * math.sin(course), -1.0 if t > 29.0 else 0.0)
    return estimate(
        sequence=round(25 * t),
        t_ns=T + round(t * S),
        state=Lifecycle.LOST if lost else Lifecycle.TRACKING,
        valid=not lost,
        cause=Cause.TIMEOUT if lost else Cause.FUSED,
        reason="no image fused lately" if lost else "images fused",
        mean=(ahead, 4.0 + t, 2.0 - 0.2 * t, *v, 2.5, 0.5 if t < 12.0 else 0.0, 0.0),
        reset_count=int(t >= 29.0),
    )


def beat(kind: int, t: float) -> Heartbeat:
    """Armed from 1 s on, led from 2 to 33 s but for two seconds."""
    mode = (LED if 2.0 <= t < 33.0 and not 20.0 <= t < 22.0 else NOT_LED)[kind]
    return replace(AUTOPILOT, autopilot=kind, armed=t >= 1.0, custom_mode=mode)


def flown(kind: int) -> Iterator[tuple[float, bytes]]:
    """Each frame with its time, of 36 s behind that leader."""
    config = parse_config(
        {
            "link": [{"name": LINK, "url": "udpin:127.0.0.1:0"}],
            "odometry": {"link": LINK},
            "traffic_out": {"link": LINK, "adsb_vehicle": "all"},
            "leader_out": [SENT],
            "estimator": {"leader": {}},
        }
    )
    out = AutopilotOutput(config, Parameters(config, lambda _: None))
    out.connect(replace(AUTOPILOT, autopilot=kind))
    out.set_computer_status(computer())
    head = {"t_ns": T, "t_recv_ns": T, "system": 7, "component": 1}
    for k in range(25 * 36):
        t = k / 25
        now_ns, boot_ns = NOW_TIME_NS + k * TICK_NS, T + k * TICK_NS
        north, turn = 100.0 + 4.0 * t, 0.2 * math.sin(0.3 * t)
        pose = own_pose(t_ns=boot_ns, r_OF_n=(north, 50.0, -40.0), v_F_n=(4.0, 0.0, 0.0))
        pose = replace(pose, q_nb=(math.cos(turn), 0.0, 0.0, math.sin(turn)))
        made = [pose, leader(t), *([nav_state(boot_ns // 1_000_000)] if k % 5 == 0 else [])]
        made += [replace(TRAFFIC, t_ns=boot_ns, intruder=replace(INTRUDER, icao=k))] if k % 50 == 0 else []
        for record in made:
            yield from ((t, frame) for frame in frames(out.publish(record)))
        heard: list[Any] = [own_global((47.4 + 9e-6 * north, 8.5, 540.0), boot_ns)] if k % 5 == 0 else []
        heard += [beat(kind, t), LandedState(**head, on_ground=t < 0.5), origin()] if k % 25 == 0 else []
        yield from ((t, frame) for frame in out.respond(LINK, heard, now_ns).frames)
        ticked = out.tick(now_ns, healthy=t < 30.0, rates={"front": 25.0}, boot_ns=boot_ns)
        yield from ((t, frame) for frame in frames(ticked))
    for line in out.take_lines():
        yield 36.0, line.encode()


def fields(message: Any) -> dict[str, Any]:
    values = {name: getattr(message, name) for name in message.fieldnames if "version" not in name}
    return values | {"sender": f"{message.get_srcSystem()}/{message.get_srcComponent()}"}


def decoded(sent_frames: Iterable[bytes]) -> Iterator[Any]:
    parser = dialect.MAVLink(None)
    for frame in sent_frames:
        yield from parser.parse_buffer(frame) or []


@pytest.mark.parametrize(("kind", "name"), [(3, "ardupilot"), (12, "px4")])
def test_what_is_sent_in_a_flight(kind: int, name: str) -> None:
    columns = defaultdict[tuple[str, str], list[Any]](list)
    lines = []
    for t, frame in flown(kind):
        if frame[:1] not in (b"\xfd", b"\xfe"):
            lines.append(frame.decode())
            continue
        for message in decoded([frame]):
            kind_of = message.get_type()
            for field, value in fields(message).items():
                columns[kind_of, field].append(value)
            if kind_of == "STATUSTEXT":
                lines.append(f"{t:.2f} s: {message.severity} {message.text}")
            elif kind_of == "SET_POSITION_TARGET_LOCAL_NED" and round(25 * t) % 50 == 0:
                shown = (
                    message.x,
                    message.y,
                    message.z,
                    message.vx,
                    message.vy,
                    message.vz,
                    message.afx,
                    message.afy,
                )
                lines.append(rounded(f"{t:.2f} s: {' '.join(map(str, (*shown, message.yaw, message.yaw_rate)))}"))
    for (message_name, field), values in sorted(columns.items()):
        if isinstance(values[0], str | bytes):
            text = " | ".join(str(value) for value in dict.fromkeys(values[:40]))
        else:
            text = numbers([value for each in values for value in (each if isinstance(each, list) else [each])])
        lines.append(f"{message_name} {field}: {len(values)} {text}")
    assert_golden(f"sent-{name}.txt", lines)


def test_what_is_sent_once_and_in_answer() -> None:
    out = everything()
    lines = []
    for part in (sent(out), answered(out)):
        lines += [rounded(f"{message.get_type()} {fields(message)}") for message in decoded(part)]
    assert_golden("sent-once.txt", lines)
