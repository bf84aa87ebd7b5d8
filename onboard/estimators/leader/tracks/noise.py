"""How noisy a detector is, by the filter's own evidence.

The innovations of the direction say how far images are from what was predicted. Where half of them are farther off
for a whole window than the configured noise allows, the noise is larger than configured, and is taken for so much
larger. Up to `MOST` times: images that fit worse come of something else, and nothing is valid with them. A median,
so that neither outliers nor a short manoeuvre count; the direction alone, as the wing misleads where the nose is
not on the course.

What was learnt is part of a track's state, so it is rewound with it: an image counts by its exposure, with its
final pose, however late it arrives.
"""

import math
from statistics import median
from typing import Final, NamedTuple

from onboard.arrays import Array

WINDOW: Final = 60  # images
MEDIAN: Final = 2.0 * math.log(2.0)  # of chi-square with two degrees of freedom
TOO_LARGE: Final = 2.0  # times that: no chance
NOISE: Final = 13.8  # as chi-square is in all but one of a thousand
MOST: Final = 6.0  # times the configured noise
WORTH: Final = 1.3  # a larger scale is reported


class NoiseScale(NamedTuple):
    """By what factor (`scale`) the standard deviations of image points are larger than configured; the median NIS
    where even the largest scale does not explain it, else 0; the NIS of the images since the last window; and
    whether it stays as it is."""

    scale: float = 1.0
    beyond: float = 0.0
    window: tuple[float, ...] = ()
    is_fixed: bool = False

    def restarted(self) -> "NoiseScale":
        """For another track of the same detector."""
        return NoiseScale(self.scale, is_fixed=self.is_fixed)

    def after(self, innovation: Array, covariance: Array) -> "NoiseScale":
        """After an image was compared with its prediction: innovation (m,), covariance (m, m), the direction
        first."""
        if self.is_fixed:
            return self
        e, f = innovation[:2].tolist()
        (a, b), (_, d) = covariance[:2, :2].tolist()
        nis = (d * e * e - 2.0 * b * e * f + a * f * f) / (a * d - b * b)
        if nis * self.scale**2 > NOISE * MOST**2:
            return self  # of something else: an outlier, which the gate stops
        window = (*self.window, nis)
        if len(window) < WINDOW:
            return self._replace(window=window)
        found, scale = median(window), self.scale
        ratio = found / MEDIAN
        beyond = found if ratio > TOO_LARGE and scale >= MOST else 0.0
        if ratio > TOO_LARGE:
            scale = min(scale * math.sqrt(ratio), MOST)
        elif scale > 1.0:  # half the way: it is one window's evidence
            scale = min(max(scale * ratio**0.25, 1.0), MOST)
        return NoiseScale(scale, beyond)

    @property
    def finding(self) -> str:
        """What there is to report of it, "" if nothing."""
        return f"the detector is {self.scale:.1f} times as noisy as configured" if self.scale > WORTH else ""

    @property
    def contradiction(self) -> str:
        """Why no estimate is valid, "" if it may be."""
        if not self.beyond:
            return ""
        return f"the images do not fit: NIS {self.beyond:.0f} of 1.4 at {MOST:g} times the configured noise"
