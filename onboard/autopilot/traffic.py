"""Traffic over MAVLink: ADSB_VEHICLE for maps, COLLISION for threats.

Threats are only reported; acting on them is left to the autopilot. Sans-IO; off unless the configuration names a
link.
"""

import math
from typing import Any, Final

from onboard.autopilot.sent import Encoder
from onboard.autopilot.stream import Stream
from onboard.config import TrafficOutConfig
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Clock,
    Collision,
    Estimate,
    Intruder,
    Message,
    ThreatLevel,
)

BY_ADSB, BY_POSITION = 0, 1  # MAV_COLLISION_SRC
THREAT_LEVELS: Final = {ThreatLevel.NONE: 0, ThreatLevel.LOW: 1, ThreatLevel.HIGH: 2}  # MAV_COLLISION_THREAT_LEVEL
OURS_BY_SYSTEM: Final = 0xF0_0000  # F00000 to FFFFFF are unassigned ICAO addresses: for aircraft that have none
OURS_BY_RADAR: Final = 0xF1_0000
UINT16_MAX: Final = 0xFFFF
TRAFFIC_MESSAGES: Final = ("ADSB_VEHICLE", "COLLISION")


class TrafficOutput:
    """Encodes estimates of traffic, at most `rate_hz` of each track, after `connect`."""

    def __init__(self, config: TrafficOutConfig, component: int) -> None:
        self.link = config.link
        self._config = config
        self._component = component
        self._encoder: Encoder | None = None
        self.streams = {kind: Stream(config.rate_hz) for kind in TRAFFIC_MESSAGES}
        self._due: dict[str, dict[str, int]] = {}  # by track and kind

    def connect(self, system: int) -> None:
        """Send as a component of our autopilot's system."""
        self._encoder = Encoder(system, self._component)

    def frames(self, estimate: Estimate) -> list[bytes]:
        """Return the frames due for a valid estimate of traffic; none for others."""
        who = estimate.intruder
        if self._encoder is None or who is None or not estimate.valid:
            self._due.pop(estimate.target, None)
            return []
        due = self._due.setdefault(estimate.target, {})
        messages = self._messages(estimate, who)
        return [self._encoder.encode(m) for kind, m in messages if self._is_due(kind, due, estimate.t_ns)]

    def _is_due(self, kind: str, due: dict[str, int], t_ns: int) -> bool:
        stream = self.streams[kind]
        if stream.take_request():
            return True
        if stream.interval_ns == 0 or t_ns < due.get(kind, 0) <= t_ns + stream.interval_ns:
            return False
        due[kind] = t_ns + stream.interval_ns
        return True

    def _messages(self, estimate: Estimate, who: Intruder) -> list[tuple[str, Message]]:
        messages: list[tuple[str, Message]] = []
        silent = who.icao is None
        if self._config.adsb_vehicle == "all" or (self._config.adsb_vehicle == "silent" and silent):
            messages.append(("ADSB_VEHICLE", adsb_vehicle(estimate, who)))
        if self._config.collision and who.approach.threat is not ThreatLevel.NONE:
            messages.append(("COLLISION", collision(estimate, who)))
        return messages


def adsb_vehicle(estimate: Estimate, who: Intruder) -> AdsbVehicle:
    """Make ADSB_VEHICLE from a track; its altitude is above mean sea level."""
    north, east, down = who.v_n
    return AdsbVehicle(
        **_unstamped(estimate),
        icao=address(estimate, who),
        lat_deg=who.lat_deg,
        lon_deg=who.lon_deg,
        altitude=who.alt_msl,
        altitude_type=AltitudeType.PRESSURE,  # which MAVLink means above mean sea level
        course=math.atan2(east, north) % (2 * math.pi),
        ground_speed=(north * north + east * east) ** 0.5,
        climb=-down,
        callsign=who.callsign or estimate.target.upper().replace("/", "")[:8],
        emitter=who.emitter,
        tslc=estimate.age or 0.0,
        squawk=who.squawk,
    )


def collision(estimate: Estimate, who: Intruder) -> Collision:
    """Make COLLISION from the closest approach of a threat."""
    a = who.approach
    by_position = who.icao is None and who.system is not None
    return Collision(
        **_unstamped(estimate),
        source=BY_POSITION if by_position else BY_ADSB,
        threat=who.system if by_position and who.system is not None else address(estimate, who),
        threat_level=THREAT_LEVELS[a.threat],
        time=a.time,
        vertical=a.vertical,
        horizontal=a.horizontal,
    )


def address(estimate: Estimate, who: Intruder) -> int:
    """Return an aircraft's ICAO address, or an unassigned number that its track keeps."""
    if who.icao is not None:
        return who.icao
    if who.system is not None:
        return OURS_BY_SYSTEM + who.system
    return OURS_BY_RADAR + int(estimate.target.rsplit("/", 1)[1]) % UINT16_MAX


def _unstamped(estimate: Estimate) -> dict[str, Any]:
    """Return the time fields of a record whose message carries no time."""
    return {"t_ns": estimate.t_ns, "t_recv_ns": estimate.t_ns, "clock": Clock.NONE}
