"""Where the leader may be when its nose may point anywhere: a mixture of Gaussians over noses and manoeuvres.

One image leaves the nose open, and with it the range. A new mixture has a Gaussian for each cell of the nose over
half a circle, in the coordinates of `models.apparent_wing`: a wing looks the same from the front and from behind.
Within a cell there is a Gaussian for each manoeuvre, and these mix (an interacting multiple model). A cell loses
weight only by evidence. A cell whose nose becomes uncertain is split, and cells that agree are merged.

Smoothness is no evidence. A near leader that flies calmly and a far one that flies twice as boldly look alike, and
how boldly a leader flies is not known. So process noise is proportional to the range that a cell implies, and no
cell fits smooth motion better than another. Evidence is our own known motion, and a line of sight that turns while
the nose does not.
"""

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filter import Measurement
from onboard.estimators.leader.nose_cells import Mixture, tidy
from onboard.estimators.leader.settings import NoseModel
from onboard.filters.belief import FilterError
from onboard.models import apparent_wing as model
from onboard.models.apparent_wing import (
    BANK_ERROR,
    DIRECTION,
    LOG_LENGTH,
    LOG_SIZE,
    MISALIGNMENT,
    NOSE,
    NOSE_RATE,
    OWN_VELOCITY,
    A,
    Decay,
    N,
    V,
)

SPREAD: Final = math.sqrt(3.0)  # standard deviations, of the points of a central difference: exact for a cubic
LEAST_WEIGHT: Final = 1e-4  # of a cell: a lighter one is dropped
LEAST_MANOEUVRE: Final = 1e-4  # of the probability of a manoeuvre within a cell
MOST_EVIDENCE: Final = 40.0  # of the logarithm of a likelihood ratio, by one image
MOVING: Final = 3.0  # m/s: if we fly faster, a leader that flies along with us is likely
HORIZONTAL: Final = np.array([1.0, 1.0, 0.5])  # vertical accelerations are half as large
DIAGONAL: Final = np.arange(N)


def start(settings: NoseModel, seen: Measurement, pose: CameraPose) -> Mixture:
    """The mixture after one image."""
    direction = seen.axes[0] @ pose.R_cn
    axes = model.axes_about(direction)
    bearing = math.atan2(direction[1], direction[0])
    noses, nose_sigma, prior = _first_noses(settings, bearing, pose.v_F_n)
    broad = np.maximum(
        np.abs(np.cos(noses - bearing)), 0.08
    )  # about the range, as a share of the largest possible
    k = len(noses)
    mean, sigma = np.zeros((k, N)), np.zeros((k, N))
    mean[:, LOG_LENGTH], mean[:, LOG_SIZE] = math.log(seen.span), math.log(settings.size)
    mean[:, V], mean[:, NOSE] = pose.v_F_n, noses
    sigma[:, DIRECTION] = math.sqrt(seen.R[0, 0])
    sigma[:, LOG_LENGTH] = max(seen.span_sigma / seen.span, 0.01)
    sigma[:, V] = broad[:, None] * settings.speed * np.array([1.0, 1.0, 0.4])
    sigma[:, LOG_SIZE] = settings.size_sigma / settings.size
    sigma[:, A] = broad[:, None] * settings.acceleration * HORIZONTAL
    sigma[:, NOSE], sigma[:, NOSE_RATE] = nose_sigma, settings.first_nose_rate * broad
    sigma[:, BANK_ERROR] = 2.0 * settings.bank * broad
    sigma[:, MISALIGNMENT], sigma[:, OWN_VELOCITY] = settings.misalignment, settings.own_velocity
    P = np.zeros((k, N, N))
    P[:, DIAGONAL, DIAGONAL] = sigma**2
    # the direction was measured by the attitude that we believe
    J = -np.cross(np.eye(3), direction) @ axes[1:].T
    W = np.diag(np.square(settings.misalignment))
    P[:, DIRECTION, MISALIGNMENT], P[:, MISALIGNMENT, DIRECTION] = J.T @ W, W @ J
    P[:, DIRECTION, DIRECTION] += J.T @ W @ J
    count = len(settings.lasts)
    likely = np.array([0.7, *[0.3 / (count - 1)] * (count - 1)])
    from_camera = Mixture(
        np.repeat(mean[:, None], count, 1),
        np.repeat(P[:, None], count, 1),
        np.tile(likely, (k, 1)),
        np.log(prior),
        axes,
    )
    return predict(settings, from_camera, 0.0, -pose.r_FC_n)  # from the camera's place to F: no time passes


