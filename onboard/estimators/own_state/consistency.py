"""How well the filter explains the last second's measurements."""

from collections import deque
from typing import Final

import numpy as np
import numpy.typing as npt

from onboard.filters.belief import Update
from onboard.geometry.units import NS_PER_S

WINDOW_NS: Final = NS_PER_S

Outside = npt.NDArray[np.bool_]


class Counts:
    """Of the last second's measurements: how many components were outside their layer of `sigmas` standard
    deviations of the innovation, and the NIS."""

    def __init__(self, sigmas: float) -> None:
        self._sigmas = sigmas
        self._recent: deque[tuple[int, int, int, float]] = deque()  # t_ns, outside, components, NIS
        self._outside = self._components = 0  # sums over those

    def add(self, t_ns: int, update: Update) -> Outside:
        """Count a measurement; which of its components were outside (m,)."""
        layer = self._sigmas * np.sqrt(np.diag(update.innovation_covariance))
        outside: Outside = np.abs(update.innovation) > layer
        self._recent.append((t_ns, int(outside.sum()), len(outside), float(update.nis)))
        self._outside += self._recent[-1][1]
        self._components += len(outside)
        while self._recent[0][0] < t_ns - WINDOW_NS:
            _, old_outside, old_components, _ = self._recent.popleft()
            self._outside -= old_outside
            self._components -= old_components
        return outside

    @property
    def switch_fraction(self) -> float | None:
        """Share of components outside their layer; None before the first."""
        return self._outside / self._components if self._components else None

    @property
    def nis_ratio(self) -> float | None:
        """NIS over the number of components: 1 where the covariance is right."""
        return sum(nis for _, _, _, nis in self._recent) / self._components if self._components else None
