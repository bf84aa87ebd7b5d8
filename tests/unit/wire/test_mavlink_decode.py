"""Records from MAVLink bytes: literal frames and hand-packed ones."""

import math
import struct

import pytest

from onboard.messages import (
    Barometer,
    Clock,
    CurrentMode,
    LocalPosition,
    ParamValue,
)
from tests.support.mavlink_frames import NED_V1, NED_V2, RECEIVE_TIME_NS, frame, one


@pytest.mark.parametrize("literal", [NED_V2, NED_V1], ids=["v2", "v1"])
def test_local_position_from_literal_bytes(literal: str) -> None:
    assert one(bytes.fromhex(literal)) == LocalPosition(
        t_ns=123_456_000_000,
        t_recv_ns=RECEIVE_TIME_NS,
        clock=Clock.BOOT,
        system=3,
        component=1,
        r_OF_n=(1.5, -2.25, -30.5),
        v_F_n=(0.125, -0.5, 4.0),
    )


def test_the_mode_that_px4_returns_to() -> None:
    m = one(frame(436, 193, struct.pack("<2IB", 4 << 16 | 3 << 24, 6 << 16, 0)))
    assert isinstance(m, CurrentMode)
    assert (m.custom_mode, m.intended_mode) == (4 << 16 | 3 << 24, 6 << 16)


ISA = {  # the standard's printed table (ISO 2533): geopotential altitude, m: pressure, hPa
    -1000: 1139.29,
    -200: 1037.51,
    0: 1013.25,
    500: 954.608,
    1000: 898.746,
    2000: 794.952,
    3000: 701.085,
    4000: 616.402,
    5000: 540.199,
    6000: 471.810,
    8000: 355.998,
    10000: 264.363,
    11000: 226.321,
}


@pytest.mark.parametrize(("altitude", "press_abs"), ISA.items())
def test_a_pressure_is_an_altitude_of_the_standard_atmosphere(press_abs: float, altitude: float) -> None:
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert isinstance(m, Barometer)
    assert (m.t_ns, m.clock) == (5_250_000_000, Clock.BOOT)
    assert m.pressure_altitude == pytest.approx(altitude, abs=0.05)


@pytest.mark.parametrize("press_abs", [0.0, -1.0, math.nan])
def test_no_pressure_is_no_altitude(press_abs: float) -> None:
    m = one(frame(29, 115, struct.pack("<Iffh", 5250, press_abs, 0.0, 2500)))
    assert math.isnan(m.pressure_altitude)


@pytest.mark.parametrize(
    ("kind", "sent", "value"),
    [
        (9, struct.pack("<f", 0.125), 0.125),
        (6, struct.pack("<f", -3.0), -3.0),  # as ArduPilot sends it
        *((6, struct.pack("<i", n), n) for n in (0, 1, -1, 57600, -70000)),  # as PX4 does
        (5, struct.pack("<I", 4), 4),
        (2, struct.pack("<b3x", -5), -5),
        (4, struct.pack("<h2x", -500), -500),
    ],
)
def test_a_parameter_s_value_is_that_of_its_type(kind: int, sent: bytes, value: float) -> None:
    m = one(frame(22, 220, sent + struct.pack("<2H16sB", 900, 12, b"SER_TEL1_BAUD", kind)))
    assert isinstance(m, ParamValue)
    assert (m.name, m.value, m.count, m.index, m.default) == ("SER_TEL1_BAUD", value, 900, 12, None)
