"""Lines for a person about changes while the daemon runs."""

from collections.abc import Callable, Sequence
from typing import Final

from onboard.messages import Advice, Estimate, Health, Lifecycle
from onboard.units import NS_PER_S, S_PER_NS

MAX_LINE_COUNT: Final = 5  # of advice at once; then one a second
MAX_ADVICE_COUNT: Final = 64
MIN_RATE_CHANGE: Final = 0.005
MIN_REPEAT_PERIOD_NS: Final = 10 * NS_PER_S  # of the same advice; doubled each time
MAX_REPEAT_PERIOD_NS: Final = 640 * NS_PER_S
ADVICE_TIMEOUT_NS: Final = 30 * NS_PER_S  # returning advice is new after this

Kind = tuple[str, str]  # cause, and what it is about


class _ShownAdvice:
    """Advice that was shown, and the times that decide its repetition."""

    def __init__(self, advice: Advice, t_ns: int) -> None:
        self.advice, self.shown_ns, self.wait_ns = advice, t_ns, MIN_REPEAT_PERIOD_NS
        self.given_ns = t_ns
        self.is_over = False


class ConsoleLines:
    """Lines about changes of estimators' states, and the health's advice.

    `pilot` receives the advice shown here, for readers of STATUSTEXT.
    """

    def __init__(self, report: Callable[[str], None], *, pilot: Callable[[Advice], None]) -> None:
        self._report, self._pilot = report, pilot
        self._states: dict[str, Lifecycle] = {}
        self._errors_shown = 0
        self._shown: dict[Kind, _ShownAdvice] = {}
        self._lines_left = MAX_LINE_COUNT
        self._rate = 1.0

    def show_state(self, estimate: Estimate) -> None:
        """Report a changed state of an estimator."""
        if self._states.get(estimate.name) is not estimate.state:
            self._states[estimate.name] = estimate.state
            self._report(
                f"{estimate.t_ns * S_PER_NS:.2f} s  {estimate.name}: {estimate.state} ({estimate.reason})"
            )

    def show_errors(self, lines: Sequence[str]) -> None:
        """Report exceptions over single messages, the first of each kind; `lines` only grows."""
        for line in lines[self._errors_shown :]:
            self._report(line)
        self._errors_shown = len(lines)

    def show_health(self, health: Health) -> None:
        """Report the health's advice: new kinds at once, repetitions after a while, and its end.

        `health` arrives once a second; a flood of kinds gets one line each time.
        """
        self._show_rate(health.clock_rate)
        self._lines_left = min(self._lines_left + 1, MAX_LINE_COUNT)
        t_ns, given = health.t_recv_ns, set[Kind]()
        for advice in health.advice:
            kind = advice.cause, advice.about
            given.add(kind)
            self._show(kind, advice, t_ns)
        for kind, shown in list(self._shown.items()):
            if kind in given:
                continue
            if shown.advice.over and not shown.is_over:
                shown.is_over = True
                self._report(shown.advice.over)
            if shown.is_over or t_ns - shown.given_ns > ADVICE_TIMEOUT_NS:
                del self._shown[kind]

    def _show(self, kind: Kind, advice: Advice, t_ns: int) -> None:
        before = self._shown.get(kind)
        if before is not None:
            before.given_ns = t_ns
            is_same = advice.what == before.advice.what and advice.count == before.advice.count
            if is_same or t_ns - before.shown_ns <= before.wait_ns:
                return
        if self._lines_left <= 0 or (before is None and len(self._shown) >= MAX_ADVICE_COUNT):
            return
        self._lines_left -= 1
        if before is None:
            self._shown[kind] = _ShownAdvice(advice, t_ns)
        else:
            before.advice, before.shown_ns, before.wait_ns = (
                advice,
                t_ns,
                min(2 * before.wait_ns, MAX_REPEAT_PERIOD_NS),
            )
        self._report(line(advice))
        self._pilot(advice)

    def _show_rate(self, rate: float) -> None:
        """Report a simulator's clock of another rate; estimates are in its seconds."""
        if abs(rate - self._rate) > MIN_RATE_CHANGE:
            self._rate = rate
            self._report(f"the autopilot's clock runs {rate:.3f} times as fast as this computer's")


def line(advice: Advice) -> str:
    """Return advice in one line."""
    times = f" ({advice.count} times)" if advice.count > 1 else ""
    return f"{advice.what}{times}" + (f". Remedy: {advice.remedy}" if advice.remedy else "")
