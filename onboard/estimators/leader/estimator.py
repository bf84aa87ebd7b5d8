"""The motion of other aircraft relative to us, from three points of each in our camera.

Every target has a track of its own (`track`), with a filter (`hypotheses.belief`). An image with an id goes to the
track of that id, one without to the track whose prediction it fits best. If it fits none, it is either an outlier
or of another aircraft: an outlier, if the camera sees no more aircraft at once than there are
tracks (`Exposures`). Otherwise outliers would begin a second track of the same aircraft, which then takes half of
its images. So would a detector that draws two boxes about one aircraft: images that lie half upon each other count
as one.

Ids are unlimited, so a flood of them must not cost the leader anything. A target without a track is published only
when an image of it comes, and forgotten after a second without one. Their tracks begin one by one, not twenty at
the same moment. Images of one target too many are all counted, and few are reported.
"""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Final, NamedTuple

from onboard import messages
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.belief import BeliefFilter, make_filter, make_plain_filter
from onboard.estimators.leader.hypotheses.wind import TIMEOUT_NS, UNKNOWN, Wind, wind_of
from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.estimators.leader.image.prepare import Image, prepare
from onboard.estimators.leader.reports.broadcast import Broadcast
from onboard.estimators.leader.reports.prior import prior_of, size_of
from onboard.estimators.leader.reports.ranging import Ranging
from onboard.estimators.leader.tracks.fusing import Distance
from onboard.estimators.leader.tracks.gimbal_frames import GimbalFrames, may_be_contradicted
from onboard.estimators.leader.tracks.track import Track
from onboard.geometry.camera import Camera
from onboard.geometry.units import NS_PER_S
from onboard.messages import (
    Estimate,
    Exposure,
    ImagePoint,
    Lifecycle,
    Message,
    TargetDetection,
    TargetImage,
    Verdict,
)
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship

