"""The study's Markdown report, and its table as rows of text."""

from collections.abc import Sequence
from typing import Final

from onboard.messages import Record
from onboard.studies._formation import AS_PRINTED, METHODS, R_ALONE
from onboard.studies._relative_motion_claims import Claim
from onboard.studies._relative_motion_table import SIGMAS, Comparison, Quantity, Row

LABELS: Final = {method.name: method.label for method in (AS_PRINTED, *METHODS, R_ALONE)}
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
    "NIS (3)",
    "diverged",
)
COLUMNS: Final = ("position_ft", "velocity_ft_s", "range_percent", "size_percent", "a_lat_ft_s2", "nees", "nis")
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
{seeds} simulated flights of 60 s per variant: a, the reference formation, 90 ft behind a leader in a steady
turn; d, no image at 30–35 s; e, two images in a hundred show something else. The initial course of each
flight is random."""
DEFINITIONS: Final = """\
Over t ≥ 15 s. Position and velocity: root mean square of the error vector's length, over all samples of all
runs that did not diverge, at the navigation's 50 Hz. Range, size: root mean square relative errors. NEES and
NIS (of the images fused): means; a consistent filter shows 9 and 3. *Diverged*: the covariance lost its
Cholesky factor or overflowed, or over the last 5 s the mean range error exceeds 50 % or the mean bearing
error 5°."""
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


def markdown(result: Result) -> str:
    """The report."""
    claims = [(c.claim, c.where, f"**{c.verdict}**", c.evidence) for c in result.claims]
    compared = ("variant", "method", "quantity", "ours", "reference", "tolerance", "")
    sections = [
        "# Relative motion by vision: Oh & Johnson's unscented Kalman filter",
        SETTING.format(seeds=result.seeds),
        "## Results",
        DEFINITIONS,
        _markdown_table(HEADER, table(result.rows)),
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


def _cell(name: str, quantity: Quantity) -> str:
    if quantity.value is None:
        return "–"
    text = f"{quantity.value:.3g}"
    return f"{text} ({quantity.value * FT:.2g})" if name in IN_SI else text


def _markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
