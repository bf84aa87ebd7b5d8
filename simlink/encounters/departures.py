"""Encounters that violate one assumption of an estimator.

The ranges of `conditions` lie around the assumed values of leaders and of our own errors; a departure lies
outside. The exception is `sway`, our own motion across the line of sight, which violates nothing.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.messages import Record
from simlink.encounters.conditions import NOMINAL_SIZE, Conditions
from simlink.encounters.curves import Motion, heading_vector, motion_from_positions, moving_average, wander, waves
from simlink.encounters.families import Scene
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, step_count


class Departure(NamedTuple):
    """One departure from an estimator's assumptions; the default is none.

    The factors multiply what a family or its conditions draw: the leader's manoeuvres (`vigour`), its bank and
    heading errors (`wobble`), the noise of image points, and the errors of our attitude and velocity.
    """

    drag: float | None = None  # 1/s; None: as drawn
    wind: float | None = None  # m/s, from any direction; None: a breeze
    any_nose: bool = False  # whether the leader's nose is independent of its course
    size_off: float | None = None  # relative error of the nominal wingspan; None: up to SIZE_WITHIN
    vigour: float = 1.0
    wobble: float = 1.0
    image_noise: float = 1.0
    image_noise_time: float = 0.0  # s, its correlation time
    stamp_late: float = 0.0  # s, stamp minus exposure, at most the latency
    own_errors: float = 1.0
    own_errors_time: float | None = None  # s, their correlation time; None: as drawn
    attitude_white_deg: float = 0.0  # white noise of our attitude about each axis
    mount_off_deg: float = 0.0  # error of the configured mount about one of its axes
    # Recorded leaders did these; `studies/encounters/assumptions.py` has the extremes.
    yaw_leads: float = 0.0  # s by which the nose is ahead of the course in a turn
    nose_slack_deg: float = 0.0  # RMS of the oscillation of its nose
    nose_rate: float = 0.0  # rad/s at which its nose turns to either side
    nose_turns: float = 0.0  # share of the time in which it does
    acceleration: float = 0.0  # m/s^2, RMS of manoeuvres in addition to the family's
    jitter: float = 0.0  # m/s, RMS of wandering as by a pilot's hand, in addition
    bank: GaussMarkov | None = None  # degrees, the error of its bank; None: as drawn
    sail: float = 0.0  # 1/s, additional drag along its nose, as of a wing across the flow
    sway: float = 0.0  # m, amplitude of our own motion across the first line of sight


NO_DEPARTURE: Final = Departure()
MANOEUVRE_PERIODS_S: Final = (5.0, 3.2)
JITTER_PERIODS_S: Final = (5.0, 3.5)  # of a hand that hovers: correlated for about a second
SLACK_PERIODS_S: Final = (6.0, 3.0)
COURSE_MIN_SPEED: Final = 1.0  # m/s; a slower leader has hardly a course


def depart(
    scene: Scene, conditions: Conditions, departure: Departure, rng: np.random.Generator
) -> tuple[Scene, Conditions]:
    """Apply a departure to a scene and its conditions, after the family's `vigour`."""
    d = departure
    turned, windward, side = rng.uniform(0.0, math.tau), rng.uniform(0.0, math.tau), float(rng.choice([-1.0, 1.0]))
    if d.any_nose:
        scene = scene._replace(nose=scene.nose + turned)
    if d.wind is not None:
        scene = scene._replace(wind=d.wind * heading_vector(np.array(windward)))
    if d.sway:
        scene = scene._replace(follower=_add_sway(scene, d.sway, rng))
    scene = _change_flight(scene, d, rng)
    s = conditions.scenario
    leader = replace(s.leader, **_scale_errors(s.leader, ("bank_wobble_deg", "heading_wobble_deg"), d.wobble))
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
    own = _scale_errors(s.nav, ("attitude_deg", "yaw_deg", "velocity"), d.own_errors, d.own_errors_time)
    nav = replace(s.nav, attitude_white=(white, white, white), **own)
    drag = conditions.drag if d.drag is None else d.drag
    return scene, Conditions(drag, replace(s, leader=leader, camera=camera, nav=nav))


def _change_flight(scene: Scene, d: Departure, rng: np.random.Generator) -> Scene:
    """Apply the departures that change how the leader is flown."""
    if d.acceleration or d.jitter:
        r = scene.leader.r
        for of_r, size, seconds in ((2, d.acceleration, MANOEUVRE_PERIODS_S), (1, d.jitter, JITTER_PERIODS_S)):
            if size:
                r = r + _wander_positions(rng, len(r), size, seconds, of_r)
        scene = scene._replace(leader=motion_from_positions(r))
    nose = scene.nose
    if d.yaw_leads:
        nose = nose + d.yaw_leads * _course_rate(scene.leader)
    if d.nose_slack_deg:
        t: Array = DT * np.arange(len(nose), dtype=np.float64)
        swing = waves(rng, t, 1.0, SLACK_PERIODS_S)
        nose = nose + np.radians(d.nose_slack_deg) * swing / np.sqrt(np.mean(swing**2))
    if d.nose_rate:
        nose = nose + _turn_angles(rng, len(nose), d.nose_rate, d.nose_turns)
    return scene._replace(nose=nose, sail=d.sail)


def _wander_positions(
    rng: np.random.Generator, count: int, size: float, seconds: Sequence[float], order: int
) -> Array:
    """Return positions (N, 3) whose derivative of this `order` has the RMS `size`.

    The vertical amplitude is 0.3 times the horizontal one.
    """
    t: Array = DT * np.arange(count, dtype=np.float64)
    r = motion_from_positions(wander(rng, t, (1.0, 1.0, 0.3), seconds))
    rms = np.sqrt(np.mean(np.sum((r.v if order == 1 else r.a)[2:-2] ** 2, axis=1)))
    return np.asarray(size / rms * (r.r - r.r[0]))


def _course_rate(motion: Motion) -> Array:
    """Return the course rate (N,), rad/s, which tends to zero as the leader stops."""
    (u, v, _), (du, dv, _) = motion.v.T, motion.a.T
    return np.asarray((u * dv - v * du) / (u**2 + v**2 + COURSE_MIN_SPEED**2))


def _turn_angles(rng: np.random.Generator, count: int, rate: float, share: float) -> Array:
    """Return angles (N,) of a nose that turns at up to `rate` for `share` of the time."""
    rates, begin = np.zeros(count), 0
    while begin < count:
        end = begin + step_count(float(rng.uniform(1.0, 3.0)))
        rates[begin:end] = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0) * rate * (rng.uniform() < share)
        begin = end
    return np.cumsum(moving_average(rates, 0.4)) * DT


def _scale_errors(
    part: Record, names: tuple[str, ...], factor: float, time: float | None = None
) -> dict[str, GaussMarkov]:
    """Return scaled errors of a scenario's record, with the correlation time `time` (s)."""
    errors = {name: getattr(part, name) for name in names}
    return {name: GaussMarkov(sigma=factor * e.sigma, time=time or e.time) for name, e in errors.items()}


def _add_sway(scene: Scene, amplitude: float, rng: np.random.Generator) -> Motion:
    """Return our motion with a sway of 7 to 12 s across the first line of sight."""
    sight = scene.leader.r[0] - scene.follower.r[0]
    across = heading_vector(np.arctan2(sight[1], sight[0]) + np.array(0.25 * math.tau))
    phase = math.tau * (DT * np.arange(len(scene.follower.r)) / rng.uniform(7.0, 12.0) + rng.uniform())
    return motion_from_positions(scene.follower.r + amplitude * np.sin(phase)[:, None] * across)
