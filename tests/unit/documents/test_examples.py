"""Examples in the documents, as a reader would use them."""

import math
from types import ModuleType

import msgspec
import pytest

from onboard.config import load_config
from onboard.estimators import EstimatorProtocol
from onboard.geometry.camera import make_camera
from onboard.messages import Cause, Exposure, Reason, TargetDetection, TargetImage, TargetPoints
from onboard.ownship import Ownship
from onboard.wire.documents.detections import decode_detections
from onboard.wire.documents.points import decode_points
from tests.support import documents
from tests.support.leader import leader_state, lost_state


def example() -> ModuleType:
    (block,) = documents.blocks(documents.text("contributing"), "python")
    module = ModuleType("example")
    exec(block, module.__dict__)  # noqa: S102 - what a reader would paste
    return module


def test_the_example_estimates_a_range() -> None:
    module = example()
    assert (Exposure,) == module.LISTENS
    estimator: EstimatorProtocol = module.Estimator(
        module.Config(size_m=3.0), make_camera(f_px=500.0, width_px=640, height_px=480)
    )
    image = TargetPoints(
        t_ns=1, t_recv_ns=1, camera="front", center=(0.0, 0.0), left=(-0.05, 0.0), right=(0.05, 0.0)
    )
    ownship = Ownship(max_extrapolation=0.1)
    (estimate,) = estimator.observe(Exposure.of(image), ownship)
    assert estimate.mean is not None
    assert math.isclose(estimate.mean[0], 30.0)
    assert estimator.tick(ownship) == []
    estimator.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))


def test_the_camera_points_of_the_page_decode() -> None:
    _, _, block, _ = documents.blocks(documents.text("detectors"), "json")
    (points,) = decode_points(block.encode(), 1).detections
    assert isinstance(points, TargetPoints)
    assert points.target == "leader"
    assert points.center == pytest.approx((11.2 / 600, -15.1 / 600))
    assert points.sigma == pytest.approx((1 / 600,) * 3)


def test_the_example_of_a_follower_uses_only_a_leader_that_it_may_fly_on() -> None:
    (block,) = documents.blocks(documents.text("follow"), "python")
    module = ModuleType("follower")
    exec(block, module.__dict__)  # noqa: S102 - what a reader would paste
    leader = leader_state()
    r, v = module.leader_now(msgspec.json.encode(leader), leader.t_host_ns + 100_000_000)
    assert r == pytest.approx((130.0, 54.8, -38.1))
    assert tuple(v) == leader.v_L_n
    for late_ns, record in (
        (400_000_000, leader),
        (0, lost_state()),
        (0, leader_state(covariance=((26.0, 0, 0, 0, 0, 0), *leader.covariance[1:]))),
    ):
        assert module.leader_now(msgspec.json.encode(record), record.t_host_ns + late_ns) is None


def test_the_detections_of_the_page_decode() -> None:
    block, pose, _, turned = documents.blocks(documents.text("detectors"), "json")
    cameras, refused = load_config(None).camera_inputs(), []

    def images(document: str) -> tuple[TargetImage, ...]:
        exposure = decode_detections(document.encode(), 1, cameras, refused.append, refused.append)
        assert exposure is not None
        return exposure.detections

    pair, box = images(block)
    assert refused == []
    assert isinstance(pair, TargetDetection)
    assert [f.name for f in pair.features] == ["left", "right"]
    assert pair.features[1].sigma == pytest.approx(2 / 554.256)
    assert (box.target, box.camera) == ("wingman", "front")
    (away,) = images(pose)
    assert away.pose is not None
    assert away.pose.r_CL_c == (24.1, 1.2, -0.4)
    assert away.pose.q_cL == pytest.approx((1.0, 0.0, 0.0, 0.0))
    (direction,) = images(turned)
    assert refused == []
    assert direction.mount is not None
    assert direction.mount.frame == "body"
