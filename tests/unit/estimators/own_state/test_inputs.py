"""The means of samples, and how much a flight manoeuvres."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.own_state.inputs import Manoeuvres, Samples
from onboard.geometry.rotations import matrix_from_euler
from tests.support.own_vehicle import GRAVITY, MS


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


@pytest.mark.parametrize("gap_ms", [150, 190, 250, 500, 1000, 2600])
def test_what_a_span_holds_of_a_gap_is_unknown_and_no_push(gap_ms: int) -> None:
    """A constant is its own mean, wherever a span begins; a gap that a sample does not hold over has none."""
    s, constant = Samples(1), np.array([-9.81])
    times = [*range(0, 1000, 10), *range(990 + gap_ms, 1190 + gap_ms, 10)]
    for t in times:
        s.add(t * MS, constant)
    end, has_gap = times[100], gap_ms > 200
    for begin in range(200, end + 180, 5):
        for span in (0, 1, 20, 1000):
            mean = s.mean(begin * MS, (begin + span) * MS)
            touches = begin < end and begin + span > 990 and has_gap
            if begin + span <= times[-1] + 200:
                assert (mean is None) is (touches and not (span == 0 and begin == end)), (begin, span)
            if mean is not None:
                assert mean == pytest.approx(constant, abs=1e-9)


def test_the_density_of_scatter_is_that_of_white_noise_seed_1() -> None:
    """Variance times the interval, on a course that bends slowly."""
    rng, s, found = np.random.default_rng(1), Samples(1), []
    for k in range(20_000):
        s.add(k * 10 * MS, 3.0 * np.sin([k * 1e-3]) + 0.2 * rng.normal(size=1))
        found.append(float(s.density(k * 10 * MS)[0]))
    assert np.mean(found[1000:]) == pytest.approx(0.2**2 * 0.01, rel=0.05)


def manoeuvres(acceleration: float, seconds: int, roll: float = 0.0) -> Manoeuvres:
    """After fixes five times a second that gather speed to the east, at a steady bank."""
    flown = Manoeuvres()
    for k in range(5 * seconds + 1):
        t_ns = k * 200 * MS
        flown.add_attitude(t_ns, matrix_from_euler(roll, 0.0, 0.0))
        flown.add_fix(t_ns, np.array([0.0, acceleration * t_ns * 1e-9]), np.full(2, 0.15))
    return flown


def test_the_density_of_manoeuvres_follows_from_fixes() -> None:
    nothing = Manoeuvres()
    assert_allclose(nothing.at(0), 4.0)
    steady, gathering = manoeuvres(0.0, 10), manoeuvres(2.0, 10)
    assert_allclose(steady.at(10**10), [0.045, 0.045, 4.0])  # what the fixes' noise hides: 2 x .15^2 over 1 s
    assert_allclose(gathering.at(10**10), [3.955, 3.955, 4.0])  # 2 m/s in a second, less that
    assert_allclose(gathering.at(500 * MS), 4.0)
    banked = manoeuvres(GRAVITY * math.tan(math.radians(5.0)), 10, math.radians(5.0))
    assert banked.at(10**10)[0] == pytest.approx(0.045, abs=0.01)  # where attitude explains it
    late = gathering.at(10**10)[0]
    for k in range(51, 76):
        gathering.add_attitude(k * 200 * MS, np.eye(3))
        gathering.add_fix(k * 200 * MS, np.array([0.0, 20.0]), np.full(2, 0.15))
    assert gathering.at(15 * 10**9)[0] == pytest.approx(late * math.exp(-5.0 / 5.0), rel=0.01)
