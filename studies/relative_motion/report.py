"""The result of the study, and its report."""

from collections.abc import Sequence
from typing import Final

from onboard.filters.gating import mean_bounds
from onboard.messages import Record
from studies.relative_motion.bound import ASSUMES, Bound, VariantBound
from studies.relative_motion.formation import M_PER_FT
from studies.relative_motion.reference import TOLERANCE_SIGMAS
from studies.relative_motion.scores import Row
from studies.relative_motion.shipped import DEFAULT
from studies.relative_motion.targets import Target
from studies.relative_motion.variants import LABELS, VARIANTS
from studies.report.findings import Claim, Findings, Table
from studies.report.markdown import interval, number
from studies.report.runs import Comparison, Quantity

NAMES: Final = {
    "position_ft": "position ft",
    "velocity_ft_s": "velocity ft/s",
    "range_percent": "range %",
    "size_percent": "size %",
    "a_lat_ft_s2": "a_lat ft/s²",
    "nees": "NEES (9)",
    "nis": "NIS (3)",
    "diverged_percent": "diverged %",
}
COLUMNS: Final = ("position_ft", "velocity_ft_s", "range_percent", "size_percent", "a_lat_ft_s2", "nees")
IN_SI: Final = {"position_ft": " (m)", "velocity_ft_s": " (m/s)"}
SETTING: Final = """\
{seeds} simulated flights of 60 s per variant; the initial course of each is random. Variants: {variants}.
Every filter knows the nominal size with 2 % (1 sigma), in f a wrong one with the same. In h the paper's filter,
with its size considered, knows the sizes of the errors of its own state. The daemon is the pipeline as it ships:
messages go in and estimates come out, over every fifth flight. It knows the camera, and the leader's size and
class.

Not judged: the paper's own flight data, which are not public. Its figures compare with the GPS/INS of both
aircraft; ours compare with simulated truth, and the follower's own motion is known exactly."""
DEFINITIONS: Final = """\
Over t ≥ 15 s. Position and velocity: root mean square of the error vector's length, over all samples of all
runs that did not diverge, at the navigation's 50 Hz. Range, size: root mean square relative errors. NEES and
NIS (of the images fused): means; a consistent filter shows 9, and the degrees of freedom of its measurement.
Were each run one sample, 95 % of such means over {seeds} runs would lie in {nees} and, of three degrees, {nis}.
*In 95 % ellipsoid*: share of true positions inside the reported ellipsoid, of all runs. *Valid*: share of samples
with an estimate, of all runs; all other figures are of those samples. *Diverged*: the covariance lost its Cholesky
factor or overflowed, or over the last 5 s there is no estimate, the mean range error exceeds 50 % or the mean
bearing error 5°."""
LEAST: Final = """\
Posterior Cramer-Rao bounds, and in brackets how many times larger our errors are. They assume: {ASSUMES}.
Where the true leader is steadier than that process noise, a filter can be better."""
COMPARED: Final = """\
Both are samples, of {seeds} and of 50 random runs. Tolerance: {sigmas:g} standard errors of their difference,
estimated from the scatter of our runs, and half a unit of the reference's last digit. Of {count} comparisons
one in twenty may differ by chance. For the drop-out (d) the reference does not say which
arctangent it used; the printed one gives its numbers, atan2 does not."""


class Result(Record, frozen=True, kw_only=True):
    """The results of the study over `seeds` flights of each variant."""

    seeds: int
    first_seed: int
    rows: tuple[Row, ...]
    bounds: tuple[VariantBound, ...]
    targets: tuple[Target, ...]
    comparisons: tuple[Comparison, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...] = ()  # file names, drawn from the first seed


def findings(result: Result, study: str, title: str) -> Findings:
    """Return the findings for the report."""
    variants = "; ".join(f"{v.name}, {v.label}" for v in VARIANTS)
    return Findings(
        study=study,
        title=title,
        setting=SETTING.format(seeds=result.seeds, variants=variants),
        seeds=result.seeds,
        first_seed=result.first_seed,
        tables=(
            results_table(result.rows, result.seeds),
            bounds_table(result),
            targets_table(result.targets),
            comparisons_table(result.comparisons, result.seeds),
        ),
        claims=result.claims,
        figures=result.figures,
    )


def results_table(rows: Sequence[Row], seeds: int) -> Table:
    """A line for each variant and method."""
    return Table(
        title="Results",
        note=DEFINITIONS.format(seeds=seeds, nees=_mean_bounds(9, seeds), nis=_mean_bounds(3, seeds)),
        header=(
            *("variant", "method", "runs"),
            *(NAMES[name] + IN_SI.get(name, "") for name in COLUMNS),
            *("NIS / degrees", "in 95 % ellipsoid", "valid", "diverged"),
        ),
        rows=tuple(
            (
                row.variant,
                LABELS[row.method],
                float(row.runs),
                *(_cell(name, row.quantities[name]) for name in COLUMNS),
                f"{number(row.quantities['nis'].value)} / {row.nis_degrees}",
                number(row.quantities["inside_percent"].value) + " %",
                number(row.quantities["valid_percent"].value) + " %",
                f"{row.diverged_percent:.0f} %",
            )
            for row in rows
        ),
    )


def bounds_table(result: Result) -> Table:
    """The bound of each variant that has one, and the judged method's errors over it."""
    rows = {row.variant: row for row in result.rows if row.method == DEFAULT.name}
    names = Bound.__struct_fields__
    return Table(
        title="The least that is possible",
        note=LEAST.format(ASSUMES=ASSUMES),
        header=("variant", *(NAMES[name] for name in names)),
        rows=tuple(
            (bound.variant, *(_over_bound(rows[bound.variant], name, getattr(bound, name)) for name in names))
            for bound in result.bounds
        ),
    )


def targets_table(targets: Sequence[Target]) -> Table:
    """Return the targets: variant, figure, measured, bounds, whether it is met."""
    return Table(
        title=f"What is asked of ours ({DEFAULT.label})",
        note="",
        header=("variant", "figure", "measured", "asked for", ""),
        rows=tuple(
            (
                t.variant,
                t.what,
                f"{number(t.value)} {t.unit}".strip(),
                interval(t.at_least, t.at_most),
                "met" if t.met else "NOT MET",
            )
            for t in targets
        ),
    )


def comparisons_table(comparisons: Sequence[Comparison], seeds: int) -> Table:
    """Return the table of our figures and the reference's."""
    return Table(
        title="Beside an independent implementation",
        note=COMPARED.format(seeds=seeds, sigmas=TOLERANCE_SIGMAS, count=len(comparisons)),
        header=("variant", "method", "quantity", "ours", "reference", "tolerance", ""),
        rows=tuple(
            (
                c.variant,
                LABELS[c.method],
                NAMES[c.quantity],
                number(c.ours),
                f"{c.reference:g}",
                f"± {number(c.tolerance, 2)}",
                "agrees" if c.agrees else "DIFFERS",
            )
            for c in comparisons
        ),
    )


def _mean_bounds(degrees: int, samples: int) -> str:
    low, high = mean_bounds(degrees, samples)
    return f"{low:.2f}–{high:.2f}"


def _over_bound(row: Row, name: str, bound: float) -> str:
    value = row.quantities[name].value
    return f"{bound:.3g}" + ("" if value is None else f" ({value / bound:.2f})")


def _cell(name: str, quantity: Quantity) -> str:
    text = number(quantity.value)
    return text if quantity.value is None or name not in IN_SI else f"{text} ({quantity.value * M_PER_FT:.2g})"
