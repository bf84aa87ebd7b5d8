"""A leader whose nose is known, and what an image shows of its shape: named points, and the sides of a box.

The state is that of `wing`. The shape is a set of points in b (FRD), for a leader of wingspan 1.
It leans as it accelerates: a multirotor's thrust carries, accelerates and drags it. What is open of its pitch, and
by how much a detector misplaces a point on it, is noise.

A measurement is a list of rows. Each is one coordinate, right or down on the plane tangent to the sphere of
directions at the measured center (`image.measurement`), of one point of the shape: a named one, or, for a side of
a box, whichever reaches farthest. A box says no more.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.hypotheses.particle_update import correct, factor, log_likelihood, whiten
from onboard.estimators.leader.hypotheses.wing import COVARIANCES, NOSES, NUMBER, G
from onboard.estimators.leader.image.shape import HIGHEST, LOWEST, Posture, ShapeRows, measured_spread
from onboard.filters.compiled import OUT, VECTOR, record


class Seen(NamedTuple):
    """Of which points (k, 3) which coordinates are seen (`ShapeRows`), how a leader `leans` (`Posture`), from
    where, r_FC (3,), and about which axes (3, 3) in n; the column of the bias of the size, 0 without one."""

    points: Array
    which: Array
    axis: Array
    leans: float
    r_FC: Array
    axes: Array
    bias: int


SEEN: Final = record(Seen, OUT, NOSES, NOSES, NUMBER, NOSES, OUT, types.int64)


def _seen(rows: ShapeRows, posture: Posture, camera: tuple[Array, Array, Array], bias: int) -> Seen:
    R_cn, r_FC, measured = camera
    axes = np.ascontiguousarray(measured @ R_cn)
    return Seen(np.ascontiguousarray(rows.points), rows.which, rows.axis, posture.leans, r_FC, axes, bias)


def update(
    means: Array,
    P: Array,
    noses: Array,
    rows: ShapeRows,
    posture: Posture,
    camera: tuple[Array, Array, Array],
    bias: int = 0,
) -> tuple[Array, Array]:
    """NIS (K,) and logarithms of the likelihoods (K,), without their common constant, of an image. The `camera`:
    its attitude R_cn (3, 3), its place r_FC_n (3,) m, and the measured axes (3, 3) in c. Means (K, N), covariances
    (K, N, N) and noses (K,) are corrected in place: a particle whose nose is where named points show the tail
    turns round."""
    seen = _seen(rows, posture, camera, bias)
    nis, log_l = _update(means, P, noses, seen, rows.y, rows.sigma, rows.named, posture.pitch, posture.misplaced)
    return nis, log_l


def spread(rows: ShapeRows, noses: Array, axes: Array) -> Array:
    """How far (k,) the rows' coordinates are apart, root of the sum of squares, of a leader of wingspan 1 at
    distance 1 that flies level with its nose at `cloud` (k,), without perspective; `axes` (3, 3) in n."""
    c, s, zero, one = np.cos(noses), np.sin(noses), np.zeros_like(noses), np.ones_like(noses)
    body = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])  # (3, 3, k)
    seen = np.einsum("ai,ijk,pj->kap", axes[1:], body, rows.points)  # (k, 2, points)
    columns = []
    for which, axis in zip(rows.which, rows.axis.astype(int), strict=True):
        of_axis = seen[:, axis]
        if which == LOWEST:
            columns.append(of_axis.min(axis=1))
        else:
            columns.append(of_axis.max(axis=1) if which == HIGHEST else of_axis[:, int(which)])
    return measured_spread(rows, np.column_stack(columns))


@njit(cache=True, error_model="numpy")
def _posture(x, nose, leans, B, by):
    """Body axes into B (3, 3), forward, right and down as columns, and the derivatives of bank and pitch by the
    forces: `by` (2, 3), by the acceleration north and east, and down."""
    c, s = np.cos(nose), np.sin(nose)
    north, east, weight = x[6] + x[10], x[7] + x[11], G - x[8]
    across, along = east * c - north * s, north * c + east * s
    bank, pitch = np.arctan2(across, weight) + x[9], leans * np.arctan2(-along, weight)
    sb, cb, sp, cp = np.sin(bank), np.cos(bank), np.sin(pitch), np.cos(pitch)
    B[0, 0], B[1, 0], B[2, 0] = c * cp, s * cp, -sp
    B[0, 1], B[1, 1], B[2, 1] = c * sp * sb - s * cb, s * sp * sb + c * cb, cp * sb
    B[0, 2], B[1, 2], B[2, 2] = c * sp * cb + s * sb, s * sp * cb - c * sb, cp * cb
    square = across * across + weight * weight
    by[0, 0], by[0, 1], by[0, 2] = -s * weight / square, c * weight / square, across / square
    square = along * along + weight * weight
    by[1, 0], by[1, 1] = -leans * c * weight / square, -leans * s * weight / square
    by[1, 2] = -leans * along / square
    return sb, cb


class Scratch(NamedTuple):
    """Room for the body axes (3, 3), the derivatives of bank and pitch (2, 3), and of each point its place and its
    two coordinates (k, 5)."""

    body: Array
    by: Array
    q: Array


@njit(cache=True, error_model="numpy")
def _linearised(x, nose, seen, scratch, h, J, d):
    """The rows that are predicted into h (m,), their derivatives by the state into J (m, N), by the pitch into d
    (m,)."""
    points, which, axis, leans, r_FC, axes, bias = seen
    B, by, q = scratch
    sb, cb = _posture(x, nose, leans, B, by)
    size = np.exp(x[13] + (x[bias] if bias > 0 else 0.0))
    for k in range(points.shape[0]):
        for i in range(3):
            offset = B[i, 0] * points[k, 0] + B[i, 1] * points[k, 1] + B[i, 2] * points[k, 2]
            q[k, i] = x[i] - r_FC[i] + size * offset
        length = np.sqrt(q[k, 0] ** 2 + q[k, 1] ** 2 + q[k, 2] ** 2)
        below = length + axes[0, 0] * q[k, 0] + axes[0, 1] * q[k, 1] + axes[0, 2] * q[k, 2]
        for a in range(2):
            e = axes[1 + a]
            q[k, 3 + a] = 2.0 * (e[0] * q[k, 0] + e[1] * q[k, 1] + e[2] * q[k, 2]) / max(below, 1e-9 * length)
    for j in range(h.shape[0]):
        a = int(axis[j])
        k = max(int(which[j]), 0)
        if which[j] < 0.0:
            for other in range(points.shape[0]):
                if (q[other, 3 + a] < q[k, 3 + a]) == (which[j] == LOWEST):
                    k = other
        h[j] = q[k, 3 + a]
        length = np.sqrt(q[k, 0] ** 2 + q[k, 1] ** 2 + q[k, 2] ** 2)
        below = length + axes[0, 0] * q[k, 0] + axes[0, 1] * q[k, 1] + axes[0, 2] * q[k, 2]
        twice = 2.0 / max(below, 1e-9 * length)
        px, py, pz = points[k]
        banked, pitched, grown = 0.0, 0.0, 0.0
        for i in range(3):
            gradient = twice * (axes[1 + a, i] - 0.5 * h[j] * (q[k, i] / length + axes[0, i]))
            J[j, i] = gradient
            grown += gradient * (px * B[i, 0] + py * B[i, 1] + pz * B[i, 2])
            banked += gradient * (py * B[i, 2] - pz * B[i, 1])
            # the forward axis turns up; right and down turn by it as far as the leader is banked
            up = (-B[0, 2] * cb - B[0, 1] * sb, -B[1, 2] * cb - B[1, 1] * sb, -B[2, 2] * cb - B[2, 1] * sb)[i]
            pitched += gradient * (px * up + (py * sb + pz * cb) * B[i, 0])
        banked, pitched = size * banked, size * pitched
        d[j], J[j, 9], J[j, 13] = pitched, banked, size * grown
        if bias > 0:
            J[j, bias] = J[j, 13]
        J[j, 6] = J[j, 10] = banked * by[0, 0] + pitched * by[1, 0]
        J[j, 7] = J[j, 11] = banked * by[0, 1] + pitched * by[1, 1]
        J[j, 8] = banked * by[0, 2] + pitched * by[1, 2]


@njit(cache=True, error_model="numpy")
def _noise(sigma, d, pitch, place, R):
    """The rows' noise into R (m, m): their own, that of the points' places, and that of the pitch, which is
    common."""
    for i in range(sigma.shape[0]):
        for j in range(sigma.shape[0]):
            R[i, j] = pitch * pitch * d[i] * d[j]
        R[i, i] += sigma[i] * sigma[i] + place * place


@njit(cache=True, error_model="numpy")
def _turn_round(x, P):
    """The state of the same leader with its nose the other way, in place: it banks to the other side."""
    x[9] = -x[9]
    for i in range(P.shape[0]):
        P[9, i] = -P[9, i]
        P[i, 9] = -P[i, 9]


@njit(
    (OUT, COVARIANCES, NOSES, SEEN, VECTOR, VECTOR, types.boolean, NUMBER, NUMBER),
    cache=True,
    error_model="numpy",
)
def _update(means, P, noses, seen, y, sigma, named, pitch, misplaced):
    m, count, width = y.shape[0], means.shape[0], P.shape[2]
    nis, log_l = np.empty(count), np.empty(count)
    scratch = Scratch(np.empty((3, 3)), np.empty((2, 3)), np.empty((seen.points.shape[0], 5)))
    h, e, d, R, c, dx = np.empty(m), np.empty(m), np.empty(m), np.empty((m, m)), np.empty(width), np.empty(width)
    J = np.zeros((m, width))
    for k in range(count):
        x = means[k]
        place = misplaced * np.exp(x[13]) / np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        best, turns = np.inf, 0
        for way in range(2 if named else 1):  # tips change places with the nose: `wing` orders them
            x[9] = -x[9] if way == 1 else x[9]
            nose = noses[k] + way * np.pi
            _linearised(x, nose, seen, scratch, h, J, d)
            J[:, 3:6] = 0.0
            J[:, 12] = 0.0
            e[:] = y - h
            _noise(sigma, d, pitch, place, R)
            whiten(factor(R), e, J)
            off = 0.0
            for j in range(m):
                off += e[j] * e[j]
            if off < best:
                best, turns = off, way
        if named:
            x[9] = -x[9]
            if turns == 1:
                noses[k] += np.pi
                _turn_round(x, P[k])
            _linearised(x, noses[k], seen, scratch, h, J, d)
            J[:, 3:6] = 0.0
            J[:, 12] = 0.0
            e[:] = y - h
            _noise(sigma, d, pitch, place, R)
        L = factor(R)
        if named:
            whiten(L, e, J)
        log_noise = 0.0
        for j in range(m):
            log_noise += np.log(L[j, j])
        nis[k], det = correct(x, P[k], e, J, c, dx, seen.bias)
        log_l[k] = log_likelihood(nis[k], m, det) - log_noise
    return nis, log_l


def expected_box(
    means: Array,
    P: Array,
    noses: Array,
    w: Array,
    rows: ShapeRows,
    posture: Posture,
    camera: tuple[Array, Array, Array],
    bias: int,
) -> tuple[Array, Array]:
    """Mean (m,) and covariance (m, m) of the rows, by particles of weights w (K,), without the rows' own noise.
    The `camera` and the column of the `bias` are as in `update`."""
    seen = _seen(rows, posture, camera, bias)
    mean, covariance = _expected_box(means, P, noses, w, seen, posture.pitch, posture.misplaced)
    return mean, covariance


@njit((OUT, COVARIANCES, NOSES, VECTOR, SEEN, NUMBER, NUMBER), cache=True, error_model="numpy")
def _expected_box(means, P, noses, w, seen, pitch, misplaced):
    m, width = seen.which.shape[0], P.shape[2]
    scratch = Scratch(np.empty((3, 3)), np.empty((2, 3)), np.empty((seen.points.shape[0], 5)))
    h, d, J, JP = np.empty(m), np.empty(m), np.zeros((m, width)), np.empty(width)
    mean, covariance = np.zeros(m), np.zeros((m, m))
    for k in range(means.shape[0]):
        x = means[k]
        place = misplaced * np.exp(x[13]) / np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        _linearised(x, noses[k], seen, scratch, h, J, d)
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
