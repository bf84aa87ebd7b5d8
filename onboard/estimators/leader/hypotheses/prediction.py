"""What a step makes of a cloud of noses. Each leader flies on, and chance changes it: a nose begins to turn
or stops, a leader begins to accelerate or stops, a few particles take another nose, and all noses wander."""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import NoseModel
from onboard.estimators.leader.hypotheses import leaning
from onboard.estimators.leader.hypotheses import wing as model
from onboard.estimators.leader.hypotheses.cloud import ARRAYS, Bias, Cloud, charged, named
from onboard.estimators.leader.hypotheses.draws import DRAW, normal_of, uniform_of
from onboard.estimators.leader.hypotheses.leaning import banked, lean, likely, lognormal, slope_of
from onboard.estimators.leader.hypotheses.wing import (
    ACCELERATING,
    ACCELERATION,
    BANK_ERROR,
    COVARIANCES,
    FOLLOWS4,
    FREE,
    HOVERING,
    LEAN,
    LEAST_VISIBLE,
    NOSES,
    NUMBER,
    POSITION,
    SLOW2,
    STEADY,
    STRETCH,
    TIED,
    UNDECIDED,
    VELOCITY,
    N,
    course_of,
    visible2,
)
from onboard.filters.compiled import OUT, VECTOR

CIRCLES: Final = 5  # of a computation: a nose, the range that it implies, the course at that range
MOST_CRAB: Final = 2.5  # standard deviations of a fixed wing's nose about its course
APART: Final = 1 << 40  # added to the number of a draw, for a stream of its own
LETS_GO2: Final = 9.0  # (m/s)^2: a slower leader's nose is not tied to its course
DRIFTS2: Final = 0.16  # (m/s)^2: a faster leader does not hover
DRAWS: Final = 8  # streams of random numbers that a step uses
SURE: Final = 10.0  # times as long until a particle takes another nose, where points show the nose
MOST_COST: Final = 20.0  # of what a hypothesis supposes: it is improbable enough then
HORIZONTAL: Final = np.array([1.0, 1.0, 0.5])  # vertical accelerations are half as large


def predict(settings: NoseModel, cloud: Cloud, dt: float, moved: Array) -> Cloud:
    """The cloud after `dt` seconds in which we move by `moved` (3,) m, in n."""
    s = settings
    changed: list[Any] = [array.copy() for array in cloud[: ARRAYS - 1]]  # type: ignore[union-attr]
    sure = SURE if cloud.sided else 1.0
    doubted_after = sure * s.doubted_after
    change(
        s,
        changed,
        cloud.draws,
        dt,
        moved,
        doubted_after=doubted_after,
        edge_on=cloud.edge_on,
        metric=cloud.metric,
    )
    noses, rates, regimes, means, P, intensities, tied, drags = changed
    lasts = [bias.time for bias in cloud.biases]
    times = np.array([s.acceleration_time, s.bank_time, s.stretch_time, *lasts])
    noise, decay = _noise(s, dt, cloud.biases), np.exp(-dt / times)
    after = cloud._replace(**named(changed), draws=cloud.draws + DRAWS, unseen=cloud.unseen + dt)
    before = supposed(s, after)
    walk = s.nose_random_walk * math.sqrt(dt)
    turning = noses, rates, means, tied, cloud.draws, dt, walk, s.nose_about_course, cloud.edge_on, np.array(s.air)
    _wander(*turning)
    interval = model.Interval(dt, moved, noise, _hover(s, dt), decay)
    course = model.Course(tied, s.air, cloud.edge_on)
    model.predict(means, P, noses, regimes, intensities, drags, interval, course)
    return charged(after, supposed(s, after) - before)


def supposed(s: NoseModel, cloud: Cloud) -> Array:
    """Logarithms of the likelihoods (K,) of the leans, and of the banks that have lasted. Whatever an image makes
    of them counts in full: a hypothesis may suppose any, and not get one for nothing where few images count. One
    that takes another nose has paid: it is accepted by the same likelihood."""
    if s.drag == 0.0 or cloud.edge_on > LEAST_VISIBLE:
        return np.zeros(len(cloud.noses))
    arrays = cloud.noses, cloud.means, cloud.covariances, cloud.drags, cloud.rolled
    found: Array = leaning.plausible(*arrays, s.wind, s.rolled, MOST_COST)
    return found


