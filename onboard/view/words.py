"""Texts of the view: the pilot's headline, and the panels for the ground."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.messages import (
    DOUBT_PREFIX,
    Estimate,
    Fault,
    FaultKind,
    Health,
    MeasurementReport,
    Mode,
    NavState,
    Severity,
)
from onboard.units import S_PER_NS
from onboard.view.motion import LeaderArrays, RangeEstimate, leader_state, open_interval, range_estimate

NO_ADVICE: Final = "nothing is wrong"
MAX_REFUSAL_ROWS: Final = 5  # the latest


class VehicleRecords(NamedTuple):
    """The newest records of one vehicle of a fleet."""

    leader: Estimate | None = None
    own: NavState | None = None
    health: Health | None = None


LEGEND = """\
± is one standard deviation

*Blue: the estimate. White: the truth. Amber: ourselves. Pink: 3σ ellipsoid (97 %); where the range is open, the
nearest and the farthest place (95 %) instead of an aircraft.*
"""


def plain(text: str) -> str:
    """Replace characters that the viewer's font lacks: a missing glyph can end the viewer."""
    return "".join(c if c == "\n" or " " <= c <= "~" or c in "·±²³σ–µ°×" else "?" for c in text)


def nis_words(report: MeasurementReport | None) -> str:
    """Return in words whether the last image agreed with the track."""
    if report is None:
        return "no image"
    if report.nis is None or report.gate is None:
        return "no NIS"
    return "NIS ok" if report.nis <= report.gate else "NIS TOO HIGH"


def headline(
    estimate: Estimate, leader: LeaderArrays | None, report: MeasurementReport | None, wrong: str = ""
) -> str:
    """Return one line: state, range, closing speed, size; without a track, the fault `wrong`.

    The ± are one standard deviation.
    """
    state = f"LEADER {estimate.state.upper()}"
    if leader is None:
        return f"{state} · {wrong or 'no track'}"
    r = range_estimate(leader)
    words = f"{state} · range {_range(leader, r)} · {_direction(r)} {abs(r.closing):.1f} m/s"
    size, sigma = leader.mean[6], leader.sigma[6]
    if not math.isnan(size):
        words += f" · size {size:.2f} ± {sigma:.2f} m"
    return f"{words} · {nis_words(report)}"


def own_headline(state: NavState) -> str:
    """Return one line on our own state: its certainty and our faults.

    The ± are one standard deviation per axis.
    """
    words = f"OWN STATE {state.state.upper()}"
    if state.covariance is not None:
        variance = np.diag(np.array(state.covariance))
        speed, angle = (math.sqrt(max(float(variance[k : k + 3].mean()), 0.0)) for k in (3, 6))
        words += f" · velocity ± {speed:.2f} m/s · attitude ± {math.degrees(angle):.1f}°"
    return plain(" · ".join([words, *map(fault, state.faults)] if state.faults else [words, "no fault"]))


def fault(one: Fault) -> str:
    """Return a fault and its magnitude."""
    if one.kind is FaultKind.MOTOR:
        return f"{one.part.upper()} WEAK: {one.magnitude:.0%} of its thrust lost"
    return f"{one.kind.upper()} {one.part}".strip() + f": {one.magnitude:.2f} {one.unit}"


def tag(estimate: Estimate, leader: LeaderArrays) -> str:
    """Return the label of the leader in the 3-D view."""
    words = f"{estimate.state.upper()}  {_range(leader, range_estimate(leader))}"
    why = plain(estimate.reason).split("; ")[-1]  # what is open comes last
    return f"{words} · {why}" if open_interval(leader) and why else words


def verdict_label(report: MeasurementReport) -> str:
    """Return the label of the image: its verdict, and its NIS with the gate."""
    name = report.verdict.replace("_", " ").upper()
    if report.nis is None or report.gate is None:
        return name
    return f"{name} · NIS {report.nis:.1f} of {report.gate:.1f}"


def status(
    estimate: Estimate,
    leader: LeaderArrays | None,
    report: MeasurementReport | None,
    error: float | None,
    advice: str = "",
) -> str:
    """Return the status panel as Markdown, `advice` first.

    `report` is the last image's, `error` the distance to the truth (m) if known.
    """
    rows = [advice, ""] if advice else []
    rows += [f"| {estimate.state.upper()} | {'' if estimate.valid else 'not valid'} |", "|---|---|"]
    if leader is not None:
        r = range_estimate(leader)
        rows += [
            f"| range | **{_range(leader, r)}** |",
            f"| {_direction(r)} | **{abs(r.closing):.1f} m/s** |",
            f"| wingspan | **{leader.mean[6]:.2f} ± {leader.sigma[6]:.2f} m** |",
        ]
        if len(estimate.modes) > 1:
            rows.append(f"| possible ranges | {' or '.join(map(_place, estimate.modes))} |")
        if error is not None:
            rows.append(f"| error | {error:.2f} m |")
    age = "–" if estimate.age is None else f"{estimate.age:.2f} s ago"
    rows += [f"| innovation | {nis_words(report)} |", f"| last fused | {age} |", ""]
    if estimate.reason:
        rows += [f"*{plain(estimate.reason)}*", ""]
    return "\n".join([*rows, LEGEND])


