"""How often a target is predicted and published between its images."""

from onboard.geometry.units import NS_PER_S


class RateLimit:
    """When a target's next estimate is due, so that there are `rate_hz` a second on average, those with an image
    included.

    Estimates are of the times of navigation samples: where these come every 20 ms, 30 images a second bring an
    estimate after 20 or 40 ms. So the next one is due an interval after the last one was due, not after it came.
    One that comes early postpones the next one by an interval at most.
    """

    def __init__(self, rate_hz: float) -> None:
        self._interval_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None

    def published(self, t_ns: int) -> None:
        """An estimate of this time was published, with or without an image."""
        due_ns = t_ns if self._due_ns is None else self._due_ns
        counted_ns = min(max(due_ns, t_ns - self._interval_ns), t_ns + self._interval_ns)
        self._due_ns = counted_ns + self._interval_ns

    def is_due(self, t_ns: int) -> bool:
        """Whether to predict and publish at this time; also when time has gone back."""
        if self._due_ns is None:
            return True
        return not 0 < self._due_ns - t_ns <= 2 * self._interval_ns

    def clear(self) -> None:
        """Forget all times: the next estimate is due at once."""
        self._due_ns = None
