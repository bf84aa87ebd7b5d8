"""A recorded flight through the same pipeline, as fast as it goes; bit-exact from run to run.

Time is the recording's own, so nothing here depends on when or how fast it is replayed.
"""

import csv
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Final, NamedTuple

import numpy as np

from onboard.config import Config
from onboard.errors import UserError
from onboard.messages import Datagram, Estimate, Health, Message, NavState, Output
from onboard.models import relative_motion
from onboard.models.own_motion import COMPONENTS as OWN_COMPONENTS
from onboard.models.own_motion import UNITS as OWN_UNITS
from onboard.pipeline import Pipeline
from onboard.wire import ulog
from onboard.wire.recording import is_recording, read_recording
from onboard.wire.tlog import NotALogError, read_tlog

PROGRESS_EVERY: Final = 2000
UNIT_SUFFIX: Final = {"m": "m", "m/s": "m_s", "m/s^2": "m_s2", "rad": "rad", "rad/s": "rad_s"}


class ReplayError(UserError, ValueError):
    """The log cannot be replayed; the message says why in one line."""


class Replayed(NamedTuple):
    """What a replay made: every estimate of others and of our own state, the health at the end, records read, and
    stretches that were no record."""

    estimates: list[Estimate]
    health: Health
    records: int
    damaged: int
    duration: float
    own_states: list[NavState]


def replay(
    log: Path,
    config: Config,
    *,
    take: Callable[[Output], None] = lambda _: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Replayed:
    """Feed a log through a pipeline. `take` sees each output in order; `progress` is told bytes done and in all.

    Raises ReplayError.
    """
    pipeline = Pipeline(config)
    estimates: list[Estimate] = []
    own_states: list[NavState] = []
    total = _size(log)
    count = damaged = first = last = 0
    try:
        for item, done in read_log(log):
            if item is None:
                damaged += 1
                continue
            outputs = pipeline.feed(item) if isinstance(item, Datagram) else pipeline.advance([item])
            for output in outputs:
                take(output)
                if isinstance(output, NavState):
                    own_states.append(output)
                elif isinstance(output, Estimate) and "/" not in output.target:  # of one target, not of traffic
                    estimates.append(output)
            first = first or item.t_recv_ns
            last = max(last, item.t_recv_ns)
            count += 1
            if count % PROGRESS_EVERY == 0:
                progress(done, total)
    except NotALogError as error:
        raise ReplayError(f"{log}: {error}") from error
    progress(total, total)
    health = pipeline.health(last)
    return Replayed(estimates, health, count, damaged, (last - first) * 1e-9, own_states)


def check_log(log: Path) -> None:
    """Raise ReplayError for what is no log, before anything is written for it."""
    try:
        items = read_log(log)
        empty = log.suffix != ".ulg" and all(item is None for item, _ in items)  # a ULog is parsed as a whole
    except (NotALogError, OSError) as error:
        raise ReplayError(f"{log}: {error}") from error
    if empty:
        raise ReplayError(f"{log}: there is no record in it that can be read")


def read_log(log: Path) -> Iterator[tuple[Datagram | Message | None, int]]:
    """What a log holds, with the bytes read so far: the datagrams of a .tlog or a recording of ours, the messages
    of a ULog; None for damage.

    Raises ReplayError, NotALogError.
    """
    try:
        with log.open("rb") as file:
            head = file.read(16)
        if head.startswith(ulog.MAGIC):
            return ((message, 0) for message in ulog.read_ulog(log))
        if is_recording(log):
            return read_recording(log)
        data = log.read_bytes()
    except OSError as error:
        raise ReplayError(f"cannot read {log}: {error.strerror or error}") from error
    if not data:
        raise ReplayError(f"{log} is empty")
    return read_tlog(data)


def _size(log: Path) -> int:
    try:
        return log.stat().st_size
    except OSError as error:
        raise ReplayError(f"cannot read {log}: {error.strerror or error}") from error


class CsvWriter:
    """One row per estimate. Columns carry their units; NED, leader relative to follower, on the boot clock. The
    numbers of an estimate that is not valid are left out."""

    def __init__(self, file: IO[str]) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow(header(relative_motion.COMPONENTS, relative_motion.UNITS))

    def write(self, estimate: Output) -> None:
        """Append an estimate's row; other records have none."""
        nine = len(relative_motion.COMPONENTS)
        if isinstance(estimate, Estimate) and estimate.components[:nine] == relative_motion.COMPONENTS:
            self._writer.writerow(row(estimate, nine))


class OwnCsvWriter:
    """One row per state of our own vehicle: as `CsvWriter`, then the attitude's quaternion, the share of
    measurements outside their layer, the quality and the faults that last. NED from the origin."""

    def __init__(self, file: IO[str]) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        more = ["q_w", "q_x", "q_y", "q_z", "switch_fraction", "quality", "faults"]
        self._writer.writerow([*header(OWN_COMPONENTS, OWN_UNITS), *more])

    def write(self, state: Output) -> None:
        """Append a state's row; other records have none."""
        if not isinstance(state, NavState):
            return
        q = [f"{x:.9f}" for x in state.q_nb] if state.valid and state.q_nb else [""] * 4
        switched = "" if state.switch_fraction is None else f"{state.switch_fraction:.4f}"
        faults = "; ".join(f"{f.kind} {f.part}".strip() for f in state.faults)
        self._writer.writerow([*row(state, len(OWN_COMPONENTS)), *q, switched, str(state.quality), faults])


def header(components: tuple[str, ...], units: tuple[str, ...]) -> list[str]:
    """Column names of an estimate's rows."""
    names = [f"{c}_{UNIT_SUFFIX[u]}" for c, u in zip(components, units, strict=True)]
    sigmas = [f"sigma_{n}" for n in names]
    told = ("verdict", "nis", "valid", "age_s", "reset_count", "target")
    return ["time_boot_s", "state", *names, *sigmas, *told]


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
