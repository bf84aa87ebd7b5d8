"""Whether innovations are as large as they should be: the mean NIS of the last measurements against its bounds.

A consistent filter's NIS is chi-square distributed with as many degrees of freedom as the innovation has
components, so the sum over a window is, too, with as many as the window has components. A mean above its bounds
shows noise larger than configured, or an error of another kind (mount, delay, size); below them, noise smaller
than configured. A measurement beyond the gate counts as one at the gate, so that a single outlier moves the
mean little.

Innovations that are too large come of a target that flies otherwise than expected, too. That is in one innovation
as in the next, while noise is in their differences. So the noise that is stated is at most what these show."""

import math
from collections import deque
from typing import Final, NamedTuple

from onboard.filters.gating import mean_bounds
from onboard.messages import Consistency, Estimate, MeasurementReport
from onboard.units import NS_PER_S

WINDOW: Final = 200  # measurements
MIN_INNOVATION_COUNT: Final = 30  # before which nothing is stated
DEFAULT_GATE_RATIO: Final = 5.0  # of the expectation: where a report states no gate
MAX_INTERVAL_NS: Final = NS_PER_S // 2  # between two innovations that are compared
MAX_SUMMARY_COUNT: Final = 32  # estimators and sources
BOUNDS_PROBABILITY: Final = 0.9973  # that the mean NIS of a consistent filter lies within its bounds


class _Innovation(NamedTuple):
    """One innovation: its NIS and degrees of freedom, the noise scale in use, and the NIS of its difference."""

    nis: float
    degrees: int
    noise_scale: float
    difference: float | None


class Consistencies:
    """The windows, by estimator and source, as `leader.front`. Further targets of an estimator count with the
    first: their noise is that of the same camera."""

    def __init__(self) -> None:
        self._windows: dict[str, deque[_Innovation]] = {}
        self._last: dict[str, MeasurementReport] = {}

    def add(self, estimate: Estimate, report: MeasurementReport) -> None:
        """Take a measurement that was compared with its prediction."""
        if report.nis is None or report.innovation is None or not math.isfinite(report.nis):
            return
        key = f"{estimate.name}.{report.source}"
        if key not in self._windows and len(self._windows) >= MAX_SUMMARY_COUNT:
            return
        degrees = len(report.innovation)
        nis = min(report.nis, report.gate or DEFAULT_GATE_RATIO * degrees)
        window = self._windows.setdefault(key, deque(maxlen=WINDOW))
        difference = _difference_nis(self._last.get(key), report)
        self._last[key] = report
        window.append(_Innovation(nis, degrees, report.noise_scale, difference))

    def summary(self) -> dict[str, Consistency]:
        """Return the consistency of each window that is long enough."""
        return {
            key: _summarise(window) for key, window in self._windows.items() if len(window) >= MIN_INNOVATION_COUNT
        }


def _difference_nis(before: MeasurementReport | None, now: MeasurementReport) -> float | None:
    """Return the NIS per component of what an innovation differs by from the one before, None without that."""
    if before is None or before.components != now.components or now.t_ns - before.t_ns > MAX_INTERVAL_NS:
        return None
    e, f, sigma, tau = now.innovation, before.innovation, now.innovation_sigma, before.innovation_sigma
    if e is None or f is None or sigma is None or tau is None or len(e) != len(f):
        return None
    terms = [(a - b) ** 2 / (s * s + t * t) for a, b, s, t in zip(e, f, sigma, tau, strict=True)]
    return sum(terms) / len(terms)


def _summarise(window: deque[_Innovation]) -> Consistency:
    degrees = sum(one.degrees for one in window)
    low, high = mean_bounds(1, degrees, BOUNDS_PROBABILITY)
    nis = sum(one.nis for one in window) / degrees
    larger = sum(one.noise_scale**2 * one.nis for one in window) / degrees
    learnt = sum(one.noise_scale**2 for one in window) / len(window)
    noise = max(larger, learnt) if nis < 1.0 else larger
    differences = [one.noise_scale**2 * one.difference for one in window if one.difference is not None]
    if differences:
        noise = min(noise, max(sum(differences) / len(differences), 1.0))
    return Consistency(count=len(window), nis=nis, low=low, high=high, noise=math.sqrt(noise))
