"""What particles expect of a box, against their update by it, and against their moments."""

import numpy as np
import pytest

from onboard.estimators.leader.hypotheses import view
from onboard.estimators.leader.hypotheses.motion import POSITION, N
from onboard.estimators.leader.image.measurement import OF_BOX, Rows
from onboard.estimators.leader.image.shape import Posture
from tests.unit.estimators.leader.hypotheses.test_points import POINTS, axes_of, drawn

POSTURE = Posture(1.0, 0.1, 0.03)
FREE = np.zeros(2)


def rows_of(y: list[float]) -> Rows:
    """A box's middle and size."""
    R = np.diag(np.square([0.003, 0.004, 0.006, 0.008]))
    return Rows(np.array(y), R, POINTS, *OF_BOX, posture=POSTURE, bias=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_what_one_particle_expects_has_the_nis_of_its_update_seed_0_to_2(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    wide = np.zeros((N + 1, N + 1))
    wide[:N, :N], wide[N, N] = P, 0.01
    state = np.append(x, 0.02)[None], wide[None], np.array([heading])
    rows, camera = rows_of([-0.01, -0.005, 0.08, 0.03]), (R_cn, np.array([0.1, 0.0, -0.2]), axes_of(x, R_cn))
    seen = view.view_of(rows, camera, FREE, N)
    expected, off, S, together, each = view.expect(*state, np.ones(1), seen)
    np.testing.assert_allclose(off, rows.y - expected, rtol=1e-12)
    assert float(off @ np.linalg.solve(S, off)) == pytest.approx(together, rel=1e-9)
    nis, _ = view.update(*state, seen, each)
    assert together == pytest.approx(float(nis[0]), rel=1e-6)


def test_several_particles_expect_their_mean_and_how_far_they_are_apart_seed_4() -> None:
    x, P, heading, R_cn = drawn(4)
    means, covariances = np.array([x, x]), np.array([P, P])
    means[1, POSITION] += [0.0, 2.0, 0.5]
    headings, w, camera = (
        np.array([heading, heading + 0.5]),
        np.array([0.25, 0.75]),
        (R_cn, np.zeros(3), axes_of(x, R_cn)),
    )
    seen = view.view_of(rows_of([0.0] * 4), camera, FREE)

    def alone(k: int) -> tuple[np.ndarray, np.ndarray]:
        which = slice(k, k + 1)
        return view.expect(means[which], covariances[which], headings[which], np.ones(1), seen)[0:3:2]

    (a, S_a), (b, S_b) = alone(0), alone(1)
    mean, _, S, *_ = view.expect(means, covariances, headings, w, seen)
    np.testing.assert_allclose(mean, 0.25 * a + 0.75 * b, rtol=1e-9)
    apart = 0.25 * 0.75 * np.outer(a - b, a - b)
    np.testing.assert_allclose(S, 0.25 * S_a + 0.75 * S_b + apart, rtol=1e-9, atol=1e-15)
