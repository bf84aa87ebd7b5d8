"""Prediction of particles.

Each leader flies on, and chance changes it: a heading begins to turn or stops, a leader begins to accelerate or
stops, a few particles take another heading, and all headings wander."""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import BOOL, FILLING, MAKING, OUT, ROWS, UNSIGNED, kernel, like, record
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses.draws import (
    OF_ACCEPTANCE,
    OF_DRAG,
    OF_HEADING,
    OF_INTENSITIES,
    OF_NEW_WOBBLE,
    OF_REGIME,
    OF_RESAMPLED_HEADING,
    OF_SLACK,
    OF_TURN_RATE,
    OF_TURNING,
    OF_TYING,
    OF_WANDERING,
    STREAMS_PER_STEP,
    normal_of,
    uniform_of,
)
from onboard.estimators.leader.hypotheses.motion import (
    ACCELERATING,
    AX,
    BANK_ERROR,
    COURSE_LOCKED,
    COVARIANCES,
    FREE,
    HEADINGS,
    HOVERING,
    NUMBER,
    RX,
    RY,
    RZ,
    STEADY,
    TILT_NORTH,
    UNDECIDED,
    VX,
    VY,
    WING_SCALE_ERROR,
    Hover,
    Interval,
    N,
    Noise,
    course_of,
    fly_on,
    visible2,
)
from onboard.estimators.leader.hypotheses.particles import Bias, Particles, evidence, normalise
from onboard.estimators.leader.hypotheses.tilt import (
    appears,
    banked,
    likely,
    lognormal_of,
    plausible,
    retilt,
    slope_of,
)

NOWHERE: Final = np.zeros(3)
HORIZONTAL: Final = np.array([1.0, 1.0, 0.8])  # vertical accelerations are smaller


def predict(s: LeaderModel, particles: Particles, dt: float, moved: Array) -> Particles:
    """The particles after `dt` seconds in which we move by `moved` (3,) m, in n.

    What a step makes of the tilts, and of the banks that have lasted, counts in full: a hypothesis may suppose
    any, and not get one for nothing. One that takes another heading has paid: it is accepted by the same
    likelihood."""
    changed = ParticleArrays(*(array.copy() for array in particles_of(particles)))
    known = _variances(particles.biases), particles.heading_observed, passed(s, particles, dt, moved)
    log_weights = step(changed, particles.log_weights, particles.draws, s, *known)
    after = particles._replace(**changed._asdict(), log_weights=log_weights)
    return after._replace(draws=particles.draws + STREAMS_PER_STEP, unseen=particles.unseen + dt)


@lru_cache(maxsize=64)
def _variances(biases: tuple[Bias, ...]) -> Array:
    """Return variance and correlation time (k, 2), s, of each bias."""
    return np.array([(bias.sigma**2, bias.time) for bias in biases]).reshape(-1, 2)


class ParticleArrays(NamedTuple):
    """The arrays of a `particles.Particles` that a step changes."""

    headings: Array
    rates: Array
    regimes: Array
    means: Array
    covariances: Array
    intensities: Array
    course_locked: Array
    drags: Array
    mean_bank_error: Array


def particles_of(particles: Particles) -> ParticleArrays:
    """Those arrays of particles."""
    return ParticleArrays(*particles[: len(ParticleArrays._fields)])  # type: ignore[arg-type]


class Changes(NamedTuple):
    """Probabilities and scales of what a step changes.

    The `chances` that it does; what it `keeps` of the logarithms of the intensities, and their standard
    deviations; the rate of a heading that is turned, rad/s; median of the drag, 1/s, and standard deviation of its
    logarithm; how far a heading wanders, rad, and one that is course-locked about its course, rad, and what it
    keeps of that."""

    chances: Array
    keeps: float
    intensity: tuple[float, float, float]
    nose_rate: float
    drag: tuple[float, float]
    wanders: tuple[float, float, float]


