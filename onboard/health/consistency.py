"""Whether innovations are as large as they should be: the mean NIS of the last measurements against its bounds.

A consistent filter's NIS is chi-square distributed with as many degrees of freedom as the innovation has
components, so the sum over a window is, too, with as many as the window has components. A mean above its bounds
shows noise larger than configured, or an error of another kind (mount, delay, size); below them, noise smaller
than configured. A measurement beyond the gate counts as one at the gate, so that a single outlier moves the
mean little."""

import math
from collections import deque
from typing import Final

from onboard.messages import Consistency, Estimate, MeasurementReport

WINDOW: Final = 200  # measurements
FEWEST_INNOVATIONS: Final = 30  # before which nothing is stated
NO_GATE: Final = 5.0  # of the expectation: where a report states no gate
MOST_SUMMARIES: Final = 32  # estimators and sources
SIGMAS: Final = 3.0  # of the bounds: 99.7 %


class Consistencies:
    """The windows, by estimator and source, as `leader.front`. Further targets of an estimator count with the
    first: their noise is that of the same camera."""

    def __init__(self) -> None:
        self._windows: dict[str, deque[tuple[float, int, float]]] = {}

    def add(self, estimate: Estimate, report: MeasurementReport) -> None:
        """Take a measurement that was compared with its prediction."""
        if report.nis is None or report.innovation is None or not math.isfinite(report.nis):
            return
        key = f"{estimate.name}.{report.source}"
        if key not in self._windows and len(self._windows) >= MOST_SUMMARIES:
            return
        degrees = len(report.innovation)
        nis = min(report.nis, report.gate or NO_GATE * degrees)
        window = self._windows.setdefault(key, deque(maxlen=WINDOW))
        window.append((nis, degrees, report.noise_scale))

    def summary(self) -> dict[str, Consistency]:
        """What the windows show, of those that are long enough."""
        return {key: _of(window) for key, window in self._windows.items() if len(window) >= FEWEST_INNOVATIONS}


def _of(window: deque[tuple[float, int, float]]) -> Consistency:
    degrees = sum(n for _, n, _ in window)
    low, high = bounds(degrees)
    nis = sum(nis for nis, _, _ in window) / degrees
    larger = sum(scale**2 * nis for nis, _, scale in window) / degrees
    learnt = sum(scale**2 for _, _, scale in window) / len(window)
    noise = math.sqrt(max(larger, learnt) if nis < 1.0 else larger)
    return Consistency(count=len(window), nis=nis, low=low, high=high, noise=noise)


def bounds(degrees: int) -> tuple[float, float]:
    """The bounds of chi-square over its so many degrees of freedom, by Wilson and Hilferty's approximation."""
    variance = 2.0 / (9.0 * degrees)
    middle, width = 1.0 - variance, SIGMAS * math.sqrt(variance)
    return max(middle - width, 0.0) ** 3, (middle + width) ** 3
