"""The paper's claims, and whether they held in our runs."""

from collections.abc import Mapping

import numpy as np

from onboard.models import camera_angles
from studies.relative_motion.scores import Row, Score
from studies.report.findings import Claim, Outcome, verdict
from studies.report.runs import rms
from studies.report.sampling import (
    all_of,
    any_of,
    at_most,
    inside,
    negated,
    none,
    rms_below,
    rms_less,
)

Rows = Mapping[tuple[str, str], Row]

MAX_RANGE_ERROR_PERCENT = 10.0  # "satisfactory": a tenth of the range ...
MAX_DIVERGED_SHARE = 0.02  # ... in all runs but one of fifty
LEARNT_ERROR_RATIO = 0.7  # of a size's error to its prior's: the size is learnt
MAX_NOISE_RATIO = 2.0  # noise settings describe the sensor when within this factor


def claims_of(rows: Rows) -> tuple[Claim, ...]:
    """Judge each claim by thresholds fixed in this file, not by eye."""
    return (
        _satisfactory(rows),
        _nonlinearity(rows),
        _lateral(rows),
        _longitudinal(rows),
        _size(rows),
        _noise(rows),
        _consistency(rows),
    )


def _satisfactory(rows: Rows) -> Claim:
    paper, tuned, honest = (rows["a", name] for name in ("paper", "tuned", "honest"))
    good = rms_below([s.range_percent for s in _kept(paper)], MAX_RANGE_ERROR_PERCENT)
    return Claim(
        claim="The vision-based filter estimates relative position and velocity satisfactorily.",
        where="section IV.B, figures 8, 9, 11, 12",
        verdict=verdict(all_of([good, _hardly_diverges(paper)])),
        evidence=(
            f"Position {paper.value('position_ft'):.2f} ft at some 90 ft, velocity "
            f"{paper.value('velocity_ft_s'):.2f} ft/s, range {paper.value('range_percent'):.1f} % with the "
            f"paper's settings. The velocity is {tuned.value('velocity_ft_s'):.2f} ft/s with noise settings "
            f"that follow from the camera; the position is {honest.value('position_ft'):.2f} ft when the size "
            "is considered instead of estimated. Most of the range error left is the error of the size prior."
        ),
    )


def _nonlinearity(rows: Rows) -> Claim:
    steady, printed, mended = rows["a", "paper"], rows["d", "printed"], rows["d", "paper"]
    return Claim(
        claim="The UKF successfully overcomes the highly nonlinear system characteristics.",
        where="abstract, sections IV.B and V",
        verdict=verdict(_hardly_diverges(printed), _hardly_diverges(mended)),
        evidence=(
            f"While images keep coming {steady.diverged_percent:.0f} % of runs diverge. After five seconds "
            "without one, the paper's process noise has spread the sigma points past the camera: with eq 14's "
            "arctangents as printed, which fold those behind it to the front, "
            f"{printed.diverged_percent:.0f} % diverge; with atan2 and wrapped differences "
            f"{mended.diverged_percent:.0f} %."
        ),
    )


def _lateral(rows: Rows) -> Claim:
    paper, tuned = rows["a", "paper"], rows["a", "tuned"]
    never = sum(s.a_lat_converged_s is None for s in paper.scores)
    return Claim(
        claim="The lateral acceleration converges rapidly from 0 to around 8 ft/s^2.",
        where="section IV.B, figure 14(b)",
        verdict=verdict(none(never, len(paper.scores))),
        evidence=(
            f"Within 20 % of the truth after {_seconds(paper)} (median) with the paper's settings, "
            f"{_seconds(tuned)} with the tuned ones; afterwards off by {paper.value('a_lat_ft_s2'):.2f} and "
            f"{tuned.value('a_lat_ft_s2'):.2f} ft/s^2."
        ),
    )


