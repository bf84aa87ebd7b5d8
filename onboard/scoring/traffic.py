"""How good a picture of traffic is, against the truth: who is tracked by whom, how long nobody is, whether tracks
change what they follow, how well the closest approach is foretold, and whether the ellipsoids hold what they say.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Estimate, TrafficTruth

LEAD_S: Final = 10.0  # of the prediction that is held against the closest approach
NEAR_M: Final = 1000.0  # closest approaches beyond are no encounters
CLOSE_M: Final = 15.0  # an error up to this is small ...
CLOSE_SHARE: Final = 0.1  # ... or up to this share of the distance
SETTLE_S: Final = 5.0  # of a track, before its ellipsoid is judged
FRESH_S: Final = 3.0  # detections or messages this recent: it could be tracked
KNOWN_S: Final = 10.0  # without a longer gap than that: what is foretold has something to go by
BEGIN_S: Final = 4.0  # and has this long to be found
SWAPPED_S: Final = 1.0  # off its own aircraft and on another for so long is a swap
APART: Final = chi_square_threshold(0.9999, 3)
NS: Final = 1e9


class Encounter(NamedTuple):
    """A closest approach: when it was (s on the boot clock), how near (m), and what was foretold `LEAD_S` before
    (NaN: no valid track of it then). `known`: it had been heard or seen all the time for a while before that."""

    t: float
    distance: float
    foretold: float
    known: bool = True

    @property
    def close(self) -> bool:
        """Whether it was foretold well."""
        return abs(self.foretold - self.distance) <= max(CLOSE_M, CLOSE_SHARE * self.distance)


class Scored(NamedTuple):
    """One aircraft. `tracks` that followed it, in order; samples judged and inside the 95 % ellipsoid; seconds in
    which it was there to be seen and nothing valid followed it; RMS position error, m."""

    name: str
    tracks: tuple[str, ...]
    samples: int
    inside: int
    missing_s: float
    rmse: float
    encounters: tuple[Encounter, ...]


class Score(NamedTuple):
    """All aircraft; tracks that went from one to another; tracks that followed nothing, with samples each."""

    aircraft: tuple[Scored, ...]
    swaps: tuple[str, ...]
    false_tracks: dict[str, int]


class _Truth:
    """The truth as arrays (times, aircraft, 3), interpolated in between: cubic, by positions and velocities."""

    def __init__(self, truth: Sequence[TrafficTruth]) -> None:
        self.t = np.array([x.t_ns for x in truth]) / NS
        self.names = [a.name for a in truth[0].intruders]
        self.targets = [a.target for a in truth[0].intruders]
        self.r = np.array([[a.r_FT_n for a in x.intruders] for x in truth])
        self.v = np.array([[a.v_FT_n for a in x.intruders] for x in truth])
        self.signs = np.array([[a.messages + a.detections for a in x.intruders] for x in truth])

    def at(self, t: float) -> Array:
        """Relative positions (aircraft, 3)."""
        i = int(np.clip(np.searchsorted(self.t, t) - 1, 0, len(self.t) - 2))
        h = self.t[i + 1] - self.t[i]
        u = (t - self.t[i]) / h
        a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
        return np.asarray(
            a * self.r[i] + (1 - a) * self.r[i + 1] + h * (b * self.v[i] + (u**3 - u**2) * self.v[i + 1])
        )


def score(estimates: Iterable[Estimate], truth: Sequence[TrafficTruth]) -> Score:
    """The score of a flight: estimates of traffic in order of time, and the truth at some 10 Hz."""
    told = _Truth(truth)
    rows: dict[str, list[tuple[float, Estimate, Array]]] = defaultdict(list)  # track -> (t, estimate, d2 to each)
    for e in estimates:
        t = e.t_ns / NS
        if e.intruder is None or not e.valid or e.mean is None or not told.t[0] <= t <= told.t[-1]:
            continue
        off = told.at(t) - np.array(e.mean[:3])
        P = np.array(e.covariance)[:3, :3]
        rows[e.target].append((t, e, np.einsum("ki,ki->k", off, np.linalg.solve(P, off.T).T)))
    owner: dict[str, int] = {}
    false_tracks = {}
    for name, row in rows.items():
        index = _owner(name, [d2 for _, _, d2 in row], told)
        if index is None:
            false_tracks[name] = len(row)
        else:
            owner[name] = index
    swaps = tuple(name for name, index in owner.items() if _swapped(rows[name], index))
    return Score(
        tuple(_scored(k, told, {n: rows[n] for n, i in owner.items() if i == k}) for k in range(len(told.names))),
        swaps,
        false_tracks,
    )


def _owner(name: str, d2: list[Array], told: _Truth) -> int | None:
    """Whose track it is: his whose address it bears, else his that it was on when it began; None if nobody's."""
    for k, target in enumerate(told.targets):
        if target and name.split("-", maxsplit=1)[0] == target:
            return k
    first = np.mean(d2[:10], axis=0)
    nearest = int(np.argmin(first))
    return nearest if first[nearest] < APART else None


