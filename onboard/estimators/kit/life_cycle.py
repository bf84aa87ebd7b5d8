"""Life cycle of a track, by the age of its last fused measurement.

    tracking -> coasting -> lost -> tracking, or forgotten

Only a track that is tracking or coasting is valid.
"""

from typing import Protocol

from onboard.messages import Lifecycle
from onboard.messages.causes import Cause, Reason


class Ages(Protocol):
    """A configuration of the ages, s, at which a track coasts and is lost."""

    @property
    def coast_after_s(self) -> float:
        """Age from which the track is only predicted."""

    @property
    def validity_timeout_s(self) -> float:
        """Age from which the track is not valid."""


def check_order(ages: Ages, forgotten: str) -> None:
    """Raise ValueError for ages out of order.

    `forgotten`: the key of the age at which a track is forgotten.
    """
    if not ages.coast_after_s <= ages.validity_timeout_s <= getattr(ages, forgotten):
        raise ValueError(f"coast_after_s <= validity_timeout_s <= {forgotten} must hold")


def life_by_age(age_s: float, ages: Ages, *, one: str, many: str, where: str = "") -> tuple[Lifecycle, Reason]:
    """Return state and reason for the age of the last fused measurement.

    `one` and `many` name the measurements in words; `where` is added to the reason.
    """
    if age_s <= ages.coast_after_s:
        return Lifecycle.TRACKING, Reason(Cause.FUSED, f"{many} fused")
    if age_s <= ages.validity_timeout_s:
        return Lifecycle.COASTING, Reason(Cause.PREDICTED, f"no {one} fused lately: predicted{where}")
    return Lifecycle.LOST, Reason(Cause.TIMEOUT, f"no {one} fused within the validity timeout{where}")
