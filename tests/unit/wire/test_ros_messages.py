"""Messages of ROS 2 as rosbags' own decoder reads them, against numbers worked out by hand and others' hashes of
types."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from onboard.config import ConfigError, parse_config
from onboard.config.ros import ros_encoder
from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import Mode, OwnPose
from onboard.messages.ros import Ros2Config, RosMessage
from onboard.models import relative_motion
from onboard.wire.ros.messages import UNKNOWN_ANGLE, RosEncoder
from tests.support.records import make_estimate
from tests.support.vehicle_records import EAST, nav_state

pytest.importorskip("rosbags", reason="needs the extra `ros2`")
STAMP = 1_735_689_605_250_000_000
POSE = "geometry_msgs/msg/PoseWithCovariance"
HASHES = {  # as other implementations of ROS 2 over Zenoh have them
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    f"{POSE}Stamped": "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    "vision_msgs/msg/Detection3DArray": "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
}


@pytest.fixture
def encoder() -> RosEncoder:
    return RosEncoder(Ros2Config())


def decoded(encoder: RosEncoder, messages: list[RosMessage]) -> dict[str, list[Any]]:
    """By topic, what another decoder makes of the bytes. Every hash is one that others have."""
    found: dict[str, list[Any]] = {}
    for message in messages:
        assert message.topic.type_hash == f"RIHS01_{HASHES[message.topic.kind]}"
        assert message.data[:4] == b"\0\1\0\0"
        read = encoder.store.deserialize_cdr(message.data, message.topic.kind)
        found.setdefault(message.topic.name, []).append(read)
    return found


def numbers(thing: Any) -> list[float]:
    return [getattr(thing, name) for name in "xyzw" if hasattr(thing, name)]


def leader(**changed: Any) -> Any:
    mean = (10.0, 20.0, -5.0, 1.0, 2.0, -3.0, 1.8, 0.0, 0.0)
    fields = {"components": relative_motion.COMPONENTS, "units": relative_motion.UNITS, "mean": mean}
    covariance = tuple(map(tuple, np.diag(np.arange(1.0, 10.0)).tolist()))
    return make_estimate(name="leader", **({"covariance": covariance} | fields | changed))


def test_our_own_state_is_odometry_in_enu_and_flu(encoder: RosEncoder) -> None:
    read = decoded(encoder, encoder.encode(nav_state(), STAMP))
    (m,) = read.pop("/onboard/odometry")
    assert read == {}
    assert (m.header.stamp.sec, m.header.stamp.nanosec) == (1_735_689_605, 250_000_000)
    assert (m.header.frame_id, m.child_frame_id) == ("map", "base_link")
    assert numbers(m.pose.pose.position) == [2.0, 1.0, 3.0]  # 1 m north, 2 m east, 3 m up
    assert_allclose(numbers(m.pose.pose.orientation), [0, 0, 0, 1], atol=1e-12)  # nose to the east
    assert_allclose(numbers(m.twist.twist.linear), [5.0, 4.0, -6.0], atol=1e-12)
    assert_allclose(numbers(m.twist.twist.angular), [0.1, -0.2, -0.3], atol=1e-12)
    assert_allclose(np.diag(m.pose.covariance.reshape(6, 6)), [2, 1, 3, 7, 8, 9], atol=1e-12)
    speeds = [5 + 36 * 8 + 16 * 9, 4 + 36 * 7 + 25 * 9, 6 + 16 * 7 + 25 * 8, 10, 11, 12]
    assert_allclose(np.diag(m.twist.covariance.reshape(6, 6)), speeds)


def test_errors_of_the_pose_are_as_its_covariance_says_seed_5(encoder: RosEncoder) -> None:
    """States drawn from a full covariance and converted by scipy: ROS's rotations are about the map's axes."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(12, 12)) * np.repeat([1.0, 0.5, 0.02, 0.1], 3)[:, None]
    P, q = root @ root.T, quaternion_from_euler(0.5, -0.4, 2.0)
    state = nav_state(q_nb=tuple(q.tolist()), covariance=tuple(map(tuple, P.tolist())))
    (m,) = decoded(encoder, encoder.encode(state, STAMP))["/onboard/odometry"]
    ned_enu, aircraft = Rotation.from_euler("xyz", [np.pi, 0, np.pi / 2]), Rotation.from_euler("x", np.pi)
    mean = np.array(state.mean)
    estimated = Rotation.from_quat(numbers(m.pose.pose.orientation))
    off = rng.multivariate_normal(np.zeros(12), P, 20_000)
    true = ned_enu * Rotation.from_quat(q, scalar_first=True) * Rotation.from_rotvec(off[:, 6:9]) * aircraft
    places = (mean[:3] + off[:, :3])[:, [1, 0, 2]] * [1.0, 1.0, -1.0] - numbers(m.pose.pose.position)
    draws = np.hstack([places, (true * estimated.inv()).as_rotvec()])
    expected, sigma = np.cov(draws.T), np.std(draws, axis=0)
    assert_allclose(
        m.pose.covariance.reshape(6, 6) / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.04
    )


