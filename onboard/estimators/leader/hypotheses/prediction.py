"""What a step makes of a cloud of noses. Each leader flies on, and chance changes it: a nose begins to turn
or stops, a leader begins to accelerate or stops, a few particles take another nose, and all noses wander."""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import NoseModel
from onboard.estimators.leader.hypotheses import motion as model
from onboard.estimators.leader.hypotheses.cloud import Cloud, weighted
from onboard.estimators.leader.hypotheses.draws import (
    DRAW,
    DRAWS,
    OF_ACCEPTANCE,
    OF_DOUBT,
    OF_DRAG,
    OF_INTENSITIES,
    OF_NEW_WOBBLE,
    OF_NOSE,
    OF_REGIME,
    OF_SLACK,
    OF_TURN_RATE,
    OF_TURNING,
    OF_TYING,
    OF_WANDERING,
    normal_of,
    uniform_of,
)
from onboard.estimators.leader.hypotheses.leaning import (
    appears,
    banked,
    lean,
    likely,
    lognormal,
    plausible,
    slope_of,
)
from onboard.estimators.leader.hypotheses.motion import (
    ACCELERATING,
    ACCELERATION,
    BANK_ERROR,
    COVARIANCES,
    FOLLOWS4,
    FREE,
    HOVERING,
    INTERVAL,
    LEAN,
    NOSES,
    NUMBER,
    PAIR,
    POSITION,
    RX,
    RY,
    RZ,
    SLOW2,
    STEADY,
    STRETCH,
    TIED,
    UNDECIDED,
    VELOCITY,
    VX,
    VY,
    N,
    course_of,
    fly_on,
    visible2,
)
from onboard.filters.compiled import OUT, record

CIRCLES: Final = 5  # of a computation: a nose, the range that it implies, the course at that range
MOST_CRAB: Final = 2.5  # standard deviations of a fixed wing's nose about its course
LETS_GO2: Final = 9.0  # (m/s)^2: a slower leader's nose is not tied to its course
DRIFTS2: Final = 0.16  # (m/s)^2: a faster leader does not hover
SURE: Final = 10.0  # times as long until a particle takes another nose, where points show the nose
HORIZONTAL: Final = np.array([1.0, 1.0, 0.8])  # vertical accelerations are smaller


def predict(s: NoseModel, cloud: Cloud, dt: float, moved: Array) -> Cloud:
    """The cloud after `dt` seconds in which we move by `moved` (3,) m, in n. What a step makes of the leans, and
    of the banks that have lasted, counts in full: a hypothesis may suppose any, and not get one for nothing. One
    that takes another nose has paid: it is accepted by the same likelihood."""
    flies_for = s.flies_for if s.crab == 0.0 else math.inf  # a fixed wing cannot hover
    doubted_after = (SURE if cloud.sided else 1.0) * s.doubted_after
    means_of = s.accelerates_for, s.steady_for, flies_for, s.hovers_for, doubted_after, s.tied_for, s.undecided_for
    chances = [-math.expm1(-dt / mean) for mean in means_of]
    # of the noses that are looked at anew, so many are tied that the share of all stays what it is
    anew = s.tied * doubted_after / (s.tied * doubted_after + (1.0 - s.tied) * s.tied_for)
    # in one step: a nose stops or begins to turn, a leader stops or begins to accelerate, to hover, leaves, a
    # particle takes another nose, or one that is tied does, a fast leader's nose is tied or not; and it is tied
    each = np.array([s.turns_for, s.still_for, *chances, s.tied, anew])
    wanders = s.nose_random_walk * math.sqrt(dt), s.nose_about_course, math.exp(-dt / s.slack_time)
    changes = Changes(
        each, math.exp(-dt / s.intensity_time), s.intensity, s.nose_rate, s.crab, lognormal(s), wanders
    )

    # what the step adds, in proportion to the range that a nose implies (`motion.Noise`)
    per_second, times = _densities(s), [s.acceleration_time, s.bank_time, s.stretch_time]
    decay = np.exp(-dt / np.array([*times, *(bias.time for bias in cloud.biases)]))
    new = -math.expm1(-2.0 * dt / s.stretch_time)
    fixed, broad = per_second.fixed.copy(), per_second.broad * dt
    fixed[VELOCITY], fixed[STRETCH] = 2.0 * dt / s.own_velocity_time * s.own_velocity**2, s.stretch**2 * new
    broad[:, BANK_ERROR] = s.bank**2 * -math.expm1(-2.0 * dt / s.bank_time)
    if cloud.biases:
        fixed = np.append(fixed, [bias.sigma**2 * -math.expm1(-2.0 * dt / bias.time) for bias in cloud.biases])
    range_ = 2.0 * dt / s.misalignment_time * per_second.range_
    noise = model.Noise(fixed, broad, range_, s.nose_wobble**2 * new, math.log(s.size))
    v, a = math.exp(-dt / s.hover_time), math.exp(-dt / s.hover_acceleration_time)
    hover = model.Hover(v, a, s.hover_speed**2 * (1.0 - v**2), s.hover_acceleration**2 * (1.0 - a**2))
    interval = model.Interval(dt, moved, noise, hover, decay)

    passed = Passed(dt, moved, cloud.edge_on, cloud.metric, s.air, s.wind, s.rolled, cloud.leans(s))
    changed = Particles(*(array.copy() for array in particles_of(cloud)))
    gained = step(changed, cloud.draws, changes, passed, interval)
    after = cloud._replace(**changed._asdict(), draws=cloud.draws + DRAWS, unseen=cloud.unseen + dt)
    return weighted(after, gained)


