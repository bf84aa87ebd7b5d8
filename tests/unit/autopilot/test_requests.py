"""Requests for our messages, by REQUEST_MESSAGE and SET_MESSAGE_INTERVAL, at the whole output."""

from collections import Counter
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.config import AutopilotConfig, parse_config
from tests.support.emitted import command_long
from tests.support.leader import AUTOPILOT, S, T, estimate, origin, own_pose
from tests.support.vehicle_records import TRAFFIC, nav_state

NOW = 1_800_000_000 * S
CONFIG = {
    "link": [{"name": "fc", "url": "udpin:127.0.0.1:0"}, {"name": "gcs", "url": "udpin:127.0.0.1:0"}],
    "autopilot": {"request_rates": False, "trusted": [255]},
    "odometry": {"link": "gcs"},
    "traffic_out": {"link": "gcs", "adsb_vehicle": "all"},
    "leader_out": [{"link": "gcs", "system": 99, "rates_hz": {"FOLLOW_TARGET": 20.0, "TARGET_RELATIVE": 5.0}}],
}


def output(*, has_leader: bool = True) -> AutopilotOutput:
    out = AutopilotOutput(parse_config(CONFIG))
    out.connect(AUTOPILOT)
    if has_leader:
        note(out, [own_pose(), estimate()])
        out.respond("fc", [origin()], NOW)
    tick(out, 0)
    return out


def note(out: AutopilotOutput, records: list[Any]) -> None:
    for record in records:
        assert list(out.publish(record)) == []


def tick(out: AutopilotOutput, ms: int) -> list[tuple[str, int]]:
    """(channel, message number) of what is sent by a tick."""
    t = ms * 1_000_000
    sent = out.tick(NOW + t, healthy=True, rates={}, boot_ns=T + t % (400 * 1_000_000))
    return [(o.channel, int.from_bytes(frame[7:10], "little")) for o in sent for frame in o.frames]


def ask(
    out: AutopilotOutput, command: int, *params: float, channel: str = "gcs", component: int = 191
) -> list[Any]:
    message = command_long(command, *params, component=component)
    parser = dialect.MAVLink(None)
    frames = out.respond(channel, [message], NOW).frames
    return [m for frame in frames for m in parser.parse_buffer(frame) or []]


def sent_in_a_second(out: AutopilotOutput) -> Counter[int]:
    counts: Counter[int] = Counter()
    for ms in range(20, 1020, 20):
        counts.update(number for channel, number in tick(out, ms) if channel == "gcs")
        for record in (nav_state(20_000 + ms), TRAFFIC):
            counts.update(int.from_bytes(f[7:10], "little") for o in out.publish(record) for f in o.frames)
    return counts


@pytest.mark.parametrize(
    ("params", "result"),
    [
        ((144, float("nan")), 2),
        ((144, 5_000.0), 2),  # 200 Hz
        ((144, -7.0), 2),
        ((30, 100_000.0), 3),  # ATTITUDE: not ours
        ((float("nan"), 100_000.0), 3),
        ((144.5, 100_000.0), 3),
    ],
)
def test_an_interval_that_cannot_be_is_refused(params: tuple[float, float], result: int) -> None:
    out = output()
    assert [m.result for m in ask(out, 511, *params)] == [result]
    assert ask(out, 510, 144)[1].interval_us == 50_000


def test_a_message_that_is_requested_comes_once_though_it_is_off() -> None:
    out = output()
    for number in (144, 331):
        ask(out, 511, number, -1)
        (ack,) = ask(out, 512, number)
        assert (ack.command, ack.result) == (512, {144: 0, 331: 1}[number])  # no ODOMETRY before there is a state
    assert sent_in_a_second(out)[144] == 1


def test_a_message_that_cannot_be_made_now_is_rejected_for_now() -> None:
    (ack,) = ask(output(has_leader=False), 512, 144)
    assert ack.result == 1


def test_a_stream_is_changed_only_on_its_own_link() -> None:
    out = output()
    assert [m.result for m in ask(out, 511, 331, 100_000, channel="fc")] == [3]


def test_what_all_components_are_asked_for_is_answered_by_us_only_if_it_is_ours() -> None:
    out = output()
    assert [m.result for m in ask(out, 511, 144, 100_000, component=0)] == [0]
    assert ask(out, 512, 30, component=0) == []
    assert ask(out, 400, 1, component=0) == []


def test_the_origin_is_requested_until_it_comes_if_we_may_request() -> None:
    wanted = AutopilotConfig().rates_hz | {"ATTITUDE": 1.0}
    for may, expected in ((False, 0), (True, 3)):
        out = AutopilotOutput(
            parse_config(CONFIG | {"autopilot": {"request_rates": may, "rates_hz": {"ATTITUDE": 1.0}}})
        )
        out.connect(AUTOPILOT)
        asked = 0
        for ms in range(0, 12_000, 50):
            for o in out.tick(NOW + ms * 1_000_000, healthy=True, rates={}):
                parser = dialect.MAVLink(None)
                for m in (m for f in o.frames for m in parser.parse_buffer(f) or []):
                    is_it = m.get_type() == "COMMAND_LONG" and (m.command, m.param1) == (512, 49.0)
                    asked += is_it and o.channel == "fc"
        assert asked == expected
        out.respond("fc", [origin()], NOW)
        later = (f for o in out.tick(NOW + 60 * S, healthy=True, rates=wanted) for f in o.frames)
        assert not any(
            m.get_type() == "COMMAND_LONG" for f in later for m in dialect.MAVLink(None).parse_buffer(f)
        )


def test_a_leader_on_the_autopilots_own_system_is_refused_and_said() -> None:
    config = CONFIG | {"leader_out": [{"link": "gcs", "system": 7}]}
    out = AutopilotOutput(parse_config(config))
    assert out.connect(AUTOPILOT) == ["leader_out on gcs: `system` 7 is the autopilot's own; set another"]
    note(out, [own_pose(), estimate()])
    out.respond("fc", [origin()], NOW)
    assert not any(number == 144 for _, number in tick(out, 0))