def _hover(s: NoseModel, dt: float) -> model.Hover:
    velocity, acceleration = math.exp(-dt / s.hover_time), math.exp(-dt / s.hover_acceleration_time)
    return model.Hover(
        velocity,
        acceleration,
        s.hover_speed**2 * (1.0 - velocity**2),
        s.hover_acceleration**2 * (1.0 - acceleration**2),
    )


def _noise(s: NoseModel, dt: float, biases: tuple[Bias, ...]) -> model.Noise:
    """What `dt` seconds add, in proportion to the range that a nose implies (`wing.Noise`)."""
    per_second = _densities(s)
    new, of_bank = -math.expm1(-2.0 * dt / s.stretch_time), s.bank**2 * -math.expm1(-2.0 * dt / s.bank_time)
    fixed = np.zeros(N + len(biases))
    fixed[N:] = [bias.sigma**2 * -math.expm1(-2.0 * dt / bias.time) for bias in biases]
    fixed[POSITION], fixed[VELOCITY], fixed[LEAN] = 1e-8, 2.0 * dt / s.own_velocity_time * s.own_velocity**2, 1e-10
    fixed[STRETCH] = s.stretch**2 * new
    broad = per_second.broad * dt
    broad[:, BANK_ERROR] = of_bank
    range_ = 2.0 * dt / s.misalignment_time * per_second.range_
    return model.Noise(fixed, broad, range_, s.nose_wobble**2 * new, math.log(s.size))


class Densities(NamedTuple):
    """Of the noise of a step (`wing.Noise`), what grows with its duration: `broad`, each second,
    and `range_`, over half of the time of the misalignment."""

    broad: Array
    range_: Array


@lru_cache(maxsize=64)
def _densities(s: NoseModel) -> Densities:
    broad, range_ = np.zeros((3, N)), np.zeros(N)
    range_[POSITION] = np.square(s.misalignment)[[2, 2, 0]]
    broad[:2, VELOCITY], broad[:, LEAN] = s.velocity_random_walk**2, s.lean_random_walk**2
    broad[:2, ACCELERATION] = np.outer(np.square(s.acceleration_random_walk), HORIZONTAL**2)
    return Densities(broad, range_)


def change(
    s: NoseModel,
    arrays: Iterable[Array],
    draws: int,
    dt: float,
    moved: Array,
    *,
    doubted_after: float,
    edge_on: float,
    metric: bool,
) -> None:
    """Change the arrays of a `cloud.Cloud` in place, by the random numbers from `draws` on. In
    `dt` seconds we move by `moved` (3,) m, in n; a particle keeps its nose for `doubted_after` seconds on average;
    `edge_on` as in `wing.visible`; `metric`: whether the ranges do not depend on the noses."""
    flies_for = s.flies_for if s.crab == 0.0 else math.inf  # a fixed wing cannot hover
    means_of = (s.turns_for, s.still_for, s.accelerates_for, s.steady_for, flies_for, s.hovers_for, doubted_after)
    chances = [-math.expm1(-dt / mean) for mean in (*means_of, s.tied_for, s.undecided_for)]
    # of the noses that are looked at anew, so many are tied that the share of all stays what it is
    anew = s.tied * doubted_after / (s.tied * doubted_after + (1.0 - s.tied) * s.tied_for)
    # in one step: a nose stops or begins to turn, a leader stops or begins to accelerate, to hover, leaves, a
    # particle takes another nose, or one that is tied does, a fast leader's nose is tied or not; and it is tied
    arguments: tuple[Any, ...] = (
        *arrays,
        draws,
        np.array([*chances, s.tied, anew]),
        np.array(s.intensity),
        np.array([math.exp(-dt / s.intensity_time), s.nose_rate, s.crab, s.nose_about_course]),
        np.array(s.air),
        s.wind,
        dt,
        moved,
        edge_on,
        metric,
        np.array(lognormal(s)),
    )
    _change(*arguments)


