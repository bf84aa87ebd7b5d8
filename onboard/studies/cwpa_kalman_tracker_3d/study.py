"""Lazarov, Kabakchiev, Dimitrov & Minchev, "Kalman Tracking Filter in 3-D Space".

A linear Kalman filter on a continuous Wiener process acceleration, whose process noise is misprinted (eq 14). The
paper gives no sampling interval; half a second here. States as the paper orders them: positions, velocities,
accelerations; "relative dimensions", read as m.
"""

from importlib import import_module
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from onboard.arrays import Array
from onboard.filters import kalman
from onboard.filters.belief import Belief
from onboard.filters.discretisation import wiener_acceleration
from onboard.filters.gating import chi_square_threshold, mean_bounds, normalised_squared
from onboard.studies.cwpa_kalman_tracker_3d.runs import (
    DENSITY,
    DT,
    P0,
    RUNS_PER_SEED,
    STEPS,
    H,
    R,
    fly,
    fraction_noise,
    printed_noise,
)
from onboard.studies.report import findings as report
from onboard.studies.report.findings import Claim, Findings, Misprint, Table
from onboard.studies.report.workers import Part, Progress, compute, require_seeds, write

NAME: Final = "cwpa-kalman-tracker-3d"
TITLE: Final = "Lazarov et al.: a linear Kalman tracker in three dimensions"
GOLDEN: Final = (4.427842, 3.639966, 2.406474, 0.442784, 0.257108, 0.074647)


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study over `seeds` times 20 runs; with `out`, figures and report are written (the extra `study`)."""
    if out is not None:
        import_module("matplotlib")
    every = require_seeds(seeds, first_seed)
    noises = (None, None, printed_noise(DT, DENSITY))
    parts = [
        Part(_scores, (every, drawn, noise)) for drawn, noise in zip((True, False, True), noises, strict=True)
    ]
    drawn, rest, printed = compute(parts, jobs if jobs is not None else 1, progress)  # each takes a second
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=(
            f"{seeds * RUNS_PER_SEED} runs of {STEPS} steps on the paper's model, {DT:g} s apart (an "
            "assumption: the paper states no interval), q 0.2, R = diag(10, 8, 5), P₀ as printed. The bound is "
            "the posterior Cramér–Rao bound, which a Kalman filter on its own linear model attains."
        ),
        seeds=seeds,
        first_seed=first_seed,
        tables=(_table(drawn, rest, printed),),
        checks=_checks(drawn),
        claims=_claims(drawn, rest, printed),
        misprints=misprints(printed["nees"], drawn["nees"]),
        figures=(),
    )
    if out is not None:
        from onboard.studies.cwpa_kalman_tracker_3d import figures as cwpa_figures  # noqa: PLC0415 - matplotlib is an extra

        found = msgspec.structs.replace(found, figures=cwpa_figures.draw(fly(first_seed, 1, drawn=False), out))
        write(found, out)
    return found


def _scores(seeds: range, drawn: bool, noise: Array | None) -> dict[str, float]:
    together = [fly(seed, RUNS_PER_SEED, drawn, noise) for seed in seeds]
    error = np.concatenate([r.mean - r.truth for r in together], axis=1)
    raw = np.concatenate([r.seen - r.truth[..., :3] for r in together], axis=1)
    nees = normalised_squared(error, together[0].covariance[:, None])
    position = np.trace(together[0].covariance[:, :3, :3], axis1=1, axis2=2)
    velocity = np.trace(together[0].covariance[:, 3:6, 3:6], axis1=1, axis2=2)
    return {
        "position": _rms(error[..., :3]),
        "velocity": _rms(error[..., 3:6]),
        "acceleration": _rms(error[..., 6:]),
        "raw": _rms(raw),
        "nees": float(nees.mean()),
        "inside": float(np.mean(nees < chi_square_threshold(0.95, 9))),
        "bound": float(np.sqrt(position.mean())),
        "velocity_bound": float(np.sqrt(np.abs(velocity.mean()))),
    }


def _table(*scores: dict[str, float]) -> Table:
    names = (
        "right Q, start drawn from P₀",
        "right Q, start at rest (the paper)",
        "Q of eq 14, start drawn from P₀",
    )
    keys = ("position", "velocity", "acceleration", "raw", "bound", "nees", "inside")
    low, high = mean_bounds(9, 50)
    return Table(
        title="Results",
        note="Root mean squares of vector lengths over all steps. NEES of nine states: 9 (95 % of 50 runs: "
        f"{low:.1f} to {high:.1f}); a negative one has no meaning: the covariance is none.",
        header=(
            "filter",
            "position m",
            "velocity m/s",
            "acceleration m/s²",
            "raw m",
            "bound m",
            "NEES",
            "in 95 %",
        ),
        rows=tuple((name, *(s[k] for k in keys)) for name, s in zip(names, scores, strict=True)),
    )


def final() -> tuple[Array, Array]:
    """Covariance (9, 9) after the last step and the last gain (9, 3), by the package's own filter."""
    F, Q = wiener_acceleration(DT, DENSITY)
    belief, gain = Belief(np.zeros(9), P0), np.zeros((9, 3))
    for _ in range(STEPS):
        belief = kalman.update(kalman.predict(belief, F, Q), np.zeros(3), H, R).belief
        gain = belief.covariance @ H.T @ np.linalg.inv(R)  # K = P+ H^T R^-1
    return belief.covariance, gain


