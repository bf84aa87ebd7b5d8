"""The motion of other aircraft relative to us, from three points of each in our camera.

Every target has a track of its own (`track`), with a filter (`hypotheses.belief`). All that one image shows comes
as one exposure: the tracks are predicted to it and compared with its detections, these are associated with them
(`association`), and each track fuses its own.

A detection with an id is of the track of that id. One without an id is of the track that explains it best, with
all others. If it fits none, it is either an outlier or of another aircraft: an outlier, if a track near it has no
other detection in the exposure. Otherwise outliers would begin a second track of the same aircraft, which then
takes half of its images. So would a detector that draws two boxes about one aircraft: detections that lie half
upon each other count as one.

Ids are unlimited, so a flood of them must not cost the leader anything. A target without a track is published only
when an image of it comes, and forgotten after a second without one. Their tracks begin one by one, not twenty at
the same moment. Images of one target too many are all counted, and few are reported.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import Final

import numpy as np

from onboard import messages
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.association import associate
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.belief import BeliefFilter, make_filter
from onboard.estimators.leader.image.camera_pose import CameraPoses, PosedExposure
from onboard.estimators.leader.image.prepare import Image, agree, prepare
from onboard.estimators.leader.reports.broadcast import Broadcast
from onboard.estimators.leader.reports.prior import prior_of, size_of
from onboard.estimators.leader.reports.ranging import Ranging
from onboard.estimators.leader.tracks.fusing import ImageRecord
from onboard.estimators.leader.tracks.track import FULL, FUSED, NO_IMAGE, Track
from onboard.geometry.camera import Camera
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
LISTENS: Final = (Exposure, messages.WarmState)
CONTRADICTED: Final = "broadcast_contradicted"  # how often the leader was not where its broadcast had led
NO_ID: Final = ""
CLASS: Final = "class_changed"  # how often the detector has taken a target for something else from some image on
PASSED_ON: Final = "leader_passed_on"  # how often another target has become the leader
MISFIT: Final = "misfit_"  # before the names of points that fit no heading, in the health
UNNAMED: Final = "unnamed/"  # before the numbers of targets without an id


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`.

    A track for each target, by its id; `verdicts` on all images."""

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
        self._tracks = {NAME: self._track(NAME)}
        self._numbered = 0
        self._is_named = False  # images say which target is the leader
        self._next_refusal_ns = self._next_begin_ns = 0
        self._seen_ns: dict[str, int] = {}  # the newest image of each camera that shows the leader

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
        """Fuse the detections of one image at its time, or take a report or a range."""
        if not isinstance(message, Exposure):
            self._receive(message, ownship)
            return []
        view, answers = self._poses.view(message, ownship), dict[int, list[Estimate]]()
        found: dict[int, Track] = {}  # the tracks of the exposure's detections
        for i, seen in enumerate(message.detections):
            if seen.target == NO_ID:
                continue
            self._is_named |= seen.target == NAME
            track = self._track_of(seen.target, ownship)
            if track is None:
                answers[i] = self._refuse(seen, ownship)
                continue
            found[i] = track
            answers[i] = self._fuse(track.claim(seen, view, ownship), view, track, ownship)
        if len(answers) < len(message.detections):
            answers |= self._associate_unnamed(view, found, ownship)
        return [estimate for i in sorted(answers) for estimate in answers[i]]

    def _fuse(self, claim: ImageRecord, view: PosedExposure, track: Track, ownship: Ownship) -> list[Estimate]:
        """Let a track take a detection, as it was compared with the track, or may have been with another one."""
        estimates, seen = list[Estimate](), claim.message
        if self._classes:
            filter_ = track.filter
            known = self._classes.get(seen.class_name, (None, self._config))
            if track.take_for(seen.class_name, seen.t_ns, *known):
                self._verdicts[CLASS] += 1
                estimates.append(track.tick(ownship))
            if track.filter is not filter_:
                claim = track.claim(seen, view, ownship)
        estimates.append(estimate := self._counted(track.take(claim, ownship)))
        report, is_shown = estimate.measurement, estimate.valid or estimate.cause is Cause.NOISE
        if track.target == NAME and is_shown and report is not None and report.verdict in FUSED:
            self._seen_ns[seen.camera] = seen.t_ns
        for source in self._sources if track.target == NAME else ():
            source.receive(seen, ownship)
        return estimates

    def _counted(self, estimate: Estimate) -> Estimate:
        """An estimate that follows an image, whose verdict is counted."""
        if estimate.measurement is not None:
            self._verdicts[estimate.measurement.verdict] += 1
            self._verdicts.update(f"{MISFIT}{name}" for name in estimate.measurement.misfits)
        return estimate

    def _associate_unnamed(
        self, view: PosedExposure, found: dict[int, Track], ownship: Ownship
    ) -> dict[int, list[Estimate]]:
        """Associate the detections without an id with the tracks that were `found` for no other one."""
        detections, answers = view.exposure.detections, dict[int, list[Estimate]]()
        images: dict[int, Image] = {}
        for i, seen in enumerate(detections):
            image = self._prepared(seen, view, ownship) if seen.target == NO_ID else None
            if isinstance(image, Image):
                images[i] = image
            elif image is not None:
                answers[i] = self._fuse(ImageRecord(seen, image), view, self._tracks[NAME], ownship)
        if not images:
            return answers
        tracks = [track for track in self._tracks.values() if track not in found.values()]
        pairs = self._candidates(images, tracks, ownship)
        fitting = {pair: candidate for pair, candidate in pairs.items() if candidate.fits}
        is_choice = len(fitting) > 1  # else its cost is of no interest
        decided, undecided = associate({pair: c.cost if is_choice else 0.0 for pair, c in fitting.items()})
        found |= {i: tracks[k] for i, k in decided.items()}
        for i, k in undecided.items():
            unused = ImageRecord(detections[i], Verdict.UNASSOCIATED)
            answers[i] = [self._counted(tracks[k].take(unused, ownship))]
        for i, k in decided.items():
            answers[i] = self._fuse(pairs[k, i], view, tracks[k], ownship)
        free = [track for k, track in enumerate(tracks) if k not in undecided.values()]
        extents = [*map(extent, detections)]
        for i, image in images.items():
            if i in answers:
                continue
            seen = detections[i]
            twin = next((track for j, track in found.items() if overlap(extents[i], extents[j])), None)
            if twin is not None:
                answers[i] = [self._counted(twin.take(ImageRecord(seen, Verdict.DUPLICATE), ownship))]
            elif (
                track := self._choose_track(image, [t for t in free if t not in found.values()], ownship)
            ) is None:
                answers[i] = self._refuse(seen, ownship)
            else:
                answers[i], found[i] = self._fuse(track.claim(seen, view, ownship), view, track, ownship), track
        return answers

    def withholds(self, exposure: Exposure, doubts: Mapping[str, Reason]) -> Reason | None:
        """Why an image is not to be used.

        Its camera is among those in doubt, and one that is not shows the leader: fused, it would spoil what that
        one shows."""
        if (doubt := doubts.get(exposure.camera)) is None:
            return None
        sound = (t_ns for camera, t_ns in self._seen_ns.items() if camera not in doubts)
        return doubt if any(abs(exposure.t_ns - t_ns) < given.SERVED_TIME_NS for t_ns in sound) else None

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Predict the tracks to the newest navigation sample whose next estimate is due.

        Drop idle targets, except the first."""
        self._promote_next_leader(ownship.now_ns)
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
        for source in self._sources:
            source.clear()
        self._next_refusal_ns = self._next_begin_ns = 0

    def _promote_next_leader(self, now_ns: int) -> None:
        """Without ids, what was seen first is the leader, and may be a tree.

        Once it is gone, the first other target that is tracked is the leader. Where images or a broadcast say who
        the leader is, no other takes its name."""
        leader = self._tracks[NAME]
        if self._is_named or self._sources or not leader.is_idle(now_ns):
            return
        heir = next((track for track in self._tracks.values() if may_lead(track)), None)
        if heir is None:
            return
        self._tracks[NAME], self._tracks[heir.target] = heir, leader
        swap_names(leader, heir)
        self._verdicts[PASSED_ON] += 1

    def _receive(self, message: Message, ownship: Ownship) -> None:
        """Take what is no image."""
        if isinstance(message, messages.WarmState):
            self._tracks[NAME].prior = prior_of(message)
            if self._sources:  # images alone teach no size
                self._tracks[NAME].size = size_of(message)
        else:
            for source in self._sources:
                source.receive(message, ownship)

    def _assist(self, taken: Auxiliary, ownship: Ownship) -> Verdict:
        """Pass a report or a range to the leader's track."""
        return self._tracks[NAME].assist(taken, ownship)

    def _track(self, target: str, why: Reason = NO_IMAGE) -> Track:
        settings = self._filter, self._poses, self._config
        return Track(NAME, target, *settings, why=why, may_begin=self._may_begin)

    def _may_begin(self, target: str, now_ns: int) -> bool:
        """Whether a target's track may begin now.

        Beside a leader's that is followed, one at a time."""
        if target == NAME or not self._tracks[NAME].is_followed:
            return True
        if now_ns < self._next_begin_ns:
            return False
        self._next_begin_ns = now_ns + given.TRACK_START_PERIOD_NS
        return True

    def _class_of(self, message: TargetImage) -> tuple[BeliefFilter, Config]:
        """The filter and the settings for what the detector takes the target for."""
        return self._classes.get(message.class_name, (self._filter, self._config))

    def _prepared(self, message: TargetImage, view: PosedExposure, ownship: Ownship) -> Image | Verdict:
        """A detection that may be of any track, or why it cannot be used."""
        filter_, config = self._class_of(message)
        half_wing = max(track.half_wing for track in self._tracks.values())
        noise = max(track.noise.scale for track in self._tracks.values())
        return prepare(message, view, ownship, filter_.shape, config, half_wing, noise)

    def _refuse(self, message: TargetImage, ownship: Ownship) -> list[Estimate]:
        """An image that is of one target too many."""
        self._verdicts[Verdict.FULL] += 1
        if ownship.now_ns < self._next_refusal_ns:
            return []
        self._next_refusal_ns = ownship.now_ns + given.REFUSAL_PERIOD_NS
        target = message.target or f"{UNNAMED}{self._numbered}"
        return [self._track(target, FULL).take(ImageRecord(message, Verdict.FULL), ownship)]

    def _track_of(self, target: str, ownship: Ownship) -> Track | None:
        """The track of that id, a new one if there is none; None if there are too many."""
        if target in self._tracks:
            return self._tracks[target]
        followed = len(self._tracks) - self._tracks[NAME].is_idle(ownship.now_ns)
        if followed >= self._config.max_targets:
            return None
        return self._tracks.setdefault(target, self._track(target))

    def _candidates(
        self, images: Mapping[int, Image], tracks: Sequence[Track], ownship: Ownship
    ) -> dict[tuple[int, int], ImageRecord]:
        """Detections beside what tracks expect, by the numbers of both.

        A track is compared with the `MAX_COMPARISON_COUNT` detections nearest to its last direction, since
        comparing each with each would cost n^2 updates of n targets."""
        t_ns = next(iter(images.values())).message.t_ns
        followed = {k: track.direction_n for k, track in enumerate(tracks) if track.direction_n is not None}
        there = np.array([*followed.values()]).reshape(-1, 1, 3)
        offsets = np.linalg.norm(there - np.array([image.direction_n for image in images.values()]), axis=2)
        is_near = offsets.argsort(axis=1).argsort(axis=1) < given.MAX_COMPARISON_COUNT
        predicted = {k: tracks[k].predict(t_ns, ownship) for k in followed}
        found: dict[tuple[int, int], ImageRecord] = {}
        for i, image, row in zip(images, images.values(), is_near.T, strict=True):
            filter_, _ = self._class_of(image.message)
            for k in compress(followed, row.tolist()):
                if isinstance(own := tracks[k].prepared(image, filter_, ownship), Image):
                    found[k, i] = tracks[k].compare(own, predicted[k], ownship)
        return found

    def _choose_track(self, image: Image, free: Sequence[Track], ownship: Ownship) -> Track | None:
        """The track of a detection without an id that fits none, of those that are `free`.

        One that it may start, or of which it is an outlier; or else a new one, None with too many."""
        starting = (t for t in free if not t.is_followed and t.held and agree(t.held[-1], image))
        here = image.direction_n.tolist()
        near = min(((offset(track, here), track) for track in free), key=lambda each: each[0], default=None)
        if image.has_extent and (first := next(starting, None)) is not None:
            return first
        if self._tracks[NAME].is_idle(ownship.now_ns):
            return self._tracks[NAME]
        limit = given.MAX_TARGET_OFFSET if image.has_extent else math.inf
        if near is not None and near[0] < limit:
            return near[1]
        if not image.has_extent:
            return self._tracks[NAME]
        self._numbered += 1
        return self._track_of(f"{UNNAMED}{self._numbered}", ownship)


