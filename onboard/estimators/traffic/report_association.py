"""Association of reports with tracks, as decisions that the tracker executes.

An address is an identity: its reports go to the track of that address, or to a second one of the same address, and
to no other. Decisions for different addresses do not depend on each other.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.estimators.kit.peer_position import is_repetition
from onboard.estimators.traffic.batch import NO_ROWS, Batch
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.publication import measurement_report
from onboard.estimators.traffic.reports import Key, Report
from onboard.estimators.traffic.track import Track
from onboard.filters.association import Places
from onboard.filters.belief import Update
from onboard.filters.gating import chi_square_threshold
from onboard.messages import MeasurementReport, Verdict
from onboard.models.intruder.measurement import REPORT_SIZE
from onboard.units import NS_PER_S

MIN_OUTLIER_COUNT: Final = 3  # Reports that fit each other but not their track are then believed.
MAX_OUTLIER_INTERVAL_S: Final = 5.0  # Between consecutive outliers; one report in a thousand is one by chance.
MAX_LAG_DISTANCE_M: Final = 100.0  # A nearer report is of the same aircraft, and the filter has lagged.
MAX_TRACKS_PER_ADDRESS: Final = 4
MAX_ADOPTION_DISTANCE_M: Final = 1000.0  # from a report to the radar's track that it names
LOOK_BACK_VARIANCE_FRACTION: Final = 0.02  # of a manoeuvre's variance, for changes within a second


class Fuse(NamedTuple):
    """Fuse a report into the track of its address."""

    report: Report
    row: int
    measurement: MeasurementReport


class Reject(NamedTuple):
    """Reject a report that does not fit the track of its address, or repeats an older one.

    Attributes
    ----------
    outliers
        The track's outliers from now on.
    """

    row: int
    measurement: MeasurementReport
    outliers: tuple[Report, ...]


class Restart(NamedTuple):
    """Restart a track at the position of a report.

    Attributes
    ----------
    split
        Whether the echoes at its old place are of another aircraft, whose track continues without the name.
    """

    report: Report
    row: int
    split: bool


class Adopt(NamedTuple):
    """Give a radar's track the report's name, and apply the update `place` of those evaluated."""

    report: Report
    row: int
    rows: Places
    updates: Update
    place: int


class Begin(NamedTuple):
    """Start a track with the report; `copy`: its number among those of the same address."""

    report: Report
    copy: int = 1


class ReportAssociation(NamedTuple):
    """Updates to apply, and decisions to execute after them, in order.

    The updates `chosen` are of the tracks in `rows[chosen]`.
    """

    rows: Places
    updates: Update | None
    chosen: Places
    decisions: list[Fuse | Reject | Restart | Adopt | Begin]


def associate_reports(
    reports: Sequence[Report], tracks: Sequence[Track], batch: Batch, config: Config
) -> ReportAssociation:
    """Decide about reports of different addresses.

    Each is compared with the track of its address that it fits best.
    """
    owners: dict[Key, list[int]] = {}
    for row, track in enumerate(tracks):
        if track.key is not None:
            owners.setdefault(track.key, []).append(row)
    pairs = [(report, row) for report in reports for row in owners.get(report.key, ())]
    unknown = _decide_without_track([r for r in reports if r.key not in owners], tracks, batch, config)
    if not pairs:
        return ReportAssociation(NO_ROWS, None, NO_ROWS, [*unknown])
    updates, rows = _evaluate([r for r, _ in pairs], [row for _, row in pairs], batch, config)
    best: dict[Key, int] = {}  # the pair that fits best
    for p, (report, _) in enumerate(pairs):
        if report.key not in best or updates.nis[p] < updates.nis[best[report.key]]:
            best[report.key] = p
    chosen: list[int] = []
    first: list[Fuse | Reject] = []
    then: list[Restart | Begin] = []
    for key, p in best.items():
        report, row = pairs[p]
        verdict = _verdict(report, row, tracks, float(updates.nis[p]), batch, config)
        measurement = measurement_report(
            report.message, report.source, report.t_ns, verdict, updates, p, config, polar=batch.polar
        )
        if verdict is Verdict.FUSED:
            chosen.append(p)
            first.append(Fuse(report, row, measurement))
            continue
        outliers = tracks[row].outliers
        if verdict is not Verdict.DUPLICATE:
            outliers, remedy = _decide_on_outlier(report, row, tracks, len(owners[key]), batch, config)
            then += [remedy] if remedy else []
        first.append(Reject(row, measurement, outliers))
    return ReportAssociation(rows, updates, np.array(chosen, np.int64), [*first, *then, *unknown])


def _evaluate(
    reports: Sequence[Report], rows: Sequence[int], batch: Batch, config: Config
) -> tuple[Update, Places]:
    lag = np.array([batch.lag(r.t_ns) for r in reports])
    R = np.stack([r.R for r in reports])
    # noise of manoeuvres since the report, which the model neglects when it looks back
    manoeuvre = config.manoeuvre_acceleration_m_s2**2
    for i in range(3):
        R[:, i, i] += manoeuvre * LOOK_BACK_VARIANCE_FRACTION * lag**4
        R[:, 3 + i, 3 + i] += manoeuvre * LOOK_BACK_VARIANCE_FRACTION * lag**2
    at = np.array(rows, np.int64)
    y, bias_sigma = np.stack([r.y for r in reports]), np.stack([r.bias_sigma for r in reports])
    return batch.evaluate_reports(at, lag, y, R, bias_sigma), at


def _verdict(
    report: Report, row: int, tracks: Sequence[Track], nis: float, batch: Batch, config: Config
) -> Verdict:
    if is_repetition(report.message, tracks[row].adsb):
        return Verdict.DUPLICATE
    if nis <= chi_square_threshold(config.gate_probability, REPORT_SIZE):
        return Verdict.FUSED
    return Verdict.IMPLAUSIBLE if _is_far(report, row, tracks, batch, config) else Verdict.GATED


def _is_far(report: Report, row: int, tracks: Sequence[Track], batch: Batch, config: Config) -> bool:
    """Return whether no aircraft can fly from the track to the reported position in time."""
    elapsed = max(abs(report.t_ns - tracks[row].fused_ns) / NS_PER_S, 1.0)
    return _distance(report, row, batch) > config.max_speed_m_s * elapsed + MAX_LAG_DISTANCE_M


def _distance(report: Report, row: int, batch: Batch) -> float:
    """Return the distance of a report from its track's position at the time, m."""
    return float(np.linalg.norm(report.y[:3] - batch.position(row, report.t_ns)))


