"""Traffic sent over MAVLink, read back with pymavlink's own parser."""

import math
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import common

from onboard.autopilot.traffic import TrafficOutput
from onboard.config import ConfigError, TrafficOutConfig, load_config, parse_config
from onboard.messages import (
    Clock,
    Datagram,
    Encoding,
    Estimate,
    Heartbeat,
    ThreatLevel,
)
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.vehicle_records import APPROACH, INTRUDER, TRAFFIC

S = 1_000_000_000


def silent(target: str, system: int | None = None) -> Estimate:
    return replace(
        TRAFFIC, target=target, intruder=replace(INTRUDER, icao=None, system=system, callsign="", squawk=None)
    )


def out(**config: Any) -> TrafficOutput:
    made = TrafficOutput(TrafficOutConfig(link="gcs", **config), 191)
    made.connect(7)
    return made


def parsed(frames: list[bytes]) -> list[Any]:
    parser = common.MAVLink(None)
    return [m for frame in frames for m in parser.parse_buffer(frame) or []]


def test_a_threat_is_told_with_its_closest_approach() -> None:
    (m,) = parsed(out().frames(TRAFFIC))
    assert (m.get_type(), m.get_srcSystem(), m.get_srcComponent()) == ("COLLISION", 7, 191)
    assert (m.src, m.id, m.action, m.threat_level) == (0, 0x4B1A2C, 0, 2)
    assert (m.time_to_minimum_delta, m.altitude_minimum_delta, m.horizontal_minimum_delta) == (12.0, -30.0, 40.0)


def test_those_without_a_transponder_are_put_on_the_map_under_an_address_that_is_nobodys() -> None:
    drone, peer = parsed(out().frames(silent("radar/12"))), parsed(out().frames(silent("system/7", 7)))
    assert [m.get_type() for m in drone] == ["ADSB_VEHICLE", "COLLISION"]
    m = drone[0]
    assert m.ICAO_address == drone[1].id == 0xF1000C
    assert peer[0].ICAO_address == 0xF00007
    assert (peer[1].src, peer[1].id) == (1, 7)
    assert (m.lat, m.lon, m.altitude, m.altitude_type) == (474000000, -85000000, 600000, 0)
    assert m.heading == round(math.degrees(math.atan2(40, -30)) * 100)
    assert (m.hor_velocity, m.ver_velocity) == (5000, -200)
    assert (m.callsign, m.tslc) == ("RADAR12", 1)
    assert m.flags & 0b11011111 == 1 | 2 | 4 | 8 | 16 | 128


@pytest.mark.parametrize(("which", "count"), [("all", 2), ("silent", 1), ("none", 0)])
def test_which_tracks_are_put_on_the_map_is_configured(which: str, count: int) -> None:
    made = out(adsb_vehicle=which, collision=False)
    frames = made.frames(TRAFFIC) + made.frames(silent("radar/3"))
    assert [m.get_type() for m in parsed(frames)] == ["ADSB_VEHICLE"] * count


def test_each_track_is_told_of_as_often_as_configured_and_not_when_it_is_no_threat() -> None:
    made = out(rate_hz=2.0)
    times = [(1000 + k) * S // 10 for k in range(40)]  # 4 s at 10 Hz
    assert sum(len(made.frames(replace(TRAFFIC, t_ns=t_ns))) for t_ns in times) == 8
    harmless = replace(INTRUDER, approach=replace(APPROACH, threat=ThreatLevel.NONE))
    assert out().frames(replace(TRAFFIC, intruder=harmless)) == []


def test_after_the_clock_has_gone_back_it_goes_on() -> None:
    made = out()
    assert made.frames(TRAFFIC)
    assert made.frames(replace(TRAFFIC, t_ns=3 * S))


def test_nothing_is_told_of_what_is_not_valid_nor_before_an_autopilot_is_heard() -> None:
    assert out().frames(replace(TRAFFIC, valid=False)) == []
    assert out().frames(replace(TRAFFIC, intruder=None)) == []
    assert TrafficOutput(TrafficOutConfig(link="gcs"), 191).frames(TRAFFIC) == []


def test_it_is_off_unless_a_link_is_named_and_the_link_must_be_there() -> None:
    assert load_config(None).traffic_out.link == ""
    assert parse_config({"traffic_out": {"link": "camera"}}).traffic_out.link == "camera"
    with pytest.raises(ConfigError, match=r"traffic_out.link.*gcs.*known: autopilot, camera"):
        parse_config({"traffic_out": {"link": "gcs"}})


def test_what_we_told_ourselves_is_no_traffic_when_it_comes_back() -> None:
    pipeline = Pipeline(parse_config({"estimator": {"traffic": {}}}))
    beat = Heartbeat(t_ns=0, t_recv_ns=0, clock=Clock.NONE, vehicle_type=2, autopilot=12, armed=True, status=4)
    frames = [MavlinkEncoder(7, 1).encode(beat), *out(adsb_vehicle="all").frames(TRAFFIC)]
    for frame in frames:
        pipeline.feed(Datagram(channel="autopilot", encoding=Encoding.MAVLINK, t_recv_ns=S, data=frame))
    health = pipeline.health(2 * S)
    assert health.rejected["our_own"] == len(frames) - 1
    assert not any(name.startswith("traffic") for name in health.verdicts)
