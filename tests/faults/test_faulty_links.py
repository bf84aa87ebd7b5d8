"""Faults of the bytes, messages and senders of one synthetic flight that the fault matrix does not have.

After a fault has passed, estimates are valid again within 5 s of flight. That a Zenoh router which dies and
returns is found again: tests/peers/test_fleet.py.
"""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.links import link, tcp
from onboard.messages import Datagram, Encoding, TargetPoints, TimeSync, Verdict
from tests.support.faulty_flight import (
    DATAGRAMS,
    IMAGES,
    ITEMS,
    T0,
    T1,
    assert_on_target,
    clean,
    flown,
)
from tests.support.streams import CIRCLE, EPOCH, MS, Item, S, Stream, encode


@pytest.mark.parametrize("seed", [33, 34])
def test_drop_30_percent_of_frames_within_datagrams_with_seed(seed: int) -> None:
    """Of an image's three LANDING_TARGETs some are missing."""
    rng = np.random.default_rng(seed)
    lossy = []
    for item, datagram in zip(ITEMS, DATAGRAMS, strict=True):
        if isinstance(item.message, TargetPoints):
            third = len(datagram.data) // 3
            parts = (datagram.data[k * third : (k + 1) * third] for k in range(3))
            lossy.extend(replace(datagram, data=part) for part in parts if rng.random() > 0.1)
        else:
            lossy.append(datagram)
    run = flown(lossy)
    assert_on_target(run, 3.0)
    assert 0 < run.rejected["incomplete_points"] < 0.4 * IMAGES
    assert run.rejected["incomplete_points"] + sum(run.verdicts().values()) == pytest.approx(IMAGES, abs=12)


@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.parametrize("seed", [37, 38])
def test_corrupt_bytes_with_seed(seed: int, stream: bool) -> None:
    """One byte in 400 is wrong."""
    rng = np.random.default_rng(seed)
    damaged = []
    for d in DATAGRAMS:
        data = np.frombuffer(d.data, dtype=np.uint8).copy()
        hit = rng.random(len(data)) < 1 / 400
        data[hit] = rng.integers(0, 256, hit.sum())
        encoding = Encoding.MAVLINK_STREAM if stream else Encoding.MAVLINK
        damaged.append(replace(d, data=data.tobytes(), encoding=encoding))
    run = flown(damaged)
    assert_on_target(run)
    assert run.rejected["bad_frame"] > 20
    assert run.pipeline.clocks.reboots == 0


def test_the_autopilot_reboots_while_an_old_image_is_still_on_its_way() -> None:
    again = [Item(i.t_recv_ns + 48 * S, i.message) for i in Stream(t0=6.0, t1=12.0, seed=22, sparse=True).items()]
    stale = [
        Item(EPOCH + round((54.2 + 0.04 * k) * S), CIRCLE.image(round((51.9 + 0.04 * k) * S))) for k in range(5)
    ]
    run = flown(encode(sorted([*ITEMS, *again, *stale], key=lambda i: i.t_recv_ns)))
    assert_on_target(run)
    assert run.pipeline.health(0).autopilot_reboots == 1


def test_all_at_once_with_seed_40() -> None:
    rng = np.random.default_rng(40)
    out: list[Datagram] = []
    for d in DATAGRAMS:
        if rng.random() < 0.15:
            continue
        data = bytearray(d.data)
        if rng.random() < 0.1:
            data[rng.integers(0, len(data))] ^= 0xFF
        if rng.random() < 0.05:
            data = data[: rng.integers(0, len(data))]
        out.extend([replace(d, data=bytes(data))] * (2 if rng.random() < 0.1 else 1))
        if rng.random() < 0.1:
            noise = rng.integers(0, 256, 60, dtype=np.uint8).tobytes()
            out.append(replace(d, data=noise))
    order = np.argsort([i + rng.uniform(0, 6) for i in range(len(out))])
    run = flown([out[i] for i in order])
    assert_on_target(run, 3.0)
    assert {"bad_frame", "truncated", "incomplete_points", "position_out_of_order"} <= set(run.rejected)


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


WITHIN_S = 5.0
CUT, BACK = EPOCH + 45 * S, EPOCH + 48 * S


def serial(datagrams: list[Datagram]) -> list[Datagram]:
    """The same bytes as they come over a serial line."""
    return [replace(d, encoding=Encoding.MAVLINK_STREAM) for d in datagrams]


@pytest.mark.parametrize("seed", [51, 52])
def test_a_serial_line_that_drops_bytes_with_seed(seed: int) -> None:
    """For three seconds one byte in 50 is lost, so that few frames are whole; in the last of them, all are."""
    rng = np.random.default_rng(seed)
    received = []
    for d in serial(DATAGRAMS):
        share = 0.0 if not CUT <= d.t_recv_ns < BACK else 0.02 if d.t_recv_ns < BACK - S else 1.0
        data = np.frombuffer(d.data, dtype=np.uint8)
        received.append(replace(d, data=data[rng.random(len(data)) >= share].tobytes()))
    run = flown([d for d in received if d.data])
    assert run.rejected["bad_frame"] > 20
    after = [e for e in run.estimates if e.t_ns > BACK - EPOCH]
    first = next(e for e in after if e.valid)
    assert (first.t_ns - (BACK - EPOCH)) * 1e-9 < WITHIN_S
    assert_on_target(run)


def test_a_lost_link_is_tried_again_often_enough() -> None:
    assert link.MAX_RECONNECT_DELAY_S + tcp.CONNECT_TIMEOUT_S < WITHIN_S


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
