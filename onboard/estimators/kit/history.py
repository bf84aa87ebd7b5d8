"""Late measurements: a short history of beliefs that is rewound and replayed.

Nodes exist at every navigation sample and every measurement of the last fraction of a second. A measurement is
inserted at its own time, whenever it arrives, and all later nodes are computed again, so a late measurement gives
the same belief as one in order. A node reached with extrapolated own motion is provisional: it is computed again
when the motion is known. Gated measurements stay in the history and are tested again.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar


class Motion(Protocol):
    """The model's input between measurements: `Ownship`, or an estimator's own inputs."""

    @property
    def nav_times(self) -> list[int]:
        """Times of samples that get a node."""

    def knows(self, t_ns: int) -> bool:
        """Return whether no later message can change the motion until then."""


B = TypeVar("B")  # a filter's belief
M = TypeVar("M", bound=Motion)


class Node(NamedTuple):
    """A belief at a time, after a measurement if there is one."""

    t_ns: int
    belief: Any
    measurement: Any | None = None
    outcome: Any | None = None  # the last one returned by `fuse`


TIME: Final = attrgetter("t_ns")


class History(Generic[B, M]):
    """Beliefs of one track at its `nodes`, the newest at the end.

    `advance(belief, t0_ns, t1_ns, ownship)` predicts; `fuse(belief, measurement, ownship)` updates and returns
    (belief, outcome). Both must be pure; their errors pass through.
    """

    def __init__(
        self,
        t_ns: int,
        belief: B,
        *,
        horizon_ns: int,
        advance: Callable[[B, int, int, M], B],
        fuse: Callable[[B, Any, M], tuple[B, Any]],
    ) -> None:
        self.nodes = [Node(t_ns, belief)]
        self._provisional_ns: int | None = None  # of the first node reached with extrapolated motion
        self._horizon_ns = horizon_ns
        self._advance = advance
        self._fuse = fuse

    def reaches(self, t_ns: int) -> bool:
        """Return whether a measurement of that time can still be inserted."""
        return t_ns >= self.nodes[0].t_ns

    def insert(self, t_ns: int, measurement: Any, ownship: M, fused: tuple[B, Any] | None = None) -> Any:
        """Insert a measurement at its time, and recompute all later nodes.

        The time must be within reach. `fused` is the belief after it and its outcome, if it has been fused with
        `belief_before` already. Returns the outcome.
        """
        index = bisect_right(self.nodes, t_ns, key=TIME)
        later = self._cut(index) if index < len(self.nodes) else []
        outcome = self._append(t_ns, measurement, ownship, fused)
        if later:
            self._redo(later, ownship)
        return outcome

    def settle(self, ownship: M) -> bool:
        """Recompute provisional nodes, advance to the newest sample, and drop the oldest nodes.

        Called after new own motion. Returns whether any measurement was tested again.
        """
        first, redone = self._provisional_ns, False
        if first is not None and ownship.knows(first):
            redone = True
            self._redo(self._cut(self._before(first) + 1), ownship)
        if times := ownship.nav_times:
            self._append_samples(times[-1] + 1, times, ownship)
        oldest = self.nodes[-1].t_ns - self._horizon_ns
        keep = max(bisect_right(self.nodes, oldest, key=TIME) - 1, 0)
        if self._provisional_ns is not None:  # it will be computed again, from the node before it
            keep = min(keep, self._before(self._provisional_ns))
        del self.nodes[:keep]
        return redone

    def belief_at(self, t_ns: int, ownship: M) -> tuple[int, B]:
        """Return (time, belief) of the newest belief, predicted to t_ns unless it is later."""
        newest = self.nodes[-1]
        if t_ns <= newest.t_ns:
            return newest.t_ns, newest.belief
        return t_ns, self._advance(newest.belief, newest.t_ns, t_ns, ownship)

    def belief_before(self, t_ns: int, ownship: M) -> B | None:
        """Return the belief at a time, from measurements until then; None before the history."""
        if t_ns < self.nodes[0].t_ns:
            return None
        node = self.nodes[bisect_right(self.nodes, t_ns, key=TIME) - 1]
        return node.belief if node.t_ns == t_ns else self._advance(node.belief, node.t_ns, t_ns, ownship)

    def newest(self, holds: Callable[[Any], bool]) -> int | None:
        """Return the time of the newest measurement whose last outcome fulfils `holds`."""
        for node in reversed(self.nodes):
            if node.measurement is not None and holds(node.outcome):
                t_ns: int = node.t_ns
                return t_ns
        return None

    def _before(self, t_ns: int) -> int:
        """Return the index of the last node before a time, or of the first node."""
        return max(bisect_left(self.nodes, t_ns, key=TIME) - 1, 0)

    def _cut(self, index: int) -> list[Node]:
        """Remove and return the nodes from an index on; the first node always stays."""
        later = self.nodes[index:]
        del self.nodes[index:]
        if self._provisional_ns is not None and self._provisional_ns > self.nodes[-1].t_ns:
            self._provisional_ns = None
        return later

    def _redo(self, nodes: list[Node], ownship: M) -> None:
        for node in nodes:
            if node.measurement is not None:
                self._append(node.t_ns, node.measurement, ownship)

    def _append(self, t_ns: int, measurement: Any, ownship: M, fused: tuple[B, Any] | None = None) -> Any:
        self._append_samples(t_ns, ownship.nav_times, ownship)
        if fused is None:
            newest = self.nodes[-1]
            prior = self._advance(newest.belief, newest.t_ns, t_ns, ownship)
            fused = self._fuse(prior, measurement, ownship)
        belief, outcome = fused
        self.nodes.append(Node(t_ns, belief, measurement, outcome))
        if self._provisional_ns is None and not ownship.knows(t_ns):
            self._provisional_ns = t_ns
        return outcome

    def _append_samples(self, until_ns: int, times: list[int], ownship: M) -> None:
        """Append nodes at the navigation samples after the newest node and before `until_ns`."""
        newest = self.nodes[-1]
        for t_ns in times[bisect_right(times, newest.t_ns) :]:
            if t_ns >= until_ns:
                break
            belief = self._advance(newest.belief, newest.t_ns, t_ns, ownship)
            newest = Node(t_ns, belief)
            self.nodes.append(newest)
