"""Conversion of records to the quantities of the view, in NED, metres, seconds, radians."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_euler
from onboard.messages import Estimate, OwnPose, Truth
from onboard.units import S_PER_NS

COMPONENTS = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size", "a_lat", "a_long")


OPEN_RANGE_RATIO: Final = 0.1  # sigma over range, above which the range counts as open
OPEN_RANGE_SIGMAS: Final = 2.0  # half width of its interval


class LeaderArrays(NamedTuple):
    """An estimate of the leader as arrays, with NaN for components that are not estimated."""

    t_ns: int
    mean: Array  # (9,) in the order of COMPONENTS
    covariance: Array  # (9, 9)

    @property
    def r(self) -> Array:
        """The leader relative to the follower, (3,) m."""
        return self.mean[:3]

    @property
    def sigma(self) -> Array:
        """The standard deviation of every component, (9,)."""
        return np.asarray(np.sqrt(np.clip(np.diag(self.covariance), 0.0, None)))


def leader_state(estimate: Estimate) -> LeaderArrays | None:
    """Return the state in an estimate, or None without a finite relative position."""
    if estimate.mean is None or estimate.covariance is None:
        return None
    order = {name: i for i, name in enumerate(estimate.components)}
    if any(name not in order for name in COMPONENTS[:3]):
        return None
    known = [k for k, name in enumerate(COMPONENTS) if name in order]
    source = [order[COMPONENTS[k]] for k in known]
    mean, covariance = np.full(9, np.nan), np.full((9, 9), np.nan)
    mean[known] = np.asarray(estimate.mean, dtype=float)[source]
    covariance[np.ix_(known, known)] = np.asarray(estimate.covariance, dtype=float)[np.ix_(source, source)]
    if not (np.all(np.isfinite(mean[:3])) and np.all(np.isfinite(covariance[:3, :3]))):
        return None
    return LeaderArrays(t_ns=estimate.t_ns, mean=mean, covariance=covariance)


class RangeEstimate(NamedTuple):
    """The range and closing speed of the leader with their uncertainty."""

    range: float  # m
    sigma: float  # m
    closing: float  # m/s, positive when closing
    sigma_across: float  # m, the larger position sigma across the line of sight


def range_estimate(leader: LeaderArrays) -> RangeEstimate:
    """Return the components of a state along and across the line of sight."""
    distance = float(np.linalg.norm(leader.r))
    u = leader.r / max(distance, 1e-6)
    P = leader.covariance[:3, :3]
    across = np.eye(3) - np.outer(u, u)
    return RangeEstimate(
        range=distance,
        sigma=float(np.sqrt(max(float(u @ P @ u), 0.0))),
        closing=float(-u @ leader.mean[3:6]),
        sigma_across=float(np.sqrt(max(np.linalg.eigvalsh(across @ P @ across)[-1], 0.0))),
    )


def open_interval(leader: LeaderArrays) -> tuple[float, float] | None:
    """Return the nearest and farthest range (m, 95 %) if the range is uncertain, else None."""
    r = range_estimate(leader)
    if r.sigma <= OPEN_RANGE_RATIO * r.range:
        return None
    return max(r.range - OPEN_RANGE_SIGMAS * r.sigma, 0.0), r.range + OPEN_RANGE_SIGMAS * r.sigma


def ellipsoid(P: Array, sigmas: float) -> tuple[Array, Array]:
    """Return half axes (3,), m, and rotation (3, 3) of the `sigmas`-sigma ellipsoid of P (3, 3)."""
    values, vectors = np.linalg.eigh(P)
    if np.linalg.det(vectors) < 0:  # eigenvectors have no sign; a rotation has
        vectors[:, 0] = -vectors[:, 0]
    return sigmas * np.sqrt(np.clip(values, 0.0, None)), vectors


def course_quaternion(v_n: ArrayLike) -> Array:
    """Return the attitude (4,) of an aircraft in straight flight along v_n (3,), wings level."""
    north, east, down = np.asarray(v_n, dtype=float)
    return quaternion_from_euler(
        0.0, float(np.arctan2(-down, np.hypot(north, east))), float(np.arctan2(east, north))
    )


def heading_quaternion(q_nb: ArrayLike) -> Array:
    """Return the yaw of q_nb as a quaternion (4,): level axes that turn with the nose."""
    m = matrix_from_quaternion(q_nb)
    return quaternion_from_euler(0.0, 0.0, float(np.arctan2(m[1, 0], m[0, 0])))


def own_position(pose: OwnPose, t_ns: int) -> Array:
    """Extrapolate our position r_OF_n (3,) to t_ns at constant velocity from the latest pose."""
    dt = np.clip((t_ns - pose.t_ns) * S_PER_NS, -0.5, 0.5)
    return np.asarray(np.asarray(pose.r_OF_n, dtype=float) + dt * np.asarray(pose.v_F_n), dtype=float)


def truth_vector(truth: Truth) -> Array:
    """Return the truth (9,) in the order of COMPONENTS."""
    return np.array([*truth.r_FL_n, *truth.v_FL_n, truth.size, truth.a_lat, truth.a_long])


def truth_at(history: Sequence[Truth], t_ns: int, longest_gap_ns: int = 200_000_000) -> Array | None:
    """Interpolate the truth (9,) at t_ns in time-ordered `history`; None outside, or in a gap."""
    for before, after in zip(reversed(list(history)[:-1]), reversed(list(history)[1:]), strict=True):
        if before.t_ns <= t_ns <= after.t_ns:
            span = after.t_ns - before.t_ns
            if span > longest_gap_ns or span == 0:
                return None
            weight = (t_ns - before.t_ns) / span
            return np.asarray((1 - weight) * truth_vector(before) + weight * truth_vector(after))
    return None
