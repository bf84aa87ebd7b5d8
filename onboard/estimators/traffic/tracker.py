"""The tracker, the only place where tracks change.

All filters are in one batch at one time (`batch`). Reports wait for the next publication, when all that arrived
are fused together; a radar scan is fused on arrival. Both may be older than the filters: the model looks back. The
modules `report_association` and `radar_association` decide, and the tracker executes.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Final

import numpy as np

from onboard.estimators.kit.frame import Frame, OwnMotion
from onboard.estimators.traffic.batch import Batch, Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.echoes import Echoes, echoes_of, radar_of
from onboard.estimators.traffic.motion import belief_from_echo, belief_from_report, configured_filter
from onboard.estimators.traffic.publication import in_turn, last_estimate, measurement_report
from onboard.estimators.traffic.radar_association import (
    anchor_echoes,
    associate_echoes,
    candidate_rows,
    continuations,
)
from onboard.estimators.traffic.registration import Registration
from onboard.estimators.traffic.report_association import (
    Adopt,
    Begin,
    Fuse,
    Reject,
    ReportAssociation,
    Restart,
    associate_reports,
)
from onboard.estimators.traffic.reports import Key, Report, ReportMessage
from onboard.estimators.traffic.room import make_room
from onboard.estimators.traffic.track import Track, name_of
from onboard.estimators.traffic.waiting import WaitingReports
from onboard.filters.association import Places
from onboard.filters.belief import Belief
from onboard.messages import Estimate, PeerRanges, RadarScan, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.models.intruder.attitude_error import ReportErrors

NO_REPORTS: Final = (np.inf,) * 3  # m, standard deviation of the steady error without reports


class Tracker:
    """All tracks and their filters.

    Attributes
    ----------
    tracks
        `tracks[i]` has the filter in row i of `batch`.
    verdicts
        Counts of the verdicts on all reports and echoes.
    """

    def __init__(self, config: Config) -> None:
        self.verdicts: Counter[str] = Counter()
        self.tracks: list[Track] = []
        self.batch = Batch(configured_filter(config))
        self.registration = Registration(config)
        self._config = config
        self._waiting = WaitingReports(config)
        self._keys: frozenset[Key | None] = frozenset()  # addresses with a track, as of the last publication
        self._turn = 0
        self._own_r = np.zeros(3)  # our position at the last publication
        self._ended: list[Estimate] = []  # last estimates of removed tracks, until they are published
        self._last_number = 0

    def receive(self, message: ReportMessage, frame: Frame) -> None:
        """Queue a report for `fuse_reports`, or count why it cannot be used."""
        near = None
        if isinstance(message, PeerRanges):
            rows = (i for i, t in enumerate(self.tracks) if t.key == ("system", message.peer))
            near = next((self.batch.position(i, message.t_ns) for i in rows), None)
        refusal = self._waiting.add(message, frame, near, self._keys)
        if refusal is not None:
            self.verdicts[refusal] += 1

    def advance(self, t_ns: int) -> None:
        """Predict every track to a time. A track whose covariance is lost is removed."""
        reports = [t.last_report for t in self.tracks]
        bias = np.array([NO_REPORTS if r is None else r.bias_sigma for r in reports]).reshape(-1, 3)
        shared = self.registration.covariance_with_bias([t.number for t in self.tracks], bias)
        failed = self.batch.advance(t_ns, self.registration.residual, ReportErrors(bias, shared))
        if len(failed):
            self.verdicts[Verdict.NUMERICAL] += len(failed)
            self._remove(failed.tolist(), Reason(Cause.FILTER_FAILED, "the covariance was lost"))

    def fuse_reports(self) -> None:
        """Fuse all queued reports."""
        for reports in self._waiting.take():
            timely = [r for r in reports if self._is_timely(r)]
            self._execute(associate_reports(self._limit_reports(timely), self.tracks, self.batch, self._config))

    def fuse_scan(self, scan: RadarScan, own: OwnMotion | None) -> None:
        """Fuse a radar scan.

        Echoes go to established tracks first, which also register the radar, then to the others. Those left start
        new tracks, most of which are never confirmed.
        """
        if own is None or (self.tracks and self.batch.lag(scan.t_ns) > self._config.late_horizon_s):
            self.verdicts[Verdict.NO_POSE if own is None else Verdict.TOO_OLD] += len(scan.detections)
            return
        self.advance(scan.t_ns)
        self.registration.advance(scan.t_ns)
        nominal = radar_of(scan, own, self._config)
        # A filter of Cartesian positions does not estimate the attitude error, so it counts as noise.
        angle_sigma = None if self.batch.polar else np.sqrt(self.registration.residual.covariance.max())
        echoes = echoes_of(scan, self._config, angle_sigma)
        radar, noisy = self._registered(nominal, echoes)
        rows, places = self._associate(noisy, scan, radar, established=True)
        self._register(rows, echoes.at(places), scan.t_ns, nominal)
        radar, noisy = self._registered(nominal, echoes)
        hits = self._fuse_echoes(rows, noisy.at(places), scan, radar)
        free = np.delete(np.arange(len(echoes.polar)), places)
        rows, places = self._associate(noisy.at(free), scan, radar, established=False)
        hits |= self._fuse_echoes(rows, noisy.at(free[places]), scan, radar)
        free = np.delete(free, places)
        found = self._count_scan(hits)
        for place in free:
            self._begin_with_echo(noisy.at(np.array([place])), scan, radar)
        self._continue(found, scan.t_ns)

    def remove_expired(self, now_ns: int) -> None:
        """Remove tracks without a recent measurement, and those that were never confirmed."""
        expired = [i for i, t in enumerate(self.tracks) if t.expired(now_ns, self._config)]
        self._remove(expired, Reason(Cause.FORGOTTEN, "no report or echo for a long time"))
        self._keys = frozenset(t.key for t in self.tracks)

    def publish(self, own: OwnMotion) -> tuple[list[Track], Belief]:
        """Return the tracks to be published now, with their beliefs (k, 15) and (k, 15, 15).

        Each has its next sequence number, and its newest measurement if that was not published yet. Of many
        tracks, see `in_turn`.
        """
        rows = [i for i, t in enumerate(self.tracks) if t.established]
        self._own_r = own.r
        rows = in_turn(rows, self.batch.belief().mean[rows, :3] - own.r, self._turn)
        self._turn += 1
        published = [self.tracks[i]._replace(sequence=self.tracks[i].sequence + 1) for i in rows]
        for i, track in zip(rows, published, strict=True):
            self.tracks[i] = track._replace(measurement=None)
        mean, covariance = self.batch.belief()
        return published, Belief(mean[rows], covariance[rows])

    def publish_ended(self) -> list[Estimate]:
        """Return the last estimates of tracks that were removed since the last call."""
        ended, self._ended = self._ended, []
        return ended

    def clear(self, why: Reason) -> None:
        """Remove all tracks, queued reports, and the time."""
        self._remove(range(len(self.tracks)), why)
        self._waiting.clear()
        self.batch.clear()
        self.registration.clear()

    # ------------------------------------------------------------------------------------------------ reports

    def _is_timely(self, report: Report) -> bool:
        lag = self.batch.lag(report.t_ns)
        if -1.0 <= lag <= self._config.late_horizon_s:
            return True
        self.verdicts[Verdict.TOO_OLD if lag > 0 else Verdict.TOO_NEW] += 1
        return False

    def _limit_reports(self, reports: list[Report]) -> list[Report]:
        """Return the reports that there is room for; distant tracks give way to near aircraft."""
        r = self.batch.belief().mean[:, :3]
        gone, left = make_room(self.tracks, r, self._own_r, reports, self._config.max_reported)
        self._remove(gone, Reason(Cause.DISPLACED, "nearer aircraft have taken its place"))
        self.verdicts[Verdict.FULL] += len(reports) - len(left)
        return left

    def _execute(self, association: ReportAssociation) -> None:
        if association.updates is not None:
            self.batch.apply(association.rows, association.updates, association.chosen)
        for decision in association.decisions:
            match decision:
                case Fuse(report, row, measurement):
                    self.verdicts[measurement.verdict] += 1
                    self.tracks[row] = self.tracks[row].reported(report, measurement)
                case Reject(row, measurement, outliers):
                    self.verdicts[measurement.verdict] += 1
                    self.tracks[row] = self.tracks[row]._replace(measurement=measurement, outliers=outliers)
                case Restart():
                    self._restart(decision)
                case Adopt():
                    self._adopt(decision)
                case Begin():
                    self._begin_with_report(decision)

    def _restart(self, decision: Restart) -> None:
        report, row = decision.report, decision.row
        track, (mean, covariance) = self.tracks[row], self.batch.belief()
        for source, echo_ns in track.sources.items() if decision.split else ():
            if source.startswith("radar/") and echo_ns == track.fused_ns:
                self._begin(Belief(mean[row], covariance[row]), None, echo_ns, source)
        self.batch.restart(row, self._belief_from_report(report))
        self.tracks[row] = track.fused(report.t_ns, report.source)._replace(resets=track.resets + 1)

    def _adopt(self, decision: Adopt) -> None:
        report, row = decision.report, decision.row
        track, name = self.tracks[row], name_of(decision.report.key, self.tracks[row].number)
        self.batch.apply(decision.rows, decision.updates, np.array([decision.place]))
        if track.sequence:
            self._ended.append(last_estimate(track, self.batch.t_ns, Reason(Cause.RENAMED, f"it is {name}")))
        named = track._replace(target=name, key=report.key).with_first_report(report)
        self.tracks[row] = named.fused(report.t_ns, report.source)
        self.verdicts[Verdict.FUSED] += 1

    def _begin_with_report(self, decision: Begin) -> None:
        report, copy = decision.report, decision.copy
        belief = self._belief_from_report(report)
        if self._begin(belief, report.key, report.t_ns, report.source, copy):
            self.tracks[-1] = self.tracks[-1].with_first_report(report)
        if copy > 1:
            same = [i for i, t in enumerate(self.tracks) if t.key == report.key]
            for i in same:
                self.tracks[i] = self.tracks[i]._replace(address_shared=True)

    def _belief_from_report(self, report: Report) -> Belief:
        lag = self.batch.lag(report.t_ns)
        return belief_from_report(report, lag, self.registration.residual.covariance, self._config)

    # -------------------------------------------------------------------------------------------------- scans

    def _registered(self, radar: Radar, echoes: Echoes) -> tuple[Radar, Echoes]:
        """Return the radar after registration, and the echoes with the added noise."""
        sigma = np.hypot(echoes.sigma, self.registration.echo_jitter(echoes.polar, radar.R_rn))
        return Radar(radar.r, self.registration.corrected(radar.R_rn)), Echoes(echoes.polar, sigma)

    def _associate(
        self, echoes: Echoes, scan: RadarScan, radar: Radar, *, established: bool
    ) -> tuple[Places, Places]:
        rows = candidate_rows(self.tracks, scan.t_ns, self._config, established=established)
        lag = self.batch.lag(scan.t_ns)
        return associate_echoes(rows, echoes, self.batch.belief(), lag, radar, self._config)

    def _register(self, rows: Places, echoes: Echoes, t_ns: int, radar: Radar) -> None:
        """Estimate our own attitude's error from aircraft with both an echo and a report."""
        anchors = anchor_echoes(rows, echoes, self.tracks, self.batch.belief(), t_ns, radar, self._config)
        rotation = self.registration.update(t_ns, anchors, radar.r)
        if rotation is not None:
            self.batch.correct_attitude_error(rotation)

    def _fuse_echoes(self, rows: Places, echoes: Echoes, scan: RadarScan, radar: Radar) -> set[int]:
        """Correct the tracks in these rows by an echo each.

        Returns the rows where that was possible.
        """
        if not len(rows):
            return set()
        updates = self.batch.evaluate_echoes(rows, self.batch.lag(scan.t_ns), *echoes, radar)
        fine = np.flatnonzero(np.isfinite(updates.nis))
        self.batch.apply(rows, updates, fine)
        self.verdicts[Verdict.FUSED] += len(fine)
        self.verdicts[Verdict.NUMERICAL] += len(rows) - len(fine)
        source = f"radar/{scan.radar}"
        for place in fine.tolist():
            row = rows[place]
            measurement = measurement_report(
                scan, source, scan.t_ns, Verdict.FUSED, updates, place, self._config, polar=self.batch.polar
            )
            self.tracks[row] = self.tracks[row].fused(scan.t_ns, source)._replace(measurement=measurement)
        return set(rows[fine].tolist())

    def _count_scan(self, hits: set[int]) -> list[int]:
        """Count a scan for every track. Returns the rows of tracks that it has established."""
        before = self.tracks
        self.tracks = [track.scanned(hit=i in hits, config=self._config) for i, track in enumerate(before)]
        return [i for i, t in enumerate(self.tracks) if t.established and not before[i].established]

    def _begin_with_echo(self, echo: Echoes, scan: RadarScan, radar: Radar) -> None:
        covariance = self.registration.residual.covariance
        belief = belief_from_echo(*echo, radar, self.batch.lag(scan.t_ns), covariance, self._config)
        if self._begin(belief, None, scan.t_ns, f"radar/{scan.radar}"):
            self.tracks[-1] = self.tracks[-1].scanned(hit=True, config=self._config)

    def _continue(self, found: list[int], t_ns: int) -> None:
        """Merge new tracks with the older ones that they continue."""
        if not found:
            return
        same = continuations(found, self.tracks, belief := self.batch.belief(), t_ns, self._config)
        for new, row in same:
            self.batch.restart(row, Belief(belief.mean[new], belief.covariance[new]))
            self.tracks[row] = self.tracks[row].merged(self.tracks[new])
        self._remove([new for new, _ in same], Reason(Cause.RENAMED, "it continues another track"))

    # ------------------------------------------------------------------------------------------------- tracks

    def _begin(self, belief: Belief, key: Key | None, t_ns: int, source: str, copy: int = 1) -> bool:
        """Append a track, unless there are as many as configured."""
        if len(self.tracks) >= self._config.max_tracks:
            self.verdicts[Verdict.FULL] += 1
            return False
        self.batch.add(belief)
        self._last_number += 1
        name = name_of(key, self._last_number, copy)
        self.tracks.append(Track(name, key, self._last_number, t_ns, {}).fused(t_ns, source))
        self.verdicts[Verdict.INITIALISING] += 1
        return True

    def _remove(self, rows: Iterable[int], why: Reason) -> None:
        """Remove tracks; those that have been published get a last estimate."""
        removed = set(rows)
        if not removed:
            return
        gone = [self.tracks[i] for i in sorted(removed)]
        self._ended += [last_estimate(track, self.batch.t_ns, why) for track in gone if track.sequence]
        kept = [i for i in range(len(self.tracks)) if i not in removed]
        self.tracks = [self.tracks[i] for i in kept]
        self.batch.keep(np.array(kept, np.int64))
