"""Our records as messages of ROS 2, with its axes (REP 103) and frames (REP 105).

    map           east, north, up from the autopilot's origin O
    base_enu      the same axes at our vehicle
    base_link     our vehicle: forward, left, up
    leader        the leader, with axes east, north, up: its attitude is not estimated
    front_optical a camera, named as configured: right, down, forward

Each is the child of the one above; `leader` is one of `base_enu`, cameras are of `base_link`. Where another node
moves `base_link`, `base_enu` is its child, and `map` is left to that node. Only what is valid is published: the
diagnostics say why something is not. This is the only table from records to messages: bags, rmw_zenoh and
`onboard ros2` publish its bytes.
"""

import math
import re
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from onboard.geometry.camera import Camera
from onboard.geometry.enu import ENU_NED, FLU_FRD, ellipsoid, flu_to_enu
from onboard.geometry.rotations import quaternion_from_matrix
from onboard.messages import Estimate, Health, NavState, OwnPose
from onboard.messages.ros import Ros2Config, RosMessage, RosTopic
from onboard.units import NS_PER_S
from onboard.wire.odometry import full, odometry_of
from onboard.wire.ros.diagnostics import Status, statuses
from onboard.wire.ros.types import RosTypes

PLACE_NAMES: Final = ("r_north", "r_east", "r_down")
VELOCITY: Final = ("v_north", "v_east", "v_down")
UNKNOWN_ANGLE: Final = math.pi**2 / 3.0  # rad^2: variance of an angle, or a rate, that may be any
UPRIGHT_XYZW: Final = (0.0, 0.0, 0.0, 1.0)  # x, y, z, w
FRD_OPTICAL: Final = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # from right, down, forward
ARROW, SPHERE, TEXT, ADD = 0, 2, 9, 0  # visualization_msgs/Marker
BLUE, ORANGE, WHITE, PALE_BLUE = (
    (0.1, 0.4, 1.0, 1.0),
    (1.0, 0.6, 0.1, 1.0),
    (1.0, 1.0, 1.0, 1.0),
    (0.25, 0.75, 1.0),
)
ARROW_SIZE_M: Final = np.array([0.1, 0.2, 0.0])  # diameters of the shaft and of the head
MARKER_DURATION_S: Final = 1  # before the marker of an estimate that is no longer valid disappears
MARKER_SIZE_M: Final = 0.5  # of a leader whose wingspan is not estimated, and of text
MIN_CLOCK_RESET_STEP_NS: Final = 10 * NS_PER_S  # a clock that steps back by more has restarted; as in tf2
Numbers = NDArray[np.float64]
Color = tuple[float, float, float, float]
Place = tuple[float, Numbers, Numbers]  # weight (or opacity), mean, covariance