def _first_noses(settings: NoseModel, bearing: float, v_F_n: Array) -> tuple[Any, Any, Any]:
    """Noses (k,), their standard deviations and prior probabilities: all noses alike, and one along our own course
    that is more likely; for a fixed wing only noses about our course."""
    course, moving = math.atan2(v_F_n[1], v_F_n[0]), math.hypot(v_F_n[0], v_F_n[1]) > MOVING
    if moving and settings.crab > 0:
        apart = 1.2 * np.arange(-2, 3)  # standard deviations of the crab
        prior = np.exp(-0.5 * apart**2)
        return course + apart * settings.crab, np.full(5, 0.55 * settings.crab), prior / prior.sum()
    width = math.pi / settings.cells
    noses, sigma = bearing + np.arange(settings.cells) * width, np.full(settings.cells, width / math.sqrt(3.0))
    prior = np.full(settings.cells, 1.0 / settings.cells)
    if moving:
        noses, sigma = np.append(noses, course), np.append(sigma, settings.heading)
        prior = np.append(prior * (1.0 - settings.on_course), settings.on_course)
    return noses, sigma, prior


def predict(settings: NoseModel, mixture: Mixture, dt: float, moved: Array) -> Mixture:
    """The mixture after `dt` seconds in which we move by `moved` (3,) m, in n. Raises FilterError."""
    mean, P, after = _mixed(settings, mixture, dt)
    cells, count, _ = mean.shape
    best = int(np.argmax(mixture.log_weights))
    r = model.positions(mean[best, :1], mixture.axes)[0] + dt * mean[best, 0, V] - moved
    new_axes = model.axes_about(r / np.linalg.norm(r))
    broad = model.visible(mean.reshape(-1, N), mixture.axes).reshape(cells, count)
    rows = _points(mean, P)[1]
    times = np.array(settings.nose_rate_time)
    decay = Decay(
        math.exp(-dt / settings.acceleration_time),
        math.exp(-dt / settings.bank_time),
        math.exp(-dt / settings.misalignment_time),
        math.exp(-dt / settings.own_velocity_time),
        np.tile(np.repeat(np.exp(-dt / times), rows.shape[2]), cells),
    )
    images = model.process(rows.reshape(-1, N), dt, moved, mixture.axes, new_axes, decay)
    mean, D = _differences(images.reshape(rows.shape))
    P = np.swapaxes(D, -1, -2) @ D
    P[..., DIAGONAL, DIAGONAL] += _process_noise(settings, broad, dt)
    return Mixture(mean, P, after, mixture.log_weights, new_axes)


def _mixed(settings: NoseModel, mixture: Mixture, dt: float) -> tuple[Array, Array, Array]:
    """Means, covariances and probabilities of the manoeuvres, mixed within each cell by who may follow whom."""
    count = len(settings.lasts)
    stay = np.exp(-dt / np.array(settings.lasts))
    passing = np.where(np.eye(count, dtype=bool), stay[:, None], ((1.0 - stay) / (count - 1))[:, None])
    after = mixture.manoeuvres @ passing
    share = mixture.manoeuvres[:, :, None] * passing / after[:, None, :]
    back = np.swapaxes(share, 1, 2)
    mean = back @ mixture.means
    off = mixture.means[:, :, None] - mean[:, None]
    P = (back @ mixture.covariances.reshape(*share.shape[:2], N * N)).reshape(mixture.covariances.shape)
    return mean, P + (off * share[..., None]).transpose(0, 2, 3, 1) @ off.transpose(0, 2, 1, 3), after


