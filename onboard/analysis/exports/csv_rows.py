"""Estimates as rows of a table. Columns carry their units."""

import csv
from collections.abc import Callable
from typing import IO, Final, NamedTuple

import numpy as np

from onboard.messages import Estimate, NavState, Output
from onboard.models import relative_motion
from onboard.models.own_motion import COMPONENTS as OWN_COMPONENTS
from onboard.models.own_motion import UNITS as OWN_UNITS
from onboard.units import S_PER_NS

OWN_STATE: Final = "own_state"  # Outputs of estimators that ran beside it have other names.
UNIT_SUFFIX: Final = {"m": "m", "m/s": "m_s", "m/s^2": "m_s2", "rad": "rad", "rad/s": "rad_s"}


Values = list[float | str | None]
Format = dict[str, str]
DECIMALS: Final[Format] = {
    "age_s": ".3f",
    "switch_fraction": ".4f",
    "valid": ".0f",
    "reset_count": ".0f",
    "quality": ".0f",
}
Q_COLUMNS: Final = ("q_w", "q_x", "q_y", "q_z")
TEXT_COLUMNS: Final = ("state", "verdict", "target", "estimator", "faults")  # columns that hold no number


class CsvTable(NamedTuple):
    """A table of estimates. Columns carry their units; unknown values are None."""

    columns: tuple[str, ...]
    values: Callable[[Output], Values | None]  # the row of an output, None if it has no row


def _leader_values(estimate: Output) -> Values | None:
    nine = len(relative_motion.COMPONENTS)
    if isinstance(estimate, Estimate) and estimate.components[:nine] == relative_motion.COMPONENTS:
        return [*_values(estimate, nine), estimate.name]
    return None


def _own_values(state: Output) -> Values | None:
    if not isinstance(state, NavState) or state.name != OWN_STATE:
        return None
    q = state.q_nb if state.valid and state.q_nb else (None,) * 4
    faults = "; ".join(f.name for f in state.faults)
    return [*_values(state, len(OWN_COMPONENTS)), *q, state.switch_fraction, float(state.quality), faults]


def _columns(components: tuple[str, ...], units: tuple[str, ...]) -> tuple[str, ...]:
    names = [f"{c}_{UNIT_SUFFIX[u]}" for c, u in zip(components, units, strict=True)]
    sigmas = [f"sigma_{n}" for n in names]
    rest = ("verdict", "nis", "valid", "age_s", "reset_count", "target")
    return ("time_boot_s", "state", *names, *sigmas, *rest)


def _values(estimate: Estimate, n: int) -> Values:
    """The row of one estimate with its first n components, which are None if it is not valid."""
    numbers: Values = [None] * (2 * n)
    if estimate.valid and estimate.mean is not None and estimate.covariance is not None:
        sigma = np.sqrt(np.diag(np.array(estimate.covariance)))
        numbers = [*estimate.mean[:n], *sigma[:n].tolist()]
    report = estimate.measurement
    return [
        estimate.t_ns * S_PER_NS,
        str(estimate.state),
        *numbers,
        str(report.verdict) if report else None,
        report.nis if report else None,
        float(estimate.valid),
        estimate.age,
        float(estimate.reset_count),
        estimate.target,
    ]


# one row per estimate of any estimator, which the last column names: NED, leader relative to follower, boot clock
LEADER_TABLE: Final = CsvTable(
    (*_columns(relative_motion.COMPONENTS, relative_motion.UNITS), "estimator"), _leader_values
)
# one row per state of our own vehicle, NED from the origin: then the attitude's quaternion, the share of
# measurements outside their layer, the quality and the faults that last
OWN_TABLE: Final = CsvTable(
    (*_columns(OWN_COMPONENTS, OWN_UNITS), *Q_COLUMNS, "switch_fraction", "quality", "faults"), _own_values
)


class CsvWriter:
    """A table as CSV."""

    def __init__(self, file: IO[str], table: CsvTable = LEADER_TABLE) -> None:
        self._writer, self._values = csv.writer(file, lineterminator="\n"), table.values
        self._writer.writerow(table.columns)
        self._formats = [".9f" if name in Q_COLUMNS else DECIMALS.get(name, ".6f") for name in table.columns]

    def write(self, output: Output) -> None:
        """Append an output's row, if it has one."""
        values = self._values(output)
        if values is not None:
            self._writer.writerow(
                [
                    "" if v is None else v if isinstance(v, str) else format(v, form)
                    for v, form in zip(values, self._formats, strict=True)
                ]
            )
