"""Estimates as MCAP with Foxglove's own schemas (Protobuf), which it draws by itself.

Every estimate is there as JSON, too. Foxglove's axes are east, north, up; a body's are forward, left, up. Needs
the extra `foxglove`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from onboard.arrays import Array
from onboard.geometry.enu import ENU_NED, ellipsoid, flu_to_enu
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.geometry.rotations import quaternion_from_matrix
from onboard.messages import Estimate, NavState, Output, OwnPose
from onboard.messages.base import Quaternion
from onboard.messages.schemas import key_of, schema

WORLD, OWN = "world", "own"
DRAWING_PERIOD_NS: Final = 40_000_000  # of one entity in the scene; poses and locations are complete
ARROW_LENGTH: Final = 0.5  # m, of our own vehicle
LEVELS: Final = {True: Log.INFO, False: Log.WARNING}
UPRIGHT: Final[Quaternion] = (1.0, 0.0, 0.0, 0.0)


class FoxgloveWriter:
    """An MCAP file on the boot clock, with Foxglove's schemas and ours.

    Foxglove's: `/tf`, `/own/pose`, `/own/location`, `/leader/pose`, `/leader/location`, `/scene` and `/log`.
    Ours: every estimate on its own key. Locations need the estimator of our own state, which knows the origin."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer: Any = Writer(self._file)
        self._writer.start(library="onboard")
        self._encoder = msgspec.json.Encoder()
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._drawn: dict[str, int] = {}
        self._states: dict[str, str] = {}
        self._own_r = np.zeros(3)
        self._origin: tuple[float, float, float] | None = None

    def close(self) -> None:
        """Write the index and finish the file."""
        self._writer.finish()
        self._file.close()

    def write(self, output: Output) -> None:
        """Append a record and its drawing."""
        if output.t_ns <= 0:
            return
        self._append(self._own_channel(output), self._encoder.encode(output), output.t_ns)
        if isinstance(output, OwnPose):
            self._draw_own(output)
        elif output.is_primary:
            self._log_state(output)
            if isinstance(output, NavState):
                self._locate(output)
            elif output.valid and output.mean is not None and output.covariance is not None:
                self._draw_leader(output, np.array(output.mean[:3]), np.array(output.covariance)[:3, :3])

    def _draw_own(self, own: OwnPose) -> None:
        north, east, down = own.r_OF_n
        self._own_r = np.array([north or 0.0, east or 0.0, down])
        transform = FrameTransform(parent_frame_id=WORLD, child_frame_id=OWN)
        _place(transform.translation, ENU_NED @ self._own_r)
        _turn(transform.rotation, flu_to_enu(own.q_nb))
        self._add("/tf", transform, own.t_ns)
        self._add("/own/pose", _pose(self._own_r, own.q_nb), own.t_ns)
        if not self._is_due("own", own.t_ns):
            return
        scene = SceneUpdate()
        entity = _entity(scene, OWN, own.t_ns)
        arrow = entity.arrows.add(
            shaft_length=ARROW_LENGTH, shaft_diameter=0.2, head_length=ARROW_LENGTH, head_diameter=0.4
        )
        arrow.pose.CopyFrom(_pose(self._own_r, own.q_nb).pose)
        _colour(arrow.color, (1.0, 0.72, 0.3, 1.0))
        self._add("/scene", scene, own.t_ns)

    def _draw_leader(self, estimate: Estimate, r: Array, P: Array) -> None:
        name = estimate.name
        place = self._own_r + r
        self._add(f"/{name}/pose", _pose(place, UPRIGHT), estimate.t_ns)
        if self._origin is not None:
            self._add(f"/{name}/location", _fix(place, P, self._origin, estimate.t_ns), estimate.t_ns)
        if not self._is_due(name, estimate.t_ns):
            return
        scene = SceneUpdate()
        entity = _entity(scene, name, estimate.t_ns)
        axes, diameters = ellipsoid(P)
        sphere = entity.spheres.add()
        _place(sphere.pose.position, ENU_NED @ place)
        _turn(sphere.pose.orientation, axes)
        _place(sphere.size, diameters)
        _colour(sphere.color, (0.25, 0.75, 1.0, 0.35))
        line = entity.lines.add(type=0, thickness=0.05)
        for point in (self._own_r, place):
            _place(line.points.add(), ENU_NED @ point)
        _colour(line.color, (0.25, 0.75, 1.0, 1.0))
        self._add("/scene", scene, estimate.t_ns)

    def _locate(self, state: NavState) -> None:
        self._origin = state.origin or self._origin
        if state.valid and state.mean is not None and state.covariance is not None and self._origin is not None:
            P = np.array(state.covariance)[:3, :3]
            self._add("/own/location", _fix(np.array(state.mean[:3]), P, self._origin, state.t_ns), state.t_ns)

    def _log_state(self, estimate: Estimate) -> None:
        text = f"{estimate.state}: {estimate.reason}"
        if self._states.get(estimate.name) != estimate.state:
            self._states[estimate.name] = estimate.state
            log = Log(level=LEVELS[estimate.valid], message=text, name=estimate.name)
            self._add("/log", log, estimate.t_ns)

    def _is_due(self, what: str, t_ns: int) -> bool:
        if 0 <= t_ns - self._drawn.get(what, -DRAWING_PERIOD_NS) < DRAWING_PERIOD_NS:
            return False
        self._drawn[what] = t_ns
        return True

    def _add(self, topic: str, message: Any, t_ns: int) -> None:
        """Append a message of Foxglove's, stamped if it has a stamp."""
        if "timestamp" in message.DESCRIPTOR.fields_by_name:
            message.timestamp.FromNanoseconds(t_ns)
        channel = self._channels.get(topic)
        if channel is None:
            number = self._schema(message.DESCRIPTOR.full_name, "protobuf", lambda: _descriptors(type(message)))
            channel = self._channels[topic] = self._writer.register_channel(topic, "protobuf", number)
        self._append(channel, message.SerializeToString(), t_ns)

    def _own_channel(self, record: Output) -> int:
        key = key_of(record)
        if key not in self._channels:
            kind = type(record)
            number = self._schema(kind.__name__, "jsonschema", lambda: msgspec.json.encode(schema(kind)))
            self._channels[key] = self._writer.register_channel(key, "json", number)
        return self._channels[key]

    def _schema(self, name: str, encoding: str, make: Callable[[], bytes]) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, make())
        return self._schemas[name]

    def _append(self, channel: int, data: bytes, t_ns: int) -> None:
        self._writer.add_message(channel, t_ns, data, t_ns)