class Passed(NamedTuple):
    """Inputs of a step.

    Seconds and our own way (3,) m since the last one; what is seen along a heading (`motion.visible`); whether
    ranges are metric, so that they do not depend on the headings; the standard deviations of the wind, m/s, and of
    a mean bank error, rad; and whether leaders tilt, so that a wing's slope shows it."""

    dt: float
    moved: Array
    edge_on_visibility: float
    metric: bool
    wind: float
    bank_sigma: float
    tilts: bool


def passed(s: LeaderModel, particles: Particles, dt: float = 0.0, moved: Array = NOWHERE) -> Passed:
    """The interval since the last step, and what these particles have in common."""
    tilts = s.drag != 0.0 and particles.edge_on_visibility <= given.MIN_VISIBLE_FRACTION
    return Passed(dt, moved, particles.edge_on_visibility, particles.metric, s.wind, s.rolled, tilts)


PARTICLE_ARRAYS: Final = record(
    ParticleArrays, HEADINGS, HEADINGS, HEADINGS, OUT, COVARIANCES, OUT, HEADINGS, HEADINGS, HEADINGS
)
PASSED: Final = record(Passed, NUMBER, HEADINGS, NUMBER, BOOL, NUMBER, NUMBER, BOOL)
MODEL: Final = like(LeaderModel(1.0, 1.0, (1.0, 1.0, 1.0), 1.0, 1.0))


@kernel(**MAKING)
def _changes(s, dt, heading_observed):
    """Return the probabilities of the changes in `dt` seconds."""
    doubted_after = (given.OBSERVED_HEADING_TIME_FACTOR if heading_observed else 1.0) * s.doubted_after
    # of the headings that are looked at anew, so many are course-locked that the share of all stays what it is
    anew = s.tied * doubted_after / (s.tied * doubted_after + (1.0 - s.tied) * s.tied_for)
    # a leader stops or begins to accelerate, to hover, leaves, a particle takes another heading, or one that is
    # course-locked does, a fast leader's heading is decided
    means = s.accelerates_for, s.steady_for, s.flies_for, s.hovers_for, doubted_after, s.tied_for, s.undecided_for
    chances = np.empty(len(means) + 4)  # and a heading stops or begins to turn; it is locked to its course
    chances[0], chances[1], chances[-2], chances[-1] = s.turns_for, s.still_for, s.tied, anew
    for i, mean in enumerate(means):
        chances[2 + i] = -np.expm1(-dt / mean)
    wanders = s.nose_random_walk * np.sqrt(dt), s.nose_about_course, np.exp(-dt / s.slack_time)
    keeps = np.exp(-dt / s.intensity_time)
    return Changes(chances, keeps, s.intensity, s.nose_rate, lognormal_of(s), wanders)


@kernel(**MAKING)
def _interval(s, biases, dt, moved):
    """Return the motion in `dt` seconds.

    What the step adds is in proportion to the range that a heading implies (`motion.Noise`)."""
    k = biases.shape[0]
    decay, fixed, broad, range_ = np.empty(3 + k), np.zeros(N + k), np.zeros((3, N)), np.zeros(N)
    decay[0], decay[1] = np.exp(-dt / s.acceleration_time), np.exp(-dt / s.bank_time)
    decay[2] = np.exp(-dt / s.stretch_time)
    new = 1.0 - decay[2] * decay[2]
    for i in range(3):
        fixed[RX + i], fixed[VX + i] = 1e-8, 2.0 * dt / s.own_velocity_time * s.own_velocity**2
        range_[RX + i] = 2.0 * dt / s.misalignment_time * (s.misalignment[2 if i < 2 else 0] ** 2)
        for regime in range(3):
            if regime != HOVERING:
                of_axis = HORIZONTAL[i] * s.acceleration_random_walk[0 if regime == STEADY else 1]
                broad[regime, AX + i], broad[regime, VX + i] = dt * of_axis**2, dt * s.velocity_random_walk**2
    fixed[WING_SCALE_ERROR] = s.stretch**2 * new
    for regime in range(3):
        broad[regime, BANK_ERROR] = s.bank**2 * (1.0 - decay[1] * decay[1])
        for i in range(TILT_NORTH, WING_SCALE_ERROR):
            fixed[i], broad[regime, i] = 1e-10, dt * s.lean_random_walk**2
    for i in range(k):
        decay[3 + i] = np.exp(-dt / biases[i, 1])
        fixed[N + i] = biases[i, 0] * (1.0 - decay[3 + i] * decay[3 + i])
    noise = Noise(fixed, broad, range_, s.nose_wobble**2 * new, np.log(s.size))
    v, a = np.exp(-dt / s.hover_time), np.exp(-dt / s.hover_acceleration_time)
    hover = Hover(v, a, s.hover_speed**2 * (1.0 - v * v), s.hover_acceleration**2 * (1.0 - a * a))
    return Interval(dt, moved, noise, hover, decay)


