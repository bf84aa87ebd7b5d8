"""Accuracy of traffic tracks against a simulator's truth: which track follows which aircraft, times without a
track, tracks that change aircraft, predictions of the closest approach, and coverage of the 95 % ellipsoid.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Estimate, TrafficTruth
from onboard.units import NS_PER_S

LEAD_S: Final = 10.0  # the prediction this long before the closest approach is compared with it
NEAR_M: Final = 1000.0  # closest approaches beyond are no encounters
CLOSE_M: Final = 15.0  # an error up to this is small ...
CLOSE_SHARE: Final = 0.1  # ... or up to this share of the distance
SETTLE_S: Final = 5.0  # of a track, before its ellipsoid is judged
TRACKABLE_S: Final = 3.0  # an aircraft with a detection or message this recent can be tracked
KNOWN_S: Final = 10.0  # detections or messages must have come all this time for a prediction to count
BEGIN_S: Final = 4.0  # allowed for a new aircraft without a track
SWAPPED_S: Final = 1.0  # a track on another aircraft for this long is swapped
APART: Final = chi_square_threshold(0.9999, 3)


class Encounter(NamedTuple):
    """A closest approach: its time (s on the boot clock), its distance (m), and the distance predicted `LEAD_S`
    before (NaN without a valid track then). `known`: detections or messages had come all the time before that."""

    t: float
    distance: float
    predicted: float
    known: bool = True

    @property
    def predicted_well(self) -> bool:
        """Whether the prediction is within 15 m or 10 %."""
        return abs(self.predicted - self.distance) <= max(CLOSE_M, CLOSE_SHARE * self.distance)


class AircraftScore(NamedTuple):
    """One aircraft: the `tracks` that followed it, in order; samples judged, and how many of them were inside the
    95 % ellipsoid; seconds in which it could be tracked and no valid track followed it; RMS position error, m; and
    all seconds in which it could be tracked."""

    name: str
    tracks: tuple[str, ...]
    samples: int
    inside: int
    missing_s: float
    rmse: float
    encounters: tuple[Encounter, ...]
    trackable_s: float


class TrafficScore(NamedTuple):
    """All aircraft; tracks that changed aircraft; tracks of nothing, with their samples."""

    aircraft: tuple[AircraftScore, ...]
    swaps: tuple[str, ...]
    false_tracks: dict[str, int]


class _Sample(NamedTuple):
    """One estimate of a track: time (s), and squared Mahalanobis distance to each aircraft (aircraft,)."""

    t: float
    estimate: Estimate
    d2: Array


_Tracks = dict[str, list[_Sample]]  # by name


class _Truth:
    """The truth as arrays: relative positions and velocities (times, aircraft, 3), and how many messages and
    detections of each aircraft there have been (times, aircraft)."""

    def __init__(self, truth: Sequence[TrafficTruth]) -> None:
        self.t = np.array([x.t_ns for x in truth]) / NS_PER_S
        self.names = [a.name for a in truth[0].intruders]
        self.targets = [a.target for a in truth[0].intruders]
        self.r = np.array([[a.r_FT_n for a in x.intruders] for x in truth])
        self.v = np.array([[a.v_FT_n for a in x.intruders] for x in truth])
        self.received = np.array([[a.messages + a.detections for a in x.intruders] for x in truth])

    def at(self, t: float) -> Array:
        """Relative positions (aircraft, 3), interpolated by cubics through positions and velocities."""
        i = int(np.clip(np.searchsorted(self.t, t) - 1, 0, len(self.t) - 2))
        h = self.t[i + 1] - self.t[i]
        u = (t - self.t[i]) / h
        a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
        return np.asarray(
            a * self.r[i] + (1 - a) * self.r[i + 1] + h * (b * self.v[i] + (u**3 - u**2) * self.v[i + 1])
        )


def score_traffic(estimates: Iterable[Estimate], truths: Sequence[TrafficTruth]) -> TrafficScore:
    """The score of a flight: estimates of traffic in order of time, and the truth at some 10 Hz."""
    truth = _Truth(truths)
    tracks: _Tracks = defaultdict(list)
    for e in estimates:
        t = e.t_ns / NS_PER_S
        if e.intruder is None or not e.valid or e.mean is None or not truth.t[0] <= t <= truth.t[-1]:
            continue
        off = truth.at(t) - np.array(e.mean[:3])
        P = np.array(e.covariance)[:3, :3]
        tracks[e.target].append(_Sample(t, e, np.einsum("ki,ki->k", off, np.linalg.solve(P, off.T).T)))
    owner: dict[str, int] = {}
    false_tracks = {}
    for name, samples in tracks.items():
        index = _owner(name, samples, truth)
        if index is None:
            false_tracks[name] = len(samples)
        else:
            owner[name] = index
    return TrafficScore(
        tuple(
            _score_aircraft(k, truth, {name: tracks[name] for name, index in owner.items() if index == k})
            for k in range(len(truth.names))
        ),
        tuple(name for name, index in owner.items() if _swapped(tracks[name], index)),
        false_tracks,
    )


def _owner(name: str, samples: list[_Sample], truth: _Truth) -> int | None:
    """Index of the aircraft that a track follows: the one with the address in its name, otherwise the nearest at
    its start; None if that is too far."""
    for k, target in enumerate(truth.targets):
        if target and name.split("-", maxsplit=1)[0] == target:
            return k
    first = np.mean([sample.d2 for sample in samples[:10]], axis=0)
    nearest = int(np.argmin(first))
    return nearest if first[nearest] < APART else None


def _swapped(samples: list[_Sample], owner: int) -> bool:
    """Whether for a while the track was on another aircraft and not on its own."""
    since = None
    for t, _, d2 in samples:
        other = np.delete(d2, owner).min()
        if d2[owner] > APART and other < APART:
            since = t if since is None else since
            if t - since >= SWAPPED_S:
                return True
        else:
            since = None
    return False


def _score_aircraft(k: int, truth: _Truth, tracks: _Tracks) -> AircraftScore:
    gate = chi_square_threshold(0.95, 3)
    samples = inside = 0
    squared = []
    times: list[float] = []
    for track in tracks.values():
        for t, e, d2 in track:
            times.append(t)
            if t - track[0].t < SETTLE_S:
                continue
            samples += 1
            inside += bool(d2[k] <= gate)
            assert e.mean is not None  # noqa: S101 - estimates without a mean were left out
            squared.append(float(np.sum((truth.at(t)[k] - np.array(e.mean[:3])) ** 2)))
    missing, trackable = _missing(truth, k, np.sort(times))
    return AircraftScore(
        truth.names[k],
        tuple(sorted(tracks, key=lambda name: tracks[name][0].t)),
        samples,
        inside,
        missing,
        float(np.sqrt(np.mean(squared))) if squared else float("nan"),
        tuple(_encounters(truth, k, tracks)),
        trackable,
    )


def _missing(truth: _Truth, k: int, times: Array) -> tuple[float, float]:
    """Seconds without a valid track of an aircraft that had had detections or messages for a while, and all
    seconds in which it had."""
    missing, total, since = 0.0, 0.0, None
    for i in range(1, len(truth.t)):
        t = truth.t[i]
        past = int(np.searchsorted(truth.t, t - TRACKABLE_S))
        if truth.received[i, k] <= truth.received[past, k]:
            since = None
            continue
        since = t if since is None else since
        j = int(np.searchsorted(times, t + 0.05))
        tracked = j > 0 and t - times[j - 1] < 0.5
        if t - since > BEGIN_S:
            total += t - truth.t[i - 1]
            missing += 0.0 if tracked else t - truth.t[i - 1]
    return float(missing), float(total)  # a report must be written


def _encounters(truth: _Truth, k: int, tracks: _Tracks) -> Iterator[Encounter]:
    """The closest approaches of an aircraft, at most `NEAR_M` away."""
    distance = np.linalg.norm(truth.r[:, k], axis=1)
    for i in range(1, len(distance) - 1):
        if not (distance[i - 1] > distance[i] <= distance[i + 1] and distance[i] < NEAR_M):
            continue
        t = float(truth.t[i])
        if t - truth.t[0] < LEAD_S + SETTLE_S:
            continue
        predicted = float("nan")
        for track in tracks.values():
            near = [sample.estimate for sample in track if abs(sample.t - (t - LEAD_S)) <= 0.06]
            if near and near[0].intruder is not None:
                predicted = near[0].intruder.approach.distance
        yield Encounter(t, float(distance[i]), predicted, _known(truth, k, t - LEAD_S))


def _known(truth: _Truth, k: int, t: float) -> bool:
    """Whether detections or messages of an aircraft came in every few of the last seconds before t."""
    ends = np.arange(t, max(t - KNOWN_S, truth.t[0] + TRACKABLE_S), -0.5)
    now, before = np.searchsorted(truth.t, ends), np.searchsorted(truth.t, ends - TRACKABLE_S)
    return bool((truth.received[now, k] > truth.received[before, k]).all())
