"""The Kalman filter of a broadcast leader, on errors as it assumes them: how sure it is of the size."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.beside import reference
from onboard.estimators.leader.beside.carried import as_leader
from onboard.estimators.leader.beside.reference import DELAY, OWN_V, SIZE, Errors, Shown
from onboard.filters.belief import Belief, FilterError
from onboard.geometry.rotations import matrix_from_euler
from tests.support.leader import estimate

RANGE, SPEED = 28.0, 20.0  # m, m/s: nose to tail
TURN, STRAIGHT = 0.11, 0.001  # rad/s
YAW = 0.025  # rad, of our own
ERRORS = Errors(np.full(3, 2.0), 0.1, 60.0, 0.1, yaw=YAW)
WHITE = 2.0  # m
PRIOR = 0.3  # of the size, one standard deviation


class Truth(NamedTuple):
    """What is true, at a time."""

    r: Array
    v: Array
    moved: Array


def truth(t: float, dt: float, turn: float, since: float | None = None) -> Truth:
    """At t, relative to where we are at `since`."""

    def own(at: float) -> Array:
        return SPEED / turn * np.array([math.sin(turn * at), 1.0 - math.cos(turn * at), 0.0])

    ahead = RANGE / SPEED
    r = own(t + ahead) - own(t if since is None else since)
    course = turn * (t + ahead)
    return Truth(r, SPEED * np.array([math.cos(course), math.sin(course), 0.0]), own(t) - own(t - dt))


class Markov:
    """A Gauss-Markov process with three components."""

    def __init__(self, rng: np.random.Generator, sigma: float, time: float) -> None:
        self._rng, self._sigma, self._time = rng, sigma, time
        self.x = sigma * rng.normal(size=3)

    def step(self, dt: float) -> Array:
        left = math.exp(-dt / self._time)
        self.x = left * self.x + self._sigma * math.sqrt(1.0 - left**2) * self._rng.normal(size=3)
        return self.x


def fly(seed: int, seconds: int = 60, turn: float = TURN) -> tuple[Belief, float]:
    """The belief after a minute, and the true size; the prior is of a nominal 2 m."""
    rng = np.random.default_rng(seed)
    nominal, size = 2.0, 2.0 * (1.0 + PRIOR * float(np.clip(rng.normal(), -2.0, 2.0)))
    bias, image, delay = Markov(rng, 2.0, 60.0), Markov(rng, 0.02, 5.0), 0.1 * rng.normal()
    R = np.diag([WHITE**2] * 3 + [0.3**2] * 3)
    turned = matrix_from_euler(0.0, 0.0, YAW * rng.normal())

    def shown(at: Truth, dt: float) -> Shown:
        scale = nominal / size  # what the camera shows of a leader that is taken for a nominal one
        errors = RANGE * image.step(dt) * scale
        return Shown(turned @ at.r * scale + errors, (0.02 * RANGE * scale) ** 2 * np.eye(3), nominal)

    now = truth(0.0, 1.0, turn)
    belief = reference.start(ERRORS, shown(now, 1.0), nominal, PRIOR * nominal, now.v + rng.normal(size=3), 8.0)
    for t in range(1, seconds + 1):
        now = truth(float(t), 1.0, turn)
        belief = reference.predict(ERRORS, belief, 1.0, now.moved)
        belief = reference.see(belief, shown(now, 1.0), 1.0)
        before = truth(t - delay, 1.0, turn, since=float(t))
        r = before.r + bias.step(1.0) + WHITE * rng.normal(size=3)
        belief, _ = reference.report(belief, r, before.v + 0.3 * rng.normal(size=3), R)
    return belief, size


def test_the_size_after_a_minute_is_known_as_well_as_it_says_seeds_1_to_60() -> None:
    """A leader in a turn, reports with 2 m that are new, 2 m that last and 0.1 s of delay; our yaw is off. The
    normalised square error is 1 on average, within what 60 flights show (0.67 to 1.4)."""
    flights = [fly(seed) for seed in range(1, 61)]
    squares = [(b.mean[SIZE] - size) ** 2 / reference.size_variance(ERRORS, b) for b, size in flights]
    errors = [b.mean[SIZE] / size - 1.0 for b, size in flights]
    assert 0.67 < np.mean(squares) < 1.2
    assert np.sqrt(np.mean(np.square(errors))) < 0.09  # 0.1 s at 20 m/s are 7 % of the range


def test_straight_ahead_a_lasting_error_limits_what_is_known_seeds_1_to_60() -> None:
    """2 m, and 0.1 s at 20 m/s: a tenth of the range, however many reports come."""
    flights = [fly(seed, turn=STRAIGHT) for seed in range(1, 61)]
    squares = [(b.mean[SIZE] - size) ** 2 / reference.size_variance(ERRORS, b) for b, size in flights]
    sigmas = [math.sqrt(reference.size_variance(ERRORS, b)) / size for b, size in flights]
    assert 0.4 < np.mean(squares) < 1.4  # the delay counts twice here
    assert 0.06 < np.median(sigmas) < 0.12  # an error of a minute's correlation averages a little


def carried(seed: int, seconds: int = 20) -> tuple[Array, Belief]:
    """The error of r_FL_n after reports alone, while our own velocity is lastingly off, and the belief."""
    rng = np.random.default_rng(seed)
    errors = ERRORS._replace(delay=0.0, own_velocity=0.25)
    now, own, bias = truth(0.0, 1.0, TURN), Markov(rng, 0.25, 20.0), Markov(rng, 2.0, 60.0)
    R = np.diag([WHITE**2] * 3 + [0.3**2] * 3)
    seen = Shown(now.r, (0.005 * RANGE) ** 2 * np.eye(3), 2.0)
    belief = reference.start(errors, seen, 2.0, 0.02, now.v + rng.normal(size=3), 1.0)
    for t in range(1, seconds + 1):
        now = truth(float(t), 1.0, TURN)
        belief = reference.predict(errors, belief, 1.0, now.moved - own.step(1.0))
        r = now.r + bias.step(1.0) + WHITE * rng.normal(size=3)
        belief, _ = reference.report(belief, r, now.v + 0.3 * rng.normal(size=3), R)
    return belief.mean[:3] - now.r, belief


def test_carried_for_20_s_it_is_as_sure_as_our_lasting_velocity_error_allows_seeds_1_to_60() -> None:
    """The mean of the normalised square of three errors is 3, within what 60 flights show (2.1 to 4)."""
    flights = [carried(seed) for seed in range(1, 61)]
    squares = [error @ np.linalg.solve(b.covariance[:3, :3], error) for error, b in flights]
    assert 2.1 < np.mean(squares) < 3.6


def test_the_velocity_relative_to_us_has_the_error_of_our_own() -> None:
    """0.25 m/s more than we know of, to the north: the leader is slower relative to us by that."""
    _, belief = carried(1)
    v_F = np.array([SPEED, 0.0, 0.0])
    belief.mean[OWN_V] = 0.25, 0.0, 0.0
    made = as_leader(belief, estimate(), v_F)
    assert made.mean[3:6] == pytest.approx(belief.mean[3:6] - v_F - [0.25, 0.0, 0.0])
    P = belief.covariance
    of_both = P[3:6, 3:6] + P[OWN_V, OWN_V] - P[3:6, OWN_V] - P[OWN_V, 3:6]
    assert made.covariance[3:6, 3:6] == pytest.approx(of_both)


def test_what_the_camera_shows_without_the_size_keeps_its_direction_and_loses_the_range() -> None:
    r = np.array([28.0, 0.0, 0.0])
    P = np.diag([(0.3 * 28.0) ** 2 + 0.5**2, 0.2**2, 0.2**2])
    seen = reference.shown(r, P, 2.0, 0.6)
    assert seen.P[0, 0] == pytest.approx(0.25)
    assert seen.P[1, 1] == pytest.approx(0.2**2 + (0.003 * 28.0) ** 2)
    assert not seen.is_open
    assert reference.shown(r, P, 2.0, 0.04).is_open
    surer = reference.shown(r, np.diag([9.0, 0.04, 0.04]), 2.0, 0.6)  # than its size allows
    assert surer.P[0, 0] == pytest.approx(9.0)


def test_while_the_images_leave_the_range_open_they_teach_a_direction_alone() -> None:
    belief, _ = fly(1, 1)
    line = belief.mean[:3] / np.linalg.norm(belief.mean[:3])
    flat = np.eye(3) - np.outer(line, line)
    for share, is_open in ((0.2, True), (0.1, False)):  # of the range, 40 % farther than it is
        r = 1.4 * belief.mean[:3]
        P = 0.04 * flat + (share * float(np.linalg.norm(r))) ** 2 * np.outer(line, line)
        shown = Shown(r, P, float(belief.mean[SIZE]))
        assert shown.is_open == is_open
        after = reference.see(belief, shown, 1.0)
        assert (abs(after.mean[SIZE] / belief.mean[SIZE] - 1.0) < 0.003) == is_open
        assert np.trace(flat @ after.covariance[:3, :3]) < np.trace(flat @ belief.covariance[:3, :3])


def test_a_delay_moves_what_is_published_along_the_course() -> None:
    belief, _ = fly(3)
    published, v = reference.with_delay(ERRORS, belief), belief.mean[3:6]
    more = published.covariance[:3, :3] - belief.covariance[:3, :3]
    assert more == pytest.approx(0.01 * np.outer(v, v))
    assert published.covariance[SIZE, SIZE] == reference.size_variance(ERRORS, belief)
    assert belief.covariance[DELAY, DELAY] == pytest.approx(0.01)  # no report teaches it


def test_numbers_that_are_none_are_refused() -> None:
    belief, _ = fly(1, 1)
    with pytest.raises(FilterError, match="not finite"):
        reference.report(belief, np.array([math.nan, 0.0, 0.0]), np.zeros(3), np.eye(6))


def test_a_range_whose_error_lasts_stays_as_uncertain_as_that() -> None:
    """0.5 m that last, of 28 m: a hundred ranges of 0.1 m say no more than 1.8 % of the size."""
    errors = ERRORS._replace(range_bias=0.5)
    r, v = np.array([RANGE, 0.0, 0.0]), np.array([SPEED, 0.0, 0.0])
    seen = Shown(r, (0.002 * RANGE) ** 2 * np.eye(3), 2.0)
    belief = reference.start(errors, seen, 2.0, 0.6, v, 1.0)
    for _ in range(100):
        belief = reference.see(reference.predict(errors, belief, 0.1, 0.1 * v), seen, 0.1)
        belief, nis = reference.measure_range(belief, RANGE, 0.1)
        assert nis < 1.0
    assert math.sqrt(belief.covariance[SIZE, SIZE]) / 2.0 == pytest.approx(0.5 / RANGE, rel=0.15)
    assert belief.mean[SIZE] == pytest.approx(2.0, rel=0.005)
