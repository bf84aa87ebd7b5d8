"""Results of many runs of a tracker: errors in windows of time, consistency, failures; small enough to be sent
between processes."""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from studies.tracking.batch import Scene, Trace, Tracker, run_batch

Mask = npt.NDArray[np.bool_]
POSITION: Final = (0, 3, 6)
VELOCITY: Final = (1, 4, 7)
ACCELERATION: Final = (2, 5, 8)
LAST: Final = 50  # steps over which divergence is judged


class WindowErrors(NamedTuple):
    """Over the steps of a window and the runs that did not fail, before or after: root mean squares of the lengths
    of error vectors (m, m/s, m/s^2), means of NEES and NIS, and the share of NEES within its 95 % bound. NaN if
    all failed."""

    position: float
    velocity: float
    acceleration: float
    nees: float
    nis: float
    inside: float


class Outcome(NamedTuple):
    """One tracker over all runs of a scene."""

    label: str
    runs: int
    failed: int  # numerical failures
    failed_at: float  # s, their median, NaN without
    diverged: int  # failures, and runs too far off over their last steps
    windows: dict[str, WindowErrors]
    rms: Array  # (T, n), over runs, of each state's error
    first_mean: Array  # (T, n), of the first run
    condition: Array  # (T,), median over runs

    @property
    def failed_share(self) -> float:
        """Numerical failures over runs."""
        return self.failed / self.runs

    @property
    def diverged_share(self) -> float:
        """Diverged runs over runs."""
        return self.diverged / self.runs

    @property
    def failures(self) -> str:
        """How many runs failed, and when."""
        return f"{self.failed} of {self.runs}" + (f", median {self.failed_at:.0f} s" if self.failed else "")


def outcomes_of(
    scene: Scene,
    trackers: Iterable[Tracker],
    t: Array,
    windows: Mapping[str, Mask],
    limit: float,
    condition: bool = False,
) -> dict[str, Outcome]:
    """Run and judge each of the trackers; by name. Arguments as of `run_batch` and `judge`."""
    return {x.name: judge(run_batch(scene, x, condition), scene.truth, x, t, windows, limit) for x in trackers}


def judge(
    trace: Trace, truth: Array, tracker: Tracker, t: Array, windows: Mapping[str, Mask], limit: float
) -> Outcome:
    """Compare a trace with the truth (T, n) or (T, B, n). `t` (T,) in s; `windows` are masks (T,). A run has
    diverged if its mean position error over the last steps is above `limit`, m."""
    steps, runs, n = trace.mean.shape
    error = trace.mean - (truth if truth.ndim == 3 else truth[:, None])
    failed = trace.failed < steps
    kept = error[:, ~failed]  # a run is easy as long as it does not fail: to count it up to there would flatter
    distance = _length(error, POSITION)
    far = distance[-LAST:].mean(axis=0) > limit  # false of NaN, a run that failed
    bound = chi_square_threshold(0.95, n)
    return Outcome(
        label=tracker.label,
        runs=runs,
        failed=int(failed.sum()),
        failed_at=float(np.median(t[trace.failed[failed]])) if failed.any() else float("nan"),
        diverged=int((failed | far).sum()),
        windows={
            name: WindowErrors(
                position=_rms(_length(kept[at], POSITION)),
                velocity=_rms(_length(kept[at], VELOCITY)),
                acceleration=_rms(_length(kept[at], ACCELERATION)),
                nees=_over(np.mean, trace.nees[at][:, ~failed]),
                nis=_over(np.mean, trace.nis[at][:, ~failed]),
                inside=_over(np.mean, trace.nees[at][:, ~failed], lambda x: x < bound),
            )
            for name, at in windows.items()
        },
        rms=_rms_over_runs(error),
        first_mean=trace.mean[:, 0],
        condition=_median_over_runs(trace.condition),
    )


def between(t: Array, begin: float, end: float) -> Mask:
    """The mask of [begin, end), s."""
    return np.asarray((t >= begin) & (t < end))


def _length(error: Array, columns: tuple[int, ...]) -> Array:
    return np.asarray(np.linalg.norm(error[..., columns], axis=-1))


def _over(statistic: Any, values: Array, of: Any = None) -> float:
    """A statistic of the finite values, NaN without any."""
    known = values[np.isfinite(values)]
    return float(statistic(known if of is None else of(known))) if known.size else float("nan")


def _rms(values: Array) -> float:
    return float(np.sqrt(_over(np.mean, values**2)))


def _rms_over_runs(values: Array) -> Array:
    known = np.isfinite(values)
    total = np.sum(np.where(known, values, 0.0) ** 2, axis=1)
    return np.asarray(np.sqrt(total / np.where(known.any(axis=1), known.sum(axis=1), np.nan)))


def _median_over_runs(values: Array) -> Array:
    return np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else np.nan for row in values])
