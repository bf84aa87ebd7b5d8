"""How a multirotor leans against the air, and what its wing shows of that: what another nose means for a lean.

A wing slopes in the image by its bank, the more steeply the less is seen of its length. So each nose needs another
lean to explain the same slope, and how likely that lean is, by drag times airspeed in an unknown wind, is evidence
of the nose. No hypothesis explains a slope for nothing.
"""

import math
from typing import Final

import numpy as np
from numba import njit

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import NoseModel
from onboard.estimators.leader.hypotheses.draws import normal
from onboard.estimators.leader.hypotheses.motion import (
    AX,
    AY,
    AZ,
    BANK_ERROR,
    LEAN_EAST,
    LEAN_NORTH,
    LEAST_VISIBLE,
    NUMBER,
    RX,
    RY,
    RZ,
    VX,
    VY,
    G,
)
from onboard.filters.compiled import CUBE, OUT, VECTOR

OF_LEAN2: Final = 0.01  # (m/s^2)^2: the variance of a lean of one that has no drag
LEANS2: Final = 12.0  # (m/s^2)^2: of any multirotor's steady lean, on each axis; 20 degrees are one sigma
MOST_COST: Final = 20.0  # of what a hypothesis supposes: it is improbable enough then
TINY: Final = 1e-9  # in place of 0/0: of the distance straight above us, m, and of a wing that shows no width


def lognormal(s: NoseModel) -> tuple[float, float]:
    """Of the drag: the median, 1/s, and the standard deviation of the logarithm."""
    if s.drag == 0.0:
        return 0.0, 0.0
    variance = math.log1p((s.drag_sigma / s.drag) ** 2)
    return s.drag * math.exp(-0.5 * variance), math.sqrt(variance)


def drags_of(s: NoseModel, draw: int | np.uint64, count: int) -> Array:
    """Drags (count,), 1/s, a fixed function of `draw`."""
    middle, sigma = lognormal(s)
    found: Array = middle * np.exp(sigma * normal(draw, count))
    return found


@njit(cache=True, error_model="numpy")
def appears(nose, x):
    """What is seen of a wing with that nose, per length: to the right and down of a level one, down of one on its
    side. `x` begins with its place (3,) m."""
    level = np.sqrt(x[RX] * x[RX] + x[RY] * x[RY]) + TINY
    range_ = np.sqrt(level * level + x[RZ] * x[RZ])
    right = (np.cos(nose) * x[RX] + np.sin(nose) * x[RY]) / level
    down = (np.sin(nose) * x[RX] - np.cos(nose) * x[RY]) / level * x[RZ] / range_
    # from above or below, one that points at us shows its length, and needs no tip
    least = np.sqrt(max(LEAST_VISIBLE * LEAST_VISIBLE - down * down, TINY * TINY))
    return right if abs(right) > least else math.copysign(least, right), down, level / range_


@njit(cache=True, error_model="numpy")
def slope_of(nose, x):
    """Of the wing in the image."""
    right, down, upright = appears(nose, x)
    across = (x[AY] + x[LEAN_EAST]) * np.cos(nose) - (x[AX] + x[LEAN_NORTH]) * np.sin(nose)
    return (down + np.tan(np.arctan2(across, G - x[AZ]) + x[BANK_ERROR]) * upright) / right


@njit(cache=True, error_model="numpy")
def banked(slope, nose, x):
    """The bank with which a wing with that nose has that slope, rad, and its length in the image per length."""
    right, down, upright = appears(nose, x)
    bank = np.arctan((slope * right - down) / upright)
    return bank, abs(right) * np.cos(bank) * np.sqrt(1.0 + slope * slope)


@njit(cache=True, error_model="numpy")
def likely(nose, x, P, drag, wind, more):
    """The logarithm of the likelihood of a lean across that nose, of which `more` is the variance beside that of
    an airspeed in an unknown wind."""
    c, s = np.cos(nose), np.sin(nose)
    across = x[LEAN_EAST] * c - x[LEAN_NORTH] * s
    off = across - drag * (x[VY] * c - x[VX] * s)
    speeds = P[VY, VY] * c * c - 2.0 * P[VX, VY] * c * s + P[VX, VX] * s * s
    variance = drag * drag * (wind * wind + speeds) + OF_LEAN2 + more
    return -0.5 * (off * off / variance + np.log(variance) + across * across / LEANS2)