NAME: Final = "leader"
LISTENS: Final = (Exposure, messages.Wind, messages.WarmState)
CONTRADICTED: Final = "broadcast_contradicted"  # how often the leader was not where its broadcast had led
NO_ID: Final = ""
GIMBAL: Final = "gimbal_contradicted"  # how often the images began to contradict a gimbal's flags
CLASS: Final = "class_changed"  # how often the detector has taken a target for something else from some image on
RENAMED: Final = "target_renamed"  # how often a track has gone on under another id
PASSED_ON: Final = "leader_passed_on"  # how often another target has become the leader
MISFIT: Final = "misfit_"  # before the names of points that fit no nose, in the health
# An image is compared with the tracks at most this many times as far from it as the nearest one, plus this angle.
FARTHER: Final = 3.0
BESIDE: Final = 0.04  # rad
APART: Final = 0.2  # rad; an image this far from every track is of another aircraft, whatever else is in view
WIND_PERIOD_NS: Final = 900_000_000  # between reports of the wind that are used
BEGIN_NS: Final = 50_000_000  # between tracks that begin beside a leader's: each takes 10 ms
REFUSAL_PERIOD_NS: Final = 100_000_000  # between reports of images that are one target too many
UNNAMED: Final = "unnamed/"  # before the numbers of targets without an id
REMEMBERED: Final = 128  # exposures: a second of four cameras


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`. A track for each target, by its id; `verdicts` on all images."""

    def __init__(self, config: Config, camera: Camera) -> None:
        self._verdicts: Counter[str] = Counter()
        self._config, self._poses = config, CameraPoses(camera)
        self._filter = make_filter(config)
        self._classes: dict[str, tuple[BeliefFilter, Config]] = {}
        for name in config.target:
            settings = config.of_class(name)
            alike = [kind for kind in self._classes.values() if kind[1] == settings]  # two names of one thing
            self._classes[name] = alike[0] if alike else (make_filter(settings), settings)
        self._sources: tuple[Broadcast | Ranging, ...] = (
            *([Broadcast(config, self._assist)] if config.broadcast.is_used else []),
            *([Ranging(config, self._assist)] if config.range.is_used else []),
        )
        self._frames: GimbalFrames | None = None
        if may_be_contradicted(camera):
            self._frames = GimbalFrames(NAME, make_plain_filter(config), config, camera)
        self._tracks = {NAME: self._track(NAME)}
        self._numbered = 0
        self._is_named = False  # images say which target is the leader
        self._heir_since_ns: int | None = None  # since when another could be the leader, who is not valid
        self._next_refusal_ns = self._next_begin_ns = 0
        self._exposures = Exposures(config.max_targets)
        self._wind, self._wind_ns = UNKNOWN, 0

    @property
    def verdicts(self) -> Counter[str]:
        """Verdicts on all images, and on what is measured of the leader beside them."""
        contradictions = self._tracks[NAME].life.contradictions
        wrong = Counter({CONTRADICTED: contradictions} if contradictions else {})
        wrong.update(track.prior_verdict for track in self._tracks.values() if track.prior_verdict)
        return sum((source.verdicts for source in self._sources), self._verdicts + wrong)

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """The messages it receives as it is configured."""
        return (*LISTENS, *(kind for source in self._sources for kind in source.listens))

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse the detections of one image at the time it was taken; or take what is measured beside them."""
        if not isinstance(message, Exposure):
            self._heed(message, ownship)
            return []
        return [each for seen in message.detections for each in self._observe(seen, ownship)]

    def _observe(self, message: TargetImage, ownship: Ownship) -> list[Estimate]:
        track, prepared = self._track_of(message, ownship)
        if track is None:
            return self._refuse(message, ownship)
        said: list[Estimate] = []
        if (before := self._renamed(message, track, ownship)) is not None:
            track, said = before, [self._rename(before, message.target, ownship)]
        if message.target != NO_ID and track.is_followed:
            self._exposures.add(message)
        known = self._classes.get(message.class_name)
        if track.take_for(message.class_name, message.t_ns, *(known or (None, self._config))):
            self._verdicts[CLASS] += 1
            said.append(track.tick(ownship))
        if track.target == NAME and self._frames is not None:
            self._compare(self._frames, message, ownship)
        if prepared is not None and not track.prepares_as(self._class_of(message)[0], prepared):
            prepared = None
        estimate = track.observe(message, ownship, prepared)
        if estimate.measurement is not None:
            self._verdicts[estimate.measurement.verdict] += 1
            self._verdicts.update(f"{MISFIT}{name}" for name in estimate.measurement.misfits)
        for source in self._sources if track.target == NAME else ():
            source.receive(message, ownship)
        return [*said, estimate]

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Predict the tracks to the newest navigation sample whose next estimate is due. Drop idle targets, except
        the first."""
        if self._wind.is_known and ownship.now_ns - self._wind_ns > TIMEOUT_NS:
            self._set_wind(UNKNOWN, ownship)
        self._pass_name_on(ownship.now_ns)
        estimates = []
        for target, track in list(self._tracks.items()):
            if target == NAME or track.is_followed:
                if track.rate_limit.is_due(ownship.now_ns):
                    estimates.append(track.tick(ownship))
            elif track.is_idle(ownship.now_ns):
                del self._tracks[target]
                if track.state is not Lifecycle.SEARCHING:  # say the last word on it
                    track.reset(Reason(Cause.FORGOTTEN, "no image within a second"))
                    estimates.append(track.tick(ownship))
        return estimates

    def reset(self, why: Reason) -> None:
        """Forget all tracks and all times."""
        for track in self._tracks.values():
            track.reset(why)
        if self._frames is not None:
            self._frames.clear(why)
        for source in self._sources:
            source.clear()
        self._next_refusal_ns = self._next_begin_ns = 0
        self._heir_since_ns = None
        self._wind = UNKNOWN

    def _pass_name_on(self, now_ns: int) -> None:
        """Without ids, what was seen first is the leader, and may be a tree. Once it is gone, or has not been
        valid for `reset_timeout_s` while another target is tracked, the first of these is the leader. Where images
        or a broadcast say who the leader is, no other takes its name."""
        leader = self._tracks[NAME]
        is_known = self._is_named or self._sources or leader.state.is_valid
        heirs = [] if is_known else [t for t in self._tracks.values() if may_lead(t)]
        if not heirs:
            self._heir_since_ns = None
            return
        if self._heir_since_ns is None:
            self._heir_since_ns = now_ns
        waited_s = (now_ns - self._heir_since_ns) / NS_PER_S
        if leader.is_idle(now_ns) or waited_s > self._config.reset_timeout_s:
            name = heirs[0].target
            swap_names(leader, heirs[0])
            self._tracks[NAME], self._tracks[name] = self._tracks[name], leader
            self._verdicts[PASSED_ON] += 1
            self._heir_since_ns = None

    def _compare(self, frames: GimbalFrames, message: TargetImage, ownship: Ownship) -> None:
        """Whether the images of the leader contradict what a gimbal states of its angles."""
        frames.observe(message, ownship)
        found, before = frames.contradiction, self._poses.contradiction
        self._verdicts.update([GIMBAL] if found and not before else [])
        self._poses.contradiction = found

    def _feel(self, wind: Wind | None, ownship: Ownship) -> None:
        """The wind that our autopilot reports, not more often than it changes."""
        if wind is None:
            self._verdicts["wind_implausible"] += 1
        elif not self._wind.is_known or ownship.now_ns - self._wind_ns > WIND_PERIOD_NS:
            self._set_wind(wind, ownship)

    def _set_wind(self, wind: Wind, ownship: Ownship) -> None:
        self._wind, self._wind_ns = wind, ownship.now_ns
        for track in self._tracks.values():
            track.feel(wind, ownship)

    def _heed(self, message: Message, ownship: Ownship) -> None:
        """Take what is no image."""
        if isinstance(message, messages.Wind):
            self._feel(wind_of(message), ownship)
        elif isinstance(message, messages.WarmState):
            self._tracks[NAME].prior = prior_of(message)
            if self._sources:  # images alone teach no size
                self._tracks[NAME].size = size_of(message)
        else:
            for source in self._sources:
                source.receive(message, ownship)

    def _assist(self, taken: Auxiliary, ownship: Ownship) -> Verdict:
        """What is measured of the leader beside its images."""
        return self._tracks[NAME].assist(taken, ownship)

    def _track(self, target: str, *, full: bool = False) -> Track:
        settings = self._filter, self._poses, self._config
        return Track(NAME, target, *settings, full=full, may_begin=self._may_begin)

    def _may_begin(self, target: str, now_ns: int) -> bool:
        """Whether a target's track may begin now: beside a leader's that is followed, one at a time."""
        if target == NAME or not self._tracks[NAME].is_followed:
            return True
        if now_ns < self._next_begin_ns:
            return False
        self._next_begin_ns = now_ns + BEGIN_NS
        return True

    def _class_of(self, message: TargetImage) -> tuple[BeliefFilter, Config]:
        """The filter and the settings for what the detector takes the target for."""
        return self._classes.get(message.class_name, (self._filter, self._config))

    def _prepared(self, message: TargetImage, ownship: Ownship, half_wing: float, noise: float) -> Image | Verdict:
        filter_, config = self._class_of(message)
        return prepare(message, ownship, self._poses, filter_.shape, config, half_wing, noise)

    def _refuse(self, message: TargetImage, ownship: Ownship) -> list[Estimate]:
        """An image that is of one target too many."""
        self._verdicts[Verdict.FULL] += 1
        if ownship.now_ns < self._next_refusal_ns:
            return []
        self._next_refusal_ns = ownship.now_ns + REFUSAL_PERIOD_NS
        target = message.target or f"{UNNAMED}{self._numbered}"
        return [self._track(target, full=True).observe(message, ownship)]

    def _named(self, target: str, ownship: Ownship) -> Track | None:
        """The track of that id, a new one if there is none; None if there are too many."""
        if target in self._tracks:
            return self._tracks[target]
        followed = len(self._tracks) - self._tracks[NAME].is_idle(ownship.now_ns)
        if followed >= self._config.max_targets:
            return None
        self._tracks[target] = self._track(target)
        self._tracks[target].feel(self._wind, ownship)
        return self._tracks[target]

    def _renamed(self, message: TargetImage, track: Track, ownship: Ownship) -> Track | None:
        """The track that goes on under the id of an image, whose own track is not followed yet."""
        if message.target in (NO_ID, NAME) or not awaits_name(track, message.t_ns):
            return None
        image = self._prepared(message, ownship, track.half_wing, track.noise.scale)
        if isinstance(image, Verdict):
            return None
        near = {
            offset: self._tracks[target]
            for target, offset in self._offsets(image).items()
            if target != NAME and not target.startswith(UNNAMED) and offset < BESIDE
        }
        return continued(track, image, near, ownship)

    def _rename(self, track: Track, target: str, ownship: Ownship) -> Estimate:
        """Let a track go on under another id; the last estimate of its old one."""
        before = self._track(track.target)
        before.sequence, before.life.resets = track.sequence, track.life.resets + 1
        before.life.why = Reason(Cause.RENAMED, f"the detector calls it {target} now")
        del self._tracks[track.target]
        self._tracks[target], track.target = track, target
        self._verdicts[RENAMED] += 1
        return before.tick(ownship)

    def _track_of(self, message: TargetImage, ownship: Ownship) -> tuple[Track | None, Image | None]:
        """The track that is to take an image, None with too many tracks; and the image, where comparing it has
        prepared it. One without an id is for the track whose prediction it fits best."""
        if message.target != NO_ID:
            self._is_named |= message.target == NAME
            return self._named(message.target, ownship), None
        half_wing = max(track.half_wing for track in self._tracks.values())
        noise = max(track.noise.scale for track in self._tracks.values())
        image = self._prepared(message, ownship, half_wing, noise)
        if isinstance(image, Verdict):
            return self._tracks[NAME], None  # which reports the verdict
        distances = {track.target: track.expects(image, ownship) for track in self._candidates(image)}
        self._exposures.add(message)
        return self._nearest(image, distances, ownship), image

    def _nearest(self, image: Image, distances: dict[str, Distance], ownship: Ownship) -> Track | None:
        """The track whose prediction an image fits best, or a new one; None with too many tracks."""
        nearest = min(distances, key=lambda target: distances[target])
        if not distances[nearest].beyond or not image.has_extent:
            return self._tracks[nearest]
        if self._tracks[NAME].is_idle(ownship.now_ns):
            return self._tracks[NAME]
        visible = self._offsets(image)
        aircraft = self._exposures.aircraft(image.message)
        if visible and len(visible) >= aircraft and min(visible.values()) < APART:
            return self._tracks[min(visible, key=lambda target: visible[target])]  # an outlier of this track
        self._numbered += 1
        return self._named(f"{UNNAMED}{self._numbered}", ownship)

    def _candidates(self, image: Image) -> list[Track]:
        """The tracks that an image may belong to: all without a recent image, whose target may be anywhere, and
        of the others those hardly farther from the image's direction than the nearest one. With n targets in an
        image, to compare each image with each track would cost n^2 updates."""
        offsets = self._offsets(image)
        limit = FARTHER * min(offsets.values(), default=0.0) + BESIDE
        return [t for t in self._tracks.values() if offsets.get(t.target, 0.0) <= limit]

    def _offsets(self, image: Image) -> dict[str, float]:
        """How far, rad, an image's direction is from each track that had an image shortly before it, by target:
        images that waited for our own motion are older than the newest estimate."""
        direction, t_ns = image.direction_n.tolist(), image.message.t_ns
        recent = (t for t in self._tracks.values() if not t.life.is_coasting(t_ns))
        return {t.target: math.dist(t.direction_n, direction) for t in recent if t.direction_n is not None}


def may_lead(track: Track) -> bool:
    """Whether a target without an id is tracked, so that it may be the leader."""
    return track.target.startswith(UNNAMED) and track.state is Lifecycle.TRACKING


def swap_names(one: Track, other: Track) -> None:
    """Let two targets change their names. Each name's counts go on: its state has changed, as after a reset."""
    one.target, other.target = other.target, one.target
    one.sequence, other.sequence = other.sequence, one.sequence
    one.life.resets, other.life.resets = other.life.resets + 1, one.life.resets + 1


def awaits_name(track: Track, t_ns: int) -> bool:
    """Whether an image of that time is the second one at least of a target that is not followed yet."""
    return not track.is_followed and bool(track.held) and track.held[0].message.t_ns < t_ns


def continued(by: Track, image: Image, near: Mapping[float, Track], ownship: Ownship) -> Track | None:
    """The track that goes on under the id of `by`, of those `near` the image, by their distance: its own id has
    not come since the first image of `by`, and the image fits its prediction."""
    since_ns = by.held[0].message.t_ns
    gone = {
        offset: t for offset, t in near.items() if t is not by and (t.repeats.newest_ns or since_ns) < since_ns
    }
    nearest = gone[min(gone)] if gone else None
    return nearest if nearest is not None and not nearest.expects(image, ownship).beyond else None


class Disc(NamedTuple):
    """Where an image is, and how far it reaches, in focal lengths."""

    middle: ImagePoint
    radius: float

    def covers(self, other: "Disc") -> bool:
        """Whether two images lie half upon each other."""
        return self.middle == other.middle or math.dist(self.middle, other.middle) < max(self.radius, other.radius)


def disc_of(message: TargetImage) -> Disc:
    """Of an image; without a radius where it shows one point alone."""
    first, *others = message.image_points
    radius = max([math.dist(first, point) for point in others], default=0.0)
    if isinstance(message, TargetDetection):
        radius = max(radius, message.half_width or 0.0)
    return Disc(first, radius)


class Exposures:
    """The images of the last exposures, by camera and time; of one exposure at most one more than `targets`."""

    def __init__(self, targets: int) -> None:
        self._most = targets + 1
        self._images: dict[tuple[str, int], list[Disc]] = {}

    def add(self, message: TargetImage) -> None:
        """Remember an image."""
        disc, images = disc_of(message), self._images.setdefault((message.camera, message.t_ns), [])
        if len(images) < self._most and not any(map(disc.covers, images)):
            images.append(disc)
        while len(self._images) > REMEMBERED:
            del self._images[next(iter(self._images))]

    def aircraft(self, message: TargetImage) -> int:
        """The largest number of different images that the camera of `message` took at one time within a second of
        it."""
        sizes = (
            len(images)
            for (camera, t_ns), images in self._images.items()
            if camera == message.camera and abs(message.t_ns - t_ns) <= NS_PER_S
        )
        return max(sizes, default=0)
