"""The conversation with an autopilot on one link: sans-IO, time is an argument.

A good citizen: a heartbeat a second as an onboard controller, TIMESYNC requests to know the clock offset, the
message rates we need (asked once per boot and again while they are missing, since an autopilot forgets them on
reboot), replies to TIMESYNC requests, and an answer to every command that is addressed to us.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.config import AutopilotConfig
from onboard.geometry.units import NS_PER_S
from onboard.messages import Clock, Command, CommandAck, Heartbeat, Message, TimeSync, tagged
from onboard.wire.mavlink_encode import MavlinkEncoder, message_number

TIMESYNC_PERIOD_NS: Final = NS_PER_S // 5
ASK_AGAIN_NS: Final = 5 * NS_PER_S
SLOW: Final = 0.7  # a stream below this share of its wanted rate is asked for again
ONBOARD_CONTROLLER: Final = 18
INVALID: Final = 8
ACTIVE: Final = 4
CRITICAL: Final = 5
ACCEPTED: Final = 0
UNSUPPORTED: Final = 3


class Session:
    """The conversation on one link. Nothing is sent before an autopilot is heard."""

    def __init__(self, config: AutopilotConfig) -> None:
        self._config = config
        self._encoder: MavlinkEncoder | None = None
        self._autopilot: Heartbeat | None = None
        self._next_heartbeat = 0
        self._next_timesync = 0
        self._next_request = 0

    def connect(self, autopilot: Heartbeat) -> None:
        """An autopilot was heard: we are a component of its system."""
        self._autopilot = autopilot
        self._encoder = MavlinkEncoder(autopilot.system, self._config.component)
        self._next_request = 0

    def reboot(self) -> None:
        """The autopilot has rebooted and forgotten what we asked for."""
        self._next_request = 0

    def tick(self, now_ns: int, *, healthy: bool, rates: Mapping[str, float]) -> list[bytes]:
        """Frames due at `now_ns` (this computer's clock). `healthy` shows in the heartbeat; `rates` are the rates
        of the MAVLink messages received, Hz."""
        if self._autopilot is None:
            return []
        frames = []
        if now_ns >= self._next_heartbeat:
            self._next_heartbeat = now_ns + NS_PER_S
            frames.append(self._heartbeat(healthy=healthy))
        if now_ns >= self._next_timesync:
            self._next_timesync = now_ns + TIMESYNC_PERIOD_NS
            frames.append(self._pack(TimeSync(**_now(now_ns), tc1_ns=0, ts1_ns=tagged(now_ns))))
        if self._config.request_rates and now_ns >= self._next_request:
            self._next_request = now_ns + ASK_AGAIN_NS
            frames.extend(self._requests(now_ns, rates))
        return frames

    def respond(self, messages: Sequence[Message], now_ns: int) -> list[bytes]:
        """Answers to requests of the autopilot, and of others through it."""
        if self._autopilot is None:
            return []
        frames = []
        for m in messages:
            if isinstance(m, TimeSync) and m.tc1_ns == 0 and m.system == self._autopilot.system:
                frames.append(self._pack(TimeSync(**_now(now_ns), tc1_ns=now_ns, ts1_ns=m.ts1_ns)))
            elif isinstance(m, Command) and self._is_us(m):
                frames.append(self._acknowledge(m, now_ns))
        return frames

    def _is_us(self, m: Command) -> bool:
        system = self._autopilot.system if self._autopilot else 0
        return m.target_system == system and m.target_component == self._config.component

    def _acknowledge(self, m: Command, now_ns: int) -> bytes:
        request_for_heartbeat = (
            m.command == dialect.MAV_CMD_REQUEST_MESSAGE and round(m.params[0]) == dialect.MAVLINK_MSG_ID_HEARTBEAT
        )
        result = ACCEPTED if request_for_heartbeat else UNSUPPORTED
        if request_for_heartbeat:
            self._next_heartbeat = 0
        ack = CommandAck(
            **_now(now_ns),
            target_system=m.system,
            target_component=m.component,
            command=m.command,
            result=result,
        )
        return self._pack(ack)

    def _heartbeat(self, *, healthy: bool) -> bytes:
        return self._pack(
            Heartbeat(
                **_now(0),
                vehicle_type=ONBOARD_CONTROLLER,
                autopilot=INVALID,
                armed=False,
                status=ACTIVE if healthy else CRITICAL,
            )
        )

    def _requests(self, now_ns: int, rates: Mapping[str, float]) -> list[bytes]:
        """SET_MESSAGE_INTERVAL for each stream that is too slow."""
        frames = []
        for name, wanted in self._config.rates_hz.items():
            if rates.get(name, 0.0) >= SLOW * wanted:
                continue
            message_id = message_number(name)
            command = Command(
                **_now(now_ns),
                target_system=self._autopilot.system if self._autopilot else 0,
                target_component=self._autopilot.component if self._autopilot else 0,
                command=dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
                params=(float(message_id), 1e6 / wanted, 0.0, 0.0, 0.0, 0.0, 0.0),
            )
            frames.append(self._pack(command))
        return frames

    def _pack(self, message: Message) -> bytes:
        assert self._encoder is not None  # noqa: S101 - connect() comes before anything is packed
        return self._encoder.encode(message)


def _now(now_ns: int) -> dict[str, Any]:
    return {"t_ns": now_ns, "t_recv_ns": now_ns, "clock": Clock.HOST}
