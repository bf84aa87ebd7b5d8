"""Whose message it is: that of our own vehicle, of another that an estimator listens to, or of no interest."""

from collections.abc import Collection, Container
from typing import Final

from msgspec.structs import replace

from onboard.clocks import SENSED
from onboard.config import AutopilotConfig
from onboard.messages import (
    AdsbVehicle,
    Battery,
    Clock,
    DistanceReading,
    FollowTarget,
    GimbalAttitude,
    GlobalOrigin,
    GlobalPosition,
    Heartbeat,
    Imu,
    Message,
    PeerPosition,
    Wind,
)
from onboard.ownship import is_usable
from onboard.pipeline.latching import Latch

NO_SYSTEM: Final = 0  # a vision process on this computer: no MAVLink system
# Not of our own motion: any component of our vehicle may send them.
ANY_COMPONENT: Final = (*SENSED, AdsbVehicle, DistanceReading, GimbalAttitude)
# Often without a stamp: they hold from their arrival.
FROM_ARRIVAL: Final = (GlobalOrigin, Battery, Wind)
# Carry no time of a clock we know: taken as true at arrival. So is a DistanceReading, if someone listens for it.
UNSTAMPED: Final = (AdsbVehicle, PeerPosition, FollowTarget)


class Admission:
    """Which autopilot is ours, and which messages may go further. `heard_ns`: arrival of the autopilot's last
    message; messages of others do not count. `virtual`: systems that we send as, such as a virtual leader's."""

    def __init__(
        self, config: AutopilotConfig, listened: Container[type[Message]], virtual: Collection[int] = ()
    ) -> None:
        self.heard_ns: int | None = None
        self._latch = Latch(config.system)
        self._config, self._virtual = config, frozenset(virtual)
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
    def beside(self) -> tuple[str, ...]:
        """The other vehicles that are heard."""
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

    def admit(self, message: Message) -> Message | str:
        """The message, as estimators know it, or the reason why it is rejected."""
        self._latch.receive(message)
        if message.system in self._virtual and not self._is_from_autopilot(message):
            return "our_own"  # the virtual leader, come back by another way: no traffic
        if not self.is_ours(message):
            peer = self._from_peer(message)
            return peer or ("other_system" if self.autopilot else "before_heartbeat")
        if self._is_from_autopilot(message):
            self.heard_ns = message.t_recv_ns
        elif not isinstance(message, ANY_COMPONENT):
            return "other_component"  # a gimbal's own pose, a peer's clock: not our own motion
        if isinstance(message, Imu) and not is_usable(message):
            return "imu_unusable"
        if isinstance(message, AdsbVehicle) and message.component == self._config.component:
            return "our_own"  # our own report of other traffic, come back by another way
        return message

    def _is_from_autopilot(self, message: Message) -> bool:
        mine = self.autopilot
        return mine is not None and (message.system, message.component) == (mine.system, mine.component)

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
        is_wanted = self.autopilot is not None and isinstance(message, UNSTAMPED)
        return message if is_wanted and type(message) in self._listened else None
