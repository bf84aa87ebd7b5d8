"""The bearing-angle filter of Ning, Zhang, Li, Chen and Zhao (arXiv 2401.17117, 2024).

A box gives the bearing g of its middle, a unit vector, and the angle theta between its sides. A target of size l
that looks equally wide from every side has theta = l / r. With the target's position p and ours o in n, both are
linear in the state (p, v, l) except for the noise (the paper's pseudo-linear form):

    (I - g g') o = (I - g g') p + r (I - g g') e        with e: noise of the bearing
    theta o      = theta p - l g + r (theta e + g w)    with w: noise of the angle

Across g the second repeats the first, so two rows of the first and one of the second remain, for a Kalman filter
with a target of constant velocity. The size becomes observable as we move across the line of sight or the range
changes.

With box errors of some percent, this form collapses: p = o and l = 0 fulfil both equations for any measurement. By
default the same measurement is therefore linearised about the prediction (an extended Kalman filter). Ours, not
the paper's: white acceleration of the target by `ACCELERATION`, chosen on seeds 1 to 12 for the least range error,
and an initial range as uncertain as the size, and correlated with it.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.messages import Attitude, Exposure, LocalPosition, Message, TargetDetection
from simlink.encounters.encounter import BOOT_NS, Encounter
from studies.encounters.flights import Flight, judged, received

ACCELERATION: Final = 0.2  # m/s^2 / sqrt(Hz), white, of the target
VELOCITY_SIGMA_M_S: Final = 5.0  # of the target at first
POSITION_LAG: Final = (
    0.0225  # s: an ArduPilot's positions are older than their stamps, as the daemon supposes, too
)
CENTER_SIGMA: Final = 0.1  # of the box's middle from the aircraft's center, as a fraction of the size
YAW, TILT = np.radians([1.0, 0.3])  # of our attitude, as the daemon supposes, too

POSITION: Final = slice(0, 3)
VELOCITY: Final = slice(3, 6)
SIZE: Final = 6


class Box(NamedTuple):
    """The measurement of one box, with the positions of camera and vehicle."""

    t: float  # s
    g: Array  # (3,) bearing in n
    theta: float  # rad
    g_sigma: float  # rad
    theta_sigma: float  # rad
    o: Array  # (3,) m, the camera's position in n
    r_OF: Array  # (3,) m, ours


def boxes(encounter: Encounter) -> list[Box]:
    """All boxes of an encounter, with our own pose at their times, interpolated."""
    messages, camera = received(encounter), encounter.scenario.camera
    attitudes = _rows(messages, Attitude, "q_nb", 0.0)
    lag = POSITION_LAG if encounter.scenario.vehicle.autopilot == "ardupilot" else 0.0
    places = _rows(messages, LocalPosition, "r_OF_n", -lag)
    R_bc, found = matrix_from_euler(*np.radians(camera.mount_rpy_deg)), []
    seen = [m for exposure in messages if isinstance(exposure, Exposure) for m in exposure.detections]
    for m in seen:
        if not isinstance(m, TargetDetection) or m.half_width is None:
            continue
        t, box = (m.t_ns - BOOT_NS) * 1e-9, m.features[0]
        q = np.array([np.interp(t, attitudes[:, 0], x) for x in attitudes[:, 1:].T])
        R_nb = matrix_from_quaternion(q / np.linalg.norm(q))
        r_OF = np.array([np.interp(t, places[:, 0], x) for x in places[:, 1:].T])
        g = R_nb @ R_bc @ np.array([1.0, *box.point])
        side = box.sigma  # of each of its sides
        found.append(
            Box(
                t,
                g / np.linalg.norm(g),
                2.0 * m.half_width,
                side / np.sqrt(2.0),
                side * np.sqrt(2.0),
                r_OF + R_nb @ np.array(camera.mount_offset),
                r_OF,
            )
        )
    return found


def flown(
    encounter: Encounter,
    size: float,
    size_sigma: float,
    acceleration: float = ACCELERATION,
    *,
    pseudo_linear: bool = False,
) -> Flight:
    """The filter's estimates, compared with the truth.

    The target's apparent `size` is known to `size_sigma`, in m. The covariance has the errors of our attitude and
    of the box's middle added, as ours has.
    """
    seen = boxes(encounter)
    x, P = started(seen[0], size, size_sigma)
    rows, before = [], seen[0].t
    for box in seen:
        x, P = predicted(x, P, box.t - before, acceleration)
        x, P = updated(x, P, box, pseudo_linear=pseudo_linear)
        before = box.t
        position, P_6 = x[POSITION] - box.r_OF, np.full((6, 6), np.nan)  # the velocity is not compared
        P_6[POSITION, POSITION] = P[POSITION, POSITION] + _aim(x, box)
        rows.append((box.t, *position, *[np.nan] * 3, *P_6.ravel()))
    return judged(np.array(rows), encounter.truth)


def started(box: Box, size: float, size_sigma: float) -> tuple[Array, Array]:
    """Return state (7,) and covariance (7, 7) from the first box, with a range as uncertain as the size."""
    r = size / box.theta
    x = np.concatenate([box.o + r * box.g, np.zeros(3), [size]])
    along = np.append(box.g / box.theta, [0.0, 0.0, 0.0, 1.0])  # how the state moves with the size
    P = size_sigma**2 * np.outer(along, along)
    across = box.g_sigma**2 + (CENTER_SIGMA * box.theta) ** 2
    P[POSITION, POSITION] += r**2 * (
        across * np.eye(3) + (box.theta_sigma / box.theta) ** 2 * np.outer(box.g, box.g)
    )
    P[VELOCITY, VELOCITY] = VELOCITY_SIGMA_M_S**2 * np.eye(3)
    return x, P


def predicted(x: Array, P: Array, dt: float, acceleration: float) -> tuple[Array, Array]:
    """After `dt` seconds at constant velocity."""
    F, Q, one = np.eye(7), np.zeros((7, 7)), np.eye(3)
    F[POSITION, VELOCITY] = dt * one
    Q[POSITION, POSITION], Q[POSITION, VELOCITY], Q[VELOCITY, POSITION], Q[VELOCITY, VELOCITY] = (
        dt**3 / 3 * one,
        dt**2 / 2 * one,
        dt**2 / 2 * one,
        dt * one,
    )
    return F @ x, F @ P @ F.T + acceleration**2 * Q


def updated(x: Array, P: Array, box: Box, *, pseudo_linear: bool = False) -> tuple[Array, Array]:
    """Return the state after one box, linearised about the prediction or in the paper's form."""
    offset = x[POSITION] - box.o
    r, H, noise = (
        float(np.linalg.norm(offset)),
        np.zeros((3, 7)),
        np.diag(np.square([*[box.g_sigma] * 2, box.theta_sigma])),
    )
    if pseudo_linear:
        H[:2, POSITION], H[2, POSITION], H[2, SIZE] = _across(box.g), box.theta * box.g, -1.0
        innovation, noise = -H[:, POSITION] @ offset + [0.0, 0.0, x[SIZE]], r**2 * noise
    else:
        ahead = offset / r
        H[:2, POSITION], H[2, POSITION], H[2, SIZE] = _across(ahead) / r, -x[SIZE] / r**2 * ahead, 1.0 / r
        innovation = np.append(_across(ahead) @ box.g, box.theta - x[SIZE] / r)
    K = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
    P = P - K @ H @ P
    return x + K @ innovation, 0.5 * (P + P.T)


def _aim(x: Array, box: Box) -> Array:
    """Return the covariance (3, 3) of the position by lasting errors of attitude and box centre."""
    offset = x[POSITION] - box.o
    right, down = _across(offset / np.linalg.norm(offset))
    middle, yaw, tilt = np.square(
        [CENTER_SIGMA * x[SIZE], YAW * np.linalg.norm(offset), TILT * np.linalg.norm(offset)]
    )
    aside: Array = (middle + yaw) * np.outer(right, right) + (middle + tilt) * np.outer(down, down)
    return aside


def _across(g: Array) -> Array:
    """Two unit vectors (2, 3) across a unit vector that is not upright, and each other."""
    right = np.array([-g[1], g[0], 0.0]) / np.hypot(g[0], g[1])
    return np.array([right, np.cross(g, right)])


def _rows(messages: Sequence[Message], kind: type[Message], field: str, late: float) -> Array:
    """Times of the encounter, s, and a field, of all messages of a kind (n, 1 + k)."""
    return np.array(
        [((m.t_ns - BOOT_NS) * 1e-9 + late, *getattr(m, field)) for m in messages if isinstance(m, kind)]
    )