def _checks(drawn: dict[str, float]) -> tuple[report.Check, ...]:
    P, K = final()
    ours = (*np.diag(P)[:3], K[0, 0], K[3, 0], K[6, 0])
    names = ("P₅₀ x", "P₅₀ y", "P₅₀ z", "gain x", "gain vx", "gain ax")
    units = ("m²",) * 3 + ("", "1/s", "1/s²")
    exact = np.abs(wiener_acceleration(DT, DENSITY).Q - fraction_noise(DT, DENSITY)).max()
    return (
        *(report.near(n, u, float(v), g, 5e-7) for n, u, v, g in zip(names, units, ours, GOLDEN, strict=True)),
        report.near("mean NEES of 9 states", "", drawn["nees"], 9.0, 0.3),
        report.check("closed Q against the matrix fraction", "", float(exact), 0.0, 1e-15),
        report.near("position RMSE over the Cramér–Rao bound", "", drawn["position"] / drawn["bound"], 1.0, 0.03),
    )


def _claims(drawn: dict[str, float], rest: dict[str, float], printed: dict[str, float]) -> tuple[Claim, ...]:
    gain = 1 - rest["position"] / rest["raw"]
    converges = rest["position"] < rest["raw"] and rest["position"] < 1.1 * rest["bound"]
    printed_fails = printed["nees"] < 0 or printed["position"] > printed["raw"]
    return (
        Claim(
            claim="The estimated trajectory converges satisfactorily to the real one.",
            where="section 5, figures 2-5",
            verdict="holds" if converges else "does not hold",
            evidence=f"Position {rest['position']:.2f} m where the measurements are off by {rest['raw']:.2f} m "
            f"({100 * gain:.0f} % less), velocity {rest['velocity']:.2f} m/s. That is the Cramér–Rao bound "
            f"({rest['bound']:.2f} m), as it must be on the filter's own model.",
        ),
        Claim(
            claim="The covariance matrix of eq 14 is that of the model of eq 9.",
            where="eqs 5, 7, 14",
            verdict="does not hold" if printed_fails else "holds",
            evidence=f"With it the covariance turns indefinite (NEES {printed['nees']:.0f}) and the position is "
            f"off by {printed['position']:.1f} m, more than what is measured ({printed['raw']:.1f} m). Eqs 5 "
            "and 7 give the right one, so the paper's figures cannot come from eq 14.",
        ),
        Claim(
            claim="(Implied.) The ellipses of figures 3-5 say where the target is.",
            where="section 5, figures 3-5",
            verdict="holds" if abs(drawn["nees"] - 9) < 0.3 else "does not hold",
            evidence=f"NEES {drawn['nees']:.2f} of 9, {100 * drawn['inside']:.1f} % of truths in the 95 % "
            f"ellipsoid, when runs begin as P₀ says. Begun exactly at rest, as the paper's, {rest['nees']:.2f}: "
            "P₀ then allows for errors that are not made.",
        ),
        Claim(
            claim="Eq 6 is the Padé expansion of the transition matrix.",
            where="eq 6",
            verdict="does not hold",
            evidence="It is the Taylor series. Here it ends: F³ = 0, so three terms are exact (eq 13).",
        ),
    )


def misprints(printed_nees: float, right_nees: float) -> tuple[Misprint, ...]:
    """Eq 14, by eigenvalues and by what it does to a filter."""
    printed, right = printed_noise(DT, DENSITY), wiener_acceleration(DT, DENSITY).Q
    low, sound = float(np.linalg.eigvalsh(printed)[0]), float(np.linalg.eigvalsh(right)[0])
    off = float(np.abs(printed - fraction_noise(DT, DENSITY)).max())
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
            printed_value=printed_nees,
            right_value=right_nees,
            proven=bool(printed_nees < 0 and abs(right_nees - 9) < 1),
        ),
    )


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
