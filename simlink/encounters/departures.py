"""How an encounter departs from what an estimator supposes of leaders and of our own errors: one assumption that
is false, of a leader or of ourselves. The ranges of `conditions` lie around what is supposed; these lie outside.
Or we sway, to see the leader from elsewhere: that falsifies nothing.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.messages import Record
from simlink.encounters.conditions import NOMINAL_SIZE, Conditions
from simlink.encounters.curves import Motion, blurred, level, moving, wander, waves
from simlink.encounters.families import TURN, Scene
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, steps_of


class Departure(NamedTuple):
    """By default none. The factors are of what a family or its conditions draw: the leader's manoeuvres
    (`vigour`), how its bank and nose wobble, the noise of image points, and the errors of our attitude and
    velocity."""

    drag: float | None = None  # 1/s; None: as drawn
    wind: float | None = None  # m/s, from anywhere; None: a breeze
    any_nose: bool = False  # the leader's nose points anywhere, whatever its course
    size_off: float | None = None  # of the nominal wingspan, to either side; None: SIZE_WITHIN at most
    vigour: float = 1.0
    wobble: float = 1.0
    image_noise: float = 1.0
    image_noise_time: float = 0.0  # s, over which it is correlated
    stamp_late: float = 0.0  # s, by which images are stamped after their exposure; their latency at most
    own_errors: float = 1.0
    own_errors_time: float | None = None  # s, over which they are correlated; None: as drawn
    attitude_white_deg: float = 0.0  # of our attitude about each axis, new in each message
    mount_off_deg: float = 0.0  # the camera from where it is configured, about one of its axes
    # What leaders did that others flew (`studies/encounters/assumptions.py` has the extremes).
    yaw_leads: float = 0.0  # s, of its course: the nose is ahead by so long at the rate of a turn
    nose_slack_deg: float = 0.0  # RMS, by which its nose swings about where it would point
    nose_rate: float = 0.0  # rad/s, at which its nose turns to either side, for `nose_turns` of the time
    nose_turns: float = 0.0
    acceleration: float = 0.0  # m/s^2, RMS, of manoeuvres on top of those of the family
    jitter: float = 0.0  # m/s, RMS, by which it wanders, as by hand, on top of that
    bank: GaussMarkov | None = None  # degrees: how its bank wobbles; None: as drawn
    sail: float = 0.0  # 1/s, drag along its nose beyond the other: a wing that stands across the flow
    sway: float = 0.0  # m, to either side, of ourselves across the first line of sight, on top of what we fly


NONE: Final = Departure()
MANOEUVRE_S: Final = (5.0, 3.2)  # s, periods of manoeuvres
JITTER_S: Final = (5.0, 3.5)  # s, of a hand that hovers: correlated for about a second
SLACK_S: Final = (6.0, 3.0)  # s
COURSE: Final = 1.0  # m/s


def depart(
    scene: Scene, conditions: Conditions, departure: Departure, rng: np.random.Generator
) -> tuple[Scene, Conditions]:
    """The scene and the conditions after a departure; its `vigour` is that of the family's own draw."""
    d = departure
    turned, windward, side = rng.uniform(0.0, TURN), rng.uniform(0.0, TURN), float(rng.choice([-1.0, 1.0]))
    if d.any_nose:
        scene = scene._replace(nose=scene.nose + turned)
    if d.wind is not None:
        scene = scene._replace(wind=d.wind * level(np.array(windward)))
    if d.sway:
        scene = scene._replace(follower=_swaying(scene, d.sway, rng))
    scene = _flown(scene, d, rng)
    s = conditions.scenario
    leader = replace(s.leader, **_scaled(s.leader, ("bank_wobble_deg", "heading_wobble_deg"), d.wobble))
    if d.bank is not None:
        leader = replace(leader, bank_wobble_deg=d.bank)
    if d.size_off is not None:
        leader = replace(leader, size=NOMINAL_SIZE * (1.0 + side * d.size_off))
    camera = replace(
        s.camera,
        sigma_px=d.image_noise * s.camera.sigma_px,
        noise_time=d.image_noise_time,
        stamp_late=min(d.stamp_late, s.camera.latency),
    )
    white = float(np.radians(d.attitude_white_deg))
    own = _scaled(s.nav, ("attitude_deg", "yaw_deg", "velocity"), d.own_errors, d.own_errors_time)
    nav = replace(s.nav, attitude_white=(white, white, white), **own)
    drag = conditions.drag if d.drag is None else d.drag
    return scene, Conditions(drag, replace(s, leader=leader, camera=camera, nav=nav))


