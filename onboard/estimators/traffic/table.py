"""The tracks there are, each with its filter in the batch, and what became of every measurement."""

from collections import Counter
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.batch import Batch, Judged
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.filter import choose
from onboard.estimators.traffic.publication import farewell
from onboard.estimators.traffic.registration import Registration
from onboard.estimators.traffic.reports import Key
from onboard.estimators.traffic.track import NS, Track, name_of
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Estimate, MeasurementReport, Message, Verdict
from onboard.models import intruder

ECHO: Final = 3  # components of an echo
REPORT: Final = 6  # and of a report
REMEMBERED_S: Final = 3.0  # twice the time in which a track that hears a report a second forgets its velocity
UNHEARD: Final = np.full(3, np.inf)  # m: how far off the reports of an aircraft are that has said nothing


def gust_walk(sigma: Array, time_s: float) -> Array:
    """By how much velocity walks (3,), m/s per square root of a second, where gusts of these sigmas (3,), m/s,
    come and go with this time constant: as far, over `REMEMBERED_S`, as they change it in that time."""
    return np.asarray(sigma * np.sqrt(2.0 * (1.0 - np.exp(-REMEMBERED_S / time_s)) / REMEMBERED_S))


class Table:
    """`tracks[i]` has the filter in row i of `batch`. `farewells` wait to be told."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.verdicts: Counter[str] = Counter()
        self.tracks: list[Track] = []
        self.farewells: list[Estimate] = []
        self.registration = Registration(config)
        c = config
        gust = gust_walk(np.array([c.gust_m_s, c.gust_m_s, c.gust_vertical_m_s]), c.gust_time_s)
        drift = c.own_position_sigma_m * np.sqrt(2.0 / c.own_position_time_s)
        modes = (
            (c.quiet_acceleration_m_s2, c.quiet_time_s, True, c.quiet_lasts_s),
            (c.changing_acceleration_m_s2, c.changing_time_s, True, c.changing_lasts_s),
            (c.manoeuvre_acceleration_m_s2, c.manoeuvre_time_s, False, c.manoeuvre_lasts_s),
        )
        noises = [
            intruder.Noise(self._accelerations(size), time, keeps_turn, gust, drift, c.report_bias_time_s)
            for size, time, keeps_turn, _ in modes
        ]
        self.batch = Batch(choose(c.filter, noises, [lasts for *_, lasts in modes]))
        self.gates = {m: chi_square_threshold(config.gate_probability, m) for m in (ECHO, REPORT)}
        self._numbers = 0

    def lag(self, t_ns: int) -> float:
        """How much older a measurement is than the filters, s; negative if it is newer."""
        return (self.batch.t_ns - t_ns) / NS

    def first_covariance(self) -> Array:
        """What is known of an aircraft of which nothing is known but where it is: (15, 15), without its place."""
        c = self.config
        accelerations = self._accelerations(c.manoeuvre_acceleration_m_s2)
        speeds = np.full(3, c.initial_speed_sigma_m_s)
        covariance = np.diag(np.concatenate([np.zeros(3), speeds, accelerations, np.ones(3), np.zeros(3)]) ** 2)
        covariance[intruder.TURNED, intruder.TURNED] = self.registration.residual.covariance
        return covariance

    def _accelerations(self, size: float) -> Array:
        """On each axis (3,), of horizontal ones of this size."""
        return size * np.array([1.0, 1.0, self.config.vertical_share])

    def advance(self, t_ns: int) -> None:
        """Predict every track to a time."""
        bias = np.array([UNHEARD if t.report is None else t.report.bias for t in self.tracks]).reshape(-1, 3)
        shared = self.registration.shared([t.number for t in self.tracks], bias)
        failed = self.batch.advance(t_ns, self.registration.residual, intruder.Reports(bias, shared))
        if len(failed):
            self.verdicts[Verdict.NUMERICAL] += len(failed)
            self.drop(set(failed.tolist()), "the covariance was lost")

    def begin(
        self, mean: Array, covariance: Array, key: Key | None, t_ns: int, source: str, copy: int = 1
    ) -> bool:
        """One more track, unless there are as many as may be."""
        if len(self.tracks) >= self.config.max_tracks:
            self.verdicts[Verdict.FULL] += 1
            return False
        self.batch.add(mean, covariance)
        self._numbers += 1
        track = Track(name_of(key, self._numbers, copy), key, t_ns, self._numbers)
        track.fuse(t_ns, source)
        self.tracks.append(track)
        self.verdicts[Verdict.INITIALISING] += 1
        return True

    def forget(self, now_ns: int) -> None:
        """Drop what has not been heard or seen for long, or never came to anything."""
        hopeless = {i for i, t in enumerate(self.tracks) if t.hopeless(now_ns, self.config)}
        if hopeless:
            self.drop(hopeless, "nothing heard or seen of it for long")

    def drop(self, rows: set[int], reason: str) -> None:
        """Forget tracks; those that were told of are said farewell."""
        gone = [self.tracks[i] for i in sorted(rows)]
        self.farewells += [farewell(track, self.batch.t_ns, reason) for track in gone if track.sequence]
        kept = [i for i in range(len(self.tracks)) if i not in rows]
        self.tracks = [self.tracks[i] for i in kept]
        self.batch.keep(np.array(kept, np.int64))

    def clear(self, reason: str) -> None:
        """Forget all tracks and the time."""
        self.drop(set(range(len(self.tracks))), reason)
        self.batch.clear()
        self.registration.clear()

    def said(
        self, message: Message, source: str, t_ns: int, verdict: Verdict, judged: Judged, p: int
    ) -> MeasurementReport:
        """What the judged measurement p was, and what became of it."""
        predicted, innovation = judged.predicted[p], judged.innovation[p]
        echo = len(predicted) == ECHO
        components, units = intruder.COMPONENTS[: len(predicted)], intruder.UNITS[: len(predicted)]
        if echo and self.batch.polar:
            components, units = intruder.POLAR, intruder.POLAR_UNITS
        return MeasurementReport(
            source=source,
            t_ns=t_ns,
            t_recv_ns=message.t_recv_ns,
            verdict=verdict,
            components=components,
            units=units,
            measured=tuple((predicted + innovation).tolist()),
            predicted=tuple(predicted.tolist()),
            innovation=tuple(innovation.tolist()),
            innovation_sigma=tuple(np.sqrt(np.diagonal(judged.covariance[p])).tolist()),
            nis=float(judged.nis[p]),
            gate=self.gates[len(predicted)],
        )
