"""Where each check of our own motion begins to doubt, to a percent: a limit of half or twice the size is seen."""

from collections.abc import Callable
from typing import Any

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import Attitude, GlobalPosition, LocalPosition, Message, Quaternion
from onboard.ownship.continuity import goes_on
from onboard.ownship.contradictions import Contradictions, Strides
from onboard.ownship.scatter import Ceiling
from onboard.ownship.source import Comparison, Source, Wanted
from tests.support.golden import assert_golden

MS, S = 1_000_000, 1_000_000_000
ZERO = (0.0, 0.0, 0.0)
LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)


def threshold(doubts: Callable[[float], bool], most: float) -> float:
    """The least value that is doubted, of those up to `most`; 0 or `most` itself is never the answer."""
    assert not doubts(0.0)
    assert doubts(most)
    low, high = 0.0, most
    while high - low > 1e-4 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if doubts(middle) else (middle, high)
    return high


def yawed(angle: float) -> Quaternion:
    return tuple(quaternion_from_euler(0.0, 0.0, angle).tolist())


def turning(off: float, stated: float = 0.0, seconds: float = 2.0, since: float = 0.0) -> Contradictions:
    """A vehicle that turns faster than its rates say, by `off` from a time on."""
    checks = Contradictions()
    for k in range(round(50 * seconds)):
        t = k / 50
        angle = stated * t + off * max(t - since, 0.0)
        checks.add_attitude(S + k * 20 * MS, yawed(angle), (0.0, 0.0, stated))
    return checks


def moving(off: tuple[float, float], v: float = 0.0, seconds: float = 2.0) -> Contradictions:
    """A vehicle whose position goes north and down faster than its velocity says."""
    checks = Contradictions()
    for k in range(round(50 * seconds)):
        t = k / 50
        checks.add_nav(S + k * 20 * MS, ((v + off[0]) * t, 0.0, off[1] * t), (v, 0.0, 0.0))
    return checks


def accelerating(a: float, felt: float, *, is_sideways: bool = False) -> Contradictions:
    """A vehicle whose velocity and accelerometer disagree."""
    checks = Contradictions()
    for k in range(300):
        t = k / 100
        checks.add_imu(S + k * 10 * MS, (0.0, felt, -9.8) if is_sideways else (felt, 0.0, -9.8), LEVEL)
        if k % 2 == 0:
            checks.add_nav(S + k * 10 * MS, (0.5 * a * t * t, 0.0, 0.0), (a * t, 0.0, 0.0))
    return checks


def leapt(step: float, wait_ms: int, *, has_imu: bool) -> bool:
    """Whether a velocity after a rest cannot be."""
    checks = Contradictions()
    for k in range(100):
        if has_imu:
            checks.add_imu(S + k * 10 * MS, (0.0, 0.0, -9.8), LEVEL)
        checks.add_nav(S + k * 10 * MS, ZERO, ZERO)
    return checks.leaps(S + 990 * MS + wait_ms * MS, (step, 0.0, 0.0))


def is_doubted(checks: Contradictions) -> bool:
    return bool(checks.reason(S))


def is_over(checks: Contradictions, t: float) -> bool:
    return not checks.reason(S + round(t * S))


def frozen(rate: float, seconds: float, *, of_attitude: bool) -> bool:
    checks = Contradictions()
    for k in range(round(50 * seconds)):
        if of_attitude:
            checks.add_attitude(S + k * 20 * MS, LEVEL, (0.0, 0.0, rate))
        else:
            checks.add_nav(S + k * 20 * MS, ZERO, (rate, 0.0, 0.0))
    return is_doubted(checks)


def others(off: float, limit: float, count: int = 4, period: float = 0.1) -> bool:
    checks = Contradictions()
    for k in range(count):
        checks.add_other(S + round(k * period * S), off=off, limit=limit)
    return is_doubted(checks)


def noisy(signs: tuple[int, ...], size: float, ceiling: Ceiling) -> bool:
    """Whether steps of these signs, again and again, of which the rates say nothing, are more than noise."""
    strides, found = Strides(1e9, 0.0, ceiling), False
    for k in range(200):
        e = (size * signs[k % len(signs)], 0.0, 0.0)
        found |= strides.contradict(k * 20 * MS, (k + 1) * 20 * MS, e, 0.0)
    return found


def attitude(angle: float, t: float, lag: float = 0.0) -> Attitude:
    t_ns = S + round(t * S)
    return Attitude(t_ns=t_ns - round(lag * S), t_recv_ns=t_ns, q_nb=yawed(angle), omega_b=ZERO)


def local(r: float, v: float, t: float) -> LocalPosition:
    t_ns = S + round(t * S)
    return LocalPosition(t_ns=t_ns, t_recv_ns=t_ns, r_OF_n=(r, 0.0, 0.0), v_F_n=(v, 0.0, 0.0))


def world(north: float, v: float, t: float) -> GlobalPosition:
    t_ns = S + round(t * S)
    fields: dict[str, Any] = {"lon_deg": 8.0, "alt_msl": 300.0, "height": 0.0, "heading_rad": None}
    lat = 47.0 + north / 111_177.0
    return GlobalPosition(t_ns=t_ns, t_recv_ns=t_ns, lat_deg=lat, v_F_n=(v, 0.0, 0.0), **fields)


