"""Results of many runs of a tracker: errors in windows of time, consistency, failures.

They are small enough to be sent between processes.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from studies.report.findings import Outcome as Decision
from studies.report.sampling import below
from studies.tracking.batch import Scene, Trace, Tracker, run_batch

Mask = npt.NDArray[np.bool_]
POSITION: Final = (0, 3, 6)
VELOCITY: Final = (1, 4, 7)
ACCELERATION: Final = (2, 5, 8)
QUANTITIES: Final = ("position", "velocity", "acceleration", "nees")
NO_RUNS: Final = np.empty((len(QUANTITIES), 0))
DIVERGENCE_WINDOW_STEPS: Final = 50


class WindowErrors(NamedTuple):
    """Errors and consistency over a window's steps and the runs that never fail; NaN if all do."""

    position: float  # m, RMS of the error vectors' lengths
    velocity: float  # m/s, the same
    acceleration: float  # m/s^2, the same
    nees: float  # mean
    nis: float  # mean
    inside: float  # share of NEES within its 95 % bound
    by_run: Array = NO_RUNS  # (4, runs): mean squares of QUANTITIES, the mean of NEES; NaN if the run failed

    def standard_error(self, quantity: str) -> float:
        """Return the standard error of a quantity by the scatter over runs; NaN with fewer than two."""
        runs = self.runs_of(quantity)
        runs = runs[np.isfinite(runs)]
        if runs.size < 2:
            return float("nan")
        error = float(np.std(runs, ddof=1) / np.sqrt(runs.size))
        value: float = getattr(self, quantity)
        return error if quantity == "nees" else error / (2 * value) if value > 0 else 0.0

    def text(self, quantity: str, digits: int = 2) -> str:
        """A quantity and its standard error."""
        error = self.standard_error(quantity)
        return f"{getattr(self, quantity):.{digits}f}" + (f" ± {error:.{digits}f}" if np.isfinite(error) else "")

    def within(self, quantity: str, limit: float) -> Decision:
        """Whether a quantity is below a limit, if the runs decide; a failed run is below nothing."""
        return below(self.runs_of(quantity), limit if quantity == "nees" else limit**2)

    def better(self, other: "WindowErrors", quantity: str, factor: float = 1.0) -> Decision:
        """Whether a quantity is below `factor` times the other's.

        It compares the runs in which the other does not fail; a filter that fails in one of them is not better.
        """
        ours, others = self.runs_of(quantity), other.runs_of(quantity)
        known = np.isfinite(others)
        return below((ours - (factor if quantity == "nees" else factor**2) * others)[known])

    def runs_of(self, quantity: str) -> Array:
        """Each run's mean of squares, or of NEES (runs,)."""
        row: Array = self.by_run[QUANTITIES.index(quantity)]
        return row


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

    def shown(self, value: float) -> float | str:
        """Return a cell of a table: a number only if no run failed, as the others are easier."""
        if not self.failed:
            return value
        return "failed" if self.failed == self.runs else f"{value:.4g} of {self.runs - self.failed} runs"

    @property
    def failures(self) -> str:
        """Describe how many runs failed, and when."""
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
    """Compare a trace with the truth (T, n) or (T, B, n).

    `t` (T,) in s; `windows` are masks (T,). A run has diverged if its mean position error over the last steps is
    above `limit`, m; one whose NEES becomes negative, so that its covariance is not positive definite, has failed.
    """
    steps, runs, n = trace.mean.shape
    error = trace.mean - (truth if truth.ndim == 3 else truth[:, None])
    indefinite = trace.nees < 0
    failed_at = np.where(indefinite.any(axis=0), np.argmax(indefinite, axis=0), trace.failed)
    failed_at = np.minimum(failed_at, trace.failed)
    failed = failed_at < steps
    kept = error[:, ~failed]  # a run is easy as long as it does not fail: to count it up to there would flatter
    distance = _length(error, POSITION)
    far = distance[-DIVERGENCE_WINDOW_STEPS:].mean(axis=0) > limit  # false of NaN, a run that failed
    bound = chi_square_threshold(0.95, n)
    return Outcome(
        label=tracker.label,
        runs=runs,
        failed=int(failed.sum()),
        failed_at=float(np.median(t[failed_at[failed]])) if failed.any() else float("nan"),
        diverged=int((failed | far).sum()),
        windows={
            name: WindowErrors(
                position=_rms(_length(kept[at], POSITION)),
                velocity=_rms(_length(kept[at], VELOCITY)),
                acceleration=_rms(_length(kept[at], ACCELERATION)),
                nees=_over(np.mean, trace.nees[at][:, ~failed]),
                nis=_over(np.mean, trace.nis[at][:, ~failed]),
                inside=_over(np.mean, trace.nees[at][:, ~failed], lambda x: x < bound),
                by_run=np.where(failed, np.nan, _by_run(error[at], trace.nees[at])),
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


def _by_run(error: Array, nees: Array) -> Array:
    """WindowErrors.by_run of a window's errors (t, B, n) and NEES (t, B)."""
    squares = [_length(error, columns) ** 2 for columns in (POSITION, VELOCITY, ACCELERATION)]
    if not len(error):
        return np.full((len(QUANTITIES), nees.shape[1]), np.nan)
    return np.array([np.mean(values, axis=0) for values in (*squares, nees)])


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