class RosEncoder:
    """Encodes records. `rate_hz`: of each topic at most; None: all."""

    def __init__(self, config: Ros2Config, rate_hz: float | None = None) -> None:
        self._types = RosTypes()
        self.store = self._types.store  # the typestore of rosbags
        self._period_ns = 0 if rate_hz is None else round(1e9 / rate_hz)
        self._root, prefix, self._tf = f"/{config.namespace}", config.frame_prefix, config.tf
        self._map, self._prefix = "map", prefix
        self._enu, self._body = f"{prefix}base_enu", f"{prefix}base_link"
        self._topics: dict[str, RosTopic] = {}
        self._last_ns: dict[str, int] = {}
        self._moved_ns: dict[str, int] = {}  # of the newest transform of each frame

    def encode(self, record: Any, t_ns: int) -> list[RosMessage]:
        """Encode a record with this time in the headers; an empty list if it is not published."""
        if isinstance(record, Health):
            return [self.encode_diagnostics(statuses(record), record.autopilot, t_ns)]
        if isinstance(record, OwnPose):
            return list(self._own_pose(record, t_ns))
        if isinstance(record, NavState):
            return list(self._own_state(record, t_ns))
        return list(self._target(record, t_ns)) if isinstance(record, Estimate) else []

    # ------------------------------------------------------------------------------- our own vehicle

    def _own_pose(self, own: OwnPose, t_ns: int) -> Iterator[RosMessage]:
        if not self._is_due("own", t_ns):
            return
        north, east, down = own.r_OF_n
        R = flu_to_enu(own.q_nb)
        if self._tf == "base_link":
            yield from self._moved(t_ns, (self._body, self._enu, np.zeros(3), _turn(R.T)))
            return
        body = (self._enu, self._body, np.zeros(3), _turn(R))
        if north is None or east is None:
            yield from self._moved(t_ns, body)
        else:
            yield from self._moved(t_ns, (self._map, self._enu, ENU_NED @ [north, east, down], UPRIGHT_XYZW), body)

    def _own_state(self, state: NavState, t_ns: int) -> Iterator[RosMessage]:
        odometry = odometry_of(state) if state.valid else None
        if odometry is None or state.name != "own_state" or not self._is_due("own_state", t_ns):
            return
        R = flu_to_enu(odometry.q_nb)
        # ROS's errors of an attitude are about the axes of the frame, ours about the body's
        pose = self._pose(ENU_NED @ odometry.r_OF_n, _turn(R))
        P = _spread(full(odometry.pose_covariance), ENU_NED, R @ FLU_FRD)
        twist = self._twist(FLU_FRD @ odometry.v_F_b, FLU_FRD @ odometry.omega_b)
        C = _spread(full(odometry.velocity_covariance), FLU_FRD, FLU_FRD)
        yield self._odometry(f"{self._root}/odometry", t_ns, (self._map, self._body), (pose, P), (twist, C))

    # ------------------------------------------------------------------------------- other aircraft

    def _target(self, estimate: Estimate, t_ns: int) -> Iterator[RosMessage]:
        if not estimate.valid or estimate.mean is None or estimate.covariance is None:
            return
        if estimate.components[:3] != PLACE_NAMES or not self._is_due(f"{estimate.name}/{estimate.target}", t_ns):
            return
        mean, P = np.array(estimate.mean), np.array(estimate.covariance)
        yield self._message(f"{self._root}/detections", self._detections(estimate, mean, P, t_ns), t_ns)
        if not estimate.is_primary:
            return
        yield self._message(f"{self._root}/markers", self._markers(estimate, mean, P, t_ns), t_ns)
        name = re.sub(r"\W", "_", estimate.name, flags=re.ASCII)
        position, frame = ENU_NED @ mean[:3], f"{self._prefix}{name}"
        yield from self._moved(t_ns, (self._enu, frame, position, UPRIGHT_XYZW))
        pose, spread = self._pose(position, UPRIGHT_XYZW), _of_position(P)
        stamped = self._with_covariance("Pose", pose, spread)
        message = self._make("geometry_msgs/PoseWithCovarianceStamped", self._header(t_ns, self._enu), stamped)
        yield self._message(f"{self._root}/{name}/pose", message, t_ns)
        if estimate.components[3:6] == VELOCITY:
            twist = self._twist(ENU_NED @ mean[3:6], np.zeros(3))
            frames = (self._enu, frame)
            both = (pose, spread), (twist, _of_position(P[3:6, 3:6]))
            yield self._odometry(f"{self._root}/{name}/odometry", t_ns, frames, *both)

    def _detections(self, estimate: Estimate, mean: Numbers, P: Numbers, t_ns: int) -> Any:
        """An array of one detection, with hypotheses and a cube as wide as the wingspan."""
        header = self._header(t_ns, self._enu)
        places = _places(estimate) or [(1.0, mean, P)]
        results = [
            self._make(
                "vision_msgs/ObjectHypothesisWithPose",
                self._make("vision_msgs/ObjectHypothesis", estimate.name, float(weight)),
                self._with_covariance("Pose", self._pose(ENU_NED @ place[:3], UPRIGHT_XYZW), _of_position(spread)),
            )
            for weight, place, spread in places
        ]
        side = float(mean[6]) if estimate.components[6:7] == ("size",) else 0.0
        cube = self._make("geometry_msgs/Vector3", side, side, side)
        box = self._make("vision_msgs/BoundingBox3D", self._pose(ENU_NED @ mean[:3], UPRIGHT_XYZW), cube)
        one = self._make("vision_msgs/Detection3D", header, results, box, estimate.target)
        return self._make("vision_msgs/Detection3DArray", header, [one])

    def _markers(self, estimate: Estimate, mean: Numbers, P: Numbers, t_ns: int) -> Any:
        """Markers of the aircraft, its velocity, its covariance and the other hypotheses."""
        name, r = estimate.name, mean[:3]
        side = float(mean[6]) if estimate.components[6:7] == ("size",) else MARKER_SIZE_M
        pose, above = (
            self._pose(ENU_NED @ r, UPRIGHT_XYZW),
            self._pose(ENU_NED @ r + [0.0, 0.0, side], UPRIGHT_XYZW),
        )
        label = f"{name} {np.linalg.norm(r):.1f} m"
        found = [
            self._marker(t_ns, name, SPHERE, pose, np.full(3, side), BLUE),
            self._marker(t_ns, f"{name}/label", TEXT, above, np.full(3, MARKER_SIZE_M), WHITE, text=label),
            self._ellipsoid(t_ns, f"{name}/covariance", (0.3, r, P)),
        ]
        if estimate.components[3:6] == VELOCITY:
            ends = [self._make("geometry_msgs/Point", *map(float, ENU_NED @ p)) for p in (r, r + mean[3:6])]
            origin = self._pose(np.zeros(3), UPRIGHT_XYZW)
            found.append(self._marker(t_ns, f"{name}/velocity", ARROW, origin, ARROW_SIZE_M, ORANGE, points=ends))
        places = enumerate((0.4 * weight, p, C) for weight, p, C in _places(estimate))
        found += [self._ellipsoid(t_ns, f"{name}/places", place, number=i) for i, place in places]
        return self._make("visualization_msgs/MarkerArray", found)

    def _ellipsoid(self, t_ns: int, space: str, place: Place, number: int = 0) -> Any:
        alpha, mean, P = place
        axes, diameters = ellipsoid(P[:3, :3])
        pose = self._pose(ENU_NED @ mean[:3], _turn(axes))
        return self._marker(t_ns, space, SPHERE, pose, diameters, (*PALE_BLUE, alpha), number=number)

    def _marker(
        self, t_ns: int, space: str, kind: int, pose: Any, size: Numbers, color: Color, **more: Any
    ) -> Any:
        """A marker in `base_enu`; `more`: number, points and text."""
        make, no_time = self._make, self._make("builtin_interfaces/Time", 0, 0)
        number, points, text = more.get("number", 0), more.get("points", []), more.get("text", "")
        no_bytes = np.zeros(0, np.uint8)
        return make(
            *("visualization_msgs/Marker", self._header(t_ns, self._enu), space, number, kind, ADD),
            *(pose, self._vector(size), make("std_msgs/ColorRGBA", *color)),
            *(make("builtin_interfaces/Duration", MARKER_DURATION_S, 0), False, points, [], ""),
            make("sensor_msgs/CompressedImage", make("std_msgs/Header", no_time, ""), "", no_bytes),
            *([], text, "", make("visualization_msgs/MeshFile", "", no_bytes), False),
        )

    # ------------------------------------------------------------------------------- cameras, health

    def encode_mounts(self, camera: Camera, t_ns: int) -> RosMessage:
        """The optical frames of cameras that are fixed to our vehicle, for /tf_static."""
        fixed = [one for one in (camera, *camera.others) if one.gimbal is None]
        transforms = [
            self._transform(
                *(t_ns, self._body, f"{self._prefix}{one.name}_optical", FLU_FRD @ one.r_FC_b),
                _turn(FLU_FRD @ one.R_bc @ FRD_OPTICAL),
            )
            for one in fixed
        ]
        return self._message("/tf_static", self._make("tf2_msgs/TFMessage", transforms), t_ns)

    def encode_diagnostics(self, found: Iterable[Status], hardware: str, t_ns: int) -> RosMessage:
        """Statuses for /diagnostics."""
        make = self._make
        array = [
            make(
                "diagnostic_msgs/DiagnosticStatus",
                *(one.level, one.name, one.message, hardware),
                [make("diagnostic_msgs/KeyValue", key, value) for key, value in one.values.items()],
            )
            for one in found
        ]
        message = make("diagnostic_msgs/DiagnosticArray", self._header(t_ns, ""), array)
        return self._message("/diagnostics", message, t_ns)

    # ------------------------------------------------------------------------------- parts of messages

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types.make(kind, *fields)

    def _message(self, topic: str, message: Any, t_ns: int) -> RosMessage:
        if topic not in self._topics:
            self._topics[topic] = self._types.topic(topic, message.__msgtype__.replace("/msg/", "/"))
        return RosMessage(self._topics[topic], t_ns, self._types.encode(message))

    def _header(self, t_ns: int, frame: str) -> Any:
        seconds, rest = divmod(t_ns, NS_PER_S)
        return self._make("std_msgs/Header", self._make("builtin_interfaces/Time", seconds, rest), frame)

    def _pose(self, r: Numbers, turn: tuple[float, ...]) -> Any:
        point = self._make("geometry_msgs/Point", *map(float, r))
        return self._make("geometry_msgs/Pose", point, self._make("geometry_msgs/Quaternion", *turn))

    def _twist(self, v: Numbers, omega: Numbers) -> Any:
        return self._make("geometry_msgs/Twist", self._vector(v), self._vector(omega))

    def _vector(self, v: Numbers) -> Any:
        return self._make("geometry_msgs/Vector3", *map(float, v))

    def _moved(self, t_ns: int, *moved: tuple[str, str, Numbers, tuple[float, ...]]) -> Iterator[RosMessage]:
        """Transforms from a parent to a child, without those that would go back in time."""
        if self._tf == "none":
            return
        newer = [one for one in moved if self._is_newer(one[1], t_ns)]
        if newer:
            transforms = [self._transform(t_ns, *one) for one in newer]
            yield self._message("/tf", self._make("tf2_msgs/TFMessage", transforms), t_ns)

    def _is_newer(self, frame: str, t_ns: int) -> bool:
        last_ns = self._moved_ns.get(frame)
        if last_ns is not None and -MIN_CLOCK_RESET_STEP_NS < t_ns - last_ns <= 0:
            return False
        self._moved_ns[frame] = t_ns
        return True

    def _transform(self, t_ns: int, parent: str, child: str, r: Numbers, turn: tuple[float, ...]) -> Any:
        rotation = self._make("geometry_msgs/Quaternion", *turn)
        transform = self._make("geometry_msgs/Transform", self._vector(r), rotation)
        return self._make("geometry_msgs/TransformStamped", self._header(t_ns, parent), child, transform)

    def _with_covariance(self, kind: str, value: Any, spread: Numbers) -> Any:
        return self._make(f"geometry_msgs/{kind}WithCovariance", value, spread.ravel())

    def _odometry(self, topic: str, t_ns: int, frames: tuple[str, str], pose: Any, twist: Any) -> RosMessage:
        parent, child = frames
        header = self._header(t_ns, parent)
        both = self._with_covariance("Pose", *pose), self._with_covariance("Twist", *twist)
        return self._message(topic, self._make("nav_msgs/Odometry", header, child, *both), t_ns)

    def _is_due(self, what: str, t_ns: int) -> bool:
        """Whether a record is due; a clock that steps back restarts."""
        if 0 <= t_ns - self._last_ns.get(what, -self._period_ns) < self._period_ns:
            return False
        self._last_ns[what] = t_ns
        return True


def _places(estimate: Estimate) -> list[Place]:
    """Weight, mean and covariance of each place where a target may be, the likeliest first."""
    places = [(mode.weight, np.array(mode.mean), np.array(mode.covariance)) for mode in estimate.modes]
    return sorted(places, key=lambda place: -place[0])


def _turn(R: Numbers) -> tuple[float, ...]:
    """ROS's order of a quaternion: x, y, z, w."""
    w, x, y, z = quaternion_from_matrix(R).tolist()
    return x, y, z, w


def _spread(covariance: Numbers, first: Numbers, second: Numbers) -> Numbers:
    """A covariance (6, 6) whose two halves are rotated."""
    J = np.zeros((6, 6))
    J[:3, :3], J[3:, 3:] = first, second
    return np.asarray(J @ covariance @ J.T)


def _of_position(P: Numbers) -> Numbers:
    """The covariance (6, 6) of a pose or twist whose second half is unknown."""
    spread = np.diag([UNKNOWN_ANGLE] * 6)
    spread[:3, :3] = ENU_NED @ P[:3, :3] @ ENU_NED.T
    return spread
