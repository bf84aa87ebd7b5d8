"""Radar scans to tracks: echoes go to the tracks they fit best, those that are settled first; of the rest new
tracks begin, most of which come to nothing."""

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.batch import NONE, Radar
from onboard.estimators.traffic.frame import Frame
from onboard.estimators.traffic.registration import Sight
from onboard.estimators.traffic.table import ECHO, REPORT, Table
from onboard.estimators.traffic.track import NS
from onboard.filters.association import Places, assign, candidates
from onboard.filters.gating import normalised_squared
from onboard.geometry.rotations import matrix_from_euler
from onboard.messages import RadarScan, Verdict
from onboard.models import intruder
from onboard.ownship import Ownship


class Seeing:
    """A radar on our vehicle."""

    def __init__(self, table: Table) -> None:
        self._table = table
        c = table.config
        self._R_rb = matrix_from_euler(*np.radians(c.radar_mount_rpy_deg)).T
        azimuth, elevation = np.radians([c.radar_azimuth_sigma_deg, c.radar_elevation_sigma_deg]).tolist()
        self._echo_sigma = (c.radar_range_sigma_m, azimuth, elevation)

    def scan(self, scan: RadarScan, frame: Frame, ownship: Ownship) -> None:
        """One radar scan: echoes to tracks, those that are settled first, and new tracks of the rest."""
        own = frame.own(scan.t_ns, ownship) if frame.known else None
        if own is None:
            self._table.verdicts[Verdict.NO_POSE] += len(scan.detections)
            return
        if self._table.lag(scan.t_ns) > self._table.config.late_horizon_s and self._table.tracks:
            self._table.verdicts[Verdict.TOO_OLD] += len(scan.detections)
            return
        self._table.advance(scan.t_ns)
        R_rn = self._R_rb @ own.R_nb.T if scan.frame == "body" else own.R_nl.T
        offset = own.R_nb @ np.array(self._table.config.radar_offset_m)
        nominal = Radar(own.r + offset, np.ascontiguousarray(R_rn))
        measured = np.array([(d.range, d.azimuth, d.elevation) for d in scan.detections]).reshape(-1, 3)
        sigma = self._sigma(scan, measured)
        self._table.registration.advance(scan.t_ns)
        radar, noisy = self._registered(nominal, measured, sigma)
        rows, echoes = self._associate(self._near(scan.t_ns, settled=True), measured, noisy, scan, radar)
        self._register(rows, measured[echoes], sigma[echoes], scan.t_ns, nominal)
        radar, noisy = self._registered(nominal, measured, sigma)
        seen = self._take(rows, measured[echoes], noisy[echoes], scan, radar)
        free = np.delete(np.arange(len(measured)), echoes)
        rows, echoes = self._associate(
            self._near(scan.t_ns, settled=False), measured[free], noisy[free], scan, radar
        )
        seen |= self._take(rows, measured[free[echoes]], noisy[free[echoes]], scan, radar)
        free = np.delete(free, echoes)
        found = [i for i, t in enumerate(self._table.tracks) if t.scan(hit=i in seen, config=self._table.config)]
        for j in free:
            self._begin_with(measured[[j]], noisy[[j]], scan.t_ns, radar, f"radar/{scan.radar}")
        self._stitch(found, scan.t_ns)

    def _near(self, t_ns: int, *, settled: bool) -> Places:
        """Rows of tracks that an echo may be of. What has coasted for long has a wide gate, and would take the
        first false alarm in it for itself."""
        since_ns = t_ns - round(self._table.config.relock_after_s * NS)
        tracks = enumerate(self._table.tracks)
        return np.array([i for i, t in tracks if t.settled is settled and t.fused_ns >= since_ns], np.int64)

    def _registered(self, radar: Radar, measured: Array, sigma: Array) -> tuple[Radar, Array]:
        """The radar as our attitude is now thought to be, and its noise (k, 3) with what is not known of that."""
        registration = self._table.registration
        noisy = np.hypot(sigma, registration.jitter(measured, radar.R_rn))
        return Radar(radar.r, registration.turned_back(radar.R_rn)), noisy

    def _register(self, rows: Places, measured: Array, sigma: Array, t_ns: int, radar: Radar) -> None:
        """Learn of our own attitude from those that also say where they are."""
        table = self._table
        fresh_ns = round(table.config.coast_after_s * NS)
        places = intruder.position(measured, *radar)
        noise = intruder.position_noise(measured, sigma, radar.R_rn)
        mean, covariance = table.batch.belief()
        tracks = [table.tracks[i] for i in rows]
        reports = [(k, t.report) for k, t in enumerate(tracks) if t.report and t_ns - t.report.t_ns <= fresh_ns]
        age = np.array([(t_ns - report.t_ns) / NS for _, report in reports])
        of = rows[[k for k, _ in reports]]
        since, unsure = intruder.gone(mean[of], covariance[of], age)
        sights = [
            Sight(tracks[k].number, places[k], report.y[:3] + since[j], noise[k] + unsure[j], report)
            for j, (k, report) in enumerate(reports)
        ]
        told = table.registration.scan(t_ns, sights, radar.r)
        if told is not None:
            table.batch.registered(told)

    def _sigma(self, scan: RadarScan, measured: Array) -> Array:
        """Standard deviations (k, 3) of echoes (k, 3): the radar's, and that an aircraft is no point."""
        sigma = np.array([d.sigma or self._echo_sigma for d in scan.detections]).reshape(-1, 3)
        near = np.maximum(measured[:, 0], 1.0)
        level = np.maximum(near * np.cos(measured[:, 2]), 1.0)
        glint = self._table.config.radar_glint_m / np.stack([np.ones_like(near), level, near], axis=1)
        sigma = np.hypot(sigma, glint)
        if not self._table.batch.polar:  # a filter of places cannot tell what is turned from noise
            sigma[:, 1:] = np.hypot(sigma[:, 1:], np.sqrt(self._table.registration.residual.covariance.max()))
        return np.asarray(sigma)

    def _stitch(self, found: list[int], t_ns: int) -> None:
        """Tracks just found that go on where one that coasts should be are that one, seen again."""
        table = self._table
        coasting = [
            i
            for i, t in enumerate(table.tracks)
            if t.settled and t_ns - t.fused_ns > table.config.relock_after_s * NS
        ]
        merged: set[int] = set()
        for i in found:
            if not coasting:
                break
            mean, covariance = table.batch.belief()
            off = mean[coasting, :6] - mean[i, :6]
            nis = normalised_squared(off, covariance[coasting, :6, :6] + covariance[i, :6, :6])
            best = int(np.argmin(nis))
            if nis[best] > table.gates[REPORT]:
                continue
            row = coasting.pop(best)
            known, fresh = table.tracks[row], table.tracks[i]
            table.batch.restart(row, mean[i], covariance[i])
            known.hits, known.scans = fresh.hits, fresh.scans
            for source, seen_ns in fresh.sources.items():
                known.fuse(seen_ns, source)
            merged.add(i)
        if merged:
            table.drop(merged, "it is another track, seen again")

    def _associate(
        self, rows: Places, measured: Array, sigma: Array, scan: RadarScan, radar: Radar
    ) -> tuple[Places, Places]:
        """(rows of tracks, the echoes they fit best)."""
        if not len(rows) or not len(measured):
            return NONE, NONE
        belief, lag = self._table.batch.belief(), self._table.lag(scan.t_ns)
        polar, spread = intruder.expected(belief.mean[rows], belief.covariance[rows], lag, *radar)
        pairs = candidates(polar, spread, measured, sigma**2, self._table.gates[ECHO])
        which, echoes = assign(*pairs)
        return rows[which], echoes

    def _take(self, at: Places, measured: Array, sigma: Array, scan: RadarScan, radar: Radar) -> set[int]:
        """Correct tracks in these rows by an echo each; the rows where it could be done."""
        if not len(at):
            return set()
        judged = self._table.batch.judge_echoes(at, self._table.lag(scan.t_ns), measured, sigma, radar)
        fine = np.flatnonzero(np.isfinite(judged.nis))
        self._table.batch.correct(at, judged, fine)
        self._table.verdicts[Verdict.FUSED] += len(fine)
        self._table.verdicts[Verdict.NUMERICAL] += len(at) - len(fine)
        source = f"radar/{scan.radar}"
        for p in fine.tolist():
            track = self._table.tracks[at[p]]
            track.fuse(scan.t_ns, source)
            track.said = self._table.said(scan, source, scan.t_ns, Verdict.FUSED, judged, p)
        return set(at[fine].tolist())

    def _begin_with(self, polar: Array, sigma: Array, t_ns: int, radar: Radar, source: str) -> None:
        covariance = self._table.first_covariance()
        place = intruder.position(polar, *radar)[0]
        # seen at place = r + w x d + noise, with the rotation w of which nothing is known yet but its size
        across, turned = intruder.crossing(place - radar.r), covariance[intruder.TURNED, intruder.TURNED]
        covariance[intruder.R, intruder.R] = intruder.position_noise(polar, sigma, radar.R_rn)[0]
        covariance[intruder.R, intruder.R] += across @ turned @ across.T
        covariance[intruder.R, intruder.TURNED] = across @ turned
        covariance[intruder.TURNED, intruder.R] = covariance[intruder.R, intruder.TURNED].T
        mean = np.concatenate([place, np.zeros(intruder.N - 3)])
        F = np.eye(intruder.N)
        F[:9, :9] = intruder.back(-self._table.lag(t_ns))
        covariance = F @ covariance @ F.T
        if self._table.begin(mean, covariance, None, t_ns, source):
            self._table.tracks[-1].scan(hit=True, config=self._table.config)
