"""The leader over MAVLink: setpoints, the leader as a system of its own, and reports.

Reports about tracking come from a camera component. An estimate that is not valid is sent to nobody; only these
reports say that tracking is idle. Sans-IO; off unless the configuration names a link.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final

from onboard import __version__
from onboard.autopilot.component import Component, heartbeat
from onboard.autopilot.leader_messages import MESSAGE_MAKERS, OWN_SYSTEM, CameraView
from onboard.autopilot.requests import Requests, stamp
from onboard.autopilot.sent import Encoder
from onboard.autopilot.stream import Stream
from onboard.config import LeaderOutConfig
from onboard.geometry.camera import Camera
from onboard.messages import CameraInformation, Command, LeaderState, Message, Setpoint

CAMERA: Final = 30  # MAV_TYPE
STANDBY, ACTIVE = 3, 4  # MAV_STATE
SETPOINT: Final = "SET_POSITION_TARGET_LOCAL_NED"
TELLS_IDLE: Final = frozenset({"CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS"})


class LeaderOutput:
    """The messages of one `[[leader_out]]`. `system` and `component` are our own ids."""

    def __init__(self, config: LeaderOutConfig, system: int, component: int) -> None:
        self.link = config.link
        # by MAVLink name; nobody may stop or slow down the setpoints of a vehicle that flies on them
        self.streams = {name: Stream(rate, fixed=name == SETPOINT) for name, rate in config.rates_hz.items()}
        self._is_leader = not OWN_SYSTEM.isdisjoint(self.streams)
        self._us = Encoder(system, component)
        self._leader = Encoder(config.system, config.component)
        self._heartbeats, self._camera_heartbeats = Stream(1.0), Stream(1.0, fixed=True)
        self._camera_requests = Requests()
        self._camera: Component | None = None
        if not TELLS_IDLE.isdisjoint(self.streams):
            self._camera = Component(system, config.camera_component, self.link, self._camera_requests)

    def offer(
        self, requests: Requests, camera: Camera, name: str, can_send: Callable[["LeaderOutput", str], bool]
    ) -> None:
        """Register all streams for requests, with us or with the camera of this name."""
        for kind, stream in self.streams.items():
            of = self._camera_requests if kind in TELLS_IDLE else requests
            of.offer_stream(self.link, kind, stream, partial(can_send, self, kind))
        self._camera_requests.offer_stream(self.link, "HEARTBEAT", self._camera_heartbeats, lambda: True)
        self._camera_requests.offer("CAMERA_INFORMATION", partial(_camera_information, camera, name))

    def respond(self, messages: Sequence[Message], now_ns: int) -> list[bytes]:
        """Return the camera's answers to commands."""
        camera = self._camera
        if camera is None:
            return []
        commands = [m for m in messages if isinstance(m, Command) and camera.is_target(m)]
        return [frame for m in commands for frame in camera.answer(m, now_ns)]

    def frames(
        self,
        state: LeaderState | None,
        smoothed: LeaderState | None,
        view: CameraView | None,
        now_ns: int,
        setpoint: Setpoint | None = None,
    ) -> list[bytes]:
        """Return the frames due now (this computer's clock); `smoothed` is for FOLLOW_TARGET."""
        frames = []
        if self._is_leader and self._heartbeats.is_due(now_ns):
            is_valid = state is not None and state.valid
            frames.append(self._leader.encode(heartbeat(ACTIVE if is_valid else STANDBY)))
        if self._camera is not None and self._camera_heartbeats.is_due(now_ns):
            frames.append(self._camera.encode(heartbeat(ACTIVE, CAMERA)))
        if setpoint is not None and SETPOINT in self.streams and self.streams[SETPOINT].is_due(now_ns):
            frames.append(self._us.encode(setpoint))
        if state is not None and view is not None:
            frames.extend(self._reports(state, smoothed, view, now_ns))
        return frames

    def can_send(self, name: str, state: LeaderState | None, view: CameraView | None) -> bool:
        """Whether a message can be made from this state."""
        if state is None or view is None or not (state.valid or name in TELLS_IDLE):
            return False
        return MESSAGE_MAKERS[name](state, view) is not None

    def _reports(
        self, state: LeaderState, smoothed: LeaderState | None, view: CameraView, now_ns: int
    ) -> Iterator[bytes]:
        for name, stream in self.streams.items():
            of = smoothed if name in OWN_SYSTEM else state
            if name == SETPOINT or of is None or not (of.valid or name in TELLS_IDLE) or not stream.is_due(now_ns):
                continue
            message = MESSAGE_MAKERS[name](of, view)
            if message is not None:
                yield self._sender(name).encode(message)

    def _sender(self, name: str) -> Encoder | Component:
        if name in OWN_SYSTEM:
            return self._leader
        return self._camera if name in TELLS_IDLE and self._camera is not None else self._us


def _camera_information(camera: Camera, name: str, now_ns: int) -> CameraInformation:
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    return CameraInformation(
        **stamp(now_ns),
        name=name,
        width_px=round(camera.width_px),
        height_px=round(camera.height_px),
        version=(major, minor, patch),
    )
