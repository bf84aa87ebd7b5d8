"""What the estimator of our own state is made of: its filters, its inputs' memories and its frame."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.own_state.filters import SensorFilter
from onboard.estimators.own_state.inputs import Manoeuvres, Samples
from onboard.estimators.own_state.measurements import Measured
from onboard.estimators.own_state.report import Counts
from onboard.filters.belief import Belief, Update
from onboard.geometry.rotations import matrix_from_euler
from onboard.models import own_motion
from tests.support.own_vehicle import MS, G


def test_each_sensor_has_its_own_memory_of_being_outside_seed_4() -> None:
    """Two sensors of two components each: what the one has thrown out does not count for the other."""
    filters = SensorFilter("csvsf-robust")
    state = filters.start(np.zeros(4), np.eye(4) * 1e-2)
    R = 1e-4 * np.eye(2)
    far = np.array([50.0, 0.0])
    for _ in range(2):
        state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    state, _ = filters.update(state, "b", far, lambda rows: rows[:, 2:], R, ())
    assert np.abs(filters.belief(state).mean).max() < 1.0  # the third in a row, but not of one sensor
    state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    assert filters.belief(state).mean[0] > 49.0


def test_the_mean_of_samples_is_that_of_the_line_through_them() -> None:
    s = Samples(1)
    for k in range(11):
        s.add(k * 10 * MS, np.array([float(k * k)]))
    fine = np.linspace(23 * MS, 77 * MS, 5401)
    assert s.mean(23 * MS, 77 * MS) == pytest.approx(
        np.interp(fine, np.arange(11) * 1e7, np.arange(11) ** 2).mean(), abs=1e-3
    )
    assert s.mean(90 * MS, 110 * MS) == pytest.approx((9.5 * 9.5 + 0.25 - 0.0) * 0.5 + 50.0, abs=0.3)
    assert s.mean(0, 400 * MS) is None
    assert not s.add(5 * MS, np.array([1.0]))


def manoeuvres(acceleration: float, seconds: int, roll: float = 0.0) -> Manoeuvres:
    """Of fixes five times a second that gather speed to the east, at a steady bank."""
    found = Manoeuvres()
    for k in range(5 * seconds + 1):
        t_ns = k * 200 * MS
        found.add_attitude(t_ns, matrix_from_euler(roll, 0.0, 0.0))
        found.add_fix(t_ns, np.array([0.0, acceleration * t_ns * 1e-9]), np.full(2, 0.15))
    return found


def test_how_freely_a_flight_manoeuvres_is_seen_in_its_fixes() -> None:
    nothing = Manoeuvres()
    assert_allclose(nothing.at(0), 4.0)
    steady, gathering = manoeuvres(0.0, 10), manoeuvres(2.0, 10)
    assert_allclose(steady.at(10**10), [0.045, 0.045, 4.0])  # what the fixes' noise hides: 2 x .15^2 over 1 s
    assert_allclose(gathering.at(10**10), [3.955, 3.955, 4.0])  # 2 m/s in a second, less that
    assert_allclose(gathering.at(500 * MS), 4.0)
    banked = manoeuvres(G * math.tan(math.radians(5.0)), 10, math.radians(5.0))
    assert banked.at(10**10)[0] == pytest.approx(0.045, abs=0.01)  # where attitude explains it
    late = gathering.at(10**10)[0]
    for k in range(51, 76):
        gathering.add_attitude(k * 200 * MS, np.eye(3))
        gathering.add_fix(k * 200 * MS, np.array([0.0, 20.0]), np.full(2, 0.15))
    assert gathering.at(15 * 10**9)[0] == pytest.approx(late * math.exp(-5.0 / 5.0), rel=0.01)


def test_the_frame_follows_the_vehicle_and_angles_stay_small() -> None:
    rows = np.zeros((1, own_motion.N))
    rows[0, 8] = 0.6
    R = own_motion.rotations(rows)[0]
    assert_allclose(own_motion.turned(rows, R.T)[0, [6, 8, 10]], 0.0, atol=1e-15)


def test_what_was_outside_is_counted_over_the_last_second_alone() -> None:
    """Two components every 0.4 s, the first one outside at first: by hand, what is older than a second is gone."""
    counts, nothing = Counts(5.0), np.zeros(2)
    assert counts.switch_fraction is None
    found = []
    for k, innovation in enumerate([6.0, 6.0, 0.0, 0.0, 0.0]):
        measured = Measured("gps", 400 * k * MS, 0, nothing, np.eye(2), (0, 1), ("a", "b"), ("m", "m"), nothing)
        update = Update(Belief(nothing, np.eye(2)), np.array([innovation, 0.0]), np.eye(2), nothing, float(k))
        counts.add(measured, update)
        found.append((counts.switch_fraction, counts.nis_ratio))
    assert found == [(0.5, 0.0), (0.5, 0.25), (2 / 6, 0.5), (1 / 6, 1.0), (0.0, 1.5)]
