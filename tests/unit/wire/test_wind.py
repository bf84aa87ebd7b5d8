"""Reports of the wind by both autopilots."""

import struct

import pytest

from onboard.messages import Clock, Wind
from tests.support.mavlink_frames import frame, one
from tests.support.streams import EPOCH, S, encode

SENT = Wind(t_ns=S, t_recv_ns=EPOCH + S, clock=Clock.NONE, north=0.0, east=-5.5, sigma=0.5)


def test_wind_of_both_autopilots_from_packed_bytes() -> None:
    """ArduPilot's says where it comes from; PX4's states the sum of two variances, others an accuracy."""
    ardupilot = one(frame(168, 1, struct.pack("<3f", 90.0, 5.0, 0.3)))
    assert (ardupilot.north, ardupilot.east, ardupilot.sigma) == (pytest.approx(0.0, abs=1e-6), -5.0, None)
    fields = [0.0, 0.0, 500.0, 0.0, 0.0]
    px4 = one(frame(231, 105, struct.pack("<Q8f", 7, 3.0, -4.0, 0.0, 0.5, *fields[1:])))
    assert (px4.north, px4.east, px4.sigma) == (3.0, -4.0, 0.5)
    accurate = one(frame(231, 105, struct.pack("<Q8f", 7, 3.0, -4.0, 0.0, 0.5, 0.0, 0.0, 1.25, 0.0)))
    assert accurate.sigma == 1.25


def test_wind_survives_the_wire() -> None:
    datagram = encode([(SENT.t_recv_ns, SENT)])[0]  # type: ignore[list-item]
    read = one(datagram.data)
    assert (read.north, read.east) == (0.0, pytest.approx(SENT.east))
    assert read.sigma == pytest.approx(0.5)
