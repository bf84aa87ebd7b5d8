"""Whose message it is: that of our own vehicle, of another that an estimator listens to, or of no interest."""

from collections.abc import Container, Sequence
from typing import Final

from msgspec.structs import replace

from onboard.config import AutopilotConfig, LeaderOutConfig
from onboard.messages import (
    AdsbVehicle,
    Battery,
    Clock,
    DistanceReading,
    FollowTarget,
    GlobalOrigin,
    GlobalPosition,
    Heartbeat,
    Imu,
    Message,
    PeerPosition,
)
from onboard.messages.senders import SENDERS, Sender
from onboard.ownship import is_usable
from onboard.pipeline.latching import Latch

NO_SYSTEM: Final = 0  # a vision process on this computer: no MAVLink system
# Often without a stamp: they hold from their arrival.
FROM_ARRIVAL: Final = (GlobalOrigin, Battery)
# Of sensors, which other programs on this computer may send with our component id: theirs, where we send none.
OF_SENSORS: Final = frozenset(
    {
        *("LANDING_TARGET", "CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_FOV_STATUS", "DISTANCE_SENSOR"),
        *("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION"),
    }
)
OF_CAMERA: Final = frozenset({"CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS"})
# Carry no time of a clock we know: taken as true at arrival. So is a DistanceReading, if someone listens for it.
UNSTAMPED: Final = (AdsbVehicle, PeerPosition, FollowTarget)


class Admission:
    """Which autopilot is ours, and which messages may go further. `heard_ns`: arrival of the autopilot's last
    message; messages of others do not count. `sent`: what is sent of the leader, partly by other ids of ours."""

    def __init__(
        self, config: AutopilotConfig, listened: Container[type[Message]], sent: Sequence[LeaderOutConfig] = ()
    ) -> None:
        self.heard_ns: int | None = None
        self._latch = Latch(config.system)
        self._virtual = frozenset(out.system for out in sent)
        cameras = {out.camera_component for out in sent if not OF_CAMERA.isdisjoint(out.rates_hz)}
        self._components = frozenset({config.component, *cameras})
        self._not_ours = OF_SENSORS - {name for out in sent for name in out.rates_hz}
        self._listened = listened

    @property
    def autopilot(self) -> Heartbeat | None:
        """The heartbeat of the autopilot that is followed, None before it."""
        return None if self._latch.ours is None else self._latch.ours.heartbeat

    @property
    def why(self) -> str:
        """Why it took the place of another."""
        return self._latch.why

    @property
    def is_same(self) -> bool:
        """Whether it is the one before, with another id."""
        return self._latch.is_same

    @property
    def beside(self) -> tuple[Heartbeat, ...]:
        """Heartbeats of the other vehicles that are heard."""
        return self._latch.beside

    def is_ours(self, message: Message) -> bool:
        """Whether a message comes from our own vehicle (any component of it) or this computer."""
        return message.system == NO_SYSTEM or (
            self.autopilot is not None and message.system == self.autopilot.system
        )

    def holds_from_arrival(self, message: Message) -> bool:
        """Whether a message without a stamp is of use: it is taken as true at its arrival."""
        if isinstance(message, DistanceReading):
            return DistanceReading in self._listened
        return isinstance(message, UNSTAMPED)

    def latch(self, heartbeat: Heartbeat) -> bool:
        """Let heartbeats decide whose vehicle this is (`latching`); True if it is this one's from now on."""
        if self._latch.judge(heartbeat):
            self.heard_ns = heartbeat.t_recv_ns
            return True
        return False

    def is_own(self, system: int, component: int, name: str) -> bool:
        """Whether a MAVLink message is one of ours, come back: that of our component or camera, or of the virtual
        leader's system."""
        mine = self._latch.ours
        if mine is None or system != mine.heartbeat.system:
            return system in self._virtual
        return component in self._components and name not in self._not_ours

    def admit(self, message: Message) -> Message | str:
        """The message, as estimators know it, or the reason why it is rejected."""
        vehicle, mine = self._latch.receive(message), self._latch.ours
        if mine is not None and vehicle is mine:
            self.heard_ns = message.t_recv_ns
        elif not self.is_ours(message):
            return self._from_peer(message) or ("other_system" if mine is not None else "before_heartbeat")
        elif Sender.COMPONENT not in SENDERS.get(type(message), Sender.AUTOPILOT):
            return "other_component"
        if isinstance(message, Imu) and not is_usable(message):
            return "imu_unusable"
        return message

    def _from_peer(self, message: Message) -> Message | None:
        """A message of another system, if an estimator listens to it: its position, by whichever message."""
        if isinstance(message, GlobalPosition):
            message = PeerPosition(
                t_ns=message.t_recv_ns,
                t_recv_ns=message.t_recv_ns,
                clock=Clock.NONE,
                system=message.system,
                component=message.component,
                lat_deg=message.lat_deg,
                lon_deg=message.lon_deg,
                alt_msl=message.alt_msl,
                v_n=message.v_F_n,
            )
        elif isinstance(message, FollowTarget):  # its stamp is of the other vehicle's clock, too
            message = replace(message, t_ns=message.t_recv_ns, clock=Clock.NONE)
        is_wanted = self.autopilot is not None and Sender.PEER in SENDERS.get(type(message), Sender.AUTOPILOT)
        return message if is_wanted and type(message) in self._listened else None
