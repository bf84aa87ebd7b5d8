"""The claims of Lazarov et al. and their misprint, and whether they held in our runs."""

import math

import numpy as np

from onboard.filters.discretisation import wiener_acceleration
from studies.cwpa_kalman_tracker_3d.runs import DENSITY, DT, Scores, fraction_noise, printed_noise
from studies.report.findings import Claim, Misprint, verdict


def claims_of(drawn: Scores, rest: Scores, printed: Scores) -> tuple[Claim, ...]:
    """Judge each claim.

    `drawn` and `rest`: with the right Q, started at draws from P0 and at rest; `printed`: with Q of eq 14, started
    at draws.
    """
    gain = 1 - rest.position / rest.raw
    converges = rest.position < rest.raw and rest.position < 1.1 * rest.bound
    third, taylor, pade = third_terms()
    printed_fails = printed.failed or printed.position > printed.raw
    return (
        Claim(
            claim="The estimated trajectory converges satisfactorily to the real one.",
            where="section 5, figures 2-5",
            verdict=verdict(converges),
            evidence=f"Position {rest.position:.2f} ± {rest.position_error:.2f} m where the "
            f"measurements are off by {rest.raw:.2f} m ({100 * gain:.0f} % less), velocity "
            f"{rest.velocity:.2f} m/s. That is the Cramér–Rao bound ({rest.bound:.2f} m), as it must be "
            "on the filter's own model.",
        ),
        Claim(
            claim="The covariance matrix of eq 14 is that of the model of eq 9.",
            where="eqs 5, 7, 14",
            verdict=verdict(not printed_fails),
            evidence=f"With it the covariance turns indefinite (NEES {printed.nees:.0f}) and the position is "
            f"off by {printed.position:.1f} m, more than the measurements ({printed.raw:.1f} m). Eqs 5 "
            "and 7 give the right one, so the paper's figures cannot come from eq 14.",
        ),
        Claim(
            claim="(Implied.) The ellipses of figures 3-5 say where the target is.",
            where="section 5, figures 3-5",
            verdict=verdict(abs(drawn.nees - 9) < 0.3),
            evidence=f"NEES {drawn.nees:.2f} ± {drawn.nees_error:.2f} of 9, {100 * drawn.inside:.1f} % "
            "of truths in the 95 % ellipsoid, when runs begin as P₀ says. Begun exactly at rest, as the paper's, "
            f"{rest.nees:.2f}: "
            "P₀ then allows for errors that are not made.",
        ),
        Claim(
            claim="Eq 6 is the Padé expansion of the transition matrix.",
            where="eq 6",
            verdict=verdict(abs(third - pade) < abs(third - taylor)),
            evidence=f"Its factor of F³ is {third:.4f}: that of the Taylor series is {taylor:.4f}, of Padé's "
            f"(1, 1) {pade:.4f}. Here the series ends: F³ = 0, so three terms are exact (eq 13).",
            sampled=False,
        ),
    )


def third_terms() -> tuple[float, float, float]:
    """Return the factor of F^3 at a step of one second in three approximations.

    They are eq 6, the Taylor series of the exponential, and Padé's (1 - F/2)^-1 (1 + F/2); the last two follow
    from their values at a small F.
    """
    x = 1e-2
    parabola = 1 + x + x * x / 2
    taylor, pade = ((f - parabola) / x**3 for f in (math.exp(x), (1 + x / 2) / (1 - x / 2)))
    return 1 / math.factorial(3), taylor, pade


def misprints_of(drawn: Scores, printed: Scores) -> tuple[Misprint, ...]:
    """Eq 14, by its eigenvalues and by the NEES of the filter that uses it."""
    eq_14, right = printed_noise(DT, DENSITY), wiener_acceleration(DT, DENSITY).Q
    low, sound = float(np.linalg.eigvalsh(eq_14)[0]), float(np.linalg.eigvalsh(right)[0])
    off = float(np.abs(eq_14 - fraction_noise(DT, DENSITY)).max())
    return (
        Misprint(
            where="eq 14",
            printed="t⁵/20 for all three variances of an axis",
            right="t⁵/20, t³/3, t; and t²/2 between velocity and acceleration",
            proof=f"smallest eigenvalue; eqs 5 and 7 of the same paper differ from eq 14 by {off:.2g}",
            printed_value=low,
            right_value=sound,
            proven=bool(low < 0 < sound and off > 0.01),
        ),
        Misprint(
            where="eq 14",
            printed="as above",
            right="as above",
            proof="mean NEES of nine states of the filter that uses it: 9 when consistent",
            printed_value=printed.nees,
            right_value=drawn.nees,
            proven=printed.failed and abs(drawn.nees - 9) < 1,
        ),
    )
