"""The filter we fly by default: the leader's wing is a line in the image, and aircraft bank to turn.

Differences from Oh & Johnson's filter:
- The wing's foreshortening follows from the leader's heading; theirs takes it for distance.
- The wing's slope shows the bank, and so the turn.
- The acceleration along the track is a state, in two modes (an interacting multiple model): a steady leader is
  tracked closely, and one that changes its speed is not lost.
- The size is considered, not estimated.
- The delay of the camera and the error of our own attitude can be estimated.
- A multirotor may also hover, and turn its nose meanwhile, if the wing's middle is measured, which shows the nose.

Observability: the delay shows when the target moves in the image, mostly by our own manoeuvres, since our motion
is known. In steady flight a delay cannot be distinguished from a bearing offset. Nor can the attitude's error be
distinguished from a real offset of the leader without motion: mostly its variance is carried into the position,
and little reduced.

All arrays have a leading axis B of targets or runs, so that a study flies the same code as the daemon.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.filters import modes as compiled
from onboard.estimators.leader.filters import wing_line_noise as noise
from onboard.estimators.leader.filters.modes import Modes, Step
from onboard.estimators.leader.filters.wing_line_noise import Extras
from onboard.estimators.leader.settings import FIXED_WING, ManoeuvreModel
from onboard.filters.belief import Belief, Update, Weights
from onboard.filters.gating import chi_square_threshold
from onboard.filters.unscented_transform import julier_weights, recombine, sigma_points
from onboard.models import leader_flight as flight
from onboard.models import wing_line
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, ImageGeometry
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V

INITIAL_BANK: Final = np.radians(10.0)  # rad, 1 sigma about level, of the wing in the first image
MOVING: Final = 3.0  # m/s: above it the leader's first heading is our own course, below it our line of sight
LIKELY_MANOEUVRE: Final = 0.1  # initial probability of all modes but the steady one
LEAST_ACROSS: Final = 0.1  # of the wing's length: an edge-on wing says nothing of the range
NO_EXTRAS: Final = Extras()


@dataclass(frozen=True, eq=False)  # a key of caches: compared by identity, not by content
class Filter:
    """The filter's settings: the leader's `size` (m) and its sigma, how the leader flies, what else is a state."""

    size: float
    size_sigma: float
    model: ManoeuvreModel = FIXED_WING
    extras: Extras = NO_EXTRAS

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the states."""
        delay = flight.DELAY_COMPONENTS if self.extras.delay > 0 else ()
        return flight.COMPONENTS + delay + (flight.BIAS_COMPONENTS if self.extras.biased else ())

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        delay = ("s",) if self.extras.delay > 0 else ()
        return flight.UNITS + delay + (("rad",) * 3 if self.extras.biased else ())

    @property
    def gate(self) -> float:
        """NIS above which an image is not fused."""
        return chi_square_threshold(self.model.gate_probability, self.m)

    @property
    def m(self) -> int:
        """The size of a measurement."""
        return wing_line.M_MIDDLE if self.extras.middle else wing_line.M


@lru_cache(maxsize=64)
def _step(filter_: Filter, dt_us: int) -> Step:
    """A step of so many microseconds, cached: time steps are rounded to them, and most are alike."""
    dt = max(dt_us, 1) * 1e-6
    model, extras = filter_.model, filter_.extras
    noises = noise.process_noise(model, extras, filter_.size, dt)
    parameters = np.array(noise.mode_parameters(model, extras))
    step = Step(parameters, np.array(noises), noise.transition_probabilities(model, extras, dt))
    for array in step:
        array.flags.writeable = False  # cached, so shared
    return step


@lru_cache(maxsize=64)
def _weights(n: int) -> Weights:
    """Weights with none on the centre. The usual n + lambda = 3 would make it negative, and a wide prior after a
    long gap would lose its positive definite covariance."""
    return julier_weights(n, float(n))


def start(filter_: Filter, y: Array, R_y: Array, geometry: ImageGeometry, before: Belief | None = None) -> Modes:
    """The modes after one image of each of B targets: y (B, m), R_y (B, m, m). `before`, means (B, n) and
    covariances (B, n, n), are the beliefs of earlier tracks of the same targets: their motion is kept, their
    positions are not."""
    n = filter_.extras.states
    count = len(y)
    mean, P = np.zeros((count, n)), np.zeros((count, n, n))
    model, extras = filter_.model, filter_.extras
    for b in range(count):
        course = _likely_heading(geometry, b)
        first = _first_position(filter_, y[b], R_y[b], geometry, b, course)
        at = [0, 1, 2, SIZE, HEADING, *range(n - 3, n)] if extras.biased else [0, 1, 2, SIZE, HEADING]
        mean[b, at] = first.mean[: len(at)]
        P[np.ix_([b], at, at)] = first.covariance[: len(at), : len(at)]
    velocity = model.initial_velocity**2
    for i in range(V.start, V.stop):
        P[:, i, i] = velocity
    P[:, A_LAT, A_LAT] = P[:, A_LONG, A_LONG] = model.initial_acceleration**2
    P[:, A_ALONG, A_ALONG] = model.steady**2 + LIKELY_MANOEUVRE * model.accelerating**2
    P[:, BANK_ERROR, BANK_ERROR] = model.bank**2
    if extras.delay > 0:
        P[:, flight.BASE, flight.BASE] = extras.delay**2
        # the image shows where the leader was before the delay
        P[:, [0, 1, 2], [0, 1, 2]] += velocity * extras.delay**2
    if before is not None:
        _keep_motion(mean, P, before)
    r = len(noise.mode_parameters(model, extras))
    probabilities = np.full(r, LIKELY_MANOEUVRE / (r - 1))
    probabilities[0] = 1.0 - LIKELY_MANOEUVRE
    return compiled.start(mean, P, probabilities)