def test_transforms_lead_from_the_map_to_our_vehicle_and_to_the_leader(encoder: RosEncoder) -> None:
    own = OwnPose(t_ns=1, r_OF_n=(1.0, 2.0, -3.0), v_F_n=(0, 0, 0), a_F_n=(0, 0, 0), q_nb=EAST)
    (tf,) = decoded(encoder, encoder.encode(own, STAMP))["/tf"]
    (leaders,) = decoded(encoder, encoder.encode(leader(), STAMP))["/tf"]
    every = [*tf.transforms, *leaders.transforms]
    assert [(one.header.frame_id, one.child_frame_id) for one in every] == [
        ("map", "base_enu"),
        ("base_enu", "base_link"),
        ("base_enu", "leader"),
    ]
    assert [numbers(one.transform.translation) for one in every] == [[2, 1, 3], [0, 0, 0], [20, 10, 5]]
    assert_allclose([numbers(one.transform.rotation) for one in every], [[0, 0, 0, 1]] * 3, atol=1e-12)
    (level,) = decoded(encoder, encoder.encode(OwnPose(**_fields(own, r_OF_n=(None, None, -3.0))), STAMP + 1))[
        "/tf"
    ]
    assert [one.child_frame_id for one in level.transforms] == ["base_link"]  # where it is is not known


def test_another_node_moves_our_vehicle_or_all() -> None:
    """robot_localization, or MAVROS, has base_link in its own tree: ours hangs below it, or nothing is sent."""
    own = OwnPose(t_ns=1, r_OF_n=(1.0, 2.0, -3.0), v_F_n=(0, 0, 0), a_F_n=(0, 0, 0), q_nb=EAST)
    turned = OwnPose(**_fields(own, q_nb=tuple(quaternion_from_euler(0.1, 0.2, 0.3).tolist())))
    encoder = RosEncoder(parse_config({"ros2": {"tf": "base_link"}}).ros2)
    (ours,) = decoded(encoder, encoder.encode(turned, STAMP))["/tf"]
    (leaders,) = decoded(encoder, encoder.encode(leader(), STAMP))["/tf"]
    every = [*ours.transforms, *leaders.transforms]
    assert [(one.header.frame_id, one.child_frame_id) for one in every] == [
        ("base_link", "base_enu"),
        ("base_enu", "leader"),
    ]
    usual = RosEncoder(Ros2Config())
    (tf,) = decoded(usual, usual.encode(turned, STAMP))["/tf"]
    body = Rotation.from_quat(numbers(tf.transforms[1].transform.rotation))
    there_and_back = body * Rotation.from_quat(numbers(every[0].transform.rotation))
    assert_allclose(there_and_back.as_rotvec(), np.zeros(3), atol=1e-12)

    silent = RosEncoder(Ros2Config(tf="none"))
    assert silent.encode(own, STAMP) == []
    assert set(decoded(silent, silent.encode(leader(), STAMP))) == {
        f"/onboard/{name}" for name in ("detections", "leader/pose", "leader/odometry", "markers")
    }