def _decide_on_outlier(
    report: Report, row: int, tracks: Sequence[Track], copies: int, batch: Batch, config: Config
) -> tuple[tuple[Report, ...], Restart | Begin | None]:
    """Return the outliers of a track with one more, and the decision about them.

    A few that fit each other are believed. If the track was fused with reports of the same source meanwhile, the
    outliers are of another aircraft with its address. Otherwise the track is at their position, and echoes at its
    old place are of another aircraft.
    """
    track = tracks[row]
    earlier = track.outliers if track.outliers and _are_consistent(track.outliers[-1], report) else ()
    outliers = (*earlier, report)
    if len(outliers) < MIN_OUTLIER_COUNT:
        return outliers, None
    first_ns = outliers[0].t_ns
    reports_fused = track.sources.get(report.source, 0) >= first_ns
    any_fused = track.fused_ns >= first_ns
    near = _distance(report, row, batch) < MAX_LAG_DISTANCE_M
    if near or (not reports_fused and (any_fused or not _is_far(report, row, tracks, batch, config))):
        return (), Restart(report, row, split=any_fused and not near)
    return (), Begin(report, copies + 1) if copies < MAX_TRACKS_PER_ADDRESS else None


def _are_consistent(earlier: Report, later: Report) -> bool:
    """Return whether two reports could be of one aircraft with the reported velocities."""
    dt = (later.t_ns - earlier.t_ns) / NS_PER_S
    if abs(dt) > MAX_OUTLIER_INTERVAL_S:
        return False
    off = later.y[:3] - earlier.y[:3] - dt * 0.5 * (earlier.y[3:] + later.y[3:])
    room = np.sqrt(np.trace(earlier.R[:3, :3] + later.R[:3, :3])) + 5.0 * abs(dt)
    return bool(np.linalg.norm(off) < 3.0 * room)


def _decide_without_track(
    reports: Sequence[Report], tracks: Sequence[Track], batch: Batch, config: Config
) -> list[Adopt | Begin]:
    """Return the decisions about addresses without a track.

    They name a radar's track, or start a new one.
    """
    decisions: list[Adopt | Begin] = []
    unnamed = {i for i, t in enumerate(tracks) if t.key is None and t.confirmed}
    for report in reports:
        adopted = _adoption(report, sorted(unnamed), batch, config)
        decisions.append(adopted or Begin(report))
        if adopted:
            unnamed.remove(adopted.row)
    return decisions


def _adoption(report: Report, unnamed: Sequence[int], batch: Batch, config: Config) -> Adopt | None:
    """Return the adoption of the only unnamed track that the report fits.

    None if there is not exactly one.
    """
    mean = batch.belief().mean
    rows = [i for i in unnamed if np.linalg.norm(mean[i, :3] - report.y[:3]) < MAX_ADOPTION_DISTANCE_M]
    if not rows:
        return None
    updates, at = _evaluate([report] * len(rows), rows, batch, config)
    fits = np.flatnonzero(updates.nis <= chi_square_threshold(config.gate_probability, REPORT_SIZE))
    return Adopt(report, rows[fits[0]], at, updates, int(fits[0])) if len(fits) == 1 else None
