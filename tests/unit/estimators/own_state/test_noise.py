"""The noise of our own sensors is learnt from their messages, whatever is configured."""

import numpy as np
import pytest

from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.noise import MIN_RATE_SIGMA, MIN_SPEED_SIGMA, SensorNoise
from onboard.ownship.contradictions import MAX_SPEED_NOISE, RATE_NOISE

MS = 1_000_000
CONFIG = Config()


def of_rates(white: float, turning: float, *, motors: float = 0.0) -> SensorNoise:
    """After 20 s of body rates at 100 Hz, seed 81: their noise, rad/s, that of the angular acceleration, and as
    much acceleration (rad/s^2) by the motors."""
    rng, noise = np.random.default_rng(81), SensorNoise(CONFIG)
    omega, by = np.zeros(3), np.zeros(3)
    for k in range(2000):
        noise.add_rates(10 * k * MS, omega + white * rng.normal(size=3), by)
        by = np.full(3, motors * np.sin(0.1 * k))
        omega = omega + 0.01 * by + turning * 0.1 * rng.normal(size=3)
    return noise


@pytest.mark.parametrize(("white", "turning"), [(0.02, 0.2), (0.01, 0.5), (0.0, 2.0)])
def test_rates_and_turns_seed_81(white: float, turning: float) -> None:
    noise = of_rates(white, turning)
    sigmas = noise.attitude((0.01, 0.02, 0.03))
    assert sigmas[:3] == pytest.approx([0.01, 0.02, 0.03])
    assert sigmas[3:] == pytest.approx(max(white, MIN_RATE_SIGMA), rel=0.25, abs=0.03 * turning)
    assert np.sqrt(noise.turning(20_000 * MS)) == pytest.approx(turning, rel=0.35)


def test_no_more_is_learnt_than_such_a_sensor_can_have_seed_81() -> None:
    """Rates in degrees, or velocities in another unit, are a mistake and no noise."""
    noise, rng = of_rates(30.0, 0.5), np.random.default_rng(81)
    assert noise.attitude((0.01, 0.01, 0.01))[3:] == pytest.approx(RATE_NOISE)
    for k in range(300):
        noise.add_fix(200 * k * MS, 50.0 * rng.normal(size=3))
    assert noise.speed[0] == pytest.approx(MAX_SPEED_NOISE)


def test_assumed_noise_holds_at_first() -> None:
    noise = SensorNoise(CONFIG)
    assert noise.attitude((0.1, 0.1, 0.1)) == pytest.approx(np.radians([0.573, 0.573, 1.72, *[0.573] * 3]))
    assert noise.turning(0) == pytest.approx(4.0)
    assert noise.speed == pytest.approx([0.15, 0.15, 0.3])


def test_a_density_is_that_of_its_time_seed_81() -> None:
    noise = of_rates(0.02, 0.5)
    assert noise.turning(100 * MS) == pytest.approx(4.0)  # as configured: it was not known then
    before = noise.turning(19_000 * MS)
    for k in range(2000, 2100):
        noise.add_rates(10 * k * MS, np.full(3, 0.5 * (k % 2)), None)
    assert noise.turning(19_000 * MS) == pytest.approx(before)


@pytest.mark.parametrize(("rate", "white"), [(5, 0.15), (10, 0.2), (5, 0.0)])
def test_a_fixs_velocity_while_we_turn_seed_82(rate: int, white: float) -> None:
    rng, noise = np.random.default_rng(82), SensorNoise(CONFIG)
    for k in range(60 * rate):
        t = k / rate
        v = np.array([4 * np.sin(0.5 * t), 4 * np.cos(0.5 * t)]) + white * rng.normal(size=2)
        noise.add_fix(round(t * 1e9), v)
    assert noise.speed == pytest.approx(np.array([1.0, 1.0, 2.0]) * max(white, MIN_SPEED_SIGMA), rel=0.3)
