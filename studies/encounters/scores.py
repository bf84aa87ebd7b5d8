"""Scores of flights: shares and errors over all valid estimates, with their scatter over flights."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from studies.encounters.flights import DEFAULTS, Case, Flight

INSIDE_THRESHOLD: Final = chi_square_threshold(0.95, 3)
BEYOND_THRESHOLD: Final = chi_square_threshold(0.9973, 3)  # an ellipsoid as probable as three sigma of one number
PLANE_INSIDE_THRESHOLD, PLANE_BEYOND_THRESHOLD = (
    chi_square_threshold(0.95, 2),
    chi_square_threshold(0.9973, 2),
)  # the same of two numbers
WRONG_SIGMAS: Final = 3.0
WRONG_SHARE: Final = 0.05  # of the range: an estimate is confidently wrong if it is off by more than both


class Share(NamedTuple):
    """A figure in percent, and its standard error by the scatter from flight to flight.

    NaN: unknown.
    """

    percent: float
    error: float


class Score(NamedTuple):
    """All flights of a case.

    Of `valid`, the share is of all estimates, of the others of those that are valid. Range errors are RMS, in
    percent of the true range: over all flights, of the median and the worst flight. `beyond`: the range is off by
    more than three sigma, the velocity, or a_lat and a_long, out of the ellipsoid of that probability.
    """

    flights: int
    valid: Share
    inside: Share
    wrong: Share
    beyond: Share
    velocity_inside: Share
    velocity_beyond: Share
    acceleration_inside: Share
    acceleration_beyond: Share
    range_error: Share
    median_flight: float
    worst_flight: float
    sigma: float  # median, percent of the true range


def score(flights: Sequence[Flight]) -> Score:
    """The score of these flights together; of none, all is NaN."""
    valid = [np.isfinite(f.range_) for f in flights]
    counts = np.array([np.count_nonzero(v) for v in valid], dtype=float)
    known = [np.count_nonzero(np.isfinite(f.velocity_nees)) for f in flights]
    curved = [np.count_nonzero(np.isfinite(f.acceleration_nees)) for f in flights]
    off = [f.range_[v] / f.distance[v] - 1.0 for f, v in zip(flights, valid, strict=True)]
    squares = np.array([float(np.sum(x * x)) for x in off])
    of_flights = 100.0 * np.sqrt(squares[counts > 0] / counts[counts > 0])
    sigma = np.array([s for f, v in zip(flights, valid, strict=True) for s in f.sigma[v] / f.distance[v]])
    mean_square = ratio(squares, counts)
    rms = float(np.sqrt(mean_square.percent / 100.0))
    return Score(
        flights=len(flights),
        valid=ratio(counts, [len(f.t) for f in flights]),
        inside=ratio([np.count_nonzero(f.nees < INSIDE_THRESHOLD) for f in flights], counts),
        wrong=ratio([np.count_nonzero(is_wrong(f)) for f in flights], counts),
        beyond=ratio([np.count_nonzero(_off(f) > WRONG_SIGMAS * f.sigma) for f in flights], counts),
        velocity_inside=ratio([np.count_nonzero(f.velocity_nees < INSIDE_THRESHOLD) for f in flights], known),
        velocity_beyond=ratio([np.count_nonzero(f.velocity_nees > BEYOND_THRESHOLD) for f in flights], known),
        acceleration_inside=ratio(
            [np.count_nonzero(f.acceleration_nees < PLANE_INSIDE_THRESHOLD) for f in flights], curved
        ),
        acceleration_beyond=ratio(
            [np.count_nonzero(f.acceleration_nees > PLANE_BEYOND_THRESHOLD) for f in flights], curved
        ),
        # d sqrt(s) = ds / (2 sqrt(s))
        range_error=Share(100.0 * rms, mean_square.error / (2.0 * rms) if rms else 0.0),
        median_flight=float(np.median(of_flights)) if len(of_flights) else float("nan"),
        worst_flight=float(np.max(of_flights)) if len(of_flights) else float("nan"),
        sigma=100.0 * float(np.median(sigma)) if len(sigma) else float("nan"),
    )


def over_all(flights: Mapping[Case, Sequence[Flight]]) -> Score:
    """The score of all flights with default settings."""
    return score([flight for case in DEFAULTS if case in flights for flight in flights[case]])


def is_wrong(flight: Flight) -> Array:
    """1 where an estimate is confidently wrong, or follows another aircraft, else 0 (n,)."""
    off = _off(flight)
    wrong = (off > WRONG_SIGMAS * flight.sigma) & (off > WRONG_SHARE * flight.distance)
    return np.logical_or(wrong, flight.strays).astype(float)


def _off(flight: Flight) -> Array:
    """Return the error of the range, m (n,)."""
    return np.asarray(np.abs(flight.range_ - flight.distance))


def ratio(hits: ArrayLike, counts: ArrayLike) -> Share:
    """The sum of `hits` over that of `counts`, each (n,) by flight.

    What happens within a flight is correlated, so each flight is one draw. The error of a single flight is
    unknown.
    """
    x, n = np.asarray(hits, dtype=float), np.asarray(counts, dtype=float)
    if not n.sum():
        return Share(float("nan"), float("nan"))
    share = x.sum() / n.sum()
    spread = np.sqrt(len(n) / (len(n) - 1) * np.sum((x - n * share) ** 2)) if len(n) > 1 else np.nan
    return Share(100.0 * float(share), 100.0 * float(spread / n.sum()))
