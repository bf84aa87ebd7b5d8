"""Accuracy of traffic tracks compared with a simulator's truth.

It covers the association of tracks with aircraft, times without a track, tracks that change aircraft, predictions
of the closest approach, and coverage of the 95 % ellipsoid.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Estimate, TrafficTruth
from onboard.units import NS_PER_S

PREDICTION_HORIZON_S: Final = 10.0  # the closest approach is compared with what was predicted this long before
MAX_ENCOUNTER_DISTANCE_M: Final = 1000.0
MAX_ERROR_M: Final = 15.0  # of a good prediction ...
MAX_ERROR_RATIO: Final = 0.1  # ... or this share of the distance
SETTLING_TIME_S: Final = 5.0  # of a track, before its ellipsoid is judged
MAX_TRACKABLE_AGE_S: Final = 3.0  # of the last detection or message of an aircraft that can be tracked
MIN_KNOWN_TIME_S: Final = 10.0  # detections or messages must have come all this time for a prediction to count
TRACK_START_TIMEOUT_S: Final = 4.0  # allowed for a new aircraft without a track
MIN_SWAP_TIME_S: Final = 1.0  # of a track on another aircraft
MATCH_THRESHOLD: Final = chi_square_threshold(0.9999, 3)


class Encounter(NamedTuple):
    """A closest approach and its prediction."""

    t: float  # s on the boot clock
    distance: float  # m
    predicted: float  # m, PREDICTION_HORIZON_S before; NaN without a valid track then
    known: bool = True  # detections or messages had come all the time before that

    @property
    def predicted_well(self) -> bool:
        """Whether the prediction is within 15 m or 10 %."""
        return abs(self.predicted - self.distance) <= max(MAX_ERROR_M, MAX_ERROR_RATIO * self.distance)


class AircraftScore(NamedTuple):
    """The score of one aircraft."""

    name: str
    tracks: tuple[str, ...]  # that followed it, in order
    samples: int  # judged
    inside: int  # of the samples, in the 95 % ellipsoid
    missing_s: float  # in which it could be tracked and no valid track followed it
    rmse: float  # m, of the position
    encounters: tuple[Encounter, ...]
    trackable_s: float  # in which it could be tracked


class TrafficScore(NamedTuple):
    """All aircraft; tracks that changed aircraft; tracks of nothing, with their samples."""

    aircraft: tuple[AircraftScore, ...]
    swaps: tuple[str, ...]  # tracks that changed aircraft
    false_tracks: dict[str, int]  # of nothing, with their samples


class _Sample(NamedTuple):
    """One estimate of a track: time (s), and squared Mahalanobis distance to each aircraft."""

    t: float  # s
    estimate: Estimate
    d2: Array  # squared Mahalanobis distance to each aircraft


_Tracks = dict[str, list[_Sample]]  # by name


class _Truth:
    """The truth as arrays."""

    def __init__(self, truth: Sequence[TrafficTruth]) -> None:
        self.t = np.array([x.t_ns for x in truth]) / NS_PER_S
        self.names = [a.name for a in truth[0].intruders]
        self.targets = [a.target for a in truth[0].intruders]
        self.r = np.array([[a.r_FT_n for a in x.intruders] for x in truth])
        self.v = np.array([[a.v_FT_n for a in x.intruders] for x in truth])
        self.received = np.array([[a.messages + a.detections for a in x.intruders] for x in truth])

    def at(self, t: float) -> Array:
        """Interpolate relative positions (aircraft, 3) by cubics through positions and velocities."""
        i = int(np.clip(np.searchsorted(self.t, t) - 1, 0, len(self.t) - 2))
        h = self.t[i + 1] - self.t[i]
        u = (t - self.t[i]) / h
        a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
        return np.asarray(
            a * self.r[i] + (1 - a) * self.r[i + 1] + h * (b * self.v[i] + (u**3 - u**2) * self.v[i + 1])
        )


def score_traffic(estimates: Iterable[Estimate], truths: Sequence[TrafficTruth]) -> TrafficScore:
    """Score a flight: estimates of traffic in order of time, and the truth at about 10 Hz."""
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
    """Return the index of the aircraft that a track follows, or None if it is too far.

    It is the one with the address in its name, otherwise the nearest at its start.
    """
    for k, target in enumerate(truth.targets):
        if target and name.split("-", maxsplit=1)[0] == target:
            return k
    first = np.mean([sample.d2 for sample in samples[:10]], axis=0)
    nearest = int(np.argmin(first))
    return nearest if first[nearest] < MATCH_THRESHOLD else None


def _swapped(samples: list[_Sample], owner: int) -> bool:
    """Whether for a while the track was on another aircraft and not on its own."""
    since = None
    for t, _, d2 in samples:
        other = np.delete(d2, owner).min()
        if d2[owner] > MATCH_THRESHOLD and other < MATCH_THRESHOLD:
            since = t if since is None else since
            if t - since >= MIN_SWAP_TIME_S:
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
            if t - track[0].t < SETTLING_TIME_S:
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
    """Return the seconds without a valid track of a detectable aircraft, and all its detectable seconds.

    It must have had detections or messages for a while.
    """
    missing, total, since = 0.0, 0.0, None
    for i in range(1, len(truth.t)):
        t = truth.t[i]
        past = int(np.searchsorted(truth.t, t - MAX_TRACKABLE_AGE_S))
        if truth.received[i, k] <= truth.received[past, k]:
            since = None
            continue
        since = t if since is None else since
        j = int(np.searchsorted(times, t + 0.05))
        tracked = j > 0 and t - times[j - 1] < 0.5
        if t - since > TRACK_START_TIMEOUT_S:
            total += t - truth.t[i - 1]
            missing += 0.0 if tracked else t - truth.t[i - 1]
    return float(missing), float(total)  # a report must be written


def _encounters(truth: _Truth, k: int, tracks: _Tracks) -> Iterator[Encounter]:
    """The closest approaches of an aircraft, at most `MAX_ENCOUNTER_DISTANCE_M` away."""
    distance = np.linalg.norm(truth.r[:, k], axis=1)
    for i in range(1, len(distance) - 1):
        if not (distance[i - 1] > distance[i] <= distance[i + 1] and distance[i] < MAX_ENCOUNTER_DISTANCE_M):
            continue
        t = float(truth.t[i])
        if t - truth.t[0] < PREDICTION_HORIZON_S + SETTLING_TIME_S:
            continue
        predicted = float("nan")
        for track in tracks.values():
            near = [sample.estimate for sample in track if abs(sample.t - (t - PREDICTION_HORIZON_S)) <= 0.06]
            if near and near[0].intruder is not None:
                predicted = near[0].intruder.approach.distance
        yield Encounter(t, float(distance[i]), predicted, _known(truth, k, t - PREDICTION_HORIZON_S))


def _known(truth: _Truth, k: int, t: float) -> bool:
    """Whether detections or messages of an aircraft came regularly in the last seconds before t."""
    ends = np.arange(t, max(t - MIN_KNOWN_TIME_S, truth.t[0] + MAX_TRACKABLE_AGE_S), -0.5)
    now, before = np.searchsorted(truth.t, ends), np.searchsorted(truth.t, ends - MAX_TRACKABLE_AGE_S)
    return bool((truth.received[now, k] > truth.received[before, k]).all())
