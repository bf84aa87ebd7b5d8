"""Printed scores: each figure with its unit and, if it has one, its bound.

Bounds of NIS and NEES are those of a filter whose every sigma is the true one. A value outside is explained:
below, errors are smaller than the filter claims; above, larger.
"""

from rich.console import Console
from rich.table import Table

from onboard.messages import Fault, Health, NavState
from onboard.scoring.fault import FaultScore
from onboard.scoring.leader import LeaderScore
from onboard.scoring.own_state import OwnStateScore
from onboard.scoring.statistics import Latency
from onboard.units import S_PER_NS

Row = tuple[str, str, str]  # figure, value, required value


def print_leader_score(console: Console, title: str, score: LeaderScore, latency: Latency | None = None) -> None:
    """Print the score of the leader's estimate as a table."""
    print_rows(console, title, score_rows(score, latency))


def print_rows(console: Console, title: str, rows: list[Row]) -> None:
    """Print lines as a table under their title."""
    table = Table(title=title, title_justify="left", title_style="bold", show_edge=False, pad_edge=False)
    table.add_column("")
    table.add_column("measured", justify="right")
    table.add_column("should be", style="dim")
    for name, value, bound in rows:
        table.add_row(name, value, bound)
    console.print(table)


def explain_bounds(console: Console) -> None:
    """Explain the bounds of NIS and NEES."""
    console.print(
        "NIS and NEES: bounds for a filter whose every sigma is the true one. Below, errors are smaller than it "
        "claims (too cautious); above, larger (too sure).",
        style="dim",
        highlight=False,
    )


def score_rows(s: LeaderScore, latency: Latency | None) -> list[Row]:
    """Return the lines of the leader's estimate."""
    rows = [("estimates", f"{s.estimates} ({s.valid} valid, {s.scored} scored)", ""), *_valid_rows(s)]
    if s.range_error_rms_percent is not None:
        after = _scored(s)
        rows += [
            ("range error", f"{s.range_error_rms_percent:.2f} %", after),
            ("position error", f"{s.position_rmse_m or 0:.3f} m", after),
            ("velocity error", f"{s.velocity_rmse_m_s or 0:.3f} m/s", after),
            ("size error", f"{s.size_error_rms_percent or 0:.2f} %", "no better than its prior"),
            _nees_row(s),
            (
                "confidently wrong",
                f"{s.confidently_wrong_percent or 0:.1f} %",
                "off by > 3 sigma and > 5 %",
            ),
            ("truth inside the 95 % ellipsoid", f"{s.inside_95_percent or 0:.1f} %", "95 % over many flights"),
        ]
    if s.nis_mean is not None:
        nis = _assessment(s.nis_mean, s.nis_bounds)
        rows.append((f"NIS ({s.nis_dof})", nis, _bounds_text(s.nis_bounds, "95 % of means")))
    count = sum(s.verdicts.values())
    verdicts = ", ".join(f"{n} {v}" for v, n in sorted(s.verdicts.items()))
    rows.append(("images", f"{count}" + (f" ({verdicts})" if count else ""), ""))
    rows.append(("tracks given up", str(s.resets), ""))
    if s.range_error_rms_percent is not None or s.diverged:
        rows.append(("diverged", "YES" if s.diverged else "no", "no"))
    if latency is not None and latency.p50 is not None:
        own50, own99 = latency.receive_to_publish_p50, latency.receive_to_publish_p99
        rows.append(("exposure to publication", f"p50 {latency.p50:.2f} ms, p99 {latency.p99 or 0:.2f} ms", ""))
        rows.append(("  of it our own", f"p50 {own50 or 0:.2f} ms, p99 {own99 or 0:.2f} ms", ""))
    return rows


def print_health(console: Console, health: Health) -> None:
    """Print received messages, and rejected ones with the reason."""
    streams = ", ".join(f"{name} {s.count}" for name, s in sorted(health.streams.items()))
    console.print(f"autopilot: {health.autopilot}; clock offset from {health.clock_source}", highlight=False)
    console.print(f"messages:  {streams or 'none'}", highlight=False)
    rejected = ", ".join(f"{reason} {n}" for reason, n in sorted(health.rejected.items()))
    console.print(f"rejected:  {rejected or 'none'}", highlight=False)