def _process_noise(settings: NoseModel, broad: Array, dt: float) -> Array:
    """Variances (K, M, N) of a step. `broad` (K, M) is proportional to the range that a belief implies."""
    s, times = settings, np.array(settings.nose_rate_time)
    q = np.zeros((*broad.shape, N))
    q[..., DIRECTION], q[..., LOG_LENGTH] = 1e-9, 1e-7  # so that no covariance becomes singular
    q[..., V] = ((broad * s.velocity_random_walk) ** 2 * dt)[..., None]
    q[..., A] = ((broad * np.array(s.acceleration_random_walk)) ** 2 * dt)[..., None] * HORIZONTAL**2
    steep = np.sqrt(np.maximum(1.0 - broad**2, 0.0)) / broad  # of the logarithm of the range, by the nose
    q[..., NOSE] = (np.array(s.nose_random_walk) / np.maximum(1.0, steep)) ** 2 * dt
    q[..., NOSE_RATE] = np.square(s.nose_rate) * -np.expm1(-2.0 * dt / times)
    q[..., BANK_ERROR] = (broad * s.bank) ** 2 * -math.expm1(-2.0 * dt / s.bank_time)
    q[..., MISALIGNMENT] = np.square(s.misalignment) * -math.expm1(-2.0 * dt / s.misalignment_time)
    q[..., OWN_VELOCITY] = s.own_velocity**2 * -math.expm1(-2.0 * dt / s.own_velocity_time)
    return q


def update(settings: NoseModel, mixture: Mixture, seen: Measurement, pose: CameraPose) -> tuple[Mixture, float]:
    """The mixture after an image, and the smallest NIS of its Gaussians. If that exceeds the gate, no Gaussian
    expected the image, and the mixture is returned as it was. Raises FilterError."""
    y, m = seen.y, len(seen.y)
    L, rows = _points(mixture.means, mixture.covariances)
    arguments = mixture.axes, pose.R_cn, pose.r_FC_n, seen.axes, m
    images = model.measure(rows.reshape(-1, N), *arguments).reshape(*rows.shape[:3], m)
    predicted, D = _differences(images)
    C = L @ D[..., :N, :]
    S = np.swapaxes(D, -1, -2) @ D + seen.R
    e = y - predicted
    exchanged = images[..., 0, 2] * y[2] + images[..., 0, 3] * y[3] < 0  # detectors name tips by their side
    e[exchanged, 2:4] = -y[2:4] - predicted[exchanged, 2:4]
    nis = np.sum(e * np.linalg.solve(S, e[..., None])[..., 0], -1)
    least = float(nis.min())
    if not least <= settings.gate:
        return mixture, least
    gain = np.swapaxes(np.linalg.solve(S, np.swapaxes(C, -1, -2)), -1, -2)
    gain[..., LOG_SIZE, :] = 0.0  # the size is considered: its uncertainty is carried, images do not move it
    means = mixture.means + (gain @ e[..., None])[..., 0]
    KC = gain @ np.swapaxes(C, -1, -2)
    P = mixture.covariances - KC - np.swapaxes(KC, -1, -2) + gain @ S @ np.swapaxes(gain, -1, -2)
    log_l = -0.5 * (nis + np.linalg.slogdet(S)[1])
    manoeuvres, log_weights = _weighed(mixture, np.maximum(log_l, log_l.max() - MOST_EVIDENCE))
    kept = log_weights > math.log(LEAST_WEIGHT)
    P = 0.5 * (P + np.swapaxes(P, -1, -2))
    return tidy(settings, Mixture(means[kept], P[kept], manoeuvres[kept], log_weights[kept], mixture.axes)), least