def _longitudinal(rows: Rows) -> Claim:
    paper, tuned = rows["a", "paper"], rows["a", "tuned"]
    return Claim(
        claim="The longitudinal acceleration is approximately zero in planar circular flight.",
        where="section IV.B, figure 14(c)",
        verdict=verdict(rms_below([s.a_long_ft_s2 for s in _kept(paper)], 0.1 * 8.0)),
        evidence=(
            f"Off by {paper.value('a_long_ft_s2'):.2f} ft/s^2 with the paper's settings, "
            f"{tuned.value('a_long_ft_s2'):.2f} with the tuned ones (the truth is 0)."
        ),
    )


def _size(rows: Rows) -> Claim:
    evidence, learnt = [], []
    for name in ("paper", "tuned"):
        kept = _kept(rows["a", name])
        first = rms([s.size_error_first_percent for s in kept]).value or np.nan
        last = rms([s.size_error_last_percent for s in kept]).value or np.nan
        learnt.append(
            rms_less(
                {s.seed: s.size_error_last_percent for s in kept},
                {s.seed: s.size_error_first_percent for s in kept},
                LEARNT_ERROR_RATIO,
            )
        )
        evidence.append(f"from {first:.1f} % to {last:.1f} % ({name})")
    return Claim(
        claim="The subtended angle ultimately provides the target size.",
        where="abstract, sections IV.B and V, figure 14(a)",
        verdict=verdict(any_of(learnt)),
        evidence=(
            "Three angles give the ratio of range to size, not the size. The error of the size goes, over a "
            f"minute, {' and '.join(evidence)}: it stays that of the prior, or drifts away from it."
        ),
    )


def _noise(rows: Rows) -> Claim:
    errors = np.array([s.angle_error_deg for s in rows["a", "paper"].scores])
    measured = np.sqrt(np.mean(errors**2, axis=0))
    settings = np.array([5.0, 4.0, 3.0])
    ratio = settings / measured
    too_large = [rms_below(e, s) for e, s in zip(errors.T, settings / MAX_NOISE_RATIO, strict=True)]
    names = ", ".join(f"{m:.2f}" for m in measured)
    return Claim(
        claim="R = (5, 4, 3 deg)^2 is the measurement noise.",
        where="eq 54",
        verdict=verdict(negated(any_of(too_large))),
        evidence=(
            f"For one pixel of noise at f = 554 px the {', '.join(camera_angles.COMPONENTS)} angles are off by "
            f"{names} deg: the settings are {ratio.min():.0f} to {ratio.max():.0f} times larger."
        ),
    )


def _consistency(rows: Rows) -> Claim:
    paper, tuned, honest, alone = (rows["a", name] for name in ("paper", "tuned", "honest", "r-alone"))
    low, high = paper.nees_bounds
    return Claim(
        claim="(Implied.) The covariance says how large the errors are.",
        where="eqs 33, 42, 51-54",
        verdict=verdict(inside(paper.value("nees"), low, high, len(_kept(paper)))),
        evidence=(
            f"NEES over nine states should be 9 (95 %: {low:.1f}-{high:.1f}): {paper.value('nees'):.2f} with "
            f"the paper's settings, {tuned.value('nees'):.1f} tuned, {honest.value('nees'):.1f} with "
            "the size considered. "
            f"NIS should be 3: {paper.value('nis'):.4f}, {tuned.value('nis'):.1f}, {honest.value('nis'):.1f}. "
            f"R from the pixels alone does not mend it, with the paper's Q: NEES {alone.value('nees'):.2f}, "
            f"velocity off by {alone.value('velocity_ft_s'):.2f} instead of "
            f"{paper.value('velocity_ft_s'):.2f} ft/s."
        ),
    )


def _kept(row: Row) -> list[Score]:
    """Return the runs that did not diverge."""
    return [s for s in row.scores if s.diverged is None]


def _hardly_diverges(row: Row) -> Outcome:
    return at_most(len(row.scores) - len(_kept(row)), len(row.scores), MAX_DIVERGED_SHARE)


def _seconds(row: Row) -> str:
    t = row.a_lat_converged_s
    return "never" if t is None else f"{t:.1f} s"