@njit(cache=True, error_model="numpy")
def _fraction(nose, x, edge_on):
    """The fraction that is seen of a level wing of a leader with the mean x (N,)."""
    return np.sqrt(visible2(nose, x[0], x[1], x[0] * x[0] + x[1] * x[1] + x[2] * x[2], edge_on))


@njit(cache=True, error_model="numpy")
def _doubt(ratio, x, P, dt, moved, hovers):
    """Give a particle another nose, in place: the one that is supposed may be wrong after all. Seen so, the same
    images are those of a leader that is nearer or farther by a `ratio`, and moves in proportion; one that hovers
    stands still there, too."""
    scaled = 3 if hovers else BANK_ERROR + 1
    for i in range(x.shape[0]):
        scale = ratio if i < scaled else 1.0
        x[i] *= scale
        for j in range(x.shape[0]):
            P[i, j] *= scale * (ratio if j < scaled else 1.0)
    if hovers:
        return
    for i in range(3):
        x[3 + i] += (1.0 - ratio) * moved[i] / dt


class Passed(NamedTuple):
    """What has passed since the last step, seconds and our own way (3,) m; what is seen along a nose
    (`wing.visible`); whether ranges are metric; and the standard deviation of the wind, m/s."""

    dt: float
    moved: Array
    edge_on: float
    metric: bool
    wind: float


@njit(cache=True, error_model="numpy")
def _takes(nose, other, x, P, passed, hovers, drags, chance):
    """Give a particle another nose, and the second of two `drags`, in place; False if it keeps what it has, as the
    lean is unlikely that its wing's slope needs then (Metropolis and Hastings, with the logarithm of a `chance`).
    Of what shows no slope, or does not lean, each nose is as likely."""
    dt, moved, edge_on, metric, wind = passed
    if drags[0] == 0.0 or edge_on > LEAST_VISIBLE:
        if not metric:
            _doubt(_fraction(other, x, edge_on) / _fraction(nose, x, edge_on), x, P, dt, moved, hovers)
        return True
    was, of_it = x.copy(), P.copy()
    slope, before = slope_of(nose, x), likely(nose, x, P, drags[0], wind, 0.0)
    if not metric:
        _doubt(banked(slope, other, x)[1] / banked(slope, nose, x)[1], x, P, dt, moved, hovers)
    lean(slope, nose, other, x, P, drags[1], wind)
    if chance <= likely(other, x, P, drags[1], wind, 0.0) - before:
        return True
    x[:], P[:, :] = was, of_it
    return False


@njit(cache=True, error_model="numpy")
def _next(regime, x, P, drawn, steadies, begins, hovers, leaves):
    """The regime after a step, by a number that is `drawn` from (0, 1). Only a slow leader begins to hover."""
    if regime == HOVERING:
        return ACCELERATING if drawn < leaves or x[3] * x[3] + x[4] * x[4] > DRIFTS2 else HOVERING
    speed2 = (x[3] * x[3] + x[4] * x[4]) / (SLOW2 + P[3, 3] + P[4, 4])
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
    for _ in range(CIRCLES):
        ratio = _fraction(other, x, edge_on) / _fraction(nose, x, edge_on)
        u = ratio * x[3] + (1.0 - ratio) * moved[0] / dt
        v = ratio * x[4] + (1.0 - ratio) * moved[1] / dt
        other = np.arctan2(v - air[1], u - air[0]) + aside
    return other


@njit(cache=True, error_model="numpy")
def _decided(tied, x, regime, drawn, which, decides, doubted, unties, ties, anew):
    """Whether a nose is tied to its course after a step, whether it is from now on, and whether it is doubted, by
    numbers that are `drawn` from (0, 1). Of a slow leader that is undecided."""
    speed2 = x[3] * x[3] + x[4] * x[4]
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


