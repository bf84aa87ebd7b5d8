"""`onboard router`: the Zenoh router of a fleet."""

import argparse
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

from onboard.config import load_config
from onboard.sinks.zenoh_router import LOG_FILTER, open_router, refusal, users
from onboard.terminal.output import end_signals, report

REPORT_PERIOD_S: Final = 10.0  # between reports of the same refusal
MAX_REFUSAL_COUNT: Final = 1000  # of refusals that are counted apart; further kinds are counted together


def main(arguments: argparse.Namespace) -> int:
    """Route until a signal. Raises UserError."""
    config = load_config(arguments.config, tuple(arguments.set)).router
    stop = threading.Event()
    for number in end_signals():
        signal.signal(number, lambda *_: stop.set())
    refusals = RefusalLog(config.watchers)
    _read_log(refusals.read)
    session = open_router(config)
    try:
        vehicles = len(users(config.users_file)) - len(config.watchers)
        report(f"router: {', '.join(config.listen)}, vehicles: {vehicles}, watchers: {', '.join(config.watchers)}")
        connected: set[str] = set()
        while not stop.wait(1.0):
            before, connected = connected, {str(link.auth_identifier) for link in session.info.links()}
            for name in sorted(connected ^ before):
                report(f"{name} {'has connected' if name in connected else 'has gone'}")
            for line in refusals.due(1.0):
                report(line)
    finally:
        session.close()
        report(f"stopped; refused: {refusals.total}")
    return 0


class RefusalLog:
    """Counts what is refused, by what it was. `read` may run on another thread than `due`."""

    def __init__(self, watchers: Iterable[str]) -> None:
        self.total = 0
        self._watchers = frozenset(watchers)
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._waits: dict[str, float] = {}  # s until a kind is reported again

    def read(self, line: str) -> None:
        """A line of Zenoh's log."""
        what = refusal(line, self._watchers)
        if what is None:
            return
        with self._lock:
            self.total += 1
            known = what in self._counts or len(self._counts) < MAX_REFUSAL_COUNT
            self._counts[what if known else "others"] += 1

    def due(self, elapsed: float) -> list[str]:
        """Return lines about refusals: each kind at once, then every `REPORT_PERIOD_S`.

        `elapsed`: seconds since the last call."""
        self._waits = {what: left - elapsed for what, left in self._waits.items() if left > elapsed}
        with self._lock:
            due = [what for what in self._counts if what not in self._waits]
            lines = [f"refused {what} ({self._counts.pop(what)} times)" for what in due]
        self._waits |= dict.fromkeys(due, REPORT_PERIOD_S)
        return lines


def _read_log(read: Callable[[str], None]) -> None:
    """Give each line of Zenoh's log to `read`, on a thread. Zenoh writes to standard output, which nothing else
    here uses."""
    import zenoh  # noqa: PLC0415 - half of the start

    source, target = os.pipe()
    os.dup2(target, 1)
    os.close(target)

    def follow() -> None:
        with os.fdopen(source, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                read(line.rstrip())

    threading.Thread(target=follow, daemon=True).start()
    os.environ["NO_COLOR"] = "1"
    os.environ.pop("RUST_LOG", None)  # it would go before our filter
    zenoh.init_log_from_env_or(LOG_FILTER)
