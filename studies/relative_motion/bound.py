"""The posterior Cramer-Rao bound of relative motion by vision, which no estimator can beat.

The recursion of Tichavsky, Muravchik and Nehorai (1998), J' = (Q + F J^-1 F^T)^-1 + H^T R^-1 H with Jacobians
along the true trajectories, is used in its covariance form, for each flight instead of expectations over flights.

Its assumptions: our own motion is known exactly; the leader moves by Oh & Johnson's model with the given process
noise; each coordinate of the three points has the camera's noise; the leader's attitude is known, so that the
points depend on its position and size only; the size prior, and the given initial sigmas of velocity and
accelerations. The true leader of the reference flight has no process noise: a filter with less of it could be
below the bound.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.oh_johnson.noise import process_noise
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.messages import Record
from onboard.models import relative_motion
from onboard.models.relative_motion import A_LAT, POSITION, SIZE, VELOCITY, FollowerMotion
from simlink.scenarios.camera import Camera
from studies.relative_motion.flights import Flights
from studies.relative_motion.formation import ASSUMED_SIZE_M, M_PER_FT, SIZE_SIGMA
from studies.relative_motion.noise import Noise
from studies.report.runs import rms

START_POSITION_SIGMA_M: Final = 1e3  # before the first image
DIFFERENCE_STEP: Final = 1e-4  # m, m/s, m/s^2: of finite differences
ASSUMES: Final = (
    "own motion exact; process noise as the shipped filter assumes; 1 px on each coordinate of three points, "
    "the leader's attitude known; size prior 2 %"
)


class Bound(Record, frozen=True, kw_only=True):
    """Least root mean square errors over t >= 15 s."""

    position_ft: float
    velocity_ft_s: float
    range_percent: float
    a_lat_ft_s2: float


class FlightBound(Bound, frozen=True, kw_only=True):
    """The bound of one flight."""

    seed: int


class VariantBound(Bound, frozen=True, kw_only=True):
    """The bound over all flights of a variant."""

    variant: str


def bounds(flights: Flights, camera: Camera, noise: Noise, settled: float) -> list[FlightBound]:
    """Return the bound of each flight for a camera in the follower's centre, over t >= `settled` s."""
    truth, t = flights.nav_truth, flights.nav_t
    count, samples = truth.a_lat.shape
    size = np.broadcast_to(flights.size[:, None], (count, samples))
    states = np.concatenate(
        [truth.r_FL_n, truth.v_FL_n, np.stack([size, truth.a_lat, truth.a_long], axis=-1)], axis=-1
    )
    R_cn = matrix_from_euler(*np.radians(camera.mount_rpy_deg)).T @ np.swapaxes(
        matrix_from_quaternion(truth.q_nF), 2, 3
    )
    wing = matrix_from_quaternion(truth.q_nL)[..., :, 1]
    variance = (camera.sigma_px / camera.f_px) ** 2
    image_at = {int(k): image for image, k in enumerate(flights.image_at)}
    registered = np.asarray(np.isfinite(flights.image_points).all(axis=(2, 3)))
    sigma = (
        [START_POSITION_SIGMA_M] * 3
        + [noise.initial_velocity] * 3
        + [SIZE_SIGMA]
        + [noise.initial_acceleration] * 2
    )
    P = np.tile(np.diag(np.square(sigma)), (count, 1, 1))
    squares = np.zeros((count, 4))
    settled_samples = 0
    for k in range(samples):
        if k:
            dt = float(t[k] - t[k - 1])
            F = _transition(flights, states[:, k - 1], k, dt, noise)
            P = F @ P @ np.swapaxes(F, 1, 2) + process_noise(ASSUMED_SIZE_M, noise.walks) * dt
        image = image_at.get(k)
        if image is not None:
            at = registered[:, image]
            P[at] = _informed(P[at], _sensitivity(states[at, k], R_cn[at, k], wing[at, k]), variance)
        if t[k] >= settled:
            squares += _squares(P, states[:, k])
            settled_samples += 1
    errors = np.sqrt(squares / max(settled_samples, 1))
    return [
        FlightBound(
            seed=seed,
            position_ft=float(row[0] / M_PER_FT),
            velocity_ft_s=float(row[1] / M_PER_FT),
            range_percent=float(100 * row[2]),
            a_lat_ft_s2=float(row[3] / M_PER_FT),
        )
        for seed, row in zip(flights.seeds, errors, strict=True)
    ]


def over_flights(variant: str, bounds: Sequence[FlightBound]) -> VariantBound:
    """The bound over all flights of a variant: root mean squares."""
    pooled = {name: rms([getattr(b, name) for b in bounds]).value or np.nan for name in Bound.__struct_fields__}
    return VariantBound(variant=variant, **pooled)


def _squares(P: Array, x: Array) -> Array:
    """Return variances (B, 4): position and velocity (summed), relative range, a_lat."""
    distance = np.linalg.norm(x[:, POSITION], axis=1)
    ahead = x[:, POSITION] / distance[:, None]
    along = np.einsum("bi,bij,bj->b", ahead, P[:, POSITION, POSITION], ahead)
    trace = [np.einsum("bii->b", P[:, at, at]) for at in (POSITION, VELOCITY)]
    return np.stack([*trace, along / distance**2, P[:, A_LAT, A_LAT]], axis=1)


def _transition(flights: Flights, x: Array, k: int, dt: float, noise: Noise) -> Array:
    """F (B, 9, 9): the Jacobian of the model at the true states x (B, 9)."""
    v, a = flights.nav_truth.v_F_n, flights.nav_truth.a_F_n
    follower = FollowerMotion(v[:, k - 1], v[:, k], a[:, k - 1], a[:, k])
    after = relative_motion.process_batch(_around(x), dt, follower, noise.hover_speed)
    return _slopes(after)


def _sensitivity(x: Array, R_cn: Array, wing: Array) -> Array:
    """H (B, 6, 9) of the three points."""
    rows = _around(x)
    half = 0.5 * rows[..., SIZE, None] * wing[:, None]
    coordinates = []
    for place in (rows[..., POSITION], rows[..., POSITION] - half, rows[..., POSITION] + half):
        x_c, y_c, z_c = np.moveaxis(place @ np.swapaxes(R_cn, 1, 2), -1, 0)
        coordinates += [y_c / x_c, z_c / x_c]
    return _slopes(np.stack(coordinates, axis=-1))


def _around(x: Array) -> Array:
    """Rows (B, 18, 9) a little above and below x (B, 9) in each component."""
    steps = DIFFERENCE_STEP * np.eye(x.shape[1])
    return np.asarray(x[:, None] + np.concatenate([steps, -steps]))


def _slopes(images: Array) -> Array:
    """Derivatives (B, m, n) from the images (B, 2n, m) of `_around`."""
    n = images.shape[1] // 2
    return np.swapaxes(images[:, :n] - images[:, n:], 1, 2) / (2 * DIFFERENCE_STEP)


def _informed(P: Array, H: Array, variance: float) -> Array:
    """(P^-1 + H^T H / variance)^-1."""
    PHt = P @ np.swapaxes(H, 1, 2)
    S = H @ PHt + variance * np.eye(H.shape[1])
    informed = P - PHt @ np.linalg.solve(S, np.swapaxes(PHt, 1, 2))
    return np.asarray(0.5 * (informed + np.swapaxes(informed, 1, 2)))
