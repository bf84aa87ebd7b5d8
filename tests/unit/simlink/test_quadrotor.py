"""The quadrotor's truth: conservation laws, numbers by hand, and the effects of its faults."""

from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import ActuatorOutputs, Attitude, GpsFix
from simlink.cli import main
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.quadrotor import Quadrotor, QuadrotorFault
from simlink.scenarios.scenario import load_scenario
from simlink.sensors.navigation import readings
from simlink.simulation import simulate
from simlink.world.quadrotor import Forces, advance, derivative, forces_at
from simlink.world.truth import State, states
from tests.support.simlink_truth import GRAVITY, HZ, flight

SPINNING = (0.0, 0.0, 0.0, 1.0, -2.0, 0.5, 0.6, -0.4, 0.5, 0.48, 3.0, -2.0, 4.0, 0.0, 0.0, 0.0, 0.0)
STILL = (0.0,) * 4
BARE = Quadrotor(inertia=(4e-3, 6e-3, 9e-3), drag=0.0, turbulence=GaussMarkov(sigma=0.0))


@cache
def flown(name: str) -> list[State]:
    """20 s of a scenario with seed 3; a fault begins at 10 s."""
    return flight(load_scenario(name), 3, 20.0)


def test_a_free_body_keeps_its_angular_momentum_its_energy_and_falls() -> None:
    forces = Forces((0.0,) * 4, BARE.mass, BARE.inertia, (0.0, 0.0, 0.0))
    y = SPINNING
    inertia = np.array(BARE.inertia)

    def momentum(y: tuple[float, ...]) -> np.ndarray:
        return matrix_from_quaternion(y[6:10]) @ (inertia * y[10:13])

    before, energy = momentum(y), float(inertia @ np.square(y[10:13]))
    y = (*y[:6], *(np.array(y[6:10]) / np.linalg.norm(y[6:10])), *y[10:])
    for _ in range(2 * HZ):
        y = advance(BARE, forces, STILL, y, 1 / HZ)
    assert_allclose(momentum(y), before, rtol=1e-6, atol=1e-9)
    assert float(inertia @ np.square(y[10:13])) == pytest.approx(energy, rel=1e-6)
    assert_allclose(y[:6], (2.0, -4.0, 1.0 + 0.5 * GRAVITY * 4, 1.0, -2.0, 0.5 + 2 * GRAVITY), rtol=1e-9)


def test_each_rotor_turns_the_body_according_to_its_place() -> None:
    forces = Forces((2.0,) * 4, BARE.mass, BARE.inertia, (0.0, 0.0, 0.0))
    level = (*(0.0,) * 6, 1.0, *(0.0,) * 6)
    for rotor, (roll, pitch, yaw) in enumerate([(0, 1, 1), (-1, 0, -1), (0, -1, 1), (1, 0, -1)]):
        speeds = tuple(float(i == rotor) for i in range(4))
        slope, f_b = derivative(BARE, forces, STILL, (*level, *speeds))
        lever = 2.0 * 0.225
        expected = (lever * roll / 4e-3, lever * pitch / 6e-3, 2.0 * 0.03826 * yaw / 9e-3)
        assert_allclose(slope[10:13], expected, rtol=1e-12, atol=1e-12)
        assert_allclose(f_b, (0.0, 0.0, -2.0 / 0.468), rtol=1e-12, atol=1e-15)


def test_it_stays_on_its_figure_eight_seed_2() -> None:
    r = np.array([s.r_OF_n for s in flight(load_scenario("quadrotor"), 2, 60.0)])
    assert np.abs(r[:, 0]).max() == pytest.approx(4.0, abs=0.15)
    assert np.abs(r[:, 1]).max() == pytest.approx(2.0, abs=0.15)
    assert_allclose(r[:, 2].min(), -11.0, atol=0.1)


