"""Compiled arithmetic of the smooth variable structure filters, over a batch.

A measurement is linearised over cubature points, and an update moves measured quantities by given steps. With
prior covariance P = L L^T, the images' odd parts, B = [h(x + sqrt(n) L_j) - h(x - sqrt(n) L_j)] / 2 sqrt(n) in (n,
m), give the cross-covariance L B, H = B^T L^-1 (exact for a linear measurement) and H P H^T = B^T B. Their even
parts are added to R: the nonlinear part of h counts as noise, and no large numbers are subtracted. For any steps s
(m,), x + G s with a right inverse G of H moves the predicted measurement by s.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import BOOL, FLAGS, FLOAT, INT, MAKING, kernel, record, signature
from onboard.filters.errors import (
    ANGLE_ERROR,
    COVARIANCE_ERROR,
    IMAGES_ERROR,
    INNOVATION_ERROR,
    MAX_ANGLE_SPREAD,
    MEASUREMENT_ERROR,
    MEMBER_FACTOR,
    OK,
    R_INDEFINITE_ERROR,
    R_NOT_FINITE_ERROR,
    SHAPE_ERROR,
)
from onboard.filters.kernels.cholesky import factor_into, is_noise, root_into
from onboard.filters.kernels.gains import (
    add_transposed_product_into,
    joseph_into,
    mixed_gain,
    right_inverse,
    solve_into,
    widen_into,
)
from onboard.filters.kernels.sigma_points import wrapped

INFINITE_RATIO: Final = 1e30  # finite, so that its product with zero is zero

FIXED_LAYER_TYPE: Final = 0  # switching gain for every component
VARIABLE_LAYER_TYPE: Final = 1  # Kalman gain where the optimal layer is within the limit
SWITCHED_LAYER_TYPE: Final = 2  # Kalman gain where |e| + gamma |residual| is within scale deviations of e
ADAPTIVE_LAYER_TYPE: Final = 3  # switched, after widening the prior where e keeps to one side

# A mean with a memory longer by SLOW_MEAN_FACTOR finds smaller errors, too late to follow them. Errors beyond
# SLOW_MEAN_SIGMAS of its standard deviations are added to the covariance.
SLOW_MEAN_FACTOR: Final = 5
SLOW_MEAN_SIGMAS: Final = 2.0


@kernel(**MAKING)
def linearise_into(images, y, R, angular, predicted, e, B, N, S):
    """Fill the predicted measurement, innovation e, B (n, m), N and S = B^T B + N, of images (2n+1, m).

    Returns a status.
    """
    k, m = images.shape
    n = k // 2
    even, farthest = np.empty((n, m)), 0.0
    for a in range(m):  # relative to the centre's image, so that a mean of angles does not break at +-pi
        total = 0.0
        for j in range(n):
            up, down = images[1 + j, a] - images[0, a], images[1 + n + j, a] - images[0, a]
            if angular[a]:
                up, down = wrapped(up), wrapped(down)
                farthest = max(farthest, abs(up), abs(down))
            B[j, a] = 0.5 * (up - down) / np.sqrt(n)
            even[j, a] = 0.5 * (up + down)
            total += even[j, a]
        shift = total / n
        for j in range(n):
            even[j, a] -= shift
        predicted[a] = images[0, a] + shift
        e[a] = y[a] - predicted[a]
        if angular[a]:
            e[a] = wrapped(e[a])
        if not np.isfinite(predicted[a]):
            return IMAGES_ERROR
        if not np.isfinite(e[a]):
            return MEASUREMENT_ERROR
    for a in range(m):
        for b in range(a, m):
            odd, rest = 0.0, 0.0
            for j in range(n):
                odd += B[j, a] * B[j, b]
                rest += even[j, a] * even[j, b]
            N[a, b] = rest / n + 0.5 * (R[a, b] + R[b, a])
            S[a, b] = odd + N[a, b]
            N[b, a], S[b, a] = N[a, b], S[a, b]
            if not np.isfinite(N[a, b]):
                return R_NOT_FINITE_ERROR
    return OK if farthest <= MAX_ANGLE_SPREAD else ANGLE_ERROR


class Settings(NamedTuple):
    """Settings that distinguish the filters.

    Attributes
    ----------
    kind
        Kind of layer (FIXED_LAYER_TYPE to ADAPTIVE_LAYER_TYPE).
    scale
        Width of the layer in standard deviations of R; of a switched or adaptive layer, of the innovation.
    gamma
        Convergence rate.
    patience
        Number of updates that an exceedance must last.
    weighted
        Whether the right inverse is weighted by the covariance.
    fading
        Share of the newest update in the mean of sat(e/layer).
    """

    kind: int
    scale: float
    gamma: float
    patience: int = 1
    weighted: bool = True
    fading: float = 0.0


class LayerMemory(NamedTuple):
    """Memory of earlier updates, (m,) each, as in `variable_structure.State`; all but the residual is updated."""

    residual: Array
    updates_outside: Array
    switching: Array
    slow_switching: Array


class SwitchingSteps(NamedTuple):
    """Outputs of `decide_into`, (m,) each: the layer, whether it is left, the switching step, and its gain."""

    layer: Array
    outside: Array
    s: Array
    ratio: Array


@kernel(**MAKING)
def decide_into(settings, memory, e, B, S, R, limit, steps):
    """Decide for each component its layer, whether and for how long it is outside, and its switching step s.

    `limit` (m,) is the layer's width, or (0,) for `scale` standard deviations of R. Eq 2.3.3 multiplies by e after
    dividing by e, 0/0 where e = 0: here s = (|e| + gamma |residual|) sat(e/psi) directly. The covariance treats it
    as a gain, A / max(|e|, psi), kept below 1 + gamma: if e is far smaller than the last residual, the step is a
    push of bounded size, not a large gain.
    """
    kind, scale, gamma, _, _, _ = settings
    residual, updates_outside, _, _ = memory
    layer, outside, s, ratio = steps
    for a in range(e.shape[0]):
        size = np.abs(e[a])
        A = size + gamma * np.abs(residual[a])
        psi = 0.0
        if kind >= SWITCHED_LAYER_TYPE:
            layer[a] = scale * np.sqrt(S[a, a])
            outside[a] = layer[a] < A
        else:
            psi = limit[a] if limit.shape[0] > 0 else scale * np.sqrt(R[a, a])
            layer[a] = psi
            outside[a] = size > psi
        if kind == VARIABLE_LAYER_TYPE:
            known = 0.0
            for j in range(B.shape[0]):
                known += B[j, a] * B[j, a]
            optimal = S[a, a] / known * A
            outside[a] = not optimal <= psi
            layer[a] = min(psi, optimal) if known > 0 else psi
        updates_outside[a] = updates_outside[a] + 1 if outside[a] else 0
        width = max(size, psi)
        s[a] = A * e[a] / width if width > 0 else 0
        ratio[a] = min(A / width, 1 + gamma) if width > 0 else 1


@kernel(**MAKING)
def find_bias_into(e, S, scale, fading, deviations, switching, extra):
    """Update the fading mean of sat(e/psi), psi = scale sqrt(S_aa), in `switching`, and fill its variance into
    `extra`.

    The variance explains the mean; it is zero where white innovations would explain it. Returns True if any
    variance is not zero. In sliding mode the mean of the switching term is the model's error (Utkin's equivalent
    control). For white e the mean of sat(e/psi) has the variance fading / (2 - fading) / scale^2; `deviations` of
    its square root are allowed.
    """
    limit = deviations / scale * np.sqrt(fading / (2 - fading))
    found = False
    for a in range(e.shape[0]):
        psi = scale * np.sqrt(S[a, a])
        sat = min(max(e[a] / psi, -1.0), 1.0)
        switching[a] = (1 - fading) * switching[a] + fading * sat
        extra[a] = (switching[a] * psi) ** 2 if np.abs(switching[a]) > limit else 0
        found = found or extra[a] > 0
    return found


@kernel(**MAKING)
def model_error_into(L_t, B, extra, extra_slow, model_error):
    """Fill G D G^T (n, n) with G the weighted right inverse and D some of the variances `extra_slow` (m,).

    They are those of quantities whose variance in `extra` is zero.
    """
    G_t = right_inverse(L_t, B, True)
    DG_t = np.zeros_like(G_t)
    for a in range(G_t.shape[0]):
        if extra[a] == 0:
            for i in range(G_t.shape[1]):
                DG_t[a, i] = extra_slow[a] * G_t[a, i]
    add_transposed_product_into(DG_t, G_t, model_error)


@kernel(**MAKING)
def fits(n, images, y, R, memory, limit):
    """Return whether the arrays of one filter's update fit each other."""
    m = y.shape[0]
    for size in memory:
        if size != m:
            return False
    return (
        m > 0
        and images.shape == (2 * n + 1, m)
        and R.shape == (m, m)
        and (limit.shape[0] == m or limit.shape[0] == 0)
    )


