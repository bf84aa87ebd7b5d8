"""`onboard calibrate --mass`: the airframe's constants that a made flight has are found again."""

import argparse
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from onboard import UserError
from onboard.analysis.calibration.airframe import AirframeMeasures, RecordedFlight, fit_airframe
from onboard.commands.calibrate_airframe import calibrate_airframe, described_airframe
from onboard.config import parse_config
from onboard.estimators.own_state.config import AirframeConfig
from onboard.estimators.own_state.faults import FaultMonitor
from onboard.messages import ActuatorOutputs, Fault, FaultKind, Imu

MASS, THRUST, DRAG, INERTIA, TORQUE = 0.6, 3.4, 0.13, (5.5e-3, 4.1e-3, 9.6e-3), 0.03
ROTORS = np.array([[0.2, 0.0, 1.0], [0.0, 0.2, -1.0], [-0.2, 0.0, 1.0], [0.0, -0.2, -1.0]])
KNOWN = AirframeMeasures(MASS, ROTORS, 0.0, 1.0)
DT = 0.01


def flight(seed: int, seconds: float = 60.0, weak_from: float = np.inf) -> RecordedFlight:
    """Rotor commands that rise and fall slowly, and the motion that they give, with a sensor's noise. From
    `weak_from` s on, the third motor gives three quarters of its thrust."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, DT)
    usual = MASS * 9.81 / (4 * THRUST)
    waves = [np.sin(2 * np.pi * f * t + random.uniform(1.4, 1.7)) for f in (0.31, 0.43, 0.37, 0.29)]
    mixing = np.column_stack([np.ones(4), -ROTORS[:, 1], ROTORS[:, 0], ROTORS[:, 2]])
    wanted = np.column_stack([usual * (1 + 0.1 * waves[0]) * 4, *(0.0012 * w for w in waves[1:])])
    wanted[:, 3] *= 10
    commands = np.round(1000 * np.sqrt(wanted @ np.linalg.inv(mixing))) / 1000
    squared = wanted @ np.linalg.inv(mixing)
    squared[t >= weak_from, 2] *= 0.75
    torque = THRUST * squared @ mixing[:, 1:] * (1.0, 1.0, TORQUE)
    omega = np.zeros((len(t), 3))
    i, j, k = INERTIA
    for n in range(len(t) - 1):
        p, q, r = omega[n]
        gyroscopic = np.array([(j - k) * q * r, (k - i) * p * r, (i - j) * p * q])
        omega[n + 1] = omega[n] + DT * (torque[n] + gyroscopic) / INERTIA
    v = np.column_stack([2 * np.sin(0.5 * t), 2 * np.cos(0.7 * t), np.zeros(len(t))])
    f = np.column_stack([-DRAG * v[:, 0] + 0.02, -DRAG * v[:, 1], -THRUST * squared.sum(axis=1) / MASS])
    f += 0.1 * random.standard_normal(f.shape)
    return RecordedFlight(t, f, omega + 0.01 * random.standard_normal(f.shape), v, t, commands, np.ones(len(t)))


def test_constants_are_found_within_their_sigmas_seeds_1_to_10() -> None:
    truth = (THRUST, DRAG, INERTIA[0], INERTIA[1], TORQUE / INERTIA[2])
    scores = []
    for seed in range(1, 11):
        found = fit_airframe(flight(seed), KNOWN)[:5]
        scores.append([(one.value - true) / one.sigma for one, true in zip(found, truth, strict=True)])
        assert abs(found[0].value / THRUST - 1) < 0.01
        assert abs(found[1].value / DRAG - 1) < 0.05
        assert max(abs(one.value / true - 1) for one, true in zip(found, truth, strict=True)) < 0.1
    assert np.sqrt(np.mean(np.square(scores), axis=0)).max() < 2.0


def pasted(lines: str) -> dict[str, Any]:
    """The section that is offered."""
    section = tomllib.loads(lines[lines.index("[estimator.own_state]") :])
    parse_config(section)
    return dict(section["estimator"]["own_state"])


def named(airframe: AirframeConfig, flown: RecordedFlight) -> Iterator[tuple[float, Fault]]:
    """Each fault that is present, by time."""
    monitor = FaultMonitor(airframe)
    for t, f, omega, v, command in zip(flown.t, flown.f_b, flown.omega_b, flown.v_b, flown.commands, strict=True):
        at = {"t_ns": round(t * 1e9), "t_recv_ns": round(t * 1e9)}
        monitor.receive_outputs(ActuatorOutputs(**at, pwm_us=tuple(np.rint(1000 + 1000 * command).astype(int))))
        monitor.receive_imu(Imu(**at, f_b=tuple(f), omega_b=tuple(omega)), v)
        yield from ((float(t), fault) for fault in monitor.faults())


def test_a_weak_motor_is_named_with_what_is_offered_seed_1() -> None:
    offered = pasted("\n".join(described_airframe(fit_airframe(flight(1), KNOWN), KNOWN, (1000.0, 2000.0))))
    airframe = parse_config({"estimator": {"own_state": offered}}).estimator["own_state"].known_airframe()
    assert [*named(airframe, flight(2, seconds=8.0))] == []
    after, fault = next(named(airframe, flight(2, seconds=8.0, weak_from=7.0)))
    assert (fault.kind, fault.part) == (FaultKind.MOTOR, "motor 3")
    assert 7.0 < after < 7.6
    assert fault.magnitude == pytest.approx(0.25, abs=0.07)


def test_a_flight_that_does_not_turn_offers_nothing_seed_1() -> None:
    calm = flight(1)
    still = calm._replace(
        commands=np.repeat(calm.commands.mean(axis=1)[:, None], 4, axis=1),
        omega_b=0.01 * np.random.default_rng(1).standard_normal(calm.omega_b.shape),
    )
    text = "\n".join(described_airframe(fit_airframe(still, KNOWN), KNOWN, (1000.0, 2000.0)))
    assert "nothing is offered" in text
    assert "thrust_max_n =" not in text


def test_a_log_of_few_samples_a_second_is_compared_over_longer_windows_seed_1() -> None:
    dense = flight(1)
    few = RecordedFlight(*(values[::20] for values in dense))
    found = fit_airframe(few, KNOWN)
    assert found.window == pytest.approx(1.0)
    assert found.thrust.value == pytest.approx(THRUST, rel=0.01)
    assert found.drag.value == pytest.approx(DRAG, rel=0.1)


def test_a_flight_that_is_too_short_is_refused() -> None:
    with pytest.raises(UserError, match="10 s in the air"):
        fit_airframe(flight(1, seconds=10.0), KNOWN)


def test_windows_without_a_gap_in_the_air_are_compared_seed_1() -> None:
    """Of 0.6 s; half of one may be missing of either."""
    whole = flight(1)
    t, counts = whole.t, []
    for gap in (0.0, 0.28, 0.33):
        kept = (t < 20.1) | (t > 20.1 + gap)
        imu = {name: getattr(whole, name)[kept] for name in ("t", "f_b", "omega_b", "v_b")}
        commands = {name: getattr(whole, name)[kept] for name in ("command_t", "commands", "voltage")}
        counts += [fit_airframe(whole._replace(**each), KNOWN).windows for each in (imu, commands)]
    on_ground = whole._replace(commands=np.where(t[:, None] < 12.0, 0.3 * whole.commands, whole.commands))
    counts.append(fit_airframe(on_ground, KNOWN).windows)
    assert counts == [99, 99, 98, 99, 97, 97, 79]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rotors": None}, "--mass needs --rotors"),
        ({"rotors": "[[0,0"}, "expected .*forward_m"),
        ({"rotors": "[[0,0,1],[0,0,1],[0,0,1]]"}, "at least four"),
        ({"rotors": "[[0,0,1],[0,0,1],[0,0,1],[0,0,2]]"}, "at least four"),
        ({"mass": 0.0}, "must be positive"),
        ({"voltage": 0.0}, "must be positive"),
        ({"pwm": (2000.0, 2000.0)}, "--pwm: the first must be below"),
    ],
)
def test_what_cannot_be_measured_by_is_one_line(changed: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"rotors": str(ROTORS.tolist()), "mass": 1.0, "voltage": None, "pwm": (1000.0, 2000.0)}
    with pytest.raises(UserError, match=words):
        calibrate_airframe(argparse.Namespace(**given | changed, log=None, until=None), parse_config({}))
