"""Clocks as others have them: an autopilot's that runs at another rate or jumps, a link that repeats the past, and
cameras that stamp later than they send. Right: as without the fault, or not valid, with the reason."""

from collections.abc import Callable, Sequence
from itertools import product

import pytest
from msgspec.structs import replace

from onboard.messages import Clock, Estimate, Message, TargetPoints, TimeSync, Verdict, tagged
from onboard.pipeline import Pipeline
from tests.support.cases import slow_but
from tests.support.images import exposed
from tests.support.streams import EPOCH, MS, Item, Run, S, Stream, encode, feed, make_config, position_error

T0, T1 = 40.0, 54.0
HALF = 46 * S
ITEMS = Stream(t0=T0, t1=T1, seed=21, sparse=True).items()
RIGHT = 2.2  # m


def flown(items: Sequence[Item]) -> Run:
    pipeline, outputs = Pipeline(make_config()), []
    for t_recv_ns, message in sorted(items, key=lambda i: i.t_recv_ns):
        outputs.extend(pipeline.advance(exposed([replace(message, t_recv_ns=t_recv_ns)])))
    assert not pipeline.errors
    return Run(pipeline, outputs)


def wrong(estimates: Sequence[Estimate]) -> list[float]:
    return [round(position_error(e), 2) for e in estimates if e.valid and position_error(e) > RIGHT]


def host_image(message: Message) -> Message:
    """An image stamped by this computer's clock."""
    return replace(message, t_ns=EPOCH + message.t_ns, clock=Clock.HOST)


# ---------------------------------------------------------------------------- another rate


