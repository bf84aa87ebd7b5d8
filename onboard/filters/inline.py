"""What a step written out in one compiled call is made of: compiled functions to be called from compiled code.

Each fills the arrays it is given and returns a status (`belief`). A model that advances many small filters
(`estimators.leader.modes`) calls these instead of the public families, which are one call from Python each.
"""

from onboard.filters.kernels.mixture import mix_into, pass_into, weigh_into
from onboard.filters.kernels.sigma_points import (
    FLAGS,
    correct_into,
    correct_room,
    gather_into,
    gather_room,
    spread_into,
)

__all__ = [
    "FLAGS",
    "correct_into",
    "correct_room",
    "gather_into",
    "gather_room",
    "mix_into",
    "pass_into",
    "spread_into",
    "weigh_into",
]
