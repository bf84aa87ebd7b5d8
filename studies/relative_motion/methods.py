"""Oh & Johnson's unscented filter as methods of the study: their settings, others, and our own."""

from collections.abc import Callable
from functools import partial
from typing import Final, Literal

import numpy as np

from onboard.arrays import Array
from onboard.estimators.oh_johnson.noise import process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief
from onboard.filters.gating import chi_square_threshold
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import POSITION, VELOCITY
from studies.relative_motion.formation import Filter, Images, ImageUpdate, Method, Setting, Step
from studies.relative_motion.noise import PAPER, Noise, honest_noise, initial_belief

WEIGHTS: Final = unscented.julier_weights(relative_motion.STATE_SIZE)
# R from the settings' degrees; the same for all images, diag(1, 1, 2) (sigma_px / f)^2; from each image's points
ImageNoise = Literal["degrees", "constant", "points"]

# honest noise, ungated, the size estimated
TUNED_NOISE: Final = honest_noise("fixed_wing")._replace(
    gate_probability=None, hover_speed=0.0, consider_size=False
)


def unscented_filter(setting: Setting, noise: Noise, image_noise: ImageNoise, fold: bool = False) -> Filter:
    """The nine-state filter.

    `fold`: eq 14's arctangents as printed: a leader behind looks as if ahead.
    """
    Q = process_noise(setting.size, noise.walks)
    gate = (
        np.inf
        if noise.gate_probability is None
        else chi_square_threshold(noise.gate_probability, camera_angles.MEASUREMENT_SIZE)
    )
    measured = partial(_angles_and_noise, noise=noise, image_noise=image_noise)
    measure = _measure_folded if fold else camera_angles.measure_batch
    considered = (relative_motion.SIZE,) if noise.consider_size else ()
    # The error of our own attitude is nearly constant, so no innovation shows it: the filter adds its known
    # sigma to the reported covariance, and not to its own. The paper takes its attitude as known.
    attitude_sigma = np.radians(setting.nav.attitude_deg.sigma) * (noise.angles_deg is None)

    def start(images: Images) -> Belief:
        beliefs = [
            initial_belief(noise, y, R_y, setting.size, setting.size_sigma, R_cn, r_FC_n)
            for y, R_y, R_cn, r_FC_n in zip(*measured(images), images.R_cn, images.r_FC_n, strict=True)
        ]
        return Belief(*(np.array(arrays) for arrays in zip(*beliefs, strict=True)))

    def predict(belief: Belief, step: Step) -> Belief:
        process = _by_filter(
            belief,
            lambda points: relative_motion.process_batch(points, step.dt, step.follower, noise.hover_speed),
        )
        return unscented.predict(belief, process, Q * step.dt, WEIGHTS)

    def update(belief: Belief, images: Images) -> ImageUpdate:
        angles, R_y = measured(images)
        model = _by_filter(belief, lambda points: measure(points, images.R_cn, images.r_FC_n))
        after = unscented.update(belief, angles, model, R_y, WEIGHTS, camera_angles.ANGULAR, considered)
        fused = after.nis <= gate
        mean = np.where(fused[:, None], after.belief.mean, belief.mean)
        covariance = np.where(fused[:, None, None], after.belief.covariance, belief.covariance)
        return ImageUpdate(Belief(mean, covariance), after.nis, fused)

    def nine_states(belief: Belief) -> Belief:
        return with_attitude_error(belief, attitude_sigma) if attitude_sigma else belief

    return Filter(start, predict, update, nine_states)


def _angles_and_noise(images: Images, noise: Noise, image_noise: ImageNoise) -> tuple[Array, Array]:
    """The measured angles (B, 3), rad, and their R (B, 3, 3)."""
    angles = camera_angles.angles_from_points(images.points)
    if image_noise == "points":
        return angles, camera_angles.noise_from_points(images.points, np.full(3, images.sigma))
    if image_noise == "constant":
        constant = np.diag([1.0, 1.0, 2.0]) * images.sigma**2
    else:
        constant = np.diag(np.radians(noise.angles_deg or ()) ** 2)
    return angles, np.broadcast_to(constant, (len(angles), 3, 3))


def with_attitude_error(belief: Belief, sigma: float) -> Belief:
    """Widen beliefs (B, 9) by a constant small error of our own attitude, which rotates both vectors.

    The error is in rad, 1 sigma about each axis.
    """
    slopes = np.zeros((*belief.mean.shape, 3))
    for at in (POSITION, VELOCITY):
        x, y, z = np.moveaxis(belief.mean[:, at], -1, 0) * sigma
        o = np.zeros_like(x)
        slopes[:, at] = np.moveaxis(np.array([[o, z, -y], [-z, o, x], [y, -x, o]]), -1, 0)
    return Belief(belief.mean, belief.covariance + slopes @ np.swapaxes(slopes, 1, 2))


def _by_filter(belief: Belief, model: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return a model over points (B, k, 9) as filters call it, over the rows of all filters."""
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


def _honest(setting: Setting) -> Filter:
    return unscented_filter(setting, honest_noise(setting.leader_class), "points")


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
# with an allowance for an error of our own attitude only if the setting has one
HONEST: Final = Method("honest", "size considered, gated", _honest)
R_ALONE: Final = Method(
    "r-alone",
    "R from pixels, the paper's Q and P0",
    lambda setting: unscented_filter(setting, PAPER._replace(angles_deg=None), "constant"),
)
