"""What a command to the motors is worth: a battery that empties is no fault, a load that falls off is one."""

from collections.abc import Callable

import pytest

from onboard.estimators.own_state.config import AIRFRAMES, AirframeConfig
from onboard.estimators.own_state.faults import FaultMonitor
from onboard.messages import ActuatorOutputs, FaultKind, Imu

CRAFT: AirframeConfig = AIRFRAMES["csvsf"]
GRAVITY = 9.80665  # m/s^2, standard (CGPM 1901)
S = 1_000_000_000
STEP_NS = S // 10
FULL_V = 12.6
EMPTY = 0.7  # of the thrust
RESTING, SERVOS = (0, 0, 0, 0), (1500, 1700, 1100, 1500)
MINUTES = 2.5


def emptying(t: float) -> float:
    """Thrust for a command, as a share of that of a full battery."""
    return 1.0 - (1.0 - EMPTY) * min(t / (60.0 * MINUTES), 1.0)


def heavier_after_5_s(t: float) -> float:
    return 1.3 if t > 5.0 else 1.0


def hover(
    monitor: FaultMonitor,
    seconds: float,
    *,
    worth: Callable[[float], float],
    has_voltage: bool = False,
    mass: Callable[[float], float] = lambda _: 1.0,
    begin: float = 0.0,
    port: Callable[[float], int] = lambda _: 0,
) -> dict[FaultKind, float]:
    """Hover, with `worth` of a command and `mass` times the known one, the motors on a `port`, beside one that
    rests and one of servos; when each fault was first named, s."""
    named: dict[FaultKind, float] = {}
    for k in range(round(seconds * S / STEP_NS)):
        t_ns = round(begin * S) + k * STEP_NS
        t = t_ns / S - begin
        weight = CRAFT.mass_kg * mass(t) * GRAVITY
        share = (weight / (4 * CRAFT.thrust_max_n * worth(t))) ** 0.5 if weight else 0.0
        if has_voltage and k % 10 == 0:
            monitor.receive_voltage(FULL_V * worth(t) ** 0.5)
        at, f_z = {"t_ns": t_ns, "t_recv_ns": t_ns}, -GRAVITY if weight else -0.01
        motors = (round(1000 + 1000 * share),) * 4
        for number, other in enumerate((RESTING, RESTING, SERVOS)):
            pwm_us = motors if number == port(t) else other
            monitor.receive_outputs(ActuatorOutputs(**at, pwm_us=pwm_us, port=number))
        monitor.receive_imu(Imu(**at, f_b=(0.0, 0.0, f_z), omega_b=(0.0, 0.0, 0.0)), None)
        for fault in monitor.faults():
            named.setdefault(fault.kind, t)
    return named


@pytest.mark.parametrize("has_voltage", [True, False])
def test_a_battery_that_empties_is_no_fault(has_voltage: bool) -> None:
    assert hover(FaultMonitor(CRAFT), 60.0 * MINUTES, worth=emptying, has_voltage=has_voltage) == {}


def test_a_sag_within_seconds_is_no_fault_if_the_voltage_is_told() -> None:
    def sags(t: float) -> float:
        return 0.75 if t >= 10.0 else 1.0

    assert hover(FaultMonitor(CRAFT), 15.0, worth=sags, has_voltage=True) == {}
    named = hover(FaultMonitor(CRAFT), 15.0, worth=sags)
    assert set(named) == {FaultKind.MASS}


@pytest.mark.parametrize("has_voltage", [True, False])
def test_another_mass_is_named_and_stays_so_also_when_the_battery_is_low(has_voltage: bool) -> None:
    monitor = FaultMonitor(CRAFT)
    hover(monitor, 60.0, worth=emptying, has_voltage=has_voltage)
    low = emptying(60.0)
    named = hover(monitor, 60.0, worth=lambda _: low, mass=heavier_after_5_s, has_voltage=has_voltage, begin=60.0)
    assert 5.0 < named[FaultKind.MASS] < 6.0
    (fault,) = monitor.faults()
    assert fault.magnitude == pytest.approx(1.3, abs=0.08)


def test_a_battery_that_was_charged_on_the_ground_is_no_fault() -> None:
    monitor = FaultMonitor(CRAFT)
    assert hover(monitor, 60.0 * MINUTES, worth=emptying) == {}
    assert hover(monitor, 10.0, worth=lambda _: EMPTY, mass=lambda _: 0.0, begin=150.0) == {}
    assert hover(monitor, 20.0, worth=lambda _: 1.0, begin=160.0) == {}
    named = hover(monitor, 10.0, worth=lambda _: 1.0, mass=heavier_after_5_s, begin=180.0)
    assert set(named) == {FaultKind.MASS}


@pytest.mark.parametrize("port", [lambda _: 0, lambda _: 1, lambda t: int(t > 4.0), lambda t: int(t < 4.0)])
def test_motors_are_followed_to_another_port(port: Callable[[float], int]) -> None:
    """With DShot they are auxiliary outputs, whose commands were dropped."""
    monitor = FaultMonitor(CRAFT)
    named = hover(monitor, 12.0, worth=lambda _: 1.0, mass=lambda t: 1.3 if t > 8.0 else 1.0, port=port)
    assert set(named) == {FaultKind.MASS}
    assert 8.0 < named[FaultKind.MASS] < 9.5


@pytest.mark.parametrize(
    ("armed", "outputs", "reports"),
    [(True, RESTING, 5), (True, RESTING[:3], 5), (False, RESTING, 0), (True, (1300,) * 4, 0)],
    ids=["none runs", "too few", "disarmed", "they run"],
)
def test_that_no_motor_is_observed_is_reported_once_a_second(
    armed: bool, outputs: tuple[int, ...], reports: int
) -> None:
    """Each flight of an autopilot whose outputs carried none of its motors passed for one without a fault."""
    monitor = FaultMonitor(CRAFT)
    sent = (ActuatorOutputs(t_ns=k * STEP_NS, t_recv_ns=k * STEP_NS, pwm_us=outputs) for k in range(100, 200))
    assert sum(monitor.receive_outputs(message, armed=armed) for message in sent) == reports
