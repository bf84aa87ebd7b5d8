"""The study's Markdown report, and its table as rows of text."""

from collections.abc import Sequence
from typing import Final

from onboard.filters.gating import mean_bounds
from onboard.messages import Record
from onboard.studies.relative_motion.bound import ASSUMES
from onboard.studies.relative_motion.claims import Claim
from onboard.studies.relative_motion.table import SIGMAS, Comparison, Limit, Quantity, Row
from onboard.studies.relative_motion.targets import Target
from onboard.studies.relative_motion.variants import OURS, VARIANTS

LABELS: Final = {method.name: method.label for variant in VARIANTS for method in variant.methods}
FT: Final = 0.3048
HEADER: Final = (
    "variant",
    "method",
    "position ft (m)",
    "velocity ft/s (m/s)",
    "range %",
    "size %",
    "a_lat ft/s²",
    "NEES (9)",
    "NIS / degrees",
    "in 95 % ellipsoid",
    "diverged",
)
COLUMNS: Final = ("position_ft", "velocity_ft_s", "range_percent", "size_percent", "a_lat_ft_s2", "nees")
IN_SI: Final = ("position_ft", "velocity_ft_s")
NAMES: Final = {
    "position_ft": "position, ft",
    "velocity_ft_s": "velocity, ft/s",
    "range_percent": "range, %",
    "a_lat_ft_s2": "a_lat, ft/s²",
    "nees": "NEES (9)",
    "nis": "NIS (3)",
    "diverged_percent": "diverged, %",
}
SETTING: Final = """\
{seeds} simulated flights of 60 s per variant; the initial course of each is random. Variants: {variants}.
Every filter is told the nominal size with 2 % (1 sigma), in f a wrong one with the same; in h how large the errors
of its own state are."""
DEFINITIONS: Final = """\
Over t ≥ 15 s. Position and velocity: root mean square of the error vector's length, over all samples of all
runs that did not diverge, at the navigation's 50 Hz. Range, size: root mean square relative errors. NEES and
NIS (of the images fused): means; a consistent filter shows 9, and the degrees of freedom of its measurement.
Were each run one sample, 95 % of such means over {seeds} runs would lie in {nees} and, of three degrees, {nis}.
*In 95 % ellipsoid*: share of true positions inside what the filter reports, of all runs. *Diverged*: the
covariance lost its Cholesky factor or overflowed, or over the last 5 s there is no estimate, the mean range error
exceeds 50 % or the mean bearing error 5°."""
BOUND: Final = """\
Posterior Cramer-Rao bounds, and in brackets how many times larger the errors of ours are. They assume: {ASSUMES}.
Where the true leader is steadier than that process noise, a filter can be better."""
BOUNDED: Final = ("position_ft", "velocity_ft_s", "range_percent", "a_lat_ft_s2")
BOUND_COLUMNS: Final = ("position ft", "velocity ft/s", "range %", "a_lat ft/s²")
NOT_JUDGED: Final = """\
Not judged: the paper's own flight data, which are not public. Its figures compare with the GPS/INS of both
aircraft; ours compare with simulated truth, and the follower's own motion is known exactly."""
COMPARED: Final = """\
Both are samples, of {seeds} and of 50 random runs. Tolerance: {sigmas:g} standard errors of their difference,
estimated from the scatter of our runs, and half a unit of the reference's last digit. Of {count} comparisons
one in twenty may differ by chance. For the drop-out (d) the reference does not say which
arctangent it used; its numbers come back with the one printed, and not with atan2."""


class Result(Record, frozen=True, kw_only=True):
    """What the study found over `seeds` flights of each variant."""

    seeds: int
    first_seed: int
    rows: tuple[Row, ...]
    bounds: tuple[Limit, ...]
    targets: tuple[Target, ...]
    comparisons: tuple[Comparison, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...]  # file names, drawn from the first seed


