"""The autopilot's filter fails: its zeros are not our motion, and what it does not know is not published."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.estimators.own_state.sources import _origin
from onboard.messages import Datagram, Encoding, Estimate, GlobalPosition, LocalPosition, OwnPose
from onboard.ownship import Ownship
from tests.support.faulty_flight import ITEMS, T0, T1, assert_on_target
from tests.support.streams import CIRCLE, EPOCH, MS, Item, Run, S, encode, feed

FAILS = 46.0
SECONDS = range(round(T0), round(T1))
HEALTHY, NO_VELOCITY = 831, 165  # as in recorded flights; the second in constant-position mode


def global_position(t_ns: int, v: tuple[float, float, float]) -> Item:
    message = GlobalPosition(
        t_ns=t_ns,
        t_recv_ns=EPOCH + t_ns,
        lat_deg=47.0,
        lon_deg=8.0,
        alt_msl=550.0,
        height=50.0,
        v_F_n=v,
        heading_rad=None,
    )
    return Item(EPOCH + t_ns + 2 * MS, message)


def status(t_s: float, flags: int, *, px4: bool) -> Datagram:
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    message: Any = (
        dialect.MAVLink_estimator_status_message(round(t_s * 1e6), flags, *[0.1] * 8)
        if px4
        else dialect.MAVLink_ekf_status_report_message(flags, *[0.1] * 5)
    )
    t_recv_ns = EPOCH + round(t_s * S) + 3 * MS
    return Datagram(channel="status", encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=message.pack(sender))


def flight(*, local_until: float, v: tuple[float, float, float], statuses: list[Datagram]) -> Run:
    """LOCAL_POSITION_NED ends; GLOBAL_POSITION_INT with a velocity v comes all the time; images go on."""
    items = [i for i in ITEMS if not isinstance(i.message, LocalPosition) or i.message.t_ns < local_until * S]
    items += [global_position(ms * MS, v) for ms in range(round(local_until * 1000), round(T1 * 1000), 100)]
    return feed(sorted([*encode(items), *statuses], key=lambda d: d.t_recv_ns))


def valid_after(run: Run, t_s: float) -> list[Estimate]:
    return [e for e in run.estimates if e.valid and e.t_ns > t_s * S]


@pytest.mark.parametrize(
    ("flags", "px4"),
    # a PX4 at rest states a velocity in its constant-position mode
    [(NO_VELOCITY, False), (NO_VELOCITY, True), (128 + HEALTHY, False), (0, False), (0, True)],
)
def test_zeros_of_a_failed_filter_are_not_our_velocity(flags: int, px4: bool) -> None:
    statuses = [status(t, HEALTHY if t < FAILS else flags, px4=px4) for t in SECONDS]
    run = flight(local_until=FAILS, v=(0.0, 0.0, 0.0), statuses=statuses)
    assert valid_after(run, 45.9)
    assert valid_after(run, FAILS + 0.1) == []
    assert run.estimates[-1].reason == "our own motion is not known"
    assert run.rejected["filter_has_no_velocity"] >= 50


def test_zeros_without_any_status_are_not_our_velocity() -> None:
    run = flight(local_until=FAILS, v=(0.0, 0.0, 0.0), statuses=[])
    assert valid_after(run, FAILS + 1.1) == []
    assert run.rejected["filter_has_no_velocity"] > 30


def flown_ownship(*, v: tuple[float, float, float], statuses: list[Datagram]) -> Ownship:
    return flight(local_until=FAILS, v=v, statuses=statuses).pipeline.ownship


@pytest.mark.parametrize("px4", [False, True])
def test_a_local_velocity_that_the_filter_disowns_is_not_used_until_it_recovers(px4: bool) -> None:
    statuses = [status(t, NO_VELOCITY if 45 <= t < 46 else HEALTHY, px4=px4) for t in SECONDS]
    run = feed(sorted([*encode(ITEMS), *statuses], key=lambda d: d.t_recv_ns))
    assert not [e for e in run.estimates if e.valid and 45.1 * S < e.t_ns < 45.9 * S]
    assert_on_target(run)


def test_an_old_status_does_not_count_for_ever() -> None:
    run = feed(sorted([*encode(ITEMS), status(T0 + 1, NO_VELOCITY, px4=False)], key=lambda d: d.t_recv_ns))
    assert_on_target(run, 4.0)  # a new track


def test_an_unknown_horizontal_position_is_published_as_unknown() -> None:
    run = flight(local_until=FAILS, v=(15.0, 0.0, 0.0), statuses=[])
    poses = [o for o in run.outputs if isinstance(o, OwnPose)]
    north, east, down = next(p for p in poses if p.t_ns > 45.9 * S).r_OF_n
    assert None not in {north, east, down}
    assert poses[-1].r_OF_n == (None, None, -50.0)
    assert poses[-1].v_F_n == pytest.approx((15.0, 0.0, 0.0))


def test_no_origin_is_learned_from_an_unknown_horizontal_position() -> None:
    own = flown_ownship(v=(15.0, 0.0, 0.0), statuses=[])
    message = global_position(own.now_ns, (15.0, 0.0, 0.0)).message
    assert isinstance(message, GlobalPosition)
    assert own.pose_at(own.now_ns) is not None
    assert _origin(message, own) is None
    known = Ownship(max_extrapolation=0.1)
    known.receive(CIRCLE.attitude(5 * S), 5 * S)
    known.receive(CIRCLE.position(5 * S), 5 * S)
    message = global_position(5 * S, (15.0, 0.0, 0.0)).message
    assert isinstance(message, GlobalPosition)
    assert _origin(message, known) is not None
