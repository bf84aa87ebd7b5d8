"""The result of the quadrotor study, and its report."""

from collections.abc import Sequence
from typing import Final

from onboard.filters.cubature_smooth import FADING_FRACTION, MIN_EXCEEDANCE_STEPS
from onboard.messages import Record
from studies.csvsf_quadrotor.cases import FORCE_SIGMA, NAMED, Variant
from studies.csvsf_quadrotor.filters import EVERY, MAIN, METHODS
from studies.csvsf_quadrotor.scores import ASKED, Comparison, Limit, Row
from studies.report.findings import Claim, Findings, Misprint, Table
from studies.report.markdown import UNKNOWN, number
from studies.report.runs import by_name

UNITS: Final = {"velocity_m_s": "m/s", "rates_rad_s": "rad/s"}
SETTING: Final = """\
{seeds} simulated flights of 20 s of a quadrotor on a figure eight, for each error ({few} for those whose figures
are compared with nothing: other masses and inertias, steady gusts, no velocity); all twelve states measured at
100 Hz, unless the column says otherwise. The filters keep the nominal parameters and, but for "Q x 300", the
truth's own process noise.

Not judged: the paper's own curves, which are not in its text. Its R of the gyros (7e-12 and less) is no gyro's:
4e-4 (rad/s)² here."""
DEFINITIONS: Final = """\
Root mean square of the error vector's length over 10–20 s of all runs, the diverged ones too. *Diverged* (†, in
more than half of the runs): over the last 5 s the mean error of some state is more than five standard deviations
of its raw measurement. NEES over twelve states: 12 is right. Gusts: 3 m/s² from a random side and Gauss-Markov
(1 m/s², 1 s), from 10 s; for 2 s: 3 m/s² at 12–14 s. GPS 10 Hz: attitude and rates at 100 Hz, positions and
velocities at 10; where the column says so, an accelerometer ({force_sigma:g} m/s² white a sample, no bias) takes
the place of the commanded thrust, or of all forces."""
LIMITS: Final = """\
What is asked of one filter at once: without error the CKF's accuracy within 1 %; with outliers ≤ .016 m/s; with
all inputs x .7 ≤ .09 m/s; with a weak motor ≤ .06 rad/s; and no run diverged. In bold: met."""
SWEEP: Final = """\
The settings were chosen on flights of other seeds, of which {seeds} (from {first}) are swept here one at a time.
`fading`: the share of the newest innovation in the mean that detects a wrong model. `patience`: the samples that
an exceedance must last before the filter follows it. Chosen: {fading:g}, so that a GPS's last second counts, and
{patience}. Less fading finds smaller errors, later; more patience bears more outliers in a row."""
COMPARED: Final = """\
Velocity, m/s, with its standard error, beside an independent implementation's 60 flights of other seeds: to agree
within 5 % without error and within 10 % with. *As printed only*: the difference is larger, but not from every
number that is printed like the reference, which has two or three digits. The UKF, the other errors and the
accelerometer's noise are not in the reference. With Q x 300 and no error a scalar filter's steady gain gives
.0349 m/s, and a textbook filter, which the tests have for this alone, gives what ours does: .033 would take a
factor of 220."""


class Setting(Record, frozen=True, kw_only=True):
    """Errors of the adaptive form with one setting changed, on the seeds for choosing."""

    fading: float
    patience: int
    none_m_s: float
    weak_m_s: float
    outliers_m_s: float
    motor_rad_s: float


class Result(Record, frozen=True, kw_only=True):
    """The results of the study over `seeds` flights of each variant."""

    seeds: int
    first_seed: int
    rows: tuple[Row, ...]
    comparisons: tuple[Comparison, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...] = ()  # file names, drawn from the first seed
    limits: tuple[Limit, ...]
    sweep: tuple[Setting, ...]
    sweep_seeds: int
    sweep_first_seed: int
    misprints: tuple[Misprint, ...]


