"""ArduPilot's DataFlash logs, as pymavlink writes them."""

import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Battery,
    Clock,
    EstimatorStatus,
    GlobalOrigin,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    ParamValue,
    StatusText,
)
from onboard.wire.logs.dataflash import read_dataflash
from onboard.wire.logs.tlog import NotALogError
from tests.support.dataflash import BOOT_TIME_S, WEEK, WEEK_MS, DataFlash, dataflash
from tests.support.streams import CIRCLE


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dataflash") / "flight.bin"
    dataflash(CIRCLE, 2.0, path)
    return path


def of(log: Path, kind: type[Message]) -> list[Message]:
    return [message for message, _ in read_dataflash(log) if isinstance(message, kind)]


def test_each_kind_is_read_at_its_rate(log: Path) -> None:
    counts = {
        kind: len(of(log, kind)) for kind in (Heartbeat, Imu, Attitude, LocalPosition, EstimatorStatus, GpsFix)
    }
    assert list(counts.values()) == [1, 200, 100, 50, 50, 10]
    assert [len(of(log, kind)) for kind in (Barometer, Battery, ActuatorOutputs, GlobalOrigin)] == [20, 20, 20, 1]


def test_rows_are_what_was_flown(log: Path) -> None:
    for attitude in of(log, Attitude):
        expected = CIRCLE.attitude(attitude.t_ns)
        assert isinstance(attitude, Attitude)
        sign = math.copysign(1.0, sum(a * b for a, b in zip(attitude.q_nb, expected.q_nb, strict=True)))
        assert [sign * q for q in attitude.q_nb] == pytest.approx(expected.q_nb, abs=2e-4)  # 0.01 degrees
        assert attitude.omega_b == pytest.approx(expected.omega_b, abs=1e-6)
    for position in of(log, LocalPosition):
        assert isinstance(position, LocalPosition)
        expected_position = CIRCLE.position(position.t_ns)
        assert position.r_OF_n == pytest.approx(expected_position.r_OF_n, abs=1e-4)
        assert position.v_F_n == pytest.approx(expected_position.v_F_n, abs=1e-5)
    first = of(log, Imu)[0]
    assert isinstance(first, Imu)
    assert first.f_b == pytest.approx(CIRCLE.imu(first.t_ns).f_b, abs=1e-5)


def test_the_vehicle_and_its_sensors_are_named(log: Path) -> None:
    (heartbeat,) = of(log, Heartbeat)
    assert isinstance(heartbeat, Heartbeat)
    assert (heartbeat.system, heartbeat.autopilot, heartbeat.vehicle_type) == (7, 3, 2)
    fix = of(log, GpsFix)[0]
    assert isinstance(fix, GpsFix)
    assert (fix.fix_type, fix.satellites, fix.h_acc, fix.v_acc) == (4, 12, 0.5, 0.8)
    assert (fix.lat_deg, fix.lon_deg, fix.alt_msl) == pytest.approx((47.0, 8.0, 450.0))
    (origin,) = of(log, GlobalOrigin)
    assert isinstance(origin, GlobalOrigin)
    assert origin.alt_msl == 400.0
    outputs = of(log, ActuatorOutputs)[0]
    assert isinstance(outputs, ActuatorOutputs)
    assert outputs.pwm_us == (1500, 1501, 1502, 1503)
    barometer = of(log, Barometer)[0]
    assert isinstance(barometer, Barometer)
    assert barometer.pressure_altitude == pytest.approx(0.0, abs=1e-6)


def test_arrivals_are_unix_times_of_the_gps(log: Path) -> None:
    for message, _ in read_dataflash(log):
        assert message.t_recv_ns == message.t_ns + BOOT_TIME_S * 1_000_000_000


def test_damage_costs_what_is_damaged(log: Path, tmp_path: Path) -> None:
    data, lost = log.read_bytes(), list[str]()
    broken = tmp_path / "broken.bin"
    half = len(data) // 2
    broken.write_bytes(data[:half] + b"\x00\xa3\x95\xfe" * 200 + data[half : len(data) - 7])
    kept = list(read_dataflash(broken, lost.append))
    assert len(kept) > 0.97 * len(list(read_dataflash(log)))
    assert lost


