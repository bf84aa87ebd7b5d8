"""Errors of tracks against the truth: the scores of a run, and the row of all runs.

In the paper's feet.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold, mean_bounds, normalised_squared
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Record
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import A_LAT, A_LONG, POSITION, SIZE, VELOCITY
from studies.relative_motion.flight import Flight
from studies.relative_motion.flights import Flights
from studies.relative_motion.formation import M_PER_FT, Mask, Track
from studies.relative_motion.stacked_states import Indices
from studies.report import runs
from studies.report.runs import Quantity

SETTLING_TIME_S: Final = 15.0  # before a run is scored
DIVERGENCE_WINDOW_S: Final = 5.0  # at the end: it decides whether a run diverged
MIN_DIVERGED_RANGE_ERROR: Final = 0.5  # mean over the last 5 s, as a fraction
MIN_DIVERGED_BEARING_ERROR_RAD: Final = np.radians(5.0)  # mean between true and estimated direction
CONVERGED_ERROR_RATIO: Final = 0.2  # a_lat has converged when first within this fraction of the truth
ELLIPSOID_PROBABILITY: Final = 0.95  # that the position ellipsoid holds the true position
DROP_OUT_TIMES_S: Final = (
    29.9,
    34.9,
    44.9,
)  # before, at the end of and well after the five seconds without images
CONVERGED_SHARE: Final = 0.95  # of runs have converged by the time that is judged

RMS: Final = ("position_ft", "velocity_ft_s", "range_percent", "size_percent", "a_lat_ft_s2", "a_long_ft_s2")
MEANS: Final = ("nees", "nis")
OF_ALL: Final = ("inside_percent", "inside_unseen_percent", "valid_percent")  # of the diverged runs too


class Score(Record, frozen=True, kw_only=True):
    """One run over t >= 15 s: RMS errors, mean NEES (9 degrees of freedom) and NIS, and shares.

    Errors of position and velocity are those of the vector's norm; the NIS is that of fused images.
    """

    seed: int
    diverged: str | None  # why, or None
    position_ft: float
    velocity_ft_s: float
    range_percent: float
    size_percent: float
    a_lat_ft_s2: float
    a_long_ft_s2: float
    nees: float
    nis: float
    nis_degrees: int
    inside_percent: float  # of true positions inside the reported 95 % ellipsoid ...
    inside_unseen_percent: float | None  # ... and of those while the leader is out of view, if it ever is
    valid_percent: float  # of samples that have an estimate
    a_lat_converged_s: float | None  # from the first image
    size_error_first_percent: float  # signed, at the first image (the prior's error) ...
    size_error_last_percent: float  # ... and at the end
    angle_error_deg: tuple[float, float, float]  # root mean square of measured minus true angles
    position_sigma_ft: tuple[float, float, float]  # reported, at DROP_OUT
    gated: int


class Row(runs.Row, frozen=True, kw_only=True):
    """Figures of the runs that did not diverge; the shares of samples are of all runs."""

    position_m: float | None
    velocity_m_s: float | None
    a_lat_m_s2: float | None
    a_lat_converged_s: float | None  # median
    a_lat_converged_95_s: float | None  # by when 95 % of all runs had converged; None: never
    nis_bounds: tuple[float, float]  # as nees_bounds
    nis_degrees: int
    position_sigma_ft: tuple[float, ...]  # reported (root mean square) before, in and after a drop-out
    scores: tuple[Score, ...]


def truth_of(flight: Flight) -> Array:
    """True state rows (N, 9) at the navigation samples."""
    t = flight.nav_truth
    size = np.full(len(t.a_lat), flight.size)
    return np.column_stack([t.r_FL_n, t.v_FL_n, size, t.a_lat, t.a_long])


def score(seed: int, flight: Flight, track: Track, unseen: Mask | None = None) -> Score:
    """Return the score of one run, until it failed if it did.

    `unseen` (N,): whether the leader is out of view.
    """
    truth = truth_of(flight)
    error = track.mean - truth
    known = np.asarray(np.isfinite(error).all(axis=1))
    late = track.t >= SETTLING_TIME_S
    settled = known & late
    distance = np.linalg.norm(truth[:, POSITION], axis=1)
    range_error = np.linalg.norm(track.mean[:, POSITION], axis=1) / distance - 1.0
    size_error = 100 * error[known, SIZE] / flight.size
    inside = np.zeros(len(track.t))
    nearness = normalised_squared(error[settled][:, POSITION], track.covariance[settled][:, POSITION, POSITION])
    inside[settled] = nearness <= chi_square_threshold(ELLIPSOID_PROBABILITY, 3)
    hidden: Mask | None = None if unseen is None or not unseen.any() else settled & unseen
    first = track.t[0] if not np.isfinite(flight.image_points).any() else _first_image(flight)
    return Score(
        seed=seed,
        diverged=_diverged(track, truth, range_error),
        position_ft=_rms(error[settled][:, POSITION]) / M_PER_FT,
        velocity_ft_s=_rms(error[settled][:, VELOCITY]) / M_PER_FT,
        range_percent=100 * _rms(range_error[settled, None]),
        size_percent=100 * _rms(error[settled, SIZE, None]) / flight.size,
        a_lat_ft_s2=_rms(error[settled, A_LAT, None]) / M_PER_FT,
        a_long_ft_s2=_rms(error[settled, A_LONG, None]) / M_PER_FT,
        nees=_mean(normalised_squared(error[settled], track.covariance[settled])),
        nis=_mean(track.nis[(flight.image_t >= SETTLING_TIME_S) & track.fused]),
        nis_degrees=track.degrees,
        inside_percent=100 * _mean(inside[settled]),
        inside_unseen_percent=None if hidden is None else 100 * _mean(inside[hidden]),
        valid_percent=100 * float(np.mean(known[late])),
        a_lat_converged_s=_converged(track.t[known] - first, error[known, A_LAT], truth[known, A_LAT]),
        size_error_first_percent=float(size_error[0]) if size_error.size else np.nan,
        size_error_last_percent=float(size_error[-1]) if size_error.size else np.nan,
        angle_error_deg=_angle_error_deg(flight),
        position_sigma_ft=_position_sigma(track),
        gated=int(np.sum(np.isfinite(track.nis) & ~track.fused)),
    )


def score_flight(flights: Flights, b: int, track: Track) -> Score:
    """The score of the flight of `seeds[b]`."""
    unseen = unseen_samples(flights.image_at, flights.in_view[b], len(flights.nav_t))
    return score(flights.seeds[b], flights.one(b), track, unseen)


def make_row(variant: str, method: str, scores: Sequence[Score]) -> Row:
    """The row of these runs."""
    kept = [s for s in scores if s.diverged is None]
    quantities = {name: runs.rms([getattr(s, name) for s in kept]) for name in RMS}
    quantities |= {name: runs.mean([getattr(s, name) for s in kept]) for name in MEANS}
    quantities |= {name: runs.mean(_known([getattr(s, name) for s in scores])) for name in OF_ALL}
    times = _known([s.a_lat_converged_s for s in kept])
    sigmas = [runs.rms([s.position_sigma_ft[i] for s in kept]).value for i in range(len(DROP_OUT_TIMES_S))]
    nis_degrees = scores[0].nis_degrees
    return Row(
        variant=variant,
        method=method,
        runs=len(scores),
        diverged_percent=100.0 * (1.0 - len(kept) / len(scores)),
        diverged_why=tuple(sorted({s.diverged.split(" at ")[0] for s in scores if s.diverged is not None})),
        quantities=quantities,
        position_m=_si(quantities["position_ft"]),
        velocity_m_s=_si(quantities["velocity_ft_s"]),
        a_lat_m_s2=_si(quantities["a_lat_ft_s2"]),
        a_lat_converged_s=float(np.median(times)) if times else None,
        a_lat_converged_95_s=_time_of_most([s.a_lat_converged_s for s in scores]),
        nees_bounds=mean_bounds(9, max(len(kept), 1)),
        nis_bounds=mean_bounds(nis_degrees, max(len(kept), 1)),
        nis_degrees=nis_degrees,
        position_sigma_ft=tuple(np.nan if sigma is None else sigma for sigma in sigmas),
        scores=tuple(scores),
    )


def unseen_samples(image_at: Indices, in_view: Mask, samples: int) -> Mask:
    """Return whether the leader is out of view at each navigation sample, as in the image before it."""
    image = np.searchsorted(image_at, np.arange(samples), side="right") - 1
    unseen: Mask = ~in_view[np.maximum(image, 0)]
    return unseen


def error_over_time(flight: Flight, track: Track) -> Array:
    """Return (N, 3): time, position error and reported sigma of the position, in feet.

    The sigma is the root of the summed variances.
    """
    error = np.linalg.norm((track.mean - truth_of(flight))[:, POSITION], axis=1)
    sigma = np.sqrt(np.einsum("nii->n", track.covariance[:, POSITION, POSITION]))
    return np.column_stack([track.t, error / M_PER_FT, sigma / M_PER_FT])


def relative_acceleration(mean: Array, flight: Flight) -> Array:
    """a_FL_n (N, 3) that states (N, 9) imply: eq 4."""
    v_L = mean[:, VELOCITY] + flight.nav_v_F_n
    a_L = relative_motion.leader_acceleration(v_L, mean[:, A_LAT], mean[:, A_LONG], 0.0)
    return np.asarray(a_L - flight.nav_a_F_n)


def _first_image(flight: Flight) -> float:
    return float(flight.image_t[np.isfinite(flight.image_points).all(axis=(1, 2))][0])


def _position_sigma(track: Track) -> tuple[float, float, float]:
    at = np.minimum(np.searchsorted(track.t, np.array(DROP_OUT_TIMES_S) - 1e-9), len(track.t) - 1)
    before, during, after = np.sqrt(np.einsum("nii->n", track.covariance[at][:, POSITION, POSITION])) / M_PER_FT
    return float(before), float(during), float(after)


def _angle_error_deg(flight: Flight) -> tuple[float, float, float]:
    t = flight.image_truth
    r_c = np.einsum("nji,nj->ni", matrix_from_quaternion(t.q_nF), t.r_FL_n)
    alpha = 2 * np.arctan2(flight.size, 2 * np.linalg.norm(r_c, axis=1))
    true = np.column_stack([np.arctan2(r_c[:, 1], r_c[:, 0]), np.arctan2(r_c[:, 2], r_c[:, 0]), alpha])
    error = np.degrees(camera_angles.angles_from_points(flight.image_points) - true)
    azimuth, elevation, subtended = (_rms(column[np.isfinite(column), None]) for column in error.T)
    return azimuth, elevation, subtended


def _diverged(track: Track, truth: Array, range_error: Array) -> str | None:
    if np.isfinite(track.failed_at):
        return f"numerical failure at {track.failed_at:.2f} s"
    last = track.t > track.t[-1] - DIVERGENCE_WINDOW_S
    last &= np.isfinite(range_error)
    if not last.any():
        return "no estimate"
    if float(np.mean(np.abs(range_error[last]))) > MIN_DIVERGED_RANGE_ERROR:
        return "range"
    cosine = _unit(track.mean[last][:, POSITION]) * _unit(truth[last][:, POSITION])
    bearing = np.arccos(np.clip(cosine.sum(axis=1), -1.0, 1.0))
    return "bearing" if float(np.mean(bearing)) > MIN_DIVERGED_BEARING_ERROR_RAD else None


def _converged(t: Array, error: Array, truth: Array) -> float | None:
    inside = np.flatnonzero(np.abs(error) <= CONVERGED_ERROR_RATIO * np.abs(truth))
    return float(t[inside[0]]) if inside.size else None


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _rms(rows: Array) -> float:
    """Root of the mean of squared norms of rows; NaN without rows."""
    return float(np.sqrt(np.sum(rows * rows) / len(rows))) if len(rows) else float("nan")


def _mean(values: Array) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def _known(values: Sequence[float | None]) -> list[float]:
    return [x for x in values if x is not None and np.isfinite(x)]


def _time_of_most(times: Sequence[float | None]) -> float | None:
    """Return the time by which 95 % of the runs had converged, None if fewer ever did."""
    when = float(np.quantile([np.inf if t is None else t for t in times], CONVERGED_SHARE, method="higher"))
    return when if np.isfinite(when) else None


def _si(quantity: Quantity) -> float | None:
    return None if quantity.value is None else quantity.value * M_PER_FT
