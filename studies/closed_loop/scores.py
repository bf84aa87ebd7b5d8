"""Scores of a closed-loop flight."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.arrays import Array
from simlink.scenarios.scenario import Scenario
from studies.closed_loop.flight import ROWS_PER_S, Flight

Flags = NDArray[np.bool_]

SETTLE: Final = 5.0  # s after the mode has been engaged
MOST_STRAIGHT, MOST_TURNING = 10.0, 15.0  # percent of the slot's distance, at most
NEAREST: Final = 50.0  # percent of the slot's distance, at least
STOP_WITHIN: Final = 3.0  # s
STRAIGHT_RATE: Final = 0.005  # rad/s
STRAIGHT_FOR: Final = 5.0  # s without a turn
CLOSES: Final = 0.2  # m/s; slower is noise
STAYS: Final = 5.0  # s in its slot: back from a break-off, not only swinging through
LONG: Final = 5.0  # s without a valid estimate: a break-off


class Score(NamedTuple):
    """Greatest slot errors on straight legs and in turns and their RMS, and the least distance, in percent of the
    slot's distance; for how long after the end of `valid` the follower still closed (s), the greatest distance (m)
    and after how many seconds it was back in its slot. The last three are NaN without a break-off."""

    straight: float
    turning: float
    rms: float
    nearest: float
    stop: float
    greatest: float
    back: float


def score(flight: Flight, scenario: Scenario) -> Score:
    """The scores of one flight."""
    follow = scenario.follow
    assert follow is not None  # noqa: S101 - it has flown
    distance = float(np.linalg.norm(follow.offset))
    counts = flight.t >= follow.engage + SETTLE
    error = 100.0 * flight.slot_error / distance
    away = broken_off(flight, error)
    straight = is_straight(flight.turn_rate) & counts & ~away
    turning = counts & ~away & ~straight
    stop, greatest, back = np.nan, np.nan, np.nan
    if away.any():
        first, last = np.flatnonzero(away)[[0, -1]]
        after = flight.closing[first:last]
        invalidate = ~flight.valid[first:last].astype(bool)
        still = np.flatnonzero((after > CLOSES) & invalidate)
        stop = 0.0 if not still.size else (still[-1] + 1) / ROWS_PER_S
        greatest, back = float(flight.distance[first:last].max()), flight.t[last] - flight.t[first]
    return Score(
        straight=_most(error[straight]),
        turning=_most(error[turning]),
        rms=float(np.sqrt(np.mean(error[straight | turning] ** 2))),
        nearest=100.0 * float(flight.distance[counts].min()) / distance,
        stop=float(stop),
        greatest=float(greatest),
        back=float(back),
    )


def is_straight(turn_rate: Array) -> Flags:
    """Whether the leader has not turned for a while (n,)."""
    turns = np.abs(turn_rate) > STRAIGHT_RATE
    window = round(STRAIGHT_FOR * ROWS_PER_S)
    lately = np.convolve(turns, np.ones(window), "full")[: len(turns)]
    return np.asarray(lately == 0)


def broken_off(flight: Flight, error: Array) -> Flags:
    """From the end of `valid`, where it ends for long, until the follower is back in its slot to stay (n,)."""
    away = np.zeros(len(flight.t), dtype=bool)
    invalid = (flight.valid == 0) & (flight.t > 0)
    k = 0
    while k < len(away):
        if not invalid[k : k + round(LONG * ROWS_PER_S)].all() or k + LONG * ROWS_PER_S > len(away):
            k += 1
            continue
        later = np.flatnonzero(_for(STAYS, (flight.valid[k:] > 0) & (error[k:] <= MOST_STRAIGHT)))
        end = k + int(later[0]) if later.size else len(away)
        away[k:end] = True
        k = end
    return away


def _most(values: Array) -> float:
    return float(values.max()) if values.size else float("nan")


def _for(seconds: float, holds: Flags) -> Flags:
    """Whether something holds now and for so long afterwards, as far as the flight lasts (n,)."""
    window = round(seconds * ROWS_PER_S)
    fails = np.concatenate((~holds, np.zeros(window, dtype=bool)))
    return np.array([not fails[i : i + window].any() for i in range(len(holds))])
