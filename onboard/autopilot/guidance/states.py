"""What guidance remembers beyond its smooth filters: one table of named transitions.

Two things have a state: what the vehicle is led to do, and what the leader does. A state ends by a transition, of
which every state has one that comes by itself or by what is seen now: nothing else is kept of a doubt. The table
is in docs/follow.md, too.
"""

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Final, Generic, NamedTuple, TypeVar

GRACE_S: Final = 1.0  # s, for which a lost leader is followed as if it had flown on: most drop-outs are short
CLEARS_S: Final = 10.0  # s, at most, until the vehicle has changed its height
SETS_OFF_S: Final = 0.4  # s
RESTS_S: Final = 3.0  # s, of a slow one that flew: it may be turning round
TURNED_S: Final = 8.0  # s, of a leader that backs up and does not stop: it has turned round


class Phase(Enum):
    """What the vehicle is led to do."""

    UNLED = "unled"  # no leader is known, or the vehicle has not been led to it
    KEPT = "kept"  # led to stay where it is: its mode's own way would pass the leader
    FOLLOWED = "followed"
    CARRIED = "carried"  # the leader is lost, and followed as if it had flown on
    STOPPED = "stopped"  # led to a stop, with its nose where the leader should be
    CLEARING = "clearing"  # led off the leader's height
    SILENT = "silent"  # nothing is sent; it was led in its mode, and is led again when the leader is seen


class Activity(Enum):
    """What the leader does."""

    RESTS = "rests"
    SETS_OFF = "sets off"  # it moves, and has been slow since it flew on its course: it may fly back
    FLIES = "flies"  # on its course, whatever that turns to: a turn does not pass through zero
    BACKS_UP = "backs up"  # its course is held


class Event(Enum):
    """What is true at a tick; the value is its words."""

    SEEN = "the leader is seen"
    PASSES = "the leader is seen, and the mode's own way would pass it"
    LOST = "the leader is lost"
    ELSEWHERE = "the leader is lost, another mode flies, and this one would begin on the last target"
    HELD = "it has been lost for `hold_s`"
    CLEAR = "it has been lost for `hold_s`, and the vehicle is off its height, or cannot leave it"
    FAST = "it is faster than 2 m/s, and 2.5 sigmas from a standstill"
    MAY_REST = "it is within 2.5 sigmas of a standstill"
    MOVES = "it is faster than 1 m/s"
    SLOW = "it is slower than 1 m/s"
    CREEPS = "it is slower than 1.5 m/s"
    AGAINST = "it surely flies, more than 100 degrees off its course"
    ALONG = "it surely flies, within 80 degrees of its course"


S = TypeVar("S", bound=Enum)


class StateChange(NamedTuple, Generic[S]):
    """From any of the states `of` to `to`, once `when` has been true for `after_s`."""

    of: tuple[S, ...]
    when: Event
    to: S
    after_s: float = 0.0


LOSING: Final = (Phase.CARRIED, Phase.STOPPED, Phase.CLEARING, Phase.SILENT)
PHASES: Final = (
    StateChange((*LOSING, Phase.UNLED, Phase.FOLLOWED), Event.ELSEWHERE, Phase.KEPT),
    StateChange((*LOSING, Phase.UNLED, Phase.FOLLOWED), Event.PASSES, Phase.KEPT),
    StateChange((*LOSING, Phase.UNLED, Phase.KEPT), Event.SEEN, Phase.FOLLOWED),
    StateChange((Phase.KEPT,), Event.LOST, Phase.UNLED),
    StateChange((Phase.FOLLOWED,), Event.LOST, Phase.CARRIED),
    StateChange((Phase.CARRIED, Phase.STOPPED, Phase.CLEARING), Event.CLEAR, Phase.SILENT),
    StateChange((Phase.CARRIED, Phase.STOPPED), Event.HELD, Phase.CLEARING),
    StateChange((Phase.CARRIED,), Event.LOST, Phase.STOPPED, GRACE_S),
    StateChange((Phase.CLEARING,), Event.LOST, Phase.SILENT, CLEARS_S),
)
MOTIONS: Final = (
    StateChange((Activity.SETS_OFF, Activity.FLIES, Activity.BACKS_UP), Event.SLOW, Activity.RESTS, RESTS_S),
    StateChange((Activity.SETS_OFF,), Event.MAY_REST, Activity.RESTS, RESTS_S),
    StateChange((Activity.RESTS, Activity.SETS_OFF), Event.AGAINST, Activity.BACKS_UP),
    StateChange((Activity.RESTS, Activity.SETS_OFF, Activity.BACKS_UP), Event.ALONG, Activity.FLIES),
    StateChange((Activity.SETS_OFF, Activity.BACKS_UP), Event.MOVES, Activity.FLIES, TURNED_S),
    StateChange((Activity.RESTS,), Event.FAST, Activity.SETS_OFF, SETS_OFF_S),
    StateChange((Activity.FLIES,), Event.CREEPS, Activity.SETS_OFF),
)


class Machine(Generic[S]):
    """A state, and for how long each event has been true since it began."""

    def __init__(self, table: Sequence[StateChange[S]], state: S) -> None:
        self._table, self.state = table, state
        self._true_for: dict[Event, float] = {}  # s

    def step(self, events: Mapping[Event, bool], dt: float) -> bool:
        """Take what is true after a further `dt` s, and the first transition that is due; whether one was."""
        before = self._true_for
        self._true_for = {e: before[e] + dt if e in before else 0.0 for e, is_true in events.items() if is_true}
        for row in self._table:
            if self._true_for.get(row.when, -1.0) >= row.after_s and self.state in row.of:
                self.enter(row.to)
                return True
        return False

    def enter(self, state: S) -> None:
        """Go on in a state that begins now."""
        self.state = state
        self._true_for = {}
