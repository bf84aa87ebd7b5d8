"""One target's track: it starts when images agree, fuses images, and ends when none fits any more.

Every image gets a verdict. An image is fused at the time it was taken, however late it arrives
(`kit.history`). After a long gap the position may be so uncertain that no filter can be corrected by an
image. The track then starts anew where images agree, and keeps what it knows of the motion. `life_cycle` says
what state it is in.
"""

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from onboard.estimators.kit.history import History
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import Size
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary, Report
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.estimators.leader.image.camera_pose import CameraPoses, PosedExposure
from onboard.estimators.leader.image.detector import NoiseScale, Repeats
from onboard.estimators.leader.image.prepare import Image, hold, prepare
from onboard.estimators.leader.reports.prior import Prior
from onboard.estimators.leader.tracks.doubts import Checks, cameras_apart
from onboard.estimators.leader.tracks.fusing import (
    ImageRecord,
    Predicted,
    TrackHistory,
    TrackState,
    advance,
    compare,
    fuse,
    passes,
)
from onboard.estimators.leader.tracks.life_cycle import Facts, LifeCycle
from onboard.estimators.leader.tracks.report import RateLimit, modes_of, publish, report
from onboard.filters.belief import Belief, FilterError
from onboard.filters.definite import factor
from onboard.messages import Estimate, Lifecycle, MeasurementReport, Mode, TargetImage, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.models import relative_motion
from onboard.models.relative_motion import POSITION, SIZE
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

NOISE: Final = NoiseScale()  # before anything is learnt
NO_IMAGE: Final = Reason(Cause.NO_MEASUREMENT, "no image yet")
FULL: Final = Reason(Cause.FULL, "as many targets are followed as may be")
FORGOTTEN: Final = Reason(Cause.FORGOTTEN, "no image for longer than the reset timeout")
FUSED: Final = (Verdict.FUSED, Verdict.FUSED_LATE)
ALL_GATED: Final = Reason(Cause.ALL_GATED, "every image was gated")
HANGS: Final = Reason(Cause.STALE, "the camera hangs: its image stays although we turn")


