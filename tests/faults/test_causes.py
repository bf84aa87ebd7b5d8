"""Why nothing happens is shown: on the console, in the health, and to the pilot as STATUSTEXT."""

from typing import Any

import pytest
from msgspec.structs import replace

from onboard.config import ConfigError
from onboard.daemon import Daemon
from onboard.links.host_clock import HostClock
from onboard.messages import DOUBT_PREFIX, Cause, Datagram, Encoding, Health, LocalPosition, Reason
from tests.faults.test_silence import Link, Wire
from tests.support.faulty_flight import DATAGRAMS, ITEMS
from tests.support.streams import S, encode, make_config
from tests.unit.autopilot.test_session import parsed

TICK_NS = S // 50


class Flight:
    """A daemon whose clock is that of the datagrams; `lines` are its console, `texts` what the pilot reads."""

    def __init__(self, *overrides: str) -> None:
        self.lines: list[str] = []
        self.wire, self._now_ns = Wire(), 0
        base = ("link=[{name='udp', url='udpin:127.0.0.1:0'}]", "zenoh.enabled=false")
        clock = HostClock(wall=lambda: self._now_ns, monotonic=lambda: self._now_ns)
        clock.now_ns = lambda: self._now_ns
        self.daemon = Daemon(make_config(*base, *overrides), report=self.lines.append, clock=clock)
        self.daemon._links = [Link(self.wire)]  # type: ignore[list-item]
        self.daemon._sinks = {"wire": self.wire}  # type: ignore[dict-item]

    def fly(self, flown: Any) -> "Flight":
        for datagram in flown:
            tick_ns = self._now_ns or datagram.t_recv_ns
            while tick_ns + TICK_NS <= datagram.t_recv_ns:
                tick_ns += TICK_NS
                self.wait(tick_ns)
            self._now_ns = max(tick_ns, self._now_ns)
            self.daemon._deliver(replace(datagram, channel="udp" if _is_mavlink(datagram) else datagram.channel))
        return self

    def wait(self, until_ns: int) -> None:
        self._now_ns = until_ns
        self.daemon._tick(until_ns)

    @property
    def texts(self) -> list[str]:
        joined: dict[Any, str] = {}
        for i, m in enumerate(m for m in parsed(self.wire.frames) if m.get_type() == "STATUSTEXT"):
            key = m.id or -i - 1
            joined[key] = joined.get(key, "") + m.text
        return list(joined.values())

    @property
    def health(self) -> Health:
        return [r for r in self.wire.records if isinstance(r, Health)][-1]


def _is_mavlink(datagram: Datagram) -> bool:
    return datagram.encoding is Encoding.MAVLINK


def shown(lines: list[str], words: str) -> bool:
    return any(words in line for line in lines)


def test_an_autopilot_of_another_system_than_the_wanted_one_is_named() -> None:
    flight = Flight("autopilot.system=7").fly(DATAGRAMS)
    assert shown(
        flight.lines, "no autopilot of system 7 is heard, as `autopilot.system` wants; heard: PX4, system 1"
    )
    assert not shown(flight.lines, "time stamp")


def test_the_autopilots_own_component_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"autopilot.component is 1, that of the autopilot itself.*such as 191"):
        make_config("autopilot.component=1")


def test_an_autopilot_without_a_position_is_said_to_have_none() -> None:
    aligning = encode([i for i in ITEMS if not isinstance(i.message, LocalPosition)])
    flight = Flight().fly(aligning)
    assert shown(flight.lines, "the autopilot has no position yet (its filter aligns, or no GPS)")
    assert shown(flight.texts, "no position yet: filter aligns, or no GPS")
    assert not shown(flight.lines, "own attitude")


def test_a_doubt_about_the_set_up_reaches_the_pilot() -> None:
    flight = Flight().fly(DATAGRAMS)
    words = (
        f"{DOUBT_PREFIX}the leader moves as we lean, as if the camera looked 15 degrees lower than "
        "`mount_rpy_deg` says"
    )
    flight.daemon._pipeline.refuse("camera front", Reason(Cause.MOUNT, words), flight.daemon._now_ns())
    end_ns = DATAGRAMS[-1].t_recv_ns
    for k in range(1, 50):
        flight.wait(end_ns + k * TICK_NS)
    assert shown(flight.lines, f"camera front: {words}. Remedy: turn the camera, or set `mount_rpy_deg`")
    assert shown(flight.texts, "camera mount is off")


def test_a_pilot_is_told_that_the_leader_is_lost_and_why() -> None:
    out = "leader_out=[{link='udp', rates_hz={SET_POSITION_TARGET_LOCAL_NED=25.0}}]"
    flight = Flight(out).fly(DATAGRAMS)
    assert shown(flight.texts, "leader tracked")
    end_ns = DATAGRAMS[-1].t_recv_ns
    for k in range(1, 600):
        flight.wait(end_ns + k * TICK_NS)
    assert shown(flight.texts, "leader lost")
    assert shown(flight.lines, "no leader: withdrawn: nothing usable of our own motion arrives")
