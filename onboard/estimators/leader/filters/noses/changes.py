"""What chance changes in a cloud of noses from one image to the next: a nose begins to turn or stops, a leader
begins to accelerate or stops, a few particles take another nose, and all noses wander."""

import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.filters.noses.draws import DRAW, normals, uniforms
from onboard.estimators.leader.settings import NoseModel
from onboard.filters.compiled import OUT, VECTOR
from onboard.models.apparent_wing import (
    ACCELERATING,
    BANK_ERROR,
    COVARIANCES,
    HOVERING,
    NOSES,
    NUMBER,
    SLOW2,
    STEADY,
    N,
    visible2,
)

MOST_CRAB: Final = 2.5  # standard deviations of a fixed wing's nose about its course
APART: Final = 1 << 40  # added to the number of a draw, for a stream of its own
DRAWS: Final = 8  # streams of random numbers that a step uses


class Chances(NamedTuple):
    """The probabilities, in one step, that a nose stops or begins to turn, that a leader stops or begins to
    accelerate, that one that is slow begins to hover, that one that hovers leaves, and that a particle takes
    another nose."""

    stops: float
    turns: float
    steadies: float
    accelerates: float
    hovers: float
    leaves: float
    doubted: float


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
    `edge_on` as in `apparent_wing.visible`; `metric`: whether the ranges do not depend on the noses."""
    flies_for = s.flies_for if s.crab == 0.0 else math.inf  # a fixed wing cannot hover
    means_of = (s.turns_for, s.still_for, s.accelerates_for, s.steady_for, flies_for, s.hovers_for, doubted_after)
    chances = Chances(*(-math.expm1(-dt / mean) for mean in means_of))
    wander = s.nose_random_walk * math.sqrt(dt)
    arguments: tuple[Any, ...] = (
        *arrays,
        draws,
        *chances,
        np.array(s.intensity),
        math.exp(-dt / s.intensity_time),
        s.nose_rate,
        wander,
        s.crab,
        dt,
        moved,
        edge_on,
        metric,
    )
    _change(*arguments)


@njit(cache=True, error_model="numpy")
def _fraction(nose, x, edge_on):  # type: ignore[no-untyped-def]
    """The fraction that is seen of a level wing of a leader with the mean x (N,)."""
    return np.sqrt(visible2(nose, x[0], x[1], x[0] * x[0] + x[1] * x[1] + x[2] * x[2], edge_on))


@njit(cache=True, error_model="numpy")
def _doubt(nose, other, x, P, dt, moved, edge_on, hovers):  # type: ignore[no-untyped-def]
    """Give a particle another nose, in place: the one that is supposed may be wrong after all. Seen so, the same
    images are those of a leader that is nearer or farther, and moves in proportion; one that hovers stands still
    there, too."""
    ratio = _fraction(other, x, edge_on) / _fraction(nose, x, edge_on)
    scaled = 3 if hovers else BANK_ERROR + 1
    for i in range(N):
        scale = ratio if i < scaled else 1.0
        x[i] *= scale
        for j in range(N):
            P[i, j] *= scale * (ratio if j < scaled else 1.0)
    if hovers:
        return
    for i in range(3):
        x[3 + i] += (1.0 - ratio) * moved[i] / dt


@njit(cache=True, error_model="numpy")
def _next(regime, x, P, drawn, steadies, begins, hovers, leaves):  # type: ignore[no-untyped-def]
    """The regime after a step, by a number that is `drawn` from (0, 1). Only a slow leader begins to hover."""
    if regime == HOVERING:
        return ACCELERATING if drawn < leaves else HOVERING
    speed2 = (x[3] * x[3] + x[4] * x[4]) / (SLOW2 + P[3, 3] + P[4, 4])
    if drawn > 1.0 - hovers * np.exp(-0.5 * speed2):
        return HOVERING
    if regime == ACCELERATING:
        return STEADY if drawn < steadies else ACCELERATING
    return ACCELERATING if drawn < begins else STEADY


@njit(
    (
        *(NOSES, NOSES, NOSES, OUT, COVARIANCES, OUT, DRAW, *[NUMBER] * 7, VECTOR, *[NUMBER] * 5, VECTOR),
        *(NUMBER, types.boolean),
    ),
    cache=True,
    error_model="numpy",
)
def _change(  # type: ignore[no-untyped-def]
    noses,
    rates,
    regimes,
    means,
    P,
    intensities,
    draws,
    stops,
    turns,
    steadies,
    begins,
    hovers,
    leaves,
    doubted,
    spread,
    keeps,
    nose_rate,
    wander,
    crab,
    dt,
    moved,
    edge_on,
    metric,
):
    count = noses.shape[0]
    of_turning, turn = uniforms(draws, count), normals(np.uint64(draws + 1), count)
    of_speed, walk = uniforms(np.uint64(draws + 3), count), normals(np.uint64(draws + 4), count)
    of_doubt, where = uniforms(np.uint64(draws + 6), count), uniforms(np.uint64(draws + 7), count)
    bold = np.zeros((3, count))
    for i in range(3):
        if spread[i] > 0.0:
            bold[i] = normals(np.uint64(draws + APART + 2 * i), count)
    for k in range(count):
        x = means[k]
        if rates[k] != 0.0:
            rates[k] = 0.0 if of_turning[k] < stops else rates[k]
        elif of_turning[k] < turns:
            rates[k] = nose_rate * turn[k]
        for i in range(3):
            new = spread[i] * np.sqrt(1.0 - keeps * keeps) * bold[i, k]
            intensities[k, i] = keeps * intensities[k, i] + new
        regimes[k] = _next(regimes[k], x, P[k], of_speed[k], steadies, begins, hovers, leaves)
        if of_doubt[k] < doubted:
            other = noses[k] + np.pi * where[k]
            if crab > 0.0:  # a fixed wing's nose stays about its course
                other = np.arctan2(x[4], x[3]) + crab * MOST_CRAB * (2.0 * where[k] - 1.0)
            if not metric:
                _doubt(noses[k], other, x, P[k], dt, moved, edge_on, regimes[k] == HOVERING)
            noses[k] = other
        broad = _fraction(noses[k], x, edge_on)
        # the less is seen of the wing, the more does it show of a small turn
        wanders = wander * min(1.0, broad / np.sqrt(max(1.0 - broad * broad, 1e-9)))
        noses[k] += dt * rates[k] + wanders * walk[k]
