"""Which messages of cameras are refused, in words for the detector's author: the field, and what was expected."""

from functools import lru_cache
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard.health.words import NOTHING, WORDS
from onboard.messages import Estimate, Exposure, MeasurementReport, Message, NavState, Refusal
from onboard.messages.causes import Cause, Reason
from onboard.messages.text import plain, without_names, without_numbers
from onboard.units import S_PER_NS

MAX_REFUSAL_COUNT: Final = 32  # kinds that are remembered: a source and a reason each
MAX_SIMILAR_COUNT: Final = 8  # of these, kinds that differ only in names: senders may choose any number of them
OTHERS: Final = "others"  # the source of all further ones
ROS_HASH: Final = "/RIHS"  # of a type begins so, at the end of a key of rmw_zenoh: nobody reads it
MAX_TEXT_LENGTH: Final = 240  # characters; the text may quote what came


class RefusalKind(NamedTuple):
    """Kind of refusals: a source, and words without numbers; `alike` is without names, too."""

    source: str
    words: str
    alike: str


class Refusals:
    """Refused messages, counted by source and reason.

    The newest kinds are kept, so a flood needs no more memory. Of kinds that differ only in names, few are kept
    apart, so that they do not displace other kinds."""

    def __init__(self) -> None:
        self._kinds: dict[RefusalKind, Refusal] = {}  # the latest last

    @property
    def latest(self) -> tuple[Refusal, ...]:
        """The kinds of refusals that came last, the latest last."""
        return tuple(self._kinds.values())

    def add(self, source: str, why: Reason, t_recv_ns: int) -> None:
        """Count a message that was refused. Reasons that differ only in numbers are one: the first is kept."""
        source, words, key = _classify(source, why.words)
        if key not in self._kinds and sum(other.alike == key.alike for other in self._kinds) >= MAX_SIMILAR_COUNT:
            source, key = OTHERS, RefusalKind(OTHERS, key.alike, key.alike)
        before = self._kinds.pop(key, None)
        if before is None:
            before = Refusal(source=source, cause=why.cause, reason=words, count=0, t_recv_ns=t_recv_ns)
        self._kinds[key] = replace(before, count=before.count + 1, t_recv_ns=t_recv_ns)
        while len(self._kinds) > MAX_REFUSAL_COUNT:
            del self._kinds[next(iter(self._kinds))]

    def add_message(self, message: Message, why: str | Reason) -> None:
        """Count a message that went no further, if it is of a camera: for a reason, or by what the health
        counts."""
        if isinstance(message, Exposure):
            found = why if isinstance(why, Reason) else Reason(Cause(why), WORDS.get(why, NOTHING).refused or "")
            self.add(f"camera {message.camera}", found, message.t_recv_ns)

    def add_verdict(self, estimate: Estimate, report: MeasurementReport) -> None:
        """Count an image that an estimator could not use. A gated image could be used: it only fits no track."""
        known = WORDS.get(report.verdict, NOTHING)
        is_own = isinstance(estimate, NavState) and known.sensor is not None
        text = known.sensor if is_own else known.refused
        if text is None or (report.points is None and not is_own):
            return
        lead = (report.t_ns - estimate.t_ns) * S_PER_NS
        words = f"{report.verdict}: {text.format(lead=lead, age=-lead)}"
        source = f"{'our own' if is_own else 'camera'} {report.source}"
        self.add(source, Reason(Cause(report.verdict), words), report.t_recv_ns)


@lru_cache(maxsize=4 * MAX_REFUSAL_COUNT)  # a flood says the same
def _classify(source: str, words: str) -> tuple[str, str, RefusalKind]:
    """Source and words as they are shown, and their kind."""
    source, words = plain(source.partition(ROS_HASH)[0], MAX_TEXT_LENGTH), plain(words, MAX_TEXT_LENGTH)
    kind = without_numbers(words)
    return source, words, RefusalKind(source, kind, without_names(kind))
