"""Everything that the daemon sends over MAVLink, as its own code makes it."""

from collections.abc import Iterable
from typing import Any, Final, get_args

from msgspec.structs import replace

from onboard.autopilot.output import AutopilotOutput, Outgoing
from onboard.autopilot.parameters import Parameters
from onboard.config import parse_config
from onboard.config.sections import LeaderMessage
from onboard.messages import (
    Clock,
    Command,
    ComputerStatus,
    Message,
    ParamAction,
    ParamRequest,
    Ping,
    TimeSync,
)
from onboard.wire.datagrams import OnRefused, ignore
from onboard.wire.mavlink.encode import message_number
from tests.support.leader import AUTOPILOT, S, T, estimate, origin, own_pose
from tests.support.vehicle_records import TRAFFIC, nav_state

NOW_TIME_NS: Final = 1_800_000_000 * S
LINK: Final = "gcs"
LEADER: Final[tuple[str, ...]] = get_args(LeaderMessage)
STREAMS: Final = frozenset({*LEADER, "ODOMETRY", "COLLISION", "HEARTBEAT", "TIMESYNC", "ONBOARD_COMPUTER_STATUS"})
CAMERA_COMPONENT_ID: Final = 100  # sends the messages of a camera
OF_CAMERA: Final = frozenset({"CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS", "CAMERA_INFORMATION"})
FIXED: Final = frozenset({"HEARTBEAT", "TIMESYNC", "SET_POSITION_TARGET_LOCAL_NED"})  # whose rates others rely on
ON_REQUEST: Final = frozenset({"AUTOPILOT_VERSION", "CAMERA_INFORMATION"})
# Answers and events, which are nobody's to request: what they answer is requested instead.
ANSWERS: Final = frozenset(
    {
        *("COMMAND_ACK", "MESSAGE_INTERVAL", "PING", "PARAM_VALUE", "PARAM_EXT_VALUE", "PARAM_EXT_ACK"),
        *("COMMAND_LONG", "PARAM_REQUEST_READ", "STATUSTEXT"),
    }
)


def everything(keys: dict[str, bytes] | None = None, refuse: OnRefused = ignore) -> AutopilotOutput:
    """An output that sends all it can on one link, with a leader and an autopilot."""
    config = parse_config(
        {
            "link": [{"name": LINK, "url": "udpin:127.0.0.1:0"}],
            "autopilot": {"trusted": [255]},
            "odometry": {"link": LINK},
            "traffic_out": {"link": LINK, "adsb_vehicle": "all"},
            "leader_out": [{"link": LINK, "system": 99, "rates_hz": dict.fromkeys(LEADER, 20.0)}],
            "estimator": {"leader": {}},
        }
    )
    out = AutopilotOutput(config, Parameters(config, lambda _: None), keys, refuse)
    out.connect(AUTOPILOT)
    for record in (own_pose(), estimate()):
        list(out.publish(record))
    out.respond(LINK, [origin()], NOW_TIME_NS)
    out._guide(T - S // 10, NOW_TIME_NS - S)
    for custom_mode in (5, 4):  # LOITER, GUIDED: it is led
        out.respond(LINK, [replace(AUTOPILOT, custom_mode=custom_mode)], NOW_TIME_NS - S)
    out.set_computer_status(computer())
    out.take_lines()
    return out


def computer() -> ComputerStatus:
    """Two cores, 1 of 4 GiB, 8 of 32 GiB, 61.4 deg C."""
    gib = 2**30
    return ComputerStatus(
        t_ns=NOW_TIME_NS,
        t_recv_ns=NOW_TIME_NS,
        clock=Clock.HOST,
        uptime=100.5,
        cpu_percent=(12.4, 100.0),
        memory_used=gib,
        memory_total=4 * gib,
        storage_used=8 * gib,
        storage_total=32 * gib,
        temperature=61.4,
    )


def sent(out: AutopilotOutput, now_ns: int = NOW_TIME_NS) -> list[bytes]:
    """The frames of one tick and of one record of each kind."""
    ticked = list(out.tick(now_ns, healthy=True, rates={}, boot_ns=T))
    published = [o for record in (nav_state(T // 1_000_000), TRAFFIC) for o in out.publish(record)]
    return frames([*ticked, *published])


def answered(out: AutopilotOutput) -> list[bytes]:
    """The frames that answer one request of each kind."""
    sender: dict[str, Any] = {
        "t_ns": NOW_TIME_NS,
        "t_recv_ns": NOW_TIME_NS,
        "clock": Clock.NONE,
        "system": 255,
        "component": 190,
    }
    to_us = {"target_system": 7, "target_component": 191}
    messages: list[Message] = [
        Ping(**sender, time_us=1, number=2, target_system=0, target_component=0),
        TimeSync(**sender, tc1_ns=0, ts1_ns=7),
        ParamRequest(**sender, **to_us, action=ParamAction.LIST, extended=False),
        ParamRequest(**sender, **to_us, action=ParamAction.LIST, extended=True),
        ParamRequest(**sender, **to_us, action=ParamAction.SET, extended=True, name="CAM_SIGMA_PX", value=2.0),
    ]
    asked = ((510, "FOLLOW_TARGET"), *((512, name) for name in sorted(ON_REQUEST)))
    commands: list[Message] = [command(name, number) for number, name in asked]
    return out.respond(LINK, [*messages, *commands], NOW_TIME_NS).frames


def command(name: str, number: int, *params: float, component: int | None = None) -> Command:
    """A command about a message, to the component that sends it."""
    to = (CAMERA_COMPONENT_ID if name in OF_CAMERA else 191) if component is None else component
    return command_long(number, float(message_number(name)), *params, component=to)


def command_long(
    number: int, *params: float, t_ns: int = NOW_TIME_NS, system: int = 7, component: int = 191
) -> Command:
    """Return a ground station's command to a system and component; missing parameters are 0."""
    return Command(
        t_ns=t_ns,
        t_recv_ns=t_ns,
        clock=Clock.NONE,
        system=255,
        component=190,
        target_system=system,
        target_component=component,
        command=number,
        params=tuple([*params, *(0.0,) * 7][:7]),
    )


def frames(outgoing: Iterable[Outgoing]) -> list[bytes]:
    return [frame for o in outgoing for frame in o.frames]
