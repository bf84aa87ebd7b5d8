"""What particles expect together of the sides of a box (`models.apparent_shape`)."""

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.compiled import OUT, ROWS, VECTOR
from onboard.models.apparent_shape import Posture, Rows, _linearised
from onboard.models.apparent_wing import COVARIANCES, NOSES, NUMBER


def prediction(
    means: Array,
    P: Array,
    noses: Array,
    w: Array,
    rows: Rows,
    posture: Posture,
    camera: tuple[Array, Array, Array],
    bias: int,
) -> tuple[Array, Array]:
    """Mean (m,) and covariance (m, m) of the rows, by particles of weights w (K,), without the rows' own noise.
    The `camera` and the column of the `bias` are as in `apparent_shape.update`."""
    R_cn, r_FC, seen = camera
    shape = np.ascontiguousarray(rows.points), rows.which, rows.axis
    axes = np.ascontiguousarray(seen @ R_cn)
    mean, covariance = _prediction(means, P, noses, w, *shape, *posture, r_FC, axes, bias)
    return mean, covariance


@njit(
    (
        *(OUT, COVARIANCES, NOSES, VECTOR, ROWS, VECTOR, VECTOR),
        *(NUMBER, NUMBER, NUMBER, VECTOR, ROWS, types.int64),
    ),
    cache=True,
    error_model="numpy",
)
def _prediction(means, P, noses, w, points, which, axis, leans, pitch, misplaced, r_FC, axes, bias):
    m, width = which.shape[0], P.shape[2]
    B, by, q = np.empty((3, 3)), np.empty((2, 3)), np.empty((points.shape[0], 5))
    h, d, J, JP = np.empty(m), np.empty(m), np.zeros((m, width)), np.empty(width)
    mean, covariance = np.zeros(m), np.zeros((m, m))
    for k in range(means.shape[0]):
        x = means[k]
        place = misplaced * np.exp(x[13]) / np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        _linearised(x, noses[k], points, which, axis, leans, r_FC, axes, bias, B, by, q, h, J, d)
        J[:, 3:6] = 0.0
        J[:, 12] = 0.0
        for i in range(m):
            for n in range(width):
                JP[n] = 0.0
                for a in range(width):
                    JP[n] += J[i, a] * P[k, a, n]
            mean[i] += w[k] * h[i]
            covariance[i, i] += w[k] * place * place
            for j in range(m):
                spread = h[i] * h[j] + pitch * pitch * d[i] * d[j]
                for n in range(width):
                    spread += JP[n] * J[j, n]
                covariance[i, j] += w[k] * spread
    for i in range(m):
        for j in range(m):
            covariance[i, j] -= mean[i] * mean[j]
    return mean, covariance
