"""The offset between this computer's clock and the autopilot's boot clock.

It comes from TIMESYNC replies, otherwise from the fastest messages: the lower envelope of arrival minus stamp.
While a link is held up, even its fastest messages are late, so the envelope rises no faster than clocks drift
apart. A simulator's clock may run slower or faster: if the offset changes steadily and far more than two quartz
clocks could, its slope is followed. Arrivals that wander show no slope: then the rate is uncertain.
"""

import math
from itertools import pairwise
from typing import Final, NamedTuple

from onboard.units import NS_PER_S

WINDOW_NS: Final = 10 * NS_PER_S
MAX_DRIFT: Final = 300e-6  # between two clocks, s/s; simulated autopilots show 150e-6
BLOCK_DURATION_NS: Final = 250_000_000  # The fastest message of each block shows the offset's change.
FIT_WINDOW_NS: Final = 5 * NS_PER_S
MIN_FIT_POINT_COUNT: Final = 5
MIN_FIT_SPAN_NS: Final = {"timesync": NS_PER_S, "arrival": 3 * NS_PER_S}  # of a slope that is followed
MIN_DOUBT_SPAN_NS: Final = 750_000_000  # of a slope that is reported as uncertain
MIN_NOISE_NS: Final = {"timesync": 300_000, "arrival": 2_000_000}  # standard deviation of a point
MIN_OFFSET_RATE: Final = 1e-3  # s/s; the newest messages follow smaller slopes without a model.
MIN_DOUBTFUL_RATE: Final = 5e-3  # s/s; a larger slope that is not followed yet distorts estimates.
SLOPE_SIGMAS: Final = 5.0
MAX_RESIDUAL_FRACTION: Final = 0.1  # of the change over the span; a step leaves a larger residual than a slope.
# Standard deviation of arrivals about a slope: a simulator shows 2 ms, a slow radio, whose delay wanders, 22 ms.
MAX_ARRIVAL_RESIDUAL_NS: Final = 5_000_000
SLOPE_CHANGE_FRACTION: Final = 0.1  # by which a steady slope may change
LATENESS_SPREAD_FACTOR: Final = 10  # A link's lateness may be this many times the spread of its fastest messages.
MIN_LATENESS_TIME_NS: Final = 100_000_000
# Stamps that are earlier than all others by this much, and only for this long, were wrong. They are dropped if the
# offset returns to its former value and is steady, which that of a link that is held up again is not.
MIN_DROP_SIZE_NS: Final = 50_000_000
MAX_DROP_DURATION_NS: Final = NS_PER_S
MAX_STEADY_SPREAD_NS: Final = 20_000_000
DROP_CHECK_DELAY_NS: Final = 4 * NS_PER_S
ROUND_TRIP_TOLERANCE_NS: Final = 5_000_000  # beyond the error of round trips; else the clock has jumped


class Reply(NamedTuple):
    """A TIMESYNC reply. All times are in ns."""

    round_trip: int
    t_recv: int
    offset: int  # in the middle of the round trip


