"""Reports to tracks. An address is an identity: what it says goes to its own track, or to a second one of the same
address, and to no other."""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.batch import Judged
from onboard.estimators.traffic.frame import Frame
from onboard.estimators.traffic.publication import farewell
from onboard.estimators.traffic.reports import Heard, Key, Report, report_of, same_again
from onboard.estimators.traffic.table import REPORT, Table
from onboard.estimators.traffic.track import NS, name_of
from onboard.filters.association import Places
from onboard.messages import AdsbVehicle, PeerRanges, Verdict
from onboard.models import intruder

STRAYS: Final = 3  # reports that fit each other and not their track, before they are believed ...
STRAYS_WITHIN_S: Final = 5.0  # ... when no two are farther apart: one in a thousand strays by chance
SAME_PLACE_M: Final = 100.0  # from its track a report is of the same aircraft, and the filter has lagged
COPIES: Final = 4  # tracks of one address
ADOPTED_WITHIN: Final = 1000.0  # m: how far a report may be from the radar track whose name it gives
LOOK_BACK: Final = 0.02  # share of a manoeuvre's variance that comes and goes within a second
WAITING: Final = 5000  # reports; more in a tenth of a second is a flood


class Hearing:
    """Reports wait here until they are fused together."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._waiting: list[Report] = []

    def hear(self, message: Heard, frame: Frame) -> None:
        """Take a message in, or count why not."""
        near = self._near(message) if isinstance(message, PeerRanges) else None
        report = report_of(message, frame, self._table.config, near)
        if isinstance(report, Verdict):
            self._table.verdicts[report] += 1
        elif len(self._waiting) >= WAITING:
            self._table.verdicts[Verdict.FULL] += 1
        else:
            self._waiting.append(report)

    def _near(self, message: PeerRanges) -> Array | None:
        """Where the track of this peer was then, if there is one."""
        for i, track in enumerate(self._table.tracks):
            if track.key == ("system", message.peer):
                mean = self._table.batch.belief().mean[[i]]
                return np.asarray(intruder.located(mean, np.array([self._table.lag(message.t_ns)]))[0])
        return None

    def clear(self) -> None:
        """Forget what waits."""
        self._waiting.clear()

    def fuse(self) -> None:
        """All reports that wait: one of each address at a time, so that each is judged by a track that knows of
        those before it."""
        waiting, self._waiting = self._waiting, []
        while waiting:
            now: dict[Key, Report] = {}
            later = []
            for report in waiting:
                if report.key in now:
                    later.append(report)
                else:
                    now[report.key] = report
            self._fuse([r for r in now.values() if self._is_timely(r)])
            waiting = later

    def _is_timely(self, report: Report) -> bool:
        lag = self._table.lag(report.t_ns)
        if -1.0 <= lag <= self._table.config.late_horizon_s:
            return True
        self._table.verdicts[Verdict.TOO_OLD if lag > 0 else Verdict.TOO_NEW] += 1
        return False

    def _fuse(self, reports: list[Report]) -> None:
        """Reports of different addresses, each to the track of its own that it fits best."""
        owners: dict[Key, list[int]] = {}
        for i, track in enumerate(self._table.tracks):
            if track.key is not None:
                owners.setdefault(track.key, []).append(i)
        pairs = [(k, i) for k, r in enumerate(reports) for i in owners.get(r.key, ())]
        unknown = [r for r in reports if r.key not in owners]
        if pairs:
            judged, rows = self._judge([reports[k] for k, _ in pairs], [i for _, i in pairs])
            best: dict[int, int] = {}  # report -> the pair that fits best
            for p, (k, _) in enumerate(pairs):
                if k not in best or judged.nis[p] < judged.nis[best[k]]:
                    best[k] = p
            chosen = [p for k, p in best.items() if self._accept(reports[k], pairs[p][1], judged, p)]
            self._table.batch.correct(rows, judged, np.array(chosen, np.int64))
            for k, p in best.items():
                if p not in chosen and reports[k].key in owners:
                    self._stray(reports[k], pairs[p][1], len(owners[reports[k].key]))
        for report in unknown:
            if not self._adopt(report):
                self._begin_with(report, 1)

    def _judge(self, reports: list[Report], rows: list[int]) -> tuple[Judged, Places]:
        lag = np.array([self._table.lag(r.t_ns) for r in reports])
        R = np.stack([r.R for r in reports])
        # what the aircraft may have done since, which the look back leaves out
        push = self._table.config.manoeuvre_acceleration_m_s2**2
        for i in range(3):
            R[:, i, i] += push * LOOK_BACK * lag**4
            R[:, 3 + i, 3 + i] += push * LOOK_BACK * lag**2
        at = np.array(rows, np.int64)
        y, bias = np.stack([r.y for r in reports]), np.stack([r.bias for r in reports])
        return self._table.batch.judge_reports(at, lag, y, R, bias), at

    def _accept(self, report: Report, row: int, judged: Judged, p: int) -> bool:
        """Whether a report fits its track; what it is told of, either way."""
        track, nis = self._table.tracks[row], float(judged.nis[p])
        repeated = same_again(report.message, track.heard)
        verdict = Verdict.FUSED if nis <= self._table.gates[REPORT] else Verdict.GATED
        if repeated:
            verdict = Verdict.DUPLICATE
        elif verdict is Verdict.GATED and self._is_far(report, row):
            verdict = Verdict.IMPLAUSIBLE
        self._table.verdicts[verdict] += 1
        source = report.source
        track.said = self._table.said(report.message, source, report.t_ns, verdict, judged, p)
        if verdict is Verdict.FUSED:
            track.fuse(report.t_ns, source)
            track.reports += 1
            track.report = report
            track.confirmed = track.confirmed or track.reports >= 2
            track.heard = report.message if isinstance(report.message, AdsbVehicle) else track.heard
        return verdict is Verdict.FUSED

    def _is_far(self, report: Report, row: int) -> bool:
        """Whether nothing flies from its track to where a report says it is in the time between."""
        elapsed = max(abs(report.t_ns - self._table.tracks[row].fused_ns) / NS, 1.0)
        return self._off(report, row) > self._table.config.max_speed_m_s * elapsed + SAME_PLACE_M

    def _off(self, report: Report, row: int) -> float:
        """How far a report is from where its track was then, m."""
        mean = self._table.batch.belief().mean[row]
        then = intruder.located(mean[None], np.array([self._table.lag(report.t_ns)]))[0]
        return float(np.linalg.norm(report.y[:3] - then))

    def _stray(self, report: Report, row: int, copies: int) -> None:
        """A report that its track does not fit. A few that fit each other are believed. If the track has heard
        its own in the meantime, they are of another aircraft with the same address; else the track is where they
        say, and what a radar has seen in its place is somebody else."""
        track = self._table.tracks[row]
        if track.said is not None and track.said.verdict is Verdict.DUPLICATE:
            return
        if track.strays and not _follows(track.strays[-1], report):
            track.strays.clear()
        track.strays.append(report)
        if len(track.strays) < STRAYS:
            return
        first_ns = track.strays[0].t_ns
        heard = track.sources.get(report.source, 0) >= first_ns
        seen = track.fused_ns >= first_ns
        near = self._off(report, row) < SAME_PLACE_M
        track.strays.clear()
        if near or (not heard and (seen or not self._is_far(report, row))):
            if seen and not near:
                self._split(row)
            self._table.batch.restart(row, *self._first_belief(report))
            track.resets += 1
            track.fuse(report.t_ns, report.source)
        elif copies < COPIES:
            self._begin_with(report, copies + 1)
            for other in self._table.tracks:
                other.shared = other.shared or other.key == report.key

    def _split(self, row: int) -> None:
        """What a radar sees in this track's place is not who it says it is: that goes on without a name, to be
        confirmed by its own echoes, or forgotten."""
        track, (mean, covariance) = self._table.tracks[row], self._table.batch.belief()
        for source, seen_ns in track.sources.items():
            if source.startswith("radar/") and seen_ns == track.fused_ns:
                self._table.begin(mean[row], covariance[row], None, seen_ns, source)

    def _adopt(self, report: Report) -> bool:
        """Give a radar's track the name of the report that fits it, if one and only one does."""
        mean = self._table.batch.belief().mean
        rows = [
            i
            for i, t in enumerate(self._table.tracks)
            if t.key is None and t.confirmed and np.linalg.norm(mean[i, :3] - report.y[:3]) < ADOPTED_WITHIN
        ]
        if not rows:
            return False
        judged, at = self._judge([report] * len(rows), rows)
        fits = np.flatnonzero(judged.nis <= self._table.gates[REPORT])
        if len(fits) != 1:
            return False
        track = self._table.tracks[rows[fits[0]]]
        self._table.batch.correct(at, judged, fits)
        name = name_of(report.key, track.number, 1)
        if track.sequence:
            self._table.farewells.append(farewell(track, self._table.batch.t_ns, f"it is {name}"))
        track.target, track.key, track.reports = name, report.key, 1
        track.heard = report.message if isinstance(report.message, AdsbVehicle) else None
        track.fuse(report.t_ns, report.source)
        self._table.verdicts[Verdict.FUSED] += 1
        return True

    def _begin_with(self, report: Report, copy: int) -> None:
        if not self._table.begin(*self._first_belief(report), report.key, report.t_ns, report.source, copy):
            return
        track = self._table.tracks[-1]
        track.reports, track.shared = 1, copy > 1
        track.heard = report.message if isinstance(report.message, AdsbVehicle) else None

    def _first_belief(self, report: Report) -> tuple[Array, Array]:
        """What one report says: y = r + bias + noise, so that r and the bias err against each other."""
        covariance = self._table.first_covariance()
        covariance[:6, :6] = report.R
        covariance[intruder.R, intruder.R] += np.diag(report.bias**2)
        covariance[intruder.R, intruder.BIAS] = covariance[intruder.BIAS, intruder.R] = -np.diag(report.bias)
        mean = np.concatenate([report.y, np.zeros(intruder.N - 6)])
        F = np.eye(intruder.N)
        F[:9, :9] = intruder.back(-self._table.lag(report.t_ns))
        return F @ mean, F @ covariance @ F.T


def _follows(earlier: Report, later: Report) -> bool:
    """Whether two reports could be of one aircraft that flies as it says."""
    dt = (later.t_ns - earlier.t_ns) / NS
    if abs(dt) > STRAYS_WITHIN_S:
        return False
    off = later.y[:3] - earlier.y[:3] - dt * 0.5 * (earlier.y[3:] + later.y[3:])
    room = np.sqrt(np.trace(earlier.R[:3, :3] + later.R[:3, :3])) + 5.0 * abs(dt)
    return bool(np.linalg.norm(off) < 3.0 * room)
