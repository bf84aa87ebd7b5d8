"""The posterior Cramér-Rao bound: the least error that any filter can have."""

import numpy as np

from onboard.arrays import Array
from studies.tracking.outcomes import POSITION


def position_variances(P: Array, F: Array, Q: Array, R: Array, jacobians: Array) -> Array:
    """The bound (T,), m^2, of the position's variance, summed over its axes.

    For a target with the linear motion F and process noise Q (n, n), known to P (n, n) at first, with measurements
    of noise R (m, m) linearised at the truth: `jacobians` (T, m, n).
    """
    variances = np.empty(len(jacobians))
    for k, H in enumerate(jacobians):
        P = F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        left = np.eye(len(P)) - K @ H
        P = left @ P @ left.T + K @ R @ K.T
        variances[k] = P[POSITION, POSITION].sum()
    return variances
