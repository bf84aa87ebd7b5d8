"""One synthetic flight, with faults in its messages and messages of other senders."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace

from onboard.messages import Attitude, LocalPosition, Message, TargetPoints, TimeSync, Verdict
from tests.support.faulty_flight import IMAGES, ITEMS, OWN_RATE_HZ, T0, T1, assert_on_target, clean, flown
from tests.support.streams import EPOCH, MS, Item, Run, S, encode, heartbeat


def flown_with(kind: type[Message], is_hit: Callable[[int], bool], change: Callable[[Any], Message]) -> Run:
    """The flight with `change` applied to each message of that kind whose time (ns) `is_hit` accepts."""
    hit = lambda m: isinstance(m, kind) and is_hit(m.t_ns)  # noqa: E731
    return flown(encode(Item(i.t_recv_ns, change(i.message) if hit(i.message) else i.message) for i in ITEMS))


def test_nan_in_the_attitude() -> None:
    run = flown_with(Attitude, lambda t: t % (200 * MS) == 0, lambda m: replace(m, q_nb=(math.nan, 0.0, 0.0, 0.0)))
    assert_on_target(run)
    assert run.rejected == {"attitude_unusable": (T1 - T0) * 5}


def test_nan_in_the_position_for_a_second() -> None:
    nan = (math.nan, 0.0, 0.0)
    run = flown_with(LocalPosition, lambda t: 45 * S <= t < 46 * S, lambda m: replace(m, v_F_n=nan))
    assert_on_target(run)
    assert run.rejected == {"position_unusable": OWN_RATE_HZ}


def test_nan_in_all_images_for_five_seconds() -> None:
    nan = (math.nan, math.nan)
    run = flown_with(TargetPoints, lambda t: 44 * S <= t < 49 * S, lambda m: replace(m, left=nan))
    assert run.verdicts()[Verdict.NOT_FINITE] == 63  # 5 s at 12.5 Hz
    assert not any(e.valid for e in run.estimates if 46.05 * S < e.t_ns < 49 * S)
    assert_on_target(run, 5.0)  # a new track


def test_swapped_wingtips_change_nothing() -> None:
    """The span has no sign: a detector that mixes up left and right does no harm."""
    run = flown_with(TargetPoints, lambda t: t % (80 * MS) == 0, lambda m: replace(m, left=m.right, right=m.left))
    np.testing.assert_allclose(run.estimates[-1].mean, clean().estimates[-1].mean, rtol=1e-9, atol=1e-9)
    assert run.verdicts() == clean().verdicts()


def test_wingtips_that_coincide_are_degenerate() -> None:
    coincide = lambda m: replace(m, left=m.center, right=m.center)  # noqa: E731
    run = flown_with(TargetPoints, lambda t: t % (400 * MS) == 0, coincide)
    assert_on_target(run)
    assert run.verdicts()[Verdict.DEGENERATE] == 22  # two and a half a second


def test_traffic_of_other_systems_mixed_in_changes_nothing() -> None:
    """The autopilot forwards the leader's own stream onto our link, on the leader's boot clock."""
    foreign = []
    for i in ITEMS:
        m = replace(i.message, system=2, t_ns=i.message.t_ns + 1000 * S)
        foreign.append(Item(i.t_recv_ns + 1000, m))
    mixed = sorted([*ITEMS, *foreign], key=lambda i: i.t_recv_ns)
    run = flown(encode(mixed))
    assert run.estimates[-1].mean == clean().estimates[-1].mean
    assert run.rejected == {"other_system": len(foreign)}
    assert run.pipeline.health(0).autopilot_reboots == 0


def test_a_flood_of_another_systems_heartbeats_changes_nothing() -> None:
    flood = [Item(EPOCH + round(t * S), heartbeat(0, system=7)) for t in np.arange(T0 + 0.1, T1, 0.001)]
    run = flown(encode(sorted([*ITEMS, *flood], key=lambda i: i.t_recv_ns)))
    assert run.estimates[-1].mean == clean().estimates[-1].mean
    assert run.rejected == {"other_system": len(flood)}
    assert run.pipeline.autopilot is not None
    assert run.pipeline.autopilot.system == 1
    assert run.pipeline.health(EPOCH + round(T1 * S)).streams["Heartbeat"].count == T1 - T0


def test_foreign_and_forged_timesync_replies_do_not_bend_the_time_base() -> None:
    def reply(t_ns: int, component: int, ts1_ns: int) -> Item:
        recv = EPOCH + t_ns
        m = TimeSync(t_ns=recv, t_recv_ns=recv, component=component, tc1_ns=t_ns + 7 * S, ts1_ns=ts1_ns)
        return Item(recv, m)

    others = [reply(round(t * S), 154, EPOCH + round(t * S) - MS) for t in np.arange(T0 + 0.1, T1, 0.1)]
    stale = [reply(round(t * S), 1, round(t * S)) for t in np.arange(T0 + 0.15, T1, 0.1)]
    run = flown(encode(sorted([*ITEMS, *others, *stale], key=lambda i: i.t_recv_ns)))
    assert run.estimates[-1].mean == clean().estimates[-1].mean
    assert run.pipeline.health(0).clock_offset_ns == EPOCH + 2 * MS
    assert run.rejected == {"other_component": len(others), "timesync_not_ours": len(stale)}


def test_own_motion_stops_and_comes_back() -> None:
    """The autopilot is silent for five seconds; the camera continues."""
    silence = range(44 * S, 49 * S)
    items = [i for i in ITEMS if i.message.t_ns not in silence or isinstance(i.message, TargetPoints)]
    run = flown(encode(items))
    assert_on_target(run, 3.0)
    verdicts = run.verdicts()
    assert sum(verdicts.values()) == IMAGES
    assert verdicts[Verdict.TOO_NEW] > 45
    # the estimate of the boot clock stands still: only the arrival times show that time has passed
    late = [
        e for e in run.estimates if e.measurement and EPOCH + 45.1 * S < e.measurement.t_recv_ns < EPOCH + 49 * S
    ]
    assert len(late) > 45
    assert not any(e.valid for e in late if e.measurement and e.measurement.verdict is Verdict.TOO_NEW)
