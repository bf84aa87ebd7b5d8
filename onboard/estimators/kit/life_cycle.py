"""The life cycle that every track has, by the age of what was fused last.

    tracking -> coasting -> lost -> tracking, or forgotten

Only a track that is tracking or coasting is valid.
"""

from typing import Protocol

from onboard.messages import Lifecycle
from onboard.messages.causes import Cause, Reason


class Ages(Protocol):
    """A configuration of ages, s: beyond the first a track coasts, beyond the second it is lost."""

    @property
    def coast_after_s(self) -> float:
        """Older, it is predicted."""

    @property
    def validity_timeout_s(self) -> float:
        """Older, it is not valid."""


def check_order(ages: Ages, forgotten: str) -> None:
    """Raises ValueError for ages out of order; `forgotten`: the key of that at which a track is forgotten."""
    if not ages.coast_after_s <= ages.validity_timeout_s <= getattr(ages, forgotten):
        raise ValueError(f"coast_after_s <= validity_timeout_s <= {forgotten} must hold")


def by_age(age_s: float, ages: Ages, *, one: str, many: str, where: str = "") -> tuple[Lifecycle, Reason]:
    """State and reason when what was fused last is so old. `one`, `many`: what is fused, in words; `where`: added
    to why none was."""
    if age_s <= ages.coast_after_s:
        return Lifecycle.TRACKING, Reason(Cause.FUSED, f"{many} fused")
    if age_s <= ages.validity_timeout_s:
        return Lifecycle.COASTING, Reason(Cause.PREDICTED, f"no {one} fused lately: predicted{where}")
    return Lifecycle.LOST, Reason(Cause.TIMEOUT, f"no {one} fused within the validity timeout{where}")
