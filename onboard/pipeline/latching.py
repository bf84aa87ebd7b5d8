"""Which autopilot is ours: the first vehicle that is heard, until a better one shows.

Ours is let go when it has fallen silent and a vehicle comes that was never heard beside it, at once only if it
brings motion; or when ours brings no motion while another one does. A wingman is heard beside ours: its motion is
not ours, whatever becomes of ours.

A vehicle that comes after ours, whose clock and motion go on where those of ours ended, is ours with another id:
it is followed sooner, and nothing that was learnt is forgotten.
"""

from typing import Final

from onboard.messages import Attitude, GlobalPosition, Heartbeat, LocalPosition, Message
from onboard.messages.mavlink_enums import NO_AUTOPILOT
from onboard.ownship.continuity import goes_on
from onboard.units import NS_PER_S

# MAV_TYPE of what flies, drives, swims or floats. A gimbal, camera or transponder may also claim an autopilot.
VEHICLES: Final = frozenset({*range(1, 5), *range(7, 18), *range(19, 26), 28, 29, 35, 43, 45, 46, 47})
GENERIC: Final = 0  # MAV_TYPE of a vehicle only from the component of an autopilot; MAV_AUTOPILOT of no known one
AUTOPILOT_COMPONENT_ID: Final = 1
SILENCE_TIMEOUT_NS: Final = 3 * NS_PER_S  # silence after which another autopilot may be ours
MOTION_TIMEOUT_NS: Final = 3 * NS_PER_S  # in which an autopilot is to bring motion, once another one does
MAX_MOTION_AGE_NS: Final = 2 * NS_PER_S  # motion that is as new is brought
MAX_OVERLAP_TIME_NS: Final = 200_000_000  # messages on their way: an autopilot may change its id
SAME: Final = "the one before has another id now: its clock and its motion go on"
CONTINUATION_WINDOW_NS: Final = (
    500_000_000  # in which one that goes on shows its motion: until its second heartbeat
)
MIN_SILENCE_TIME_NS: Final = 500_000_000  # silence of ours after which the same one may have another id
MAX_CONTINUATION_AGE_NS: Final = 10 * NS_PER_S  # for so long motion tells whether it goes on
MOTION_MESSAGES: Final = (Attitude, LocalPosition, GlobalPosition)
MOST_VEHICLES: Final = 16  # vehicles that are remembered

Id = tuple[int, int]  # MAVLink system and component


class Vehicle:
    """An autopilot that is heard: its heartbeat, the arrivals of its first and its last message, and since when it
    is heard without a pause; its first attitude and position since then, and its last."""

    def __init__(self, heartbeat: Heartbeat) -> None:
        self.heartbeat = heartbeat
        self.first_ns = self.since_ns = self.last_ns = heartbeat.t_recv_ns
        self.first: dict[type[Message], Message] = {}  # of each kind of motion
        self.last: dict[type[Message], Message] = {}

    def receive(self, message: Message) -> None:
        """Note a message of its own."""
        if message.t_recv_ns - self.last_ns > MIN_SILENCE_TIME_NS:  # it may have had another id meanwhile
            self.since_ns = message.t_recv_ns
            self.first.clear()
        self.last_ns = message.t_recv_ns
        if isinstance(message, MOTION_MESSAGES):
            self.first.setdefault(type(message), message)
            self.last[type(message)] = message

    @property
    def attitude_ns(self) -> int | None:
        """Arrival of its last attitude."""
        return self.last[Attitude].t_recv_ns if Attitude in self.last else None

    @property
    def position_ns(self) -> int | None:
        """Arrival of its last position."""
        return max((m.t_recv_ns for kind, m in self.last.items() if kind is not Attitude), default=None)

    def is_complete(self, t_ns: int) -> bool:
        """Whether it brings attitude and position."""
        times = self.attitude_ns, self.position_ns
        return all(t is not None and t_ns - t < MAX_MOTION_AGE_NS for t in times)

    @property
    def rank(self) -> tuple[bool, bool]:
        """Order among the components of one vehicle; the highest is its autopilot."""
        h = self.heartbeat
        return h.component == AUTOPILOT_COMPONENT_ID, h.autopilot != GENERIC


