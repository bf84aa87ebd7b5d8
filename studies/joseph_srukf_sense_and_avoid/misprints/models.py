"""Misprints of De Vivo et al. in the models of target and measurement, printed and right."""

from collections.abc import Callable
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import van_loan
from onboard.models import gnss_clock, pseudorange
from studies.report.findings import Misprint

ROUNDING_TOLERANCE: Final = 1e-6


def printed_q1(omega_c: float, alpha: float, dt: float) -> Array:
    """Q_1 (3, 3) of appendix A, as printed."""
    w, a, t = omega_c, alpha, dt
    grow, fall, d = np.exp(a * t), np.exp(-2 * a * t), w * w + a * a
    s, c, s2, c2 = np.sin(w * t), np.cos(w * t), np.sin(2 * w * t), np.cos(2 * w * t)
    q11 = (4 * t * w**2 * a + w**2 + 4 * t * a**3 - 11 * a**2) / (4 * a * d**3) - fall / (4 * w**2 * a * d**3) * (
        w * a * s2 * (3 * a**2 - w**2)
        + a**2 * c2 * (3 * w**2 - a**2)
        + w**4
        + a**4
        + 2 * w**2 * a**2
        + 8 * w * a * grow * s * (w**2 - a**2)
        - 16 * w**2 * a**2 * grow * c
    )
    q12 = (
        fall
        / (2 * w**2 * d**2)
        * (w**2 * grow**2 + c**2 * (w**2 - a**2) + a**2 - 2 * w**2 * grow * c + w * a * s2 - 2 * w * a * grow * s)
    )
    q13 = (
        fall / (4 * w**2 * a * d) * (a**2 * c2 - w**2 * grow**2 + w**2 - a**2 - w * a * s2 + 4 * w * a * grow * s)
    )
    q22 = fall / (4 * w**2 * a * d) * (w**2 - w**2 * grow**2 - a**2 * c2 + a**2 + w * a * s2)
    q23 = fall / (4 * w**2) * (c2 - 1)
    q33 = fall / (4 * w**2 * a) * (a**2 * c2 - w**2 - a**2 + w * a * s2)
    return np.array([[q11, q12, q13], [q12, q22, q23], [q13, q23, q33]])


def corrected_q1(omega_c: float, alpha: float, dt: float) -> Array:
    """Q_1 (3, 3) of appendix A with its signs corrected and the missing term added."""
    q = printed_q1(omega_c, alpha, dt)
    q[1, 1], q[1, 2], q[2, 1] = -q[1, 1], -q[1, 2], -q[2, 1]
    q[2, 2] += 1 / (4 * alpha)  # omega_c^2 e^(2 alpha dt) inside the bracket
    return q


def markov_noise() -> Misprint:
    """Appendix A."""
    w, a, dt = 0.3, 0.2, 0.5
    A = np.array([[0.0, 1, 0], [0, 0, 1], [0, -(a * a + w * w), -2 * a]])
    expected = van_loan(A, np.diag([0.0, 0.0, 1.0]), dt).Q
    printed, right = printed_q1(w, a, dt), corrected_q1(w, a, dt)
    wrong = [f"q{i + 1}{j + 1}" for i, j in zip(*np.nonzero(np.abs(printed - expected) > 1e-6), strict=True)]
    return Misprint(
        where="appendix A",
        printed="q22, q23, q32 of the wrong sign; q33 without + ω_c² e^(2αΔt)",
        right="Van Loan's integral; the corrected closed forms equal it, but cancel as α → 0",
        proof=f"q33, (m/s²)² at ω_c 0.3, α 0.2, Δt 0.5 and unit density; wrong as printed: {', '.join(wrong)}",
        printed_value=float(printed[2, 2]),
        right_value=float(right[2, 2]),
        proven=bool(wrong == ["q22", "q23", "q32", "q33"] and bool(np.allclose(right, expected, rtol=1e-6))),
    )


def damping() -> Misprint:
    """Alpha, below eq 42."""
    v, a = np.array([100.0, 0, 0]), np.array([0.5, 0, 0])  # accelerates along a line: no jerk

    def jerk(alpha: float) -> float:
        return float(np.linalg.norm(-2 * alpha * a - 2 * alpha**2 * v))

    printed, right = jerk(-(v @ a) / (a @ a)), jerk(-(v @ a) / (v @ v))
    return Misprint(
        where="below eq 42",
        printed="α = −v·a / |a|², a time",
        right="α = −v·a / |v|², a rate",
        proof="jerk, m/s³, of steady acceleration along a line (true: 0) by eq 42",
        printed_value=printed,
        right_value=right,
        proven=bool(printed > 1e3 and right < ROUNDING_TOLERANCE),
    )


def turn_rate() -> Misprint:
    """Omega_c, below eq 43."""
    alpha, omega = 0.05, 0.1
    entry = 2 * alpha**2 + omega**2  # of eq 42
    squared = alpha**2 + omega**2
    printed, right = alpha**2 + squared**2, alpha**2 + squared
    return Misprint(
        where="below eq 43",
        printed="ω_c = α² + ω²",
        right="ω_c² = α² + ω²",
        proof=f"α² + ω_c² of eq 43, 1/s², which must be eq 42's 2α² + ω² = {entry:.4g}",
        printed_value=printed,
        right_value=right,
        proven=bool(abs(right - entry) < 1e-12 and abs(printed / entry - 1) > 0.1),
    )


