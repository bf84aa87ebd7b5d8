"""One synthetic flight, with faults of its bytes on the way and of clocks."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Datagram, Encoding, TargetPoints, Verdict
from tests.support.faulty_flight import (
    DATAGRAMS,
    IMAGES,
    ITEMS,
    OWN_RATE_HZ,
    T0,
    T1,
    assert_on_target,
    clean,
    flown,
)
from tests.support.streams import CIRCLE, EPOCH, MS, Item, S, Stream, encode


def test_the_flight_without_faults() -> None:
    assert_on_target(clean(), 1.0)
    assert clean().rejected == {}
    assert clean().verdicts() == {Verdict.INITIALISING: 3, Verdict.FUSED: IMAGES - 3}


@pytest.mark.parametrize("seed", [31, 32])
def test_drop_30_percent_with_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kept = [d for i, d in enumerate(DATAGRAMS) if i == 0 or rng.random() > 0.3]  # the first is a heartbeat
    run = flown(kept)
    assert_on_target(run)
    assert run.rejected == {}
    assert run.pipeline.health(0).streams["Attitude"].count < 0.8 * (T1 - T0) * OWN_RATE_HZ


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


@pytest.mark.parametrize("seed", [35, 36])
def test_reorder_with_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    order = np.argsort([d.t_recv_ns + rng.uniform(0, 100 * MS) for d in DATAGRAMS])
    run = flown([DATAGRAMS[i] for i in order])
    assert_on_target(run)
    assert run.rejected["attitude_out_of_order"] > 20
    assert run.rejected["position_out_of_order"] > 20
    assert run.pipeline.clocks.reboots == 0


def test_duplicate_every_datagram() -> None:
    run = flown([d for d in DATAGRAMS for _ in range(2)])
    assert run.estimates[-1].mean == clean().estimates[-1].mean
    assert run.verdicts() == clean().verdicts()
    assert set(run.rejected) == {"repeated"}


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


@pytest.mark.parametrize("seed", [39])
def test_a_stream_cut_anywhere_gives_the_same_flight_with_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rest, cut = b"", []
    for d in DATAGRAMS:
        data = rest + d.data
        at = int(rng.integers(0, len(data) + 1))
        rest = data[at:]
        cut.append(replace(d, data=data[:at], encoding=Encoding.MAVLINK_STREAM))
    run = flown(cut)
    assert_on_target(run, 1.0)
    assert run.rejected == {}


@pytest.mark.parametrize("jump_s", [-3600, -5, 5, 3600])
def test_our_own_clock_jumps(jump_s: int) -> None:
    half = len(DATAGRAMS) // 2
    run = flown([*DATAGRAMS[:half], *(replace(d, t_recv_ns=d.t_recv_ns + jump_s * S) for d in DATAGRAMS[half:])])
    assert run.estimates[-1].mean == clean().estimates[-1].mean
    assert run.rejected == {"host_clock_steps": 1}
    assert run.pipeline.health(0).clock_offset_ns == EPOCH + 2 * MS + jump_s * S


def test_the_autopilot_reboots() -> None:
    again = encode(
        [Item(i.t_recv_ns + 48 * S, i.message) for i in Stream(t0=6.0, t1=12.0, seed=22, sparse=True).items()]
    )
    run = flown([*DATAGRAMS, *again])
    assert_on_target(run)
    assert run.estimates[-1].reset_count == 1
    assert run.estimates[-1].t_ns < 12 * S
    assert run.pipeline.health(0).autopilot_reboots == 1
    assert run.rejected == {"odd_stamp": 4}


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