@kernel(**MAKING)
def update_into(mean, P, images, y, R, limit, angular, settings, memory, out):
    """Update one filter into `out`; return (status, NIS)."""
    mean_out, P_out, e, S, predicted, layer, smoothing, outside, rejected, model_error = out
    kind, scale, _, patience, weighted, fading = settings
    residual, updates_outside, switching, slow_switching = memory
    n, m = mean.shape[0], y.shape[0]
    sizes = (residual.shape[0], updates_outside.shape[0], switching.shape[0], slow_switching.shape[0])
    if not fits(n, images, y, R, sizes, limit):
        return SHAPE_ERROR, 0.0
    L_t, B, N = np.empty((n, n)), np.empty((n, m)), np.empty((m, m))
    if not root_into(P, L_t):
        return COVARIANCE_ERROR, 0.0
    status = linearise_into(images, y, R, angular, predicted, e, B, N, S)
    if status != OK:
        return status, 0.0
    white, lower_t = np.empty((m, 1)), np.empty((m, m))
    if not is_noise(R, lower_t):
        return R_INDEFINITE_ERROR, 0.0
    if not factor_into(S, lower_t):
        return INNOVATION_ERROR, 0.0
    white[:, 0] = e
    solve_into(lower_t, white)
    s, ratio, switched = np.empty(m), np.empty(m), np.empty(m, np.bool_)
    wider = S
    if kind == ADAPTIVE_LAYER_TYPE:
        extra, extra_slow = np.empty(m), np.empty(m)
        found = find_bias_into(e, S, scale, fading, scale, switching, extra)
        if find_bias_into(e, S, scale, fading / SLOW_MEAN_FACTOR, SLOW_MEAN_SIGMAS, slow_switching, extra_slow):
            model_error_into(L_t, B, extra, extra_slow, model_error)
        if found:
            wider = np.empty((m, m))  # S and NIS stay the prior's: e must not widen its own reference
            if not widen_into(L_t, B, N, extra, wider):
                return COVARIANCE_ERROR, 0.0
    decide_into(settings, memory, e, B, wider, R, limit, SwitchingSteps(layer, outside, s, ratio))
    nis = 0.0
    for a in range(m):
        nis += e[a] * white[a, 0]
        rejected[a] = kind >= SWITCHED_LAYER_TYPE and outside[a] and updates_outside[a] < patience
        switched[a] = kind == FIXED_LAYER_TYPE or (outside[a] and not rejected[a])
        smoothing[a] = min(INFINITE_RATIO, S[a, a] / (S[a, a] - N[a, a])) if S[a, a] > N[a, a] else INFINITE_RATIO
    K_t, step, exists = mixed_gain(L_t, B, wider, e, s, ratio, switched, outside, weighted)
    if not exists:
        return INNOVATION_ERROR, 0.0
    for i in range(n):
        mean_out[i] = mean[i] + step[i]
    joseph_into(L_t, B, N, K_t, P_out)
    return OK, nis