def remaining_noise() -> Misprint:
    """The noise, below eq 42: a turn at constant speed that tightens."""
    speed, rate, tightening = 100.0, 0.1, 0.02
    v, a = np.array([speed, 0, 0]), np.array([0, speed * rate, 0])
    jerk = np.array([-speed * rate**2, speed * tightening, 0])  # of (cos psi, sin psi) speed, psi_dot 0.1
    rest = jerk - (-(rate**2) * v)  # the jerk that eq 42 leaves to the noise; alpha = 0
    turn, change = np.array([0, 0, rate]), np.array([0, 0, tightening])
    printed, right = np.cross(turn, v), np.cross(change, v)
    return Misprint(
        where="below eq 42",
        printed="noise d²v/dt² + Ω × v",
        right="noise d²v/dt² + dΩ/dt × v",
        proof=f"the noise, m/s³, of a turn that tightens at constant speed; true: {np.linalg.norm(rest):.3g}",
        printed_value=float(np.linalg.norm(printed)),
        right_value=float(np.linalg.norm(right)),
        proven=bool(np.allclose(right, rest) and not np.allclose(printed, rest) and np.allclose(printed, a)),
    )


def _rate_after(state: Array, dt: float, r: Array, v: Array) -> float:
    """Pseudorange rate, m/s, `dt` after a state (9,), with steady acceleration (eq 52)."""
    later = np.zeros((1, 11))
    later[0, :9] = state
    later[0, 0:9:3] += dt * state[1::3] + 0.5 * dt * dt * state[2::3]
    later[0, 1:9:3] += dt * state[2::3]
    return float(pseudorange.measure(later, r, v)[0, 1])


def _geometry() -> tuple[Array, Array, Array, Array, Array, float, float]:
    """Return a state (9,), a satellite's r and v (1, 3), their differences, range and range rate.

    The differences d and d_dot are (3,).
    """
    state = np.array([4.4e6, 90.0, 1.0, 6e5, -60.0, 2.0, 4.5e6, 5.0, 0.5])
    r, v = np.array([[1.5e7, 1e7, 1.9e7]]), np.array([[-1500.0, 2000.0, 1200.0]])
    d, d_dot = r[0] - state[0::3], v[0] - state[1::3]
    distance = float(np.linalg.norm(d))
    return state, r, v, d, d_dot, distance, float(d @ d_dot / distance)


def rate_by_position() -> Misprint:
    """Appendix B, the derivative of a rate by a position."""
    state, r, v, d, d_dot, R, rate = _geometry()
    ahead, behind = state.copy(), state.copy()
    ahead[0], behind[0] = state[0] + 50, state[0] - 50
    expected = (_rate_after(ahead, 0.0, r, v) - _rate_after(behind, 0.0, r, v)) / 100
    printed = -d[0] / R + rate * d[0] / R**2
    right = -d_dot[0] / R + rate * d[0] / R**2
    return Misprint(
        where="appendix B",
        printed="∂ρ̇/∂ξ = −d/R + Ṙ d/R², d = ξ_s − ξ",
        right="∂ρ̇/∂ξ = −ḋ/R + Ṙ d/R²",
        proof=f"the derivative, 1/s; by differences {expected:.4g}",
        printed_value=float(printed),
        right_value=float(right),
        proven=bool(abs(right - expected) < 1e-8 and abs(printed - expected) > 0.1),
    )


def rate_by_acceleration() -> Misprint:
    """Appendix B, the derivative of a rate by an acceleration, one second before the measurement."""
    state, r, v, *_ = _geometry()
    dt = 1.0
    later = state.copy()
    later[0::3] += dt * state[1::3] + 0.5 * dt * dt * state[2::3]
    later[1::3] += dt * state[2::3]
    d, d_dot = r[0] - later[0::3], v[0] - later[1::3]
    R = float(np.linalg.norm(d))
    rate = float(d @ d_dot / R)
    ahead, behind = state.copy(), state.copy()
    ahead[2], behind[2] = state[2] + 20, state[2] - 20
    expected = (_rate_after(ahead, dt, r, v) - _rate_after(behind, dt, r, v)) / 40
    along = -d[0] * dt / R
    printed = along - 0.5 * dt**2 / R * (d_dot[0] + rate * d[0] / R)
    right = along - 0.5 * dt**2 / R * (d_dot[0] - rate * d[0] / R)
    return Misprint(
        where="appendix B",
        printed="∂ρ̇/∂ξ̈ with ḋ + Ṙ d/R inside",
        right="ḋ − Ṙ d/R",
        proof="error against differences, s",
        printed_value=float(abs(printed - expected)),
        right_value=float(abs(right - expected)),
        proven=bool(abs(right - expected) < 1e-8 and abs(printed - expected) > 1e-6),
    )


def augmented_noise() -> Misprint:
    """Eq 49."""
    mean = np.zeros((1, 11))
    mean[0, [1, 4]] = 100.0
    right = gnss_clock.noise(mean, 0.1, 1.0, 0.0, 0.01)[0]
    printed = right.copy()
    printed[6:], printed[:, 6:] = 0.0, 0.0
    ranks = [int(np.linalg.matrix_rank(Q / np.abs(Q).max(), tol=1e-14)) for Q in (printed, right)]
    return Misprint(
        where="eq 49",
        printed="zeros for the z axis and the clock",
        right="q_z Q₁ and q_c Q_c",
        proof="variance that ten seconds add to the clock's error, m², q_c 0.01: nothing lets it drift. "
        f"(Rank of Q: {ranks[0]}, right {ranks[1]}.)",
        printed_value=float(printed[9, 9]) * 1e6,
        right_value=float(right[9, 9]) * 1e6,
        proven=bool(printed[9, 9] == 0.0 and printed[8, 8] == 0.0 and ranks[0] < ranks[1]),
    )


MISPRINTS: Final[tuple[Callable[[], Misprint], ...]] = (
    damping,
    turn_rate,
    remaining_noise,
    markov_noise,
    augmented_noise,
    rate_by_position,
    rate_by_acceleration,
)
