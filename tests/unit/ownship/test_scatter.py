"""Noise is learnt from a stream, and what goes on to contradict it is still noticed."""

import math

import numpy as np
import pytest

from onboard.geometry.rotations import quaternion_from_euler
from onboard.ownship.contradictions import Contradictions, Strides
from onboard.ownship.scatter import Scatter

DT = 0.02
STEP_NS = 20_000_000
RUNS = 30


def increments(rng: np.random.Generator, white: float, walk: float, n: int) -> np.ndarray:
    """Of values with white noise, and a random walk of so much a step."""
    values = white * rng.normal(size=(n + 1, 3)) + walk * np.cumsum(rng.normal(size=(n + 1, 3)), axis=0)
    return np.asarray(np.diff(values, axis=0))


@pytest.mark.parametrize(("white", "walk"), [(0.01, 0.0), (0.0, 0.013), (0.02, 0.01)])
def test_white_noise_and_a_walk_are_distinguished_seed_51(white: float, walk: float) -> None:
    rng = np.random.default_rng(51)
    whites, sums = [], []
    for _ in range(RUNS):
        scatter = Scatter(3)
        for e in increments(rng, white, walk, 1000):
            scatter.add(e.tolist(), DT)
        whites.append(np.square(scatter.white or (math.nan,) * 3))
        sums.append(scatter.deviation(16))
    assert math.sqrt(np.mean(whites)) == pytest.approx(white, rel=0.12, abs=0.35 * walk)
    true = math.sqrt(3 * (16 * walk**2 + 2 * white**2))
    assert 0.9 * true < np.mean(sums) < 1.6 * true  # what is not known of a covariance counts as a walk


def test_a_constant_contradiction_in_noise_is_no_walk_seed_54() -> None:
    with_it, without = Scatter(3), Scatter(3)
    for e in increments(np.random.default_rng(54), 0.01, 0.0, 1500):
        with_it.add((e + 0.01).tolist(), DT)
        without.add(e.tolist(), DT)
    assert with_it.deviation(100) == pytest.approx(without.deviation(100), rel=0.2)


def noticed(strides: Strides, e: np.ndarray, begins: int, fault: float) -> float | None:
    """Seconds from the beginning of a constant fault, m/s, to its notice."""
    for k, off in enumerate(e):
        wrong = off + np.array([fault * DT if k >= begins else 0.0, 0.0, 0.0])
        if strides.contradict(k * STEP_NS, (k + 1) * STEP_NS, wrong.tolist(), 0.0):
            return float((k + 1 - begins) * DT)
    return None


@pytest.mark.parametrize(("white", "walk", "fault"), [(0.0, 0.0, 0.6), (0.0, 0.013, 3.0), (0.03, 0.0, 3.0)])
def test_noise_is_no_contradiction_and_a_fault_is_seeds_60_to_64(white: float, walk: float, fault: float) -> None:
    for seed in range(60, 65):
        e = increments(np.random.default_rng(seed), white, walk, 3000)
        assert noticed(Strides(0.5, 0.2), e, 10_000, 0.0) is None
        after = noticed(Strides(0.5, 0.2), e, 2000, fault)
        assert after is not None
        assert after <= (0.3 if white == walk == 0.0 else 2.0)


@pytest.mark.parametrize("leap", [0, 1, 7])
def test_a_stream_that_begins_with_a_leap_is_not_noisy_seed_56(leap: int) -> None:
    """A real autopilot's position leaps when it gets its origin: it was taken for a walk of 200 m a second."""
    rng, scatter = np.random.default_rng(56), Scatter(3)
    for k in range(60):
        scatter.add((1e3 if k == leap else 0.0) + 0.01 * rng.normal(size=3), DT)
    assert scatter.white is not None
    assert max(scatter.white) < 0.03
    assert scatter.deviation(1) < 0.05


def turning(t: float) -> np.ndarray:
    """Roll, pitch and yaw of a vehicle that sways and weaves, rad."""
    roll, pitch = 0.05 * math.sin(2.1 * t) + 0.02 * math.sin(7.0 * t), 0.04 * math.sin(1.3 * t + 1.0)
    return np.array([roll, pitch, 0.3 * math.sin(0.4 * t)])


def doubts(unit: float, white: float, rates: float, seconds: int) -> list[set[str]]:
    """What contradicts itself in each second, of attitudes with white noise (rad) and body rates with another
    (rad/s), which are stated in another unit."""
    rng, checks = np.random.default_rng(55), Contradictions()
    found: list[set[str]] = [set() for _ in range(seconds)]
    for k in range(seconds * 50):
        t, h = k * DT, 1e-4
        (roll, pitch, _), (p, q, r) = turning(t), (turning(t + h) - turning(t - h)) / (2.0 * h)
        omega = np.array(
            [
                p - r * math.sin(pitch),
                q * math.cos(roll) + r * math.cos(pitch) * math.sin(roll),
                r * math.cos(pitch) * math.cos(roll) - q * math.sin(roll),
            ]
        )
        omega = unit * (omega + rates * rng.normal(size=3))
        q_nb = quaternion_from_euler(*(turning(t) + white * rng.normal(size=3)))
        checks.add_attitude(k * STEP_NS, q_nb.tolist(), omega.tolist())
        found[k // 50].add(checks.reason(k * STEP_NS))
    return found


def test_rates_in_degrees_are_no_noise_however_long_they_come_seed_55() -> None:
    """They were taken for noise after seven seconds, and what followed from them for valid."""
    found = doubts(math.degrees(1.0), 0.0, 0.0, 30)
    expected = "attitude contradicts the body rates: they look like degrees per second, not radians"
    assert found[2:] == [{expected}] * 28


@pytest.mark.parametrize(("white", "rates"), [(0.0, 0.0), (0.02, 0.1), (0.005, 0.6)])
def test_much_noise_of_attitude_and_rates_is_no_mistake_seed_55(white: float, rates: float) -> None:
    assert doubts(1.0, white, rates, 15) == [{""}] * 15


def test_the_white_noise_of_velocities_is_measured_while_we_accelerate_seed_53() -> None:
    rng, checks = np.random.default_rng(53), Contradictions()
    for k in range(1500):
        t = k * DT
        v = np.array([3 * math.sin(t), 3 * math.cos(1.3 * t), 0.0]) + 0.05 * rng.normal(size=3)
        checks.add_nav(k * STEP_NS, (math.nan, math.nan, 0.0), v.tolist())
    assert checks.velocity_noise == pytest.approx((0.05, 0.05, 0.05), rel=0.3)
