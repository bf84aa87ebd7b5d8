"""Tilt of a multirotor against the air, as evidence of its heading.

A wing slopes in the image by its bank, the more steeply the less is seen of its length. So each heading needs
another tilt to explain the same slope, and how likely that tilt is, by drag times airspeed in an unknown wind, is
evidence of the heading. No hypothesis explains a slope for nothing.
"""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import CUBE, FILLING, MAKING, OUT, VECTOR, kernel
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses.draws import normal
from onboard.estimators.leader.hypotheses.motion import (
    AX,
    AY,
    AZ,
    BANK_ERROR,
    NUMBER,
    RX,
    RY,
    RZ,
    TILT_EAST,
    TILT_NORTH,
    VX,
    VY,
    G,
)


def lognormal(s: LeaderModel) -> tuple[float, float]:
    """Return the median of the drag, 1/s, and the standard deviation of its logarithm."""
    if s.drag == 0.0:
        return 0.0, 0.0
    variance = math.log1p((s.drag_sigma / s.drag) ** 2)
    return s.drag * math.exp(-0.5 * variance), math.sqrt(variance)


lognormal_of: Final = kernel(**FILLING)(lognormal)  # to be called from compiled code


def drags_of(s: LeaderModel, draw: int | np.uint64, count: int) -> Array:
    """Drags (count,), 1/s, a fixed function of `draw`."""
    middle, sigma = lognormal(s)
    found: Array = middle * np.exp(sigma * normal(draw, count))
    return found


@kernel(**FILLING)
def appears(heading, x):
    """Return the visible length of a wing with that heading, per length.

    To the right and down of a level one, down of one on its side. `x` begins with its place (3,) m."""
    level = np.sqrt(x[RX] * x[RX] + x[RY] * x[RY]) + given.MIN_VIEW_LENGTH
    range_ = np.sqrt(level * level + x[RZ] * x[RZ])
    right = (np.cos(heading) * x[RX] + np.sin(heading) * x[RY]) / level
    down = (np.sin(heading) * x[RX] - np.cos(heading) * x[RY]) / level * x[RZ] / range_
    # from above or below, one that points at us shows its length, and needs no tip
    least = np.sqrt(max(given.MIN_VISIBLE_FRACTION**2 - down * down, given.MIN_VIEW_LENGTH**2))
    return right if abs(right) > least else math.copysign(least, right), down, level / range_


@kernel(**FILLING)
def slope_of(heading, x):
    """Return the slope of the wing in the image."""
    right, down, upright = appears(heading, x)
    across = (x[AY] + x[TILT_EAST]) * np.cos(heading) - (x[AX] + x[TILT_NORTH]) * np.sin(heading)
    return (down + np.tan(np.arctan2(across, G - x[AZ]) + x[BANK_ERROR]) * upright) / right


@kernel(**FILLING)
def banked(slope, heading, x):
    """The bank with which a wing with that heading has that slope, rad, and its length in the image per length."""
    right, down, upright = appears(heading, x)
    bank = np.arctan((slope * right - down) / upright)
    return bank, abs(right) * np.cos(bank) * np.sqrt(1.0 + slope * slope)


@kernel(**FILLING)
def likely(heading, x, P, drag, wind, more):
    """The logarithm of the likelihood of a tilt across that heading, of which `more` is the variance beside that
    of an airspeed in an unknown wind."""
    c, s = np.cos(heading), np.sin(heading)
    across = x[TILT_EAST] * c - x[TILT_NORTH] * s
    off = across - drag * (x[VY] * c - x[VX] * s)
    speeds = P[VY, VY] * c * c - 2.0 * P[VX, VY] * c * s + P[VX, VX] * s * s
    variance = drag * drag * (wind * wind + speeds) + given.TILT_VARIANCE + more
    return -0.5 * (off * off / variance + np.log(variance) + across * across / given.STEADY_TILT_VARIANCE)


