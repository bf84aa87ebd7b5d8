"""The fault matrix of our own state: numbers that are none, and that no vehicle has, in every field of every
message that it is estimated from.

A vehicle hovers for 6 s. Meanwhile, for a second or two, each message of one kind has a bad number in one field
after the other. No exception is counted, every state is sane, and half a second later all is well.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Barometer,
    Battery,
    Clock,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Imu,
    Message,
)
from tests.support.own_vehicle import GRAVITY, ORIGIN, header, heartbeat, hovering, pipeline, states_of

BEGINS, LAST = 2500, 6000  # ms; the origin is chosen at 3 s
ENDS = {GpsFix: 4500}  # which comes ten times a second; other kinds:
SOON = 3500
LATER = 500  # ms after the end, all is well again
RIGHT = 2.2e-5  # m, m/s
BAD = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38)
FIELDS = {
    Imu: ("f_b", "omega_b", "pressure_altitude"),
    Attitude: ("q_nb", "omega_b"),
    GpsFix: ("lat_deg", "lon_deg", "alt_msl", "ground_speed", "course_rad", "h_acc", "v_acc", "v_down"),
    Barometer: ("pressure_altitude",),
    GlobalOrigin: ("lat_deg", "lon_deg", "alt_msl"),
    GlobalPosition: ("lat_deg", "lon_deg", "alt_msl", "height", "v_F_n", "heading_rad"),
    Battery: ("voltage_v",),
}


def flight() -> Iterator[Message]:
    """Level and at rest, with all that an autopilot may send."""
    hover = round(1000 + 1000 * math.sqrt(0.468 * GRAVITY / 12.0))
    for message in hovering(1000, LAST):
        yield message
        t = round(message.t_ns / 1e6)
        if isinstance(message, Imu) and t % 20 == 0:
            yield Barometer(**header(t), pressure_altitude=500.0)
            yield ActuatorOutputs(**header(t), pwm_us=(hover,) * 4)
        if isinstance(message, GpsFix):
            at = {"lat_deg": ORIGIN[0], "lon_deg": ORIGIN[1], "alt_msl": ORIGIN[2]}
            yield GlobalPosition(**header(t), **at, height=0.0, v_F_n=(0.0, 0.0, 0.0), heading_rad=0.0)
            yield GlobalOrigin(**header(t), clock=Clock.NONE, **at)
            yield Battery(**header(t), clock=Clock.NONE, voltage_v=12.6)


def spoilt(kind: type[Message]) -> Iterator[Message]:
    """The flight with bad numbers in one kind of message."""
    turn, end = itertools.cycle(itertools.product(BAD, FIELDS[kind])), ENDS.get(kind, SOON)
    for message in flight():
        if isinstance(message, kind) and BEGINS <= message.t_ns / 1e6 < end:
            value, name = next(turn)
            yield replace(message, **{name: _like(getattr(message, name), value)})
        else:
            yield message


def _like(good: Any, value: float) -> Any:
    return (value, *good[1:]) if isinstance(good, tuple) else value


@pytest.mark.parametrize("kind", FIELDS, ids=[kind.__name__ for kind in FIELDS])
def test_bad_numbers_in(kind: type[Message]) -> None:
    p = pipeline(airframe="csvsf", publish_rate_hz=20.0)
    states = states_of(p, [heartbeat(), *spoilt(kind)])
    assert not p.errors
    for state in states:
        if state.valid:
            assert np.isfinite(state.mean).all()
            assert np.isfinite(state.covariance).all()
    after = [state for state in states if state.t_ns >= (ENDS.get(kind, SOON) + LATER) * 1_000_000]
    assert len(after) > 15
    assert all(state.valid for state in after)
    assert max(abs(x) for state in after for x in (state.mean or ())[:6]) < RIGHT
    assert not any(state.faults for state in after)


def test_the_flight_without_bad_numbers() -> None:
    p = pipeline(airframe="csvsf", publish_rate_hz=20.0)
    states = states_of(p, [heartbeat(), *flight()])
    assert states[-1].valid
    assert max(abs(x) for x in (states[-1].mean or ())[:6]) < 2e-5
    assert not any(state.faults for state in states)