@pytest.mark.parametrize(
    ("step_ns", "sent"), [(1, True), (0, False), (-1, False), (-9_000_000_000, False), (-11_000_000_000, True)]
)
def test_no_transform_goes_back_in_time_unless_the_clock_begins_anew(
    encoder: RosEncoder, step_ns: int, sent: bool
) -> None:
    """tf2 complains of each that does, and of each that is repeated."""
    own = OwnPose(t_ns=1, r_OF_n=(1.0, 2.0, -3.0), v_F_n=(0, 0, 0), a_F_n=(0, 0, 0), q_nb=EAST)
    for record in (own, leader()):
        assert "/tf" in decoded(encoder, encoder.encode(record, STAMP))
        assert ("/tf" in decoded(encoder, encoder.encode(record, STAMP + step_ns))) == sent


def _fields(record: Any, **changed: Any) -> dict[str, Any]:
    return {name: getattr(record, name) for name in record.__struct_fields__} | changed


def test_a_leader_is_a_pose_odometry_and_a_detection_from_our_vehicle(encoder: RosEncoder) -> None:
    read = decoded(encoder, encoder.encode(leader(), STAMP))
    topics = ("detections", "leader/pose", "leader/odometry", "markers")
    assert set(read) == {"/tf", *(f"/onboard/{name}" for name in topics)}
    (pose,), (odometry,), (array,) = (
        read[f"/onboard/{name}"] for name in ("leader/pose", "leader/odometry", "detections")
    )
    assert pose.header.frame_id == odometry.header.frame_id == array.header.frame_id == "base_enu"
    assert numbers(pose.pose.pose.position) == numbers(odometry.pose.pose.position) == [20.0, 10.0, 5.0]
    assert np.diag(pose.pose.covariance.reshape(6, 6)).tolist() == [2.0, 1.0, 3.0, *[UNKNOWN_ANGLE] * 3]
    assert math.sqrt(UNKNOWN_ANGLE) == pytest.approx(math.pi / math.sqrt(3.0))
    assert odometry.child_frame_id == "leader"
    assert numbers(odometry.twist.twist.linear) == [2.0, 1.0, 3.0]
    assert np.diag(odometry.twist.covariance.reshape(6, 6))[:3].tolist() == [5.0, 4.0, 6.0]
    (one,) = array.detections
    assert one.id == "leader"
    assert numbers(one.bbox.size) == [1.8] * 3
    (hypothesis,) = one.results
    assert (hypothesis.hypothesis.class_id, hypothesis.hypothesis.score) == ("leader", 1.0)


def test_an_open_range_is_several_hypotheses_the_likeliest_first(encoder: RosEncoder) -> None:
    P = tuple(map(tuple, np.eye(6).tolist()))
    modes = tuple(Mode(weight=w, mean=(r, 0, 0, 0, 0, 0), covariance=P) for w, r in ((0.3, 20.0), (0.7, 60.0)))
    (array,) = decoded(encoder, encoder.encode(leader(modes=modes), STAMP))["/onboard/detections"]
    results = array.detections[0].results
    assert [one.hypothesis.score for one in results] == [0.7, 0.3]
    assert [numbers(one.pose.pose.position)[1] for one in results] == [60.0, 20.0]


def test_markers_show_the_leader_its_covariance_and_where_else_it_may_be(encoder: RosEncoder) -> None:
    P = tuple(map(tuple, np.eye(6).tolist()))
    modes = tuple(Mode(weight=w, mean=(r, 0, 0, 0, 0, 0), covariance=P) for w, r in ((0.3, 20.0), (0.7, 60.0)))
    (array,) = decoded(encoder, encoder.encode(leader(modes=modes), STAMP))["/onboard/markers"]
    found = {(one.ns, one.id): one for one in array.markers}
    assert len(found) == len(array.markers) == 6
    assert {
        (one.header.frame_id, one.header.stamp.nanosec, one.action, one.lifetime.sec) for one in found.values()
    } == {("base_enu", 250_000_000, 0, 1)}
    aircraft, spread = found["leader", 0], found["leader/covariance", 0]
    assert (aircraft.type, numbers(aircraft.pose.position), numbers(aircraft.scale)) == (2, [20, 10, 5], [1.8] * 3)
    axes = Rotation.from_quat(numbers(spread.pose.orientation)).as_matrix()
    variances = axes @ np.diag(np.square(numbers(spread.scale)) / 16.0) @ axes.T  # diameters of 2 sigma
    assert_allclose(variances, np.diag([2.0, 1.0, 3.0]), atol=1e-12)
    ends = [numbers(point) for point in found["leader/velocity", 0].points]
    assert_allclose(np.diff(ends, axis=0), [[2.0, 1.0, 3.0]])
    assert found["leader/label", 0].text == "leader 22.9 m"
    places = [found["leader/places", k] for k in (0, 1)]
    assert [numbers(one.pose.position) for one in places] == [[0, 60, 0], [0, 20, 0]]
    assert places[0].color.a > places[1].color.a > 0.0


