"""How far the autopilot's attitude may be off, as it says."""

import math
import struct
from typing import Any

import pytest

from onboard.messages import EstimatorStatus
from onboard.ownship.stated_attitude import AttitudeUncertainty
from onboard.wire.mavlink.decode import MavlinkDecoder
from tests.support.mavlink_frames import RECEIVE_TIME_NS, frame, one

MS = 1_000_000


def status(**fields: Any) -> EstimatorStatus:
    known = {"horizontal_velocity": None, "horizontal_position": None, **fields}
    return EstimatorStatus(t_ns=0, t_recv_ns=0, **known)


def flown(accelerates: float, seconds: float) -> AttitudeUncertainty:
    """At rest, then so much acceleration, m/s^2, northwards and back."""
    yaw, v = AttitudeUncertainty(), 0.0
    yaw.receive(status(is_at_rest=True))
    for k in range(round(seconds * 50)):
        v += accelerates * 0.02 * (1.0 if k % 200 < 100 else -1.0)
        yaw.move(k * 20 * MS, (v, 0.0, 0.0))
    return yaw


def test_the_yaw_of_a_px4_at_rest_is_open_until_it_accelerates() -> None:
    assert math.degrees(flown(0.0, 60.0).sigma) == pytest.approx(10.0)
    assert math.degrees(flown(0.0, 60.0).tilt) == pytest.approx(2.3)
    assert math.degrees(flown(1.0, 20.0).sigma) == pytest.approx(3.9, abs=0.2)
    assert math.degrees(flown(1.0, 100.0).sigma) == pytest.approx(1.85, abs=0.1)


def test_what_is_stated_counts_and_silence_is_nothing() -> None:
    assert AttitudeUncertainty().sigma == 0.0
    yaw = flown(0.0, 60.0)
    yaw.receive(status(yaw_sigma=0.06, tilt_sigma=0.01))
    yaw.move(100_000 * MS, (3.0, 0.0, 0.0))
    assert (yaw.sigma, yaw.tilt) == (0.06, pytest.approx(0.03))  # a filter's tilt is three times what it states
    silent = AttitudeUncertainty()
    silent.receive(status(horizontal_velocity=True))
    silent.move(0, (0.0, 0.0, 0.0))
    silent.move(1000 * MS, (3.0, 0.0, 0.0))
    assert silent.sigma == 0.0


@pytest.mark.parametrize(("variance", "sigma"), [(0.0304617, 0.174533), (math.nan, None), (0.0, None)])
def test_the_covariance_of_odometry_is_read_and_zero_and_nan_are_unknown(
    variance: float, sigma: float | None
) -> None:
    values = [0.0] * 55
    values[28] = values[31] = 1e-4
    values[33] = variance
    payload = struct.pack("<Q55f4Bb", 5_000_000, *values, 1, 8, 7, 2, 100)
    found = MavlinkDecoder(stream=False).decode(frame(331, 91, payload), RECEIVE_TIME_NS)
    assert [m.yaw_sigma for m in found if isinstance(m, EstimatorStatus)] == (
        [sigma if sigma is None else pytest.approx(sigma, rel=1e-5)]
    )
    assert [m.resets for m in found if isinstance(m, EstimatorStatus)] == [7]


@pytest.mark.parametrize(
    ("number", "extra", "form", "is_px4"), [(230, 163, "<Q8fH", True), (193, 71, "<5fHf", False)]
)
def test_constant_position_of_a_px4_is_rest_and_of_an_ardupilot_ignorance(
    number: int, extra: int, form: str, is_px4: bool
) -> None:
    flags = 0b1111111111
    values = (7_000_000, *[0.1] * 8, flags) if number == 230 else (*[0.1] * 5, flags, 0.0)
    m = one(frame(number, extra, struct.pack(form, *values)))
    assert isinstance(m, EstimatorStatus)
    assert (m.horizontal_velocity, m.horizontal_position, m.is_at_rest) == (is_px4, is_px4, is_px4)
