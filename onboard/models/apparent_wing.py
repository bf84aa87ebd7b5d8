"""A leader whose nose is known, as one of many particles supposes: how it moves, and what an image shows of it.

One image leaves the nose open, and with it the range. But if the nose is given, the rest is nearly linear: the
wing's apparent length gives the range, its slope the bank. So the nose is sampled
(`estimators.leader.nose_particles`), and each sample has a Gaussian over the other states, with the nose as a
given number.

State (N = 13), vectors in n: r_FL (3), from the follower F to the leader L, m; v_L (3), m/s; a_L (3), m/s^2;
`bank_error`, rad, beyond the bank that the thrust implies; `lean` (2), m/s^2, north and east: what a multirotor's
thrust needs against the air, drag times the airspeed; `stretch`: the logarithm of a slow error of the apparent
length, of a nose that wobbles and of a detector that misplaces a tip.

The follower's own errors are no states. An error of our velocity moves the leader's velocity alike, and one of our
attitude turns the whole scene; both are added to what is reported.
"""

from typing import Final

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.compiled import OUT, ROWS, VECTOR, out

G: Final = 9.80665
N: Final = 13
R: Final = slice(0, 3)
V: Final = slice(3, 6)
A: Final = slice(6, 9)
BANK_ERROR: Final = 9
LEAN: Final = slice(10, 12)
STRETCH: Final = 12
LEAST_VISIBLE: Final = 0.05  # of the wing: seen exactly along itself, it still shows a tip
SLOW2: Final = 1.0  # (m/s)^2: in place of 0/0 where a course would be divided by
TURNS2: Final = 4.0  # (m/s)^2: a leader slower than its root does not turn its velocity
FOLLOWS4: Final = 81.0  # (m/s)^4: a leader faster than its fourth root turns its nose with its course
STEP_M: Final = 1e-3  # of differences, as a share of the range
STEP_RAD: Final = 1e-3
TINY: Final = 1e-12

NUMBER: Final = types.float64
NOSES: Final = out(types.float64, 1)
COVARIANCES: Final = out(types.float64, 3)


def predict(
    means: Array, P: Array, noses: Array, dt: float, moved: Array, q: Array, decay: Array, drag: float
) -> None:
    """Means (K, N) and covariances (K, N, N), in place, after `dt` seconds in which the follower moves by `moved`
    (3,) m, in n; the noses (K,) turn with the course. `q` (K, N) are the variances that the step adds; `decay`
    (3,) is what it leaves of the acceleration along the track, the bank's error and the stretch; `drag` is in
    1/s."""
    _predict(means, P, noses, dt, moved, q, decay, drag)


def update(
    means: Array, P: Array, noses: Array, size: float, y: Array, R_y: Array, R_cn: Array, r_FC: Array, seen: Array
) -> tuple[Array, Array]:
    """NIS (K,) and logarithms of the likelihoods (K,), without their common constant, of an image: y (m,) of
    `models.wing_line` with noise R_y (m, m), by a camera at r_FC_n (3,) m with attitude R_cn (3, 3), about the
    measured axes `seen` (3, 3) in c. Means (K, N) and covariances (K, N, N) are corrected in place."""
    nis, log_l = _update(means, P, noses, size, y, R_y, R_cn, r_FC, seen)
    return nis, log_l


@njit(cache=True, error_model="numpy")
def _wing(nose, bank):  # type: ignore[no-untyped-def]
    """The direction in n from the left wingtip to the right one."""
    level = np.cos(bank)
    return -np.sin(nose) * level, np.cos(nose) * level, np.sin(bank)


@njit(cache=True, error_model="numpy")
def _bank(x, c, s):  # type: ignore[no-untyped-def]
    """The bank of a wing square to the thrust, which carries the weight, accelerates, and leans against the
    air."""
    across = (x[7] + x[11]) * c - (x[6] + x[10]) * s
    return np.arctan2(across, G - x[8])


@njit(cache=True, error_model="numpy")
def _advance(S, j, side, dt, half, drag, t00, t01, t10, t11, down, decay):  # type: ignore[no-untyped-def]
    """One column (side 0) or row (side 1) of a covariance through the transition."""
    w = S[:, j] if side == 0 else S[j]
    a, b, d = w[6], w[7], w[8]
    w[0] += dt * w[3] + half * a
    w[1] += dt * w[4] + half * b
    w[2] += dt * w[5] + half * d
    w[3] += dt * a
    w[4] += dt * b
    w[5] += dt * d
    w[10] += drag * dt * a
    w[11] += drag * dt * b
    w[6], w[7], w[8] = t00 * a + t01 * b, t10 * a + t11 * b, down * d
    w[9] *= decay[1]
    w[12] *= decay[2]