def _flown(scene: Scene, d: Departure, rng: np.random.Generator) -> Scene:
    """The scene with a leader that is flown otherwise."""
    if d.acceleration or d.jitter:
        r = scene.leader.r
        for of_r, size, seconds in ((2, d.acceleration, MANOEUVRE_S), (1, d.jitter, JITTER_S)):
            if size:
                r = r + _wandering(rng, len(r), size, seconds, of_r)
        scene = scene._replace(leader=moving(r))
    nose = scene.nose
    if d.yaw_leads:
        nose = nose + d.yaw_leads * _course_rate(scene.leader)
    if d.nose_slack_deg:
        t: Array = DT * np.arange(len(nose), dtype=np.float64)
        swing = waves(rng, t, 1.0, SLACK_S)
        nose = nose + np.radians(d.nose_slack_deg) * swing / np.sqrt(np.mean(swing**2))
    if d.nose_rate:
        nose = nose + _turning(rng, len(nose), d.nose_rate, d.nose_turns)
    return scene._replace(nose=nose, sail=d.sail)


def _wandering(rng: np.random.Generator, count: int, size: float, seconds: Sequence[float], order: int) -> Array:
    """Positions (N, 3) whose derivative of that `order` has the RMS `size`, a third of it upright."""
    t: Array = DT * np.arange(count, dtype=np.float64)
    r = moving(wander(rng, t, (1.0, 1.0, 0.3), seconds))
    rms = np.sqrt(np.mean(np.sum((r.v if order == 1 else r.a)[2:-2] ** 2, axis=1)))
    return np.asarray(size / rms * (r.r - r.r[0]))


def _course_rate(motion: Motion) -> Array:
    """How fast the course turns (N,), rad/s; hardly, where the leader hardly flies."""
    (u, v, _), (du, dv, _) = motion.v.T, motion.a.T
    return np.asarray((u * dv - v * du) / (u**2 + v**2 + COURSE**2))


def _turning(rng: np.random.Generator, count: int, rate: float, share: float) -> Array:
    """Angles (N,) of a nose that turns by a rate up to `rate` for `share` of the time, to either side."""
    rates, begin = np.zeros(count), 0
    while begin < count:
        end = begin + steps_of(float(rng.uniform(1.0, 3.0)))
        rates[begin:end] = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0) * rate * (rng.uniform() < share)
        begin = end
    return np.cumsum(blurred(rates, 0.4)) * DT


def _scaled(
    part: Record, names: tuple[str, ...], factor: float, time: float | None = None
) -> dict[str, GaussMarkov]:
    """These errors of a part of the scenario, so many times as large, and correlated over `time` s."""
    errors = {name: getattr(part, name) for name in names}
    return {name: GaussMarkov(sigma=factor * e.sigma, time=time or e.time) for name, e in errors.items()}


def _swaying(scene: Scene, amplitude: float, rng: np.random.Generator) -> Motion:
    """Our motion with a sway across the first line of sight, of 7 to 12 s."""
    sight = scene.leader.r[0] - scene.follower.r[0]
    across = level(np.arctan2(sight[1], sight[0]) + np.array(0.25 * TURN))
    phase = TURN * (DT * np.arange(len(scene.follower.r)) / rng.uniform(7.0, 12.0) + rng.uniform())
    return moving(scene.follower.r + amplitude * np.sin(phase)[:, None] * across)
