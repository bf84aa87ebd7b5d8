"""Health records -> advice: what is wrong, and the line to type or the key to change.

One mechanism for `onboard status`, the daemon's lines, the view and the pilot's STATUSTEXT, which all read
`advice` of the published health. The causes themselves are functions in `causes`."""

from collections import deque
from typing import Final

from onboard.health.causes import OF_MESSAGES, OF_THIS_COMPUTER
from onboard.health.causes_host import STALLED_LAG_S
from onboard.health.causes_state import invalid
from onboard.health.needs import Moment, Needs
from onboard.messages import Advice, Health, Severity
from onboard.units import NS_PER_S, S_PER_NS

COUNT_WINDOW_NS: Final = 5 * NS_PER_S  # counts are compared with those of then
SEVERITIES: Final = (Severity.ERROR, Severity.WARNING, Severity.NOTICE)
SETTLING_TIME_NS: Final = 3 * NS_PER_S  # after this program stood still, until rates are again those that come
MAX_ADVICE_COUNT: Final = 16  # pieces of advice at once


class Advisor:
    """Compares each health record with those of the last seconds."""

    def __init__(self, needs: Needs) -> None:
        self.needs = needs
        self._before: deque[Health] = deque()
        self._first_ns: int | None = None
        self._stood_ns = 0  # see `Moment`

    def advise(self, health: Health) -> tuple[Advice, ...]:
        """Return what is wrong at the time of `health`, the worst first. Call it about once a second."""
        t_ns, kept = health.t_recv_ns, self._before
        if self._first_ns is None or t_ns < self._first_ns or (kept and t_ns < kept[-1].t_recv_ns):
            self._first_ns = t_ns  # this computer's clock was set back
            kept.clear()
        while len(kept) > 1 and t_ns - kept[1].t_recv_ns >= COUNT_WINDOW_NS:
            kept.popleft()
        before = kept[0] if kept else health
        waited = max((t_ns - self._first_ns) * S_PER_NS, health.uptime)
        if health.computer.lag > STALLED_LAG_S:
            self._stood_ns = t_ns
        moment = Moment(health, before, self.needs, waited, self._stood_ns, tuple(kept))
        kept.append(health)
        # Silence, low rates and images without our motion follow from it: they are nobody else's fault.
        has_stood = self._stood_ns > 0 and 0 <= t_ns - self._stood_ns < SETTLING_TIME_NS
        found = [] if has_stood else [advice for cause in OF_MESSAGES for advice in cause(moment)]
        if not has_stood and all(advice.severity is Severity.NOTICE for advice in found):
            found += invalid(moment)  # for which nothing else is to blame
        found += [advice for cause in OF_THIS_COMPUTER for advice in cause(moment)]
        return tuple(sorted(found, key=lambda a: SEVERITIES.index(a.severity))[:MAX_ADVICE_COUNT])
