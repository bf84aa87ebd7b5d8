"""The leader's covariance is as large as its errors: neither over- nor underconfident, over twenty short flights
whose unknowns are drawn as the configuration says. Filters are named: a bound is one filter's."""

from collections.abc import Iterable, Iterator

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.estimators.leader import wing_line_noise as noise
from onboard.estimators.leader.settings import FIXED_WING, MULTIROTOR, ManoeuvreModel
from onboard.estimators.leader.wing_line_noise import Extras
from onboard.geometry.rotations import quaternion_from_vector, quaternion_product
from onboard.messages import Attitude, Message
from onboard.models import leader_flight as flight
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V
from tests.support.honesty import assert_honest, nees
from tests.support.streams import Flight, S, Stream, advance, heartbeat, make_config

SEEDS = range(20)
EXACT = ("own_tilt_sigma_deg=0.0", "own_yaw_sigma_deg=0.0", "own_velocity_sigma_m_s=0.0")


def settings(filter_: str, *more: str) -> tuple[str, ...]:
    named = (f"filter={filter_}", "leader_class=fixed_wing", *more)
    return tuple(f"estimator.leader.{setting}" for setting in named)


def error_at_the_end(
    seed: int, radius: float | None, config: Iterable[str], bias_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Error (7,) of position, velocity and size after 4 s, and its covariance (7, 7). The leader's size and the
    steady errors of our own attitude are drawn."""
    rng = np.random.default_rng(seed)
    flown = Flight(radius=radius, size=2.0 * (1.0 + 0.02 * rng.normal()))
    turned = np.radians(bias_deg) * rng.normal(size=3)
    items = Stream(flight=flown, t1=9.0, seed=1000 + seed).items()
    run = advance([heartbeat(5 * S), *misaligned((i.message for i in items), turned)], make_config(*config))
    last = run.estimates[-1]
    assert last.valid
    r, v = flown.relative(last.t_ns / S)
    return np.array(last.mean)[:7] - np.array([*r, *v, flown.size]), np.array(last.covariance)[:7, :7]


def misaligned(messages: Iterable[Message], turned: Array) -> Iterator[Message]:
    """The autopilot's attitude, off by a rotation vector (3,) in body axes."""
    for m in messages:
        if isinstance(m, Attitude):
            q = quaternion_product(m.q_nb, quaternion_from_vector(turned))
            yield replace(m, q_nb=tuple(q.tolist()))
        else:
            yield m


@pytest.mark.parametrize("radius", [None, 100.0])
def test_nees_with_our_own_state_exact_seeds_0_to_19(radius: float | None) -> None:
    found = [error_at_the_end(seed, radius, settings("wing-line", *EXACT)) for seed in SEEDS]
    assert_honest([nees(error, P) for error, P in found], 7)


@pytest.mark.parametrize("radius", [None, 100.0])
def test_nees_with_our_own_attitude_in_error_seeds_0_to_19(radius: float | None) -> None:
    config = settings("wing-line", "own_velocity_sigma_m_s=0.0")
    found = [error_at_the_end(seed, radius, config, (0.3, 0.3, 1.0)) for seed in SEEDS]
    assert_honest([nees(error, P) for error, P in found], 7)


def walks(model: ManoeuvreModel, size: float) -> dict[int, float]:
    """Variance per second of what wanders without end."""
    each = dict.fromkeys(range(R.start, R.stop), model.position_random_walk**2)
    each |= dict.fromkeys(range(V.start, V.stop), model.velocity_random_walk**2)
    return each | {
        SIZE: (model.size_random_walk * size) ** 2,
        A_LAT: model.a_lat_random_walk**2,
        A_LONG: model.a_long_random_walk**2,
    }


@pytest.mark.parametrize("model", [FIXED_WING, MULTIROTOR])
def test_process_noise_is_what_the_settings_say(model: ManoeuvreModel) -> None:
    """Random walks grow with time; what dies out ends at its own variance and begins with 2 sigma^2 / T."""
    model = model._replace(size_random_walk=0.01)
    bias = (0.01, 0.02, 0.03)
    extras = Extras(delay=0.1, bias=bias, bias_time=40.0)
    moment, long = (noise.process_noise(model, extras, 2.5, dt) for dt in (1e-3, 1e9))
    for i, per_second in walks(model, 2.5).items():
        assert moment[0][i, i] == pytest.approx(1e-3 * per_second)
        assert moment[1][i, i] == moment[0][i, i]
    fading = {
        HEADING: (model.heading, model.heading_time),
        BANK_ERROR: (model.bank, model.bank_time),
        **{extras.states - 3 + k: (bias[k], 40.0) for k in range(3)},
    }
    for mode, along in enumerate(
        [(model.steady, model.steady_time), (model.accelerating, model.accelerating_time)]
    ):
        for i, (sigma, time) in (fading | {A_ALONG: along}).items():
            assert long[mode][i, i] == pytest.approx(sigma**2)
            assert moment[mode][i, i] == pytest.approx(2 * sigma**2 / time * 1e-3, rel=2e-3)
        assert moment[mode][flight.BASE, flight.BASE] == pytest.approx(noise.DELAY_RANDOM_WALK**2 * 1e-3)
        assert np.array_equal(moment[mode], np.diag(np.diag(moment[mode])))


def test_modes_last_as_long_as_the_settings_say() -> None:
    """In the long run each mode has its share of the time; in a moment a mode is left once in its duration."""
    model = MULTIROTOR._replace(steady_for=20.0, accelerating_for=5.0)
    moment, long = (noise.transition_probabilities(model, Extras(), dt) for dt in (1e-3, 1e4))
    np.testing.assert_allclose(long, [[0.8, 0.2]] * 2, rtol=1e-6)
    np.testing.assert_allclose(moment, [[1 - 5e-5, 5e-5], [2e-4, 1 - 2e-4]], rtol=1e-3)
    hovers = model._replace(hovers_for=8.0, flies_for=40.0, straight_for=10.0, turns_for=2.0)
    rates = noise.transition_probabilities(hovers, Extras(middle=True), 1e-3) / 1e-3
    expected = [
        [1 / 20, 1 / 40, 0, 0],
        [1 / 5, 1 / 40, 0, 0],
        [0.5 / 8, 0.5 / 8, 0.5 / 10, 0.5 / 10],
        [0, 1 / 8, 1 / 2, 0],
        [0, 1 / 8, 1 / 2, 0],
    ]
    off_diagonal = rates[~np.eye(5, dtype=bool)].reshape(5, 4)
    np.testing.assert_allclose(off_diagonal, expected, rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize("filter_", ["wing-line", "any-side"])
def test_a_size_without_a_sigma_is_uncertain_by_2_percent_seed_0(filter_: str) -> None:
    """One flight's images say nothing of it: the sigma stays."""
    config = settings(filter_, *EXACT)
    _, covariance = error_at_the_end(0, None, config)
    assert np.sqrt(covariance[SIZE, SIZE]) == pytest.approx(0.02 * 2.0, rel=0.05)
