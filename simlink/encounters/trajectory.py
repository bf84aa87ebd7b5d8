"""Recorded flights as smooth trajectories: the stretches of a log in which a vehicle flies, resampled to the steps
of the world.

Velocity is the derivative of position, and acceleration that of velocity, so that a recording is as good a truth
as a drawn flight. Recorded velocity is smoothed over SMOOTH s or two samples and integrated; the slow rest to the
recorded position is added. Where a log has fixes of a receiver alone, IMU and attitude give the velocity, whose
drift the fixes remove; how late they are is found by correlation. Attitude is interpolated as it was recorded.

Left out are gaps, steps of the EKF, times at rest, and times in which attitude and acceleration disagree by more
than DISAGREES: by the specific force where there is one, else by its part along the wing, which rotors and wings
leave near zero but for drag.
"""

from collections import defaultdict
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.geometry.rotations import matrix_from_quaternion
from simlink.encounters.curves import Motion
from simlink.encounters.families import LeaderClass
from simlink.encounters.recording import LogError, Recording, gaps, read_recording
from simlink.sensors.arrays import Array, Flags
from simlink.world.constants import DT, G

SMOOTH: Final = 0.08  # s
PULL: Final = 2.0  # s, after which a smoothed trajectory is where the recorded one is
EDGE: Final = (2.0, 4.0)  # s at either end of a piece that are not used, where smoothing lacks a side: EKF, GPS
LONGEST_GAP: Final = 0.5  # s
LONGEST_GPS_GAP: Final = 1.1  # s
STEP: Final = (0.4, 3.0)  # m, of the position beside what the velocity says: an EKF's, a receiver's
DISAGREES: Final = 1.0  # m/s^2
DISAGREES_S: Final = 0.5  # s, over which that is a mean
DRAG: Final = 0.6  # 1/s, at most, along the wing
BANKS: Final = 0.1  # rad, more: by so much a bank may be off that of the thrust without a fault of the log
# RMS rate of the attitude, rad/s: on the ground of eight logs 0.002 to 0.02, in calm hovers from 0.03 up.
MOVES: Final = 0.02
MOVES_S: Final = 3.0
CARRIES: Final = 5.0  # m/s: a fixed wing flies no slower
LATEST: Final = 0.5  # s, of a fix
LEAST: Final = 20.0  # s, of a stretch
WEIGHT: Final[Array] = np.array([0.0, 0.0, G])


class Trajectory(NamedTuple):
    """N steps of DT: the motion in n from the place of the first, and q_nb (N, 4). `begin`: s of the log."""

    name: str
    begin: float
    motion: Motion
    q_nb: Array
    leader_class: LeaderClass

    @property
    def seconds(self) -> float:
        """How long it is."""
        return DT * (len(self.q_nb) - 1)

    def part(self, begin: int, count: int) -> "Trajectory":
        """`count` steps from step `begin` on."""
        r, v, a = (x[begin : begin + count] for x in self.motion)
        return self._replace(
            begin=self.begin + DT * begin, motion=Motion(r - r[0], v, a), q_nb=self.q_nb[begin : begin + count]
        )


def times(count: int) -> Array:
    """So many times (N,), DT apart, s."""
    t: Array = DT * np.arange(count, dtype=np.float64)
    return t


def read_trajectories(path: Path, least: float = LEAST) -> list[Trajectory]:
    """The stretches of at least `least` s in which the vehicle of a log flies, the longest first. Raises LogError,
    which says why where there is none."""
    recording = read_recording(path)
    found, lost = stretches(recording, least)
    if not found:
        most_first = sorted(lost.items(), key=lambda item: -item[1])
        why = ", ".join(f"{seconds:.0f} s {reason}" for reason, seconds in most_first if seconds >= 0.5)
        raise LogError(
            f"{path}: no {least:g} s of flight without interruption; left out: {why or 'all of it, too short'}"
        )
    return sorted(found, key=lambda one: one.seconds, reverse=True)