@njit((OUT, COVARIANCES, NOSES, NUMBER, VECTOR, ROWS, VECTOR, NUMBER), cache=True, error_model="numpy")
def _predict(means, P, noses, dt, moved, q, decay, drag):  # type: ignore[no-untyped-def]
    half = 0.5 * dt * dt
    for k in range(means.shape[0]):
        x, S = means[k], P[k]
        u, v, a, b = x[3], x[4], x[6], x[7]
        speed2 = u * u + v * v
        rate = (u * b - v * a) / (speed2 + SLOW2)
        noses[k] += speed2 * speed2 / (speed2 * speed2 + FOLLOWS4) * rate * dt
        turn = rate * dt * speed2 / (speed2 + TURNS2)
        c, s = np.cos(turn), np.sin(turn)
        # what is along the track decays, and all of a slow leader's
        slow = 1.0 - (1.0 - decay[0]) * TURNS2 / (speed2 + TURNS2)
        lost = (1.0 - decay[0]) / (speed2 + SLOW2)
        k00, k01 = slow * (1.0 - lost * u * u), -slow * lost * u * v
        k11 = slow * (1.0 - lost * v * v)
        t00, t01 = c * k00 - s * k01, c * k01 - s * k11
        t10, t11 = s * k00 + c * k01, s * k01 + c * k11
        down = decay[0] * slow
        for side in range(2):
            for j in range(N):
                _advance(S, j, side, dt, half, drag, t00, t01, t10, t11, down, decay)
        for i in range(N):
            S[i, i] += q[k, i]
            for j in range(i):
                S[i, j] = S[j, i] = 0.5 * (S[i, j] + S[j, i])
        for i in range(3):
            x[i] += dt * x[3 + i] + half * x[6 + i] - moved[i]
            x[3 + i] += dt * x[6 + i]
        x[10] += drag * dt * a
        x[11] += drag * dt * b
        x[6], x[7], x[8] = t00 * a + t01 * b, t10 * a + t11 * b, down * x[8]
        x[9] *= decay[1]
        x[12] *= decay[2]


@njit(cache=True, error_model="numpy")
def _image(x, y, z, nose, bank, half, R_cn, seen, m, out):  # type: ignore[no-untyped-def]
    """What an image shows of a leader at (x, y, z) from the camera, into `out` (m,)."""
    w0, w1, w2 = _wing(nose, bank)
    for k in range(3):
        sign = (0.0, -half, half)[k]
        a, b, c = x + sign * w0, y + sign * w1, z + sign * w2
        p0 = R_cn[0, 0] * a + R_cn[0, 1] * b + R_cn[0, 2] * c
        p1 = R_cn[1, 0] * a + R_cn[1, 1] * b + R_cn[1, 2] * c
        p2 = R_cn[2, 0] * a + R_cn[2, 1] * b + R_cn[2, 2] * c
        length = np.sqrt(p0 * p0 + p1 * p1 + p2 * p2)
        twice = 2.0 / max(length + seen[0, 0] * p0 + seen[0, 1] * p1 + seen[0, 2] * p2, 1e-9 * length)
        right = twice * (seen[1, 0] * p0 + seen[1, 1] * p1 + seen[1, 2] * p2)
        down = twice * (seen[2, 0] * p0 + seen[2, 1] * p1 + seen[2, 2] * p2)
        if k == 0:
            out[0], out[1] = right, down
        elif k == 1:
            out[2], out[3] = -right, -down
            if m > 4:
                out[4], out[5] = 0.5 * right, 0.5 * down
        else:
            out[2] += right
            out[3] += down
            if m > 4:
                out[4] += 0.5 * right
                out[5] += 0.5 * down


@njit(cache=True, error_model="numpy")
def _linearised(x, nose, size, R_cn, r_FC, seen, m, h, J, up, low):  # type: ignore[no-untyped-def]
    """The predicted measurement into h (m,), its derivatives by the state into J (m, N)."""
    c, s = np.cos(nose), np.sin(nose)
    bank = _bank(x, c, s) + x[9]
    p = (x[0] - r_FC[0], x[1] - r_FC[1], x[2] - r_FC[2])
    half = 0.5 * size * np.exp(x[12])
    _image(p[0], p[1], p[2], nose, bank, half, R_cn, seen, m, h)
    J[:] = 0.0
    step = STEP_M * np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    for i in range(3):
        d0, d1, d2 = step * (i == 0), step * (i == 1), step * (i == 2)
        _image(p[0] + d0, p[1] + d1, p[2] + d2, nose, bank, half, R_cn, seen, m, up)
        _image(p[0] - d0, p[1] - d1, p[2] - d2, nose, bank, half, R_cn, seen, m, low)
        for j in range(m):
            J[j, i] = (up[j] - low[j]) / (2.0 * step)
    _image(p[0], p[1], p[2], nose, bank + STEP_RAD, half, R_cn, seen, m, up)
    _image(p[0], p[1], p[2], nose, bank - STEP_RAD, half, R_cn, seen, m, low)
    across, weight = (x[7] + x[11]) * c - (x[6] + x[10]) * s, G - x[8]
    square = across * across + weight * weight
    for j in range(m):
        by_bank = (up[j] - low[j]) / (2.0 * STEP_RAD)
        J[j, 6], J[j, 7], J[j, 8] = (
            -s * weight / square * by_bank,
            c * weight / square * by_bank,
            across / square * by_bank,
        )
        J[j, 10], J[j, 11] = J[j, 6], J[j, 7]
        J[j, 9] = by_bank
    J[2, 12], J[3, 12] = h[2], h[3]
    if m > 4:
        J[4, 12], J[5, 12] = 2.0 * (h[4] - h[0]), 2.0 * (h[5] - h[1])  # it grows with the wing's square