def _swapped(row: list[tuple[float, Estimate, Array]], owner: int) -> bool:
    """Whether for a while the track was on another aircraft and not on its own."""
    since = None
    for t, _, d2 in row:
        other = np.delete(d2, owner).min()
        if d2[owner] > APART and other < APART:
            since = t if since is None else since
            if t - since >= SWAPPED_S:
                return True
        else:
            since = None
    return False


def _scored(k: int, told: _Truth, tracks: dict[str, list[tuple[float, Estimate, Array]]]) -> Scored:
    gate = chi_square_threshold(0.95, 3)
    samples = inside = 0
    squared = []
    times: list[float] = []
    for row in tracks.values():
        for t, e, d2 in row:
            times.append(t)
            if t - row[0][0] < SETTLE_S:
                continue
            samples += 1
            inside += bool(d2[k] <= gate)
            assert e.mean is not None  # noqa: S101 - only those with one were kept
            squared.append(float(np.sum((told.at(t)[k] - np.array(e.mean[:3])) ** 2)))
    return Scored(
        told.names[k],
        tuple(sorted(tracks, key=lambda n: tracks[n][0][0])),
        samples,
        inside,
        _missing(told, k, np.sort(times)),
        float(np.sqrt(np.mean(squared))) if squared else float("nan"),
        tuple(_encounters(told, k, tracks)),
    )


def _missing(told: _Truth, k: int, times: Array) -> float:
    """Seconds without a valid track of it though it had been there to be seen for a while."""
    total, since = 0.0, None
    for i in range(1, len(told.t)):
        t = told.t[i]
        past = int(np.searchsorted(told.t, t - FRESH_S))
        visible = told.signs[i, k] > told.signs[past, k]
        if not visible:
            since = None
            continue
        since = t if since is None else since
        j = int(np.searchsorted(times, t + 0.05))
        tracked = j > 0 and t - times[j - 1] < 0.5
        if t - since > BEGIN_S and not tracked:
            total += t - told.t[i - 1]
    return total


def _encounters(
    told: _Truth, k: int, tracks: dict[str, list[tuple[float, Estimate, Array]]]
) -> Iterable[Encounter]:
    distance = np.linalg.norm(told.r[:, k], axis=1)
    for i in range(1, len(distance) - 1):
        if not (distance[i - 1] > distance[i] <= distance[i + 1] and distance[i] < NEAR_M):
            continue
        t = float(told.t[i])
        if t - told.t[0] < LEAD_S + SETTLE_S:
            continue
        foretold = float("nan")
        for row in tracks.values():
            near = [e for s, e, _ in row if abs(s - (t - LEAD_S)) <= 0.06]
            if near and near[0].intruder is not None:
                foretold = near[0].intruder.approach.distance
        yield Encounter(t, float(distance[i]), foretold, _known(told, k, t - LEAD_S))


def _known(told: _Truth, k: int, t: float) -> bool:
    """Whether it was heard or seen in every few seconds of the last ones."""
    ends = np.arange(t, max(t - KNOWN_S, told.t[0] + FRESH_S), -0.5)
    now, before = np.searchsorted(told.t, ends), np.searchsorted(told.t, ends - FRESH_S)
    return bool((told.signs[now, k] > told.signs[before, k]).all())
