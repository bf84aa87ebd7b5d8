"""Estimates as rows of CSV. Columns carry their units."""

import csv
import itertools
from typing import IO, Final

import numpy as np

from onboard.messages import Estimate, NavState, Output
from onboard.models import relative_motion
from onboard.models.own_motion import COMPONENTS as OWN_COMPONENTS
from onboard.models.own_motion import UNITS as OWN_UNITS

OWN_STATE: Final = "own_state"  # not that of another configuration which flew beside
UNIT_SUFFIX: Final = {"m": "m", "m/s": "m_s", "m/s^2": "m_s2", "rad": "rad", "rad/s": "rad_s"}


class CsvWriter:
    """One row per estimate of any estimator, which the last column names. Columns carry their units; NED, leader
    relative to follower, on the boot clock. The numbers of an estimate that is not valid are left out."""

    def __init__(self, file: IO[str]) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow([*header(relative_motion.COMPONENTS, relative_motion.UNITS), "estimator"])

    def write(self, estimate: Output) -> None:
        """Append an estimate's row; other records have none."""
        nine = len(relative_motion.COMPONENTS)
        if isinstance(estimate, Estimate) and estimate.components[:nine] == relative_motion.COMPONENTS:
            self._writer.writerow([*row(estimate, nine), estimate.name])


class OwnCsvWriter:
    """One row per state of our own vehicle: as `CsvWriter`, then the attitude's quaternion, the share of
    measurements outside their layer, the quality and the faults that last. NED from the origin."""

    def __init__(self, file: IO[str]) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        more = ["q_w", "q_x", "q_y", "q_z", "switch_fraction", "quality", "faults"]
        self._writer.writerow([*header(OWN_COMPONENTS, OWN_UNITS), *more])

    def write(self, state: Output) -> None:
        """Append a state's row; other records have none."""
        if not isinstance(state, NavState) or state.name != OWN_STATE:
            return
        q = [f"{x:.9f}" for x in state.q_nb] if state.valid and state.q_nb else [""] * 4
        switched = "" if state.switch_fraction is None else f"{state.switch_fraction:.4f}"
        faults = "; ".join(f"{f.kind} {f.part}".strip() for f in state.faults)
        self._writer.writerow([*row(state, len(OWN_COMPONENTS)), *q, switched, str(state.quality), faults])


def header(components: tuple[str, ...], units: tuple[str, ...]) -> list[str]:
    """Column names of an estimate's rows."""
    names = [f"{c}_{UNIT_SUFFIX[u]}" for c, u in zip(components, units, strict=True)]
    sigmas = [f"sigma_{n}" for n in names]
    rest = ("verdict", "nis", "valid", "age_s", "reset_count", "target")
    return ["time_boot_s", "state", *names, *sigmas, *rest]


def row(estimate: Estimate, n: int) -> list[str]:
    """The row of one estimate, with its first n components."""
    numbers = list(itertools.repeat("", 2 * n))
    if estimate.valid and estimate.mean is not None and estimate.covariance is not None:
        sigma = np.sqrt(np.diag(np.array(estimate.covariance)))
        numbers = [f"{x:.6f}" for x in (*estimate.mean[:n], *sigma[:n].tolist())]
    report = estimate.measurement
    return [
        f"{estimate.t_ns * 1e-9:.6f}",
        str(estimate.state),
        *numbers,
        str(report.verdict) if report else "",
        f"{report.nis:.6f}" if report and report.nis is not None else "",
        "1" if estimate.valid else "0",
        f"{estimate.age:.3f}" if estimate.age is not None else "",
        str(estimate.reset_count),
        estimate.target,
    ]
