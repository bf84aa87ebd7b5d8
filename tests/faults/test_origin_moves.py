"""GPS_GLOBAL_ORIGIN: the autopilot moves its origin in flight."""

from functools import cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.config import load_config
from onboard.messages import Datagram, Encoding, NavState
from tests.faults.test_silence import own_and_traffic
from tests.support.streams import EPOCH, MS, Run, S, feed


def origin(t_s: int, lat_deg: float, alt: float, *, component: int = 1) -> Datagram:
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=component)
    frame = dialect.MAVLink_gps_global_origin_message(round(lat_deg * 1e7), 80_000_000, round(alt * 1000))
    t_recv_ns = EPOCH + t_s * S + 5 * MS
    return Datagram(channel="origin", encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=frame.pack(sender))


def flight(origins: list[Datagram]) -> Run:
    config = load_config(None, ("estimator={own_state={}}",))
    return feed(sorted([*own_and_traffic(), *origins], key=lambda d: d.t_recv_ns), config)


@cache
def unmoved() -> Run:
    """The flight without a word about the origin."""
    return flight([])


def states(run: Run) -> list[NavState]:
    return [e for e in run.estimates if isinstance(e, NavState)]


@pytest.mark.parametrize(("lat_deg", "alt"), [(47.001, 500.0), (46.9, 500.0), (47.0, 520.0)])
def test_our_own_state_begins_anew_at_an_origin_that_has_moved(lat_deg: float, alt: float) -> None:
    origins = [origin(t, *((47.0, 500.0) if t < 47 else (lat_deg, alt))) for t in range(44, 52)]
    run = flight(origins)
    before, after = [s for s in states(run) if s.t_ns < 47 * S][-1], states(run)[-1]
    assert before.valid
    assert after.valid
    assert after.reset_count == before.reset_count + 1
    assert after.origin == pytest.approx((lat_deg, 8.0, alt), abs=1e-6)
    assert before.mean is not None
    assert after.mean is not None
    assert any(not s.valid and s.reason == "the autopilot has moved its origin" for s in states(run))


@pytest.mark.parametrize("component", [1, 154])
def test_an_origin_that_stays_or_is_of_another_component_changes_nothing(component: int) -> None:
    by = 1e-7 if component == 1 else 1.0
    origins = [origin(t, 47.0 + t % 2 * by, 500.0, component=component) for t in range(44, 52)]
    assert [s.mean for s in states(flight(origins))] == [s.mean for s in states(unmoved())]
