"""Configured motion of aircraft, and the belief in one of them after a single measurement."""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.batch import Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.filter import TrackFilter, track_filter
from onboard.estimators.traffic.reports import Report
from onboard.filters.belief import Belief
from onboard.models.intruder.measurement import cross_matrix, position, position_noise
from onboard.models.intruder.motion import (
    ATTITUDE_ERROR,
    BIAS,
    POSITION,
    STATE_SIZE,
    MotionModel,
    backward_transition,
)

GUST_MEMORY_TIME_S: Final = 3.0  # Twice the memory of the velocity in a track with a report a second.


def configured_filter(config: Config) -> TrackFilter:
    """Return the filter of the configured name, with the configured motion models."""
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
    """Return the random walk (3,) of the velocity by gusts, m/s per square root of a second.

    `sigma` (3,), m/s, are the standard deviations of the gusts, and `time_s` is their time constant. Over
    `GUST_MEMORY_TIME_S` the random walk changes the velocity by as much as they do.
    """
    return np.asarray(sigma * np.sqrt(2.0 * (1.0 - np.exp(-GUST_MEMORY_TIME_S / time_s)) / GUST_MEMORY_TIME_S))


def belief_from_report(report: Report, lag: float, attitude_error: Array, config: Config) -> Belief:
    """Return the belief after one report that is `lag` seconds old.

    The attitude error's covariance is (3, 3). y = r + bias + noise correlates position and bias.
    """
    covariance = first_covariance(attitude_error, config)
    covariance[:6, :6] = report.R
    covariance[POSITION, POSITION] += np.diag(report.bias_sigma**2)
    covariance[POSITION, BIAS] = covariance[BIAS, POSITION] = -np.diag(report.bias_sigma)
    return _predicted(Belief(np.concatenate([report.y, np.zeros(STATE_SIZE - 6)]), covariance), lag)


def belief_from_echo(
    polar: Array, sigma: Array, radar: Radar, lag: float, attitude_error: Array, config: Config
) -> Belief:
    """Return the belief after one echo that is `lag` seconds old.

    The echo is (1, 3) with standard deviations (1, 3), and the attitude error's covariance is (3, 3). The echo is
    measured at r + w x d + noise, which correlates position and attitude error w.
    """
    covariance = first_covariance(attitude_error, config)
    r = position(polar, *radar)[0]
    across = cross_matrix(r - radar.r)
    covariance[POSITION, POSITION] = position_noise(polar, sigma, radar.R_rn)[0]
    covariance[POSITION, POSITION] += across @ attitude_error @ across.T
    covariance[POSITION, ATTITUDE_ERROR] = across @ attitude_error
    covariance[ATTITUDE_ERROR, POSITION] = covariance[POSITION, ATTITUDE_ERROR].T
    return _predicted(Belief(np.concatenate([r, np.zeros(STATE_SIZE - 3)]), covariance), lag)


def first_covariance(attitude_error: Array, config: Config) -> Array:
    """Return the prior covariance (15, 15) of an aircraft, without its position.

    The attitude error's covariance is (3, 3).
    """
    accelerations = _accelerations(config.manoeuvre_acceleration_m_s2, config)
    speeds = np.full(3, config.initial_speed_sigma_m_s)
    covariance = np.diag(np.concatenate([np.zeros(3), speeds, accelerations, np.ones(3), np.zeros(3)]) ** 2)
    covariance[ATTITUDE_ERROR, ATTITUDE_ERROR] = attitude_error
    return covariance


def _accelerations(horizontal: float, config: Config) -> Array:
    """Return the standard deviation of the acceleration on each axis (3,)."""
    return horizontal * np.array([1.0, 1.0, config.vertical_share])


def _predicted(belief: Belief, lag: float) -> Belief:
    F = np.eye(STATE_SIZE)
    F[:9, :9] = backward_transition(-lag)
    return Belief(F @ belief.mean, F @ belief.covariance @ F.T)