def _likely_heading(geometry: ImageGeometry, b: int) -> float:
    """Heading (rad) of a leader in its first image: our own course, or straight away from us."""
    direction = geometry.axes[b, 0] @ geometry.R_cn[b]
    v_F = geometry.v_F_n[b]
    along = v_F if np.hypot(v_F[0], v_F[1]) > MOVING else direction
    return float(np.arctan2(along[1], along[0]))


def _first_position(
    filter_: Filter, y: Array, R_y: Array, geometry: ImageGeometry, b: int, course: float
) -> Belief:
    """Mean (10,) and covariance (10, 10) of [r_FL_n (3), size, heading, bias (3), bank, span] from one image: an
    unscented transform of the measurement, size, heading, bank and bias."""
    extras = filter_.extras
    bias = np.array(extras.bias) if extras.biased else np.full(3, 1e-12)
    mean = np.array([0.0, 0.0, y[2], y[3], filter_.size, course, 0.0, 0.0, 0.0, 0.0])
    P = np.diag([0, 0, 0, 0, filter_.size_sigma, filter_.model.initial_heading, INITIAL_BANK, *bias]) ** 2
    P[:4, :4] = R_y[:4, :4]
    weights = julier_weights(len(mean), float(len(mean)))
    rows = sigma_points(Belief(mean, P), weights)
    quarter = 0.25 * (rows[:, :1] ** 2 + rows[:, 1:2] ** 2)
    axes = geometry.axes[b]
    direction_c = ((1.0 - quarter) * axes[0] + rows[:, :1] * axes[1] + rows[:, 1:2] * axes[2]) / (1.0 + quarter)
    direction_n = (direction_c + np.cross(rows[:, 7:], direction_c)) @ geometry.R_cn[b]
    heading, bank = rows[:, 5], rows[:, 6]
    wing = np.column_stack([-np.sin(heading) * np.cos(bank), np.cos(heading) * np.cos(bank), np.sin(bank)])
    along = np.sum(wing * direction_n, axis=1, keepdims=True)
    across = np.linalg.norm(wing - along * direction_n, axis=1)
    span = np.hypot(rows[:, 2], rows[:, 3])
    distance = rows[:, 4] * np.maximum(across, LEAST_ACROSS) / np.maximum(span, 1e-6)
    images = np.column_stack(
        [geometry.r_FC_n[b] + distance[:, None] * direction_n, rows[:, 4], heading, rows[:, 7:], bank, span]
    )
    return recombine(images, weights, np.zeros((10, 10)))


def _keep_motion(mean: Array, P: Array, before: Belief) -> None:
    """Take velocity, accelerations and heading from an earlier track where it knows them better; in place."""
    kept = [*range(V.start, V.stop), A_LAT, A_LONG, A_ALONG, HEADING, *range(flight.BASE, mean.shape[1])]
    for b in range(len(mean)):
        for i in kept:
            if before.covariance[b, i, i] < P[b, i, i]:
                mean[b, i] = before.mean[b, i]
                ratio = np.sqrt(before.covariance[b, i, i] / P[b, i, i])
                P[b, i, :] *= ratio
                P[b, :, i] *= ratio


def advance(filter_: Filter, modes: Modes, dt: float, v_F_n: Array, a_F_n: Array) -> Modes:
    """The modes after `dt` seconds in which the followers, at first at v_F_n (B, 3), accelerate by a_F_n (B, 3).

    Raises FilterError, NotPositiveDefiniteError.
    """
    step = _step(filter_, round(dt * 1e6))
    return compiled.predict(modes, step, dt, v_F_n, a_F_n, _weights(modes.means.shape[-1]))


def fuse(filter_: Filter, modes: Modes, y: Array, R_y: Array, geometry: ImageGeometry) -> Update:
    """The modes after an image of each target, y (B, m) and R_y (B, m, m). The caller compares the NIS with the
    gate.

    Raises FilterError, NotPositiveDefiniteError.
    """
    eps = filter_.model.hover_speed
    if filter_.extras.delay > 0:
        R_y = R_y + _delay_noise(modes, geometry, y.shape[-1])
    return compiled.update(modes, y, R_y, geometry, eps, _weights(modes.means.shape[-1]), (SIZE,))


def _delay_noise(modes: Modes, geometry: ImageGeometry, m: int) -> Array:
    """Variance (B, m, m) of the direction from the product of the delay's and the velocity's errors. No sigma
    point shows it: each strays from the mean in one of the two. Without it the filter soon becomes sure of a wrong
    delay."""
    mean, P = modes.means[:, 0], modes.covariances[:, 0]
    at = flight.BASE
    product = P[:, at, at, None, None] * P[:, V, V] + P[:, V, at, None] * P[:, None, at, V]
    to_angles = geometry.axes[:, 1:] @ geometry.R_cn / np.linalg.norm(mean[:, R], axis=1)[:, None, None]
    angles = to_angles @ product @ np.swapaxes(to_angles, 1, 2)
    variance = np.zeros((len(mean), m, m))
    places = (slice(0, 2), slice(4, 6))[: m // 3]  # the center, and the wing's middle
    for i in places:
        for j in places:
            variance[:, i, j] = angles
    return variance
