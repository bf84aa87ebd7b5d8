"""Our own state's covariance is as large as its errors: neither over- nor underconfident, in twenty short flights
whose noise and steady errors are drawn as the configuration says."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.noise import SensorNoise
from onboard.estimators.own_state.track import process_noise
from onboard.geometry.rotations import quaternion_from_vector
from onboard.messages import GlobalPosition, LocalPosition, Message, NavState, Quaternion
from onboard.models.own_motion import DISTURBANCE, OFFSET
from onboard.models.quadrotor import ATTITUDE, POSITION, VELOCITY
from onboard.wire.odometry import odometry_of
from tests.support import own_vehicle as own
from tests.support.cases import slow_but
from tests.support.honesty import assert_honest, assert_neither_too_sure_nor_too_unsure, nees

SEEDS = range(20)
FILTERS = slow_but(["csvsf-adaptive"], ["cubature", "csvsf-adaptive"])
ZERO = (0.0, 0.0, 0.0)


def hovering(seed: int) -> Iterator[Message]:
    """Level and at rest for 5 s at 50 Hz: each sensor with the noise that the configuration expects of it, the
    accelerometer with a bias, the attitude with a steady error."""
    rng = np.random.default_rng(seed)
    config = Config()
    white = np.radians(config.attitude_sigma_deg)
    steady = rng.normal(size=3) * np.radians([config.own_tilt_sigma_deg] * 2 + [config.own_yaw_sigma_deg])
    bias = config.bias_sigma_m_s2 * rng.normal(size=3)
    speed = np.array(config.gps_velocity_sigma_m_s[:2])
    for t in range(1000, 6000, 20):
        yield own.imu(t, np.array([0.0, 0.0, -own.GRAVITY]) + bias + 0.02 * rng.normal(size=3))
        q = quaternion_from_vector(steady + white * rng.normal(size=3))
        yield own.attitude(t, q, np.radians(config.rates_sigma_deg_s) * rng.normal(size=3))
        if t % 100 == 0:
            yield own.fix(t, np.array([0.5, 0.5, 1.0]) * rng.normal(size=3), speed * rng.normal(size=2))


def origin() -> Iterator[Message]:
    """Where the autopilot's origin is: so that no error of the first fix is taken for it."""
    lat, lon, alt = own.ORIGIN
    place = {"lat_deg": lat, "lon_deg": lon, "alt_msl": alt, "height": 0.0, "heading_rad": None}
    yield own.attitude(900)
    for t in (900, 920):
        yield LocalPosition(**own.header(t), r_OF_n=ZERO, v_F_n=ZERO)
    yield GlobalPosition(**own.header(910), **place, v_F_n=ZERO)


@cache
def ends(filter_: str) -> list[NavState]:
    """The last state of each flight."""
    found = []
    for seed in SEEDS:
        p = own.pipeline(filter=filter_)
        found.append(own.states_of(p, [own.heartbeat(), *origin(), *hovering(seed)])[-1])
    assert all(state.valid for state in found)
    return found


def rotation(q: Quaternion | None) -> Array:
    """A small rotation as a vector (3,)."""
    assert q is not None
    return np.asarray(2.0 * np.sign(q[0]) * np.array(q[1:]))


def errors(filter_: str) -> list[tuple[Array, Array]]:
    """Error (12,) and covariance (12, 12) at the end of each flight; the attitude's as a rotation vector in b."""
    return [
        (np.array([*(s.mean or ())[:6], *rotation(s.q_nb), *(s.omega_b or ())]), np.array(s.covariance))
        for s in ends(filter_)
    ]


def sent(filter_: str) -> list[tuple[Array, Array, Array, Array]]:
    """What ODOMETRY has at the end of each flight: error (6,) and covariance (6, 6) of the pose, the same of
    velocity and rates in b."""
    found = []
    for state in ends(filter_):
        m = odometry_of(state)
        assert m is not None
        pose, speed = np.array([*m.r_OF_n, *rotation(m.q_nb)]), np.array([*m.v_F_b, *m.omega_b])
        found.append((pose, whole(m.pose_covariance), speed, whole(m.velocity_covariance)))
    return found


def whole(upper: tuple[float, ...]) -> Array:
    """The symmetric matrix (6, 6) of its upper triangle (21)."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = upper
    return matrix + np.triu(matrix, 1).T


@pytest.mark.parametrize(("part", "dof"), [("position", 3), ("attitude", 3), ("rates", 3)])
@pytest.mark.parametrize("filter_", FILTERS)
def test_nees_of_each_part_seeds_0_to_19(filter_: str, part: str, dof: int) -> None:
    at = {"position": slice(0, 3), "attitude": slice(6, 9), "rates": slice(9, 12)}[part]
    assert_honest([nees(error[at], P[at, at]) for error, P in errors(filter_)], dof)


@pytest.mark.parametrize("filter_", FILTERS)
def test_nees_of_all_twelve_seeds_0_to_19(filter_: str) -> None:
    assert_honest([nees(error, P) for error, P in errors(filter_)], 12)


@pytest.mark.parametrize("filter_", FILTERS)
def test_the_velocity_is_neither_too_sure_nor_too_unsure_seeds_0_to_19(filter_: str) -> None:
    """It is pessimistic at rest, by the manoeuvres that it has to expect."""
    mean = np.mean([nees(error[3:6], P[3:6, 3:6]) for error, P in errors(filter_)])
    assert_neither_too_sure_nor_too_unsure(float(mean), 3)


@pytest.mark.parametrize("filter_", FILTERS)
def test_nees_of_odometry_seeds_0_to_19(filter_: str) -> None:
    assert_honest([nees(error, P) for error, P, _, _ in sent(filter_)], 6)
    assert_honest([nees(error[3:], P[3:, 3:]) for _, _, error, P in sent(filter_)], 3)
    velocity = np.mean([nees(error[:3], P[:3, :3]) for _, _, error, P in sent(filter_)])
    of_state = np.mean([nees(error[3:6], P[3:6, 3:6]) for error, P in errors(filter_)])
    assert velocity == pytest.approx(of_state, rel=1 / 4)


def test_process_noise_is_what_is_assumed() -> None:
    variance, fading = process_noise(Config())
    assert variance[list(VELOCITY)] == pytest.approx(0.005**2)
    assert variance[OFFSET] == pytest.approx(0.07**2)
    assert fading == pytest.approx(1 / 50.0)
    # what dies out at that rate and is driven so ends at its own variance
    assert variance[list(DISTURBANCE)] / (2 * fading) == pytest.approx(0.05**2)
    assert variance[list(POSITION)] == pytest.approx(1e-8)
    assert variance[list(ATTITUDE)] == pytest.approx(1e-6)
    gusts, fading = process_noise(Config(force="thrust"))
    assert gusts[list(DISTURBANCE)] / (2 * fading) == pytest.approx([9.0, 9.0, 0.05**2])


@pytest.mark.parametrize(("airframe", "sigma"), [("unknown", 2.0), ("x500", 0.2)])
def test_a_vehicle_whose_torques_are_known_turns_less_by_surprise(airframe: str, sigma: float) -> None:
    noise = SensorNoise(Config(airframe=airframe))
    assert noise.turning(0) == pytest.approx(sigma**2)
