"""Compiled functions to be called from compiled code: the pieces of a step that is written out in one call.

Each fills the arrays it is given and returns a status (`belief`), or nothing. A model that advances many small
filters (`estimators.leader.modes`) calls these instead of the public families, which are one call from Python
each.
"""

from onboard.filters.kernels.mixture import mix_into, pass_into, weigh_into
from onboard.filters.kernels.sigma_points import (
    correct_into,
    correct_scratch_shape,
    gather_into,
    gather_scratch_shape,
    spread_into,
)

__all__ = [
    "correct_into",
    "correct_scratch_shape",
    "gather_into",
    "gather_scratch_shape",
    "mix_into",
    "pass_into",
    "spread_into",
    "weigh_into",
]
