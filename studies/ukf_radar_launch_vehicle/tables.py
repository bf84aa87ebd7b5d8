"""Tables of the launch-vehicle study."""

from collections.abc import Mapping

from onboard.filters.gating import mean_bounds
from studies.report.findings import Cell, Table
from studies.tracking.outcomes import Outcome, WindowErrors
from studies.ukf_radar_launch_vehicle.runs import NAMES, STAGED_DENSITY, Results

ERRORS = (*(x for n in NAMES for x in (f"position m, {n}", "±")), *(f"velocity m/s, {n}" for n in NAMES))


def main_table(single: Results, triple: Results, staged: Results) -> Table:
    """Every filter with each noise."""
    groups = (("1σ, q 1", single), ("3σ, q 1", triple), (f"1σ, q {STAGED_DENSITY:g}, raised at events", staged))
    low, high = mean_bounds(9, single.outcomes["ukf"].runs)
    return Table(
        title="Results",
        note="Root mean squares of the lengths of error vectors, by window of flight, ± their standard error by "
        "the scatter over runs. Where runs failed, errors are of the others, which are the easier ones: they do "
        f"not compare. NEES of nine states in the last window: 9 when consistent (95 %: {low:.1f} to {high:.1f}, "
        "were each run one sample). Within 1σ: components of position and velocity by the filter's own "
        "account; 0.683 when it is right.",
        header=("radar noise", "filter", *ERRORS, "NEES", "within 1σ", "failed"),
        rows=tuple(
            (noise, o.label, *_errors(o), o.shown(o.windows[NAMES[-1]].nees), results.within[name], o.failures)
            for noise, results in groups
            for name, o in results.outcomes.items()
        ),
    )


def sweep_table(sweep: Mapping[float, Results], bounds: Mapping[float, Mapping[str, float]]) -> Table:
    """Return the table of the unscented filter with every process noise q, (m/s^3)^2/Hz.

    `bounds` are by q and window, m.
    """
    return Table(
        title="Every process noise",
        note="The unscented filter. The last columns: how far the extended filter's position is from it after "
        "262 s, and the least position error of any filter that knows as much of the motion as q says "
        "(posterior Cramér–Rao bound; the true motion is smoother than q = 1 says, so a filter may be better "
        "than that).",
        header=("q (m/s³)²/Hz", *ERRORS, "EKF − UKF mm", *(f"bound m, {n}" for n in NAMES)),
        rows=tuple(
            (q, *_errors(results.outcomes["ukf"]), 1e3 * results.gap, *(bounds.get(q, {}).get(n) for n in NAMES))
            for q, results in sorted(sweep.items())
        ),
    )


def _errors(o: Outcome) -> list[Cell]:
    position = [x for w in _windows(o) for x in (o.shown(w.position), w.standard_error("position"))]
    return [*position, *(o.shown(w.velocity) for w in _windows(o))]


def _windows(o: Outcome) -> list[WindowErrors]:
    return [o.windows[n] for n in NAMES]