class Track:
    """All state of one target.

    `place` (3,): where the target was estimated last, None without a track; `held`: images that are to start it;
    `repeats`: its stamps; `rate_limit`: when a tick is due; `sequence` and `life`: counts that go on with its
    name; `why`: why there is none yet. `may_begin`: asked, by target and time, before its filter starts."""

    def __init__(
        self,
        name: str,
        target: str,
        filter_: BeliefFilter,
        poses: CameraPoses,
        config: Config,
        *,
        why: Reason = NO_IMAGE,
        may_begin: Callable[[str, int], bool] = lambda *_: True,
    ) -> None:
        self.target, self._may_begin = target, may_begin
        self.place: tuple[float, ...] | None = None
        self._name, self._filter, self._poses, self._config = name, filter_, poses, config
        self._history: TrackHistory | None = None
        self._images = config.initialise_images  # that must agree before a track starts
        self.held: deque[Image] = deque(maxlen=self._images)
        self.rate_limit = RateLimit(config.publish_rate_hz)
        self.repeats = Repeats(config.stale_after_s, poses.camera.sigma)
        self._checks, self._noise = Checks(config), NOISE  # of the tracks before
        self._mean_nis = 1.0  # by the images before a track starts
        self.size: Size | None = None  # by more than images
        self.prior: Prior | None = None  # of an earlier run, until a track starts
        self.prior_verdict = ""  # what became of it
        self.sequence = 0
        self.life = LifeCycle(config, self._images, why)

    def claim(self, message: TargetImage, view: PosedExposure, ownship: Ownship) -> ImageRecord:
        """An image beside what this track expects at its time, or the verdict that it cannot be used. Pure."""
        image = self.prepare(message, view, ownship)
        if isinstance(image, Verdict):
            return ImageRecord(message, image)
        return self.compare(image, self.predict(message.t_ns, ownship), ownship)

    def predict(self, t_ns: int, ownship: Ownship) -> Predicted | None:
        """Return the track at the time of an image; None without one, or before all that is remembered."""
        try:
            state = None if self._history is None else self._history.belief_before(t_ns, ownship)
            return None if state is None else (state, self._filter.predict(state.leader))
        except FilterError:
            return None

    def compare(self, image: Image, predicted: Predicted | None, ownship: Ownship) -> ImageRecord:
        """An image beside what this track, `predicted` to its time, expects. Pure."""
        record = ImageRecord(image.message, image=image)
        if predicted is None:
            return record
        state, prediction = predicted
        try:
            compared = compare(self._filter, self._poses, state.noise, prediction, image, ownship)
        except FilterError:
            return record
        fits = compared.expected.nis <= self._filter.gate
        return record._replace(state=state, compared=compared, fits=fits)

    def take(self, record: ImageRecord, ownship: Ownship) -> Estimate:
        """Let an image start the track, fuse it, or reject it, as it was compared with the track."""
        try:
            if record.verdict is None and record.image is not None:
                record = self._decide(record, record.image, ownship)
                self._apply(record, ownship)
        except FilterError as error:
            self._fail(error)
            record = ImageRecord(record.message, Verdict.NUMERICAL)
        return self._published(ownship, report(self._filter, record))

    def tick(self, ownship: Ownship) -> Estimate:
        """Predict to the newest navigation sample, and check the timeouts."""
        if self._history is not None:
            try:
                self._settle(self._history, ownship)
            except FilterError as error:
                self._fail(error)
        if self._history is not None and self.life.is_over(ownship.now_ns):
            self._forget(FORGOTTEN)
        return self._published(ownship, None)

    def take_for(self, name: str, t_ns: int, filter_: BeliefFilter | None, config: Config) -> bool:
        """The detector takes an image of this time for a class of targets, which has this filter (None: no such
        class is configured). If most images are of another class than believed, the track begins anew, and True is
        returned."""
        if not self._checks.classes.add(filter_, name, t_ns) or filter_ is None:
            return False
        was_followed = self._history is not None
        if was_followed:
            self._forget(Reason(Cause.CLASS_CHANGED, f"the detector takes it for {name} now"))
        self.held.clear()
        self._filter, self._config = filter_, config
        return was_followed

    def assist(self, taken: Auxiliary, ownship: Ownship) -> Verdict:
        """Use what is measured beside the images at its own time.

        Images come first: what contradicts them is rejected. A report that may be false is used beside them alone.
        """
        history, is_report = self._history, isinstance(taken, Report)
        if history is None:
            return Verdict.INITIALISING
        if not history.reaches(taken.t_ns):
            return Verdict.STALE
        try:
            verdict = self._assist(history, taken, ownship)
        except FilterError as error:
            self._fail(error)
            return Verdict.NUMERICAL
        if is_report and verdict is not Verdict.UNASSOCIATED:
            self.life.reported(taken.t_ns, used=verdict is Verdict.FUSED)
        return verdict

    def _assist(self, history: TrackHistory, taken: Auxiliary, ownship: Ownship) -> Verdict:
        if isinstance(taken, Report):
            if self.life.was_led_elsewhere(taken.t_ns):
                return Verdict.GATED
            if not taken.trusted and self.life.is_coasting(taken.t_ns):
                return Verdict.UNASSOCIATED
        elif self._filter.is_too_wide(history.belief_at(taken.t_ns, ownship)[1].leader, given.MAX_RANGED_SIGMA):
            return Verdict.UNASSOCIATED  # a tangent of the sphere says nothing of a leader far from it
        used: bool = history.insert(taken.t_ns, taken, ownship)
        self._settle(history, ownship, inserted=True)
        if not used:
            return Verdict.GATED
        belief = self._filter.belief(history.belief_at(ownship.now_ns, ownship)[1].leader)
        self.size = Size(float(belief.mean[SIZE]), math.sqrt(belief.covariance[SIZE, SIZE]))
        return Verdict.FUSED

    def reset(self, why: Reason) -> None:
        """Forget the track and all times."""
        self._forget(why)
        self.held.clear()
        self.repeats.clear()
        self._checks.clear()
        self.rate_limit.clear()

    @property
    def is_followed(self) -> bool:
        """Whether images agreed, so that there is a track."""
        return self._history is not None

    @property
    def filter(self) -> BeliefFilter:
        """Return the filter of the target's believed class."""
        return self._filter

    @property
    def range(self) -> float:
        """Return the range of the last estimate, m; infinite without a track."""
        return math.inf if self.place is None else math.hypot(*self.place)

    @property
    def half_wing(self) -> float:
        """Return the largest apparent length of half the wing, in focal lengths."""
        return min(0.5 * self._config.size_prior_m / max(self.range, 1e-3), 1.0) if self.place else 1.0

    @property
    def direction_n(self) -> tuple[float, ...] | None:
        """Return the direction of the last estimate (3,) in n; None without a track."""
        return None if self.place is None else tuple(x / self.range for x in self.place)

    @property
    def state(self) -> Lifecycle:
        """The state of the last estimate."""
        return self.life.latest

    @property
    def noise(self) -> NoiseScale:
        """Return the noise of its detector, by all images until now."""
        return self._noise if self._history is None else self._history.nodes[-1].belief.noise

    def is_idle(self, t_ns: int) -> bool:
        """Whether there is no track, nor any image within the last second.

        Older images are not held."""
        newest_ns = self.repeats.newest_ns
        return self._history is None and (newest_ns is None or t_ns - newest_ns > NS_PER_S)

    # ------------------------------------------------------------------------------- measurements

    def prepare(self, message: TargetImage, view: PosedExposure, ownship: Ownship) -> Image | Verdict:
        """The image of a target of this class, or why it cannot be used."""
        settings = self._filter.shape, self._config, self.half_wing, self.noise.scale
        return prepare(message, view, ownship, *settings)

    def prepared(self, image: Image, filter_: BeliefFilter, ownship: Ownship) -> Image | Verdict:
        """An image that was prepared by this filter, as this track would prepare it."""
        is_same = self._filter is filter_ and image.supposes(self.half_wing, self.noise.scale)
        return image if is_same else self.prepare(image.message, image.view, ownship)

    def _decide(self, record: ImageRecord, image: Image, ownship: Ownship) -> ImageRecord:
        """Decide what to do with an image.

        The history keeps it in either case, to judge it again where an earlier one comes later."""
        history, t_ns = self._history, record.message.t_ns
        repeated = self.repeats.judge(image)  # after what is wrong with the image itself
        if repeated is Verdict.DUPLICATE:
            return ImageRecord(record.message, repeated)
        if repeated is not None:
            return record._replace(verdict=repeated, why=HANGS)
        record = record._replace(verdict=Verdict.INITIALISING if image.has_extent else Verdict.DIRECTION_ONLY)
        if history is None:
            return record
        if not history.reaches(t_ns):
            return record._replace(verdict=Verdict.TOO_OLD)
        if self.life.is_coasting(t_ns):  # until its position is too uncertain to be corrected?
            coasted = history.belief_at(t_ns, ownship)[1].leader
            if self._filter.is_too_wide(coasted, given.MAX_CORRECTED_DIRECTION_SIGMA):
                return record._replace(before=history)
        known = None
        if record.state is not None:
            known = fuse(self._filter, self._poses, record.state, image, ownship, record.compared)
        update = history.insert(t_ns, image, ownship, known)
        history.settle(ownship)
        newest_ns = history.newest(passes)
        judged = self.life.judge(t_ns, passes=update.passes, has_extent=image.has_extent, newest_ns=newest_ns)
        if update.passes:
            verdict, why = Verdict.FUSED_LATE if judged.is_late else Verdict.FUSED, None
        else:
            verdict, why = Verdict.GATED, ALL_GATED if judged.is_over else None
        return record._replace(verdict=verdict, update=update, why=why)

    def _apply(self, record: ImageRecord, ownship: Ownship) -> None:
        """Do what was decided."""
        verdict, image, why, t_ns = record.verdict, record.image, record.why, record.message.t_ns
        if image is None:
            return
        if verdict in FUSED:
            self._checks.fused(image)
        elif verdict is Verdict.INITIALISING:
            if record.before is not None and not record.fits:
                self.life.led_elsewhere(t_ns)
            self._start(image, ownship, record.before)
        elif verdict is Verdict.GATED and why is not None:
            self.life.led_elsewhere(t_ns)
            leapt = self._checks.ended(image)
            self._forget(why)
            # Another object fits none of its hypotheses.
            self._mean_nis = 1.0 if leapt else given.MEAN_NIS_AFTER_LOSS
            self._start(image, ownship, None)
        elif verdict is Verdict.GATED:
            self._checks.gated(image)
        elif why is not None and self._history is not None:  # which has taken some of the same images
            self._forget(why)

    def _start(self, image: Image, ownship: Ownship, before: TrackHistory | None) -> None:
        """Hold images until enough of them agree; start at the oldest and fuse the rest."""
        held, last = self.held, self.held[-1] if self.held else None
        hold(held, image)
        self.life.why = Reason(Cause.STARTING, f"{len(held)} of {self._images} images")
        if last is not None and len(held) == 1 and (apart := cameras_apart(last, image)) is not None:
            self.life.why = apart
        if len(held) < self._images or not self._may_begin(self.target, ownship.now_ns):
            return
        images = sorted(held, key=lambda i: i.message.t_ns)
        first = images[0]
        earlier = before.belief_at(first.message.t_ns, ownship)[1].leader if before else None
        measurement = first.measurement.with_attitude_noise(first.pose.noise_c)
        mean_nis = self._mean_nis if before is None else None
        started = self._filter.start(measurement, first.pose, earlier, self.size, mean_nis)
        if self.prior is not None:
            started = self._use_prior(started, self.prior, self.prior.relative(first.message.t_ns, ownship))
        begun = TrackState(started, self.noise, self.noise.scale)
        t_ns, horizon_ns = first.message.t_ns, self._horizon_ns()
        forward, take = partial(advance, self._filter), partial(fuse, self._filter, self._poses)
        self._history = History(t_ns, begun, horizon_ns=horizon_ns, advance=forward, fuse=take)
        for other in images[1:]:
            self._history.insert(other.message.t_ns, other, ownship)
        self.life.started(first.message.t_ns, again=before is not None)
        self._settle(self._history, ownship, inserted=True)
        held.clear()

    def _horizon_ns(self) -> int:
        """Return how far back measurements are fused: reports arrive late."""
        b = self._config.broadcast
        late = b.latency_s + given.REPORT_DELAY_MARGIN_S if b.is_used else 0.0
        return round(max(self._config.rewind_horizon_s, late) * NS_PER_S)

    def _use_prior(self, started: Any, known: Prior, prior: Belief | None) -> Any:
        """The first state of the filter with what an earlier run believed, unless the image contradicts it."""
        after = None if prior is None else self._filter.informed(started, prior, flew=known.flew)
        late = "warm_start_too_late" if prior is None else "warm_start_contradicted"
        self.prior, self.prior_verdict = None, late if after is None else "warm_start_used"
        return started if after is None else after

    def _settle(self, history: TrackHistory, ownship: Ownship, *, inserted: bool = False) -> None:
        """Come up to the newest own motion.

        The history fuses and gates its images anew where that changes them: the gate may let pass an image that it
        stopped at first."""
        if history.settle(ownship) or inserted:
            self.life.judged_again(history.newest(passes))

    def _fail(self, error: FilterError) -> None:
        self._forget(Reason(Cause.FILTER_FAILED, f"the filter failed: {error}"))

    def _forget(self, why: Reason) -> None:
        self.life.forgotten(why, had_track=self._history is not None)
        self._mean_nis = 1.0
        self.prior = None
        self._noise = self.noise.restarted()
        self._history = None

    # ---------------------------------------------------------------------------------- estimates

    def _published(self, ownship: Ownship, measurement: MeasurementReport | None) -> Estimate:
        """The estimate now; where it says that the target is prepares the next image."""
        estimate = self._estimate(ownship, measurement)
        self.place = None if estimate.mean is None else estimate.mean[:3]
        return estimate

    def _estimate(self, ownship: Ownship, measurement: MeasurementReport | None) -> Estimate:
        """The estimate now, with the report on the image that it follows, if any.

        A covariance without a Cholesky factor ends the track."""
        t_ns, belief, life = ownship.now_ns, None, self.life
        modes: tuple[Mode, ...] = ()
        if self._history is not None:
            try:
                at_ns, track = self._history.belief_at(t_ns, ownship)
                belief, left = self._filter.published(track.leader)
                factor(belief.covariance)
                t_ns = at_ns
            except FilterError as error:
                self._fail(error)
                belief = None
        facts: Facts | None = None
        if belief is not None:
            noise, r_FL_n = track.noise, belief.mean[POSITION]
            doubt, finding = self._checks.judge(t_ns, noise, is_misfit=left.is_misfit)
            in_view = not life.is_coasting(t_ns) or self._poses.see(r_FL_n, t_ns, ownship)
            facts = Facts(doubt, in_view, finding, left.reason)
        state, why, since_ns, age, is_valid = life.status(t_ns, facts, is_held=bool(self.held))
        if belief is not None and left.reason and is_valid:
            modes = modes_of(left.places)
        self.sequence += 1
        tilt, yaw = math.radians(self._config.own_tilt_sigma_deg), math.radians(self._config.own_yaw_sigma_deg)
        return publish(
            belief,
            (tilt, tilt, yaw),
            self.rate_limit,
            ownship,
            name=self._name,
            target=self.target,
            sequence=self.sequence,
            t_ns=t_ns,
            state=state,
            cause=why.cause,
            reason=why.words,
            measurement=measurement,
            modes=modes,
            state_since_ns=since_ns,
            valid=is_valid,
            frame=relative_motion.FRAME,
            components=self._filter.components,
            units=self._filter.units,
            age=age,
            reset_count=life.resets,
        )
