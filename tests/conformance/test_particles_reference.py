"""The particles beside a reference: a bootstrap particle filter of the same model, written on its own."""

import math
from typing import Final

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.particles import Particles
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.measurement import Measurement, measure_wing
from tests.support import bootstrap

SIGMA: Final = 2.0 / 554.0
STILL: Final = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
DT: Final = 0.1


def image(aspect: float, east: float, rng: np.random.Generator) -> tuple[Array, Measurement]:
    """The leader hovers 25 m to the north of where we began; its heading is `aspect` rad off the line of sight."""
    wing = np.array([-math.sin(aspect), math.cos(aspect), 0.0])
    ends = [np.array([25.0, -east, 0.0]) + side * wing for side in (0.0, -1.0, 1.0)]
    points = np.array([p[1:] / p[0] for p in ends]) + SIGMA * rng.normal(size=(3, 2))
    seen = np.concatenate([points[0], points[2] - points[1]])
    return seen, measure_wing(points.tolist(), [SIGMA] * 3)


@pytest.mark.parametrize("aspect_deg", [20.0, 60.0])
@pytest.mark.parametrize(
    ("images", "draws"), [(3, 40_000), (5, 40_000), pytest.param(10, 400_000, marks=pytest.mark.slow)]
)
def test_the_cloud_is_as_sure_of_the_range_as_the_reference_seed_3(
    aspect_deg: float, images: int, draws: int
) -> None:
    """We sway by 3 m. After more images the reference has too few draws left near any velocity."""
    rng, noise = np.random.default_rng(3), np.random.default_rng(4)
    seen, measured = image(math.radians(aspect_deg), 0.0, noise)
    reference = bootstrap.start(bootstrap.CALM, seen, SIGMA, draws, rng)
    particles, east = start(bootstrap.CALM, measured, STILL), 0.0
    for k in range(1, images + 1):
        new = 3.0 * math.sin(2.0 * math.pi * k / 40.0)
        moved, east = np.array([0.0, new - east, 0.0]), new
        seen, measured = image(math.radians(aspect_deg), east, noise)
        reference = bootstrap.predict(bootstrap.CALM, reference, DT, moved, rng)
        reference = bootstrap.update(bootstrap.CALM, reference, seen, SIGMA, rng)
        particles = prediction.predict(bootstrap.CALM, particles, DT, moved)
        particles, _ = update.update(bootstrap.CALM, particles, measured, STILL)
    theirs = np.log(np.linalg.norm(reference.r, axis=1))
    mean, sigma = log_range(particles)
    assert 0.75 < sigma / theirs.std() < 1.4
    assert abs(mean - theirs.mean()) < 0.5 * theirs.std()


def log_range(particles: Particles) -> tuple[float, float]:
    """Mean and standard deviation of the logarithm of the range, by the whole particles."""
    w, r = np.exp(particles.log_weights), particles.means[:, :3]
    logs, line = np.log(np.linalg.norm(r, axis=1)), r / np.linalg.norm(r, axis=1)[:, None]
    within = np.einsum("ki,kij,kj->k", line, particles.covariances[:, :3, :3], line) / np.exp(2.0 * logs)
    mean = float(w @ logs)
    return mean, math.sqrt(w @ ((logs - mean) ** 2 + within))
