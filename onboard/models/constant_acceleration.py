"""Target with constant acceleration: the continuous Wiener process acceleration model.

State rows by axis: [x, vx, ax, y, vy, ay, z, vz, az], SI, in any Cartesian frame: east, north, up at a radar, or
ECEF. The process noise is `filters.discretisation.wiener_acceleration(dt, q, by_axis=True)`.

De Vivo et al. eqs 33-34, Varaprasad et al. eqs 19-20, Lazarov et al. eqs 8-14 (there ordered by derivative).
Errata: eq 34 prints t^3/6 for entry (2, 2), and eq 14 t^5/20 for all variances of an axis; both are indefinite.
They are t^3/3, and t^5/20, t^3/3, t.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, FLOAT, kernel, signature

STATE_SIZE: Final = 9
POSITION: Final = (0, 3, 6)
VELOCITY: Final = (1, 4, 7)
ACCELERATION: Final = (2, 5, 8)


def process(rows: Array, dt: float) -> Array:
    """Return state rows (k, 9) after `dt` seconds."""
    after = np.empty(rows.shape)  # faster than an array from machine code
    _process(rows, dt, after)
    return after


@kernel(signature(2, FLOAT, "out"), **FILLING)
def _process(rows, dt, after):
    half = 0.5 * dt * dt
    for s in range(rows.shape[0]):
        for i in range(0, 9, 3):
            after[s, i] = rows[s, i] + dt * rows[s, i + 1] + half * rows[s, i + 2]
            after[s, i + 1] = rows[s, i + 1] + dt * rows[s, i + 2]
            after[s, i + 2] = rows[s, i + 2]
