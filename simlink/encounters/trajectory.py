"""Recorded flights as smooth trajectories, resampled to the steps of the world.

Velocity is the derivative of position and acceleration that of velocity, so that a recording is as consistent a
truth as a drawn flight. Recorded velocity is smoothed and integrated, then corrected slowly towards the recorded
position. With GPS fixes only, velocity comes from IMU and attitude and is corrected by the fixes, whose latency is
found by correlation.

Gaps, EKF resets and times at rest are left out, and times in which attitude and acceleration disagree: by the
specific force if it is logged, else by its component along the wing, which is near zero except for drag.
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
from simlink.world.constants import DT, GRAVITY

SMOOTHING_WINDOW_S: Final = 0.08
CORRECTION_WINDOW_S: Final = 2.0  # over which a smoothed trajectory returns to the recorded position
EDGE_S: Final = (2.0, 4.0)  # left out at both ends, where smoothing is one-sided: EKF, GPS
MAX_GAP_TIME_S: Final = 0.5
MAX_GPS_GAP_TIME_S: Final = 1.1
MIN_RESET_M: Final = (0.4, 3.0)  # jump of the position that the velocity does not explain: EKF, GPS
MAX_ACCELERATION_ERROR: Final = 1.0  # m/s^2
ACCELERATION_WINDOW_S: Final = 0.5  # over which the error is averaged
MAX_DRAG: Final = 0.6  # 1/s, along the wing
MAX_BANK_ERROR: Final = 0.1  # rad; a log without faults has bank errors of this size
# RMS rate of the attitude, rad/s: on the ground of eight logs 0.002 to 0.02, in calm hovers from 0.03 up.
MIN_ATTITUDE_RATE: Final = 0.02
MOTION_WINDOW_S: Final = 3.0
FIXED_WING_MIN_SPEED: Final = 5.0  # m/s
MAX_GPS_LATENCY_S: Final = 0.5
MIN_DURATION_S: Final = 20.0
GRAVITY_N: Final[Array] = np.array([0.0, 0.0, GRAVITY])


class Trajectory(NamedTuple):
    """The motion in n relative to its first position, and q_nb (N, 4), in N steps of DT.

    `begin` is the time in the log (s).
    """

    name: str
    begin: float
    motion: Motion
    q_nb: Array
    leader_class: LeaderClass

    @property
    def seconds(self) -> float:
        """The duration, s."""
        return DT * (len(self.q_nb) - 1)

    def part(self, begin: int, count: int) -> "Trajectory":
        """Return `count` steps from step `begin` on."""
        r, v, a = (x[begin : begin + count] for x in self.motion)
        return self._replace(
            begin=self.begin + DT * begin, motion=Motion(r - r[0], v, a), q_nb=self.q_nb[begin : begin + count]
        )


def time_grid(count: int) -> Array:
    """Return `count` times (N,), DT apart, s."""
    t: Array = DT * np.arange(count, dtype=np.float64)
    return t


def read_trajectories(path: Path, least: float = MIN_DURATION_S) -> list[Trajectory]:
    """Return stretches of flight of at least `least` seconds, longest first.

    Raises LogError with the reasons if there is none.
    """
    recording = read_recording(path)
    found, lost = stretches(recording, least)
    if not found:
        most_first = sorted(lost.items(), key=lambda item: -item[1])
        why = ", ".join(f"{seconds:.0f} s {reason}" for reason, seconds in most_first if seconds >= 0.5)
        raise LogError(
            f"{path}: no {least:g} s of flight without interruption; left out: {why or 'all of it, too short'}"
        )
    return sorted(found, key=lambda one: one.seconds, reverse=True)


def stretches(recording: Recording, least: float = MIN_DURATION_S) -> tuple[list[Trajectory], dict[str, float]]:
    """Return the stretches of a recording in order, and the seconds left out by reason."""
    found: list[Trajectory] = []
    lost: dict[str, float] = defaultdict(float)
    for begin, end in _pieces(recording, lost):
        t, edge = begin + time_grid(int((end - begin) / DT)), EDGE_S[recording.is_gps]
        if len(t) * DT < 2.0 * edge + least:
            lost["too short between gaps or steps"] += len(t) * DT
            continue
        motion, q_nb = _smooth(recording, t)
        recording = recording._replace(forces=_remove_force_bias(recording, t, motion, q_nb))
        if recording.is_gps:
            motion, q_nb = _smooth(recording, t)
        use = _is_flying(recording, t, motion, q_nb, lost) & _is_consistent(recording, t, motion, q_nb, lost)
        use &= (t >= begin + edge) & (t <= end - edge)
        whole = Trajectory(recording.name, begin, motion, q_nb, recording.leader_class)
        for first, last in _index_ranges(use):
            if (last - first) * DT >= least:
                found.append(whole.part(first, last - first))
            else:
                lost["too short"] += (last - first) * DT
    return found, lost


def _pieces(recording: Recording, lost: dict[str, float]) -> list[tuple[float, float]]:
    """Return the intervals (from, to), s, without gaps and resets."""
    t, places = recording.places[:, 0], recording.places
    dt, longest = np.diff(t), MAX_GPS_GAP_TIME_S if recording.is_gps else MAX_GAP_TIME_S
    apart = gaps(t, longest) + gaps(recording.attitudes[:, 0], MAX_GAP_TIME_S)
    if recording.is_gps:
        apart += gaps(recording.forces[:, 0], MAX_GAP_TIME_S)
    r, v = places[:, 1:4], places[:, 4:7]
    jump = np.linalg.norm(np.diff(r, axis=0) - 0.5 * dt[:, None] * (v[1:] + v[:-1]), axis=1)
    steps = np.flatnonzero((jump > MIN_RESET_M[recording.is_gps]) & (dt <= longest))  # NaN is none
    ends = sorted(
        [*apart, *((t[i] - CORRECTION_WINDOW_S, t[i + 1] + CORRECTION_WINDOW_S) for i in steps.tolist())]
    )
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
    """Return the motion and q_nb at the times t (N,), DT apart."""
    q_nb = _attitude(recording.attitudes, t)
    when, r, v = recording.places[:, 0], recording.places[:, 1:4], recording.places[:, 4:7]
    known = np.isfinite(v).all(axis=1)
    between = 0.5 * (when[1:] + when[:-1])
    # without recorded velocity: what positions say
    when_v, v = (when[known], v[known]) if known.any() else (between, np.diff(r, axis=0) / np.diff(when)[:, None])
    late = 0.0
    if recording.is_gps:
        force = np.einsum("nij,nj->ni", matrix_from_quaternion(q_nb), _interpolate_rows(recording.forces, t))
        fast = np.cumsum(smooth_columns(force + GRAVITY_N, SMOOTHING_WINDOW_S), axis=0) * DT
        late = _latency(t, fast, when_v, v)
        slow = _interpolate(t + late, when_v, v)
        fast = fast + smooth_columns(slow - fast, CORRECTION_WINDOW_S)
    else:
        inside = (when_v >= t[0]) & (when_v <= t[-1])
        seconds = max(SMOOTHING_WINDOW_S, float(np.median(np.diff(when_v[inside]))))
        fast = smooth_columns(_interpolate(t, when_v, v), seconds)
    place = np.vstack([np.zeros(3), np.cumsum(0.5 * DT * (fast[1:] + fast[:-1]), axis=0)])
    place = place + smooth_columns(_interpolate(t + late, when, r) - place, CORRECTION_WINDOW_S)
    velocity = np.gradient(place, DT, axis=0)
    return Motion(place, velocity, np.gradient(velocity, DT, axis=0)), q_nb


def _latency(t: Array, fast: Array, when: Array, v: Array) -> float:
    """Return the latency (s) of velocities v (n, 3) at `when` relative to `fast` (N, 3) at t."""

    ends = round(EDGE_S[1] / DT)

    def quick(x: Array) -> Array:
        change: Array = x - smooth_columns(x, EDGE_S[1])
        return change[ends:-ends, :2]

    ours = quick(smooth_columns(fast, 0.2))
    lags = np.arange(0.0, MAX_GPS_LATENCY_S + 0.01, 0.02)
    unlike = [float(np.sum((ours - quick(_interpolate(t + lag, when, v))) ** 2)) for lag in lags]
    return float(lags[int(np.argmin(unlike))])


def _attitude(attitudes: Array, t: Array) -> Array:
    """Return q_nb (N, 4) at t, interpolated linearly."""
    q = attitudes[:, 1:].copy()
    q /= np.linalg.norm(q, axis=1)[:, None]
    flips = np.cumprod(np.where(np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    between = _interpolate(t, attitudes[:, 0], q)
    return np.asarray(between / np.linalg.norm(between, axis=1)[:, None])


def _remove_force_bias(recording: Recording, t: Array, motion: Motion, q_nb: Array) -> Array:
    """Return specific forces in b without their median error at t (N,)."""
    if not _has_forces(recording):
        return recording.forces
    force = np.einsum("nij,ni->nj", matrix_from_quaternion(q_nb), motion.a - GRAVITY_N)
    bias = force - _interpolate_rows(recording.forces, t)
    return np.asarray(recording.forces + np.concatenate([[0.0], np.median(bias, axis=0)]))


def _has_forces(recording: Recording) -> bool:
    """Whether there is a specific force throughout."""
    return len(recording.forces) > 1 and not gaps(recording.forces[:, 0], MAX_GAP_TIME_S)


def _is_flying(recording: Recording, t: Array, motion: Motion, q_nb: Array, lost: dict[str, float]) -> Flags:
    """Return when it flies (N,), by attitude, arming and a fixed wing's speed."""
    rate = 2.0 * np.linalg.norm(np.gradient(q_nb, DT, axis=0), axis=1)
    flies = np.sqrt(smooth_columns(rate[:, None] ** 2, MOTION_WINDOW_S)[:, 0].clip(0.0)) > MIN_ATTITUDE_RATE
    arms = recording.arms
    if len(arms) and arms[:, 1].any():
        flies &= arms[np.clip(np.searchsorted(arms[:, 0], t, "right") - 1, 0, None), 1] > 0.0
    if recording.leader_class == "fixed_wing":
        flies &= (
            smooth_columns(np.linalg.norm(motion.v, axis=1)[:, None], MOTION_WINDOW_S)[:, 0] > FIXED_WING_MIN_SPEED
        )
    lost["at rest"] += float(np.count_nonzero(~flies)) * DT
    return np.asarray(flies)