def findings(result: Result, study: str, title: str) -> Findings:
    """Return the findings for the report."""
    full = [v for v in NAMED.values() if not v.multirate]
    main = [NAMED[name] for name in MAIN]
    others = [v for v in full if v not in main]
    slow = [v for v in NAMED.values() if v.multirate]
    definitions = DEFINITIONS.format(force_sigma=FORCE_SIGMA)
    return Findings(
        study=study,
        title=title,
        setting=SETTING.format(seeds=result.seeds, few=min(row.runs for row in result.rows)),
        seeds=result.seeds,
        first_seed=result.first_seed,
        tables=(
            pivot("Velocity, m/s", result.rows, main, "velocity_m_s", definitions),
            pivot("Velocity, m/s: other errors", result.rows, others, "velocity_m_s"),
            pivot("Velocity, m/s: GPS at 10 Hz", result.rows, slow, "velocity_m_s"),
            pivot("Rates, rad/s", result.rows, full, "rates_rad_s"),
            pivot("Attitude (Euler angles), rad", result.rows, full, "attitude_rad"),
            pivot("NEES (12)", result.rows, [*full, *slow], "nees"),
            limits_table(result.limits),
            sweep_table(result),
            comparisons_table(result.comparisons),
        ),
        claims=result.claims,
        misprints=result.misprints,
        figures=result.figures,
    )


def pivot(title: str, rows: Sequence[Row], variants: Sequence[Variant], quantity: str, note: str = "") -> Table:
    """A quantity: a line for each method, a column for each variant."""
    known = by_name(rows)
    wanted = {variant.name for variant in variants}
    methods = dict.fromkeys(row.method for row in rows if row.variant in wanted)
    return Table(
        title=title,
        note=note,
        header=("", *(variant.label for variant in variants)),
        rows=tuple(
            (EVERY[method].label, *(_cell(known.get((variant.name, method)), quantity) for variant in variants))
            for method in methods
        ),
    )


def limits_table(limits: Sequence[Limit]) -> Table:
    """Each method's figures of the four that are asked at once."""
    known = {(limit.method, limit.variant): limit for limit in limits}
    columns = [variant for variant, _, _ in ASKED]
    asked = [known[METHODS[0].name, variant] for variant in columns]
    rows = []
    for method in METHODS:
        found = [known[method.name, variant] for variant in columns]
        cells = [f"**{number(x.value, 4)}**" if x.met else number(x.value, 4) for x in found]
        rows.append((method.label, *cells, "**yes**" if all(x.met for x in found) else "no"))
    header = (f"{NAMED[x.variant].label}, ≤ {x.limit:.4g} {UNITS[x.quantity]}" for x in asked)
    return Table(title="One filter for all of it", note=LIMITS, header=("", *header, "all"), rows=tuple(rows))


def sweep_table(result: Result) -> Table:
    """A line for each setting."""
    return Table(
        title="Settings of the adaptive form",
        note=SWEEP.format(
            seeds=result.sweep_seeds,
            first=result.sweep_first_seed,
            fading=FADING_FRACTION,
            patience=MIN_EXCEEDANCE_STEPS,
        ),
        header=("fading", "patience", "no error, m/s", "inputs x .7, m/s", "weak motor, rad/s", "outliers, m/s"),
        rows=tuple(
            (
                *(f"{s.fading:g}", f"{s.patience}"),
                *(number(x) for x in (s.none_m_s, s.weak_m_s, s.motor_rad_s, s.outliers_m_s)),
            )
            for s in result.sweep
        ),
    )


def comparisons_table(comparisons: Sequence[Comparison]) -> Table:
    """Return the table of our figures and the reference's."""
    return Table(
        title="Beside an independent implementation",
        note=COMPARED,
        header=("variant", "method", "ours", "", "reference", "tolerance", ""),
        rows=tuple(
            (
                NAMED[c.variant].label,
                EVERY[c.method].label,
                number(c.ours),
                f"± {number(c.standard_error, 2)}",
                f"{c.reference:g}",
                f"± {c.tolerance:.2g}",
                "agrees" if c.agrees else "as printed only" if c.agrees_as_printed else "DIFFERS",
            )
            for c in comparisons
        ),
    )


def _cell(row: Row | None, quantity: str) -> str:
    if row is None:
        return UNKNOWN
    return number(row.quantities[quantity].value) + ("†" if row.diverged_percent > 50 else "")
