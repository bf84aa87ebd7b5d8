"""The health as ROS's diagnostics show it."""

from typing import Any

import pytest

from onboard.messages import (
    Advice,
    Fault,
    FaultKind,
    Health,
    Lifecycle,
    Severity,
    SinkHealth,
    StreamHealth,
)
from onboard.messages.ros import Ros2Config
from onboard.wire.ros.diagnostics import statuses
from onboard.wire.ros.messages import RosEncoder


def health(**changed: Any) -> Health:
    fields: dict[str, Any] = {
        "t_ns": 0,
        "t_recv_ns": 2,
        "uptime": 3.0,
        "autopilot": "PX4, system 1",
        "autopilot_reboots": 0,
        "clock_source": "timesync",
        "clock_offset_ns": None,
        "round_trip": None,
        "streams": {"Attitude": StreamHealth(count=50, rate=49.5, age=0.01)},
        "states": {"leader": Lifecycle.TRACKING},
        "verdicts": {"leader.fused": 7, "leader.gated": 1, "own_state.fused": 3},
        "rejected": {},
        "sinks": {},
        "reasons": {"leader": "images fused"},
    }
    return Health(**fields | changed)


def advice(cause: str, severity: Severity, about: str = "") -> Advice:
    return Advice(cause=cause, severity=severity, about=about, what=f"{cause} is bad", remedy="mend it", text="t")


def test_all_is_well() -> None:
    program, leader = statuses(health())
    assert (program.level, program.name, program.message) == (0, "onboard", "nothing is wrong")
    assert program.values == {"Attitude, Hz": "49.5"}
    assert (leader.level, leader.name, leader.message) == (0, "onboard: leader", "tracking: images fused")
    assert leader.values == {"fused": "7", "gated": "1"}


def test_the_program_is_as_bad_as_its_worst_advice_and_each_is_there() -> None:
    causes = advice("stream", Severity.ERROR, "ATTITUDE"), advice("stream", Severity.WARNING, "GPS_RAW_INT")
    program, _ = statuses(health(advice=causes))
    assert (program.level, program.message) == (2, "stream is bad")
    assert program.values["stream GPS_RAW_INT"] == "stream is bad; mend it"
    assert program.values["stream ATTITUDE"] == "stream is bad; mend it"
    noticed, _ = statuses(health(advice=(advice("x", Severity.NOTICE),)))
    assert noticed.level == 0


@pytest.mark.parametrize(
    ("state", "level"),
    [("tracking", 0), ("coasting", 1), ("initialising", 1), ("searching", 1), ("lost", 2)],
)
def test_an_estimator_is_as_bad_as_its_state(state: str, level: int) -> None:
    _, leader = statuses(health(states={"leader": Lifecycle(state)}))
    assert leader.level == level


def test_a_fault_and_a_failed_sink_are_errors() -> None:
    fault = Fault(kind=FaultKind.MOTOR, part="motor 1", t_onset_ns=5, magnitude=0.25, unit="1")
    sinks = {"recorder": SinkHealth(sent=1, error="disk full"), "zenoh": SinkHealth(sent=2)}
    found = {
        s.name: s for s in statuses(health(states={"own_state": Lifecycle.TRACKING}, faults=(fault,), sinks=sinks))
    }
    assert (found["onboard: vehicle"].level, found["onboard: vehicle"].message) == (2, "motor 1")
    assert found["onboard: vehicle"].values == {"motor 1": "0.25 1"}
    assert (found["onboard: sink recorder"].level, found["onboard: sink recorder"].message) == (2, "disk full")
    assert found["onboard: sink zenoh"].level == 0


def test_another_decoder_reads_them() -> None:
    pytest.importorskip("rosbags", reason="needs the extra `ros2`")
    encoder = RosEncoder(Ros2Config())
    (message,) = encoder.encode(health(), 1_000_000_001)
    assert message.topic.name == "/diagnostics"
    array = encoder.store.deserialize_cdr(message.data, message.topic.kind)
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1, 1)
    assert [(s.level, s.name, s.hardware_id) for s in array.status] == [
        (0, "onboard", "PX4, system 1"),
        (0, "onboard: leader", "PX4, system 1"),
    ]
    assert [(v.key, v.value) for v in array.status[1].values] == [("fused", "7"), ("gated", "1")]
