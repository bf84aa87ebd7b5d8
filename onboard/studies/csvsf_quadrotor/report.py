"""The quadrotor study's Markdown report, and its tables as rows of text."""

from collections.abc import Sequence
from typing import Final

from onboard.messages import Record
from onboard.studies.csvsf_quadrotor.cases import NAMED, Variant
from onboard.studies.csvsf_quadrotor.filters import EVERY, MAIN, METHODS
from onboard.studies.csvsf_quadrotor.scores import Comparison, Limit, Row
from onboard.studies.report.findings import Claim, Misprint

NOTHING: Final = "–"
SETTING: Final = """\
{seeds} simulated flights of 20 s of a quadrotor on a figure eight, for each thing that is wrong (of those whose
figures are held against nothing, {few}: other masses and inertias, lasting gusts, no velocity); all twelve states
measured at 100 Hz, unless the column says otherwise. The filters keep the nominal parameters and, but for
"Q x 300", the truth's own process noise."""
DEFINITIONS: Final = """\
Root mean square of the error vector's length over 10–20 s of all runs, the diverged ones too. *Diverged* (†, in
more than half of the runs): over the last 5 s the mean error of some state is more than five standard deviations
of its raw measurement. NEES over twelve states: 12 is right. Gusts: 3 m/s² from a random side and Gauss-Markov
(1 m/s², 1 s), from 10 s; for 2 s: 3 m/s² at 12–14 s. GPS 10 Hz: attitude and rates at 100 Hz, positions and
velocities at 10; where it says so, an accelerometer ({force_sigma:g} m/s² white a sample, no bias) takes the place
of the commanded thrust, or of all that pushes."""
LIMITS: Final = """\
What is asked of one filter at once: where nothing is wrong the CKF's accuracy within 1 %; with outliers
≤ .016 m/s; with all inputs x .7 ≤ .09 m/s; with a weak motor ≤ .06 rad/s; and none diverged. In bold what is
met."""
SWEEP: Final = """\
Settings of the adaptive form were chosen on flights of other seeds, of which {seeds} (from {first}) are swept here
one at a time: `fading`, the share of the newest innovation in the mean that tells a wrong model; `patience`, the
samples that an exceedance must last before it is followed. Chosen: {fading:g}, so that a GPS's last second counts,
and {patience}. Less fading finds smaller errors, later; more patience bears more outliers in a row."""
COMPARED: Final = """\
Velocity, m/s, with its standard error, beside an independent implementation's 60 flights of other seeds: to agree
within 5 % without error and within 10 % with. *As printed only*: farther off than that, but not from every number
that is printed like the reference, which has two or three digits. The UKF, the other errors and the
accelerometer's noise are not in it. With Q x 300 and no error a scalar filter's steady gain gives .0349 m/s,
and a textbook filter, written down for the tests alone, what ours does: .033 would take a factor of 220."""
NOT_JUDGED: Final = """\
Not judged: the paper's own curves, which are not in its text. Its R of the gyros (7e-12 and less) is no gyro's:
4e-4 (rad/s)² here."""


class Setting(Record, frozen=True, kw_only=True):
    """The adaptive form with one setting changed, on the seeds for choosing: velocity (m/s) without error, with
    inputs x .7 and with outliers, and rates (rad/s) with a weak motor."""

    fading: float
    patience: int
    none_m_s: float
    weak_m_s: float
    outliers_m_s: float
    motor_rad_s: float


class Result(Record, frozen=True, kw_only=True):
    """What the study found over `seeds` flights of each variant."""

    seeds: int
    first_seed: int
    rows: tuple[Row, ...]
    comparisons: tuple[Comparison, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...]  # file names, drawn from the first seed
    limits: tuple[Limit, ...]
    sweep: tuple[Setting, ...]
    sweep_seeds: int
    sweep_first_seed: int
    misprints: tuple[Misprint, ...]


def pivot(rows: Sequence[Row], variants: Sequence[Variant], quantity: str) -> list[tuple[str, ...]]:
    """A header, and for each method its figure in each variant."""
    by_name = {(row.variant, row.method): row for row in rows}
    wanted = {variant.name for variant in variants}
    methods = dict.fromkeys(row.method for row in rows if row.variant in wanted)
    lines: list[tuple[str, ...]] = [("", *(variant.label for variant in variants))]
    for method in methods:
        cells = [_cell(by_name.get((variant.name, method)), quantity) for variant in variants]
        lines.append((EVERY[method].label, *cells))
    return lines


