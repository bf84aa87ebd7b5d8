"""Unknown components of our position, integrated from our velocity."""

import math

from onboard.messages import Vec3
from onboard.units import S_PER_NS


class Reckoning:
    """Dead reckoning of unknown components, so that checks can use the known ones."""

    def __init__(self) -> None:
        self._last: tuple[int, Vec3, Vec3] | None = None  # time, position, velocity

    def complete(self, t_ns: int, r: Vec3, v_n: Vec3) -> Vec3:
        """Replace each NaN of a position by the integrated velocity."""
        whole = r
        if not all(map(math.isfinite, r)):
            moved = (0.0, 0.0, 0.0)
            if self._last is not None:
                t0_ns, r0, v0 = self._last
                dt = (t_ns - t0_ns) * S_PER_NS
                x, y, z = (a + 0.5 * (u + v) * dt for a, u, v in zip(r0, v0, v_n, strict=True))
                moved = x, y, z
            x, y, z = (a if math.isfinite(a) else b for a, b in zip(r, moved, strict=True))
            whole = x, y, z
        self._last = t_ns, whole, v_n
        return whole