@njit(cache=True, error_model="numpy")
def plausible(nose, x, P, drag, rolled, wind, rolls):
    """The logarithm of the likelihood of the lean that a hypothesis has come to suppose, and of a mean of its
    bank's errors that has `rolled` by a standard deviation of `rolls`; -MOST_COST at least."""
    by = rolled / rolls
    return max(likely(nose, x, P, drag, wind, 0.0) - 0.5 * (by * by), -MOST_COST)


@njit(cache=True, error_model="numpy")
def lean(slope, nose, other, x, P, drag, wind):
    """Lean a leader with another nose so that its wing has that slope, in place. Along its nose, which no image
    shows, it leans as its drag lets it."""
    c, s = np.cos(other), np.sin(other)
    a, b = -np.sin(nose), np.cos(nose)
    for i in range(P.shape[0]):  # all rows of the new lean, then all columns
        across = a * P[LEAN_NORTH, i] + b * P[LEAN_EAST, i]
        along = drag * (c * P[VX, i] + s * P[VY, i])
        P[LEAN_NORTH, i], P[LEAN_EAST, i] = -s * across + c * along, c * across + s * along
    for i in range(P.shape[0]):
        across = a * P[i, LEAN_NORTH] + b * P[i, LEAN_EAST]
        along = drag * (c * P[i, VX] + s * P[i, VY])
        P[i, LEAN_NORTH], P[i, LEAN_EAST] = -s * across + c * along, c * across + s * along
    along2 = drag * drag * wind * wind
    P[LEAN_NORTH, LEAN_NORTH] += along2 * c * c
    P[LEAN_EAST, LEAN_EAST] += along2 * s * s
    P[LEAN_NORTH, LEAN_EAST] += along2 * c * s
    P[LEAN_EAST, LEAN_NORTH] += along2 * c * s
    bank, _ = banked(slope, other, x)
    across = np.tan(bank - x[BANK_ERROR]) * (G - x[AZ]) - x[AY] * c + x[AX] * s
    along = drag * (c * x[VX] + s * x[VY])
    x[LEAN_NORTH], x[LEAN_EAST] = -s * across + c * along, c * across + s * along


@njit((OUT, CUBE, VECTOR, VECTOR, NUMBER, NUMBER, VECTOR), cache=True, error_model="numpy")
def first(means, P, noses, drags, slope, wind, banks):
    """Share out the slope of an image between the leans, the accelerations and the errors of the bank, whose
    sigmas are `banks` (K,) rad, of hypotheses that have not seen it, in place. The logarithms of their likelihoods
    (K,)."""
    log_l = np.zeros(len(noses))
    for k in range(len(noses)):
        x, S, c, s = means[k], P[k], np.cos(noses[k]), np.sin(noses[k])
        of_lean = (
            S[LEAN_EAST, LEAN_EAST] * c * c
            - 2.0 * S[LEAN_NORTH, LEAN_EAST] * c * s
            + S[LEAN_NORTH, LEAN_NORTH] * s * s
        )
        of_turn = S[AY, AY] * c * c - 2.0 * S[AX, AY] * c * s + S[AX, AX] * s * s
        of_bank = (G * banks[k]) ** 2
        off = np.tan(banked(slope, noses[k], x)[0]) * G - (x[LEAN_EAST] * c - x[LEAN_NORTH] * s)
        x[LEAN_NORTH], x[LEAN_EAST] = x[LEAN_NORTH] - s * off, x[LEAN_EAST] + c * off
        narrower = np.log(abs(appears(noses[k], x)[0]))  # a density of slopes: `prediction._takes`
        log_l[k] = likely(noses[k], x, S, drags[k], wind, of_turn + of_bank) + narrower
        share = off / (of_lean + of_turn + of_bank)
        rest = off - of_lean * share  # not the lean's
        x[LEAN_NORTH], x[LEAN_EAST] = x[LEAN_NORTH] + s * rest, x[LEAN_EAST] - c * rest
        x[AX], x[AY] = -s * of_turn * share, c * of_turn * share
        x[BANK_ERROR] = of_bank * share / G
    return log_l


@njit((VECTOR, VECTOR, NUMBER), cache=True, error_model="numpy")
def shown(noses, r, slope):
    """Lengths (K,) in the image, per length, of wings with that slope, at the place r (3,) m."""
    found = np.empty(len(noses))
    for k in range(len(noses)):
        found[k] = banked(slope, noses[k], r)[1]
    return found
