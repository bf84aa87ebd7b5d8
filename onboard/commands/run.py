"""`onboard run`: the daemon."""

import argparse
import asyncio
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Final

from onboard import UserError
from onboard.commands.loading import go_first, loading, release_compiler, share_heap
from onboard.filters.numba_internals import on_compile
from onboard.terminal import output as terminal

if TYPE_CHECKING:
    from onboard.config import Config
    from onboard.sinks.zenoh_session import ZenohConfig, ZenohSession

PROGRESS_S: Final = 10.0  # between lines about compiling


def main(arguments: argparse.Namespace) -> int:
    """Fly until a signal, which may come while the daemon still loads. Raises UserError."""
    terminal.end_at_once()
    lines = _lines()
    report = lines or terminal.report
    try:
        return fly(arguments, report)
    finally:
        if lines is not None:
            lines.close()


def _lines() -> terminal.Lines | None:
    """What writes lines without waiting for their reader; None where standard error is no file of the system's."""
    try:
        return terminal.Lines(sys.stderr.fileno())
    except (AttributeError, OSError):
        return None


def fly(arguments: argparse.Namespace, report: Callable[[str], None]) -> int:
    """Load, and run the daemon to its end."""
    compiling = Compiling(report)
    on_compile(compiling)
    share_heap()
    with loading():
        from onboard.config import load_config  # noqa: PLC0415 - the block is about loading

        config = load_config(arguments.config, tuple(arguments.set))
        compiling.ahead = partial(compile_flight, config)
        # cameras find the router again while the filters load
        session = ThreadPoolExecutor(1).submit(open_first, config.zenoh) if config.zenoh.enabled else None
        from onboard.daemon import Daemon  # noqa: PLC0415 - loads the filters

        daemon = Daemon(config, report=report, session=session)
    release_compiler()
    go_first()
    asyncio.run(daemon.run(terminal.end_signals()))
    return 0


def open_first(config: "ZenohConfig") -> "ZenohSession":
    """Open the Zenoh session, whose threads go first, too. Raises SinkError."""
    from onboard.sinks.zenoh_session import open_session  # noqa: PLC0415 - the block is about loading

    go_first()
    return open_session(config)


def compile_flight(config: "Config", on_progress: Callable[[int, int], None]) -> None:
    """Compile what a configuration flies with and nothing else, on all cores. Raises CompileError."""
    from onboard.commands.compiling import compile_all, flight_modules  # noqa: PLC0415 - seldom needed
    from onboard.config import estimator_modules  # noqa: PLC0415

    modules = flight_modules(estimator_modules(config.estimator))
    compile_all(modules, on_progress=lambda done, total, _: on_progress(done, total))


class Compiling:
    """Lines about the filters that are compiled, which takes up to minutes, once on each computer: no start waits
    for it silently. Call it before each function: at the first one, what the flight needs is compiled `ahead`, on
    all cores. What cannot be compiled so (too little memory, say) is compiled by this process, one by one."""

    def __init__(self, report: Callable[[str], None], monotonic: Callable[[], float] = time.monotonic) -> None:
        self.ahead: Callable[[Callable[[int, int], None]], None] | None = None
        self._report, self._monotonic = report, monotonic
        self._count = 0
        self._began = self._shown = 0.0

    def __call__(self) -> None:
        """One more function."""
        if not self._count:
            self._began = self._shown = self._monotonic()
            self._report("compiling the filters for this computer: up to minutes, once (ahead: `onboard compile`)")
        else:
            self._show(f"{self._count} functions")
        self._count += 1
        if self._count == 1 and self.ahead is not None:
            try:
                self.ahead(lambda done, total: self._show(f"{done} of {total} parts"))
            except UserError as error:
                self._report(f"{error}; going on with one core")

    def _show(self, done: str) -> None:
        now = self._monotonic()
        if now - self._shown >= PROGRESS_S:
            self._shown = now
            self._report(f"still compiling: {done} in {now - self._began:.0f} s")