@njit(cache=True, error_model="numpy")
def _innovation_factor(P, J, R_y, S, C, m):  # type: ignore[no-untyped-def]
    """C = P J^T, and into S the Cholesky factor of J P J^T + R_y."""
    for i in range(N):
        for j in range(m):
            total = 0.0
            for n in range(N):
                total += P[i, n] * J[j, n]
            C[i, j] = total
    for i in range(m):
        for j in range(i + 1):
            total = R_y[i, j]
            for n in range(N):
                total += J[i, n] * C[n, j]
            for n in range(j):
                total -= S[i, n] * S[j, n]
            S[i, j] = np.sqrt(max(total, TINY * TINY)) if i == j else total / S[j, j]


@njit(cache=True, error_model="numpy")
def _whiten(e, S, C, K, m):  # type: ignore[no-untyped-def]
    """e becomes S^-1 e, and K becomes C S^-T, with S a Cholesky factor; NIS and the determinant's logarithm."""
    nis, log_det = 0.0, 0.0
    for i in range(m):
        for n in range(i):
            e[i] -= S[i, n] * e[n]
        e[i] /= S[i, i]
        nis += e[i] * e[i]
        log_det += 2.0 * np.log(S[i, i])
    for i in range(N):
        for j in range(m):
            total = C[i, j]
            for n in range(j):
                total -= K[i, n] * S[j, n]
            K[i, j] = total / S[j, j]
    return nis, log_det


@njit(cache=True, error_model="numpy")
def _correct(x, P, e, K, m):  # type: ignore[no-untyped-def]
    """Mean and covariance of one particle by a whitened innovation and its gain, in place."""
    for i in range(N):
        for j in range(m):
            x[i] += K[i, j] * e[j]
        for j in range(i + 1):
            total = P[i, j]
            for n in range(m):
                total -= K[i, n] * K[j, n]
            P[i, j] = P[j, i] = total


@njit((OUT, COVARIANCES, VECTOR, NUMBER, VECTOR, ROWS, ROWS, VECTOR, ROWS), cache=True, error_model="numpy")
def _update(means, P, noses, size, y, R_y, R_cn, r_FC, seen):  # type: ignore[no-untyped-def]
    m, count = y.shape[0], means.shape[0]
    nis, log_l = np.empty(count), np.empty(count)
    h, up, low, e = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    J, S, C, K = np.empty((m, N)), np.empty((m, m)), np.empty((N, m)), np.empty((N, m))
    for k in range(count):
        _linearised(means[k], noses[k], size, R_cn, r_FC, seen, m, h, J, up, low)
        # detectors name tips by their side
        sign = -1.0 if h[2] * y[2] + h[3] * y[3] < 0 else 1.0
        for i in range(m):
            e[i] = (sign if 2 <= i < 4 else 1.0) * y[i] - h[i]
        _innovation_factor(P[k], J, R_y, S, C, m)
        nis[k], log_det = _whiten(e, S, C, K, m)
        _correct(means[k], P[k], e, K, m)
        log_l[k] = -0.5 * (nis[k] + log_det)
    return nis, log_l


def axes_about(direction: Array) -> Array:
    """Unit vectors (3, 3) in n: a direction (3,), and to the right (level) and down of it."""
    level = np.hypot(direction[0], direction[1])
    right = np.array([-direction[1], direction[0], 0.0]) / level if level > 1e-6 else np.array([0.0, 1.0, 0.0])
    return np.array([direction, right, np.cross(direction, right)])


def visible(noses: Array, directions: Array) -> Array:
    """The fraction (k,) that is seen of a level wing's length: its nose at `noses` (k,), the leader in the unit
    `directions` (k, 3)."""
    along = np.cos(noses) * directions[:, 1] - np.sin(noses) * directions[:, 0]
    found: Array = np.sqrt(np.maximum(1.0 - along * along, 0.0) + LEAST_VISIBLE * LEAST_VISIBLE)
    return found