def offset(track: Track, here: Sequence[float]) -> float:
    """Return the angle, rad, between a direction and a track's last estimate, or the image that will start it;
    infinite without either."""
    there = track.held[-1].direction_n.tolist() if track.held and not track.is_followed else track.direction_n
    return math.inf if there is None else math.dist(there, here)


def may_lead(track: Track) -> bool:
    """Whether a target without an id is tracked, so that it may be the leader."""
    return track.target.startswith(UNNAMED) and track.state is Lifecycle.TRACKING


def swap_names(one: Track, other: Track) -> None:
    """Let two targets change their names.

    Each name's counts go on: its state has changed, as after a reset."""
    one.target, other.target = other.target, one.target
    one.sequence, other.sequence = other.sequence, one.sequence
    one.life.resets, other.life.resets = other.life.resets + 1, one.life.resets + 1


def overlap(one: tuple[ImagePoint, float], other: tuple[ImagePoint, float]) -> bool:
    """Whether two detections, by their extents, lie half upon each other."""
    (here, radius), (there, other_radius) = one, other
    return here == there or math.dist(here, there) < max(radius, other_radius)


def extent(seen: TargetImage) -> tuple[ImagePoint, float]:
    """Return the centre of a detection and its reach, in focal lengths; 0 for a single point."""
    first, *others = seen.image_points
    radius = max([math.dist(first, point) for point in others], default=0.0)
    if isinstance(seen, TargetDetection):
        radius = max(radius, seen.half_width or 0.0)
    return first, radius