class Densities(NamedTuple):
    """Of the noise of a step (`motion.Noise`): what any step adds (`fixed`), and what grows with its duration,
    `broad` each second and `range_` over half of the time of the misalignment."""

    fixed: Array
    broad: Array
    range_: Array


@lru_cache(maxsize=64)
def _densities(s: NoseModel) -> Densities:
    fixed, broad, range_ = np.zeros(N), np.zeros((3, N)), np.zeros(N)
    fixed[POSITION], fixed[LEAN] = 1e-8, 1e-10
    range_[POSITION] = np.square(s.misalignment)[[2, 2, 0]]
    broad[:2, VELOCITY], broad[:, LEAN] = s.velocity_random_walk**2, s.lean_random_walk**2
    broad[:2, ACCELERATION] = np.outer(np.square(s.acceleration_random_walk), HORIZONTAL**2)
    return Densities(fixed, broad, range_)


class Particles(NamedTuple):
    """The arrays of a `cloud.Cloud` that a step changes."""

    noses: Array
    rates: Array
    regimes: Array
    means: Array
    covariances: Array
    intensities: Array
    tied: Array
    drags: Array
    rolled: Array


def particles_of(cloud: Cloud) -> Particles:
    """Those arrays of a cloud."""
    return Particles(*cloud[: len(Particles._fields)])  # type: ignore[arg-type]


class Changes(NamedTuple):
    """How far a step changes what changes: the `chances` that it does; what it `keeps` of the logarithms of the
    intensities, and their standard deviations; the rate of a nose that is turned, rad/s; how far that of a fixed
    wing is from its course, rad; median of the drag, 1/s, and standard deviation of its logarithm; how far a nose
    wanders, rad, and one that is tied about its course, rad, and what it keeps of that."""

    chances: Array
    keeps: float
    intensity: tuple[float, float, float]
    nose_rate: float
    crab: float
    drag: tuple[float, float]
    wanders: tuple[float, float, float]


class Passed(NamedTuple):
    """What has passed since the last step, seconds and our own way (3,) m; what is seen along a nose
    (`motion.visible`); whether ranges are metric, so that they do not depend on the noses; the velocity of the
    `air` (2,), and its standard deviation where that is not known, m/s; that of a mean bank error, rad; and
    whether leaders lean, so that a wing's slope shows it."""

    dt: float
    moved: Array
    edge_on: float
    metric: bool
    air: tuple[float, float]
    wind: float
    rolled: float
    leans: bool


PARTICLES: Final = record(Particles, NOSES, NOSES, NOSES, OUT, COVARIANCES, OUT, NOSES, NOSES, NOSES)
THREE: Final = record(tuple, NUMBER, NUMBER, NUMBER)
CHANGES: Final = record(Changes, NOSES, NUMBER, THREE, NUMBER, NUMBER, PAIR, THREE)
PASSED: Final = record(Passed, NUMBER, NOSES, NUMBER, types.boolean, PAIR, NUMBER, NUMBER, types.boolean)


@njit(cache=True, error_model="numpy")
def _fraction(nose, x, edge_on):
    """The fraction that is seen of a level wing of a leader with the mean x (N,)."""
    return np.sqrt(visible2(nose, x[RX], x[RY], x[RX] * x[RX] + x[RY] * x[RY] + x[RZ] * x[RZ], edge_on))


@njit(cache=True, error_model="numpy")
def _doubt(ratio, x, P, dt, moved, hovers):
    """Give a particle another nose, in place: the one that is supposed may be wrong after all. Seen so, the same
    images are those of a leader that is nearer or farther by a `ratio`, and moves in proportion; one that hovers
    stands still there, too."""
    scaled = VX if hovers else BANK_ERROR + 1
    for i in range(x.shape[0]):
        scale = ratio if i < scaled else 1.0
        x[i] *= scale
        for j in range(x.shape[0]):
            P[i, j] *= scale * (ratio if j < scaled else 1.0)
    if hovers:
        return
    for i in range(3):
        x[VX + i] += (1.0 - ratio) * moved[i] / dt


