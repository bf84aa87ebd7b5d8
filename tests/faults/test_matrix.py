"""The fault matrix: a row a fault, and what must be true while it lasts and after it.

All rows share one flight of 6 s: own motion at 25 Hz, images at 12.5 Hz, and the fault from 2 s to 3.5 s. Whatever
the fault, no exception is counted, every estimate is sane, and a valid one is right. Other rows have files of
their own: reboots (`tests/unit/test_reboot.py`), floods (`tests/unit/estimators/leader/test_leader_floods.py`), a
link that is late without TIMESYNC (`test_held_up.py`), clocks of another rate (`test_other_clocks.py`), who is
followed (`test_latching.py`), what guidance does without a position, after a reset of the origin, on the ground
and while the mode changes (`tests/unit/autopilot/test_guidance.py`), a camera that is late beside a sound one
(`tests/unit/health/test_mounts.py`, as it takes 20 s), noisy detectors and mirrored places
(`tests/unit/estimators/leader`: `test_noise.py`, `test_tracks.py`), hours of silence and ADS-B without a position
(`own_state`, `traffic` there), sinks, the recorder and the wall clock (beside this file).
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import (
    Attitude,
    Datagram,
    EstimatorStatus,
    Heartbeat,
    Lifecycle,
    LocalPosition,
    Message,
    Output,
    TargetPoints,
)
from onboard.pipeline import Pipeline
from tests.support.beginnings import Beginning
from tests.support.images import exposed
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    MS,
    Item,
    Run,
    S,
    Stream,
    assert_sane,
    encode,
    position_error,
    position_nees,
)

T0, BEGINS, ENDS, T1 = 40.0, 42.0, 43.5, 46.0
RIGHT = 3.4  # m; what is valid is right so nearly
INSIDE = (
    4.0  # normalised square of a position's error, whose mean is three: the truth is well inside the ellipsoid
)
QUIET = 2.2  # m; the same of the flight without faults
ITEMS = Stream(t0=T0, t1=T1, seed=21, sparse=True).items()
Fault = Callable[[list[Item], np.random.Generator], Sequence[Item | Datagram]]


class Row(NamedTuple):
    """A fault, and what must be true: whether estimates stay valid or not while it lasts, from `noticed` seconds
    after its beginning; a part of the reason then; what is counted as rejected; and within how many seconds after
    its end all is valid again."""

    name: str
    fault: Fault
    valid: bool = True
    reason: str = ""
    rejected: str = ""
    recovers: float = 0.2
    noticed: float = 0.7


def lasts(item: Item) -> bool:
    """Whether a message is sent while the fault lasts."""
    return BEGINS * S <= item.message.t_ns < ENDS * S


def each(change: Callable[[Any], Message], *kinds: type[Message], share: float = 1.0) -> Fault:
    """A fault that changes that share of the messages of these kinds."""

    def fault(items: list[Item], rng: np.random.Generator) -> list[Item]:
        hit = lambda i: isinstance(i.message, kinds) and lasts(i) and rng.random() < share  # noqa: E731
        return [Item(i.t_recv_ns, change(i.message)) if hit(i) else i for i in items]

    return fault


def without(*kinds: type[Message], share: float = 1.0) -> Fault:
    """A fault that takes that share of the messages of these kinds away."""
    return lambda items, rng: [
        i for i in items if not (isinstance(i.message, kinds) and lasts(i) and rng.random() < share)
    ]


def twice(share: float) -> Fault:
    return lambda items, rng: [i for i in items for _ in range(1 + (lasts(i) and rng.random() < share))]


def late(ms: float, share: float = 1.0) -> Fault:
    """Some messages arrive up to so much later, and so in another order."""

    def fault(items: list[Item], rng: np.random.Generator) -> list[Item]:
        by = [round(ms * MS * rng.random()) * (lasts(i) and rng.random() < share) for i in items]
        delayed = [Item(i.t_recv_ns + ns, i.message) for i, ns in zip(items, by, strict=True)]
        return sorted(delayed, key=lambda i: i.t_recv_ns)

    return fault


def held(ms: float) -> Fault:
    """The link stalls, then sends all at once."""
    until = EPOCH + round(BEGINS * S + ms * MS)
    return lambda items, _: sorted(
        (Item(max(i.t_recv_ns, until), i.message) if lasts(i) and i.t_recv_ns < until else i for i in items),
        key=lambda i: i.t_recv_ns,
    )


def corrupt(share: float) -> Fault:
    """One byte of that share of the datagrams is another one."""

    def fault(items: list[Item], rng: np.random.Generator) -> Iterator[Item | Datagram]:
        for item, datagram in zip(items, encode(items), strict=True):
            if lasts(item) and rng.random() < share:
                data = bytearray(datagram.data)
                data[rng.integers(len(data))] ^= int(rng.integers(1, 256))
                yield replace(datagram, data=bytes(data))
            else:
                yield datagram

    return lambda items, rng: list(fault(items, rng))


def host_clock_set(by_s: float) -> Fault:
    """Arrivals are stamped by a clock that is set, and stays so."""
    return lambda items, _: [
        Item(i.t_recv_ns + (round(by_s * S) if i.message.t_ns >= BEGINS * S else 0), i.message) for i in items
    ]


def fields(kind: type[Message], value: float, *names: str) -> Fault:
    """All numbers of these fields are `value`, in one field after the other."""
    turn = iter(range(1_000_000))

    def change(m: Any) -> Message:
        name = names[next(turn) % len(names)]
        changed: Message = replace(m, **{name: (value,) * len(getattr(m, name))})
        return changed

    return each(change, kind)


def blob(m: TargetPoints) -> TargetPoints:
    return replace(m, center=(0.3, -0.2), left=(0.25, -0.2), right=(0.35, -0.2))


def half_a_wing(m: TargetPoints) -> TargetPoints:
    """In each fourth image, the detector shows half of the wing."""
    if m.t_ns // (80 * MS) % 4:
        return m
    (u, v), ends = m.center, (m.left, m.right)
    left, right = ((0.5 * (u + a), 0.5 * (v + b)) for a, b in ends)
    return replace(m, left=left, right=right)


def accelerometer(*values: float) -> Fault:
    """There is an IMU; while the fault lasts, each of its samples has one of these values in one field."""

    def fault(items: list[Item], _: np.random.Generator) -> list[Item]:
        turn = itertools.cycle(itertools.product(values, ("f_b", "omega_b"), range(3)))
        samples = []
        for t_ns in range(round(T0 * S), round(T1 * S), 40 * MS):
            item = Item(EPOCH + t_ns + MS, CIRCLE.imu(t_ns))
            if lasts(item):
                value, name, axis = next(turn)
                vector = [*getattr(item.message, name)]
                vector[axis] = value
                item = Item(item.t_recv_ns, replace(item.message, **{name: tuple(vector)}))
            samples.append(item)
        return sorted([*items, *samples], key=lambda i: i.t_recv_ns)

    return fault


def rough(per_sample: float) -> Fault:
    """Our position walks at random, so far from sample to sample, m."""

    def fault(items: list[Item], rng: np.random.Generator) -> list[Item]:
        off = np.zeros(3)

        def change(m: LocalPosition) -> LocalPosition:
            nonlocal off
            off = off + per_sample * rng.normal(size=3)
            x, y, z = (np.array(m.r_OF_n) + off).tolist()
            return replace(m, r_OF_n=(x, y, z))

        return [i for i in each(change, LocalPosition)(items, rng) if isinstance(i, Item)]

    return fault


def slower(rate: float) -> Fault:
    """The autopilot's clock runs at that rate of ours while the fault lasts."""
    begins, lasted = EPOCH + round(BEGINS * S), round((ENDS - BEGINS) * S)

    def later(t_recv_ns: int) -> int:
        return round(min(max(t_recv_ns - begins, 0), lasted) * (1.0 / rate - 1.0))

    return lambda items, _: [Item(i.t_recv_ns + later(i.t_recv_ns), i.message) for i in items]


