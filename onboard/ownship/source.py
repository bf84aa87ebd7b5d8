"""The source of our own motion: the autopilot, or an estimator of our own state.

Attitude is one quantity, velocity with position another; each has a source of its own. The estimator is used where
it is valid and, with `auto`, surer than the autopilot, whose white noise is measured (`scatter`). Biases of either
cannot be measured here, and are configured. A change of source takes `RAMP_S`, so that nothing jumps.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from onboard.messages import Quaternion, Vec3
from onboard.units import NS_PER_S, S_PER_NS

Wanted = Literal["autopilot", "own_state", "auto"]

RAMP_S: Final = 1.0  # duration of a change of source
SURER: Final = 0.5  # of the autopilot's standard deviation: with a smaller one the estimator is used ...
LESS_SURE: Final = 0.8  # ... until it is larger than this share
DWELL_NS: Final = NS_PER_S  # the reason for a change must hold for so long; a loss of validity counts at once
LEAST_NOISE: Final = 1e-9
BIAS_S: Final = 10.0  # over which a bias of one or the other shows
BIAS_SIGMAS: Final = 3.0  # of the estimator


class StatedMotion(NamedTuple):
    """What an estimator states of our own motion at one time: attitude and body rates (rad/s), position from O (m)
    and velocity (m/s) in n. Standard deviations without biases: of the attitude about b's axes (rad), and of the
    velocity."""

    q_nb: Quaternion
    omega_b: Vec3
    attitude_sigma: Vec3
    r_OF_n: Vec3
    v_F_n: Vec3
    velocity_sigma: Vec3


class Comparison(NamedTuple):
    """The estimator beside the autopilot. `apart`: its estimate less the autopilot's, None without one. `sigma`
    and `noise`: standard deviations of both, of the components that are compared, the first of `apart`; `noise` is
    None before it is known. Estimates that differ by more than `limit` and 3 sigma are of different motions, and
    the autopilot's is used."""

    apart: Sequence[float] | None
    sigma: Sequence[float]
    noise: Sequence[float] | None
    limit: float


class Source:
    """The source of one quantity. `changes` counts changes by the new source and the reason."""

    def __init__(self, quantity: str, wanted: Wanted) -> None:
        self.changes: Counter[str] = Counter()
        self.is_own = False  # whether the estimator is used
        self._quantity, self._wanted = quantity, wanted
        self._weight, self._t_ns = 0.0, 0
        self._apart: Sequence[float] | None = None  # as last known
        self._since_ns: int | None = None  # since when a change is due
        self._mean: tuple[float, ...] = ()  # of `apart`, over BIAS_S, ...
        self._mean_ns = 0  # ... since then
        self._sigma: Sequence[float] = ()

    @property
    def bias(self) -> float:
        """By how much the estimator's values have differed from the autopilot's for BIAS_S, 0 where its own
        uncertainty explains it."""
        off = math.hypot(*self._mean)
        is_long = self._apart is not None and self._t_ns - self._mean_ns > BIAS_S * NS_PER_S
        return off if is_long and off > BIAS_SIGMAS * math.hypot(*self._sigma) else 0.0

    @property
    def is_fixed(self) -> bool:
        """Whether it is the autopilot, whatever an estimator states."""
        return self._wanted == "autopilot"

    def correction(self, t_ns: int, compared: Comparison) -> tuple[float, tuple[float, ...]]:
        """(weight of the estimator, what to add to the autopilot's values) at a time."""
        dt, self._t_ns = (t_ns - self._t_ns) * S_PER_NS if self._t_ns else 0.0, t_ns
        self._decide(t_ns, compared)
        self._average(dt, compared)
        step = max(dt, 0.0) / RAMP_S
        self._weight = min(self._weight + step, 1.0) if self.is_own else max(self._weight - step, 0.0)
        if compared.apart is not None:
            self._apart = compared.apart
        if self._apart is None or self._weight == 0.0:
            return 0.0, ()
        return self._weight, tuple([self._weight * x for x in self._apart])

    def _average(self, dt: float, compared: Comparison) -> None:
        """The mean of how far both are apart."""
        if compared.apart is None or not self._mean:
            self._mean_ns, self._mean = self._t_ns, tuple(compared.apart or ())[: len(compared.sigma)]
        else:
            share, self._sigma = min(max(dt, 0.0) / BIAS_S, 1.0), compared.sigma
            pairs = zip(self._mean, compared.apart, strict=False)
            self._mean = tuple([mean + share * (x - mean) for mean, x in pairs])

    def _decide(self, t_ns: int, compared: Comparison) -> None:
        if self._wanted == "autopilot":
            return
        apart, sigma, noise, limit = compared
        if apart is None:
            self._change(own=False, why="own_state_is_not_valid")
            return
        own, other = sum(s * s for s in sigma), sum(s * s for s in noise or sigma)
        share = LESS_SURE if self.is_own else SURER
        surer = self._wanted == "own_state" or own < max(share**2 * other, LEAST_NOISE**2)
        agrees = sum(x * x for x in apart[: len(sigma)]) < limit**2 + 9.0 * (own + other)
        if (surer and agrees) == self.is_own:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = t_ns
        elif t_ns - self._since_ns >= DWELL_NS:
            why = "own_state_is_surer" if not self.is_own else "own_state_is_less_sure"
            self._change(own=not self.is_own, why=why if agrees else "own_state_contradicts_it")

    def _change(self, *, own: bool, why: str) -> None:
        self._since_ns = None
        if self.is_own != own:
            self.is_own = own
            self.changes[f"{self._quantity}_from_{'own_state' if own else 'autopilot'}.{why}"] += 1