def at_rate(rate: Callable[[float], float], *, timesync: bool) -> list[Item]:
    """The flight in a simulator that runs at `rate(s)` of real time from its boot second s on."""
    host, hosts = EPOCH + round(T0 * S), {}
    for ms in range(round(T0 * 1000), round(T1 * 1000) + 1000):
        hosts[ms] = host
        host += round(MS / rate(ms / 1000))

    def then(t_ns: int) -> int:
        return hosts[t_ns // MS] + t_ns % MS

    out = []
    for t_recv_ns, m in ITEMS:
        is_image = isinstance(m, TargetPoints)
        message = replace(m, t_ns=then(m.t_ns), clock=Clock.HOST) if is_image else m
        out.append(Item(then(t_recv_ns - EPOCH), message))
    for ms in range(round(T0 * 1000) + 100, round(T1 * 1000), 200) if timesync else ():
        recv = then(ms * MS) + MS
        sync = TimeSync(
            t_ns=recv, t_recv_ns=recv, clock=Clock.NONE, tc1_ns=ms * MS, ts1_ns=tagged(then(ms * MS) - MS)
        )
        out.append(Item(recv, sync))
    return out


@pytest.mark.parametrize(
    ("rate", "timesync"),
    slow_but(
        [(0.9, True), (1.1, False)],
        product([0.5, 0.9, 0.97, 0.99, 1.0, 1.02, 1.1, 2.0], [True, False]),
    ),
)
def test_an_autopilot_s_clock_at_another_rate_seed_21(rate: float, timesync: bool) -> None:
    run = flown(at_rate(lambda _: rate, timesync=timesync))
    settled = [e for e in run.estimates if e.t_ns > 47 * S]
    assert wrong(settled) == []
    assert all(e.valid for e in settled)
    assert run.pipeline.clocks.rate == pytest.approx(rate, abs=2e-3)
    assert run.pipeline.health(0).clock_rate == pytest.approx(rate, abs=2e-3)
    assert run.pipeline.clocks.reboots == run.pipeline.clocks.jumps == 0


def test_a_rate_that_changes_in_flight_is_followed_seed_21() -> None:
    run = flown(at_rate(lambda s: 0.95 if s < 47 else 0.8, timesync=True))
    assert wrong([e for e in run.estimates if e.t_ns > 44 * S]) == []
    assert run.estimates[-1].valid


# ---------------------------------------------------------------------------- a second link


def repeated(late_s: float, burst_s: float, lost: float = 0.0) -> list[Item]:
    """A second link delivers the autopilot's messages again, late and many at once; the first one loses some."""
    own = [i for i in ITEMS if not isinstance(i.message, TargetPoints)]
    images = [i for i in ITEMS if isinstance(i.message, TargetPoints)]
    first = [i for n, i in enumerate(own) if 7 * n % 10 >= 10 * lost or n == 0]
    again = []
    for n, (t_recv_ns, message) in enumerate(own):
        t_ns = t_recv_ns + round(late_s * S)
        if burst_s:
            t_ns = -(-t_ns // round(burst_s * S)) * round(burst_s * S)
        again.append(Item(t_ns + n, message))
    return [*first, *images, *(i for i in again if i.t_recv_ns < EPOCH + T1 * S)]


DELAYS = [(0.05, 0.0), (0.5, 0.3), (1.2, 0.3), (1.5, 1.0), (2.0, 0.0), (2.0, 1.0), (4.0, 0.5), (8.0, 2.0)]


@pytest.mark.parametrize(
    ("delay", "lost"), slow_but([((0.5, 0.3), 0.0), ((2.0, 1.0), 0.3)], product(DELAYS, [0.0, 0.3]))
)
def test_a_link_that_repeats_the_past_is_no_reboot_seed_21(delay: tuple[float, float], lost: float) -> None:
    late_s, burst_s = delay
    run = flown(repeated(late_s, burst_s, lost))
    clocks = run.pipeline.clocks
    assert (clocks.reboots, clocks.jumps) == (0, 0)
    assert "clock_corrections" not in run.rejected
    assert run.pipeline.health(0).clock_offset_ns == pytest.approx(EPOCH, abs=2 * MS)
    settled = [e for e in run.estimates if e.t_ns > 42 * S]
    assert all(e.valid for e in settled)
    assert wrong(settled) == []


def test_a_reboot_beside_a_link_that_repeats_the_past_is_one_reboot_seed_21() -> None:
    again = Stream(t0=6.0, t1=10.0, seed=22, sparse=True).items()
    gone = [i for i in repeated(2.0, 1.0) if i.t_recv_ns < EPOCH + HALF]
    run = flown([*gone, *(Item(i.t_recv_ns + 43 * S, i.message) for i in again)])
    assert run.pipeline.clocks.reboots == 1
    assert run.estimates[-1].valid
    assert run.estimates[-1].t_ns == 9_960 * MS


# ---------------------------------------------------------------------------- a clock that jumps


def jumped(by_s: float, change: Callable[[Message, int], Message]) -> list[Item]:
    """From the middle on, the autopilot's clock is ahead by so much; what images become."""
    by, out = round(by_s * S), []
    for t_recv_ns, message in ITEMS:
        if isinstance(message, TargetPoints):
            out.append(Item(t_recv_ns, change(message, by if message.t_ns >= HALF else 0)))
        else:
            moved = replace(message, t_ns=message.t_ns + (by if message.t_ns >= HALF else 0))
            out.append(Item(t_recv_ns, moved))
    return out


CAMERAS = {
    "of this computer": lambda m, _by: host_image(m),
    "that follows": lambda m, by: replace(m, t_ns=m.t_ns + by),
    "that does not follow": lambda m, _by: m,
}


@pytest.mark.parametrize(
    ("by_s", "camera"),
    slow_but(
        [(-0.5, "that does not follow"), (2.0, "of this computer")],
        product([-30.0, -2.0, -0.5, 0.5, 2.0, 30.0], CAMERAS),
    ),
)
def test_estimates_are_back_soon_after_the_autopilot_s_clock_has_jumped_seed_21(by_s: float, camera: str) -> None:
    run = flown(jumped(by_s, CAMERAS[camera]))
    after_ns = HALF + round((by_s + 3.0) * S)
    last = [e for e in run.estimates[-60:] if e.t_ns > after_ns]
    assert len(last) > 30
    assert all(e.valid for e in last)
    by = round(by_s * S)
    off = [position_error(replace(e, t_ns=e.t_ns - by)) for e in last]
    assert max(off) < RIGHT
    clocks = run.pipeline.clocks
    assert clocks.jumps == 1 or by_s != -0.5
    assert run.rejected.get("autopilot_clock_jumps", 0) == clocks.jumps


# ---------------------------------------------------------------------------- stamps later than their arrival


@pytest.mark.parametrize("later_ms", slow_but([20], [20, 100, 900, 37_000, 7_200_000]))
def test_images_stamped_later_than_they_arrive_are_refused_and_named_seed_21(later_ms: int) -> None:
    late = [Item(t, m) if not isinstance(m, TargetPoints) else Item(t, host_image(m)) for t, m in ITEMS]
    shown = [Item(t, replace(m, t_ns=t + later_ms * MS) if isinstance(m, TargetPoints) else m) for t, m in late]
    run = flown(shown)
    assert not any(e.valid for e in run.estimates)
    images = sum(isinstance(m, TargetPoints) for _, m in ITEMS)
    assert run.rejected == {"later_than_arrival": images}
    (refusal,) = run.pipeline.health(0).refusals
    assert (refusal.source, refusal.count) == (f"camera {ITEMS_CAMERA}", images)
    assert f"{later_ms / 1000:.3f} s later than the message arrived" in refusal.reason
    assert "clock `host`" in refusal.reason


def stamped_later(later_ms: float, *, timesync: bool) -> list[Item]:
    """Images with stamps of the boot clock, so much later than their arrival."""
    items = [
        Item(t, replace(m, t_ns=t - EPOCH + round(later_ms * MS)) if isinstance(m, TargetPoints) else m)
        for t, m in ITEMS
    ]
    sync = [i for i in at_rate(lambda _: 1.0, timesync=True) if isinstance(i.message, TimeSync)]
    return sorted([*items, *(sync if timesync else [])], key=lambda i: i.t_recv_ns)


@pytest.mark.parametrize(("later_ms", "timesync"), [(3, True), (60, False)])
def test_images_stamped_by_the_boot_clock_a_little_later_than_they_arrive_are_awaited_seed_21(
    later_ms: float, timesync: bool
) -> None:
    """Without replies, the autopilot's fastest messages may be as late."""
    run = flown(stamped_later(later_ms, timesync=timesync))
    assert run.verdicts().get(Verdict.FUSED, 0) > 100
    assert "later_than_arrival" not in run.rejected


@pytest.mark.parametrize(
    ("later_ms", "timesync"),
    slow_but([(60, True), (900, False)], [(60, True), (900, True), (900, False), (400, False)]),
)
def test_images_stamped_by_the_boot_clock_later_than_it_can_be_are_refused_seed_21(
    later_ms: float, timesync: bool
) -> None:
    run = flown(stamped_later(later_ms, timesync=timesync))
    images = sum(isinstance(m, TargetPoints) for _, m in ITEMS)
    assert run.rejected["later_than_arrival"] > images - 60  # at first too little is known of the clocks
    assert not any(e.valid for e in run.estimates[200:])
    assert any("clock `boot`" in refusal.reason for refusal in run.pipeline.health(0).refusals)


def test_a_log_that_another_program_has_put_together_says_nothing_of_stamps_after_arrivals_seed_21() -> None:
    """In recorded ArduPilot flights the images lie half a second before their stamps, to the nanosecond."""
    of_log = [replace(d, channel="tlog") for d in encode(stamped_later(490, timesync=True))]
    run = feed(of_log)
    assert run.verdicts().get(Verdict.FUSED, 0) > 100
    assert "later_than_arrival" not in run.rejected


ITEMS_CAMERA = next(m.camera for _, m in ITEMS if isinstance(m, TargetPoints))