def _descriptors(kind: type[Message]) -> bytes:
    data: bytes = build_file_descriptor_set(kind).SerializeToString()
    return data


def _pose(r_n: Array, q_nb: Quaternion) -> Any:
    pose = PoseInFrame(frame_id=WORLD)
    _place(pose.pose.position, ENU_NED @ r_n)
    _turn(pose.pose.orientation, flu_to_enu(q_nb))
    return pose


def _entity(scene: Any, name: str, t_ns: int) -> Any:
    entity = scene.entities.add(id=name, frame_id=WORLD)
    entity.timestamp.FromNanoseconds(t_ns)
    return entity


def _fix(r_n: Array, P: Array, origin: tuple[float, float, float], t_ns: int) -> Any:
    lat, lon, alt = geodetic_from_ned(r_n, origin)
    covariance = (ENU_NED @ P @ ENU_NED.T).ravel().tolist()
    fix = LocationFix(latitude=lat, longitude=lon, altitude=alt, frame_id=WORLD, position_covariance=covariance)
    fix.position_covariance_type = LocationFix.KNOWN
    fix.timestamp.FromNanoseconds(t_ns)
    return fix


def _place(vector: Any, r: Array) -> None:
    vector.x, vector.y, vector.z = (float(value) for value in r)


def _turn(rotation: Any, R: Array) -> None:
    rotation.w, rotation.x, rotation.y, rotation.z = (float(value) for value in quaternion_from_matrix(R))


def _colour(colour: Any, rgba: tuple[float, float, float, float]) -> None:
    colour.r, colour.g, colour.b, colour.a = rgba
