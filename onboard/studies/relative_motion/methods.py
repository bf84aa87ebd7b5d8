"""Oh & Johnson's unscented filter as methods of `_formation`: their settings, others, and our own."""

from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.oh_johnson_noise import initial_belief, process_noise
from onboard.estimators.leader.settings import PAPER, Noise, noise_for
from onboard.filters import unscented
from onboard.filters.belief import Belief
from onboard.filters.gating import chi_square_threshold
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import R, V
from onboard.studies.relative_motion.formation import FT, Filter, Method, Seen, Setting, Step, View

WEIGHTS: Final = unscented.julier_weights(relative_motion.N)
# R as given in degrees by the noise; the same for every image, diag(1, 1, 2) (sigma_px / f)^2; from its own points
ImageNoise = Literal["degrees", "constant", "points"]

TUNED_NOISE: Final = Noise(
    position_random_walk=0.02 * FT,
    velocity_random_walk=0.1 * FT,
    size_random_walk=1e-5,
    a_lat_random_walk=1 * FT,
    a_long_random_walk=0.3 * FT,
    initial_position=None,
    initial_velocity=12 * FT,
    initial_acceleration=10 * FT,
    angles_deg=None,
    gate_probability=None,
    hover_speed=0.0,
    initialise_images=1,
    consider_size=False,
)


def unscented_filter(setting: Setting, noise: Noise, image_noise: ImageNoise, fold: bool = False) -> Filter:
    """The nine-state filter. `fold`: eq 14's arctangents as printed, which take a leader behind for one ahead."""
    Q = np.diag(process_noise(noise, setting.size))
    measure = _measure_folded if fold else camera_angles.measure_batch
    considered = (relative_motion.SIZE,) if noise.consider_size else ()
    gate = (
        np.inf if noise.gate_probability is None else chi_square_threshold(noise.gate_probability, camera_angles.M)
    )
    # The error of our own attitude is nearly constant, so no innovation shows it: like the daemon, the filter adds
    # what it was told of it to what it says, and not to what it knows. The paper takes its attitude as known.
    own = np.radians(setting.nav.attitude_deg.sigma) * (noise.angles_deg is None)

    def angles_and_noise(view: View) -> tuple[Array, Array]:
        angles = camera_angles.angles_from_points(view.points)
        if image_noise == "points":
            return angles, camera_angles.noise_from_points(view.points, np.full(3, view.sigma))
        if image_noise == "constant":
            constant = np.diag([1.0, 1.0, 2.0]) * view.sigma**2
        else:
            constant = np.diag(np.radians(noise.angles_deg or ()) ** 2)
        return angles, np.broadcast_to(constant, (len(angles), 3, 3))

    def start(view: View) -> Belief:
        angles, image_R = angles_and_noise(view)
        beliefs = [
            initial_belief(noise, y, R_y, setting.size, setting.size_sigma, R_cn, r_FC_n)
            for y, R_y, R_cn, r_FC_n in zip(angles, image_R, view.R_cn, view.r_FC_n, strict=True)
        ]
        return Belief(*(np.array(arrays) for arrays in zip(*beliefs, strict=True)))

    def predict(belief: Belief, step: Step) -> Belief:
        process = _by_filter(
            belief,
            lambda points: relative_motion.process_batch(points, step.dt, step.follower, noise.hover_speed),
        )
        return unscented.predict(belief, process, Q * step.dt, WEIGHTS)

    def see(belief: Belief, view: View) -> Seen:
        angles, image_R = angles_and_noise(view)
        update = unscented.update(
            belief,
            angles,
            _by_filter(belief, lambda points: measure(points, view.R_cn, view.r_FC_n)),
            image_R,
            WEIGHTS,
            camera_angles.ANGULAR,
            considered,
        )
        fused = update.nis <= gate
        mean = np.where(fused[:, None], update.belief.mean, belief.mean)
        covariance = np.where(fused[:, None, None], update.belief.covariance, belief.covariance)
        return Seen(Belief(mean, covariance), update.nis, fused)

    def to_nine(belief: Belief) -> Belief:
        return with_attitude_error(belief, own) if own else belief

    return Filter(start, predict, see, to_nine)


def with_attitude_error(belief: Belief, sigma: float) -> Belief:
    """Beliefs (B, 9) told with the error (rad, about each axis) of the attitude that they were formed in: as
    `relative_motion.rotation_covariance`."""
    turned = np.zeros((*belief.mean.shape, 3))
    for at in (R, V):
        x, y, z = np.moveaxis(belief.mean[:, at], -1, 0) * sigma
        o = np.zeros_like(x)
        turned[:, at] = np.moveaxis(np.array([[o, z, -y], [-z, o, x], [y, -x, o]]), -1, 0)
    return Belief(belief.mean, belief.covariance + turned @ np.swapaxes(turned, 1, 2))


def _by_filter(belief: Belief, model: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """A model over points (B, k, 9) as the filters call it: over the rows of all, each filter's together."""
    count, n = belief.mean.shape

    def over_rows(rows: Array) -> Array:
        images = model(rows.reshape(count, -1, n))
        return images.reshape(-1, images.shape[-1])

    return over_rows


def _measure_folded(points: Array, R_cn: Array, r_FC_n: Array) -> Array:
    """`camera_angles.measure_batch` with plain arctangents."""
    angles = camera_angles.measure_batch(points, R_cn, r_FC_n)
    angles[..., :2] = np.arctan(np.tan(angles[..., :2]))
    return angles


def _shipped(setting: Setting) -> Filter:
    return unscented_filter(setting, noise_for("honest", setting.leader_class), "points")


PAPER_MENDED: Final = Method(
    "paper", "the paper's settings, atan2", lambda setting: unscented_filter(setting, PAPER, "degrees")
)
AS_PRINTED: Final = Method(
    "printed",
    "the paper's settings, atan as in eq 14",
    lambda setting: unscented_filter(setting, PAPER, "degrees", fold=True),
)
TUNED: Final = Method(
    "tuned", "R from pixels, Q to match", lambda setting: unscented_filter(setting, TUNED_NOISE, "constant")
)
# without the daemon's allowance for an error of its own attitude, unless the setting tells of one
SHIPPED: Final = Method("honest", "size considered, gated", _shipped)
R_ALONE: Final = Method(
    "r-alone",
    "R from pixels, the paper's Q and P0",
    lambda setting: unscented_filter(setting, PAPER._replace(angles_deg=None), "constant"),
)
METHODS: Final = (PAPER_MENDED, TUNED, SHIPPED)
