"""A leader carried on: the same circle for the guidance and for what an earlier run knew."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.autopilot.guidance.leader import LeaderTrack
from onboard.estimators.leader.reports.prior import Prior, spread
from onboard.geometry.carried import MAX_TURN_RATE_RAD_S, carried, turn_rate
from tests.support.leader import leader_state
from tests.support.streams import S

R, V = np.array([30.0, -5.0, -40.0]), np.array([7.0, 0.0, -0.5])
RATE = 0.17  # rad/s
A = np.array([0.0, 7.0 * RATE, 0.0])


class Here:
    """Our own vehicle at the origin."""

    r_OF_n = np.zeros(3)

    def pose_at(self, _t_ns: int) -> "Here":
        return self


def stepped(dt: float, steps: int = 100_000) -> tuple[np.ndarray, np.ndarray]:
    r, v, h = R.copy(), V.copy(), dt / steps
    for _ in range(steps):
        turned = RATE * np.array([-v[1], v[0], 0.0])
        r, v = r + h * v + 0.5 * h * h * turned, v + h * turned
    return r, v


def test_it_flies_a_circle_at_its_speed() -> None:
    for found, wanted in zip(carried(R, V, RATE, 7.0), stepped(7.0, 20_000), strict=True):
        assert_allclose(found, wanted, atol=0.01)
    for found, wanted in zip(carried(R, V, 0.0, 7.0), (R + 7.0 * V, V), strict=True):
        assert_allclose(found, wanted)


def test_the_guidance_and_a_warm_start_carry_it_to_one_place() -> None:
    """7 s without a daemon: carried on without its turn, a leader at 49 m was believed at 20."""
    prior = Prior(0, R, V, A, np.diag([1.0, 1.0, 1.0, 0.2, 0.2, 0.2]))
    belief = prior.relative(7 * S, Here())
    assert belief is not None
    r, v = carried(R, V, RATE, 7.0)
    assert_allclose(belief.mean, [*r, *v], atol=1e-9)
    track = LeaderTrack()
    r_n, v_n, a_n = ((x, y, z) for x, y, z in (R.tolist(), V.tolist(), A.tolist()))
    nothing = ((0.0,) * 6,) * 6
    track.resume(leader_state(r_OL_n=r_n, v_L_n=v_n, a_L_n=a_n, covariance=nothing), None)
    track.coast(7.0)
    assert_allclose([*track.r, *track.v[:2]], [*r, *v[:2]], atol=1e-9)


def test_a_rate_is_that_of_a_flying_leader_and_of_a_turn_that_lasts() -> None:
    assert turn_rate(V, A) == pytest.approx(RATE)
    assert turn_rate(0.1 * V, A) == 0.0
    assert turn_rate(np.array([1.5, 0.0, 0.0]), np.array([0.0, -4.0, 0.0])) == -MAX_TURN_RATE_RAD_S


def test_what_it_may_have_begun_meanwhile_seed_1() -> None:
    """Accelerations of 1 m/s^2 whose correlation lasts 3 s, by 4,000 draws. What was known turns with it."""
    rng, dt, n = np.random.default_rng(1), 0.05, 4_000
    P = np.diag([4.0, 1.0, 1.0, 0.25, 0.25, 0.1])
    x = rng.multivariate_normal(np.zeros(6), P, n)
    r, v = R + x[:, :3], V + x[:, 3:]
    sigma, fading = np.array([1.0, 1.0, 0.5]), np.exp(-dt / 3.0)
    a = sigma * rng.standard_normal((n, 3))
    for _ in range(140):
        turned = RATE * np.stack([-v[:, 1], v[:, 0], 0.0 * v[:, 0]], axis=1)
        r, v = r + dt * v + 0.5 * dt * dt * (a + turned), v + dt * (a + turned)
        a = fading * a + sigma * np.sqrt(1.0 - fading**2) * rng.standard_normal((n, 3))
    drawn, found = np.sqrt(np.diag(np.cov(np.hstack([r, v]).T))), np.sqrt(np.diag(spread(P, RATE, 7.0)))
    assert_allclose(drawn, found, rtol=0.15)  # the circle turns what is unseen, too