@kernel(**FILLING)
def _visible_fraction(heading, x, edge_on_visibility):
    """The fraction that is seen of a level wing of a leader with the mean x (N,)."""
    return np.sqrt(
        visible2(heading, x[RX], x[RY], x[RX] * x[RX] + x[RY] * x[RY] + x[RZ] * x[RZ], edge_on_visibility)
    )


@kernel(**FILLING)
def _rescale(ratio, x, P, dt, moved, hovers):
    """Give a particle another heading, in place.

    The one that is supposed may be wrong after all. Seen so, the same images are those of a leader that is nearer
    or farther by a `ratio`, and moves in proportion; one that hovers stands still there, too."""
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


@kernel(**MAKING)
def _propose_heading(heading, other, x, P, passed, hovers, drags, chance):
    """Give a particle another heading, and the second of two `drags`, in place; False if it keeps what it has, as
    the tilt is unlikely that its wing's slope needs then (Metropolis and Hastings, with the logarithm of a
    `chance`). The narrower a wing looks, the steeper its slope for the same bank: the density of slopes is lower
    by that factor. Of what shows no slope, or does not tilt, each heading is as likely."""
    dt, moved, wind = passed.dt, passed.moved, passed.wind
    if not passed.tilts:
        if not passed.metric:
            before = _visible_fraction(heading, x, passed.edge_on_visibility)
            _rescale(_visible_fraction(other, x, passed.edge_on_visibility) / before, x, P, dt, moved, hovers)
        return True
    was, of_it = x.copy(), P.copy()
    slope, before = slope_of(heading, x), likely(heading, x, P, drags[0], wind, 0.0)
    if not passed.metric:
        _rescale(banked(slope, other, x)[1] / banked(slope, heading, x)[1], x, P, dt, moved, hovers)
    retilt(slope, heading, other, x, P, drags[1], wind)
    narrower = np.log(abs(appears(other, x)[0] / appears(heading, x)[0]))
    if chance <= likely(other, x, P, drags[1], wind, 0.0) - before + narrower:
        return True
    x[:], P[:, :] = was, of_it
    return False


@kernel(**FILLING)
def _next_regime(regime, x, P, drawn, steadies, begins, hovers, leaves):
    """The regime after a step, by a number that is `drawn` from (0, 1).

    Only a slow leader begins to hover."""
    if regime == HOVERING:
        return (
            ACCELERATING
            if drawn < leaves or x[VX] * x[VX] + x[VY] * x[VY] > given.MAX_HOVER_SPEED_SQUARED
            else HOVERING
        )
    speed2 = (x[VX] * x[VX] + x[VY] * x[VY]) / (given.MIN_SPEED_SQUARED + P[VX, VX] + P[VY, VY])
    if drawn > 1.0 - hovers * np.exp(-0.5 * speed2):
        return HOVERING
    if regime == ACCELERATING:
        return STEADY if drawn < steadies else ACCELERATING
    return ACCELERATING if drawn < begins else STEADY


