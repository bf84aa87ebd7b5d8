"""Accuracy of the estimate of the leader, against a truth: errors, and whether the covariance fits them.

Valid estimates count from `settle` seconds after the truth begins. The NIS is a white sequence, so its mean has
chi-square bounds for the number of images; the NEES of one flight is correlated throughout, so its bounds are
those of a single draw.
"""

import csv
import gzip
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.errors import UserError
from onboard.filters.gating import chi_square_threshold, mean_bounds, normalised_squared
from onboard.messages import Estimate, MeasurementReport, Record, Truth, Verdict
from onboard.scoring.statistics import percent, rms

SETTLE: Final = 15.0
LAST: Final = 5.0  # "diverged" is judged over these last seconds
COLUMNS: Final = {
    "r_north_m": "r_north",
    "r_east_m": "r_east",
    "r_down_m": "r_down",
    "v_north_m_s": "v_north",
    "v_east_m_s": "v_east",
    "v_down_m_s": "v_down",
    "size_m": "size",
    "a_lat_m_s2": "a_lat",
    "a_long_m_s2": "a_long",
}
LONGEST_TRUTH_GAP: Final = 0.5


class TruthError(UserError, ValueError):
    """The truth cannot be used; the message says why in one line."""


class Reference(NamedTuple):
    """A truth: times (n,) in s since boot, and values (n, k) of the named components."""

    time: Array
    components: tuple[str, ...]
    values: Array


class LeaderScore(Record, frozen=True, kw_only=True):
    """Errors are RMS over the `scored` estimates; None where there is nothing to judge by."""

    estimates: int
    valid: int
    scored: int
    settle_s: float
    range_error_rms_percent: float | None
    position_rmse_m: float | None
    velocity_rmse_m_s: float | None
    size_error_rms_percent: float | None
    nees_mean: float | None
    nees_dof: int
    nees_bounds: tuple[float, float] | None
    inside_95_percent: float | None
    nis_mean: float | None
    nis_dof: int
    nis_bounds: tuple[float, float] | None
    images_scored: int
    diverged: bool
    resets: int
    verdicts: dict[str, int]


class _Errors(NamedTuple):
    """Errors of estimates: times (n,), norms (n,) in SI, fractions of the true range and size, bearing errors in
    degrees, NEES of all components and of the position; degrees of freedom of the former."""

    time: Array
    position: Array
    velocity: Array
    range_fraction: Array
    size_fraction: Array
    bearing_deg: Array
    nees: Array
    position_nees: Array
    dof: int


def reference_from_csv(path: Path) -> Reference:
    """Truth from a CSV (or .csv.gz) with `time_boot_s` and the columns of a replay.

    Raises TruthError.
    """
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
        rows = list(csv.DictReader(text.splitlines()))
        names = tuple(c for c in COLUMNS if rows and c in rows[0])
        table = np.array([[float(row[c]) for c in ("time_boot_s", *names)] for row in rows])
    except OSError as error:
        raise TruthError(f"cannot read {path}: {error.strerror or error}") from error
    except (KeyError, TypeError, ValueError, EOFError) as error:
        raise TruthError(f"{path} is no truth table: {error}") from error
    if (
        not set(list(COLUMNS)[:7]) <= set(names)
        or not np.isfinite(table).all()
        or (np.diff(table[:, 0]) <= 0).any()
    ):
        raise TruthError(f"{path} is no truth table: it needs rising time_boot_s, r_, v_ and size_m")
    return Reference(table[:, 0], tuple(COLUMNS[c] for c in names), table[:, 1:])


def reference_from_records(truths: Iterable[Truth]) -> Reference:
    """Truth from a simulator's records, in order of time, duplicates dropped."""
    rows = {t.t_ns: (*t.r_FL_n, *t.v_FL_n, t.size, t.a_lat, t.a_long) for t in truths}
    times = sorted(rows)
    values = np.array([rows[t] for t in times]).reshape(len(times), len(COLUMNS))
    return Reference(np.array(times) * 1e-9, tuple(COLUMNS.values()), values)


def score_leader(
    estimates: Iterable[Estimate], reference: Reference | None, settle: float = SETTLE
) -> LeaderScore:
    """The score of one flight's estimates of one target; without a reference, only what needs none."""
    scorer = LeaderScorer(reference, settle)
    for estimate in estimates:
        scorer.add(estimate)
    return scorer.score()