def stretches(recording: Recording, least: float = LEAST) -> tuple[list[Trajectory], dict[str, float]]:
    """The stretches of a recording, in order, and how many seconds were left out for which reason."""
    found: list[Trajectory] = []
    lost: dict[str, float] = defaultdict(float)
    for begin, end in _pieces(recording, lost):
        t, edge = begin + times(int((end - begin) / DT)), EDGE[recording.is_gps]
        if len(t) * DT < 2.0 * edge + least:
            lost["too short between gaps or steps"] += len(t) * DT
            continue
        motion, q_nb = _smooth(recording, t)
        recording = recording._replace(forces=_unbiased(recording, t, motion, q_nb))
        if recording.is_gps:
            motion, q_nb = _smooth(recording, t)
        use = _flies(recording, t, motion, q_nb, lost) & _agrees(recording, t, motion, q_nb, lost)
        use &= (t >= begin + edge) & (t <= end - edge)
        whole = Trajectory(recording.name, begin, motion, q_nb, recording.leader_class)
        for first, last in _runs(use):
            if (last - first) * DT >= least:
                found.append(whole.part(first, last - first))
            else:
                lost["too short"] += (last - first) * DT
    return found, lost


def _pieces(recording: Recording, lost: dict[str, float]) -> list[tuple[float, float]]:
    """Times without gaps and steps, (from, to) s."""
    t, places = recording.places[:, 0], recording.places
    dt, longest = np.diff(t), LONGEST_GPS_GAP if recording.is_gps else LONGEST_GAP
    apart = gaps(t, longest) + gaps(recording.attitudes[:, 0], LONGEST_GAP)
    if recording.is_gps:
        apart += gaps(recording.forces[:, 0], LONGEST_GAP)
    r, v = places[:, 1:4], places[:, 4:7]
    jump = np.linalg.norm(np.diff(r, axis=0) - 0.5 * dt[:, None] * (v[1:] + v[:-1]), axis=1)
    steps = np.flatnonzero((jump > STEP[recording.is_gps]) & (dt <= longest))  # NaN is none
    ends = sorted([*apart, *((t[i] - PULL, t[i + 1] + PULL) for i in steps.tolist())])
    at = float(max(t[0], recording.attitudes[0, 0]))
    last = float(min(t[-1], recording.attitudes[-1, 0]))
    if recording.is_gps:
        if not len(recording.forces):
            lost["without EKF and IMU"] += last - at
            return []
        at, last = max(at, float(recording.forces[0, 0])), min(last, float(recording.forces[-1, 0]))
    found, first = [], at
    for a, b in [*ends, (last, last)]:
        if min(a, last) > at:
            found.append((at, min(a, last)))
        at = max(at, b)
    lost["in gaps and at steps of the position"] += max(0.0, last - first) - sum(b - a for a, b in found)
    return found


def _smooth(recording: Recording, t: Array) -> tuple[Motion, Array]:
    """The motion and q_nb at the times t (N,), DT apart."""
    q_nb = _attitude(recording.attitudes, t)
    when, r, v = recording.places[:, 0], recording.places[:, 1:4], recording.places[:, 4:7]
    known = np.isfinite(v).all(axis=1)
    between = 0.5 * (when[1:] + when[:-1])
    # without recorded velocity: what positions say
    when_v, v = (when[known], v[known]) if known.any() else (between, np.diff(r, axis=0) / np.diff(when)[:, None])
    late = 0.0
    if recording.is_gps:
        force = np.einsum("nij,nj->ni", matrix_from_quaternion(q_nb), _at(recording.forces, t))
        fast = np.cumsum(blurred(force + WEIGHT, SMOOTH), axis=0) * DT
        late = _lateness(t, fast, when_v, v)
        slow = _columns(t + late, when_v, v)
        fast = fast + blurred(slow - fast, PULL)
    else:
        inside = (when_v >= t[0]) & (when_v <= t[-1])
        seconds = max(SMOOTH, float(np.median(np.diff(when_v[inside]))))
        fast = blurred(_columns(t, when_v, v), seconds)
    place = np.vstack([np.zeros(3), np.cumsum(0.5 * DT * (fast[1:] + fast[:-1]), axis=0)])
    place = place + blurred(_columns(t + late, when, r) - place, PULL)
    velocity = np.gradient(place, DT, axis=0)
    return Motion(place, velocity, np.gradient(velocity, DT, axis=0)), q_nb


def _lateness(t: Array, fast: Array, when: Array, v: Array) -> float:
    """By how many seconds velocities v (n, 3) at the times `when` are late, beside `fast` (N, 3) at t."""

    ends = round(EDGE[1] / DT)

    def quick(x: Array) -> Array:
        change: Array = x - blurred(x, EDGE[1])
        return change[ends:-ends, :2]

    ours = quick(blurred(fast, 0.2))
    lags = np.arange(0.0, LATEST + 0.01, 0.02)
    unlike = [float(np.sum((ours - quick(_columns(t + lag, when, v))) ** 2)) for lag in lags]
    return float(lags[int(np.argmin(unlike))])