@pytest.mark.parametrize("hole", [bytes(4096), b"\xff" * 4096], ids=["zeros", "ones"])
def test_a_hole_prints_nothing(hole: bytes, log: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A line for each byte of it came from a library in C."""
    data, lost = log.read_bytes(), list[str]()
    broken = tmp_path / "broken.bin"
    half = len(data) // 2
    broken.write_bytes(data[:half] + hole + data[half + len(hole) :])
    assert len(list(read_dataflash(broken, lost.append))) > 300
    assert (capfd.readouterr(), len(lost)) == (("", ""), 1)


OLDER = {  # as firmware had them that numbers rows in their names, and before 2015
    "IMU2": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    **dict.fromkeys(("NKF1", "NKF6"), ("Qffffff", "TimeUS,VN,VE,VD,PN,PE,PD")),
    **dict.fromkeys(("NKF4", "NKF9"), ("QHb", "TimeUS,SS,PI")),
    "GPS": ("BIHBcLLeeEEfI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "EKF1": ("Iffffff", "TimeMS,VN,VE,VD,PN,PE,PD"),
    "RCOU": ("Ihhhh", "TimeMS,Ch1,Ch2,Ch3,Ch4"),
    "MSG": ("Z", "Message"),
}
SAID = {
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ARM": ("QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
}
GPS_EPOCH_S = 315_964_800  # 6 January 1980, Unix time
FIX = {"Status": 3, "GWk": WEEK, "GMS": WEEK_MS, "Lat": 47.0}


def written(path: Path, rows: Iterable[tuple[str, float, dict[str, Any]]], older: tuple[str, ...] = ()) -> Path:
    """A log of rows (kind, s, fields), which begins with an attitude."""
    log = DataFlash()
    for kind in older:
        log.add_format(kind, *OLDER[kind])
    log.row("ATT", 0)
    for kind, t, fields in rows:
        log.row(kind, round(t * 1e6), **fields)
    path.write_bytes(log.data)
    return path


BOTH = [(t, i) for t in (1, 2, 3, 4) for i in (0, 1)]
CORES = [("NKF4", 1, {"PI": 1}), ("NKF1", 2, {}), ("NKF6", 3, {}), ("NKF9", 4, {"PI": 0}), ("NKF1", 5, {})]
INSTANCES = {
    "second alone": (Imu, [("IMU", t, {"I": 1}) for t in (1, 2, 3)], [1, 2, 3]),
    "second by its name": (Imu, [("IMU2", t, {}) for t in (1, 2, 3)], [1, 2, 3]),
    "first of two": (Imu, [("IMU", t, {"I": i}) for t, i in BOTH], [1, 2, 3, 4]),
    "first falls silent": (Imu, [("IMU", 1, {}), *(("IMU", t, {"I": 1}) for t in (2, 3, 4, 5))], [1, 4, 5]),
    "second GPS": (GpsFix, [("GPS", t, {"I": 1, **FIX}) for t in (1, 2)], [1, 2]),
    "GPS without a fix": (
        GpsFix,
        [("GPS", t + i / 9, FIX | {"I": i, "Status": 3 * i}) for t, i in BOTH],
        [1, 2, 3, 28 / 9, 37 / 9],
    ),
    "cores by name": (LocalPosition, CORES, [3, 5]),
}


@pytest.mark.parametrize(("kind", "rows", "times"), INSTANCES.values(), ids=INSTANCES)
def test_the_first_instance_of_use_is_read(
    kind: type[Message], rows: list[tuple[str, float, dict[str, Any]]], times: list[float], tmp_path: Path
) -> None:
    """It was the one called 0, or nothing."""
    older = tuple({name for name, _, _ in rows} & {*OLDER} - {"GPS"})
    found = of(written(tmp_path / "log.bin", rows, older), kind)
    assert [m.t_ns * 1e-9 for m in found] == pytest.approx(times, abs=1e-6)


@pytest.mark.parametrize(("year", "leap_s"), [(2013, 16), (2016, 17), (2020, 18)])
def test_leap_seconds_are_those_of_the_date(year: int, leap_s: int, tmp_path: Path) -> None:
    """Before 2017, Unix times were 1 s and more off."""
    noon = datetime(year, 8, 4, 12, tzinfo=UTC).timestamp()
    week, second = divmod(int(noon) - GPS_EPOCH_S + leap_s, 604_800)
    fix = FIX | {"GWk": week, "GMS": second * 1000}
    (found,) = of(written(tmp_path / "log.bin", [("GPS", 10, fix)]), GpsFix)
    assert found.t_recv_ns == round(noon) * 10**9


def test_one_fix_of_another_week_decides_nothing(tmp_path: Path) -> None:
    """A receiver's first fix had the week before; all images were then later than the log's end."""
    fixes = [("GPS", t, FIX | {"GWk": WEEK - (t == 1), "GMS": WEEK_MS + 1000 * t}) for t in range(1, 6)]
    found = of(written(tmp_path / "log.bin", fixes), GpsFix)
    assert {m.t_recv_ns - m.t_ns for m in found} == {BOOT_TIME_S * 10**9}


@pytest.mark.parametrize("rollovers", [1, 2])
def test_weeks_that_have_rolled_over_are_named_and_corrected(rollovers: int, tmp_path: Path) -> None:
    """The log was of 2007, and all images were later than its end."""
    fixes = [("GPS", t, FIX | {"GWk": WEEK - 1024 * rollovers, "GMS": WEEK_MS + 1000 * t}) for t in range(1, 6)]
    lost: list[str] = []
    read = read_dataflash(written(tmp_path / "log.bin", fixes), lost.append)
    found = [m for m, _ in read if isinstance(m, GpsFix)]
    assert {m.t_recv_ns - m.t_ns for m in found} == {BOOT_TIME_S * 10**9}
    assert lost == ["GPS: its time is 1,024 weeks early, a rollover of the receiver's weeks; it is corrected"]


def test_rows_of_firmware_before_2015_have_milliseconds(tmp_path: Path) -> None:
    """The log was refused for the name of the GPS's time, which arrivals alone want."""
    fix = {"Status": 3, "TimeMS": WEEK_MS, "Week": WEEK, "T": 5000, "Lat": 47.0}
    (found,) = of(written(tmp_path / "log.bin", [("GPS", 0, fix)], ("GPS",)), GpsFix)
    assert (found.t_ns, found.t_recv_ns) == (
        5 * 10**9,
        (GPS_EPOCH_S - 18 + WEEK * 604_800) * 10**9 + WEEK_MS * 10**6,
    )


def test_rows_of_2015_are_read_and_texts_without_a_time_have_that_of_the_row_before(tmp_path: Path) -> None:
    rows: list[tuple[str, float, dict[str, Any]]] = [
        ("EKF1", 1, {"TimeMS": 1000, "VN": 2.0}),
        ("RCOU", 2, {"TimeMS": 2000, "Ch1": 1500, "Ch4": 1505}),
        ("MSG", 3, {"Message": b"Solo"}),
    ]
    log, lost = written(tmp_path / "log.bin", rows, ("EKF1", "RCOU", "MSG")), list[str]()
    found: dict[type, Any] = {type(m): m for m, _ in read_dataflash(log, lost.append)}
    assert lost == []
    assert found[LocalPosition].v_F_n[0] == 2.0
    assert found[ActuatorOutputs].pwm_us == (1500, 0, 0, 1505)
    assert (found[StatusText].t_ns, found[StatusText].text) == (2 * 10**9, "Solo")


def test_what_is_no_log_is_refused(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "short.bin"
    path.write_bytes(log.read_bytes()[:200])
    with pytest.raises(NotALogError, match="no attitude"):
        next(read_dataflash(path))


def test_modes_arming_and_texts_are_said(tmp_path: Path) -> None:
    """Also a mode from before the first row of a sensor; no time base begins with them."""
    log = DataFlash()
    for kind, form in SAID.items():
        log.add_format(kind, *form)
    log.row("MODE", 500_000, Mode=5, ModeNum=5)
    log.row("ATT", 1_000_000)
    log.row("MSG", 2_000_000, Message=b"EKF3 IMU0 is using GPS")
    log.row("ARM", 3_000_000, ArmState=1)
    log.row("MODE", 4_000_000, Mode=23, ModeNum=23)
    (tmp_path / "a.bin").write_bytes(log.data)
    first, *beats = (m for m in of(tmp_path / "a.bin", Heartbeat) if isinstance(m, Heartbeat))
    assert [(m.t_ns, m.armed, m.custom_mode) for m in (first, *beats)] == [
        *((1_000_000_000, False, 5), (3_000_000_000, True, 5), (4_000_000_000, True, 23))
    ]
    (text,) = (m for m in of(tmp_path / "a.bin", StatusText) if isinstance(m, StatusText))
    assert (text.text, text.severity) == ("EKF3 IMU0 is using GPS", 6)
    assert {m.clock for m in (text, *beats)} == {Clock.NONE}


def test_parameters_follow_the_heartbeat_with_their_defaults(tmp_path: Path) -> None:
    """Those of firmware before 2015 have no time, and no default before 4.4."""
    log = DataFlash()
    log.add_format("PARM", "Nf", "Name,Value")
    log.row("PARM", 0, Name=b"SYSID_THISMAV", Value=7.0)
    log.row("ATT", 1_000_000)
    log.row("PARM", 0, Name=b"RTL_ALT", Value=15.5)
    log.row("ATT", 2_000_000)
    log.row("PARM", 0, Name=b"RTL_ALT", Value=30.0)
    path = tmp_path / "old.bin"
    path.write_bytes(log.data)
    lost: list[str] = []
    messages = [message for message, _ in read_dataflash(path, lost.append)]
    kinds = [Heartbeat, ParamValue, Attitude, ParamValue, Attitude, ParamValue]
    assert [type(m) for m in messages] == kinds
    found = [m for m in messages if isinstance(m, ParamValue)]
    assert [(m.name, m.value, m.default, m.t_ns, m.clock) for m in found] == [
        ("SYSID_THISMAV", 7.0, None, 1_000_000_000, Clock.NONE),
        ("RTL_ALT", 15.5, None, 1_000_000_000, Clock.NONE),
        ("RTL_ALT", 30.0, None, 2_000_000_000, Clock.NONE),
    ]
    assert {m.system for m in messages} == {7}
    assert lost == []
    rows = [("PARM", 1, {"Name": b"A", "Value": 1.0, "Default": d}) for d in (2.5, math.nan)]
    new = of(written(tmp_path / "new.bin", [*rows, ("IMU", 1, {})]), ParamValue)
    assert [m.default for m in new if isinstance(m, ParamValue)] == [2.5, None]


@pytest.mark.parametrize(("form", "columns"), [("Nf", "Title,Value"), ("Nn", "Name,Value"), ("N", "Name")])
def test_a_parameter_that_is_none_costs_itself_alone(form: str, columns: str, tmp_path: Path) -> None:
    log = DataFlash()
    log.add_format("PARM", form, columns)
    log.row("ATT", 1_000_000)
    log.row("PARM", 0, Name=b"A", Title=b"A", Value=1.0 if "f" in form else b"x")
    log.row("ATT", 2_000_000)
    path = tmp_path / "odd.bin"
    path.write_bytes(log.data)
    lost: list[str] = []
    messages = [message for message, _ in read_dataflash(path, lost.append)]
    assert [type(m) for m in messages] == [Heartbeat, Attitude, Attitude]
    assert [reason.partition(":")[0] for reason in lost if "no row" not in reason] == ["PARM"]


def test_a_battery_without_a_voltage_is_left_out(tmp_path: Path) -> None:
    found = of(written(tmp_path / "log.bin", [("BAT", t, {"Volt": 12.1 * (t - 1)}) for t in (1, 2)]), Battery)
    assert [m.voltage_v for m in found if isinstance(m, Battery)] == pytest.approx([12.1])


@pytest.mark.parametrize(("week", "rolled"), [(1669, 0), (1668, 1024)])
def test_the_first_week_of_such_logs_has_not_rolled_over(week: int, rolled: int, tmp_path: Path) -> None:
    """Half of the fixes have the week, and half none, by whichever name."""
    fixes = [("GPS", t, FIX | {"GWk": week * (t % 2), "GMS": 60_000 + 1000 * t}) for t in range(1, 5)]
    lost: list[str] = []
    found = next(m for m, _ in read_dataflash(written(tmp_path / "log.bin", fixes), lost.append))
    leap_s = 16 if not rolled else 18
    assert found.t_recv_ns - found.t_ns == (GPS_EPOCH_S - leap_s + (week + rolled) * 604_800 + 60) * 10**9
    assert len(lost) == bool(rolled)


def test_times_of_many_fixes_are_those_of_the_first_thousand(tmp_path: Path) -> None:
    fixes = [("GPS", t, FIX | {"GMS": WEEK_MS + 1000 * t + 500_000 * (t > 1000)}) for t in range(1, 2102)]
    first = next(m for m, _ in read_dataflash(written(tmp_path / "log.bin", fixes)))
    assert first.t_recv_ns - first.t_ns == BOOT_TIME_S * 10**9


def test_numbers_that_are_none_cost_their_rows(tmp_path: Path) -> None:
    odd = (math.nan, math.inf, -math.inf)
    rows = [
        ("IMU", 1 + k, dict(zip(("AccX", "AccY", "AccZ"), (odd * 2)[k : k + 3], strict=True))) for k in range(3)
    ]
    rows += [
        ("IMU", 4 + k, {name: math.inf}) for k, name in enumerate(("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"))
    ]
    rows += [("IMU", 20, {"AccX": 1.0, "AccY": 2.0, "AccZ": 3.0})]
    (found,) = of(written(tmp_path / "log.bin", rows), Imu)
    assert isinstance(found, Imu)
    assert (found.f_b, found.t_ns) == ((1.0, 2.0, 3.0), 20 * 10**9)
