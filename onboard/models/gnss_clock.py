"""Variable-turn target in ECEF with the clock of its receiver: De Vivo et al. eqs 47-49.

State rows (k, 11): those of `variable_turn` in e, then the clock's error and its drift, in m and m/s of range.

Erratum: eq 49 lacks the blocks of the z axis and of the clock.
"""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.discretisation import white_acceleration
from onboard.models import variable_turn

STATE_SIZE: Final = 11
POSITION: Final = variable_turn.POSITION
VELOCITY: Final = variable_turn.VELOCITY
ACCELERATION: Final = variable_turn.ACCELERATION


def process(rows: Array, dt: float) -> Array:
    """Return state rows (k, 11) after `dt` seconds without noise.

    The clock's error grows by its drift.
    """
    after = variable_turn.process(rows, dt)
    after[:, 9] += dt * rows[:, 10]
    return after


def noise(mean: Array, dt: float, q: Any = 1.0, clock: float = 0.0, drift: float = 0.0) -> Array:
    """Return the process noise (..., 11, 11) of a step about states (..., 11).

    `q` is as in `variable_turn.noise`. `clock` and `drift` are densities of random walks, of the clock's error,
    m^2/s, and of its drift, (m/s)^2/s; the paper has only the second. Raises FilterError.
    """
    Q = np.zeros((*mean.shape[:-1], STATE_SIZE, STATE_SIZE))
    Q[..., :9, :9] = variable_turn.noise(mean, dt, q)
    Q[..., 9:, 9:] = white_acceleration(dt, drift, axes=1).Q
    Q[..., 9, 9] += clock * dt
    return Q
