"""Lines for a person about what changes while the daemon runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from onboard.messages import DOUBT, Estimate, Health, Lifecycle, LinkHealth, Refusal, SinkHealth

MOST_REFUSALS: Final = 5  # lines about refused messages at once; afterwards one a second
MOST_BESIDE: Final = 16
RATE_CHANGES: Final = 0.005
REFUSED_AGAIN_NS: Final = 10_000_000_000  # between lines about the same refusal


class Console:
    """Lines for a person about changes: states of estimators, silence of the autopilot, sinks that fail."""

    def __init__(self, report: Callable[[str], None], *, warn: Callable[[str], None]) -> None:
        self._report, self._warn = report, warn
        self._states: dict[str, Lifecycle] = {}
        self._errors: dict[str, str] = {}
        self._troubles: dict[str, str] = {}
        self._errors_shown = 0
        self._refusals: dict[tuple[str, str], Refusal] = {}  # as they were shown last
        self._refusals_left = MOST_REFUSALS
        self._is_silent = False
        self._rate = 1.0
        self._beside: set[str] = set()
        self._shedding: set[str] = set()  # links that have left datagrams out
        self._knocked: set[tuple[str, str]] = set()  # link and host of connections that were refused

    def show_state(self, estimate: Estimate) -> None:
        """An estimator's state, when it has changed."""
        if self._states.get(estimate.name) is not estimate.state:
            self._states[estimate.name] = estimate.state
            self._report(f"{estimate.t_ns * 1e-9:.2f} s  {estimate.name}: {estimate.state} ({estimate.reason})")

    def show_silence(self, *, is_silent: bool) -> None:
        """Estimates come with the autopilot's messages: without them there is nothing but this line to notice."""
        if is_silent != self._is_silent:
            self._is_silent = is_silent
            self._report("the autopilot is silent: no estimates" if is_silent else "the autopilot is heard again")

    def show_rate(self, rate: float) -> None:
        """A simulator's clock runs at another rate than ours, and estimates are right by its own seconds."""
        if abs(rate - self._rate) > RATE_CHANGES:
            self._rate = rate
            self._report(f"the autopilot's clock runs at {rate:.3f} of this computer's")

    def show_beside(self, health: Health) -> None:
        """Other autopilots that are heard, each once: the one that is followed may be the wrong one."""
        for name in [n for n in health.beside if n not in self._beside][: MOST_BESIDE - len(self._beside)]:
            self._beside.add(name)
            self._report(f"also heard: {name}; followed is {health.autopilot} (`autopilot.system` chooses)")

    def show_errors(self, lines: Sequence[str]) -> None:
        """Exceptions over single messages, the first of each kind. `lines` only grows."""
        for line in lines[self._errors_shown :]:
            self._report(line)
        self._errors_shown = len(lines)

    def show_refusals(self, health: Health) -> None:
        """Camera messages that were refused: a new kind at once, the same again after a while. `health` comes once
        a second; a flood of kinds gets a line each time."""
        self._refusals_left = min(self._refusals_left + 1, MOST_REFUSALS)
        shown = self._refusals
        self._refusals = {}  # of those that are not among the latest any more nothing is kept
        for refusal in health.refusals:
            key = refusal.source, refusal.reason
            before = shown.get(key)
            is_due = before is None or refusal.t_recv_ns - before.t_recv_ns > REFUSED_AGAIN_NS
            if not (is_due and self._refusals_left > 0):
                if before is not None:
                    self._refusals[key] = before
                continue
            self._refusals_left -= 1
            self._refusals[key] = refusal
            times = f" ({refusal.count} times)" if refusal.count > 1 else ""
            what = "" if refusal.reason.startswith(DOUBT) else "refused from "
            self._report(f"{what}{refusal.source}: {refusal.reason}{times}")

    def show_links(self, links: Mapping[str, LinkHealth]) -> None:
        """A link that has no peer is no error, but silence may have this reason."""
        troubles = {name: health.error for name, health in links.items()}
        for name, trouble in troubles.items():
            if trouble != self._troubles.get(name, ""):
                self._report(f"link {name}: {f'{trouble}; trying again' if trouble else 'connected'}")
        self._troubles = troubles
        for name, health in links.items():
            knocked = name, health.refused_from.rpartition(":")[0]
            if health.refused and knocked not in self._knocked and len(self._knocked) < MOST_BESIDE:
                self._knocked.add(knocked)
                self._warn(
                    f"link {name}: refused a connection from {health.refused_from}: another peer still sends"
                )
            if health.shed and name not in self._shedding:
                self._shedding.add(name)
                self._report(f"link {name}: too many messages; those beyond are left out (`shed` in the health)")

    def show_sinks(self, sinks: Mapping[str, SinkHealth]) -> None:
        """A sink that fails does not end the flight, but somebody should know: a recording may be missing."""
        errors = {name: health.error for name, health in sinks.items()}
        for name, error in errors.items():
            if error != self._errors.get(name, ""):
                self._warn(f"{name}: {error or 'works again'}")
        self._errors = errors