class OwnStateSummary:
    """Availability of our own state, fit of its covariance, and reported faults."""

    def __init__(self) -> None:
        self._states = self._valid = self._ratios = self._resets = 0
        self._ratio = 0.0
        self._faults: dict[tuple[str, str, int], Fault] = {}

    def add(self, state: NavState) -> None:
        """Add the next state."""
        self._states += 1
        self._valid += state.valid
        self._resets = state.reset_count
        if state.nis_ratio is not None:
            self._ratios += 1
            self._ratio += state.nis_ratio
        for fault in state.faults:
            self._faults[fault.kind, fault.part, fault.t_onset_ns] = fault

    def figures(self) -> dict[str, str]:
        """Return the figures by name; empty without a state."""
        if not self._states:
            return {}
        ratio = f"{self._ratio / self._ratios:.2f}" if self._ratios else "none"
        named = [f.name for f in self._faults.values()]
        return {
            "states": f"{self._states} ({self._valid} valid)",
            "NIS, of its expectation": ratio,
            "begun anew": str(self._resets),
            "faults": ", ".join(dict.fromkeys(named)) or "none",
        }

    def print(self, console: Console) -> None:
        """Print the figures if there was any state."""
        if not self._states:
            return
        figures = self.figures()
        text = ", ".join(f"{name}: {value}" for name, value in figures.items() if name != "faults")
        console.print(f"own state: {text}", highlight=False)
        for f in sorted(self._faults.values(), key=lambda f: f.t_onset_ns):
            name = f.name
            console.print(
                f"  {f.t_onset_ns * S_PER_NS:.2f} s: {name}, {f.magnitude:.2f} {f.unit}", highlight=False
            )


def print_own_state_score(
    console: Console, title: str, score: OwnStateScore, fault: FaultScore | None = None
) -> None:
    """Print the accuracy of our own state, and the detection of a fault, as a table."""
    print_rows(console, title, own_state_rows(score) + (fault_rows(fault) if fault is not None else []))


def own_state_rows(s: OwnStateScore) -> list[Row]:
    """Return the lines of our own state."""
    rows = [("states", f"{s.states} ({s.valid} valid)", ""), *_valid_rows(s)]
    if s.velocity_rmse_m_s is not None:
        after = _scored(s)
        rows += [
            ("velocity error", f"{s.velocity_rmse_m_s:.3f} m/s", after),
            ("attitude error", f"{s.attitude_rmse_deg or 0:.2f} degrees", after),
            ("velocity within 3 sigmas", f"{s.inside_3_sigma_percent or 0:.1f} %", "99.7 % over many flights"),
            _nees_row(s),
        ]
    if s.nis_ratio is not None:
        rows.append(("NIS, of its expectation", f"{s.nis_ratio:.2f}", "1"))
    rows.append(("begun anew", str(s.resets), ""))
    return rows


def fault_rows(f: FaultScore) -> list[Row]:
    """Return the lines of a fault: the true one and the reported one."""
    rows = []
    if f.happened is not None:
        named = "NOT NAMED"
        if f.named is not None:
            named = f"{f.named} ({f.magnitude or 0:.2f}), after {f.after_s or 0:.2f} s"
        rows.append(("fault named", named, f"{f.happened}, at {f.at_s or 0:.2f} s"))
    rows.append(("named wrongly", ", ".join(f.wrong) or "nothing", "nothing"))
    return rows


def _scored(s: LeaderScore | OwnStateScore) -> str:
    """Return the number of estimates that an error covers, in words."""
    return f"RMS, valid, after {s.settle_s:g} s"


def _valid_rows(s: LeaderScore | OwnStateScore) -> list[Row]:
    """Return the share of time with a valid estimate; no line if unknown."""
    if s.valid_percent is None:
        return []
    return [("valid", f"{s.valid_percent:.1f} % of the time", f"after {s.settle_s:g} s")]


def _nees_row(s: LeaderScore | OwnStateScore) -> Row:
    judged = _assessment(s.nees_mean or 0.0, s.nees_bounds)
    return f"NEES ({s.nees_dof})", judged, _bounds_text(s.nees_bounds, "95 % of flights")


def _bounds_text(bounds: tuple[float, float] | None, what: str) -> str:
    return f"{bounds[0]:.2f} to {bounds[1]:.2f} ({what})" if bounds else ""


def _assessment(value: float, bounds: tuple[float, float] | None) -> str:
    """Return a mean NIS or NEES, with its meaning if outside its bounds."""
    words = ""
    if bounds is not None and not bounds[0] <= value <= bounds[1]:
        words = ", too cautious" if value < bounds[0] else ", too sure"
    return f"{value:.2f}{words}"
