"""Misprinted formulas of Al-Shabi et al.: their results, and those of the right formulas."""

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature, cubature_smooth
from onboard.filters.belief import Belief
from studies.report.findings import Misprint

STEPS = 37
OFFSET = 1e6  # m
START_VARIANCE_M2 = 1e-3


def misprints() -> tuple[Misprint, ...]:
    """Each with the figure that proves it."""
    return (_covariance(), _gain(), _moments())


def _same(rows: Array) -> Array:
    return rows.copy()


def _covariance() -> Misprint:
    """A position and its velocity, measured to 3 cm, with hardly any process noise."""
    F, Q, R = np.array([[1.0, 0.01], [0.0, 1.0]]), 1e-6 * np.eye(2), 8e-4 * np.eye(2)
    printed, right = 4 * R, Belief(np.zeros(2), 4 * R)
    for _ in range(STEPS):
        prior = F @ printed @ F.T + Q
        W = prior @ np.linalg.inv(prior + R)
        printed = prior + W @ (prior + R) @ W.T
        right = cubature.predict(right, lambda rows: rows @ F.T, Q)
        right = cubature.update(right, np.zeros(2), _same, R).belief
    a, b = float(np.sqrt(printed[0, 0])), float(np.sqrt(right.covariance[0, 0]))
    return Misprint(
        where="eq 2.2.12",
        printed="P + W Pzz Wᵀ",
        right="P − W Pzz Wᵀ",
        proof=f"standard deviation, m, of a position measured to .028 m, after {STEPS} updates",
        printed_value=a,
        right_value=b,
        proven=a > 1e3 and b < 0.028,
    )


def _gain() -> Misprint:
    """An innovation of zero in one of two components."""
    e, psi = np.array([0.0, 1.0]), np.array([2.0, 2.0])
    with np.errstate(invalid="ignore", divide="ignore"):
        printed = np.abs(e) * np.clip(e / psi, -1, 1) / e * e
    state = cubature_smooth.start_printed(np.zeros(2), np.eye(2))
    right = cubature_smooth.update_printed(state, e, _same, np.eye(2)).belief.second.mean
    return Misprint(
        where="eq 2.3.3",
        printed="diag(e)⁻¹ in the gain",
        right="the step K e itself: A sat(e/ψ)",
        proof="step of a component whose innovation is zero (– is 0/0)",
        printed_value=None if np.isnan(printed[0]) else float(printed[0]),
        right_value=float(right[0]),
        proven=bool(np.isnan(printed[0]) and np.isfinite(right).all()),
    )


def _moments() -> Misprint:
    """Cubature points a thousand kilometres off."""
    P = START_VARIANCE_M2 * np.eye(2)
    points = OFFSET + np.sqrt(2) * np.concatenate([np.sqrt(P), -np.sqrt(P)])
    mean = points.mean(axis=0)
    printed = points.T @ points / len(points) - np.outer(mean, mean)
    right = cubature.predict(Belief(np.full(2, OFFSET), P), _same, np.zeros((2, 2))).covariance
    a, b = float(printed[0, 0] / START_VARIANCE_M2), float(right[0, 0] / START_VARIANCE_M2)
    return Misprint(
        where="eqs 2.2.4, 2.2.8, 2.2.9",
        printed="E[X Xᵀ] − x xᵀ",
        right="E[(X − x)(X − x)ᵀ]",
        proof=f"a variance of {START_VARIANCE_M2:g} m² at {OFFSET:g} m, over itself",
        printed_value=a,
        right_value=b,
        proven=abs(a - 1) > 0.02 and abs(b - 1) < 1e-6,
    )
