"""The life cycle of a leader's track, decided in one place (`state`), from what was fused when and what speaks
against it.

    searching -> initialising (images must agree) -> tracking -> coasting -> lost -> tracking, or forgotten

It is LOST while anything contradicts it, while images have yet to agree after it was lost, once no image has shown
its range for too long, and once none has been fused for too long; in the last two cases its own reports may carry
it.
"""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from onboard.estimators.kit.life_cycle import life_by_age
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.config import Config
from onboard.messages import Lifecycle
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

CARRIED: Final = "carried by its broadcast"
ELSEWHERE: Final = "its broadcast had led elsewhere"
OUTSIDE: Final = ", and it should be outside the view"
AGAIN: Final = "seen again: {} more images must agree"
UNSEEN: Final = "no image has shown the wing, and so the range, for too long"


class Facts(NamedTuple):
    """Facts about a track.

    `doubt`: what contradicts it; `in_view`: whether the target should be in the image; `finding`: what else there
    is to report; `question`: what is open about it while it is followed. Both may be ""."""

    doubt: Reason | None
    in_view: bool
    finding: str
    question: str


class TrackStatus(NamedTuple):
    """The state of a track and its reason.

    Since when it has been in this state; the seconds since the newest fused image, None without one; and whether
    it is valid."""

    state: Lifecycle
    why: Reason
    since_ns: int
    age: float | None
    is_valid: bool


class Judgement(NamedTuple):
    """Consequences of an image for a track.

    Whether it is older than the newest that was fused, and whether nothing has passed the gate for so long that
    the track must end."""

    is_late: bool
    is_over: bool


