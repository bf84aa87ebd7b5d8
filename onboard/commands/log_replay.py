"""A recorded flight through the same pipeline, as fast as it goes; bit-exact from run to run.

Time is the recording's own, so nothing here depends on when or how fast it is replayed.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from onboard.config import Config
from onboard.errors import UserError
from onboard.messages import Datagram, Estimate, Health, Message, NavState, Output
from onboard.pipeline import Pipeline
from onboard.scoring.beside import judged
from onboard.wire import ulog
from onboard.wire.recording import is_recording, read_recording
from onboard.wire.tlog import NotALogError, read_tlog

PROGRESS_EVERY: Final = 2000


class ReplayError(UserError, ValueError):
    """The log cannot be replayed; the message says why in one line."""


class Replayed(NamedTuple):
    """What a replay made: every estimate of the leader and of our own state, the health at the end, records read,
    stretches that were no record and rows that could not be used, the seconds that it lasted, and the boot time of
    its end, s. `estimates` are the judged estimator's (`onboard.scoring.beside`); others are in `beside`."""

    estimates: list[Estimate]
    health: Health
    records: int
    damaged: int
    duration: float
    own_states: list[NavState]
    end: float
    beside: dict[str, list[Estimate]]


def replay(
    log: Path,
    config: Config,
    *,
    take: Callable[[Output], None] = lambda _: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    keep: bool = True,
) -> Replayed:
    """Feed a log through a pipeline. `take` sees each output in order; `progress` gets bytes done and in all.
    Without `keep`, the result holds no estimates: an hour of them would be gigabytes.

    Raises ReplayError.
    """
    pipeline = Pipeline(config)
    estimates: dict[str, list[Estimate]] = {}
    own_states: list[NavState] = []
    total = _size(log)
    count = damaged = first = last = lost = 0

    def lose(reason: str) -> None:
        nonlocal lost
        lost += 1
        pipeline.refuse(log.name, reason, last)

    try:
        for item, done in read_log(log, lose):
            if item is None:
                damaged += 1
                continue
            outputs = pipeline.feed(item) if isinstance(item, Datagram) else pipeline.advance([item])
            for output in outputs:
                take(output)
                if not keep:
                    continue
                if isinstance(output, NavState):
                    own_states.append(output)
                elif isinstance(output, Estimate) and output.is_primary:
                    estimates.setdefault(output.name, []).append(output)
            first = first or item.t_recv_ns
            last = max(last, item.t_recv_ns)
            count += 1
            if count % PROGRESS_EVERY == 0:
                progress(done, total)
    except NotALogError as error:
        raise ReplayError(f"{log}: {error}") from error
    progress(total, total)
    health, end = pipeline.health(last), pipeline.ownship.now_ns * 1e-9
    main, seconds = estimates.pop(judged(estimates), []), (last - first) * 1e-9
    return Replayed(main, health, count, damaged + lost, seconds, own_states, end, estimates)


def check_log(log: Path) -> None:
    """Raise ReplayError for what is no log, before anything is written for it."""
    try:
        items = read_log(log)
        empty = log.suffix != ".ulg" and all(item is None for item, _ in items)  # a ULog is parsed as a whole
    except (NotALogError, OSError) as error:
        raise ReplayError(f"{log}: {error}") from error
    if empty:
        raise ReplayError(f"{log}: there is no record in it that can be read")


def read_log(
    log: Path, lose: Callable[[str], None] = lambda _: None
) -> Iterator[tuple[Datagram | Message | None, int]]:
    """What a log holds, with the bytes read so far: the datagrams of a .tlog or a recording of ours, the messages
    of a ULog; None for damage. `lose` is called with the reason for each row of a ULog that cannot be used.

    Raises ReplayError, NotALogError.
    """
    try:
        with log.open("rb") as file:
            head = file.read(16)
        if head.startswith(ulog.MAGIC):
            return ((message, 0) for message in ulog.read_ulog(log, lose))
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