@njit(cache=True, error_model="numpy")
def _takes(nose, other, x, P, passed, hovers, drags, chance):
    """Give a particle another nose, and the second of two `drags`, in place; False if it keeps what it has, as the
    lean is unlikely that its wing's slope needs then (Metropolis and Hastings, with the logarithm of a `chance`).
    The narrower a wing looks, the steeper its slope for the same bank: the density of slopes is lower by that
    factor. Of what shows no slope, or does not lean, each nose is as likely."""
    dt, moved, edge_on, metric, wind = passed.dt, passed.moved, passed.edge_on, passed.metric, passed.wind
    if not passed.leans:
        if not metric:
            _doubt(_fraction(other, x, edge_on) / _fraction(nose, x, edge_on), x, P, dt, moved, hovers)
        return True
    was, of_it = x.copy(), P.copy()
    slope, before = slope_of(nose, x), likely(nose, x, P, drags[0], wind, 0.0)
    if not metric:
        _doubt(banked(slope, other, x)[1] / banked(slope, nose, x)[1], x, P, dt, moved, hovers)
    lean(slope, nose, other, x, P, drags[1], wind)
    narrower = np.log(abs(appears(other, x)[0] / appears(nose, x)[0]))
    if chance <= likely(other, x, P, drags[1], wind, 0.0) - before + narrower:
        return True
    x[:], P[:, :] = was, of_it
    return False


@njit(cache=True, error_model="numpy")
def _next(regime, x, P, drawn, steadies, begins, hovers, leaves):
    """The regime after a step, by a number that is `drawn` from (0, 1). Only a slow leader begins to hover."""
    if regime == HOVERING:
        return ACCELERATING if drawn < leaves or x[VX] * x[VX] + x[VY] * x[VY] > DRIFTS2 else HOVERING
    speed2 = (x[VX] * x[VX] + x[VY] * x[VY]) / (SLOW2 + P[VX, VX] + P[VY, VY])
    if drawn > 1.0 - hovers * np.exp(-0.5 * speed2):
        return HOVERING
    if regime == ACCELERATING:
        return STEADY if drawn < steadies else ACCELERATING
    return ACCELERATING if drawn < begins else STEADY


@njit(cache=True, error_model="numpy")
def _rate(rate, drawn, stops, turns, new):
    """At which a nose is turned after a step, by a number that is `drawn` from (0, 1)."""
    if rate != 0.0:
        return 0.0 if drawn < stops else rate
    return new if drawn < turns else 0.0


@njit(cache=True, error_model="numpy")
def _tied_nose(nose, aside, x, dt, moved, edge_on, air):
    """The nose so far `aside`, rad, of the course that the leader would have with that nose: its range and
    velocity depend on it."""
    other = course_of(x, air) + aside
    aside += course_of(x, air) - np.arctan2(x[VY] - air[1], x[VX] - air[0])
    for _ in range(CIRCLES):
        ratio = _fraction(other, x, edge_on) / _fraction(nose, x, edge_on)
        u = ratio * x[VX] + (1.0 - ratio) * moved[0] / dt
        v = ratio * x[VY] + (1.0 - ratio) * moved[1] / dt
        other = np.arctan2(v - air[1], u - air[0]) + aside
    return other


@njit(cache=True, error_model="numpy")
def _decided(tied, x, regime, drawn, which, decides, doubted, unties, ties, anew):
    """Whether a nose is tied to its course after a step, whether it is from now on, and whether it is doubted, by
    numbers that are `drawn` from (0, 1). Of a slow leader that is undecided."""
    speed2 = x[VX] * x[VX] + x[VY] * x[VY]
    if ties > 0.0 and (regime == HOVERING or speed2 < LETS_GO2):
        tied = UNDECIDED
    if tied == TIED and drawn >= unties:
        return TIED, False, False
    fast = speed2 * speed2 / (speed2 * speed2 + FOLLOWS4)
    if tied == UNDECIDED and drawn > 1.0 - decides * fast:
        return (TIED, True, False) if which < ties else (FREE, False, False)
    if tied == TIED or drawn < doubted:
        if which < anew * fast and tied != UNDECIDED:
            return TIED, True, False
        return min(tied, FREE), False, True
    return tied, False, False