ARRAYS: Final = (2, 3, 3, 2, 3, 2, 2, 2, 2, 2, FLAGS)


@kernel(signature(*ARRAYS, record(Settings, INT, FLOAT, FLOAT, INT, BOOL, FLOAT)), **MAKING)
def update_batch(
    mean, P, images, y, R, residual, updates_outside, switching, slow_switching, limit, angular, settings
):
    """Update a batch: mean (B, n), P (B, n, n), images (B, 2n+1, m), y (B, m), R (B or 1, m, m).

    residual, updates_outside, switching and slow_switching are (B, m); limits (B or 1, m), or (1, 0) for `scale`
    standard deviations of R. Returns (mean, covariance, innovation, S, predicted, layer, S_ii / (H P H^T)_ii,
    outside, rejected, model_error, updates_outside, switching, slow_switching, NIS, status).
    """
    count, n = mean.shape
    m = y.shape[1]
    out = (
        np.empty((count, n)),
        np.empty((count, n, n)),
        np.empty((count, m)),
        np.empty((count, m, m)),
        np.empty((count, m)),
        np.empty((count, m)),
        np.empty((count, m)),
        np.empty((count, m), np.bool_),
        np.empty((count, m), np.bool_),
        np.zeros((count, n, n)),
    )
    updates_outside, switching, slow_switching = updates_outside.copy(), switching.copy(), slow_switching.copy()
    nis, status = np.empty(count), OK
    sizes = (residual.shape[0], updates_outside.shape[0], switching.shape[0], slow_switching.shape[0])
    for size in (P.shape[0], images.shape[0], y.shape[0], *sizes):
        if size != count:
            status = SHAPE_ERROR
    for size in (R.shape[0], limit.shape[0]):
        if size not in (1, count):
            status = SHAPE_ERROR
    for b in range(count):
        if status == OK:
            rows = (
                out[0][b], out[1][b], out[2][b], out[3][b], out[4][b], out[5][b], out[6][b], out[7][b], out[8][b],
                out[9][b],
            )  # fmt: skip
            memory = LayerMemory(residual[b], updates_outside[b], switching[b], slow_switching[b])
            noise, width = R[b % R.shape[0]], limit[b % limit.shape[0]]
            status, nis[b] = update_into(
                mean[b], P[b], images[b], y[b], noise, width, angular, settings, memory, rows
            )
            if status != OK:
                status += MEMBER_FACTOR * b
    return (*out, updates_outside, switching, slow_switching, nis, status)
