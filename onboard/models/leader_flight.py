"""What is published of a leader: the states of Oh & Johnson's model, and more.

State rows: the nine of `relative_motion` first, [r_FL_n (3), v_FL_n (3), b, a_lat, a_long], then
- `a_along`: acceleration along the track (m/s^2), which the paper leaves out;
- `heading`: of the nose, rad from north, not wrapped;
- `bank_error`: rad beyond the bank that the acceleration requires, tan(bank) = a_right / (g - a_down). Lift, or
  the rotors' thrust, turns any aircraft, and the wing stands square to it.
"""

from typing import Final

from onboard.models import relative_motion

A_ALONG: Final = 9
HEADING: Final = 10
BANK_ERROR: Final = 11
BASE: Final = 12  # the number of states
COMPONENTS: Final = (*relative_motion.COMPONENTS, "a_along", "heading", "bank_error")
UNITS: Final = (*relative_motion.UNITS, "m/s^2", "rad", "rad")