def test_a_fixed_camera_has_an_optical_frame(encoder: RosEncoder) -> None:
    """It looks up by 15 degrees, from 0.2 m ahead, and a point on its axis is there; one on a gimbal has none."""
    table = {"mount_rpy_deg": [0, 15, 0], "mount_offset_m": [0.2, 0.0, -0.1]}
    config = parse_config({"camera": table, "cameras": {"belly": {"gimbal": 1}}})
    (tf,) = decoded(encoder, [encoder.encode_mounts(config.camera_model(), STAMP)])["/tf_static"]
    (one,) = tf.transforms
    assert (one.header.frame_id, one.child_frame_id) == ("base_link", "front_optical")
    assert numbers(one.transform.translation) == [0.2, 0.0, 0.1]
    turn = Rotation.from_quat(numbers(one.transform.rotation))
    up, right = math.radians(15.0), [0.0, -1.0, 0.0]
    assert_allclose(turn.apply([[0, 0, 1], [1, 0, 0]]), [[math.cos(up), 0, math.sin(up)], right], atol=1e-12)


def test_one_of_many_is_a_detection_only(encoder: RosEncoder) -> None:
    other = leader(target="icao/4b1a2c")
    read = decoded(encoder, encoder.encode(other, STAMP))
    assert set(read) == {"/onboard/detections"}
    assert read["/onboard/detections"][0].detections[0].id == "icao/4b1a2c"


@pytest.mark.parametrize(
    "record",
    [
        leader(valid=False),
        leader(mean=None, covariance=None),
        nav_state(valid=False),
        nav_state(name="own_state_2"),
    ],
)
def test_what_is_not_valid_or_not_ours_is_not_published(encoder: RosEncoder, record: Any) -> None:
    assert encoder.encode(record, STAMP) == []


def test_names_and_rates_are_as_configured() -> None:
    config = Ros2Config(namespace="uav1/onboard", frame_prefix="uav1/")
    encoder = RosEncoder(config, rate_hz=10.0)
    times = [STAMP + k * 20_000_000 for k in range(51)]
    found = [m for t_ns in times for m in encoder.encode(nav_state(), t_ns)]
    assert len(found) == 11
    assert found[0].topic.name == "/uav1/onboard/odometry"
    (m, *_) = decoded(encoder, found)["/uav1/onboard/odometry"]
    assert (m.header.frame_id, m.child_frame_id) == ("map", "uav1/base_link")
    assert encoder.encode(nav_state(), STAMP - 10**9) != []  # a clock that was set back does not end it


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"namespace": "/onboard"}, "such as .onboard. or"),
        ({"namespace": "1st"}, "namespace '1st': letters, digits"),
        ({"frame_prefix": "a b"}, "frame_prefix 'a b'"),
        ({"domain": 233}, "<= 232"),
        ({"distribution": "foxy"}, "foxy"),
    ],
)
def test_what_ros_does_not_take_is_refused(settings: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        parse_config({"ros2": settings})


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ros_encoder(parse_config({})) is None
    with pytest.raises(ConfigError, match=r"needs zenoh\.enabled = true"):
        ros_encoder(parse_config({"ros2": {"enabled": True}, "zenoh": {"enabled": False}}))
    monkeypatch.setitem(__import__("sys").modules, "rosbags.typesys", None)
    with pytest.raises(ConfigError, match=r"\[ros2\]"):
        ros_encoder(parse_config({"ros2": {"enabled": True}}))
