"""Everything we send over MAVLink, by link: the session on each autopilot's link, our odometry, other traffic."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from onboard.autopilot.odometry import OdometryStream
from onboard.autopilot.session import Session
from onboard.autopilot.traffic import TrafficOutput
from onboard.config import Config
from onboard.messages import Estimate, Heartbeat, Message, NavState, Output


class Outgoing(NamedTuple):
    """Frames for the link of a channel."""

    channel: str
    frames: list[bytes]


class AutopilotOutput:
    """Sans-IO: frames are returned, not sent. There are none before `connect`."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._sessions = {link.name: Session(config.autopilot) for link in config.link if link.autopilot}
        self._traffic = TrafficOutput(config.traffic_out, config.autopilot.component)
        self._odometry: OdometryStream | None = None

    def is_autopilot(self, channel: str) -> bool:
        """Whether a session is held on this channel's link."""
        return channel in self._sessions

    def connect(self, autopilot: Heartbeat) -> None:
        """An autopilot was heard: we are a component of its system on all links."""
        for session in self._sessions.values():
            session.connect(autopilot)
        self._traffic.connect(autopilot.system)
        ids = autopilot.system, self._config.autopilot.component
        self._odometry = OdometryStream(*ids, rate_hz=self._config.odometry.rate_hz)

    def reboot(self) -> None:
        """The autopilot has rebooted and forgotten our requests."""
        for session in self._sessions.values():
            session.reboot()

    def publish(self, output: Output) -> Iterator[Outgoing]:
        """Frames for an estimate: our own state as ODOMETRY, one of many targets as traffic."""
        if isinstance(output, NavState):
            if self._config.odometry.link is not None and self._odometry is not None:
                yield Outgoing(self._config.odometry.link, self._odometry.frames(output))
        elif isinstance(output, Estimate) and not output.is_primary and self._traffic.link:
            yield Outgoing(self._traffic.link, self._traffic.frames(output))

    def respond(self, channel: str, messages: Sequence[Message], now_ns: int) -> Outgoing:
        """Answers to the messages of a channel, on the same channel."""
        return Outgoing(channel, self._sessions[channel].respond(messages, now_ns))

    def tick(self, now_ns: int, *, healthy: bool, rates: Mapping[str, float]) -> Iterator[Outgoing]:
        """Frames due at `now_ns`; see `Session.tick`."""
        for channel, session in self._sessions.items():
            yield Outgoing(channel, session.tick(now_ns, healthy=healthy, rates=rates))
