"""The size of a leader that was followed before: where the next track of it starts."""

from typing import NamedTuple


class Size(NamedTuple):
    """The wingspan and its standard deviation, m."""

    value: float
    sigma: float