@kernel(**FILLING)
def _next_turn_rate(rate, drawn, stops, turns, new):
    """At which a heading is turned after a step, by a number that is `drawn` from (0, 1)."""
    if rate != 0.0:
        return 0.0 if drawn < stops else rate
    return new if drawn < turns else 0.0


@kernel(**FILLING)
def _course_locked_heading(heading, aside, x, dt, moved, edge_on_visibility):
    """The heading so far `aside`, rad, of the course that the leader would have with that heading: its range and
    velocity depend on it."""
    other = course_of(x) + aside
    aside += course_of(x) - np.arctan2(x[VY], x[VX])
    for _ in range(given.COURSE_ITERATIONS):
        ratio = _visible_fraction(other, x, edge_on_visibility) / _visible_fraction(heading, x, edge_on_visibility)
        u = ratio * x[VX] + (1.0 - ratio) * moved[0] / dt
        v = ratio * x[VY] + (1.0 - ratio) * moved[1] / dt
        other = np.arctan2(v, u) + aside
    return other


@kernel(**FILLING)
def _next_course_lock(course_locked, x, regime, drawn, which, decides, doubted, unties, ties, anew):
    """Whether a heading is locked to its course after a step, whether it is from now on, and whether it is
    doubted, by numbers that are `drawn` from (0, 1). Of a slow leader that is undecided."""
    speed2 = x[VX] * x[VX] + x[VY] * x[VY]
    if ties > 0.0 and (regime == HOVERING or speed2 < given.COURSE_UNLOCK_SPEED_SQUARED):
        course_locked = UNDECIDED
    if course_locked == COURSE_LOCKED and drawn >= unties:
        return COURSE_LOCKED, False, False
    fast = speed2 * speed2 / (speed2 * speed2 + given.FOLLOWING_SPEED_POWER4)
    if course_locked == UNDECIDED and drawn > 1.0 - decides * fast:
        return (COURSE_LOCKED, True, False) if which < ties else (FREE, False, False)
    if course_locked == COURSE_LOCKED or drawn < doubted:
        if which < anew * fast and course_locked != UNDECIDED:
            return COURSE_LOCKED, True, False
        return min(course_locked, FREE), False, True
    return course_locked, False, False


@kernel(**MAKING)
def _draw_changes(k, particles, draws, changes, passed):
    """Let chance change a particle, in place, by the random numbers from `draws` on."""
    headings, rates, regimes, means, P, intensities, course_locked, drags, _ = particles
    turns_for, still_for, steadies, begins, hovers, leaves, doubted, unties, decides, ties, anew = changes.chances
    keeps, spread, slack, drag = changes.keeps, changes.intensity, changes.wanders[1], changes.drag
    dt, x = passed.dt, means[k]
    restless = np.exp(intensities[k, 2])
    stops, turns = -np.expm1(-dt * np.sqrt(restless) / turns_for), -np.expm1(-dt * restless**2 / still_for)
    new_rate = 0.0
    of_turning = uniform_of(draws + OF_TURNING, k)
    if rates[k] == 0.0 and of_turning < turns:
        new_rate = changes.nose_rate * restless * normal_of(draws + OF_TURN_RATE, k)
    rates[k] = _next_turn_rate(rates[k], of_turning, stops, turns, new_rate)
    for i in range(3):
        bold = normal_of(draws + OF_INTENSITIES[i], k) if spread[i] > 0.0 else 0.0
        new = spread[i] * np.sqrt(1.0 - keeps * keeps) * bold
        intensities[k, i] = keeps * intensities[k, i] + new
    of_speed = uniform_of(draws + OF_REGIME, k)
    regimes[k] = _next_regime(regimes[k], x, P[k], of_speed, steadies, begins, hovers, leaves)
    locked_before = course_locked[k]
    course_locked[k], becomes_locked, doubts = _next_course_lock(
        *(course_locked[k], x, regimes[k], uniform_of(draws + OF_RESAMPLED_HEADING, k)),
        *(uniform_of(draws + OF_TYING, k), decides, doubted, unties, ties, anew),
    )
    if not (becomes_locked or doubts):
        return
    other = headings[k] + np.pi * uniform_of(draws + OF_HEADING, k)
    of_heading = spread[2] * normal_of(draws + OF_NEW_WOBBLE, k)
    if becomes_locked:
        aside = slack * np.exp(of_heading) * normal_of(draws + OF_SLACK, k)
        other = _course_locked_heading(headings[k], aside, x, dt, passed.moved, passed.edge_on_visibility)
        rates[k] = 0.0
    new_drag = drag[0] * np.exp(drag[1] * normal_of(draws + OF_DRAG, k))
    accepted = uniform_of(draws + OF_ACCEPTANCE, k)
    hovering, both = regimes[k] == HOVERING, (drags[k], new_drag)
    if _propose_heading(headings[k], other, x, P[k], passed, hovering, both, np.log(accepted)):
        drags[k] = new_drag
        intensities[k, 2] = of_heading
    else:
        other, course_locked[k] = headings[k], locked_before
    headings[k] = other


