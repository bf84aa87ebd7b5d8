"""Ranges to the leader, by a rangefinder or a radio: they teach the size."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.auxiliary import DISTANCE, Auxiliary, Range
from onboard.estimators.leader.hypotheses.particles import Bias
from onboard.messages import DistanceReading, Message, TargetImage, Verdict
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

COUNTED: Final = "range_"  # before the verdicts in the health


class Ranging:
    """The ranges to one leader, which are given to `take`.

    `verdicts` counts what became of them, by name."""

    def __init__(self, config: Config, take: Callable[[Auxiliary, Ownship], Verdict]) -> None:
        self.verdicts: Counter[str] = Counter()
        self._config, self._take = config.range, take
        self._bias = Bias(DISTANCE, config.range.bias_m, config.broadcast.bias_time_s)
        self.clear()

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """The messages it uses beside the images."""
        return (DistanceReading,) if self._config.sensor >= 0 else ()

    def clear(self) -> None:
        """Forget all but the counts."""
        self._newest_ns = 0

    def receive(self, message: Message, ownship: Ownship) -> None:
        """Take a range, also that of an image of the leader."""
        c = self._config
        if isinstance(message, DistanceReading) and message.sensor == c.sensor:
            t_ns = message.t_ns - round(c.latency_s * NS_PER_S)
            verdict = self._fuse(t_ns, message.distance, message.sigma, ownship)
        elif isinstance(message, TargetImage) and message.range is not None and c.detections:
            verdict = self._fuse(message.t_ns, message.range, message.range_sigma, ownship)
        else:
            return
        self.verdicts[COUNTED + verdict] += 1

    def _fuse(self, t_ns: int, distance: float | None, sigma: float | None, ownship: Ownship) -> Verdict:
        if distance is None:
            return Verdict.NO_POSITION
        if not math.isfinite(distance) or not math.isfinite(sigma or 0.0):
            return Verdict.NOT_FINITE
        if distance <= 0.0:
            return Verdict.IMPLAUSIBLE
        if t_ns <= self._newest_ns:
            return Verdict.STALE
        if ownship.pose_at(t_ns) is None:
            return Verdict.NO_POSE
        self._newest_ns = t_ns
        sigma = max(sigma or 0.0, self._config.sigma_m)
        return self._take(Range(t_ns, distance, sigma, (self._bias,)), ownship)