def limits_table(limits: Sequence[Limit]) -> list[tuple[str, ...]]:
    """A header, and for each method what it reaches of the four that are asked at once."""
    by_name = {(limit.method, limit.variant): limit for limit in limits}
    columns = ("none", "outliers", "weak", "motor")
    first = [by_name[METHODS[0].name, variant] for variant in columns]
    units = {"velocity_m_s": "m/s", "rates_rad_s": "rad/s"}
    header = [f"{NAMED[x.variant].label}, ≤ {x.limit:.4g} {units[x.quantity]}" for x in first]
    lines: list[tuple[str, ...]] = [("", *header, "all")]
    for method in METHODS:
        found = [by_name[method.name, variant] for variant in columns]
        cells = [f"**{_number(x.value, 4)}**" if x.met else _number(x.value, 4) for x in found]
        lines.append((method.label, *cells, "**yes**" if all(x.met for x in found) else "no"))
    return lines


def sweep_table(sweep: Sequence[Setting]) -> list[tuple[str, ...]]:
    """A header and a line for each setting."""
    header = ("fading", "patience", "no error, m/s", "inputs x .7, m/s", "weak motor, rad/s", "outliers, m/s")
    lines: list[tuple[str, ...]] = [header]
    return lines + [
        (
            f"{s.fading:g}",
            f"{s.patience}",
            *(_number(x) for x in (s.none_m_s, s.weak_m_s, s.motor_rad_s, s.outliers_m_s)),
        )
        for s in sweep
    ]


def misprint_table(misprints: Sequence[Misprint]) -> list[tuple[str, ...]]:
    """A header, and what each gives."""
    lines: list[tuple[str, ...]] = [("where", "printed", "right", "proof", "printed gives", "right gives", "")]
    return lines + [
        (
            *(m.where, m.printed, m.right, m.proof, _number(m.printed_value), _number(m.right_value)),
            "proven" if m.proven else "NOT PROVEN",
        )
        for m in misprints
    ]


def comparison_table(comparisons: Sequence[Comparison]) -> list[tuple[str, ...]]:
    """A header, and ours beside the reference."""
    lines: list[tuple[str, ...]] = [("variant", "method", "ours", "", "reference", "tolerance", "")]
    return lines + [
        (
            NAMED[c.variant].label,
            EVERY[c.method].label,
            _number(c.ours),
            f"± {_number(c.standard_error, 2)}",
            f"{c.reference:g}",
            f"± {c.tolerance:.2g}",
            "agrees" if c.agrees else "as printed only" if c.agrees_as_printed else "DIFFERS",
        )
        for c in comparisons
    ]


def markdown(result: Result, force_sigma: float, chosen: tuple[float, int]) -> str:
    """The report."""
    full = [v for v in NAMED.values() if not v.multirate]
    main = [NAMED[name] for name in MAIN]
    others = [v for v in full if v not in main]
    slow = [v for v in NAMED.values() if v.multirate]
    claims = [(c.claim, c.where, f"**{c.verdict}**", c.evidence) for c in result.claims]
    fading, patience = chosen
    sections = [
        "# A quadrotor's own state: Al-Shabi, Gadsden & Wilkerson's cubature smooth variable structure filter",
        SETTING.format(seeds=result.seeds, few=min(row.runs for row in result.rows)),
        "## Velocity, m/s",
        DEFINITIONS.format(force_sigma=force_sigma),
        _table(pivot(result.rows, main, "velocity_m_s")),
        _table(pivot(result.rows, others, "velocity_m_s")),
        _table(pivot(result.rows, slow, "velocity_m_s")),
        "## Rates, rad/s",
        _table(pivot(result.rows, full, "rates_rad_s")),
        "## Attitude (Euler angles), rad",
        _table(pivot(result.rows, full, "attitude_rad")),
        "## NEES (12)",
        _table(pivot(result.rows, [*full, *slow], "nees")),
        "## The paper's claims",
        _table([("claim", "where", "verdict", "evidence"), *claims]),
        NOT_JUDGED,
        "## Misprints, and their proof in numbers",
        _table(misprint_table(result.misprints)),
        "## One filter for all of it",
        LIMITS,
        _table(limits_table(result.limits)),
        SWEEP.format(seeds=result.sweep_seeds, first=result.sweep_first_seed, fading=fading, patience=patience),
        _table(sweep_table(result.sweep)),
        "## Beside an independent implementation",
        COMPARED,
        _table(comparison_table(result.comparisons)),
        f"## Figures: one flight, seed {result.first_seed}",
        "\n\n".join(f"![{name}]({name})" for name in result.figures) or "None were drawn.",
    ]
    return "\n\n".join(sections) + "\n"


def _cell(row: Row | None, quantity: str) -> str:
    if row is None:
        return NOTHING
    return _number(row.quantities[quantity].value) + ("†" if row.diverged_percent > 50 else "")


def _number(value: float | None, digits: int = 3) -> str:
    return NOTHING if value is None else f"{value:.{digits}g}"


def _table(lines: Sequence[Sequence[str]]) -> str:
    header, *rows = lines
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows])