class Latch:
    """The autopilot that is followed, and why it took the place of another. `system`: the only one that may be; 0
    for any."""

    def __init__(self, system: int) -> None:
        self.ours: Vehicle | None = None
        self.why = ""
        self._system = system
        self._since_ns = 0  # arrival of the heartbeat that was latched
        self._heard: dict[Id, Vehicle] = {}

    @property
    def is_same(self) -> bool:
        """Whether it is the one before, with another id."""
        return self.why == SAME

    @property
    def beside(self) -> tuple[Heartbeat, ...]:
        """The first heartbeats of the other vehicles that are heard."""
        return tuple(v.heartbeat for v in self._heard.values() if v is not self.ours)

    def receive(self, message: Message) -> Vehicle | None:
        """Note a message of any sender; the vehicle whose autopilot it is."""
        vehicle = self._heard.get((message.system, message.component))
        if vehicle is not None:
            vehicle.receive(message)
        return vehicle

    def judge(self, heartbeat: Heartbeat) -> bool:
        """Take a heartbeat; True if its sender is followed from now on."""
        if not _is_vehicle(heartbeat):
            return False
        its = heartbeat.system, heartbeat.component
        if its not in self._heard:
            self._make_room()
            self._heard[its] = Vehicle(heartbeat)
        if self._system not in {0, heartbeat.system}:
            return False  # heard, but not ours
        vehicle = self._heard[its]
        if vehicle is self.ours:
            return False
        if self.ours is not None:
            why = self._why(self.ours, vehicle, heartbeat.t_recv_ns)
            if not why:
                return False
            self.why = why
        self.ours, self._since_ns = vehicle, heartbeat.t_recv_ns
        vehicle.heartbeat = heartbeat
        return True

    def _why(self, ours: Vehicle, other: Vehicle, t_ns: int) -> str:
        """Why another vehicle takes the place of ours; "" if it does not."""
        later_ns, is_complete = other.first_ns - ours.last_ns, other.is_complete(t_ns)
        silent_ns = t_ns - ours.last_ns
        is_silent = silent_ns > SILENCE_TIMEOUT_NS
        is_after = other.since_ns - ours.last_ns > -MAX_OVERLAP_TIME_NS
        if silent_ns > MIN_SILENCE_TIME_NS and is_complete and is_after and _goes_on(ours, other):
            return SAME
        if is_silent and (later_ns > SILENCE_TIMEOUT_NS or (is_complete and later_ns > -MAX_OVERLAP_TIME_NS)):
            may_go_on = ours.last and not is_complete and t_ns - other.first_ns < CONTINUATION_WINDOW_NS
            return "" if may_go_on else "the one before has fallen silent"
        if not is_complete:
            return ""
        if other.heartbeat.system == ours.heartbeat.system and other.rank > ours.rank:
            return "the one before is another part of the vehicle"
        brings = ours.attitude_ns is not None or ours.position_ns is not None
        if not brings and t_ns - self._since_ns > MOTION_TIMEOUT_NS:
            return "the one before brings no motion"
        return ""

    def _make_room(self) -> None:
        """Forget a vehicle that is not ours: one without motion first, then the one that was heard longest ago."""
        others = [(v.attitude_ns or 0, v.last_ns, key) for key, v in self._heard.items() if v is not self.ours]
        if len(self._heard) >= MOST_VEHICLES:
            del self._heard[min(others)[2]]


def _goes_on(ours: Vehicle, other: Vehicle) -> bool:
    """Whether clock and motion of one go on where those of the other ended."""
    pairs = [(ours.last[kind], other.first[kind]) for kind in ours.last if kind in other.first]
    return (
        ours.heartbeat.autopilot == other.heartbeat.autopilot
        and len(pairs) > 1  # the attitude, and a position
        and all(0 < after.t_recv_ns - before.t_recv_ns < MAX_CONTINUATION_AGE_NS for before, after in pairs)
        and all(goes_on(before, after) for before, after in pairs)
    )


def _is_vehicle(heartbeat: Heartbeat) -> bool:
    """Whether this is the heartbeat of a vehicle's autopilot."""
    is_generic = heartbeat.vehicle_type == GENERIC and heartbeat.component == AUTOPILOT_COMPONENT_ID
    return heartbeat.autopilot != NO_AUTOPILOT and (heartbeat.vehicle_type in VEHICLES or is_generic)
