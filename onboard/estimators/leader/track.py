"""One leader's track: when it starts, what it believes of an image, when it is not to be believed itself.

    searching -> initialising (images must agree) -> tracking -> coasting -> lost -> tracking, or forgotten

Every image gets a verdict. An image is fused at the time it was taken, however late it comes (`_history`). What
has coasted so long that the leader could be almost anywhere about us is not corrected by an image, which no
filter can do from so far: the track begins anew where images agree, and keeps what it knows of the motion.
"""

import math
from collections import deque
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.history import History
from onboard.estimators.leader.filter import LeaderFilter
from onboard.estimators.leader.image import Eye, Image, agree, in_view, ready
from onboard.estimators.leader.report import Outcome, report
from onboard.filters.belief import Belief, FilterError
from onboard.filters.unscented_transform import factor
from onboard.messages import (
    Estimate,
    ImagePoint,
    Lifecycle,
    MeasurementReport,
    Record,
    TargetPoints,
    Verdict,
)
from onboard.models import relative_motion
from onboard.models.relative_motion import R
from onboard.ownship import Ownship

NS: Final = 1_000_000_000
TURNED_SIGMAS: Final = 3.0  # of a point: a camera that turned by more sees another image
TOO_WIDE: Final = 0.2  # of the range: a position less certain is not corrected but begun anew


class Times(Record, frozen=True, kw_only=True):
    """What of the configuration a track needs; see `leader.Config`."""

    initialise_images: int
    rewind_horizon_s: float
    coast_after_s: float
    validity_timeout_s: float
    reset_timeout_s: float
    relock_after_s: float
    stale_after_s: float
    edge_px: float


