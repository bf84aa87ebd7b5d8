"""ADSB_VEHICLE and COLLISION against literal bytes and pymavlink's own parser and packer."""

import math
import struct
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import common

from onboard.messages import AdsbVehicle, AltitudeType, Clock, Collision
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.mavlink_frames import RECEIVE_TIME_NS, crc_x25

# Packed with struct from the field table of common.xml (size order), not with any encoder.
ALL_VALID = 1 | 2 | 4 | 8 | 16 | 32 | 128
ADSB: dict[str, Any] = {
    "ICAO_address": 0x4B1A2C,
    "lat": 473977420,
    "lon": -85455940,
    "altitude": 1234567,
    "heading": 27000,
    "hor_velocity": 6543,
    "ver_velocity": -321,
    "flags": ALL_VALID,
    "squawk": 7700,
    "altitude_type": 1,
    "callsign": b"HB-ABC\0\0\0",
    "emitter_type": 14,
    "tslc": 3,
}
EXTRA = 184


def adsb_frame(**changes: Any) -> bytes:
    f = ADSB | changes
    payload = struct.pack("<IiiiHHhHHB9sBB", *(f[name] for name in ADSB))
    head = b"\xfd" + bytes([len(payload), 0, 0, 5, 1, 156]) + (246).to_bytes(3, "little")
    return head + payload + struct.pack("<H", crc_x25(head[1:] + payload + bytes([EXTRA])))


def adsb(**changes: Any) -> AdsbVehicle:
    (message,) = MavlinkDecoder(stream=False).decode(adsb_frame(**changes), RECEIVE_TIME_NS)
    assert isinstance(message, AdsbVehicle)
    return message


def test_adsb_vehicle_packed_by_hand() -> None:
    m = adsb()
    assert (m.t_ns, m.t_recv_ns, m.clock, m.system, m.component) == (
        RECEIVE_TIME_NS,
        RECEIVE_TIME_NS,
        Clock.NONE,
        1,
        156,
    )
    assert m.icao == 0x4B1A2C
    assert m.lat_deg == pytest.approx(47.397742, abs=1e-12)
    assert m.lon_deg == pytest.approx(-8.545594, abs=1e-12)
    assert m.altitude == pytest.approx(1234.567)
    assert m.altitude_type is AltitudeType.GEOMETRIC
    assert m.course == pytest.approx(1.5 * math.pi)
    assert m.ground_speed == pytest.approx(65.43)
    assert m.climb == pytest.approx(-3.21)
    assert (m.callsign, m.squawk, m.emitter, m.tslc, m.simulated) == ("HB-ABC", 7700, 14, 3.0, False)


def test_adsb_vehicle_is_encoded_as_it_was_decoded() -> None:
    frame = MavlinkEncoder(1, 156).encode(adsb())
    (theirs,) = common.MAVLink(None).parse_buffer(frame)
    assert theirs.get_type() == "ADSB_VEHICLE"
    for name, value in ADSB.items():
        expected = value.rstrip(b"\0").decode() if isinstance(value, bytes) else value
        assert getattr(theirs, name) == expected, name
    for flag in (1, 2, 4, 8, 16, 32, 128):
        m = adsb(flags=ALL_VALID & ~flag)
        (theirs,) = common.MAVLink(None).parse_buffer(MavlinkEncoder(1, 156).encode(m))
        assert theirs.flags == ALL_VALID & ~flag


def test_speeds_and_ages_beyond_a_field_do_not_wrap() -> None:
    m = replace(adsb(), ground_speed=1000.0, climb=-1000.0, tslc=1e6, course=-math.pi / 2)
    (theirs,) = common.MAVLink(None).parse_buffer(MavlinkEncoder(1, 156).encode(m))
    assert (theirs.hor_velocity, theirs.ver_velocity, theirs.tslc, theirs.heading) == (65535, -32768, 255, 27000)


def test_collision_as_pymavlink_reads_it() -> None:
    m = Collision(
        t_ns=0, t_recv_ns=0, source=0, threat=0x4B1A2C, threat_level=2, time=12.5, vertical=-3.25, horizontal=40.5
    )
    frame = MavlinkEncoder(7, 191).encode(m)
    (theirs,) = common.MAVLink(None).parse_buffer(frame)
    assert (theirs.src, theirs.id, theirs.action, theirs.threat_level) == (0, 0x4B1A2C, 0, 2)
    assert theirs.time_to_minimum_delta == 12.5
    assert (theirs.altitude_minimum_delta, theirs.horizontal_minimum_delta) == (-3.25, 40.5)
    (back,) = MavlinkDecoder(stream=False).decode(frame, RECEIVE_TIME_NS)
    assert back == replace(
        m, t_ns=RECEIVE_TIME_NS, t_recv_ns=RECEIVE_TIME_NS, clock=Clock.NONE, system=7, component=191
    )