@kernel(**FILLING)
def plausible(heading, x, P, drag, mean_bank_error, wind, rolls):
    """The logarithm of the likelihood of the tilt that a hypothesis has come to suppose, and of a mean of its
    bank's errors that has `rolled` by a standard deviation of `rolls`; -given.MAX_PRIOR_COST at least."""
    by = mean_bank_error / rolls
    return max(likely(heading, x, P, drag, wind, 0.0) - 0.5 * (by * by), -given.MAX_PRIOR_COST)


@kernel(**MAKING)
def retilt(slope, heading, other, x, P, drag, wind):
    """Tilt a leader with another heading so that its wing has that slope, in place.

    Along its heading, which no image shows, it tilts as its drag lets it."""
    c, s = np.cos(other), np.sin(other)
    a, b = -np.sin(heading), np.cos(heading)
    for i in range(P.shape[0]):  # all rows of the new tilt, then all columns
        across = a * P[TILT_NORTH, i] + b * P[TILT_EAST, i]
        along = drag * (c * P[VX, i] + s * P[VY, i])
        P[TILT_NORTH, i], P[TILT_EAST, i] = -s * across + c * along, c * across + s * along
    for i in range(P.shape[0]):
        across = a * P[i, TILT_NORTH] + b * P[i, TILT_EAST]
        along = drag * (c * P[i, VX] + s * P[i, VY])
        P[i, TILT_NORTH], P[i, TILT_EAST] = -s * across + c * along, c * across + s * along
    along2 = drag * drag * wind * wind
    P[TILT_NORTH, TILT_NORTH] += along2 * c * c
    P[TILT_EAST, TILT_EAST] += along2 * s * s
    P[TILT_NORTH, TILT_EAST] += along2 * c * s
    P[TILT_EAST, TILT_NORTH] += along2 * c * s
    bank, _ = banked(slope, other, x)
    across = np.tan(bank - x[BANK_ERROR]) * (G - x[AZ]) - x[AY] * c + x[AX] * s
    along = drag * (c * x[VX] + s * x[VY])
    x[TILT_NORTH], x[TILT_EAST] = -s * across + c * along, c * across + s * along


@kernel((OUT, CUBE, VECTOR, VECTOR, NUMBER, NUMBER, VECTOR), **MAKING)
def first(means, P, headings, drags, slope, wind, banks):
    """Share out the slope of an image between the tilts, the accelerations and the errors of the bank, whose
    sigmas are `banks` (K,) rad, of hypotheses that have not seen it, in place. The logarithms of their likelihoods
    (K,)."""
    log_l = np.zeros(len(headings))
    for k in range(len(headings)):
        x, S, c, s = means[k], P[k], np.cos(headings[k]), np.sin(headings[k])
        of_lean = (
            S[TILT_EAST, TILT_EAST] * c * c
            - 2.0 * S[TILT_NORTH, TILT_EAST] * c * s
            + S[TILT_NORTH, TILT_NORTH] * s * s
        )
        of_turn = S[AY, AY] * c * c - 2.0 * S[AX, AY] * c * s + S[AX, AX] * s * s
        of_bank = (G * banks[k]) ** 2
        off = np.tan(banked(slope, headings[k], x)[0]) * G - (x[TILT_EAST] * c - x[TILT_NORTH] * s)
        x[TILT_NORTH], x[TILT_EAST] = x[TILT_NORTH] - s * off, x[TILT_EAST] + c * off
        narrower = np.log(abs(appears(headings[k], x)[0]))  # a density of slopes: `prediction._propose_heading`
        log_l[k] = likely(headings[k], x, S, drags[k], wind, of_turn + of_bank) + narrower
        share = off / (of_lean + of_turn + of_bank)
        rest = off - of_lean * share  # not the tilt's
        x[TILT_NORTH], x[TILT_EAST] = x[TILT_NORTH] + s * rest, x[TILT_EAST] - c * rest
        x[AX], x[AY] = -s * of_turn * share, c * of_turn * share
        x[BANK_ERROR] = of_bank * share / G
    return log_l


@kernel((VECTOR, VECTOR, NUMBER), **MAKING)
def shown(headings, r, slope):
    """Lengths (K,) in the image, per length, of wings with that slope, at the place r (3,) m."""
    found = np.empty(len(headings))
    for k in range(len(headings)):
        found[k] = banked(slope, headings[k], r)[1]
    return found
