"""Why an estimate is not valid, where nothing else that is wrong says so: by the cause that it states itself."""

from collections.abc import Iterator
from typing import Final

from onboard.health.needs import Moment
from onboard.health.words import NOTHING, WORDS
from onboard.messages import Advice, Health
from onboard.messages.causes import Cause
from onboard.units import NS_PER_S

MIN_INVALID_DURATION_NS: Final = 5 * NS_PER_S  # not valid for so long
VALID: Final = frozenset({Cause.NONE, Cause.FUSED, Cause.PREDICTED, Cause.CARRIED})


def invalid(m: Moment) -> Iterator[Advice]:
    """Estimates that have not been valid for some seconds."""
    if m.now.t_recv_ns - m.before.t_recv_ns < MIN_INVALID_DURATION_NS:
        return
    for name in m.now.states:
        if is_valid(m.now, name) or name not in m.before.states or is_valid(m.before, name):
            continue
        cause, why = m.now.causes.get(name, Cause.NONE), m.now.reasons.get(name, "")
        remedy = WORDS.get(cause, NOTHING).state
        yield Advice(
            kind="not-valid",
            severity=remedy.severity,
            about=f"estimate {name}",
            what=f"the {name} estimate is not valid: {why or cause.meaning}",
            remedy=remedy.words,
            text=f"{name}: {why or cause.meaning}",
            over=f"{name}: valid again",
        )


def is_valid(health: Health, name: str) -> bool:
    """Whether the newest estimate of this name may be used."""
    return health.states[name].is_valid and health.causes.get(name, Cause.NONE) in VALID