def no_velocity(items: list[Item], _: np.random.Generator) -> list[Item]:
    """The autopilot says that its filter has lost the horizontal velocity, then that it has it again."""
    reports = []
    for tenth in range(round(T0 * 10), round(T1 * 10)):
        t_ns, known = tenth * 100 * MS, not BEGINS <= tenth / 10 < ENDS
        status = EstimatorStatus(
            t_ns=t_ns, t_recv_ns=EPOCH + t_ns, horizontal_velocity=known, horizontal_position=known
        )
        reports.append(Item(EPOCH + t_ns + MS, status))
    return sorted([*items, *reports], key=lambda i: i.t_recv_ns)


def empty_status(items: list[Item], _: np.random.Generator) -> list[Item]:
    """The autopilot's reports on its filter hold nothing while the fault lasts."""
    reports = []
    for tenth in range(round(BEGINS * 10), round(ENDS * 10)):
        t_ns = tenth * 100 * MS
        status = EstimatorStatus(
            t_ns=t_ns, t_recv_ns=EPOCH + t_ns, horizontal_velocity=None, horizontal_position=None
        )
        reports.append(Item(EPOCH + t_ns + MS, status))
    return sorted([*items, *reports], key=lambda i: i.t_recv_ns)


def empty_and_zero(items: list[Item], rng: np.random.Generator) -> list[Item]:
    """The same, and velocities are zero."""
    still = each(lambda m: replace(m, v_F_n=(0.0, 0.0, 0.0)), LocalPosition)
    return empty_status([i for i in still(items, rng) if isinstance(i, Item)], rng)