def health(record: Health) -> str:
    """Return the health panel as Markdown."""
    rows = [f"**{record.autopilot}**, up {record.uptime:.0f} s, clock from {record.clock_source or '–'}"]
    if record.round_trip is not None:
        rows[0] += f", round trip {record.round_trip * 1e3:.1f} ms"
    rows += [
        f"**{f.kind.upper()} {f.part}** since {f.t_onset_ns * S_PER_NS:.1f} s: {f.magnitude:.2f} {f.unit}"
        for f in record.faults
    ]
    rows += ["", "| stream | Hz | age s | count |", "|---|---:|---:|---:|"]
    rows += [f"| {name} | {s.rate:.1f} | {s.age:.2f} | {s.count} |" for name, s in sorted(record.streams.items())]
    for title, table in (("images", record.verdicts), ("rejected", record.rejected)):
        if table:
            rows += ["", f"{title}: " + " · ".join(f"{name} {n}" for name, n in sorted(table.items()))]
    for r in record.refusals[-MAX_REFUSAL_ROWS:]:
        what = "" if r.reason.startswith(DOUBT_PREFIX) else "**refused** from "
        rows.append(f"{what}{r.source}: {r.reason} ({r.count} times)")
    rows += ["", "| sink | sent | dropped | restarts |", "|---|---:|---:|---:|"]
    rows += [f"| {n} {s.error} | {s.sent} | {s.dropped} | {s.restarts} |" for n, s in sorted(record.sinks.items())]
    return plain("\n".join(rows))


def advice(record: Health) -> str:
    """Return the faults and their remedies as Markdown; "" if there are none."""
    rows = []
    for one in record.advice:
        rows += [f"**{one.severity.upper()}** {one.what}", "", f"> {one.remedy}" if one.remedy else "", ""]
    return plain("\n".join(rows)).replace("`", "").replace("[", "\\[")


def own_status(state: NavState, advice: str = "") -> str:
    """Return the status panel without a leader as Markdown: `advice`, own state, and faults."""
    rows = [advice, "", f"| {state.state.upper()} | {'' if state.valid else 'not valid'} |", "|---|---|"]
    rows += [f"| quality | **{state.quality} %** |"] if state.quality >= 0 else []
    rows += [f"| {one.kind} | **{fault(one)}**, since {one.t_onset_ns * S_PER_NS:.1f} s |" for one in state.faults]
    return "\n".join([*rows, "", f"*{plain(state.reason)}*"])


def worst(record: Health) -> str:
    """Return the most severe fault in a few words; "" if there is none."""
    return next((plain(one.text) for one in record.advice if one.severity is not Severity.NOTICE), "")


def fleet(vehicles: Mapping[str, VehicleRecords]) -> str:
    """Return a narrow Markdown table of all vehicles: leader, own faults, other faults."""
    rows = ["| vehicle | leader | fault | advice |", "|---|---|---|---|"]
    for name, one in sorted(vehicles.items()):
        leader = "-"
        if one.leader is not None:
            state = leader_state(one.leader)
            leader = one.leader.state if state is None else _range(state, range_estimate(state))
        faults = ", ".join(f"{f.part or f.kind} {f.magnitude:.2f}" for f in one.own.faults) if one.own else ""
        wrong = "?" if one.health is None else worst(one.health)
        rows.append(f"| {name} | {leader} | {faults or '-'} | {wrong or '-'} |")
    return plain("\n".join(rows))


def _range(leader: LeaderArrays, r: RangeEstimate) -> str:
    """Return the range and its sigma, or its interval if uncertain."""
    ends = open_interval(leader)
    return f"{r.range:.1f} ± {r.sigma:.1f} m" if ends is None else f"OPEN: {ends[0]:.0f} to {ends[1]:.0f} m"


def _place(mode: Mode) -> str:
    return f"{math.hypot(*mode.mean[:3]):.0f} m ({mode.weight:.0%})"


def _direction(r: RangeEstimate) -> str:
    return "closing" if r.closing >= 0 else "opening"