@njit(
    (
        *(NOSES, NOSES, NOSES, OUT, COVARIANCES, OUT, NOSES, NOSES, DRAW, *[VECTOR] * 4),
        *(NUMBER, NUMBER, VECTOR, NUMBER, types.boolean, VECTOR),
    ),
    cache=True,
    error_model="numpy",
)
def _change(
    noses,
    rates,
    regimes,
    means,
    P,
    intensities,
    tied,
    drags,
    draws,
    chances,
    spread,
    slow,
    air,
    wind,
    dt,
    moved,
    edge_on,
    metric,
    drag,
):
    keeps, nose_rate, crab, slack = slow
    stops, turns, steadies, begins, hovers, leaves, doubted, unties, decides, ties, anew = chances
    passed = Passed(dt, moved, edge_on, metric, wind)
    of_drag, of_accepting, of_wobble, of_tying = 2 * APART, 3 * APART, 4 * APART, APART + 6
    of_slack = 5 * APART
    for k in range(noses.shape[0]):
        x = means[k]
        new_rate = 0.0
        of_turning = uniform_of(draws, k)
        if rates[k] == 0.0 and of_turning < turns:
            new_rate = nose_rate * normal_of(np.uint64(draws + 1), k)
        rates[k] = _rate(rates[k], of_turning, stops, turns, new_rate)
        for i in range(3):
            bold = normal_of(np.uint64(draws + APART + 2 * i), k) if spread[i] > 0.0 else 0.0
            new = spread[i] * np.sqrt(1.0 - keeps * keeps) * bold
            intensities[k, i] = keeps * intensities[k, i] + new
        of_speed = uniform_of(np.uint64(draws + 3), k)
        regimes[k] = _next(regimes[k], x, P[k], of_speed, steadies, begins, hovers, leaves)
        tied_before = tied[k]
        tied[k], becomes_tied, doubts = _decided(
            *(tied[k], x, regimes[k], uniform_of(np.uint64(draws + 6), k)),
            *(uniform_of(np.uint64(draws + of_tying), k), decides, doubted, unties, ties, anew),
        )
        if becomes_tied or doubts:
            where = uniform_of(np.uint64(draws + 7), k)
            other = noses[k] + np.pi * where
            if becomes_tied:
                aside = slack * normal_of(np.uint64(draws + of_slack), k)
                other, rates[k] = _tied_nose(noses[k], aside, x, dt, moved, edge_on, air), 0.0
            elif crab > 0.0:  # a fixed wing's nose stays about its course
                other = np.arctan2(x[4], x[3]) + crab * MOST_CRAB * (2.0 * where - 1.0)
            new_drag = drag[0] * np.exp(drag[1] * normal_of(np.uint64(draws + of_drag), k))
            accepted = uniform_of(np.uint64(draws + of_accepting), k)
            hovering, both = regimes[k] == HOVERING, (drags[k], new_drag)
            if _takes(noses[k], other, x, P[k], passed, hovering, both, np.log(accepted)):
                drags[k] = new_drag
                intensities[k, 2] = spread[2] * normal_of(np.uint64(draws + of_wobble), k)
            else:
                other, tied[k] = noses[k], tied_before
            noses[k] = other


@njit(
    (NOSES, VECTOR, OUT, VECTOR, DRAW, NUMBER, NUMBER, NUMBER, NUMBER, VECTOR),
    cache=True,
    error_model="numpy",
)
def _wander(noses, rates, means, tied, draws, dt, walk, slack, edge_on, air):
    """Turn the noses (K,) in place. One that is tied to its course wanders about it, `slack` away at one sigma."""
    for k in range(noses.shape[0]):
        x = means[k]
        broad = _fraction(noses[k], x, edge_on)
        # the less is seen of the wing, the more does it show of a small turn
        step = walk * min(1.0, broad / np.sqrt(max(1.0 - broad * broad, 1e-9)))
        turned = dt * rates[k]
        if tied[k] == TIED:
            aside = noses[k] - course_of(x, air)
            aside -= 2.0 * np.pi * np.rint(aside / (2.0 * np.pi))
            turned = aside * (np.sqrt(max(1.0 - (step / slack) ** 2, 0.0)) - 1.0)
        noses[k] += turned + step * normal_of(np.uint64(draws + 4), k)
