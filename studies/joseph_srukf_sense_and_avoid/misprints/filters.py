"""Misprints of De Vivo et al. in the filters' equations: the printed and the right form of each."""

from collections.abc import Callable
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.belief import Belief
from onboard.filters.discretisation import wiener_acceleration
from onboard.models import radar
from studies.report.findings import Misprint

DT: Final = 0.5
P0: Final = np.diag(np.tile([300.0, 30.0, 3.0], 3) ** 2)
MEAN: Final = np.array([-6000.0, 110, -0.2, 4500, -60, 0.3, 1000, 8, -0.05])
ROUNDING_TOLERANCE: Final = 1e-9  # relative


def process_noise() -> Misprint:
    """Eq 34."""
    right = wiener_acceleration(DT, axes=1).Q
    printed = right.copy()
    printed[1, 1] = DT**3 / 6
    low, sound = float(np.linalg.eigvalsh(printed)[0]), float(np.linalg.eigvalsh(right)[0])
    return Misprint(
        where="eq 34",
        printed="t³/6 for entry (2, 2)",
        right="t³/3",
        proof="smallest eigenvalue of Q₁: negative means that it has no Cholesky factor",
        printed_value=low,
        right_value=sound,
        proven=bool(low < 0 < sound),
    )


def predicted_covariance() -> Misprint:
    """Eqs 21 and 22."""
    F, Q = wiener_acceleration(DT, 0.01, by_axis=True)
    points = unscented.sigma_points(Belief(MEAN, P0), unscented.julier_weights(9, 9.0))
    moved, expected = points @ F.T, F @ P0 @ F.T + Q
    mean = moved[1:].mean(axis=0)

    def off(deviations: Array) -> float:
        found = deviations[1:].T @ deviations[1:] / 18 + Q
        return float(np.abs(found - expected).max() / np.abs(expected).max())

    printed, right = off(points - mean), off(moved - mean)
    return Misprint(
        where="eqs 21, 22",
        printed="deviations of X(n−1|n−1) from the predicted mean",
        right="deviations of f(X(n−1|n−1))",
        proof="relative error against F P Fᵀ + Q on the linear model of section 4",
        printed_value=printed,
        right_value=right,
        proven=bool(printed > 1e-2 and right < ROUNDING_TOLERANCE),
    )


def cross_covariance() -> Misprint:
    """Eq 27 and table 2."""
    F, Q = wiener_acceleration(DT, 10.0, by_axis=True)
    rule = unscented.julier_weights(9, 9.0)
    H, prior = np.zeros((1, 9)), np.diag(np.tile([3.0, 1.0, 0.3], 3) ** 2)
    H[0, 2] = 1.0
    moved = unscented.sigma_points(Belief(MEAN, prior), rule) @ F.T
    predicted = Belief(MEAN @ F.T, F @ prior @ F.T + Q)
    drawn = unscented.sigma_points(predicted, rule)
    seen = (drawn - drawn[0]) @ H.T
    printed = float(((moved - moved[0]).T @ seen / 18)[2, 0])
    right = float(((drawn - drawn[0]).T @ seen / 18)[2, 0])
    expected = float((predicted.covariance @ H.T)[2, 0])
    return Misprint(
        where="eq 27, table 2",
        printed="deviations of f(X(n−1|n−1)), which lack Q",
        right="deviations of the redrawn X(n|n−1)",
        proof=f"cross-covariance of an acceleration and its own measurement, (m/s²)²; P Hᵀ is {expected:.4g}",
        printed_value=printed,
        right_value=right,
        proven=bool(abs(printed / expected - 1) > 0.1 and abs(right / expected - 1) < ROUNDING_TOLERANCE),
    )


def centre_weight() -> Misprint:
    """Eqs 22 and 26."""
    rule = unscented.julier_weights(9)
    points = radar.measure(unscented.sigma_points(Belief(MEAN, P0), rule))
    mean = rule.mean * points[0] + rule.other * points[1:].sum(axis=0)
    d = points - mean
    others = rule.other * d[1:].T @ d[1:]
    expected = others + rule.covariance * np.outer(d[0], d[0])
    printed = others + abs(rule.covariance) * np.outer(d[0], d[0])
    wrong = float(np.abs(printed - expected).max() / np.abs(expected).max())
    return Misprint(
        where="eqs 22, 26; sections 3.1 and 6",
        printed="no downdate is needed",
        right="with a negative centre weight (n + κ = 3 for nine states: ω₀ = −2) both are downdates",
        proof="centre weight; taken as an update instead, the innovation covariance is off by "
        f"{100 * wrong:.3g} %. With ω₀ ≥ 0 (right: n + κ = 9) there is none",
        printed_value=rule.covariance,
        right_value=unscented.julier_weights(9, 9.0).covariance,
        proven=bool(rule.covariance < 0 and wrong > 1e-4),
    )


def transposed() -> Misprint:
    """Eq 32."""
    G = np.eye(9)
    G[0, :3] = [0.4, -0.3, 0.2]
    A = (G @ np.linalg.cholesky(P0)).T
    upper: Array = np.asarray(np.linalg.qr(A, mode="r"), float)
    expected = A.T @ A

    def off(S: Array) -> float:
        return float(np.abs(S @ S.T - expected).max() / np.abs(expected).max())

    printed, right = off(upper), off(upper.T)
    return Misprint(
        where="eq 32",
        printed="S = qr{·}, its upper triangle",
        right="S = qr{·}ᵀ, as in eqs 21, 25, 30",
        proof="relative error of S Sᵀ",
        printed_value=printed,
        right_value=right,
        proven=bool(printed > 1e-3 and right < ROUNDING_TOLERANCE),
    )


def arctangent() -> Misprint:
    """Eq 36."""
    x, y = 500.0, -1000.0
    printed = float(np.degrees(np.arctan(x / y)))
    right = float(np.degrees(radar.measure(np.array([[x, 0, 0, y, 0, 0, 100.0, 0, 0]]))[0, 1]))
    return Misprint(
        where="eq 36",
        printed="arctan(x / y)",
        right="atan2(x, y)",
        proof="azimuth, degrees clockwise from y, of a target at x = 500, y = −1000 m: behind, to the right",
        printed_value=printed,
        right_value=right,
        proven=bool(abs(right - 153.43) < 0.01 and abs(printed - right) > 90),
    )


MISPRINTS: Final[tuple[Callable[[], Misprint], ...]] = (
    process_noise,
    predicted_covariance,
    cross_covariance,
    centre_weight,
    transposed,
    arctangent,
)
