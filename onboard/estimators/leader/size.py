"""A size that becomes known better while a leader is followed: what the states of the filters become by it.

The images alone never correct the size: they show it over the range. What does is elsewhere (`broadcast`).
"""

from typing import NamedTuple


class Size(NamedTuple):
    """The wingspan and its standard deviation, m."""

    value: float
    sigma: float
