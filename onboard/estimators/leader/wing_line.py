"""The filter we fly by default: the leader's wing as a line in the image, and how aircraft turn.

Against Oh & Johnson's: the wing's foreshortening follows from the leader's heading instead of being taken for
distance; its slope shows the bank and so the turn; the acceleration along the track is a state, in two modes (an
interacting multiple model), so that a steady leader is tracked closely and one that changes its speed is not lost;
the size is considered, not estimated. The delay of the camera and the error of our own attitude can be estimated.
A multirotor, where the wing's middle shows its nose, may also hover, and turn its nose while it does.

Observability: the delay shows when what the camera sees moves, by our own manoeuvres above all, since our motion
is known; in steady flight it is told from a bearing offset by nothing. The attitude's error is told from a real
offset of the leader only by motion, too: its variance is carried into the position more than it is reduced.

Everything has a leading axis B of targets or runs, so that a study flies the same code as the daemon.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import modes as leader_modes
from onboard.estimators.leader import wing_line_noise as noise
from onboard.estimators.leader.modes import Modes, Step
from onboard.estimators.leader.wing_line_noise import Extras, Manner
from onboard.filters.belief import Belief, Update, Weights
from onboard.filters.gating import chi_square_threshold
from onboard.filters.unscented_transform import julier_weights, recombine, sigma_points
from onboard.models import leader_flight as flight
from onboard.models import wing_line
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, Sight
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V

START_BANK: Final = np.radians(10.0)  # rad, of the wing in the first image about level
MOVING: Final = 3.0  # m/s: faster, and we take our own course for the leader's at first, slower where we look
LIKELY_MANOEUVRE: Final = 0.1  # probability, at first, that the leader changes its speed, or its heading
LEAST_SEEN: Final = 0.1  # of the wing's length: an edge-on wing says nothing of the range
NO_EXTRAS: Final = Extras()


@dataclass(frozen=True, eq=False)  # itself a key of caches, found by what it is and not by what is in it
class Filter:
    """The filter's settings: `size` and `size_sigma` (m) of the leader."""

    size: float
    size_sigma: float
    manner: Manner = noise.FIXED_WING
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
        """NIS above which an image is not believed."""
        return chi_square_threshold(self.manner.gate_probability, self.m)

    @property
    def m(self) -> int:
        """How many numbers an image measures."""
        return wing_line.M_MIDDLE if self.extras.middle else wing_line.M


@lru_cache(maxsize=64)
def _step(filter_: Filter, dt_us: int) -> Step:
    """Of a step of so many microseconds, to which time steps are rounded here: most are alike."""
    dt = max(dt_us, 1) * 1e-6
    manner, extras = filter_.manner, filter_.extras
    noises = noise.process_noise(manner, extras, filter_.size, dt)
    step = Step(np.array(noise.habits(manner, extras)), np.array(noises), noise.passing(manner, extras, dt))
    for array in step:
        array.flags.writeable = False  # cached, so shared
    return step


@lru_cache(maxsize=64)
def _weights(n: int) -> Weights:
    """No weight on the centre: with n + lambda three, as usual, it would be negative, and a wide prior after a
    long gap then loses its covariance."""
    return julier_weights(n, float(n))


def start(filter_: Filter, y: Array, R_y: Array, sight: Sight, before: Belief | None = None) -> Modes:
    """The belief after one image of each of B targets: y (B, m), R_y (B, m, m). `before` is what was believed of
    targets seen earlier, (B, n): where they are is forgotten, how they fly is not."""
    n = filter_.extras.states
    count = len(y)
    mean, P = np.zeros((count, n)), np.zeros((count, n, n))
    manner, extras = filter_.manner, filter_.extras
    for b in range(count):
        course = _likely_heading(sight, b)
        place, spread = _first_place(filter_, y[b], R_y[b], sight, b, course)
        at = [0, 1, 2, SIZE, HEADING, *range(n - 3, n)] if extras.biased else [0, 1, 2, SIZE, HEADING]
        mean[b, at] = place[: len(at)]
        P[np.ix_([b], at, at)] = spread[: len(at), : len(at)]
    velocity = manner.initial_velocity**2
    for i in range(V.start, V.stop):
        P[:, i, i] = velocity
    P[:, A_LAT, A_LAT] = P[:, A_LONG, A_LONG] = manner.initial_acceleration**2
    P[:, A_ALONG, A_ALONG] = manner.keep**2 + LIKELY_MANOEUVRE * manner.push**2
    P[:, BANK_ERROR, BANK_ERROR] = manner.bank**2
    if extras.delay > 0:
        P[:, flight.BASE, flight.BASE] = extras.delay**2
        # where the leader was so long ago is seen, not where it is
        P[:, [0, 1, 2], [0, 1, 2]] += velocity * extras.delay**2
    if before is not None:
        _remember(mean, P, before)
    count = len(noise.habits(manner, extras))
    likely = np.full(count, LIKELY_MANOEUVRE / (count - 1))
    likely[0] = 1.0 - LIKELY_MANOEUVRE
    return leader_modes.start(mean, P, likely)