def chosen(sigma: float, apart: float = 0.0, wanted: Wanted = "auto", was: float | None = None) -> bool:
    """Whether an estimate of this standard deviation is used beside an autopilot's noise of 1."""
    source = Source("attitude", wanted)
    for k in range(40):
        known = sigma if was is None or k >= 20 else was
        source.correction(S + k * 100 * MS, Comparison((apart, 0.0, 0.0), (known,) * 3, (1.0,) * 3, 2.0))
    return source.is_own


def is_other(before: Callable[..., Message], after: tuple[float, ...], *begin: float) -> bool:
    return not goes_on(before(*begin), before(*after))


LIMITS: dict[str, tuple[Callable[[float], bool], float]] = {
    "attitude at rest, rad/s": (lambda x: is_doubted(turning(x)), 1.0),
    "attitude at 1 rad/s, rad/s": (lambda x: is_doubted(turning(x, 1.0)), 2.0),
    "attitude, s": (lambda x: is_doubted(turning(0.5, seconds=1.0 + x, since=1.0)), 2.0),
    "frozen attitude, rad/s": (lambda x: frozen(x, 0.6, of_attitude=True), 1.0),
    "frozen attitude, s": (lambda x: frozen(0.1, x, of_attitude=True), 2.0),
    "position at rest, m/s": (lambda x: is_doubted(moving((x, 0.0))), 5.0),
    "position at 10 m/s, m/s": (lambda x: is_doubted(moving((x, 0.0), 10.0)), 9.0),
    "height at 10 m/s, m/s": (lambda x: is_doubted(moving((0.0, x), 10.0)), 5.0),
    "frozen position, m/s": (lambda x: frozen(x, 0.6, of_attitude=False), 0.4),
    "accelerometer, m/s^2": (lambda x: is_doubted(accelerating(2.0, 2.0 - x)), 2.0),
    "doubt of attitude, s": (lambda x: is_over(turning(1.0), 1.98 + x), 60.0),
    "doubt of a yaw, s": (lambda x: is_over(accelerating(3.0, 3.0, is_sideways=True), 2.98 + x), 60.0),
    "doubt of a velocity, s": (lambda x: is_over(accelerating(3.0, 0.0), 2.98 + x), 60.0),
    "two sources, of their limit": (lambda x: others(x, 0.7), 2.0),
    "two sources, number": (lambda x: others(1.0, 0.7, count=round(x)), 10.0),
    "two sources, hidden period, s": (lambda x: not others(1.0, 0.7, period=0.1 + x), 2.0),
    "white noise": (lambda x: noisy((1, -1), x, Ceiling(white=3.0)), 10.0),
    "random walk": (lambda x: noisy((1, 1, -1, -1), x, Ceiling(walk=1.0)), 10.0),
    "leap after 10 ms, m/s": (lambda x: leapt(x, 10, has_imu=False), 50.0),
    "leap after 100 ms, m/s": (lambda x: leapt(x, 100, has_imu=False), 50.0),
    "leap beside an IMU of then, m/s": (lambda x: leapt(x, 1, has_imu=True), 50.0),
    "leap beside an IMU of 100 ms before, m/s": (lambda x: leapt(x, 100, has_imu=True), 50.0),
    "leap beside an IMU of 130 ms before, m/s": (lambda x: leapt(x, 130, has_imu=True), 50.0),
    "other attitude, rad": (lambda x: is_other(attitude, (x, 0.0), 0.0, 0.0), 3.0),
    "other attitude in 1 s, rad": (lambda x: is_other(attitude, (x, 1.0), 0.0, 0.0), 3.0),
    "other clock, s": (lambda x: is_other(attitude, (0.0, 0.0, x), 0.0, 0.0), 3.0),
    "other position, m": (lambda x: is_other(local, (x, 3.0, 0.0), 0.0, 3.0, 0.0), 9.0),
    "other position in 2 s, m": (lambda x: is_other(local, (8.0 + x, 5.0, 2.0), 0.0, 3.0, 0.0), 19.0),
    "other velocity, m/s": (lambda x: is_other(local, (0.0, 3.0 + x, 0.0), 0.0, 3.0, 0.0), 9.0),
    "other velocity in 1 s, m/s": (lambda x: is_other(local, (0.0, 0.5 * x, 1.0), 0.0, -0.5 * x, 0.0), 19.0),
    "other place in 2 s, m": (lambda x: is_other(world, (8.0 + x, 5.0, 2.0), 0.0, 3.0, 0.0), 19.0),
    "own state is less sure than": (lambda x: not chosen(x), 9.0),
    "own state was surer, and is less sure than": (lambda x: not chosen(x, was=0.1), 9.0),
    "own state is off by more than": (lambda x: not chosen(0.1, x), 9.0),
    "wanted own state is off by more than": (lambda x: not chosen(1.0, x, "own_state"), 19.0),
}


def test_where_each_check_begins_to_doubt() -> None:
    found = (f"{name}: {threshold(doubts, most):.3g}" for name, (doubts, most) in LIMITS.items())
    assert_golden("ownship_limits.txt", found)
    assert not goes_on(attitude(0.0, 0.0), local(0.0, 0.0, 0.0))
    assert not chosen(0.0, wanted="autopilot")