class Track:
    """All state of one target is in the fields below."""

    def __init__(
        self, name: str, target: str, filter_: LeaderFilter, eye: Eye, times: Times, *, full: bool = False
    ) -> None:
        self.target = target
        self._full = full  # there are too many tracks for this one, which takes nothing
        self.look: tuple[float, ...] | None = None  # where it was last said to be, in n; None: not seen lately
        self._name, self._filter, self._eye, self._times = name, filter_, eye, times
        self._history: History[Any, Ownship] | None = None
        self._candidates: deque[Image] = deque(maxlen=filter_.images or times.initialise_images)
        self._last_fused_ns: int | None = None
        self._last_stamps: deque[int] = deque(maxlen=64)
        self._last_seen: tuple[tuple[ImagePoint, ...], Image] | None = None  # points, and the first image of them
        self._gated_since_ns: int | None = None
        self._to_agree = 0  # images still to be fused before a lost track is believed again
        self._resets = 0
        self._sequence = 0
        self._why = "as many targets are followed as may be" if full else "no image yet"
        self._state_since: tuple[Lifecycle, int] | None = None

    # ----------------------------------------------------------------------------- what comes in

    def take(self, message: TargetPoints, ownship: Ownship) -> Estimate:
        """Check an image, then start the track with it or fuse it."""
        try:
            report = self._take(message, ownship)
        except FilterError as error:
            self._forget(f"the filter failed: {error}")
            report = self._report(message, Verdict.NUMERICAL)
        return self._estimate(ownship, report)

    def tick(self, ownship: Ownship) -> Estimate:
        """Predict to the newest navigation sample, and see what has timed out."""
        if self._history is not None:
            try:
                self._settle(self._history, ownship)
            except FilterError as error:
                self._forget(f"the filter failed: {error}")
        if self._history is not None and self._age(ownship.now_ns) > self._times.reset_timeout_s:
            self._forget("no image for longer than the reset timeout")
        return self._estimate(ownship, None)

    def reset(self, reason: str) -> None:
        """Forget the track and all times."""
        self._forget(reason)
        self._candidates.clear()
        self._last_stamps.clear()
        self._last_seen = None

    def idle_since(self, t_ns: int) -> bool:
        """Whether nothing has been heard of the target for the reset timeout."""
        newest = max(self._last_stamps, default=None)
        silent = newest is None or t_ns - newest > self._times.reset_timeout_s * NS
        return self._history is None and silent

    def likeness(self, image: Image, ownship: Ownship) -> float:
        """How unlike an image is to what this track expects: its NIS over the gate, or infinity. Pure."""
        if self._history is None:
            near = bool(self._candidates) and agree(self._candidates[-1], image)
            return 1.0 if near else float("inf")
        try:
            _, state = self._history.belief_at(image.message.t_ns, ownship)
            outcome = self._fuse(state, image, ownship)[1]
        except FilterError:
            return float("inf")
        return float(outcome.update.nis) / (self._filter.gate or float("inf"))

    # -------------------------------------------------------------------------- one image's way

    def _take(self, message: TargetPoints, ownship: Ownship) -> MeasurementReport:
        if self._full:
            return self._report(message, Verdict.FULL)
        if message.t_ns in self._last_stamps:
            return self._report(message, Verdict.DUPLICATE)
        image = self._ready(message, ownship)
        if isinstance(image, Verdict):
            return self._report(message, image)
        self._last_stamps.append(message.t_ns)
        if self._is_stale(image):
            return self._report(message, Verdict.STALE, image)
        if self._history is None:
            self._start(image, ownship, None)
            return self._report(message, Verdict.INITIALISING, image)
        if not self._history.reaches(message.t_ns):
            return self._report(message, Verdict.TOO_OLD, image)
        if self._is_wide(self._history, message.t_ns, ownship):
            self._start(image, ownship, self._history)
            return self._report(message, Verdict.INITIALISING, image)
        late = self._last_fused_ns is not None and message.t_ns < self._last_fused_ns
        was_lost = self._age(message.t_ns) > self._times.validity_timeout_s
        outcome: Outcome = self._history.insert(message.t_ns, image, ownship)
        self._settle(self._history, ownship, inserted=True)
        if not outcome.fused:
            self._gated(image, ownship)
            return self._report(message, Verdict.GATED, image, outcome)
        if was_lost:  # its gate is wide by then: one image proves nothing
            self._to_agree = self._candidates.maxlen or 1
        self._to_agree = max(self._to_agree - 1, 0)
        self._gated_since_ns = None
        self._last_fused_ns = max(self._last_fused_ns or 0, message.t_ns)
        return self._report(message, Verdict.FUSED_LATE if late else Verdict.FUSED, image, outcome)

    def _ready(self, message: TargetPoints, ownship: Ownship) -> Image | Verdict:
        return ready(message, ownship, self._eye, self._filter, self._times.edge_px)

    def _is_stale(self, image: Image) -> bool:
        """Whether the points have been exactly these for too long, although the camera turned: it hangs."""
        message = image.message
        points = (message.center, message.left, message.right)
        if self._last_seen is None or self._last_seen[0] != points:
            self._last_seen = points, image
        first = self._last_seen[1]
        long = message.t_ns - first.message.t_ns > self._times.stale_after_s * NS
        turned = float(np.abs(image.view.R_cn - first.view.R_cn).max())
        return long and turned > TURNED_SIGMAS * self._eye.camera.sigma

    def _is_wide(self, history: History[Any, Ownship], t_ns: int, ownship: Ownship) -> bool:
        if self._age(t_ns) <= self._times.coast_after_s:
            return False
        mean, covariance = self._filter.believed(history.belief_at(t_ns, ownship)[1])
        widest = float(np.linalg.eigvalsh(covariance[R, R])[-1])
        return widest > (TOO_WIDE * float(np.linalg.norm(mean[R]))) ** 2

    def _start(self, image: Image, ownship: Ownship, before: History[Any, Ownship] | None) -> None:
        """Hold images until enough of them agree; start at the oldest and fuse the rest."""
        held = self._candidates
        while held and image.message.t_ns - held[0].message.t_ns > NS:
            held.popleft()
        if held and not agree(held[-1], image):
            held.clear()
        held.append(image)
        self._why = f"{len(held)} of {held.maxlen} images"
        if len(held) < (held.maxlen or 1):
            return
        images = sorted(held, key=lambda i: i.message.t_ns)
        first = images[0]
        earlier = before.belief_at(first.message.t_ns, ownship)[1] if before else None
        self._history = History(
            first.message.t_ns,
            self._filter.start(first.seen, first.view, earlier),
            horizon_ns=round(self._times.rewind_horizon_s * NS),
            advance=self._advance,
            fuse=self._fuse,
        )
        for other in images[1:]:
            self._history.insert(other.message.t_ns, other, ownship)
        self._last_fused_ns = first.message.t_ns
        self._gated_since_ns, self._to_agree = None, 0
        self._resets += before is not None
        self._settle(self._history, ownship, inserted=True)
        held.clear()

    def _settle(self, history: History[Any, Ownship], ownship: Ownship, inserted: bool = False) -> None:
        """Come up to what is known; an image may have been gated at first, and be fused now that it is judged
        again with what came since."""
        if not (history.settle(ownship) or inserted):
            return
        fused_ns = history.newest(lambda outcome: outcome.fused)
        if fused_ns is not None and fused_ns > (self._last_fused_ns or 0):
            self._last_fused_ns = fused_ns
            self._gated_since_ns = None

    def _gated(self, image: Image, ownship: Ownship) -> None:
        """A track that agrees with nothing any more is given up, and begun anew from what it sees."""
        since = self._gated_since_ns
        if self._to_agree:
            self._to_agree = self._candidates.maxlen or 1
        if since is None:
            self._gated_since_ns = image.message.t_ns
        elif image.message.t_ns - since > self._times.relock_after_s * NS:
            self._forget("every image was gated")
            self._start(image, ownship, None)

    def _forget(self, reason: str) -> None:
        if self._history is not None:
            self._resets += 1
        self._history = None
        self._last_fused_ns = None
        self._gated_since_ns = None
        self._to_agree = 0
        self._why = reason

    # -------------------------------------------------------------------- the filter's two steps

    def _advance(self, state: Any, t0_ns: int, t1_ns: int, ownship: Ownship) -> Any:
        for step in ownship.steps(t0_ns, t1_ns):
            state = self._filter.advance(state, step)
        return state

    def _fuse(self, state: Any, image: Image, ownship: Ownship) -> tuple[Any, Outcome]:
        view = image.view
        if not image.final:
            view = self._eye.at(image.message.t_ns, ownship) or view
        update = self._filter.fuse(state, image.seen, view)
        fused = self._filter.gate is None or update.nis <= self._filter.gate
        return (update.belief if fused else state), Outcome(fused, update, state, view)

    # ---------------------------------------------------------------------------- what is told

    def _age(self, t_ns: int) -> float:
        return float("inf") if self._last_fused_ns is None else (t_ns - self._last_fused_ns) / NS

    def _lifecycle(self, age: float, in_view: bool) -> tuple[Lifecycle, str]:
        if self._history is None:
            return (Lifecycle.INITIALISING if self._candidates else Lifecycle.SEARCHING), self._why
        where = "" if in_view else ", and it should be outside the view"
        if self._to_agree:
            return Lifecycle.LOST, f"seen again: {self._to_agree} more images must agree"
        if age <= self._times.coast_after_s:
            return Lifecycle.TRACKING, "images fused"
        if age <= self._times.validity_timeout_s:
            return Lifecycle.COASTING, f"no image fused lately: predicted{where}"
        return Lifecycle.LOST, f"no image fused within the validity timeout{where}"

    def _expects_view(self, mean: Array, t_ns: int, ownship: Ownship) -> bool:
        """Whether the target's center should be in the image now."""
        view = self._eye.at(t_ns, ownship)
        if view is None:
            return True
        ahead, right, down = (view.R_cn @ (mean[R] - view.r_FC_n)).tolist()
        return ahead > 0 and in_view([(right / ahead, down / ahead)], self._eye.camera, None, 0.0)

    def _believed(self, ownship: Ownship) -> tuple[int, Belief] | None:
        """What the track believes now; nothing goes out that has no factor."""
        if self._history is None:
            return None
        try:
            t_ns, state = self._history.belief_at(ownship.now_ns, ownship)
            belief = self._filter.believed(state)
            factor(belief.covariance)
        except FilterError as error:
            self._forget(f"the filter failed: {error}")
            return None
        return t_ns, belief

    def _estimate(self, ownship: Ownship, report: MeasurementReport | None) -> Estimate:
        t_ns, mean, covariance, in_view = ownship.now_ns, None, None, True
        self.look = None
        believed = self._believed(ownship)
        if believed is not None:
            t_ns, belief = believed
            mean = tuple(belief.mean.tolist())
            covariance = tuple(map(tuple, belief.covariance.tolist()))
            if self._age(t_ns) > self._times.coast_after_s:
                in_view = self._expects_view(belief.mean, t_ns, ownship)
            else:
                range_ = math.hypot(*mean[R])
                self.look = tuple(x / range_ for x in mean[R])
        age = self._age(t_ns)
        state, reason = self._lifecycle(age, in_view)
        if self._state_since is None or self._state_since[0] is not state:
            self._state_since = state, t_ns
        self._sequence += 1
        return Estimate(
            name=self._name,
            target=self.target,
            sequence=self._sequence,
            t_ns=t_ns,
            state=state,
            state_since_ns=self._state_since[1],
            valid=state in (Lifecycle.TRACKING, Lifecycle.COASTING),
            reason=reason,
            frame=relative_motion.FRAME,
            components=self._filter.components,
            units=self._filter.units,
            mean=mean,
            covariance=covariance,
            age=None if age == float("inf") else age,
            reset_count=self._resets,
            measurement=report,
        )

    def _report(
        self,
        message: TargetPoints,
        verdict: Verdict,
        image: Image | None = None,
        outcome: Outcome | None = None,
    ) -> MeasurementReport:
        return report(self._filter, message, verdict, image, outcome)
