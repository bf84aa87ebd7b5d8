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
from onboard.messages import Estimate, Record, Truth, Verdict
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
    estimates: Sequence[Estimate], reference: Reference | None, settle: float = SETTLE
) -> LeaderScore:
    """The score of one flight's estimates of one target; without a reference, only what needs none."""
    valid = [e for e in estimates if e.valid and e.mean is not None and e.covariance is not None]
    begin = (reference.time[0] if reference is not None and len(reference.time) else _start(estimates)) + settle
    all_errors = _errors(valid, reference) if reference is not None else None
    errors = _since(all_errors, begin)
    nis = [
        e.measurement.nis
        for e in estimates
        if e.measurement is not None
        and e.measurement.verdict in {Verdict.FUSED, Verdict.FUSED_LATE}
        and e.measurement.nis is not None
        and e.measurement.t_ns * 1e-9 >= begin
    ]
    dof = next((len(e.measurement.components) for e in estimates if e.measurement is not None), 0)
    return LeaderScore(
        estimates=len(estimates),
        valid=len(valid),
        scored=len(errors.time) if errors else 0,
        settle_s=settle,
        range_error_rms_percent=rms(errors.range_fraction * 100) if errors else None,
        position_rmse_m=rms(errors.position) if errors else None,
        velocity_rmse_m_s=rms(errors.velocity) if errors else None,
        size_error_rms_percent=rms(errors.size_fraction * 100) if errors else None,
        nees_mean=float(errors.nees.mean()) if errors else None,
        nees_dof=errors.dof if errors else 0,
        nees_bounds=_single_bounds(errors.dof) if errors else None,
        inside_95_percent=percent(errors.position_nees < chi_square_threshold(0.95, 3)) if errors else None,
        nis_mean=float(np.mean(nis)) if nis else None,
        nis_dof=dof,
        nis_bounds=mean_bounds(dof, len(nis)) if nis else None,
        images_scored=len(nis),
        diverged=_diverged(all_errors) if reference is not None else False,
        resets=estimates[-1].reset_count if estimates else 0,
        verdicts=dict(Counter(e.measurement.verdict for e in estimates if e.measurement is not None)),
    )


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


def _start(estimates: Sequence[Estimate]) -> float:
    return estimates[0].t_ns * 1e-9 if estimates else 0.0


def _single_bounds(dof: int) -> tuple[float, float]:
    """Bounds that a single chi-square draw keeps with 95 %."""
    return chi_square_threshold(0.025, dof), chi_square_threshold(0.975, dof)