class Offset:
    """Host clock minus boot clock, in ns."""

    def __init__(self) -> None:
        self.slope = 0.0  # growth in s per second of the host clock: 0.1 if the boot clock runs at 0.9 of ours
        self.doubt = False  # A slope is visible but too uncertain to follow, or arrivals wander.
        self.is_paced = False  # Another clock shows that both clocks run alike; arrivals only wander.
        self.fastest: list[tuple[int, int]] = []  # (t_recv, host - boot), the lower envelope, the lowest first
        self.replies: list[Reply] = []
        self._best: Reply | None = None  # reply; None until needed
        self._blocks: list[tuple[int, int]] = []  # the fastest of each block
        self._shown: list[Reply] = []  # replies to fit
        self._drop: tuple[int, int] | None = None  # arrival of a much earlier stamp, and the offset before it

    @property
    def round_trip_ns(self) -> int | None:
        """The shortest round trip of the last seconds, None without replies."""
        return min(self.replies).round_trip if self.replies else None

    def at(self, t_ns: int) -> int | None:
        """The offset at a time of the host clock, None before the first message."""
        if self.replies:
            if self._best is None:
                newest, spread = self.replies[-1].t_recv, self._spread
                self._best = min(self.replies, key=lambda r: 0.5 * r.round_trip + spread * (newest - r.t_recv))
            since_ns, offset = self._best.t_recv - self._best.round_trip // 2, self._best.offset
        elif self.fastest:
            since_ns, offset = self.fastest[0]
        else:
            return None
        return offset + round(self.slope * (t_ns - since_ns))

    def bounds(self, t_ns: int) -> tuple[int | None, int | None]:
        """Return the offset at a host time, and the offset of the latest possible stamp.

        None if too little is known. The bound comes from the round trip of replies. Without replies it allows for
        a link that is always late, by many times the spread of its fastest messages.
        """
        offset, carried = self.at(t_ns), self.fastest[0][1] if self.fastest else None
        if offset is None or carried is None or self.slope != 0.0 or self.doubt:
            return offset, None
        if self.replies:
            return offset, min(offset, carried) - min(self.replies).round_trip // 2
        if len(self._blocks) < MIN_FIT_POINT_COUNT:
            return offset, None
        fastest = [o for _, o in self._blocks[:-1]]
        return offset, offset - max(MIN_LATENESS_TIME_NS, LATENESS_SPREAD_FACTOR * (max(fastest) - min(fastest)))

    def clear(self) -> None:
        """Forget the offset, since one clock was set. The rates remain."""
        self.fastest.clear()
        self.replies.clear()
        self._best = None
        self._blocks.clear()
        self._shown.clear()
        self._drop = None

    def add_arrival(self, t_recv: int, offset: int) -> None:
        """Learn from a message that arrived `offset` after its stamp."""
        while self.replies and t_recv - self.replies[0].t_recv >= WINDOW_NS:
            self.replies.pop(0)
            self._best = None
        before = self.carried(t_recv) if self.fastest else offset
        if self._drop is None and offset < before - MIN_DROP_SIZE_NS:
            self._drop = t_recv, before
        lower(self.fastest, offset, t_recv, self.slope, self._spread)
        blocks = self._blocks
        if not blocks or t_recv // BLOCK_DURATION_NS > blocks[-1][0] // BLOCK_DURATION_NS:
            if blocks and not self.replies:
                self._fit([(float(t), float(o)) for t, o in blocks if t_recv - t < FIT_WINDOW_NS], "arrival")
            if self._drop is not None and t_recv - self._drop[0] >= DROP_CHECK_DELAY_NS:
                self._judge_drop(*self._drop)
                self._drop = None
            blocks.append((t_recv, offset))
            while t_recv - blocks[0][0] >= WINDOW_NS:
                blocks.pop(0)
        elif offset < blocks[-1][1]:
            blocks[-1] = t_recv, offset

    def carried(self, t_ns: int) -> int:
        """The offset of the fastest messages, extrapolated."""
        since_ns, offset = self.fastest[0]
        return offset + round(self.slope * (t_ns - since_ns))

    def _judge_drop(self, t_ns: int, before: int) -> None:
        """Undo a drop of the envelope that did not last, if all has been as before since then."""
        since = [block for block in self._blocks if block[0] - t_ns > MAX_DROP_DURATION_NS]
        offsets = [offset - self.slope * (t - t_ns) for t, offset in since]
        if (
            offsets
            and max(offsets) - min(offsets) < MAX_STEADY_SPREAD_NS
            and abs(min(offsets) - before) < MIN_DROP_SIZE_NS
        ):
            self._blocks = since
            self._recompute_envelope()

    def add_reply(self, reply: Reply) -> None:
        """Learn from a reply. If the last two contradict the earlier ones, the clock has jumped."""
        self.replies = [r for r in self.replies if reply.t_recv - r.t_recv < WINDOW_NS]
        if self.replies and self._agree(self.replies[-1], reply):
            self.replies = [r for r in self.replies if self._agree(r, reply)]
        self.replies.append(reply)
        self._best = None
        self._shown = [r for r in self._shown if 0 <= reply.t_recv - r.t_recv < FIT_WINDOW_NS]
        self._shown.append(reply)
        usual = 2 * min(self._shown).round_trip + ROUND_TRIP_TOLERANCE_NS
        good = [(r.t_recv - 0.5 * r.round_trip, float(r.offset)) for r in self._shown if r.round_trip <= usual]
        self._fit(good, "timesync")

    def keep(self, arrivals: list[int]) -> None:
        """Keep only the replies that arrived at these times; the others are not ours."""
        self.replies = [r for r in self.replies if r.t_recv in arrivals]
        self._shown = [r for r in self._shown if r.t_recv in arrivals]
        self._best = None

    @property
    def _spread(self) -> float:
        """The offset's possible growth per second beyond its slope."""
        return MAX_DRIFT + SLOPE_CHANGE_FRACTION * abs(self.slope)

    def _agree(self, a: Reply, b: Reply) -> bool:
        apart = abs(b.offset - a.offset - self.slope * (b.t_recv - a.t_recv))
        known = 0.5 * (a.round_trip + b.round_trip) + self._spread * abs(b.t_recv - a.t_recv)
        return apart <= known + ROUND_TRIP_TOLERANCE_NS

    def _fit(self, points: list[tuple[float, float]], source: str) -> None:
        """Fit a straight line to offsets, and follow its slope if it is certain."""
        if source == "arrival" and self.is_paced:
            self.doubt = False
            self._set_slope(0.0)
            return
        if len(points) < MIN_FIT_POINT_COUNT:
            return
        n, (t0, o0) = len(points), points[0]
        x, y = [t - t0 for t, _ in points], [o - o0 for _, o in points]
        mean_x, mean_y = sum(x) / n, sum(y) / n
        sxx = sum((a - mean_x) ** 2 for a in x)
        span = x[-1] - x[0]
        if sxx == 0.0 or span < MIN_DOUBT_SPAN_NS:
            return
        slope = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / sxx
        left = [b - mean_y - slope * (a - mean_x) for a, b in zip(x, y, strict=True)]
        noise = max(math.sqrt(sum(e * e for e in left) / n), MIN_NOISE_NS[source])
        sigma = noise / math.sqrt(sxx)
        steps = sorted((d - b) / (c - a) for (a, b), (c, d) in pairwise(points) if c > a)
        usual = steps[len(steps) // 2]  # 0 for a single step, or a link that paused
        usual_size = sorted(map(abs, steps))[len(steps) // 2]
        is_steady = noise < MAX_RESIDUAL_FRACTION * abs(slope) * span and abs(usual - slope) < 0.5 * abs(slope)
        is_large = is_steady and abs(slope) > max(MIN_OFFSET_RATE, SLOPE_SIGMAS * sigma)
        wanders = source == "arrival" and noise > MAX_ARRIVAL_RESIDUAL_NS and usual_size > MIN_DOUBTFUL_RATE
        if wanders or span < MIN_FIT_SPAN_NS[source]:
            self.doubt = wanders or (is_large and abs(slope - self.slope) > MIN_DOUBTFUL_RATE)
            return
        self.doubt = False
        if is_large:
            self._set_slope(slope)
        elif abs(slope) + SLOPE_SIGMAS * sigma < 2 * MIN_OFFSET_RATE:
            self._set_slope(0.0)

    def _set_slope(self, slope: float) -> None:
        if slope == self.slope:
            return
        self.slope = slope
        self._best = None
        self._recompute_envelope()

    def _recompute_envelope(self) -> None:
        """Recompute the envelope from the fastest message of each block."""
        self.fastest.clear()
        for t_recv, offset in self._blocks:
            lower(self.fastest, offset, t_recv, self.slope, self._spread)


def lower(
    fastest: list[tuple[int, int]], offset: int, t_recv: int, slope: float = 0.0, spread: float = MAX_DRIFT
) -> None:
    """Add a message to the lower envelope, which is ordered by arrival.

    Each entry is slower than all before it, extrapolated by their slope. The fastest is extrapolated by the
    largest possible drift."""
    while fastest and fastest[-1][1] + round(slope * (t_recv - fastest[-1][0])) >= offset:
        fastest.pop()
    if fastest and t_recv - fastest[0][0] >= WINDOW_NS:
        carried = fastest[0][1] + round((slope + spread) * (t_recv - fastest[0][0]))
        while fastest and t_recv - fastest[0][0] >= WINDOW_NS:
            fastest.pop(0)
        first = fastest[0][1] + round(slope * (t_recv - fastest[0][0])) if fastest else offset
        if carried < first:
            fastest.insert(0, (t_recv, carried))
    fastest.append((t_recv, offset))
