"""What particles expect of the sides of a box, against their update by it, and against their moments."""

import numpy as np
import pytest

from onboard.estimators.leader.hypotheses import points
from onboard.estimators.leader.hypotheses.wing import POSITION, N
from onboard.estimators.leader.image.shape import HIGHEST, LOWEST, Posture, ShapeRows
from tests.unit.estimators.leader.hypotheses.test_points import POINTS, axes_of, drawn

POSTURE = Posture(1.0, 0.1, 0.03)


def rows_of(y: list[float]) -> ShapeRows:
    which, axis = np.array([LOWEST, HIGHEST] * 2), np.array([0.0, 0.0, 1.0, 1.0])
    return ShapeRows(POINTS, which, axis, np.array(y), np.array([0.004, 0.004, 0.006, 0.006]), named=False)


@pytest.mark.parametrize("seed", range(3))
def test_what_one_particle_expects_has_the_nis_of_its_update_seed_0_to_2(seed: int) -> None:
    x, P, nose, R_cn = drawn(seed)
    wide = np.zeros((N + 1, N + 1))
    wide[:N, :N], wide[N, N] = P, 0.01
    means, covariances, noses = np.append(x, 0.02)[None], wide[None], np.array([nose])
    camera, rows = (R_cn, np.array([0.1, 0.0, -0.2]), axes_of(x, R_cn)), rows_of([-0.05, 0.03, -0.02, 0.01])
    expected, S = points.expected_box(means, covariances, noses, np.ones(1), rows, POSTURE, camera, N)
    off = rows.y - expected
    nis, _ = points.update(means, covariances, noses, rows, POSTURE, camera, N)
    assert float(off @ np.linalg.solve(S + np.diag(rows.sigma**2), off)) == pytest.approx(float(nis[0]), rel=1e-6)


def test_several_particles_expect_their_mean_and_how_far_they_are_apart_seed_4() -> None:
    x, P, nose, R_cn = drawn(4)
    means, covariances = np.array([x, x]), np.array([P, P])
    means[1, POSITION] += [0.0, 2.0, 0.5]
    noses, w, camera = np.array([nose, nose + 0.5]), np.array([0.25, 0.75]), (R_cn, np.zeros(3), axes_of(x, R_cn))
    rows = rows_of([0.0] * 4)

    def alone(k: int) -> tuple[np.ndarray, np.ndarray]:
        which = slice(k, k + 1)
        one = means[which], covariances[which], noses[which]
        return points.expected_box(*one, np.ones(1), rows, POSTURE, camera, 0)

    (a, S_a), (b, S_b) = alone(0), alone(1)
    mean, S = points.expected_box(means, covariances, noses, w, rows, POSTURE, camera, 0)
    np.testing.assert_allclose(mean, 0.25 * a + 0.75 * b, rtol=1e-9)
    apart = 0.25 * 0.75 * np.outer(a - b, a - b)
    np.testing.assert_allclose(S, 0.25 * S_a + 0.75 * S_b + apart, rtol=1e-9, atol=1e-15)
