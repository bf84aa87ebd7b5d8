"""How noisy a detector is, by the filter's own evidence.

The innovations of the direction say how far images are from what was predicted. Where half of them are farther off
for a whole window than the configured noise allows, the noise is larger than configured, and is taken for so much
larger. Up to `MOST` times: images that fit worse come of something else, and nothing is valid with them. A median,
so that neither outliers nor a short manoeuvre count; the direction alone, as the wing misleads where the nose is
not on the course.
"""

import math
from collections import deque
from statistics import median
from typing import Final

import numpy as np

from onboard.arrays import Array

WINDOW: Final = 60  # images
MEDIAN: Final = 2.0 * math.log(2.0)  # of chi-square with two degrees of freedom
TOO_LARGE: Final = 2.0  # times that: no chance
NOISE: Final = 13.8  # as chi-square is in all but one of a thousand
MOST: Final = 6.0  # times the configured noise
WORTH: Final = 1.3  # a scale above it is told


class NoiseScale:
    """By what factor (`scale`) the standard deviations of image points are larger than configured."""

    def __init__(self) -> None:
        self.scale = 1.0
        self._beyond = 0.0  # the median NIS, where even the largest scale does not explain it
        self._nis: deque[float] = deque(maxlen=WINDOW)

    def restart(self) -> None:
        """Another track begins; the detector is the same."""
        self._beyond = 0.0
        self._nis.clear()

    def add(self, innovation: Array, covariance: Array) -> None:
        """An image was compared with its prediction: innovation (m,), covariance (m, m), the direction first."""
        e = innovation[:2]
        nis = float(e @ np.linalg.solve(covariance[:2, :2], e))
        if nis * self.scale**2 > NOISE * MOST**2:
            return  # of something else: an outlier, which the gate stops
        self._nis.append(nis)
        if len(self._nis) < WINDOW:
            return
        found = median(self._nis)
        ratio = found / MEDIAN
        self._beyond = found if ratio > TOO_LARGE and self.scale >= MOST else 0.0
        if ratio > TOO_LARGE:
            self.scale = min(self.scale * math.sqrt(ratio), MOST)
        elif self.scale > 1.0:  # half the way: it is one window's word
            self.scale = min(max(self.scale * ratio**0.25, 1.0), MOST)
        self._nis.clear()

    @property
    def finding(self) -> str:
        """What is to be told of it, "" if nothing."""
        return f"the detector is {self.scale:.1f} times as noisy as configured" if self.scale > WORTH else ""

    @property
    def contradiction(self) -> str:
        """Why no estimate is valid, "" if it may be."""
        if not self._beyond:
            return ""
        return f"the images do not fit: NIS {self._beyond:.0f} of 1.4 at {MOST:g} times the configured noise"
