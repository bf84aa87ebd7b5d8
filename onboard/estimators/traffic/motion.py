"""The configured motion of aircraft, and the belief in one of them after a single measurement."""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.batch import Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.filter import TrackFilter, track_filter
from onboard.estimators.traffic.reports import Report
from onboard.filters.belief import Belief
from onboard.models.intruder.measurement import cross_matrix, position, position_noise
from onboard.models.intruder.motion import ATTITUDE_ERROR, BIAS, POSITION, MotionModel, N, backward_transition

MEMORY_S: Final = 3.0  # twice the time in which a track with a report a second forgets an old velocity


def configured_filter(config: Config) -> TrackFilter:
    """The filter of the configured name, with the configured motion models."""
    c = config
    gust = gust_random_walk(np.array([c.gust_m_s, c.gust_m_s, c.gust_vertical_m_s]), c.gust_time_s)
    drift = c.own_position_sigma_m * np.sqrt(2.0 / c.own_position_time_s)
    modes = (
        (c.quiet_acceleration_m_s2, c.quiet_time_s, True, c.quiet_lasts_s),
        (c.changing_acceleration_m_s2, c.changing_time_s, True, c.changing_lasts_s),
        (c.manoeuvre_acceleration_m_s2, c.manoeuvre_time_s, False, c.manoeuvre_lasts_s),
    )
    models = [
        MotionModel(_accelerations(size, config), time, keeps_turn, gust, drift, c.report_bias_time_s)
        for size, time, keeps_turn, _ in modes
    ]
    return track_filter(c.filter, models, [duration for *_, duration in modes])


def gust_random_walk(sigma: Array, time_s: float) -> Array:
    """Random walk (3,) of the velocity, m/s per square root of a second, for gusts with standard deviations
    `sigma` (3,), m/s, and this time constant: over `MEMORY_S` it changes the velocity by as much as they do."""
    return np.asarray(sigma * np.sqrt(2.0 * (1.0 - np.exp(-MEMORY_S / time_s)) / MEMORY_S))


def belief_from_report(report: Report, lag: float, attitude_error: Array, config: Config) -> Belief:
    """State after one report that is `lag` seconds old, with the attitude error's covariance (3, 3): y = r + bias
    + noise correlates position and bias."""
    covariance = first_covariance(attitude_error, config)
    covariance[:6, :6] = report.R
    covariance[POSITION, POSITION] += np.diag(report.bias_sigma**2)
    covariance[POSITION, BIAS] = covariance[BIAS, POSITION] = -np.diag(report.bias_sigma)
    return _moved_on(Belief(np.concatenate([report.y, np.zeros(N - 6)]), covariance), lag)


def belief_from_echo(
    polar: Array, sigma: Array, radar: Radar, lag: float, attitude_error: Array, config: Config
) -> Belief:
    """State after one echo (1, 3) with standard deviations (1, 3) that is `lag` seconds old, with the attitude
    error's covariance (3, 3): it is measured at r + w x d + noise, which correlates position and attitude error
    w."""
    covariance = first_covariance(attitude_error, config)
    r = position(polar, *radar)[0]
    across = cross_matrix(r - radar.r)
    covariance[POSITION, POSITION] = position_noise(polar, sigma, radar.R_rn)[0]
    covariance[POSITION, POSITION] += across @ attitude_error @ across.T
    covariance[POSITION, ATTITUDE_ERROR] = across @ attitude_error
    covariance[ATTITUDE_ERROR, POSITION] = covariance[POSITION, ATTITUDE_ERROR].T
    return _moved_on(Belief(np.concatenate([r, np.zeros(N - 3)]), covariance), lag)


def first_covariance(attitude_error: Array, config: Config) -> Array:
    """Covariance (15, 15) before any measurement of an aircraft, without its position, with the attitude error's
    (3, 3)."""
    accelerations = _accelerations(config.manoeuvre_acceleration_m_s2, config)
    speeds = np.full(3, config.initial_speed_sigma_m_s)
    covariance = np.diag(np.concatenate([np.zeros(3), speeds, accelerations, np.ones(3), np.zeros(3)]) ** 2)
    covariance[ATTITUDE_ERROR, ATTITUDE_ERROR] = attitude_error
    return covariance


def _accelerations(horizontal: float, config: Config) -> Array:
    """On each axis (3,)."""
    return horizontal * np.array([1.0, 1.0, config.vertical_share])


def _moved_on(belief: Belief, lag: float) -> Belief:
    F = np.eye(N)
    F[:9, :9] = backward_transition(-lag)
    return Belief(F @ belief.mean, F @ belief.covariance @ F.T)
