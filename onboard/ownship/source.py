"""The source of our own motion: the autopilot, or an estimator of our own state.

Attitude is one quantity, velocity with position another; each has a source of its own. The estimator is used where
it is valid and, with `auto`, surer than the autopilot, whose white noise is measured (`scatter`). Biases of either
cannot be measured here, and are configured. A change of source takes `RAMP_DURATION_S`, so that nothing jumps.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from onboard.messages import Quaternion, Vec3
from onboard.units import NS_PER_S, S_PER_NS

Wanted = Literal["autopilot", "own_state", "auto"]

RAMP_DURATION_S: Final = 1.0  # of a change of source
SWITCH_TO_OWN_RATIO: Final = (
    0.5  # The estimator is used below this share of the autopilot's standard deviation ...
)
SWITCH_BACK_RATIO: Final = 0.8  # ... until it exceeds this share.
DWELL_TIME_NS: Final = NS_PER_S  # The reason for a change must last this long; a loss of validity counts at once.
MIN_NOISE: Final = 1e-9
BIAS_WINDOW_S: Final = 10.0
BIAS_SIGMAS: Final = 3.0  # of the estimator


class StatedMotion(NamedTuple):
    """An estimator's statement of our own motion; standard deviations exclude biases."""

    q_nb: Quaternion
    omega_b: Vec3  # rad/s
    attitude_sigma: Vec3  # rad, about b's axes
    r_OF_n: Vec3  # m
    v_F_n: Vec3  # m/s
    velocity_sigma: Vec3  # m/s


class Comparison(NamedTuple):
    """An estimate compared with the autopilot's.

    If they differ by more than `limit` and 3 sigma, they are of different motions, and the autopilot is used."""

    apart: Sequence[float] | None  # estimate minus the autopilot's; None without an estimate
    sigma: Sequence[float]  # of the estimate, for the first components of `apart`, which are compared
    noise: Sequence[float] | None  # of the autopilot, for the same; None before it is known
    limit: float


class Source:
    """The source of one quantity."""

    def __init__(self, quantity: str, wanted: Wanted) -> None:
        self.changes: Counter[str] = Counter()  # by the new source and the reason
        self.is_own = False  # The estimator is used.
        self._quantity, self._wanted = quantity, wanted
        self._weight, self._t_ns = 0.0, 0
        self._apart: Sequence[float] | None = None  # as last known
        self._since_ns: int | None = None  # since when a change is due
        self._mean: tuple[float, ...] = ()  # of `apart`, over BIAS_WINDOW_S
        self._mean_ns = 0  # the mean's first time
        self._sigma: Sequence[float] = ()

    @property
    def bias(self) -> float:
        """Mean difference of the estimator from the autopilot; 0 if its uncertainty explains it."""
        off = math.hypot(*self._mean)
        is_long = self._apart is not None and self._t_ns - self._mean_ns > BIAS_WINDOW_S * NS_PER_S
        return off if is_long and off > BIAS_SIGMAS * math.hypot(*self._sigma) else 0.0

    @property
    def is_fixed(self) -> bool:
        """Whether only the autopilot may be the source."""
        return self._wanted == "autopilot"

    def correction(self, t_ns: int, compared: Comparison) -> tuple[float, tuple[float, ...]]:
        """Return the weight of the estimator and the correction of the autopilot's values."""
        dt, self._t_ns = (t_ns - self._t_ns) * S_PER_NS if self._t_ns else 0.0, t_ns
        self._decide(t_ns, compared)
        self._average(dt, compared)
        step = max(dt, 0.0) / RAMP_DURATION_S
        self._weight = min(self._weight + step, 1.0) if self.is_own else max(self._weight - step, 0.0)
        if compared.apart is not None:
            self._apart = compared.apart
        if self._apart is None or self._weight == 0.0:
            return 0.0, ()
        return self._weight, tuple([self._weight * x for x in self._apart])

    def _average(self, dt: float, compared: Comparison) -> None:
        """Update the mean difference."""
        if compared.apart is None or not self._mean:
            self._mean_ns, self._mean = self._t_ns, tuple(compared.apart or ())[: len(compared.sigma)]
        else:
            share, self._sigma = min(max(dt, 0.0) / BIAS_WINDOW_S, 1.0), compared.sigma
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
        share = SWITCH_BACK_RATIO if self.is_own else SWITCH_TO_OWN_RATIO
        surer = self._wanted == "own_state" or own < max(share**2 * other, MIN_NOISE**2)
        agrees = sum(x * x for x in apart[: len(sigma)]) < limit**2 + 9.0 * (own + other)
        if (surer and agrees) == self.is_own:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = t_ns
        elif t_ns - self._since_ns >= DWELL_TIME_NS:
            why = "own_state_is_surer" if not self.is_own else "own_state_is_less_sure"
            self._change(own=not self.is_own, why=why if agrees else "own_state_contradicts_it")

    def _change(self, *, own: bool, why: str) -> None:
        self._since_ns = None
        if self.is_own != own:
            self.is_own = own
            self.changes[f"{self._quantity}_from_{'own_state' if own else 'autopilot'}.{why}"] += 1
