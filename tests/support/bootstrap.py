"""A bootstrap particle filter of a leader whose heading may point anywhere.

It is an independent and slow reference for the particles: every state is drawn, none is a Gaussian. It has the
same model of flight (`LeaderModel`), but its own code for the motion, the image and the weights.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import LeaderModel

GRAVITY: Final = 9.80665
HORIZONTAL: Final = np.array([1.0, 1.0, 0.8])
# Slow and calm, nothing considered: what this filter can follow.
CALM: Final = LeaderModel(
    size=2.0,
    size_sigma=1e-6,
    misalignment=(1e-6,) * 3,
    misalignment_time=60.0,
    own_velocity=1e-4,
    speed=1.0,
    acceleration=0.3,
    acceleration_random_walk=(0.2, 0.2),
    accelerating=0.0,
    still_for=1e9,
    nose_wobble=0.0,
    bank=math.radians(2.0),
    drag=0.0,
    drag_sigma=0.0,
    wind=0.0,
    lean_random_walk=0.0,
    hovering=0.0,
    flies_for=1e9,
    intensity=(0.0, 0.0, 0.0),
    tied=0.0,
    fewest=900,
    evidence_rate=1e9,
    steady_evidence=1e9,
    doubted_after=1e9,
)


class Particles(NamedTuple):
    """K draws of the leader's state."""

    heading: Array  # (K,), rad
    r: Array  # (K, 3), r_FL_n
    v: Array  # (K, 3), v_L
    a: Array  # (K, 3), a_L
    bank: Array  # (K,), error, rad
    stretch: Array  # (K,), relative error of the wing's size


def broadness(p: Particles) -> Array:
    """The fraction (K,) that is seen of a level wing."""
    along = (np.cos(p.heading) * p.r[:, 1] - np.sin(p.heading) * p.r[:, 0]) / np.linalg.norm(p.r, axis=1)
    return np.asarray(np.sqrt(np.maximum(1.0 - along**2, 0.0) + 0.05**2))


def image_of(p: Particles, size: float) -> Array:
    """Return the center (K, 2) and the vector from left to right tip (K, 2) in the image.

    They are in focal lengths, for a camera at F that looks north.
    """
    bank = np.arctan2(p.a[:, 1] * np.cos(p.heading) - p.a[:, 0] * np.sin(p.heading), GRAVITY - p.a[:, 2]) + p.bank
    half = 0.5 * size * np.exp(p.stretch)
    wing = half[:, None] * np.stack(
        [-np.sin(p.heading) * np.cos(bank), np.cos(p.heading) * np.cos(bank), np.sin(bank)], axis=1
    )
    center, left, right = (q[:, 1:] / q[:, :1] for q in (p.r, p.r - wing, p.r + wing))
    return np.concatenate([center, right - left], axis=1)


def start(s: LeaderModel, seen: Array, sigma: float, count: int, rng: np.random.Generator) -> Particles:
    """Draw particles from a first image `seen` (4,) as in `image_of`; `sigma` is that of a point."""
    heading = math.pi * rng.uniform(size=count)
    center = seen[:2] + sigma * rng.normal(size=(count, 2))
    line = np.column_stack([np.ones(count), center])
    line /= np.linalg.norm(line, axis=1)[:, None]
    zero = np.zeros(count)
    broad = broadness(Particles(heading, line, line, line, zero, zero))
    span = math.hypot(seen[2], seen[3])
    span = span + max(math.sqrt(2.0) * sigma, 0.01 * span) * rng.normal(size=count)
    r = (s.size * broad / np.maximum(span, 0.1 * sigma))[:, None] * line
    v = broad[:, None] * s.speed * np.array([1.0, 1.0, 0.4]) * rng.normal(size=(count, 3))
    a = broad[:, None] * s.acceleration * HORIZONTAL * rng.normal(size=(count, 3))
    return Particles(heading, r, v, a, broad * s.bank * rng.normal(size=count), s.stretch * rng.normal(size=count))


def predict(s: LeaderModel, p: Particles, dt: float, moved: Array, rng: np.random.Generator) -> Particles:
    """After `dt` seconds in which we move by `moved` (3,)."""
    count, broad = len(p.heading), broadness(p)
    level = p.v[:, :2]
    speed2 = np.sum(level**2, axis=1)
    rate = (p.v[:, 0] * p.a[:, 1] - p.v[:, 1] * p.a[:, 0]) / (speed2 + 1.0)
    heading = p.heading + speed2**2 / (speed2**2 + 81.0) * rate * dt
    wobble = s.nose_random_walk * np.minimum(1.0, broad / np.sqrt(np.maximum(1.0 - broad**2, 1e-9)))
    heading = heading + wobble * math.sqrt(dt) * rng.normal(size=count)
    r = p.r + dt * p.v + 0.5 * dt**2 * p.a - moved
    v = p.v + dt * p.a + (broad * s.velocity_random_walk * math.sqrt(dt))[:, None] * rng.normal(size=(count, 3))
    a = _accelerations(s, p, dt, speed2, rate)
    walk = broad * s.acceleration_random_walk[0] * math.sqrt(dt)
    a = a + walk[:, None] * HORIZONTAL * rng.normal(size=(count, 3))
    kept, kept_stretch = math.exp(-dt / s.bank_time), math.exp(-dt / s.stretch_time)
    bank = kept * p.bank + broad * s.bank * math.sqrt(1.0 - kept**2) * rng.normal(size=count)
    stretch = kept_stretch * p.stretch + s.stretch * math.sqrt(1.0 - kept_stretch**2) * rng.normal(size=count)
    return Particles(heading, r, v, a, bank, stretch)


def _accelerations(s: LeaderModel, p: Particles, dt: float, speed2: Array, rate: Array) -> Array:
    """Return the accelerations after a step.

    The component along the track decays, for a slow leader all of it; the component across turns with the track.
    """
    left = math.exp(-dt / s.acceleration_time)
    slow = 1.0 - (1.0 - left) * 4.0 / (speed2 + 4.0)
    along = np.sum(p.v[:, :2] * p.a[:, :2], axis=1) * (1.0 - left) / (speed2 + 1.0)
    x, y = (slow[:, None] * (p.a[:, :2] - along[:, None] * p.v[:, :2])).T
    turn = rate * dt * speed2 / (speed2 + 4.0)
    c, sn = np.cos(turn), np.sin(turn)
    return np.stack([c * x - sn * y, sn * x + c * y, left * slow * p.a[:, 2]], axis=1)