def _likely_heading(sight: Sight, b: int) -> float:
    """Of a leader seen for the first time: our own course, or away from us."""
    look = sight.axes[b, 0] @ sight.R_cn[b]
    ours = sight.v_F_n[b]
    towards = ours if np.hypot(ours[0], ours[1]) > MOVING else look
    return float(np.arctan2(towards[1], towards[0]))


def _first_place(
    filter_: Filter, y: Array, R_y: Array, sight: Sight, b: int, course: float
) -> tuple[Array, Array]:
    """Mean and covariance of [r_FL_n (3), size, heading, bias (3)], and more, from one image: an unscented
    transform of what was seen, the size, heading, bank and bias."""
    extras = filter_.extras
    bias = np.array(extras.bias) if extras.biased else np.full(3, 1e-12)
    mean = np.array([0.0, 0.0, y[2], y[3], filter_.size, course, 0.0, 0.0, 0.0, 0.0])
    P = np.diag([0, 0, 0, 0, filter_.size_sigma, filter_.manner.initial_heading, START_BANK, *bias]) ** 2
    P[:4, :4] = R_y[:4, :4]
    weights = julier_weights(len(mean), float(len(mean)))
    rows = sigma_points(Belief(mean, P), weights)
    quarter = 0.25 * (rows[:, :1] ** 2 + rows[:, 1:2] ** 2)
    axes = sight.axes[b]
    seen = ((1.0 - quarter) * axes[0] + rows[:, :1] * axes[1] + rows[:, 1:2] * axes[2]) / (1.0 + quarter)
    look = (seen + np.cross(rows[:, 7:], seen)) @ sight.R_cn[b]
    heading, bank = rows[:, 5], rows[:, 6]
    wing = np.column_stack([-np.sin(heading) * np.cos(bank), np.cos(heading) * np.cos(bank), np.sin(bank)])
    across = np.linalg.norm(wing - np.sum(wing * look, axis=1, keepdims=True) * look, axis=1)
    angle = np.hypot(rows[:, 2], rows[:, 3])
    distance = rows[:, 4] * np.maximum(across, LEAST_SEEN) / np.maximum(angle, 1e-6)
    images = np.column_stack(
        [sight.r_FC_n[b] + distance[:, None] * look, rows[:, 4], heading, rows[:, 7:], bank, angle]
    )
    joint = recombine(images, weights, np.zeros((10, 10)))
    return joint.mean, joint.covariance


def _remember(mean: Array, P: Array, before: Belief) -> None:
    """Velocity, accelerations and heading of an earlier track, as far as they are known better than at first."""
    kept = [*range(V.start, V.stop), A_LAT, A_LONG, A_ALONG, HEADING, *range(flight.BASE, mean.shape[1])]
    for b in range(len(mean)):
        for i in kept:
            if before.covariance[b, i, i] < P[b, i, i]:
                mean[b, i] = before.mean[b, i]
                P[b, i, :] *= np.sqrt(before.covariance[b, i, i] / P[b, i, i])
                P[b, :, i] *= np.sqrt(before.covariance[b, i, i] / P[b, i, i])


def advance(filter_: Filter, modes: Modes, dt: float, v_F_n: Array, a_F_n: Array) -> Modes:
    """After `dt` seconds in which the followers, at first at v_F_n (B, 3), accelerate by a_F_n (B, 3).

    Raises FilterError, NotPositiveDefiniteError.
    """
    step = _step(filter_, round(dt * 1e6))
    return leader_modes.predict(modes, step, dt, v_F_n, a_F_n, _weights(modes.means.shape[-1]))


def fuse(filter_: Filter, modes: Modes, y: Array, R_y: Array, sight: Sight) -> Update:
    """After an image of each, y (B, m) and R_y (B, m, m); whoever calls compares the NIS with the gate.

    Raises FilterError, NotPositiveDefiniteError.
    """
    eps = filter_.manner.hover_speed
    if filter_.extras.delay > 0:
        R_y = R_y + _unseen_product(modes, sight, y.shape[-1])
    return leader_modes.update(modes, y, R_y, sight, eps, _weights(modes.means.shape[-1]), (SIZE,))


def _unseen_product(modes: Modes, sight: Sight, m: int) -> Array:
    """Variance (B, m, m) of the direction by the delay times the velocity, as far as both are unknown: a sigma
    point strays from the mean in one of them at a time and does not see it. Left out, the filter is soon sure of
    a delay that is wrong."""
    mean, P = modes.means[:, 0], modes.covariances[:, 0]
    at = flight.BASE
    product = P[:, at, at, None, None] * P[:, V, V] + P[:, V, at, None] * P[:, None, at, V]
    to_angles = sight.axes[:, 1:] @ sight.R_cn / np.linalg.norm(mean[:, R], axis=1)[:, None, None]
    angles = to_angles @ product @ np.swapaxes(to_angles, 1, 2)
    variance = np.zeros((len(mean), m, m))
    places = (slice(0, 2), slice(4, 6))[: m // 3]  # the center, and the wing's middle
    for i in places:
        for j in places:
            variance[:, i, j] = angles
    return variance


def believed(modes: Modes) -> Belief:
    """Mean (B, n) and covariance (B, n, n)."""
    return leader_modes.believed(modes)
