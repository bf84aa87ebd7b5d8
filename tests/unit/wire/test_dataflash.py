"""ArduPilot's DataFlash logs, as pymavlink writes them."""

import math
from pathlib import Path

import pytest

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Battery,
    EstimatorStatus,
    GlobalOrigin,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
)
from onboard.wire.dataflash import read_dataflash
from onboard.wire.tlog import NotALogError
from tests.support.dataflash import BOOT_UNIX_S, dataflash
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
        assert message.t_recv_ns == message.t_ns + BOOT_UNIX_S * 1_000_000_000


def test_bytes_read_rise_to_the_end(log: Path) -> None:
    done = [at for _, at in read_dataflash(log)]
    assert done == sorted(done)
    assert 0.95 * log.stat().st_size < done[-1] <= log.stat().st_size


def test_damage_costs_what_is_damaged(log: Path, tmp_path: Path) -> None:
    data, lost = log.read_bytes(), list[str]()
    broken = tmp_path / "broken.bin"
    half = len(data) // 2
    broken.write_bytes(data[:half] + b"\x00\xa3\x95\xfe" * 200 + data[half : len(data) - 7])
    kept = list(read_dataflash(broken, lost.append))
    assert len(kept) > 0.97 * len(list(read_dataflash(log)))
    assert lost


def test_what_is_no_log_is_refused(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "short.bin"
    path.write_bytes(log.read_bytes()[:200])
    with pytest.raises(NotALogError, match="no attitude"):
        next(read_dataflash(path))
