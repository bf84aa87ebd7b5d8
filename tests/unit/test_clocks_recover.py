"""Every estimate of a clock or a latency is right within five seconds of good input, whatever came before."""

import math
from collections.abc import Iterable
from itertools import permutations
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.clocks import Clocks
from onboard.messages import Clock, GimbalAttitude, LocalPosition, Message, MountAttitude, SystemTime
from tests.support.cases import slow_but
from tests.support.clock_messages import EPOCH, MS, S, image, reply, run, sample

GOOD_NS, RECOVERY_NS = 12 * S, 5 * S
RIGHT_NS = 20 * MS


class Sent(NamedTuple):
    """How a fault changes what is sent, at times since it began: by how much stamps are wrong, ns."""

    seconds: float
    own: int = 0  # the autopilot's stamps
    own_late: int = 0
    replies: int = 0
    images: int = 0
    images_late: int = 0
    gimbal: int = 0
    is_once: bool = False  # the first of each kind only


FAULTS = {
    "one stamp early": Sent(0.5, own=200 * MS, is_once=True),
    "stamps early": Sent(1.0, own=200 * MS),
    "stamps far ahead": Sent(1.0, own=900 * MS),
    "messages late": Sent(10.0, own_late=3 * S),
    "messages a little late": Sent(10.0, own_late=400 * MS),
    "one wrong reply": Sent(0.5, replies=70 * MS, is_once=True),
    "absurd replies": Sent(4.0, replies=2**62),
    "replies of another clock": Sent(4.0, replies=-4 * S),
    "images late": Sent(3.5, images_late=3 * S),
    "images of another clock": Sent(3.5, images=-4 * S),
    "a gimbal's stamp early": Sent(0.5, gimbal=900 * MS, is_once=True),
    "a gimbal of another clock": Sent(3.5, gimbal=-4 * S),
    **{f"set by {s} s": Sent(0.0, own=round(s * S)) for s in (-4.0, -1.5, 3.0, 60.0)},
}


def own(t_ns: int, moves: int) -> LocalPosition:
    return replace(sample(t_ns, 0), r_OF_n=(moves / S, 0.0, 0.0))  # a clock that is set repeats no message


def gimbal(t_ns: int, t_recv_ns: int) -> GimbalAttitude:
    mount = MountAttitude(q=(1.0, 0.0, 0.0, 0.0), frame="earth")
    return GimbalAttitude(t_ns=t_ns, t_recv_ns=t_recv_ns, clock=Clock.BOOT, component=154, device=154, mount=mount)


def flight(faults: Iterable[str], *, replies: bool) -> tuple[list[tuple[int, Message]], int]:
    """Messages in order of arrival, and by how much the autopilot's clock was set."""
    sent, ms, ahead = list[tuple[int, Message]](), 1000, 0

    def phase(fault: Sent, seconds: float) -> None:
        nonlocal ms
        for k in range(round(50 * seconds)):
            f = fault if not (fault.is_once and k > 9) else Sent(0.0)
            t, ms = ms * MS + ahead, ms + 20
            at = EPOCH + t - ahead
            sent.append((at + 2 * MS + f.own_late, own(t + f.own * (not f.is_once or k == 0), at)))
            if replies and k % 10 == 0:
                answer = reply(t, MS, MS, host_ns=EPOCH - ahead)
                sent.append((at + MS, replace(answer, tc1_ns=min(t + f.replies, 2**63 - 1))))
            if k % 2 == 0:
                sent.append((at + 60 * MS + f.images_late, image(t + f.images, 0)))
                sent.append((at + 5 * MS, gimbal(t + f.gimbal * (not f.is_once or k == 0), 0)))

    phase(Sent(0.0), GOOD_NS / S)
    for name in faults:
        fault = FAULTS[name]
        phase(fault, fault.seconds)
        ahead += fault.own if not fault.seconds else 0
        phase(Sent(0.0), RECOVERY_NS / S)
    return sorted(sent, key=lambda one: one[0]), ahead


def off_ns(faults: Iterable[str], *, replies: bool) -> dict[str, int]:
    """By how much the last conversions are wrong: of the boot clock, an image of each clock, and a gimbal."""
    clocks = Clocks()
    sent, ahead = flight(faults, replies=replies)
    for at, message in sent:
        m = message if at == message.t_recv_ns else replace(message, t_recv_ns=at)
        if type(m).__name__ == "TimeSync":
            clocks.receive_reply(m)
        else:
            clocks.align(m)
    at = sent[-1][0] + MS
    then = at - EPOCH - 60 * MS + ahead  # an exposure, on the boot clock
    messages = {"boot": image(then, at), "host": image(at - 60 * MS, at, Clock.HOST), "gimbal": gimbal(then, at)}
    messages["gimbal"] = gimbal(then + 55 * MS, at)
    found = {"offset": abs((clocks.offset_ns or 0) - EPOCH + ahead)}
    for name, message in messages.items():
        aligned = clocks.align(message).message
        wanted = then + 55 * MS if name == "gimbal" else then
        found[name] = abs(aligned.t_ns - wanted) if aligned is not None else S
    return {name: ns for name, ns in found.items() if ns > RIGHT_NS}