def _is_consistent(recording: Recording, t: Array, motion: Motion, q_nb: Array, lost: dict[str, float]) -> Flags:
    """Return when attitude and acceleration agree (N,)."""
    R_nb = matrix_from_quaternion(q_nb)
    if _has_forces(recording):
        off = np.einsum("nij,nj->ni", R_nb, _interpolate_rows(recording.forces, t)) + GRAVITY_N - motion.a
        limit: Array | float = MAX_ACCELERATION_ERROR
    else:
        force, wing = motion.a - GRAVITY_N, R_nb[:, :, 1]
        along, speed = np.einsum("nj,nj->n", wing, force), np.einsum("nj,nj->n", wing, motion.v)
        drag = float(np.clip(-(along @ speed) / max(speed @ speed, 1e-9), 0.0, MAX_DRAG))
        off = (along + drag * speed)[:, None]
        limit = MAX_ACCELERATION_ERROR + MAX_BANK_ERROR * np.linalg.norm(force, axis=1)
    agrees = np.linalg.norm(smooth_columns(off, ACCELERATION_WINDOW_S), axis=1) <= limit
    agrees = smooth_columns(agrees[:, None].astype(float), ACCELERATION_WINDOW_S)[:, 0] > 1.0 - 1e-6
    lost["whose attitude and acceleration disagree"] += float(np.count_nonzero(~agrees)) * DT
    return np.asarray(agrees)


def _index_ranges(use: Flags) -> list[tuple[int, int]]:
    """Return the index ranges [from, to) in which `use` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], use.astype(np.int8), [0]]))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _interpolate_rows(rows: Array, t: Array) -> Array:
    return _interpolate(t, rows[:, 0], rows[:, 1:])


def _interpolate(t: Array, when: Array, values: npt.NDArray[np.float64]) -> Array:
    """Interpolate values (n, k) at the times `when` (n,) linearly to t (N,)."""
    return np.column_stack([np.interp(t, when, x) for x in values.T])


def smooth_columns(x: Array, seconds: float) -> Array:
    """Smooth x (N, k) by two moving averages over `seconds`, a triangular window together.

    The ends are padded by odd reflection.
    """
    half = max(1, round(seconds / DT / 2))
    width = 2 * half + 1
    if len(x) <= 2 * half + 1:
        return np.broadcast_to(x.mean(axis=0), x.shape).copy()
    for _ in range(2):
        padded = np.pad(x, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
        total = np.vstack([np.zeros(x.shape[1]), np.cumsum(padded, axis=0)])
        x = (total[width:] - total[:-width]) / width
    return np.asarray(x)
