"""What is not known of our position, from our velocity."""

import numpy as np

from onboard.arrays import Array
from onboard.messages import Vec3


class Reckoning:
    """A position of which some components are not known, completed by the way that the velocity makes: so that
    the components that are known are compared with the velocity, whatever the others are."""

    def __init__(self) -> None:
        self._last: tuple[int, Array, Array] | None = None  # time, position, velocity

    def complete(self, t_ns: int, r: Array, v_n: Vec3) -> list[float]:
        """The position (3,) at a time, NaN where it is not known, with no NaN left."""
        v = np.array(v_n)
        moved = np.zeros(3)
        if self._last is not None:
            t0_ns, r0, v0 = self._last
            moved = r0 + 0.5 * (v0 + v) * ((t_ns - t0_ns) * 1e-9)
        whole = np.where(np.isfinite(r), r, moved)
        self._last = t_ns, whole, v
        x, y, z = whole.tolist()
        return [x, y, z]