PAIRS = [*permutations(FAULTS, 2)]
CASES = {
    "each": [(name,) for name in FAULTS],
    "each after a set clock": [pair for pair in PAIRS if pair[0] == "set by -4.0 s"],
    "each after each": PAIRS,
}


@pytest.mark.parametrize("which", slow_but(["each", "each after a set clock"], CASES))
def test_every_clock_recovers_within_five_seconds_of_good_input(which: str) -> None:
    """After each fault, and after each two in a row: the memory of one must not be fed by the next."""
    wrong = {}
    for k, names in enumerate(CASES[which]):
        for replies in {k % 2 == 0, k % 2 == len(names) - 1}:
            if off := off_ns(names, replies=replies):
                wrong[*names, replies] = off
    assert wrong == {}


def test_a_camera_that_follows_the_clock_is_late_when_it_is_late() -> None:
    """By as much as the clock was set: its images are not of the clock before."""
    clocks = Clocks()
    run(clocks, 5, 5)
    run(clocks, 13, 5, host_ns=EPOCH + 2 * MS - 3 * S)
    for late_ns in (60 * MS, 3 * S + 60 * MS):
        aligned = clocks.align(image(18 * S, EPOCH + 15 * S + late_ns)).message
        assert aligned is not None
        assert aligned.t_ns == 18 * S


def test_replies_of_another_clock_are_refused_and_named() -> None:
    """2^63 - 1 in them made images 292 years old, and a camera was named."""
    clocks = Clocks()
    run(clocks, 5, 5)
    for k, tc1_ns in enumerate((2**63 - 1, 1, 4 * S, -(2**63))):
        why = clocks.receive_reply(replace(reply(10 * S, MS, MS), tc1_ns=tc1_ns))
        assert why is not None
        assert why.words.startswith("TIMESYNC: its clock is not that of the autopilot's stamps")
        assert clocks.rejected["timesync_contradicted"] == k + 1
    assert (clocks.offset_ns, clocks.source) == (EPOCH + 2 * MS, "arrival")
    assert clocks.receive_reply(reply(10 * S, MS, MS)) is None
    assert clocks.source == "timesync"


def slow_radio(
    *, has_unix: bool, rate: float = 1.0, wander_s: float = 0.6, jitter: float = 0.5
) -> tuple[list[float], float]:
    """The rate after each second of a log over a slow radio, and the share of these with an uncertain rate.

    Messages come ten times a second, late by up to 2.5 times `wander_s`; the autopilot's clock, and its Unix time,
    run at `rate`. Images are stamped by the other clock."""
    clocks, found, rng, doubts = Clocks(), list[float](), np.random.default_rng(1), 0
    for k in range(1200):
        t_s, host_s = 0.1 * k * rate, 0.1 * k
        late_s = wander_s * (1.0 + math.sin(host_s / 3.7) * math.cos(host_s / 9.7) + rng.uniform(0.0, jitter))
        at = EPOCH + round((host_s + late_s) * S)
        clocks.align(replace(own(round(t_s * S), k), t_recv_ns=at))
        if has_unix and k % 10 == 0:
            stamp = {"t_ns": round(t_s * S) + 1, "t_recv_ns": at, "clock": Clock.BOOT}
            clocks.align(SystemTime(**stamp, unix_ns=EPOCH + round(t_s * S)))
        if k % 10 == 9:
            clocks.align(image(at, at, Clock.HOST))
            found.append(clocks.rate)
            doubts += clocks.doubt is not None
    return found, doubts / len(found)


def test_a_slow_radio_does_not_change_the_clock_s_rate_seed_1() -> None:
    """Arrivals alone gave rates of 0.41 to 1.52. SYSTEM_TIME has both clocks; of a simulator it shows that its own
    time passes otherwise than this computer's."""
    for jitter in (0.0, 0.5):
        rates, uncertain = slow_radio(has_unix=True, jitter=jitter)
        assert max(abs(rate - 1.0) for rate in rates) < 0.01
        assert uncertain < 0.1
    rates, uncertain = slow_radio(has_unix=False)
    assert max(abs(rate - 1.0) for rate in rates) < 0.01
    assert uncertain > 0.9
    rates, uncertain = slow_radio(has_unix=True, rate=0.8, wander_s=0.0)
    assert rates[20:] == pytest.approx([0.8] * 100, abs=0.01)
