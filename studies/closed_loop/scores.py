"""Scores of a closed-loop flight."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.arrays import Array
from simlink.scenarios.scenario import Scenario
from studies.closed_loop.flight import ROWS_PER_S, Flight

Flags = NDArray[np.bool_]

SETTLING_TIME_S: Final = 5.0  # after the mode has been engaged
MAX_STRAIGHT_ERROR_PERCENT, MAX_TURNING_ERROR_PERCENT = 10.0, 15.0  # percent of the slot's distance, at most
MIN_DISTANCE_PERCENT: Final = 50.0  # of the slot's distance
MAX_STOP_TIME_S: Final = 3.0
MAX_STRAIGHT_RATE_RAD_S: Final = 0.005
MIN_STRAIGHT_TIME_S: Final = 5.0  # without a turn
MIN_CLOSING_SPEED_M_S: Final = 0.2  # slower is noise
RETURN_TIME_S: Final = 5.0  # in its slot: it is back from a break-off and does not only swing through
BREAK_OFF_TIME_S: Final = 5.0  # without a valid estimate


class Score(NamedTuple):
    """Errors of the follower's slot and behaviour after a break-off.

    Distances are in percent of the slot's. The last three fields are NaN without a break-off.
    """

    straight: float  # the greatest slot error on straight legs
    turning: float  # the greatest slot error in turns
    rms: float  # of the slot error
    nearest: float  # the least distance
    stop: float  # s, for which the follower still closed after the end of `valid`
    greatest: float  # m, distance
    back: float  # s, until the follower was back in its slot


def score(flight: Flight, scenario: Scenario) -> Score:
    """The scores of one flight."""
    follow = scenario.follow
    assert follow is not None  # noqa: S101 - it has flown
    distance = float(np.linalg.norm(follow.offset))
    counts = flight.t >= follow.engage + SETTLING_TIME_S
    error = 100.0 * flight.slot_error / distance
    away = broken_off(flight, error)
    straight = is_straight(flight.turn_rate) & counts & ~away
    turning = counts & ~away & ~straight
    stop, greatest, back = np.nan, np.nan, np.nan
    if away.any():
        first, last = np.flatnonzero(away)[[0, -1]]
        after = flight.closing[first:last]
        not_valid = ~flight.valid[first:last].astype(bool)
        still = np.flatnonzero((after > MIN_CLOSING_SPEED_M_S) & not_valid)
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
    turns = np.abs(turn_rate) > MAX_STRAIGHT_RATE_RAD_S
    window = round(MIN_STRAIGHT_TIME_S * ROWS_PER_S)
    lately = np.convolve(turns, np.ones(window), "full")[: len(turns)]
    return np.asarray(lately == 0)


def broken_off(flight: Flight, error: Array) -> Flags:
    """Return (n,) from the end of a long validity until the follower is back in its slot to stay."""
    away = np.zeros(len(flight.t), dtype=bool)
    invalid = (flight.valid == 0) & (flight.t > 0)
    k = 0
    while k < len(away):
        if not invalid[
            k : k + round(BREAK_OFF_TIME_S * ROWS_PER_S)
        ].all() or k + BREAK_OFF_TIME_S * ROWS_PER_S > len(away):
            k += 1
            continue
        later = np.flatnonzero(
            _for(RETURN_TIME_S, (flight.valid[k:] > 0) & (error[k:] <= MAX_STRAIGHT_ERROR_PERCENT))
        )
        end = k + int(later[0]) if later.size else len(away)
        away[k:end] = True
        k = end
    return away


def _most(values: Array) -> float:
    return float(values.max()) if values.size else float("nan")


def _for(seconds: float, holds: Flags) -> Flags:
    """Return whether something holds now and for some seconds afterwards, as far as the flight lasts (n,)."""
    window = round(seconds * ROWS_PER_S)
    fails = np.concatenate((~holds, np.zeros(window, dtype=bool)))
    return np.array([not fails[i : i + window].any() for i in range(len(holds))])
