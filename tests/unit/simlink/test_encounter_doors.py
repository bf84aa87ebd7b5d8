"""What an encounter's detector and mount say beyond the wing: poses and gimbals, beside the truth."""

import numpy as np
import pytest

from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.messages import GimbalAttitude, RelativePose, TargetDetection, TargetPoints
from onboard.ownship import head_attitude
from simlink.encounters.encounter import Encounter, make_encounter
from simlink.sensors.arrays import Array
from simlink.sensors.poses import PoseDetector
from simlink.simulation import EPOCH_NS
from tests.unit.simlink.test_encounters import of, rotation, sampled


def posed(encounter: Encounter) -> list[RelativePose]:
    found = [m.pose for m in of(encounter, TargetDetection)]
    return [pose for pose in found if pose is not None]


def camera_to_n(encounter: Encounter, images: list[TargetDetection]) -> list[Array]:
    mount = rotation(np.radians(encounter.scenario.camera.mount_rpy_deg))
    return [rotation(rpy) @ mount for rpy in sampled(encounter, encounter.truth.euler_F, images)]


@pytest.mark.parametrize("seed", [1])
def test_poses_are_about_the_truth_by_as_much_as_they_say_seed(seed: int) -> None:
    encounter = make_encounter("hover", seed, 15.0, "pose")
    images, poses = of(encounter, TargetDetection), posed(encounter)
    assert len(images) == len(poses) > 100
    truth = zip(
        camera_to_n(encounter, images),
        sampled(encounter, encounter.truth.r_FL_n, images),
        sampled(encounter, encounter.truth.euler_L, images),
        sampled(encounter, encounter.truth.euler_F, images),
        strict=True,
    )
    scales, noses, turns = [], [], []
    for pose, (R_nc, r_FL_n, rpy_L, rpy_F) in zip(poses, truth, strict=True):
        r = R_nc.T @ (r_FL_n - rotation(rpy_F) @ encounter.scenario.camera.mount_offset)
        scales.append(np.linalg.norm(pose.r_CL_c) / np.linalg.norm(r))
        forward = R_nc @ matrix_from_quaternion(pose.q_cL)[:, 0]
        noses.append(np.degrees(np.arccos(np.clip(forward @ rotation(rpy_L)[:, 0], -1.0, 1.0))))
        line = r / np.linalg.norm(r)
        turns.append(np.degrees(np.arccos(np.clip(abs(line @ (R_nc.T @ rotation(rpy_L)[:, 0])), -1.0, 1.0))))
    assert 0.9 < np.mean(scales) < 1.1
    assert np.mean(scales) != pytest.approx(1.0, abs=0.002)  # what lasts does not average out
    flipped = np.array(noses) > np.maximum(60.0, 0.8 * np.array(turns))
    assert flipped.mean() < 0.5
    assert np.median(np.array(noses)[~flipped]) < 25.0


def test_a_flip_is_the_mirror_image_about_the_line_of_sight() -> None:
    detector = PoseDetector(np.random.default_rng(1))
    detector._flips, detector._is_flipped = 1.0, True
    line = np.array([1.0, 0.0, 0.0])
    for nose in (0.4, 2.8):  # one is seen from behind, one from ahead
        R = detector._flip_if_ambiguous(matrix_from_euler(0.1, 0.0, nose), line)
        assert R[:, 0] == pytest.approx(matrix_from_euler(0.0, 0.0, -nose)[:, 0], abs=1e-9)
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_gimbal_says_where_the_camera_points_but_for_its_error_seeds_1_to_4() -> None:
    """The center of each image, turned by what the gimbal said, is where the leader is."""
    wrong, yaws = [], []
    for seed in range(1, 5):
        encounter = make_encounter("behind", seed, 10.0, mount="gimbal")
        images, reports = of(encounter, TargetPoints), of(encounter, GimbalAttitude)
        assert len(images) > 30  # of a camera of 4 to 30 Hz
        times = np.array([m.t_ns for m in reports])
        on_head = rotation(np.radians(encounter.scenario.camera.mount_rpy_deg))
        for m, r_FL_n, rpy in zip(
            images,
            sampled(encounter, encounter.truth.r_FL_n, images),
            sampled(encounter, encounter.truth.euler_F, images),
            strict=True,
        ):
            nearest = reports[int(np.argmin(np.abs(times - m.t_ns)))]
            if abs(nearest.t_ns - m.t_ns) > 4_000_000:
                continue
            R_nc = head_attitude(nearest.mount, rotation(rpy)) @ on_head
            sight = R_nc @ np.array([1.0, *m.center])
            truth = r_FL_n - rotation(rpy) @ encounter.scenario.camera.mount_offset
            off = np.arctan2(sight[1], sight[0]) - np.arctan2(truth[1], truth[0])
            wrong.append(np.degrees((off + np.pi) % (2 * np.pi) - np.pi))
            yaws.append(np.degrees(2 * np.arctan2(nearest.mount.q[3], nearest.mount.q[0])))
    assert len(wrong) > 60
    assert 0.2 < np.std(wrong) < 2.5
    assert np.ptp(yaws) > 20.0


def test_a_fixed_camera_has_no_gimbal_and_the_flight_is_the_same_seed_1() -> None:
    fixed, moving = make_encounter("behind", 1, 5.0), make_encounter("behind", 1, 5.0, mount="gimbal")
    assert of(fixed, GimbalAttitude) == []
    assert np.array_equal(fixed.truth.r_FL_n, moving.truth.r_FL_n)
    reports = of(moving, GimbalAttitude)
    assert min(np.diff([m.t_ns for m in reports])) > 0
    gimbal = moving.scenario.camera.gimbal
    late = [(m.t_recv_ns - EPOCH_NS - m.t_ns) * 1e-9 for m in reports]
    assert gimbal.latency + 0.001 <= min(late) <= max(late) <= gimbal.latency + 0.0071