@njit(cache=True, error_model="numpy")
def _change(k, particles, draws, changes, passed):
    """Let chance change a particle, in place, by the random numbers from `draws` on."""
    noses, rates, regimes, means, P, intensities, tied, drags, _ = particles
    turns_for, still_for, steadies, begins, hovers, leaves, doubted, unties, decides, ties, anew = changes.chances
    keeps, spread, slack, crab, drag = (
        changes.keeps,
        changes.intensity,
        changes.wanders[1],
        changes.crab,
        changes.drag,
    )
    dt, x = passed.dt, means[k]
    restless = np.exp(intensities[k, 2])
    stops, turns = -np.expm1(-dt * np.sqrt(restless) / turns_for), -np.expm1(-dt * restless**2 / still_for)
    new_rate = 0.0
    of_turning = uniform_of(draws + OF_TURNING, k)
    if rates[k] == 0.0 and of_turning < turns:
        new_rate = changes.nose_rate * restless * normal_of(draws + OF_TURN_RATE, k)
    rates[k] = _rate(rates[k], of_turning, stops, turns, new_rate)
    for i in range(3):
        bold = normal_of(draws + OF_INTENSITIES[i], k) if spread[i] > 0.0 else 0.0
        new = spread[i] * np.sqrt(1.0 - keeps * keeps) * bold
        intensities[k, i] = keeps * intensities[k, i] + new
    of_speed = uniform_of(draws + OF_REGIME, k)
    regimes[k] = _next(regimes[k], x, P[k], of_speed, steadies, begins, hovers, leaves)
    tied_before = tied[k]
    tied[k], becomes_tied, doubts = _decided(
        *(tied[k], x, regimes[k], uniform_of(draws + OF_DOUBT, k)),
        *(uniform_of(draws + OF_TYING, k), decides, doubted, unties, ties, anew),
    )
    if not (becomes_tied or doubts):
        return
    where = uniform_of(draws + OF_NOSE, k)
    other = noses[k] + np.pi * where
    of_heading = spread[2] * normal_of(draws + OF_NEW_WOBBLE, k)
    if becomes_tied:
        aside = slack * np.exp(of_heading) * normal_of(draws + OF_SLACK, k)
        other, rates[k] = _tied_nose(noses[k], aside, x, dt, passed.moved, passed.edge_on, passed.air), 0.0
    elif crab > 0.0:  # a fixed wing's nose stays about its course
        other = np.arctan2(x[VY], x[VX]) + crab * MOST_CRAB * (2.0 * where - 1.0)
    new_drag = drag[0] * np.exp(drag[1] * normal_of(draws + OF_DRAG, k))
    accepted = uniform_of(draws + OF_ACCEPTANCE, k)
    hovering, both = regimes[k] == HOVERING, (drags[k], new_drag)
    if _takes(noses[k], other, x, P[k], passed, hovering, both, np.log(accepted)):
        drags[k] = new_drag
        intensities[k, 2] = of_heading
    else:
        other, tied[k] = noses[k], tied_before
    noses[k] = other


@njit(cache=True, error_model="numpy")
def _wander(k, particles, draws, wanders, passed):
    """Turn a nose, in place. One that is tied to its course wanders about it."""
    noses, x = particles.noses, particles.means[k]
    walk, sigma, keeps = wanders
    broad = _fraction(noses[k], x, passed.edge_on)
    # the less is seen of the wing, the more does it show of a small turn
    restless = np.exp(particles.intensities[k, 2])
    far = walk * restless * min(1.0, broad / np.sqrt(max(1.0 - broad * broad, 1e-9)))
    turned = passed.dt * particles.rates[k]
    if particles.tied[k] == TIED:
        aside = noses[k] - course_of(x, passed.air)
        aside -= 2.0 * np.pi * np.rint(aside / (2.0 * np.pi))
        turned, far = aside * (keeps - 1.0), sigma * restless * np.sqrt(1.0 - keeps * keeps)
    noses[k] += turned + far * normal_of(draws + OF_WANDERING, k)


@njit(cache=True, error_model="numpy")
def _prior(k, particles, passed):
    """The logarithm of the likelihood of a particle's lean, and of its mean bank error."""
    if not passed.leans:
        return 0.0
    noses, _, _, means, P, _, _, drags, rolled = particles
    return plausible(noses[k], means[k], P[k], drags[k], rolled[k], passed.wind, passed.rolled)


@njit((PARTICLES, DRAW, CHANGES, PASSED, INTERVAL), cache=True, error_model="numpy")
def step(particles, draws, changes, passed, interval):
    """Predict particles, in place; by how much the logarithms of their priors (K,) grow."""
    gained = np.empty(particles.noses.shape[0])
    for k in range(gained.shape[0]):
        _change(k, particles, draws, changes, passed)
        gained[k] = -_prior(k, particles, passed)
        _wander(k, particles, draws, changes.wanders, passed)
        fly_on(k, particles, interval, passed.air, passed.edge_on)
        gained[k] += _prior(k, particles, passed)
    return gained


@njit((PARTICLES, PARTICLES, PASSED), cache=True, error_model="numpy")
def gain(before, after, passed):
    """By how much the logarithms of the priors (K,) of particles grow."""
    found = np.empty(before.noses.shape[0])
    for k in range(found.shape[0]):
        found[k] = _prior(k, after, passed) - _prior(k, before, passed)
    return found