class LifeCycle:
    """When an image was last fused, since when all images are gated, how many images a lost track still has to
    fuse before it is valid again, and what became of the leader's own reports. `images` must agree before a track
    starts."""

    def __init__(self, config: Config, images: int, why: Reason) -> None:
        self.last_fused_ns: int | None = None
        self._last_wing_ns: int | None = None  # the newest fused image that shows the wing, and so the range
        self.resets = 0
        self.why = why  # there is no track
        self._config, self._images = config, images
        self._gated_since_ns: int | None = None
        self._gated_ns = 0  # the newest image that the gate stopped
        self._to_agree = 0
        self._reported_ns: int | None = None  # the newest report of the leader's own that was used
        self._reports_gated = 0  # in a row
        self._elsewhere_ns: int | None = None  # when the leader was not where its reports had led
        self.contradictions = 0  # how often
        self._carried_for_s = config.broadcast.timeout_s + config.broadcast.latency_s
        self._state_since: tuple[Lifecycle, int] | None = None

    def started(self, t_ns: int, *, again: bool) -> None:
        """A track starts with an image of this time, `again` if it replaces another."""
        self.last_fused_ns = self._last_wing_ns = t_ns
        self._gated_since_ns, self._to_agree = None, 0
        self.resets += again

    def judge(self, t_ns: int, *, passes: bool, has_extent: bool, newest_ns: int | None) -> Judgement:
        """An image of this time has passed the gate or not.

        `has_extent`: it shows the range; `newest_ns`: the newest image that the gate lets pass now. The gate of a
        lost track is wide: one image proves nothing, and one without the wing nothing at all."""
        is_late = self.last_fused_ns is not None and t_ns < self.last_fused_ns
        was_lost = self.is_lost(t_ns)
        self.judged_again(newest_ns)
        if passes:
            self._gated_since_ns = None
            self.last_fused_ns = max(self.last_fused_ns or 0, t_ns)
            if has_extent:
                self._last_wing_ns = max(self._last_wing_ns or 0, t_ns)
                self._to_agree = max((self._images if was_lost else self._to_agree) - 1, 0)
            return Judgement(is_late, False)
        if not has_extent:
            return Judgement(is_late, False)
        self._gated_ns = t_ns
        if self._to_agree:
            self._to_agree = self._images
        if self._gated_since_ns is None:
            self._gated_since_ns = t_ns
        return Judgement(is_late, t_ns - self._gated_since_ns > self._config.relock_after_s * NS_PER_S)

    def judged_again(self, fused_ns: int | None) -> None:
        """The history was computed again.

        `fused_ns` is the time of the newest image that the gate lets pass now, perhaps one that it stopped at
        first."""
        if fused_ns is not None and fused_ns > (self.last_fused_ns or 0):
            self.last_fused_ns = fused_ns
            self._gated_since_ns = None

    def reported(self, t_ns: int, *, used: bool) -> None:
        """The leader's own report came, and was used or not.

        Where several in a row contradict what they have carried, one or the other is wrong."""
        if used:
            self._reported_ns, self._reports_gated = max(self._reported_ns or 0, t_ns), 0
            return
        self._reports_gated += 1
        if self._reports_gated >= given.CONTRADICTING_REPORT_LIMIT and self.is_coasting(t_ns):
            self.contradictions += self._reports_gated == given.CONTRADICTING_REPORT_LIMIT
            self._elsewhere_ns = t_ns

    def led_elsewhere(self, t_ns: int) -> None:
        """Images contradict the track.

        If reports had carried it, these are not believed for a while."""
        if self._reported_ns is None or self.was_led_elsewhere(t_ns):
            return
        if self._reported_ns > (self.last_fused_ns or 0) + given.REACQUISITION_INTERVAL_NS:
            self.contradictions, self._elsewhere_ns = self.contradictions + 1, t_ns

    def was_led_elsewhere(self, t_ns: int) -> bool:
        """Whether, lately, the leader was not where its reports had led.

        A clock may have begun anew since."""
        return self._elsewhere_ns is not None and abs(t_ns - self._elsewhere_ns) < given.BROADCAST_DISTRUST_TIME_NS

    def is_carried(self, t_ns: int) -> bool:
        """Whether the leader's own reports say where it is, nobody else could have sent them, and no image
        contradicts them just now."""
        if self._reported_ns is None or not self._config.broadcast.trusted:
            return False
        if self._gated_since_ns is not None and t_ns - self._gated_ns < given.REACQUISITION_INTERVAL_NS:
            return False
        is_recent = t_ns - self._reported_ns <= self._carried_for_s * NS_PER_S
        return is_recent and self._reports_gated < given.CONTRADICTING_REPORT_LIMIT

    def forgotten(self, why: Reason, *, had_track: bool) -> None:
        """The track, if there was one, has ended."""
        self.resets += had_track
        self.last_fused_ns = self._last_wing_ns = self._gated_since_ns = self._reported_ns = None
        self._to_agree = 0
        self.why = why

    def age(self, t_ns: int) -> float:
        """Seconds since the newest fused image; infinity without one."""
        return math.inf if self.last_fused_ns is None else (t_ns - self.last_fused_ns) / NS_PER_S

    def is_coasting(self, t_ns: int) -> bool:
        """Whether the last fused image is so old that the track is no longer tracking."""
        newest_ns = self.last_fused_ns
        return newest_ns is None or (t_ns - newest_ns) / NS_PER_S > self._config.coast_after_s

    def is_lost(self, t_ns: int) -> bool:
        """Whether the last fused image is so old that the track is no longer valid."""
        is_old = self.age(t_ns) > self._config.validity_timeout_s or self._has_only_directions(t_ns)
        return is_old and not self.is_carried(t_ns)

    def _has_only_directions(self, t_ns: int) -> bool:
        """Whether no image has shown the range for so long that it is no longer known."""
        wing_ns = self._last_wing_ns
        return wing_ns is not None and t_ns - wing_ns > self._config.direction_timeout_s * NS_PER_S

    def is_over(self, t_ns: int) -> bool:
        """Whether the last fused image, and the last report, are so old that the track must be forgotten."""
        is_reported = self._reported_ns is not None and t_ns - self._reported_ns < given.REPORTED_TRACK_TIMEOUT_NS
        return self.age(t_ns) > self._config.reset_timeout_s and not is_reported

    def state(self, t_ns: int, facts: Facts) -> tuple[Lifecycle, Reason]:
        """The state of a track, and its reason: the first of these rows that holds."""
        doubt, where = facts.doubt, "" if facts.in_view else OUTSIDE
        rows: Iterable[tuple[bool, Lifecycle, Reason]] = (
            (self._to_agree > 0, Lifecycle.LOST, Reason(Cause.SEEN_AGAIN, AGAIN.format(self._to_agree))),
            (self._has_only_directions(t_ns), Lifecycle.LOST, Reason(Cause.NO_RANGE, UNSEEN + where)),
            (True, *life_by_age(self.age(t_ns), self._config, one="image", many="images", where=where)),
        )
        state, why = next((state, why) for holds, state, why in rows if holds)
        if doubt:
            state, why = Lifecycle.LOST, doubt
        elif state is not Lifecycle.TRACKING and not self._to_agree and self.is_carried(t_ns):
            state, why = Lifecycle.COASTING, Reason(Cause.CARRIED, f"{CARRIED}; {why.words}")
        elif self._elsewhere_ns is not None and self.was_led_elsewhere(t_ns):
            why = why.also(ELSEWHERE)
        if facts.finding:
            why = why.also(facts.finding)
        if facts.question and state is not Lifecycle.LOST:
            why = why.also(facts.question)
        return state, why

    def status(self, t_ns: int, facts: Facts | None, *, is_held: bool) -> TrackStatus:
        """Return the status of a track with these facts.

        None: there is no track, but images may be held to start one."""
        if facts is not None:
            state, why = self.state(t_ns, facts)
        else:
            state, why = Lifecycle.INITIALISING if is_held else Lifecycle.SEARCHING, self.why
        if self._state_since is None or self._state_since[0] is not state:
            self._state_since = state, t_ns
        age = None if self.last_fused_ns is None else self.age(t_ns)
        return TrackStatus(state, why, self._state_since[1], age, state.is_valid)

    @property
    def latest(self) -> Lifecycle:
        """The state that was asked for last."""
        return Lifecycle.SEARCHING if self._state_since is None else self._state_since[0]