@pytest.mark.parametrize(
    ("name", "low"),
    [
        ("quadrotor", 1.0),
        ("quadrotor-motor", 1 - 0.25 / 4),
        ("quadrotor-weak-inputs", 0.7),
        ("quadrotor-heavier", 1 / 1.3),
        ("quadrotor-much-heavier", 1 / 1.5),
    ],
)
def test_after_a_fault_the_same_commands_lift_less_seed_3(name: str, low: float) -> None:
    scenario = load_scenario(name)
    craft = scenario.quadrotor
    assert craft is not None
    rows = flown(name)

    def lift(s: State) -> float:
        """Measured specific force over that of the commands, if the rotors followed at once."""
        assert s.pwm_us is not None
        commanded = sum(((pwm - 1000) / 1000) ** 2 for pwm in s.pwm_us) * craft.thrust_max / craft.mass
        return -s.f_b[2] / commanded

    assert np.mean([lift(s) for s in rows[400:2000]]) == pytest.approx(1.0, abs=0.01)
    # the controller evens the motors out: a lost quarter of one is then more than a sixteenth of the sum
    assert np.mean([lift(s) for s in rows[2600:]]) == pytest.approx(low, abs=0.012)
    assert rows[1999].fault == ""
    assert (rows[2000].fault == "") == (name == "quadrotor")


def test_all_inputs_and_inertia_scale_what_they_name() -> None:
    craft = Quadrotor(fault=QuadrotorFault(at=5.0, inputs=0.7, inertia=1.5, mass=1.3, motor=2, motor_loss=0.5))
    assert forces_at(craft, 4.99, (0.0, 0.0, 0.0)).mass == 0.468
    forces = forces_at(craft, 5.0, (0.0, 0.0, 0.0))
    assert_allclose(forces.thrusts, (2.1, 1.05, 2.1, 2.1))
    assert forces.mass == pytest.approx(0.6084)
    assert_allclose(forces.inertia, np.array([4.856e-3, 4.856e-3, 8.801e-3]) * 1.5)


def test_what_it_sends_seed_6() -> None:
    sent = [e.message for e in simulate(load_scenario("quadrotor-gps-loss"), 6, 25.0)]
    motors = [m for m in sent if isinstance(m, ActuatorOutputs)]
    fixes = [m for m in sent if isinstance(m, GpsFix)]
    assert all(len(m.pwm_us) == 4 and min(m.pwm_us) >= 1000 and max(m.pwm_us) <= 2000 for m in motors)
    assert len({m.pwm_us for m in motors}) > 100
    assert len([m for m in sent if isinstance(m, Attitude)]) == pytest.approx(2500, abs=2)
    lost = [m for m in fixes if m.fix_type < 2]
    assert {m.t_ns // 10**9 for m in lost} == set(range(60, 66))
    assert all(m.satellites == 0 and m.h_acc is None for m in lost)


def test_outliers_come_as_often_and_as_large_as_asked_seed_7() -> None:
    scenario = load_scenario("quadrotor-outliers")
    rows = list(islice(readings(scenario, 7, states(scenario, 7)), 40 * HZ))
    rates = np.array([np.subtract(r.omega_b, s.omega_b) for s, r in rows])
    assert np.abs(rates[: 10 * HZ]).max() < 0.06
    wrong = np.abs(rates[10 * HZ :]) > 0.1
    assert wrong.mean() == pytest.approx(0.02, abs=0.003)
    assert np.abs(rates[10 * HZ :])[wrong].mean() == pytest.approx(0.2, rel=0.05)
    assert np.mean(rates[10 * HZ :][wrong] > 0) == pytest.approx(0.5, abs=0.1)  # of 360: four sigmas


def test_a_log_with_the_vehicles_own_truth_seed_1(tmp_path: Path) -> None:
    out, own = tmp_path / "f.tlog", tmp_path / "own.csv"
    assert main(["log", "quadrotor-motor", "--duration", "11", "--out", str(out), "--state", str(own)]) == 0
    lines = own.read_text().splitlines()
    assert lines[0].startswith("time_boot_s,r_north_m")
    assert lines[0].endswith("r_rad_s,fault")
    assert len(lines) == 1 + 11 * 25 + 1
    assert lines[240].endswith('""')
    assert lines[260].endswith('"motor 1"')