def _weighed(mixture: Mixture, log_l: Array) -> tuple[Array, Array]:
    """Probabilities of the manoeuvres (K, M), and logarithms of the weights (K,), after an image."""
    each = np.log(mixture.manoeuvres) + log_l
    top = each.max(1, keepdims=True)
    p = np.exp(each - top)
    total = p.sum(1, keepdims=True)
    log_weights = mixture.log_weights + (top + np.log(total))[:, 0]
    log_weights -= log_weights.max()
    p = np.maximum(p / total, LEAST_MANOEUVRE)
    return p / p.sum(1, keepdims=True), log_weights - math.log(np.exp(log_weights).sum())


def with_course(settings: NoseModel, mixture: Mixture) -> tuple[Array, Array, Array]:
    """Weights (G,), means (G, N) and covariances (G, N, N) of all Gaussians, with what is likely of a nose and its
    course: most leaders that fly fast point their nose along their course.

    That is prior knowledge about an angle that lasts. It is applied to what is reported and not to the mixture
    itself, where each image would count it again.
    """
    w = (np.exp(mixture.log_weights)[:, None] * mixture.manoeuvres).ravel()
    x, P = mixture.means.reshape(-1, N), mixture.covariances.reshape(-1, N, N)
    u, v = x[:, 3], x[:, 4]
    speed2 = u * u + v * v + 1e-6
    aside = x[:, NOSE] - np.arctan2(v, u)
    aside -= math.pi * np.round(aside / math.pi)
    h = np.zeros_like(x)
    h[:, NOSE], h[:, 3], h[:, 4] = 1.0, v / speed2, -u / speed2
    Ph = (P @ h[..., None])[..., 0]
    S = np.sum(h * Ph, 1) + settings.nose_about_course**2
    gain = Ph / S[:, None]
    fast = speed2**2 / (speed2**2 + model.FOLLOWS4)
    share = settings.follows * fast
    likely = np.exp(-0.5 * aside**2 / S) / np.sqrt(2.0 * math.pi * S)
    w = np.concatenate([w * (1.0 - share) / math.pi, w * share * likely])
    means = np.concatenate([x, x - gain * aside[:, None]])
    covariances = np.concatenate([P, P - gain[:, :, None] * Ph[:, None, :]])
    kept = w > LEAST_WEIGHT * w.sum()
    return w[kept] / w[kept].sum(), means[kept], covariances[kept]


def mapped(means: Array, covariances: Array, function: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Means (G, m), and D (G, 2 N, m) with D^T D the covariances, of a function of state rows, for each Gaussian.
    Raises FilterError."""
    rows = _points(means, covariances)[1]
    images = function(rows.reshape(-1, N))
    return _differences(images.reshape(*rows.shape[:2], images.shape[1]))


def _points(mean: Array, P: Array) -> tuple[Array, Array]:
    """Factors L (..., N, N), and the points (..., 2 N + 1, N) of central differences."""
    try:
        L = np.asarray(np.linalg.cholesky(P), np.float64)
    except np.linalg.LinAlgError as error:
        raise FilterError("the nose mixture has lost a covariance") from error
    steps, x = SPREAD * np.swapaxes(L, -1, -2), mean[..., None, :]
    return L, np.concatenate([x, x + steps, x - steps], -2)


def _differences(images: Array) -> tuple[Array, Array]:
    """Mean (..., m), and D (..., 2 N, m) with D^T D the covariance, of a function of the points: of second order.

    Central differences after Norgaard, Poulsen and Ravn (2000): the covariance is positive semidefinite whatever
    the number of states, which sigma points with a negative weight do not grant.
    """
    center, up, down = images[..., :1, :], images[..., 1 : N + 1, :], images[..., N + 1 :, :]
    even: Array = (up + down - 2.0 * center) / (2.0 * SPREAD**2)
    odd: Array = (up - down) / (2.0 * SPREAD)
    mean: Array = np.asarray(center[..., 0, :] + even.sum(-2))
    return mean, np.concatenate([odd, even * math.sqrt(SPREAD**2 - 1.0)], -2)