def by_another_way(s: float) -> Fault:
    """A second link delivers the autopilot's messages again, so late."""
    return lambda items, _: sorted(
        (
            *items,
            *(
                Item(i.t_recv_ns + round(s * S) + 1, i.message)
                for i in items
                if lasts(i) and not isinstance(i.message, TargetPoints)
            ),
        ),
        key=lambda i: i.t_recv_ns,
    )


def another(apart_s: float, **ids: int) -> Fault:
    """The same messages again, of another sender or boot clock."""
    return lambda items, _: [
        each
        for i in items
        for each in (
            (i, Item(i.t_recv_ns, replace(i.message, t_ns=i.message.t_ns + round(apart_s * S), **ids)))
            if lasts(i) and not isinstance(i.message, TargetPoints)
            else (i,)
        )
    ]


HUNG = CIRCLE.image(round(BEGINS * S), np.random.default_rng(5))
Q, R = CIRCLE.attitude(round(BEGINS * S)).q_nb, CIRCLE.position(round(BEGINS * S)).r_OF_n
SHARES = (0.01, 0.1, 0.5)
VALUES = (math.nan, -math.inf, 3.4e38)
RACE = (60.0, 0.0, 0.0)  # m/s
LEAPT = 1.7  # s: it leaps back, which is in doubt for a second, too
AGREE = 1.3  # s: a second in doubt, then three images must agree
SILENT = "our own motion is not known"
IMAGE = ("center", "left", "right")

ROWS = (
    *(Row(f"drop {s:.0%}", without(Attitude, LocalPosition, TargetPoints, share=s)) for s in SHARES),
    *(Row(f"duplicate {s:.0%}", twice(s)) for s in SHARES),
    *(Row(f"reorder {s:.0%}", late(60.0, s)) for s in SHARES),
    *(Row(f"corrupt {s:.0%}", corrupt(s)) for s in SHARES),
    *(Row(f"delay up to {ms} ms", late(ms), recovers=0.4) for ms in (100, 300)),
    Row("delay up to 2 s", late(2000), rejected="odd_stamp", recovers=2.0),
    *(Row(f"stall of {ms} ms", held(ms), recovers=0.4) for ms in (200, 900, 1500)),
    *(Row(f"host clock set by {s} s", host_clock_set(s)) for s in (-3600.0, -0.3, 0.3, 3600.0)),
    *(
        Row(f"attitude of {v}", fields(Attitude, v, "q_nb", "omega_b"), rejected="attitude_unusable")
        for v in VALUES
    ),
    *(
        Row(
            f"position of {v}",
            fields(LocalPosition, v, "r_OF_n", "v_F_n"),
            False,
            SILENT,
            "position_unusable",
            noticed=1.1,
        )
        for v in VALUES
    ),
    *(Row(f"image of {v}", fields(TargetPoints, v, *IMAGE)) for v in VALUES),
    *(Row(f"accelerometer of {v}", accelerometer(v), rejected="imu_unusable") for v in VALUES),
    Row("no attitude", without(Attitude)),
    Row("no position", without(LocalPosition), False, SILENT, noticed=1.1),
    Row("no image", without(TargetPoints)),
    Row("GPS lost", no_velocity, False, SILENT, "filter_has_no_velocity"),
    Row("an empty report on the filter", empty_status),
    Row("an empty report and zeros", empty_and_zero, False, SILENT, "filter_has_no_velocity", noticed=1.1),
    *(Row(f"the autopilot's clock at {rate} of ours", slower(rate)) for rate in (0.9, 0.97)),
    Row(
        "another system id",
        each(lambda m: replace(m, system=7), Attitude, LocalPosition, Heartbeat),
        rejected="other_system",  # until it is followed under its other id, and under its first one again
        recovers=0.6,
        noticed=1.1,
    ),
    Row("a position that walks by 1.3 cm a sample", rough(0.013)),
    Row(
        "a vertical velocity of the wrong sign",
        each(lambda m: replace(m, v_F_n=(*m.v_F_n[:2], -m.v_F_n[2])), LocalPosition),
        *(False, "doubt"),
        recovers=LEAPT,
    ),
    Row(
        "a velocity off by 0.3 m/s, as in strong vibration",
        each(lambda m: replace(m, v_F_n=(m.v_F_n[0] + 0.3, *m.v_F_n[1:])), LocalPosition),
    ),
    Row(
        "images stamped 0.1 s early",
        each(lambda m: replace(m, t_ns=m.t_ns - 100 * MS), TargetPoints),
    ),
    Row(
        "images stamped 0.9 s after their arrival",
        each(lambda m: replace(m, t_ns=m.t_ns + 900 * MS), TargetPoints),
        rejected="later_than_arrival",
    ),
    *(Row(f"received again {s} s late", by_another_way(s)) for s in (0.5, 1.2, 2.0)),
    Row("GPS jumps", each(lambda m: replace(m, r_OF_n=(m.r_OF_n[0] + 80.0, *m.r_OF_n[1:])), LocalPosition)),
    Row("velocity jumps", each(lambda m: replace(m, v_F_n=RACE), LocalPosition), False, "doubt", recovers=LEAPT),
    Row("attitude hangs", each(lambda m: replace(m, q_nb=Q), Attitude), False, "attitude hangs", recovers=AGREE),
    Row(
        "position hangs",
        each(lambda m: replace(m, r_OF_n=R), LocalPosition),
        False,
        "position hangs",
        recovers=AGREE,
    ),
    Row(
        "camera hangs",
        each(lambda m: replace(m, center=HUNG.center, left=HUNG.left, right=HUNG.right), TargetPoints),
        False,
        "camera hangs",
        recovers=0.5,
    ),
    Row("wingtips swapped", each(lambda m: replace(m, left=m.right, right=m.left), TargetPoints, share=0.5)),
    Row("the detector shows half of the wing in each fourth image", each(half_a_wing, TargetPoints)),
    *(Row(f"wrong blob {s:.0%}", each(blob, TargetPoints, share=s)) for s in SHARES),
    Row("two autopilots", another(1000.0, system=2), rejected="other_system"),
    Row("two autopilots of one id", another(0.31), rejected="odd_stamp"),
    Row("a gimbal's attitude", another(0.001, component=154), rejected="other_component"),
)


