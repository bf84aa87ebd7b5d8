"""The filter of one target, and what it assumes, by a configuration."""

import math
from typing import Any, Final

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.filters.belief import BeliefFilter
from onboard.estimators.leader.image.shape import shape_of
from onboard.estimators.leader.settings import NoseModel, overridden

CRAB: Final = math.radians(14.0)  # rad, of a fixed wing's nose: wind of a quarter of its speed, at one sigma
FEW: Final = 200  # hypotheses of a plain filter
CALM: Final[dict[str, Any]] = {
    "intensity": (0.0, 0.0, 0.0),
    "hovering": 0.0,
    "accelerating": 0.0,
    "acceleration_random_walk": (0.3, 0.3),
    "bank": math.radians(1.0),
}
UNSURE: Final = 1.4  # times the configured errors of our attitude: their sigmas are guesses, too
SMALLEST_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is known better than this needs no state


def make_filter(config: Config) -> BeliefFilter:
    """The filter of a target of this configuration."""
    return BeliefFilter(nose_model(config), shape_of(config), config.delay_sigma_s)


def make_plain_filter(config: Config) -> BeliefFilter:
    """A filter that supposes a calm leader, whatever images show: by how badly they fit it, frames of a gimbal are
    compared."""
    shape = shape_of(config)._replace(center_on_wing=False)
    calm = nose_model(config)._replace(**CALM, particles=FEW)
    return BeliefFilter(calm, shape, config.delay_sigma_s)


def nose_model(config: Config) -> NoseModel:
    """What is assumed of a leader and of our own errors."""
    known = config.own_tilt_sigma_deg, config.own_yaw_sigma_deg
    tilt, yaw = (max(UNSURE * math.radians(sigma), SMALLEST_SIGMA) for sigma in known)
    model = NoseModel(
        size=config.size_prior_m,
        size_sigma=config.size_prior_sigma_m or 0.02 * config.size_prior_m,
        misalignment=(tilt, tilt, yaw),
        misalignment_time=config.own_attitude_time_s,
        own_velocity=max(config.own_velocity_sigma_m_s, SMALLEST_SIGMA),
        particles=config.particles,
    )
    if config.leader_class == "fixed_wing":
        model = model._replace(
            drag=0.0,
            drag_sigma=0.0,
            wind=0.0,
            lean_random_walk=0.0,
            crab=CRAB,
            tied=0.0,
            nose_about_course=CRAB,
        )
    return overridden(model, config.process_noise)
