"""What chance changes in a cloud of noses; a file of its own because the mutants run it without the compiler."""

import math

import numpy as np
import pytest

from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.filters.filter import Measurement
from onboard.estimators.leader.filters.noses import particles
from onboard.estimators.leader.settings import NoseModel
from onboard.models import apparent_wing as model

NOSES = NoseModel(
    size=2.0, size_sigma=0.04, misalignment=(0.007, 0.007, 0.024), misalignment_time=60.0, own_velocity=0.1
)
STILL = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
# 25 m to the north
IMAGE = Measurement(np.array([0.0, 0.0, 0.07, 0.0]), 3e-6 * np.eye(4), 0.07, 1.8e-3, np.eye(3))


def test_a_doubted_nose_shows_the_same_image() -> None:
    """A particle that takes another nose is nearer or farther by as much as its wing is seen less or more."""
    settings = NOSES._replace(doubted_after=1e-9)
    cloud = particles.start(settings, IMAGE, STILL)
    after = particles.predict(settings, cloud, 1e-6, np.zeros(3))
    assert np.abs(after.noses - cloud.noses).max() > 0.5
    direction = after.means[:, :3] / np.linalg.norm(after.means[:, :3], axis=1)[:, None]
    lengths = model.visible(after.noses, direction) / np.linalg.norm(after.means[:, :3], axis=1)
    assert lengths == pytest.approx(np.full(len(lengths), lengths.mean()), rel=1e-3)


def test_a_doubted_nose_of_a_fixed_wing_stays_about_its_course() -> None:
    settings = NOSES._replace(crab=math.radians(14.0), doubted_after=1e-9)
    flies = STILL._replace(v_F_n=np.array([15.0, 0.0, 0.0]))
    cloud = particles.start(settings, IMAGE, flies)
    course = np.arctan2(cloud.means[:, 4], cloud.means[:, 3])
    after = particles.predict(settings, cloud, 1e-6, 1e-6 * flies.v_F_n)
    assert np.abs(after.noses - course).max() < 2.6 * settings.crab
    assert np.abs(after.noses - cloud.noses).max() > settings.crab