def table(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """One tuple of texts per row, under HEADER."""
    return [
        (
            row.variant,
            LABELS[row.method],
            *(_cell(name, row.quantities[name]) for name in COLUMNS),
            _over(row),
            _cell("inside_percent", row.quantities["inside_percent"]) + " %",
            f"{row.diverged_percent:.0f} %",
        )
        for row in rows
    ]


def comparison_table(comparisons: Sequence[Comparison]) -> list[tuple[str, ...]]:
    """Ours beside the reference: variant, method, quantity, ours, reference, tolerance, verdict."""
    return [
        (
            c.variant,
            LABELS[c.method],
            NAMES[c.quantity],
            "–" if c.ours is None else f"{c.ours:.3g}",
            f"{c.reference:g}",
            "–" if c.tolerance is None else f"± {c.tolerance:.2g}",
            "agrees" if c.agrees else "DIFFERS",
        )
        for c in comparisons
    ]


def bound_table(result: Result) -> list[tuple[str, ...]]:
    """The bound of each variant that has one, beside the errors of the method that is judged."""
    rows = {row.variant: row for row in result.rows if row.method == OURS[-1].name}
    return [
        (limit.variant, *(_beside(rows[limit.variant], name, getattr(limit, name)) for name in BOUNDED))
        for limit in result.bounds
    ]


def _beside(row: Row, name: str, bound: float) -> str:
    value = row.quantities[name].value
    return f"{bound:.3g}" + ("" if value is None else f" ({value / bound:.2f})")


def target_table(targets: Sequence[Target]) -> list[tuple[str, ...]]:
    """What is asked for: variant, figure, measured, bounds, whether it is met."""
    return [
        (
            t.variant,
            t.what,
            "–" if t.value is None else f"{t.value:.3g} {t.unit}".strip(),
            " and ".join(
                f"{sign} {bound:g}" for sign, bound in (("≥", t.at_least), ("≤", t.at_most)) if bound is not None
            ),
            "met" if t.met else "NOT MET",
        )
        for t in targets
    ]


def markdown(result: Result) -> str:
    """The report."""
    claims = [(c.claim, c.where, f"**{c.verdict}**", c.evidence) for c in result.claims]
    compared = ("variant", "method", "quantity", "ours", "reference", "tolerance", "")
    targets = ("variant", "figure", "measured", "asked for", "")
    variants = "; ".join(f"{v.name}, {v.label}" for v in VARIANTS)
    sections = [
        "# Relative motion by vision: Oh & Johnson's unscented Kalman filter",
        SETTING.format(seeds=result.seeds, variants=variants),
        "## Results",
        DEFINITIONS.format(seeds=result.seeds, nees=_bounds(9, result.seeds), nis=_bounds(3, result.seeds)),
        _markdown_table(HEADER, table(result.rows)),
        "## The least that is possible",
        BOUND.format(ASSUMES=ASSUMES),
        _markdown_table(("variant", *BOUND_COLUMNS), bound_table(result)),
        f"## What is asked of ours ({OURS[-1].label})",
        _markdown_table(targets, target_table(result.targets)),
        "## The paper's claims",
        _markdown_table(("claim", "where", "verdict", "evidence"), claims),
        NOT_JUDGED,
        "## Beside an independent implementation",
        COMPARED.format(seeds=result.seeds, sigmas=SIGMAS, count=len(result.comparisons)),
        _markdown_table(compared, comparison_table(result.comparisons)),
        f"## Figures: one flight, seed {result.first_seed}",
        "\n\n".join(f"![{name}]({name})" for name in result.figures) or "None were drawn.",
    ]
    return "\n\n".join(sections) + "\n"


def _bounds(degrees: int, samples: int) -> str:
    low, high = mean_bounds(degrees, samples)
    return f"{low:.2f}–{high:.2f}"


def _over(row: Row) -> str:
    value = row.quantities["nis"].value
    return "–" if value is None else f"{value:.3g} / {row.nis_degrees}"


def _cell(name: str, quantity: Quantity) -> str:
    if quantity.value is None:
        return "–"
    text = f"{quantity.value:.3g}"
    return f"{text} ({quantity.value * FT:.2g})" if name in IN_SI else text


def _markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