class LeaderScorer:
    """The score of estimates that come one by one, in order. Only their errors are kept: an hour of estimates
    would be gigabytes. Errors are computed for `piece` estimates at a time."""

    def __init__(self, reference: Reference | None, settle: float = SETTLE, piece: int = 4096) -> None:
        self._reference, self._settle, self._piece = reference, settle, piece
        self._begin: float | None = None
        self._valid: list[Estimate] = []  # whose errors have not been computed yet
        self._errors: list[_Errors] = []
        self._nis: list[float] = []
        self._dof = 0
        self._resets = 0
        self._counts = Counter({"estimates": 0, "valid": 0})
        self._verdicts: Counter[str] = Counter()

    def add(self, estimate: Estimate) -> None:
        """The next estimate."""
        if self._begin is None:
            reference = self._reference
            known = reference is not None and len(reference.time)
            start = reference.time[0] if reference is not None and known else estimate.t_ns * 1e-9
            self._begin = float(start) + self._settle
        self._counts["estimates"] += 1
        self._resets = estimate.reset_count
        self._add_image(estimate.measurement, self._begin)
        if not estimate.valid or estimate.mean is None or estimate.covariance is None:
            return
        self._counts["valid"] += 1
        if self._reference is not None:
            self._valid.append(estimate)
            if len(self._valid) >= self._piece:
                self._compute()

    def score(self) -> LeaderScore:
        """The score of all estimates so far."""
        self._compute()
        reference, dof, n = self._reference, self._dof, len(self._nis)
        all_errors = _joined(self._errors)
        errors = _since(all_errors, self._begin or 0.0)
        return LeaderScore(
            estimates=self._counts["estimates"],
            valid=self._counts["valid"],
            scored=len(errors.time) if errors else 0,
            settle_s=self._settle,
            range_error_rms_percent=rms(errors.range_fraction * 100) if errors else None,
            position_rmse_m=rms(errors.position) if errors else None,
            velocity_rmse_m_s=rms(errors.velocity) if errors else None,
            size_error_rms_percent=rms(errors.size_fraction * 100) if errors else None,
            nees_mean=float(errors.nees.mean()) if errors else None,
            nees_dof=errors.dof if errors else 0,
            nees_bounds=_single_bounds(errors.dof) if errors else None,
            inside_95_percent=percent(errors.position_nees < chi_square_threshold(0.95, 3)) if errors else None,
            nis_mean=float(np.mean(self._nis)) if n else None,
            nis_dof=dof,
            nis_bounds=mean_bounds(dof, n) if n else None,
            images_scored=n,
            diverged=_diverged(all_errors) if reference is not None else False,
            resets=self._resets,
            verdicts=dict(self._verdicts),
        )

    def _add_image(self, image: MeasurementReport | None, begin: float) -> None:
        if image is None:
            return
        self._dof = self._dof or len(image.components)
        self._verdicts[image.verdict] += 1
        fused = image.verdict in {Verdict.FUSED, Verdict.FUSED_LATE}
        if fused and image.nis is not None and image.t_ns * 1e-9 >= begin:
            self._nis.append(image.nis)

    def _compute(self) -> None:
        errors = _errors(self._valid, self._reference) if self._reference is not None else None
        if errors is not None:
            self._errors.append(errors)
        self._valid.clear()


def _joined(pieces: list[_Errors]) -> _Errors | None:
    """The errors of all pieces in one; None without any."""
    if not pieces:
        return None
    arrays = [np.concatenate(parts) for parts in zip(*(piece[:-1] for piece in pieces), strict=True)]
    return _Errors(*arrays, pieces[0].dof)  # type: ignore[call-arg, arg-type]  # the last field is no array


def _since(errors: _Errors | None, begin: float) -> _Errors | None:
    """The errors from a time on; None when there are none."""
    if errors is None or not (errors.time >= begin).any():
        return None
    later = errors.time >= begin
    arrays = {name: values[later] for name, values in errors._asdict().items() if name != "dof"}
    return errors._replace(**arrays)


def _errors(valid: Sequence[Estimate], reference: Reference) -> _Errors | None:
    """_Errors against the truth interpolated at each estimate's time; None when no estimate can be judged."""
    times = np.array([e.t_ns * 1e-9 for e in valid])
    if not len(times) or not len(reference.time):
        return None
    after = np.clip(np.searchsorted(reference.time, times), 1, max(len(reference.time) - 1, 1))
    gap = reference.time[after] - reference.time[after - 1]
    inside = (times >= reference.time[0]) & (times <= reference.time[-1]) & (gap < LONGEST_TRUTH_GAP)
    if not inside.any():
        return None
    chosen = [e for e, use in zip(valid, inside, strict=True) if use]
    columns = [chosen[0].components.index(c) for c in reference.components]
    mean = np.array([e.mean for e in chosen])[:, columns]
    P = np.array([e.covariance for e in chosen])[:, columns][:, :, columns]
    truth = np.column_stack([np.interp(times[inside], reference.time, v) for v in reference.values.T])
    error = mean - truth
    r, size = slice(0, 3), reference.components.index("size")
    distance = np.linalg.norm(truth[:, r], axis=1)
    estimated = np.linalg.norm(mean[:, r], axis=1)
    cosine = np.sum(mean[:, r] * truth[:, r], axis=1) / (distance * estimated)
    return _Errors(
        time=times[inside],
        position=np.linalg.norm(error[:, r], axis=1),
        velocity=np.linalg.norm(error[:, 3:6], axis=1),
        range_fraction=estimated / distance - 1,
        size_fraction=error[:, size] / truth[:, size],
        bearing_deg=np.degrees(np.arccos(np.clip(cosine, -1, 1))),
        nees=normalised_squared(error, P),
        position_nees=normalised_squared(error[:, r], P[:, r, r]),
        dof=len(columns),
    )


def _diverged(errors: _Errors | None) -> bool:
    """Whether no estimate was valid, or over the last seconds the mean range error is above 50 % or the mean
    bearing error above 5 degrees."""
    if errors is None:
        return True
    last = errors.time > errors.time[-1] - LAST
    return bool(np.mean(np.abs(errors.range_fraction[last])) > 0.5 or np.mean(errors.bearing_deg[last]) > 5.0)


def _single_bounds(dof: int) -> tuple[float, float]:
    """Bounds that a single chi-square draw keeps with 95 %."""
    return chi_square_threshold(0.025, dof), chi_square_threshold(0.975, dof)
