"""One filter over one flight: Oh & Johnson's estimator on the arrays of `simlink.flight`, without the pipeline.

The clock is the navigation system's: a prediction to each of its samples with the follower's velocity and
acceleration taken as known (eq 8 ff.), and an update wherever an image was registered at that time.
"""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.estimators._leader_noise import HONEST, PAPER, Noise, initial_belief, process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief, FilterError, Update
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.rotations import Array, matrix_from_quaternion
from onboard.models import camera_angles, relative_motion
from simlink.flight import Flight
from simlink.scenario import Camera

FT: Final = 0.3048
B0: Final = 8.75 * FT  # the size the filter believes; the true one of each run differs by 2 % (1 sigma)
SIZE_SIGMA: Final = 0.02 * B0
WEIGHTS: Final = unscented.julier_weights(relative_motion.N)


class Method(NamedTuple):
    """A way to set the filter up. `image_noise`: R as given in degrees by `noise`; the same for every image,
    diag(1, 1, 2) (sigma_px/f)^2; or from each image's own points."""

    name: str
    label: str
    noise: Noise
    image_noise: Literal["degrees", "constant", "points"]
    fold: bool = False  # eq 14's arctangents as printed, which take a leader behind for one ahead


PAPER_MENDED: Final = Method("paper", "the paper's settings, atan2", PAPER, "degrees")
AS_PRINTED: Final = Method("printed", "the paper's settings, atan as in eq 14", PAPER, "degrees", fold=True)
TUNED: Final = Method(
    "tuned",
    "R from pixels, Q to match",
    Noise(
        position_walk=0.02 * FT,
        velocity_walk=0.1 * FT,
        size_walk=1e-5,
        a_lat_walk=1 * FT,
        a_long_walk=0.3 * FT,
        initial_position=None,
        initial_velocity=12 * FT,
        initial_acceleration=10 * FT,
        angles_deg=None,
        gate_probability=None,
        hover_speed=0.0,
        initialise_images=1,
        consider_size=False,
    ),
    "constant",
)
# without the daemon's allowance for an error of its own attitude, which here is exact
SHIPPED: Final = Method("honest", "as shipped: size considered, gated", HONEST, "points")
R_ALONE: Final = Method(
    "r-alone", "R from pixels, the paper's Q and P0", PAPER._replace(angles_deg=None), "constant"
)
METHODS: Final = (PAPER_MENDED, TUNED, SHIPPED)


class Track(NamedTuple):
    """A filter's account of one flight at its N navigation samples and M images; NaN where there is none.

    `mean` and `covariance` are posterior at times with an image. `failed_at`: s, when the covariance lost its
    Cholesky factor or a number overflowed; the filter stops there.
    """

    t: Array  # (N,)
    mean: Array  # (N, 9)
    covariance: Array  # (N, 9, 9)
    angles: Array  # (M, 3) measured
    innovation: Array  # (M, 3)
    nis: Array  # (M,)
    fused: NDArray[np.bool_]  # (M,)
    failed_at: float | None


def track(flight: Flight, camera: Camera, method: Method) -> Track:
    """Fly `method` over `flight`, seen by `camera` (which sits in the follower's centre, unturned).

    Raises ValueError for a camera that is mounted otherwise, or whose exposures miss the navigation samples.
    """
    image_of = _images_by_sample(flight, camera)
    n, m = len(flight.nav_t), len(flight.image_t)
    mean, covariance = np.full((n, 9), np.nan), np.full((n, 9, 9), np.nan)
    angles, innovation, nis = np.full((m, 3), np.nan), np.full((m, 3), np.nan), np.full(m, np.nan)
    fused = np.zeros(m, dtype=bool)
    gate = _gate(method.noise)
    belief, failed_at = None, None
    # where the printed settings diverge they also overflow: that is caught below as a failure, not a warning
    with np.errstate(all="ignore"):
        for k in range(n):
            try:
                belief = belief and _predict(belief, flight, k, method.noise)
                image = image_of[k]
                if image >= 0:
                    angles[image], R = _see(flight.image_points[image], camera, method)
                    R_cn = matrix_from_quaternion(flight.nav_q_nb[k]).T
                    if belief is None:
                        belief = _start(angles[image], R, R_cn, method.noise)
                    else:
                        update = _update(belief, angles[image], R, R_cn, method)
                        innovation[image], nis[image] = update.innovation, update.nis
                        fused[image] = update.nis <= gate
                        belief = update.belief if fused[image] else belief
                if belief is not None:
                    mean[k], covariance[k] = belief
            except FilterError:
                failed_at = float(flight.nav_t[k])
                break
    return Track(flight.nav_t, mean, covariance, angles, innovation, nis, fused, failed_at)


def _images_by_sample(flight: Flight, camera: Camera) -> list[int]:
    """For each navigation sample the index of the image registered at that time, or -1."""
    if any(camera.mount_rpy_deg) or any(camera.mount_offset):
        raise ValueError("the study's camera sits in the follower's centre and looks straight ahead")
    at = np.searchsorted(flight.nav_t[:-1], flight.image_t - 1e-6)
    if not np.allclose(flight.nav_t[at], flight.image_t, rtol=0, atol=1e-6):
        raise ValueError("images must be exposed at navigation samples")
    image_of = np.full(len(flight.nav_t), -1)
    registered = np.isfinite(flight.image_points).all(axis=(1, 2))
    image_of[at[registered]] = np.flatnonzero(registered)
    return [int(i) for i in image_of]


def _gate(noise: Noise) -> float:
    if noise.gate_probability is None:
        return float("inf")
    return chi_square_threshold(noise.gate_probability, camera_angles.M)


def _see(points: Array, camera: Camera, method: Method) -> tuple[Array, Array]:
    """Measured angles (3,) and their R (3, 3)."""
    sigma = camera.sigma_px / camera.f_px
    if method.image_noise == "points":
        R = camera_angles.noise_from_points(points, np.full(3, sigma))
    elif method.image_noise == "constant":
        R = np.diag([1.0, 1.0, 2.0]) * sigma**2
    else:
        R = np.diag(np.radians(method.noise.angles_deg or ()) ** 2)
    return camera_angles.angles_from_points(points), R


def _start(angles: Array, R: Array, R_cn: Array, noise: Noise) -> Belief:
    return initial_belief(noise, angles, R, B0, SIZE_SIGMA, R_cn, np.zeros(3))


def _predict(belief: Belief, flight: Flight, k: int, noise: Noise) -> Belief:
    """To sample `k` from the one before it."""
    v, a = flight.nav_v_F_n, flight.nav_a_F_n
    follower = relative_motion.FollowerMotion(v[k - 1], v[k], a[k - 1], a[k])
    dt = float(flight.nav_t[k] - flight.nav_t[k - 1])
    return unscented.predict(
        belief,
        lambda rows: relative_motion.process(rows, dt, follower, noise.hover_speed),
        np.diag(process_noise(noise, B0) * dt),
        WEIGHTS,
    )


def _update(belief: Belief, angles: Array, R: Array, R_cn: Array, method: Method) -> Update:
    measure = _measure_folded if method.fold else camera_angles.measure
    return unscented.update(
        belief,
        angles,
        lambda rows: measure(rows, R_cn, np.zeros(3)),
        R,
        WEIGHTS,
        camera_angles.ANGULAR,
        (relative_motion.SIZE,) if method.noise.consider_size else (),
    )


def _measure_folded(points: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """`camera_angles.measure` with plain arctangents."""
    angles = camera_angles.measure(points, R_cn, r_FC_n)
    angles[:, :2] = np.arctan(np.tan(angles[:, :2]))
    return angles
