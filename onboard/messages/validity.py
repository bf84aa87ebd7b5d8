"""Invalidation of a record after it was made."""

from typing import Final, TypeVar

from msgspec.structs import replace

from onboard.messages.causes import Reason
from onboard.messages.estimates import Estimate, NavState
from onboard.messages.guidance import LeaderState

Judged = TypeVar("Judged", bound=Estimate | LeaderState)

LEADER_VECTORS: Final = ("r_OL_n", "v_L_n", "a_L_n", "covariance", "r_FL_n", "r_FL_covariance")


def invalidate(record: Judged, why: Reason) -> Judged:
    """Return the same record, marked invalid for this reason."""
    made = replace(record, valid=False, cause=why.cause, reason=why.words)
    if isinstance(made, LeaderState):
        return replace(made, **dict.fromkeys(LEADER_VECTORS))
    return replace(made, quality=-1) if isinstance(made, NavState) else made