def taken(pipeline: Pipeline, sent: Item | Datagram) -> list[Output]:
    """What a pipeline makes of a message, or of its bytes."""
    if isinstance(sent, Datagram):
        return pipeline.feed(sent)
    return pipeline.advance(exposed([replace(sent.message, t_recv_ns=sent.t_recv_ns)]))


SHARED: Beginning[Item | Datagram] = Beginning(ITEMS, taken)  # two seconds of most rows


def flown(row: Row, seed: int = 61) -> Run:
    """The flight with the row's fault, through a pipeline with its defaults."""
    run = SHARED.run(row.fault(ITEMS, np.random.default_rng(seed)))
    assert not run.pipeline.errors
    assert_sane(run.estimates)
    return run


def assert_row(row: Row, run: Run) -> None:
    faulty = [e for e in run.estimates if BEGINS * S <= e.t_ns < ENDS * S]
    noticed = [e for e in run.estimates if (BEGINS + row.noticed) * S <= e.t_ns < ENDS * S]
    after = [e for e in run.estimates if e.t_ns >= (ENDS + row.recovers) * S]
    assert all(e.valid for e in noticed) if row.valid else not any(e.valid for e in noticed)
    assert all(row.reason in e.reason for e in noticed)
    assert row.rejected in {"", *run.rejected}
    assert {(e.valid, e.state) for e in after} == {(True, Lifecycle.TRACKING)}
    valid = [e for e in (*faulty, *after) if e.valid]
    assert all(position_error(e) < RIGHT or "not resolved" in e.reason for e in valid)  # a new track says so
    assert all(position_nees(e) < INSIDE for e in valid)


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_a_row_with_seed_61(row: Row) -> None:
    assert_row(row, flown(row))


def test_the_flight_without_faults() -> None:
    run = flown(Row("none", lambda items, _: items))
    assert all(e.valid for e in run.estimates if e.t_ns > (T0 + 0.5) * S)
    assert max(position_error(e) for e in run.estimates if e.t_ns > BEGINS * S) < QUIET
    assert run.rejected == {}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [62, 63, 64])
@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_the_grid_with_seed(row: Row, seed: int) -> None:
    assert_row(row, flown(row, seed))
