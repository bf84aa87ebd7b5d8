"""Poses, volumes, tags and lenses in ROS, as rosbags' own encoder writes them. Needs the extra `ros2`."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from onboard.config import Config, parse_config
from onboard.messages import Datagram, Encoding, TargetDetection, TargetPoints
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.ros.received import CAMERA_INFO, DECODERS, decode_camera_info, decode_pose
from onboard.wire.ros.types import RosTypes
from tests.support.images import detections
from tests.support.streams import EPOCH, Run, feed

pytest.importorskip("rosbags", reason="needs the extra `ros2`")

STAMP = 1_735_689_605_250_000_000
POSE = "geometry_msgs/PoseWithCovarianceStamped"
VOLUMES = "vision_msgs/Detection3DArray"
TAGS = "apriltag_msgs/AprilTagDetectionArray"
BOXES = "vision_msgs/Detection2DArray"
OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # from forward, left, up
ZERO = (0.0,) * 36
KNOWN = tuple(np.diag([0.01, 0.02, 0.3, 0.04, 0.05, 0.06]).ravel().tolist())


@pytest.fixture(scope="module")
def types() -> RosTypes:
    return RosTypes()


def header(types: RosTypes, frame: str = "camera_optical", t_ns: int = STAMP) -> Any:
    return types.make("std_msgs/Header", types.make("builtin_interfaces/Time", *divmod(t_ns, 10**9)), frame)


def spread_pose(types: RosTypes, r: Any, q: Any = (0.0, 0.0, 0.0, 1.0), covariance: Any = ZERO) -> Any:
    """geometry_msgs/PoseWithCovariance; q is x, y, z, w."""
    pose = types.make("geometry_msgs/Pose", types.make("geometry_msgs/Point", *r), _quaternion(types, q))
    return types.make("geometry_msgs/PoseWithCovariance", pose, np.array(covariance, float))


def _quaternion(types: RosTypes, q: Any) -> Any:
    return types.make("geometry_msgs/Quaternion", *map(float, q))


def pose_message(types: RosTypes, *fields: Any, frame: str = "camera_optical") -> bytes:
    return types.encode(types.make(POSE, header(types, frame), spread_pose(types, *fields)))


def volume(types: RosTypes, center: Any, *hypotheses: tuple[str, float, Any], id_: str = "7") -> Any:
    box = types.make(
        "vision_msgs/BoundingBox3D",
        types.make(
            "geometry_msgs/Pose", types.make("geometry_msgs/Point", *center), _quaternion(types, [0, 0, 0, 1])
        ),
        types.make("geometry_msgs/Vector3", 2.0, 1.0, 0.5),
    )
    results = [
        types.make(
            "vision_msgs/ObjectHypothesisWithPose", types.make("vision_msgs/ObjectHypothesis", name, score), pose
        )
        for name, score, pose in hypotheses
    ]
    return types.make("vision_msgs/Detection3D", header(types), results, box, id_)


def volumes(types: RosTypes, *found: Any) -> bytes:
    return types.encode(types.make(VOLUMES, header(types), list(found)))


def tags(types: RosTypes, number: int = 3) -> bytes:
    """A tag whose lower left corner is the first, counter-clockwise as apriltag_ros has them; v is down."""

    def point(u: float, v: float) -> Any:
        return types.make("apriltag_msgs/Point", u, v)

    corners = [point(300.0, 260.0), point(340.0, 258.0), point(342.0, 220.0), point(302.0, 222.0)]
    tag = types.make(
        *("apriltag_msgs/AprilTagDetection", "tag36h11", number, 0, 0.5, 60.0),
        *(point(321.0, 240.0), corners, np.arange(9.0)),
    )
    return types.encode(types.make(TAGS, header(types), [tag]))


def info(types: RosTypes, **changed: Any) -> bytes:
    fields: dict[str, Any] = {
        "height": 480,
        "width": 640,
        "model": "plumb_bob",
        "d": [-0.3, 0.1, 0.0, 0.0, 0.0],
        "k": [700.0, 0, 330.0, 0, 710.0, 250.0, 0, 0, 1],
        "p": [650.0, 0, 325.0, 0, 0, 655.0, 245.0, 0, 0, 0, 1, 0],
        "binning": (0, 0),
        "roi": (0, 0, 0, 0),
        **changed,
    }
    roi = types.make("sensor_msgs/RegionOfInterest", *fields["roi"], False)
    matrices = [np.array(fields[name], float) for name in ("d", "k")]
    message = types.make(
        *(CAMERA_INFO, header(types), fields["height"], fields["width"], fields["model"], *matrices),
        *(np.eye(3).ravel(), np.array(fields["p"], float), *fields["binning"], roi),
    )
    return types.encode(message)


def config(**camera: Any) -> Config:
    return parse_config({"camera": {"ros_topic": "eye/found"} | camera, "estimator": {"leader": {}}})


def sent(data: bytes, kind: str, topic: str = "eye/found") -> Datagram:
    package, name = kind.split("/")
    key = f"0/{topic}/{package}::msg::dds_::{name}_/RIHS01_{64 * '7'}" if kind else topic
    return Datagram(channel=key, encoding=Encoding.ROS, t_recv_ns=EPOCH, data=data)


def images(settings: Config, *datagrams: Datagram) -> tuple[list[Any], Run]:
    run = feed([], settings)
    return [m for datagram in datagrams for m in detections(run.pipeline.decode(datagram))], run


def reasons(run: Run) -> list[str]:
    return [refusal.reason for refusal in run.pipeline.health(EPOCH).refusals]


# ------------------------------------------------------------------------------- poses


def test_a_pose_is_of_an_aircraft_with_axes_of_rep_103_in_the_optical_frame(types: RosTypes) -> None:
    """An aircraft 24 m ahead that flies along the optical axis, yawed to the left by 0.2 rad."""
    q = Rotation.from_matrix(OPTICAL @ Rotation.from_euler("z", 0.2).as_matrix()).as_quat()
    (image,), run = images(config(), sent(pose_message(types, (1.2, -0.4, 24.0), q, KNOWN), POSE))
    assert reasons(run) == []
    assert isinstance(image, TargetDetection)
    assert image.t_ns == STAMP
    pose = image.pose
    assert pose is not None
    assert pose.r_CL_c == (24.0, 1.2, -0.4)
    assert_allclose(np.diag(pose.r_covariance), [0.3, 0.01, 0.02])
    assert_allclose(np.diag(pose.turn_covariance), [0.06, 0.04, 0.05])
    w, x, y, z = pose.q_cL or (0,) * 4
    # c is forward, right, down: yaw to the left is negative about down
    assert_allclose(Rotation.from_quat([x, y, z, w]).as_euler("ZYX"), [-0.2, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "position", "turned", "covariance"),
    [
        (((1.0, 2.0, 30.0),), True, False, False),  # the default orientation states none
        (((1.0, 2.0, 30.0), (0.5, -0.5, 0.5, -0.5), KNOWN), True, True, True),
        (((1.0, 2.0, 30.0), (0.5, -0.5, 0.5, -0.5), ZERO), True, True, False),
        (((1.0, 2.0, 30.0), (0.5, -0.5, 0.5, -0.5), np.diag([1, 1, 1, 0, 0, 0]).ravel()), True, False, True),
        (((1.0, 2.0, 30.0), (0.5, -0.5, 0.5, -0.5), np.diag([1, 1, 1, 9, 9, 9]).ravel()), True, False, True),
        (((1.0, 2.0, 30.0), (0.5, -0.5, 0.5, -0.5), np.diag([-1, -1, -1, 1, 1, 1]).ravel()), True, True, False),
        (((0.0, 0.0, 0.0), (0.5, -0.5, 0.5, -0.5), KNOWN), False, True, True),
    ],
)
def test_what_a_pose_does_not_state_is_not_made_up(
    types: RosTypes, fields: Any, position: bool, turned: bool, covariance: bool
) -> None:
    (detection,) = decode_pose(pose_message(types, *fields)).detections
    assert detection.pose is not None
    found = (detection.pose.position_m, detection.pose.q, detection.pose.covariance)
    assert [part is not None for part in found] == [position, turned, covariance]


@pytest.mark.parametrize("frame", ["map", "uav1/base_link", "odom"])
def test_a_pose_that_is_in_no_camera_s_frame_is_refused(types: RosTypes, frame: str) -> None:
    data = pose_message(types, (1.0, 2.0, 30.0), frame=frame)
    _, run = images(config(), sent(data, POSE))
    (why,) = reasons(run)
    assert why == f"`header.frame_id` is `{frame}`; expected the camera's optical frame: right, down, forward"
    moved = volumes(types)
    assert decoded_frame(types, moved, frame)


def decoded_frame(types: RosTypes, data: bytes, frame: str) -> bool:
    """Whether an array of volumes in that frame is refused, too."""
    message = types.store.deserialize_cdr(data, "vision_msgs/msg/Detection3DArray")
    message.header.frame_id = frame
    with pytest.raises(BadDocumentError, match="optical frame"):
        DECODERS[VOLUMES](types.encode(message))
    return True


def test_a_pose_that_states_nothing_is_refused(types: RosTypes) -> None:
    with pytest.raises(BadDocumentError, match="neither position nor orientation is set"):
        decode_pose(pose_message(types, (0.0, 0.0, 0.0)))


# ------------------------------------------------------------------------------- volumes


def test_a_volume_is_the_pose_of_its_best_hypothesis_or_the_middle_of_its_box(types: RosTypes) -> None:
    unset = spread_pose(types, (0.0, 0.0, 0.0))
    by_pose = volume(
        types,
        (9.0, 9.0, 9.0),
        ("bird", 0.25, unset),
        ("drone", 0.75, spread_pose(types, (1.0, -2.0, 30.0), (0.5, -0.5, 0.5, -0.5), KNOWN)),
    )
    by_box, nothing = volume(types, (2.0, 1.0, 20.0), ("drone", 0.5, unset)), volume(types, (0.0, 0.0, 0.0))
    settings = config(classes=["drone", ""], min_confidence=0.4)
    (first, second), run = images(settings, sent(volumes(types, by_pose, nothing, by_box), VOLUMES))
    assert (first.class_name, first.pose.r_CL_c, first.pose.q_cL is None) == ("drone", (30.0, 1.0, -2.0), False)
    assert (second.pose.r_CL_c, second.pose.q_cL) == ((20.0, 2.0, 1.0), None)
    (why,) = reasons(run)  # the one of which nothing is stated costs the others nothing
    assert why.endswith("at `$.detections[1]`")


# ------------------------------------------------------------------------------- tags


def test_a_tag_is_a_wing_and_its_family_and_number_its_class(types: RosTypes) -> None:
    (image,), _ = images(config(classes=["tag36h11:3"]), sent(tags(types), TAGS))
    assert isinstance(image, TargetPoints)
    assert image.class_name == "tag36h11:3"
    f = 554.256
    assert_allclose(image.center, (1.0 / f, 0.0))
    assert_allclose(image.left, (-19.0 / f, 1.0 / f))
    assert_allclose(image.right, (21.0 / f, -1.0 / f))
    found, run = images(config(classes=["tag36h11:3"]), sent(tags(types, 4), TAGS))
    assert found == []
    assert reasons(run)[0].startswith("`tag36h11:4` is not followed")


# ------------------------------------------------------------------------------- lenses


def test_a_camera_info_is_the_lens_of_the_images_after_it(types: RosTypes) -> None:
    settings = config(ros_camera_info="eye/camera_info")
    arrived = sent(info(types, d=[]), CAMERA_INFO, "eye/camera_info")
    found, run = images(settings, sent(tags(types), TAGS), arrived, sent(tags(types), TAGS))
    (image,) = found
    assert_allclose(image.center, ((321.0 - 330.0) / 700.0, (240.0 - 250.0) / 710.0))
    assert reasons(run) == ["no CameraInfo has come on `eye/camera_info` yet: its lens is not known"]


@pytest.mark.parametrize(
    ("changed", "rectified", "expected"),
    [
        ({}, False, (700.0, 710.0, 330.0, 250.0, 640.0, 480.0)),
        ({}, True, (650.0, 655.0, 325.0, 245.0, 640.0, 480.0)),
        ({"binning": (2, 2)}, False, (350.0, 355.0, 165.0, 125.0, 320.0, 240.0)),
        ({"roi": (20, 40, 400, 560)}, False, (700.0, 710.0, 310.0, 210.0, 560.0, 400.0)),
        ({"roi": (20, 40, 400, 560)}, True, (650.0, 655.0, 305.0, 205.0, 560.0, 400.0)),
        ({"model": "", "d": []}, False, (700.0, 710.0, 330.0, 250.0, 640.0, 480.0)),
    ],
)
def test_a_lens_is_that_of_the_image_that_is_sent(
    types: RosTypes, changed: Any, rectified: bool, expected: Any
) -> None:
    lens = decode_camera_info(info(types, **changed), rectified)
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, lens.width_px, lens.height_px) == expected
    assert lens.is_pinhole == (rectified or changed.get("d") == [])


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"k": [0.0] * 9}, "is not calibrated: its focal length is 0"),
        ({"model": "double_sphere"}, "distortion_model is double_sphere"),
        ({"k": [math.nan, *[1.0] * 8]}, "expected a finite number"),
        ({"width": 0}, "expected the size of its images"),
        ({"roi": (0, 600, 480, 640)}, "beyond the image"),
    ],
)
def test_a_camera_info_that_is_no_lens_is_refused(types: RosTypes, changed: Any, expected: str) -> None:
    with pytest.raises(BadDocumentError, match=expected):
        decode_camera_info(info(types, **changed), False)


# ------------------------------------------------------------------------------- topics and types


def test_a_bridge_s_key_has_no_type_so_it_is_configured(types: RosTypes) -> None:
    bridged = Datagram(channel="eye/found", encoding=Encoding.ROS, t_recv_ns=EPOCH, data=tags(types))
    (image,), _ = images(config(ros_type=TAGS), bridged)
    assert image.class_name == "tag36h11:3"
    assert config(ros_camera_info="eye/info").ros_keys() == [
        *("*/eye/found/*/*", "eye/found", "*/eye/info/*/*", "eye/info")
    ]


def test_the_node_s_key_names_the_camera_and_the_type_so_nothing_is_configured(types: RosTypes) -> None:
    settings = parse_config({"cameras": {"tele": {}}, "estimator": {"leader": {}}})

    def of_node(kind: str, data: bytes, camera: str = "tele") -> Datagram:
        key = f"onboard/1/camera/{camera}/ros/{kind}"
        return Datagram(channel=key, encoding=Encoding.ROS, t_recv_ns=EPOCH, data=data)

    lens, tag = of_node(CAMERA_INFO, info(types, d=[])), of_node(TAGS, tags(types))
    (before, after), run = images(settings, tag, lens, tag)
    assert (before.camera, after.camera) == ("tele", "tele")
    assert_allclose(before.center, (1.0 / 554.256, 0.0))  # the lens as configured
    assert_allclose(after.center, ((321.0 - 330.0) / 700.0, (240.0 - 250.0) / 710.0))
    assert reasons(run) == []
    _, run = images(settings, of_node("nav_msgs/Odometry", b""), of_node(TAGS, tags(types), "rear"))
    assert [why.split(";")[0] for why in reasons(run)] == [
        "the topic is of nav_msgs/Odometry",
        "no camera is called `rear`",
    ]


@pytest.mark.parametrize(("topic", "expected"), [("eye/found", BOXES), ("eye/info", CAMERA_INFO)])
def test_another_type_on_the_topic_is_refused_by_name(types: RosTypes, topic: str, expected: str) -> None:
    settings = config(ros_camera_info="eye/info")
    _, run = images(settings, sent(tags(types), "std_msgs/String", topic))
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason.startswith("the topic is of std_msgs/String; expected ")
    assert expected in refusal.reason
    assert "7777" not in refusal.source


@pytest.mark.parametrize("kind", [POSE, VOLUMES, TAGS, CAMERA_INFO])
def test_a_message_that_is_cut_anywhere_or_has_wrong_bytes_costs_itself_at_most_seed_1(
    types: RosTypes, kind: str
) -> None:
    whole = {
        POSE: pose_message(types, (1.0, 2.0, 30.0)),
        VOLUMES: volumes(types, volume(types, (1.0, 2.0, 30.0), ("drone", 0.5, spread_pose(types, (1, 2, 3))))),
        TAGS: tags(types),
        CAMERA_INFO: info(types),
    }[kind]
    topic = "eye/info" if kind == CAMERA_INFO else "eye/found"
    settings = config(**({"ros_camera_info": topic} if kind == CAMERA_INFO else {}))
    rng, pipeline = np.random.default_rng(1), feed([], settings).pipeline
    cuts = range(0, len(whole) - 8, 7)
    for cut in cuts:
        pipeline.feed(sent(whole[:cut], kind, topic))
    assert pipeline.health(EPOCH).rejected["bad_ros"] == len(cuts)
    for _ in range(300):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), size=rng.integers(1, 6)):
            data[at] = rng.integers(0, 256)
        pipeline.feed(sent(bytes(data), kind, topic))
    assert pipeline.errors == []
