"""Poses in detections: optical axes outside, c inside; what cannot be a pose is refused by its field."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.client import pose_of
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion, quaternion_from_matrix
from onboard.messages import TargetDetection, TargetPoints
from onboard.wire.documents.poses import ROTATION_SIGMA
from tests.unit.wire.test_detections import BOX, CENTER, HEAD, LEFT, RIGHT, Decoded, one

OPTICAL = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # from forward, right, down
AWAY = tuple(quaternion_from_matrix(OPTICAL).tolist())  # an aircraft that flies along the optical axis, level
DIAGONAL = np.diag([0.01, 0.02, 0.25, 0.04, 0.05, 0.06])
SKEW = DIAGONAL + np.eye(6, k=1) * 1e-3
WHOLE = " - at `$.detections[0]`"
AT = " - at `$.detections[0].pose"
FORWARD = f"expected right, down, forward{AT}"


def pose(**fields: Any) -> dict[str, Any]:
    return {"position_m": [1.0, -2.0, 20.0], "q": list(AWAY), "covariance": DIAGONAL.tolist()} | fields


def test_a_pose_is_turned_from_the_optical_axes_to_those_of_c() -> None:
    m = one(pose=pose())
    assert isinstance(m, TargetDetection)
    assert m.pose is not None
    assert m.pose.r_CL_c == (20.0, 1.0, -2.0)
    assert_allclose(matrix_from_quaternion(m.pose.q_cL), np.eye(3), atol=1e-12)
    assert_allclose(m.pose.r_covariance, np.diag([0.25, 0.01, 0.02]), atol=1e-15)
    assert_allclose(m.pose.turn_covariance, np.diag([0.06, 0.04, 0.05]), atol=1e-15)


def test_what_opencv_gives_is_the_pose_of_its_points() -> None:
    """Points in the aircraft's axes, an aircraft with its nose 30 degrees to the right, and 10 degrees up."""
    cv2 = pytest.importorskip("cv2")
    body = np.array([[0.7, 0.0, 0.0], [-0.8, 0.0, -0.1], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -0.3]])
    R_cL, r = matrix_from_euler(0.1, math.radians(10), math.radians(30)), np.array([15.0, 1.0, -2.0])
    k = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    seen = (body @ R_cL.T + r) @ OPTICAL.T
    pixels = (seen / seen[:, 2:]) @ k.T
    found, rvec, tvec = cv2.solvePnP(body, pixels[:, :2].copy(), k, None, flags=cv2.SOLVEPNP_SQPNP)
    assert found
    sent = pose_of(rvec, tvec)
    m = one(pose={"position_m": sent.position_m, "q": sent.q})
    assert_allclose(m.pose.r_CL_c, r, rtol=1e-4)
    assert_allclose(matrix_from_quaternion(m.pose.q_cL), R_cL, atol=1e-3)


def test_the_position_is_the_center_where_no_point_is_named() -> None:
    m = one(pose=pose(), box=BOX)
    assert [f.name for f in m.features] == ["center", "box"]
    assert m.features[0].point == (0.05, -0.1)
    # of down: 0.02 m^2, and 0.25 m^2 along an axis that is seen at -0.1
    assert m.features[0].sigma == pytest.approx(math.sqrt(0.02 + 0.01 * 0.25) / 20)
    assert [f.name for f in one(pose=pose(), points={"left": LEFT}).features] == ["left"]
    whole = one(pose=pose(), points={"center": CENTER | {"v_px": 200.0}, "left": LEFT, "right": RIGHT})
    assert isinstance(whole, TargetPoints)
    assert whole.pose is not None


def test_without_a_covariance_a_position_is_as_exact_as_a_point_across_and_vague_along() -> None:
    m = one(pose=pose(covariance=None, position_m=[0.0, 0.0, 20.0]), confidence=0.5)
    along, across, _ = np.sqrt(np.diag(m.pose.r_covariance))
    assert (along, across) == (pytest.approx(20 * 0.05, rel=0.01), pytest.approx(20 * 2 / 500))
    assert_allclose(m.pose.turn_covariance, ROTATION_SIGMA**2 * np.eye(3))


def test_either_part_may_be_missing_and_its_covariance_is_not_read() -> None:
    broken = np.diag([1.0, 1.0, 1.0, 0.0, -1.0, 5.0])
    placed = one(pose=pose(q=None, covariance=broken.tolist())).pose
    assert (placed.q_cL, placed.turn_covariance) == (None, None)
    assert_allclose(placed.r_covariance, np.eye(3))
    turned = one(pose=pose(position_m=None, covariance=broken[::-1, ::-1].tolist()), points={"center": CENTER})
    assert (turned.pose.r_CL_c, turned.pose.r_covariance) == (None, None)
    assert_allclose(turned.pose.turn_covariance, np.eye(3))


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        ({"position_m": None, "q": None}, "expected `position_m`, `q`, or both - at `$.detections[0].pose`"),
        (
            pose(position_m=None),
            "expected `points` with some of center, left, right, a `box`, or a `pose` with `position_m`" + WHOLE,
        ),
        (pose(position_m=[0.0, 0.0, -20.0]), f"it is behind the camera; {FORWARD}.position_m`"),
        (pose(position_m=[0.0, 0.0, 0.0]), f"it is behind the camera; {FORWARD}.position_m`"),
        (pose(position_m=[0.0, 0.0, 1e6]), f"expected metres below 100000{AT}.position_m`"),
        (pose(q=[0.0, 0.0, 0.0, 0.0]), f"expected a quaternion w, x, y, z of length 1{AT}.q`"),
        (pose(q=[3.0, 0.0, 0.0, 0.0]), f"expected a quaternion w, x, y, z of length 1{AT}.q`"),
        (pose(q=[1.0, 0.0, 0.0]), f"Expected `array` of length 4, got 3{AT}.q`"),
        (pose(covariance=(-DIAGONAL).tolist()), f"a covariance is positive definite{AT}.covariance`"),
        (pose(covariance=np.zeros((6, 6)).tolist()), f"a covariance is positive definite{AT}.covariance`"),
        (pose(covariance=SKEW.tolist()), f"a covariance is symmetric{AT}.covariance`"),
        (pose(covariance=np.eye(5).tolist()), f"Expected `array` of length 6, got 5{AT}.covariance`"),
    ],
)
def test_what_cannot_be_a_pose_is_refused_by_its_field(bad: dict[str, Any], expected: str) -> None:
    decoded = Decoded({**HEAD, "detections": [{"pose": bad}]})
    assert decoded.messages == []
    assert decoded.reasons == [expected]


@pytest.mark.parametrize("field", ["position_m", "q", "covariance"])
def test_what_is_no_number_is_refused_by_its_field(field: str) -> None:
    """JSON has no NaN: what stands for it is no number."""
    value = np.array(pose()[field], dtype=object)
    value.flat[-1] = None
    decoded = Decoded({**HEAD, "detections": [{"pose": pose(**{field: value.tolist()})}]})
    assert decoded.messages == []
    (reason,) = decoded.reasons
    assert reason.startswith(f"Expected `float`, got `null`{AT}.{field}")