def _attitude(attitudes: Array, t: Array) -> Array:
    """q_nb (N, 4) at t, on the straight line between two samples."""
    q = attitudes[:, 1:].copy()
    q /= np.linalg.norm(q, axis=1)[:, None]
    flips = np.cumprod(np.where(np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    between = _columns(t, attitudes[:, 0], q)
    return np.asarray(between / np.linalg.norm(between, axis=1)[:, None])


def _unbiased(recording: Recording, t: Array, motion: Motion, q_nb: Array) -> Array:
    """The specific forces without what they are off by on average, in b, beside a motion at t (N,)."""
    if not _has_forces(recording):
        return recording.forces
    force = np.einsum("nij,ni->nj", matrix_from_quaternion(q_nb), motion.a - WEIGHT)
    bias = force - _at(recording.forces, t)
    return np.asarray(recording.forces + np.concatenate([[0.0], np.median(bias, axis=0)]))


def _has_forces(recording: Recording) -> bool:
    """Whether there is a specific force all the time."""
    return len(recording.forces) > 1 and not gaps(recording.forces[:, 0], LONGEST_GAP)


def _flies(recording: Recording, t: Array, motion: Motion, q_nb: Array, lost: dict[str, float]) -> Flags:
    """Whether it flies: its attitude moves, its motors are armed, where the log says so at all, and a fixed wing
    is fast enough."""
    rate = 2.0 * np.linalg.norm(np.gradient(q_nb, DT, axis=0), axis=1)
    flies = np.sqrt(blurred(rate[:, None] ** 2, MOVES_S)[:, 0].clip(0.0)) > MOVES
    arms = recording.arms
    if len(arms) and arms[:, 1].any():
        flies &= arms[np.clip(np.searchsorted(arms[:, 0], t, "right") - 1, 0, None), 1] > 0.0
    if recording.leader_class == "fixed_wing":
        flies &= blurred(np.linalg.norm(motion.v, axis=1)[:, None], MOVES_S)[:, 0] > CARRIES
    lost["at rest"] += float(np.count_nonzero(~flies)) * DT
    return np.asarray(flies)


def _agrees(recording: Recording, t: Array, motion: Motion, q_nb: Array, lost: dict[str, float]) -> Flags:
    """Whether attitude and acceleration agree."""
    R_nb = matrix_from_quaternion(q_nb)
    if _has_forces(recording):
        off = np.einsum("nij,nj->ni", R_nb, _at(recording.forces, t)) + WEIGHT - motion.a
        limit: Array | float = DISAGREES
    else:
        force, wing = motion.a - WEIGHT, R_nb[:, :, 1]
        along, speed = np.einsum("nj,nj->n", wing, force), np.einsum("nj,nj->n", wing, motion.v)
        drag = float(np.clip(-(along @ speed) / max(speed @ speed, 1e-9), 0.0, DRAG))
        off = (along + drag * speed)[:, None]
        limit = DISAGREES + BANKS * np.linalg.norm(force, axis=1)
    agrees = np.linalg.norm(blurred(off, DISAGREES_S), axis=1) <= limit
    agrees = blurred(agrees[:, None].astype(float), DISAGREES_S)[:, 0] > 1.0 - 1e-6
    lost["whose attitude and acceleration disagree"] += float(np.count_nonzero(~agrees)) * DT
    return np.asarray(agrees)


def _runs(use: Flags) -> list[tuple[int, int]]:
    """Where `use` holds without interruption, [from, to)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], use.astype(np.int8), [0]]))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _at(rows: Array, t: Array) -> Array:
    return _columns(t, rows[:, 0], rows[:, 1:])


def _columns(t: Array, when: Array, values: npt.NDArray[np.float64]) -> Array:
    """values (n, k) at the times `when` (n,), linear between them, at t (N,)."""
    return np.column_stack([np.interp(t, when, x) for x in values.T])


def blurred(x: Array, seconds: float) -> Array:
    """x (N, k) smoothed by two means over `seconds`, which together weigh it by a triangle. At the ends it goes on
    as it does on the other side of the end, upside down."""
    half = max(1, round(seconds / DT / 2))
    width = 2 * half + 1
    if len(x) <= 2 * half + 1:
        return np.broadcast_to(x.mean(axis=0), x.shape).copy()
    for _ in range(2):
        padded = np.pad(x, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
        total = np.vstack([np.zeros(x.shape[1]), np.cumsum(padded, axis=0)])
        x = (total[width:] - total[:-width]) / width
    return np.asarray(x)
