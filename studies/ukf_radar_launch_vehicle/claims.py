"""The claims of Varaprasad et al., and whether they held in our runs."""

from collections.abc import Sequence

from studies.report.findings import Claim, verdict
from studies.report.findings import Outcome as Decision
from studies.report.sampling import all_of, any_of
from studies.tracking.outcomes import Outcome
from studies.ukf_radar_launch_vehicle.runs import NAMES, Results

LAST = NAMES[-1]
BETTER_ERROR_RATIO = 0.95  # "more accurate": by a twentieth at least


def claims_of(
    single: Results, triple: Results, flights: Sequence[Results], bound: dict[str, float]
) -> tuple[Claim, ...]:
    """Judge each claim by thresholds fixed in this file.

    `flights`: with any process noise; `bound`: the least errors for nearly steady acceleration.
    """
    return (
        _accuracy("unscented", 5.0, 5.0, [f.outcomes["ukf"] for f in flights], bound, "section 5, figure 11"),
        _accuracy("extended", 10.0, 10.0, [f.outcomes["ekf"] for f in flights], bound, "section 5, figure 12"),
        _triple(triple),
        _better(single, triple),
        _consistent(single),
        _close_points(single),
    )


def _inside(o: Outcome, position: float, velocity: float) -> dict[str, Decision]:
    """Return by window whether both errors are within the claimed size."""
    return {
        name: all_of((w.within("position", position), w.within("velocity", velocity)))
        for name, w in o.windows.items()
    }


def _throughout(o: Outcome, position: float, velocity: float) -> Decision:
    """Whether they are in all windows: the paper says "throughout the flight"."""
    return all_of(_inside(o, position, velocity).values())


def _accuracy(
    name: str, position: float, velocity: float, outcomes: Sequence[Outcome], bound: dict[str, float], where: str
) -> Claim:
    best = min(outcomes, key=lambda o: o.windows[LAST].position)
    inside = [[n for n, yes in _inside(o, position, velocity).items() if yes] for o in outcomes]
    kept = max(inside, key=len)
    found = ", ".join(
        f"{w.text('position', 1)} m and {w.text('velocity', 1)} m/s ({n})" for n, w in outcomes[0].windows.items()
    )
    return Claim(
        claim=f"The {name} filter's errors stay within {position:g} m and {velocity:g} m/s, but at stage events.",
        where=where,
        verdict=verdict(any_of(_throughout(o, position, velocity) for o in outcomes)),
        evidence=f"With q 1, rms: {found}. "
        + (f"It holds in {', '.join(kept)} only. " if kept else "In no window, with no process noise. ")
        + f"The best of all q has {best.windows[LAST].position:.0f} m at the end. 0.2 mrad at 1000 km are 200 "
        f"m; a filter that knew the motion to q 0.01 could not do better than {bound[LAST]:.0f} m there.",
    )


def _triple(triple: Results) -> Claim:
    ukf, ekf = triple.outcomes["ukf"], triple.outcomes["ekf"]
    holds = all_of((_throughout(ukf, 10.0, 5.0), _throughout(ekf, 25.0, 20.0)))
    numbers = ", ".join(
        f"{u.text('position', 0)} m and {u.text('velocity', 0)} m/s ({n})" for n, u in ukf.windows.items()
    )
    apart = max(abs(u.position - ekf.windows[n].position) for n, u in ukf.windows.items())
    return Claim(
        claim="With three times the noise: 10 m and 5 m/s unscented, 25 m and 20 m/s extended.",
        where="section 5, figures 13, 14",
        verdict=verdict(holds),
        evidence=f"Unscented {numbers}; the extended filter's position errors differ from these by "
        f"{1e3 * apart:.1f} mm at most.",
    )


def _better(single: Results, triple: Results) -> Claim:
    plain = single.outcomes["ekf-plain"]
    holds = all_of(
        f.outcomes["ukf"].windows[n].better(f.outcomes["ekf"].windows[n], "position", BETTER_ERROR_RATIO)
        for f in (single, triple)
        for n in NAMES
    )
    return Claim(
        claim="The unscented filter is more accurate than the extended one.",
        where="abstract, sections 5 and 6",
        verdict=verdict(holds, plain.failed > 0),
        evidence=f"Their positions after 262 s are {1e3 * single.gap:.1f} mm apart (rms), with three times the "
        f"noise {1e3 * triple.gap:.0f} mm. Where the extended filter's covariance is never made "
        f"symmetric (eq 18 as it stands) {plain.failed} of {plain.runs} runs fail, at "
        f"{plain.failed_at:.0f} s (median). A filter that keeps symmetry does not.",
    )


def _consistent(single: Results) -> Claim:
    within, ukf = single.within["ukf"], single.outcomes["ukf"]
    nees = ", ".join(f"{w.text('nees', 1)} ({n})" for n, w in ukf.windows.items())
    return Claim(
        claim="Errors run within their 1σ bounds: the filter is consistent.",
        where="section 5, figures 5-10",
        verdict=verdict(0.6 < within < 0.85),
        evidence=f"With q 1, {100 * within:.0f} % of the components' errors are within 1σ (68 % would be "
        f"exact), away from events. NEES of nine: {nees}. The small overconfidence of the first window is "
        "burning stages, whose acceleration grows; lower q makes it worse quickly.",
    )


def _close_points(single: Results) -> Claim:
    close, wide = (single.outcomes[name].windows[LAST] for name in ("ukf-scaled", "ukf"))
    return Claim(
        claim="The sigma points should be close together (a small α) to avoid non-local effects.",
        where="section 3.1",
        verdict=verdict(close.better(wide, "position", BETTER_ERROR_RATIO)),
        evidence=f"With α = 10⁻³ the position after 262 s is {close.text('position')} m off, with the points √9 σ "
        f"apart {wide.text('position')} m. Where both are the same, the measurement is straight over the prior, "
        "and α only spends digits, with weights of a million.",
    )
