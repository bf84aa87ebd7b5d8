"""Figures of an independent implementation of the same scenario, compared with ours."""

from typing import Final

import numpy as np

from studies.relative_motion.scores import Row
from studies.report.runs import Comparison, half_unit

QUANTITIES: Final = (
    *("position_ft", "velocity_ft_s", "range_percent", "a_lat_ft_s2"),
    *("nees", "nis", "diverged_percent"),
)
# As printed: by variant and method, over 50 seeds of its own, of the runs that did not diverge.
REFERENCE: Final[dict[tuple[str, str], dict[str, str]]] = {
    ("a", "paper"): dict(zip(QUANTITIES, ("2.72", "0.86", "3.0", "0.09", "0.19", "0.003", "0"), strict=True)),
    ("a", "tuned"): dict(zip(QUANTITIES, ("3.06", "0.46", "3.4", "0.33", "13.5", "2.9", "0"), strict=True)),
    ("d", "printed"): dict(zip(QUANTITIES, ("6.31", "3.22", "5.8", "0.20", "0.33", "0.01", "24"), strict=True)),
    ("e", "tuned"): {"diverged_percent": "99"},
}
REFERENCE_RUN_COUNT: Final = 50
DIVERGED_ROUNDING_PERCENT: Final = 1.0  # half of one of its runs
TOLERANCE_SIGMAS: Final = 2.0


def compare(row: Row) -> list[Comparison]:
    """Each figure that the reference has for this row.

    Tolerance: two standard errors of the difference of two independent sets of runs, by the scatter of ours, and
    half a unit of the reference's last digit.
    """
    reference = REFERENCE.get((row.variant, row.method), {})
    return [_compare(row, quantity, printed) for quantity, printed in reference.items()]


def _compare(row: Row, quantity: str, printed: str) -> Comparison:
    reference, rounding = float(printed), half_unit(printed)
    if quantity == "diverged_percent":
        both = (row.diverged_percent + reference) / 200.0
        ours: float | None = row.diverged_percent
        error: float | None = 100.0 * float(np.sqrt(both * (1 - both) / row.runs))
        rounding = DIVERGED_ROUNDING_PERCENT
    else:
        ours, error = row.quantities[quantity].value, row.quantities[quantity].standard_error
    tolerance = None
    if error is not None:
        tolerance = TOLERANCE_SIGMAS * error * float(np.sqrt(1.0 + row.runs / REFERENCE_RUN_COUNT)) + rounding
    return Comparison(
        variant=row.variant,
        method=row.method,
        quantity=quantity,
        ours=ours,
        reference=reference,
        tolerance=tolerance,
        agrees=ours is not None and tolerance is not None and abs(ours - reference) <= tolerance,
    )
