"""The wing-line filter's modes: their parameters, process noise and transition probabilities."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.settings import ManoeuvreModel
from onboard.models import leader_flight as flight
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, ModeParameters
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V


class Extras(NamedTuple):
    """What the filter estimates or measures beyond the leader's flight. Standard deviations at the start; with 0
    the delay or the bias is no state."""

    delay: float = 0.0  # s, of the camera's stamps
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad about the camera's axes: our attitude, and the mount
    bias_time: float = 60.0  # s, correlation time of the bias
    own_velocity: float = 0.0  # m/s, error of our own velocity; never a state
    middle: bool = False  # whether the wing's middle is measured (`models.wing_line`)

    @property
    def states(self) -> int:
        """How many states there are."""
        return flight.BASE + (self.delay > 0) + 3 * self.biased

    @property
    def biased(self) -> bool:
        """Whether the attitude's error is estimated."""
        return min(self.bias) > 0


HOVER_RANDOM_WALK: Final = 0.01  # m/s^2 / sqrt(s), of the accelerations while hovering
DELAY_RANDOM_WALK: Final = 0.001  # s / sqrt(s): clocks and exposures drift
SMALL: Final = 0.05  # argument of an exponential for which eight terms of its series are enough


def can_hover(model: ManoeuvreModel, extras: Extras) -> bool:
    """Whether there are modes for hovering: the leader may hover, and the image shows whether its nose turns."""
    return model.hovers_for > 0 and extras.middle


def mode_parameters(model: ManoeuvreModel, extras: Extras) -> tuple[ModeParameters, ...]:
    """Of each mode: steady speed, accelerating; if it can hover also hovering with the nose still, turning right
    and turning left."""
    steady = ModeParameters(
        model.hover_speed, model.steady_time, model.heading_time, model.bank_time, extras.bias_time
    )
    accelerating = steady._replace(along_time=model.accelerating_time)
    if not can_hover(model, extras):
        return steady, accelerating
    hovering = steady._replace(hover_time=model.hover_time)
    right, left = (hovering._replace(nose_rate=rate) for rate in (model.nose_rate, -model.nose_rate))
    return steady, accelerating, hovering, right, left


def process_noise(model: ManoeuvreModel, extras: Extras, size: float, dt: float) -> tuple[Array, ...]:
    """Q (n, n) of a step of `dt` seconds, in each mode. `size` (m) scales the size's random walk."""
    q = np.zeros(extras.states)
    q[R], q[V] = model.position_random_walk**2 * dt, model.velocity_random_walk**2 * dt
    q[SIZE] = (model.size_random_walk * size) ** 2 * dt
    q[A_LAT], q[A_LONG] = model.a_lat_random_walk**2 * dt, model.a_long_random_walk**2 * dt
    q[HEADING] = _gauss_markov(model.heading, model.heading_time, dt)
    q[BANK_ERROR] = _gauss_markov(model.bank, model.bank_time, dt)
    if extras.delay > 0:
        q[flight.BASE] = DELAY_RANDOM_WALK**2 * dt
    if extras.biased:
        q[-3:] = [_gauss_markov(sigma, extras.bias_time, dt) for sigma in extras.bias]
    steady, accelerating = np.diag(q), np.diag(q)
    steady[A_ALONG, A_ALONG] = _gauss_markov(model.steady, model.steady_time, dt)
    accelerating[A_ALONG, A_ALONG] = _gauss_markov(model.accelerating, model.accelerating_time, dt)
    if not can_hover(model, extras):
        return steady, accelerating
    hovering = steady.copy()
    for at in range(V.start, V.stop):
        hovering[at, at] = _gauss_markov(float(np.hypot(model.hover, extras.own_velocity)), model.hover_time, dt)
    hovering[A_LAT, A_LAT] = hovering[A_LONG, A_LONG] = HOVER_RANDOM_WALK**2 * dt
    turning = hovering.copy()
    turning[HEADING, HEADING] += model.nose_random_walk**2 * dt
    return steady, accelerating, hovering, turning, turning


def transition_probabilities(model: ManoeuvreModel, extras: Extras, dt: float) -> Array:
    """Probabilities (r, r) of changing from one mode (row) to another within `dt` seconds: a Markov chain in
    continuous time. A hovering leader flies on as often steady as accelerating; to turn its nose it must hover."""
    accelerate, settle = 1.0 / model.steady_for, 1.0 / model.accelerating_for
    rates = np.array([[0.0, accelerate], [settle, 0.0]])
    if can_hover(model, extras):
        stop, go = 1.0 / model.flies_for, 1.0 / model.hovers_for
        turn, end = 0.5 / model.straight_for, 1.0 / model.turns_for
        rates = np.array(
            [
                [0.0, accelerate, stop, 0.0, 0.0],
                [settle, 0.0, stop, 0.0, 0.0],
                [0.5 * go, 0.5 * go, 0.0, turn, turn],
                [0.0, go, end, 0.0, 0.0],
                [0.0, go, end, 0.0, 0.0],
            ]
        )
    return _exponential((rates - np.diag(rates.sum(axis=1))) * dt)


def _exponential(x: Array) -> Array:
    """exp(x) of a small matrix (r, r), by its series, scaling and squaring. Time steps come in all lengths, so
    this is computed in flight, and SciPy's function takes longer than the filter's step."""
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(x).max()), 1e-9) / SMALL)))
    x = x / 2.0**halvings
    one = np.eye(len(x))
    result = one
    for k in range(8, 0, -1):  # the ninth term is below 1e-15
        result = one + x @ result / k
    for _ in range(halvings):
        result = result @ result
    return result


def _gauss_markov(sigma: float, time: float, dt: float) -> float:
    """Variance that a Gauss-Markov process of stationary sigma and correlation `time` gains in `dt` seconds."""
    return -(sigma**2) * float(np.expm1(-2.0 * dt / time))