@kernel(**FILLING)
def _diffuse_heading(k, particles, draws, wanders, passed):
    """Turn a heading, in place. One that is locked to its course wanders about it."""
    headings, x = particles.headings, particles.means[k]
    walk, sigma, keeps = wanders
    broad = _visible_fraction(headings[k], x, passed.edge_on_visibility)
    # the less is seen of the wing, the more does it show of a small turn
    restless = np.exp(particles.intensities[k, 2])
    far = walk * restless * min(1.0, broad / np.sqrt(max(1.0 - broad * broad, 1e-9)))
    turned = passed.dt * particles.rates[k]
    if particles.course_locked[k] == COURSE_LOCKED:
        aside = headings[k] - course_of(x)
        aside -= 2.0 * np.pi * np.rint(aside / (2.0 * np.pi))
        turned, far = aside * (keeps - 1.0), sigma * restless * np.sqrt(1.0 - keeps * keeps)
    headings[k] += turned + far * normal_of(draws + OF_WANDERING, k)


@kernel(**FILLING)
def _log_prior(k, particles, passed):
    """The logarithm of the likelihood of a particle's tilt, and of its mean bank error."""
    if not passed.tilts:
        return 0.0
    headings, _, _, means, P, _, _, drags, mean_bank_error = particles
    return plausible(headings[k], means[k], P[k], drags[k], mean_bank_error[k], passed.wind, passed.bank_sigma)


@kernel((PARTICLE_ARRAYS, HEADINGS, UNSIGNED, MODEL, ROWS, BOOL, PASSED), **MAKING)
def step(particles, log_weights, draws, s, biases, heading_observed, passed):
    """Predict particles of a leader `s`, whose `biases` (k, 2) have these variances and correlation times, in
    place; their log weights (K,) after it."""
    changes, interval = _changes(s, passed.dt, heading_observed), _interval(s, biases, passed.dt, passed.moved)
    found = log_weights.copy()
    for k in range(found.shape[0]):
        _draw_changes(k, particles, draws, changes, passed)
        found[k] -= _log_prior(k, particles, passed)
        _diffuse_heading(k, particles, draws, changes.wanders, passed)
        fly_on(k, particles, interval, passed.edge_on_visibility)
        found[k] += _log_prior(k, particles, passed)
    normalise(found)
    return found


@kernel((PARTICLE_ARRAYS, PARTICLE_ARRAYS, HEADINGS, HEADINGS, NUMBER, PASSED), **MAKING)
def weigh(before, after, log_weights, log_l, believed, passed):
    """The log weights (K,) of particles after a measurement, of which the logarithms of the likelihoods (K,) are
    `believed`, from 0 to 1; what it makes of their tilts, and of their mean bank errors, counts in full."""
    found = log_weights + evidence(log_l, believed)
    for k in range(found.shape[0]):
        found[k] += _log_prior(k, after, passed) - _log_prior(k, before, passed)
    normalise(found)
    return found
