"""MAVLink bytes from records, read by pymavlink's own parser of the common dialect and by our decoder."""

import math
from typing import Any

import pytest

from onboard.messages import (
    ActuatorOutputs,
    Clock,
    Command,
    CommandAck,
    GlobalPosition,
    Heartbeat,
    LandedState,
    Message,
    StatusText,
    TargetPoints,
    TimeSync,
)
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.mavlink_frames import RECEIVE_TIME_NS, independent, one
from tests.support.mavlink_records import HEAD, RECORDS

UNSTAMPED = (Heartbeat, TimeSync, Command, CommandAck, LandedState, StatusText)  # MAVLink has no time in these


@pytest.mark.parametrize(("record", "name", "fields"), RECORDS, ids=[name for _, name, _ in RECORDS])
def test_an_independent_parser_reads_every_record(record: Message, name: str, fields: dict[str, Any]) -> None:
    (m,) = independent(MavlinkEncoder(7, 191).encode(record))
    assert (m.get_type(), m.get_srcSystem(), m.get_srcComponent()) == (name, 7, 191)
    assert {k: getattr(m, k) for k in fields} == pytest.approx(fields)


@pytest.mark.parametrize(("record", "name", "fields"), RECORDS, ids=[name for _, name, _ in RECORDS])
def test_every_record_is_decoded_again(record: Message, name: str, fields: dict[str, Any]) -> None:
    del name, fields
    back = one(MavlinkEncoder(record.system, record.component).encode(record))
    assert type(back) is type(record)
    expected = {field: getattr(record, field) for field in record.__struct_fields__}
    if isinstance(record, UNSTAMPED):
        expected |= {"t_ns": RECEIVE_TIME_NS, "clock": Clock.NONE}
    if isinstance(record, GlobalPosition) and record.heading_rad is not None:
        expected["heading_rad"] = pytest.approx(record.heading_rad % math.tau, abs=math.radians(0.005))
    if isinstance(record, ActuatorOutputs):
        expected["pwm_us"] = record.pwm_us + (0,) * (16 - len(record.pwm_us))
    for field, value in expected.items():
        exact = field in {"t_ns", "t_recv_ns", "clock", "pwm_us", "heading_rad"}
        assert getattr(back, field) == (value if exact else pytest.approx(value)), field


def test_image_points_leave_as_three_landing_targets_of_one_time() -> None:
    image = TargetPoints(**HEAD, camera="c", center=(0.1, -0.2), left=(0.0, -0.3), right=(0.2, -0.1))
    frames = independent(MavlinkEncoder(1, 191).encode(image))
    assert [m.target_num for m in frames] == [0, 1, 2]
    assert {m.time_usec for m in frames} == {5_250_000}
    assert {m.frame for m in frames} == {12}
    assert {m.position_valid for m in frames} == {0}
    assert [m.angle_x for m in frames] == pytest.approx([math.atan(0.1), 0.0, math.atan(0.2)])
    assert [m.angle_y for m in frames] == pytest.approx([math.atan(-0.2), math.atan(-0.3), math.atan(-0.1)])


def test_the_sequence_number_counts_every_frame() -> None:
    encoder = MavlinkEncoder(1, 191)
    data = b"".join(encoder.encode(RECORDS[0][0]) for _ in range(300))
    assert [m.get_seq() for m in independent(data)] == [i % 256 for i in range(300)]
