"""PX4's own logs: rows out of order, stamps that cannot be, fields that are missing or unknown."""

import struct
from pathlib import Path
from typing import Any

import pytest

from onboard.analysis.report.vehicle import VehicleSeries
from onboard.messages import ActuatorOutputs, Battery, Clock, GpsFix, Heartbeat, Message, ParamValue, StatusText
from onboard.wire.logs.tlog import NotALogError
from onboard.wire.logs.ulog import read_ulog

TYPES = {"uint64_t": "Q", "int32_t": "i", "uint8_t": "B", "float": "f", "double": "d"}
GPS = {
    "timestamp": "uint64_t",
    **dict.fromkeys(("latitude_deg", "longitude_deg", "altitude_msl_m"), "double"),
    **dict.fromkeys(("eph", "epv", "vel_m_s", "cog_rad", "vel_d_m_s"), "float"),
    **dict.fromkeys(("fix_type", "satellites_used", "vel_ned_valid"), "uint8_t"),
}
ROW = dict(zip(GPS, (0, 50.0, 10.0, 300.0, 1.0, 2.0, 5.0, 0.5, 0.25, 3, 12, 1), strict=True))
Rows = list[dict[str, Any]]


def message(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<HB", len(data), kind[0]) + data


def ulog(
    path: Path,
    rows: Rows,
    *,
    fields: dict[str, str] = GPS,
    instance: int = 0,
    system: int = 1,
    name: str = "vehicle_gps_position",
    boards: tuple[Rows, ...] = (),
) -> Path:
    """A log of one topic; `boards` are further instances of it."""
    form = f"{name}:{';'.join(f'{kind} {field}' for field, kind in fields.items())};"
    key = b"int32_t MAV_SYS_ID"
    layout = struct.Struct("<H" + "".join(TYPES[kind] for kind in fields.values()))
    path.write_bytes(
        b"ULog\x01\x12\x35"  # as PX4's guide prints it
        + struct.pack("<BQ", 1, 1_000_000)
        + message(b"B", bytes(40))
        + message(b"F", form.encode())
        + message(b"P", bytes([len(key)]) + key + struct.pack("<i", system))
        + message(b"A", struct.pack("<BH", instance, 0) + name.encode())
        + b"".join(message(b"A", struct.pack("<BH", k, k) + name.encode()) for k in range(1, len(boards) + 1))
        + b"".join(
            message(b"D", layout.pack(k, *(row[field] for field in fields)))
            for k, part in enumerate((rows, *boards))
            for row in part
        )
    )
    return path


def rows_at(*stamps_s: float) -> Rows:
    return [ROW | {"timestamp": round(t * 1e6)} for t in stamps_s]


def read(path: Path) -> tuple[list[Message], list[str]]:
    """All but the parameters."""
    lost: list[str] = []
    messages = [m for m in read_ulog(path, lost.append) if not isinstance(m, ParamValue)]
    return messages, lost


STAMPS = tuple(2.0 + 0.2 * k for k in range(1500))


def with_stamp(k: int, t: float) -> Rows:
    return rows_at(*STAMPS[:k], t, *STAMPS[k + 1 :])


@pytest.mark.parametrize("k", [0, 500, 1499])
@pytest.mark.parametrize("t", [0.0, 1e6, 1.8e13], ids=["zero", "11 days", "the last there is"])
def test_a_stamp_that_cannot_be_costs_its_row_alone(tmp_path: Path, k: int, t: float) -> None:
    (_, *fixes), lost = read(ulog(tmp_path / "a.ulg", with_stamp(k, t)))
    if (k, t) == (0, 0.0):  # which may well be: two seconds before the next
        assert (len(fixes), lost) == (1500, [])
        return
    assert [m.t_ns for m in fixes] == [round(s * 1e6) * 1000 for i, s in enumerate(STAMPS) if i != k]
    assert lost == ["vehicle_gps_position: a row's stamp is far from those of the rows around it"]


@pytest.mark.parametrize("first_utc_us", [0, 1_735_084_800_000_000], ids=["no fix yet", "a week before"])
def test_arrivals_are_unix_times_of_most_fixes(first_utc_us: int, tmp_path: Path) -> None:
    """Images with Unix times were later than the log's end."""
    assert boot_time(tmp_path / "a.ulg", 1_735_689_600, first_utc_us) == ({1_735_689_600 * 10**9}, [])


def test_weeks_that_have_rolled_over_are_named_and_corrected(tmp_path: Path) -> None:
    lost = ["GPS: its time is 1,024 weeks early, a rollover of the receiver's weeks; it is corrected"]
    assert boot_time(tmp_path / "a.ulg", 1_735_689_600 - 1024 * 604_800) == ({1_735_689_600 * 10**9}, lost)


def boot_time(path: Path, utc_s: int, first_utc_us: int | None = None) -> tuple[set[int], list[str]]:
    """Unix times at boot, ns, of the messages of a log whose fixes say `utc_s`, and what was lost."""
    rows = [row | {"time_utc_usec": utc_s * 10**6 + row["timestamp"]} for row in rows_at(*STAMPS[:9])]
    if first_utc_us is not None:
        rows[0]["time_utc_usec"] = first_utc_us
    messages, lost = read(ulog(path, rows, fields=GPS | {"time_utc_usec": "uint64_t"}))
    return {m.t_recv_ns - m.t_ns for m in messages}, lost


def test_rows_out_of_order_are_put_in_order_and_gaps_are_kept(tmp_path: Path) -> None:
    stamps = (1.0, 1.4, 1.2, 1.6, 40.0, 40.2)
    (_, *fixes), lost = read(ulog(tmp_path / "a.ulg", rows_at(*stamps)))
    assert [m.t_ns for m in fixes] == [round(s * 1e6) * 1000 for s in sorted(stamps)]
    assert lost == []


@pytest.mark.parametrize(
    ("field", "attribute"),
    [
        ("cog_rad", "course_rad"),
        ("vel_m_s", "ground_speed"),
        ("eph", "h_acc"),
        ("epv", "v_acc"),
        ("vel_d_m_s", "v_down"),
    ],
)
def test_nan_and_a_missing_field_are_unknown(tmp_path: Path, field: str, attribute: str) -> None:
    (_, plain), _ = read(ulog(tmp_path / "a.ulg", rows_at(1.0)))
    assert getattr(plain, attribute) == ROW[field]
    (_, fix), lost = read(ulog(tmp_path / "a.ulg", [ROW | {field: float("nan")}]))
    assert (getattr(fix, attribute), lost) == (None, [])
    fields = {name: kind for name, kind in GPS.items() if name != field}
    (_, fix), lost = read(ulog(tmp_path / "a.ulg", rows_at(1.0), fields=fields))
    assert (getattr(fix, attribute), lost) == (None, [])


def test_a_row_without_what_it_needs_is_one_lost_row(tmp_path: Path) -> None:
    rows = rows_at(1.0, 1.2, 1.4)
    rows[1]["latitude_deg"] = float("nan")
    (_, *fixes), lost = read(ulog(tmp_path / "a.ulg", rows))
    assert [m.t_ns for m in fixes] == [1_000_000_000, 1_400_000_000]
    assert lost == ["vehicle_gps_position: a row's latitude_deg is no finite number"]


def test_a_topic_without_what_it_needs_is_named(tmp_path: Path) -> None:
    fields = {name: kind for name, kind in GPS.items() if name != "altitude_msl_m"}
    lost: list[str] = []
    with pytest.raises(NotALogError, match="holds no attitude"):
        list(read_ulog(ulog(tmp_path / "a.ulg", rows_at(1.0), fields=fields), lost.append))
    assert lost == ["vehicle_gps_position: it has no field altitude_msl_m; the topic is not used"]


def test_another_instance_and_another_system_are_read(tmp_path: Path) -> None:
    (heartbeat, fix), lost = read(ulog(tmp_path / "a.ulg", rows_at(1.0), instance=1, system=7))
    assert isinstance(heartbeat, Heartbeat)
    assert isinstance(fix, GpsFix)
    assert (heartbeat.system, fix.system, lost) == (7, 7, [])


def test_the_motors_are_the_outputs_that_move_most(tmp_path: Path) -> None:
    fields = {"timestamp": "uint64_t", "noutputs": "uint8_t", **{f"output[{k}]": "float" for k in range(5)}}

    def board(*first: float) -> Rows:
        outputs = {f"output[{k}]": 1500.0 for k in range(1, 5)}
        return [
            {"timestamp": 1_000_000 + 100_000 * i, "noutputs": 4, **outputs, "output[0]": value}
            for i, value in enumerate(first)
        ]

    path = ulog(
        tmp_path / "a.ulg",
        board(0.0, 0.0),
        fields=fields,
        name="actuator_outputs",
        boards=(board(1400.4, 1612.6), board(1008.0, 1009.0)),
    )
    (_, *outputs), lost = read(path)
    assert [type(m) for m in outputs] == [ActuatorOutputs, ActuatorOutputs]
    assert [m.pwm_us for m in outputs if isinstance(m, ActuatorOutputs)] == [
        (1400, 1500, 1500, 1500),
        (1613, 1500, 1500, 1500),
    ]
    assert lost == []


def test_a_battery_without_a_voltage_is_left_out(tmp_path: Path) -> None:
    fields = {"timestamp": "uint64_t", "voltage_v": "float"}
    rows = [{"timestamp": 1_000_000 + 100_000 * i, "voltage_v": v} for i, v in enumerate((22.5, 0.0))]
    (_, *batteries), _ = read(ulog(tmp_path / "a.ulg", rows, fields=fields, name="battery_status"))
    assert [m.voltage_v for m in batteries if isinstance(m, Battery)] == [22.5]


def test_texts_are_said_at_their_time_and_begin_no_time_base(tmp_path: Path) -> None:
    path = ulog(tmp_path / "a.ulg", rows_at(50.0, 52.0))
    said = [(51.0, b"4", b"Low battery"), (51.5, b"6", b"Takeoff detected")]
    logged = (message(b"L", struct.pack("<cQ", level, round(t * 1e6)) + text) for t, level, text in said)
    path.write_bytes(path.read_bytes() + b"".join(logged))
    messages, lost = read(path)
    texts = [m for m in messages if isinstance(m, StatusText)]
    assert [(m.t_ns, m.severity, m.text, m.clock) for m in texts] == [
        (51_000_000_000, 4, "Low battery", Clock.NONE),
        (51_500_000_000, 6, "Takeoff detected", Clock.NONE),
    ]
    assert [m.t_ns for m in messages] == sorted(m.t_ns for m in messages)
    assert lost == []


def test_parameters_follow_the_heartbeat_and_those_set_later_come_at_their_time(tmp_path: Path) -> None:
    path = ulog(tmp_path / "a.ulg", rows_at(50.0, 52.0))
    text = path.read_bytes()
    at = text.index(message(b"A", b"\0\0\0vehicle")[2:])  # its length is another
    key = bytes([len(b"int32_t RTL_TYPE")]) + b"int32_t RTL_TYPE"
    defaults = message(b"P", key + struct.pack("<i", 3)) + message(b"Q", b"\x01" + key + struct.pack("<i", 0))
    later = message(b"P", key + struct.pack("<i", 2))
    path.write_bytes(text[: at - 2] + defaults + text[at - 2 :] + later)
    messages = list(read_ulog(path))
    assert isinstance(messages[0], Heartbeat)
    found = [m for m in messages if isinstance(m, ParamValue)]
    assert [(m.name, m.value, m.default, m.clock) for m in found] == [
        ("MAV_SYS_ID", 1.0, 1.0, Clock.NONE),
        ("RTL_TYPE", 3.0, 0.0, Clock.NONE),
        ("RTL_TYPE", 2.0, None, Clock.NONE),
    ]
    assert [m.t_ns for m in found] == [1_000_000_000, 1_000_000_000, 52_000_000_000]


def test_modes_and_arming_are_those_of_the_vehicle(tmp_path: Path) -> None:
    """A report of a .ulg had neither: its one heartbeat was disarmed, in no mode."""
    fields = {"timestamp": "uint64_t", "nav_state": "uint8_t", "arming_state": "uint8_t"}
    flown = [(2, 1), (2, 2), (17, 2), (19, 2), (5, 2), (18, 2), (18, 1), (99, 1)]
    rows = [
        {"timestamp": 1_000_000 + 500_000 * i, "nav_state": state, "arming_state": arming}
        for i, (state, arming) in enumerate(flown)
    ]
    found, lost = read(ulog(tmp_path / "a.ulg", rows, fields=fields, name="vehicle_status"))
    series = VehicleSeries()
    for message in found:
        series.hear(message, message.t_ns * 1e-9)
    assert [(round(t, 1), kind, text) for t, kind, text in series.words[1:]] == [
        (1.0, "mode", "POSCTL"),
        (1.5, "armed", ""),
        (2.0, "mode", "AUTO TAKEOFF"),
        (2.5, "mode", "AUTO FOLLOW_TARGET"),
        (3.0, "mode", "AUTO RTL"),
        (3.5, "mode", "AUTO LAND"),
        (4.0, "disarmed", ""),
        (4.5, "mode", str(99 << 24)),
    ]
    assert lost == []


def test_a_position_that_the_estimator_does_not_trust_is_left_out(tmp_path: Path) -> None:
    numbers = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), "float")
    flags = dict.fromkeys(("xy_valid", "z_valid"), "uint8_t")
    rows: Rows = [
        {"timestamp": 1_000_000 + 100_000 * i, **dict.fromkeys(numbers, 1.0), **dict.fromkeys(flags, 1)}
        for i in range(3)
    ]
    rows[0]["xy_valid"] = rows[1]["z_valid"] = 0
    fields = {"timestamp": "uint64_t", **numbers, **flags}
    (_, *found), lost = read(ulog(tmp_path / "a.ulg", rows, fields=fields, name="vehicle_local_position"))
    assert ([m.t_ns for m in found], lost) == ([1_200_000_000], [])
