"""The leader's motion relative to us, from three points of it in our camera: Oh & Johnson's UKF, flown.

The filter is the paper's (9 states, eqs 1-54, misprints mended). Around it stands what flying needs: each
image is fused at the time it was taken, however late it comes; a gate; a life cycle that says when not to
believe it; and two sets of noise settings, the paper's own and honest ones.
"""

from collections import deque
from typing import Annotated, Final, Literal, NamedTuple

import msgspec
import numpy as np

from onboard.estimators._history import History
from onboard.estimators._leader_noise import initial_belief, noise_for, overridden, process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief, NotPositiveDefiniteError, Update
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import Array
from onboard.messages import (
    Estimate,
    Lifecycle,
    MeasurementReport,
    Message,
    NotNegative,
    Positive,
    Record,
    TargetPoints,
    Verdict,
)
from onboard.models import camera_angles, relative_motion
from onboard.ownship import Ownship, Pose

NAME: Final = "leader"
LISTENS: Final = (TargetPoints,)
WEIGHTS: Final = unscented.julier_weights(relative_motion.N)
NS: Final = 1_000_000_000
AGREE_RAD: Final = np.radians(5.0)  # images that start a track point the same way this nearly ...
AGREE_RATIO: Final = 1.3  # ... and show the same span within this factor
SMALLEST_SPAN_SIGMA: Final = 2.0  # a span below this many of its sigmas says nothing of the range
WIDEST: Final = 100.0  # focal lengths from the axis (89.4 degrees): no lens shows a point beyond
SIGMAS: Final = (1e-7, 10.0)  # focal lengths: finer or coarser than this no point is found


class Config(Record, frozen=True, kw_only=True):
    """`[estimator.leader]`. The keys carry their units."""

    size_prior_m: Positive = 2.0  # the leader's wingspan, as far as it is known
    size_prior_sigma_m: Positive | None = None  # None: 2 % of it
    noise: Literal["honest", "paper"] = "honest"
    leader_class: Literal["fixed_wing", "multirotor"] = "multirotor"  # which changes its speed how freely
    process_noise: dict[str, float] = msgspec.field(
        default_factory=dict
    )  # overrides single settings of the chosen noise, by name
    initialise_images: Annotated[int, msgspec.Meta(ge=1, le=100)] = (
        3  # that must agree before a track starts (with the paper's noise: 1)
    )
    own_tilt_sigma_deg: NotNegative = 0.3  # how far our own roll and pitch may be steadily off, mount included
    own_yaw_sigma_deg: NotNegative = 1.0  # the same of our yaw (honest noise only)
    rewind_horizon_s: NotNegative = 0.5  # images older than this are rejected
    coast_after_s: NotNegative = 0.25  # without an image: coasting
    validity_timeout_s: NotNegative = 2.0  # without an image: lost, not valid
    reset_timeout_s: NotNegative = 10.0  # without an image: forgotten
    relock_after_s: NotNegative = 1.0  # with nothing but gated images: forgotten, and begun anew


class Seen(NamedTuple):
    """An image made ready: the angles (3,) it measures, their noise R (3, 3), and the camera's pose then.
    `final` once that pose is interpolated: an extrapolated one is asked for again."""

    message: TargetPoints
    angles: Array
    R: Array
    R_cn: Array
    r_FC_n: Array
    final: bool


class Outcome(NamedTuple):
    """What the filter made of an image."""

    fused: bool
    update: Update


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`. All state of one track is in the fields below."""

    def __init__(self, config: Config, camera: Camera) -> None:
        if not config.coast_after_s <= config.validity_timeout_s <= config.reset_timeout_s:
            raise ValueError("coast_after_s <= validity_timeout_s <= reset_timeout_s must hold")
        self._config = config
        self._camera = camera
        self._noise = overridden(noise_for(config.noise, config.leader_class), config.process_noise)
        self._size_sigma = config.size_prior_sigma_m or 0.02 * config.size_prior_m
        tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg])
        # the paper takes its own attitude as known, so its settings stay as printed
        self._attitude_sigma = np.array([tilt, tilt, yaw]) * (config.noise == "honest")
        self._Q = process_noise(self._noise, config.size_prior_m)
        probability = self._noise.gate_probability
        self._gate = None if probability is None else chi_square_threshold(probability, camera_angles.M)
        self._history: History[Belief, Ownship] | None = None
        self._candidates: deque[Seen] = deque(maxlen=self._noise.initialise_images or config.initialise_images)
        self._last_fused_ns: int | None = None
        self._last_stamps: deque[int] = deque(maxlen=64)
        self._gated_since_ns: int | None = None
        self._to_agree = 0  # images still to be fused before a lost track is believed again
        self._resets = 0
        self._sequence = 0
        self._why = "no image yet"

    # ----------------------------------------------------------------------- what the pipeline calls

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse one image's points at the time they were taken."""
        if not isinstance(message, TargetPoints) or message.target != NAME:
            return []
        try:
            report = self._take(message, ownship)
        except NotPositiveDefiniteError:
            self._forget("the covariance was lost")
            report = self._report(message, Verdict.NUMERICAL)
        return [self._estimate(ownship, report)]

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Predict to the newest navigation sample, and see what has timed out."""
        if self._history is not None:
            try:
                self._settle(self._history, ownship)
            except NotPositiveDefiniteError:
                self._forget("the covariance was lost")
        if self._history is not None and self._age(ownship.now_ns) > self._config.reset_timeout_s:
            self._forget("no image for longer than the reset timeout")
        return [self._estimate(ownship, None)]

    def reset(self, reason: str) -> None:
        """Forget the track and all times."""
        self._forget(reason)
        self._candidates.clear()
        self._last_stamps.clear()

    # ------------------------------------------------------------------------------ one image's way

    def _take(self, message: TargetPoints, ownship: Ownship) -> MeasurementReport:
        """Check an image, then start a track with it or fuse it."""
        points = np.array([message.center, message.left, message.right])
        if not np.isfinite(points).all():
            return self._report(message, Verdict.NOT_FINITE)
        if message.t_ns in self._last_stamps:
            return self._report(message, Verdict.DUPLICATE)
        seen = self._see(message, points, ownship)
        if isinstance(seen, Verdict):
            return self._report(message, seen)
        self._last_stamps.append(message.t_ns)
        if self._history is None:
            self._start(seen, ownship)
            return self._report(message, Verdict.INITIALISING, seen)
        if not self._history.reaches(message.t_ns):
            return self._report(message, Verdict.TOO_OLD, seen)
        late = self._last_fused_ns is not None and message.t_ns < self._last_fused_ns
        was_lost = self._age(message.t_ns) > self._config.validity_timeout_s
        outcome: Outcome = self._history.insert(message.t_ns, seen, ownship)
        self._settle(self._history, ownship)
        if not outcome.fused:
            self._gated(seen, ownship)
            return self._report(message, Verdict.GATED, seen, outcome)
        if was_lost:  # its gate is wide by then: one image proves nothing
            self._to_agree = self._candidates.maxlen or 1
        self._to_agree = max(self._to_agree - 1, 0)
        self._gated_since_ns = None
        self._last_fused_ns = max(self._last_fused_ns or 0, message.t_ns)
        return self._report(message, Verdict.FUSED_LATE if late else Verdict.FUSED, seen, outcome)

    def _see(self, message: TargetPoints, points: Array, ownship: Ownship) -> Seen | Verdict:
        pose = ownship.pose_at(message.t_ns)
        if pose is None:
            newer = message.t_ns > ownship.now_ns and ownship.now_ns > 0
            return Verdict.TOO_NEW if newer else Verdict.NO_POSE
        sigmas = np.full(3, self._camera.sigma) if message.sigma is None else np.array(message.sigma)
        if not np.isfinite(sigmas).all():
            return Verdict.NOT_FINITE
        if np.abs(points).max() > WIDEST or sigmas.min() < SIGMAS[0] or sigmas.max() > SIGMAS[1]:
            return Verdict.DEGENERATE
        angles = camera_angles.angles_from_points(points)
        R = camera_angles.noise_from_points(points, sigmas)
        if angles[2] < SMALLEST_SPAN_SIGMA * np.sqrt(R[2, 2]):
            return Verdict.DEGENERATE
        if self._noise.angles_deg is not None:
            R = np.diag(np.radians(self._noise.angles_deg) ** 2)
        return Seen(message, angles, R, *self._camera_pose(pose), ownship.knows(message.t_ns))

    def _camera_pose(self, pose: Pose) -> tuple[Array, Array]:
        """R_cn (3, 3) and r_FC_n (3,) of our own pose."""
        return self._camera.R_bc.T @ pose.R_nb.T, pose.R_nb @ self._camera.r_FC_b

    def _start(self, seen: Seen, ownship: Ownship) -> None:
        """Hold images until enough of them agree; start at the oldest and fuse the rest."""
        held = self._candidates
        while held and seen.message.t_ns - held[0].message.t_ns > NS:
            held.popleft()
        if held and not _agree(held[-1], seen):
            held.clear()
        held.append(seen)
        self._why = f"{len(held)} of {held.maxlen} images"
        if len(held) < (held.maxlen or 1):
            return
        images = sorted(held, key=lambda s: s.message.t_ns)
        first = images[0]
        size = self._config.size_prior_m
        belief = initial_belief(
            self._noise, first.angles, first.R, size, self._size_sigma, first.R_cn, first.r_FC_n
        )
        self._history = History(
            first.message.t_ns,
            belief,
            horizon_ns=round(self._config.rewind_horizon_s * NS),
            advance=self._advance,
            fuse=self._fuse,
        )
        for image in images[1:]:
            self._history.insert(image.message.t_ns, image, ownship)
        self._last_fused_ns = first.message.t_ns
        self._settle(self._history, ownship)
        held.clear()

    def _settle(self, history: History[Belief, Ownship], ownship: Ownship) -> None:
        """Come up to what is known; an image may have been gated at first, and be fused now that it is judged
        again with what came since."""
        history.settle(ownship)
        fused_ns = history.newest(lambda outcome: outcome.fused)
        if fused_ns is not None and fused_ns > (self._last_fused_ns or 0):
            self._last_fused_ns = fused_ns
            self._gated_since_ns = None

    def _gated(self, seen: Seen, ownship: Ownship) -> None:
        """A track that agrees with nothing any more is given up, and begun anew from what it sees."""
        since = self._gated_since_ns
        if self._to_agree:
            self._to_agree = self._candidates.maxlen or 1
        if since is None:
            self._gated_since_ns = seen.message.t_ns
        elif seen.message.t_ns - since > self._config.relock_after_s * NS:
            self._forget("every image was gated")
            self._start(seen, ownship)

    def _forget(self, reason: str) -> None:
        if self._history is not None:
            self._resets += 1
        self._history = None
        self._last_fused_ns = None
        self._gated_since_ns = None
        self._to_agree = 0
        self._why = reason

    # ------------------------------------------------------------------------- the filter's two steps

    def _advance(self, belief: Belief, t0_ns: int, t1_ns: int, ownship: Ownship) -> Belief:
        eps = self._noise.hover_speed
        for step in ownship.steps(t0_ns, t1_ns):
            motion = relative_motion.FollowerMotion(step.v0, step.v1, step.a, step.a)
            belief = unscented.predict(
                belief,
                lambda rows, dt=step.dt, motion=motion: relative_motion.process(rows, dt, motion, eps),  # type: ignore[misc]
                np.diag(self._Q * step.dt),
                WEIGHTS,
            )
        return belief

    def _fuse(self, belief: Belief, seen: Seen, ownship: Ownship) -> tuple[Belief, Outcome]:
        if not seen.final:
            pose = ownship.pose_at(seen.message.t_ns)
            if pose is not None:
                R_cn, r_FC_n = self._camera_pose(pose)
                seen = seen._replace(R_cn=R_cn, r_FC_n=r_FC_n)
        update = unscented.update(
            belief,
            seen.angles,
            lambda rows: camera_angles.measure(rows, seen.R_cn, seen.r_FC_n),
            seen.R,
            WEIGHTS,
            camera_angles.ANGULAR,
            (relative_motion.SIZE,) if self._noise.consider_size else (),
        )
        fused = self._gate is None or update.nis <= self._gate
        return (update.belief if fused else belief), Outcome(fused, update)

    # --------------------------------------------------------------------------------- what is told

    def _age(self, t_ns: int) -> float:
        return float("inf") if self._last_fused_ns is None else (t_ns - self._last_fused_ns) / NS

    def _state(self, age: float) -> tuple[Lifecycle, str]:
        c = self._config
        if self._history is None:
            return (Lifecycle.INITIALISING if self._candidates else Lifecycle.SEARCHING), self._why
        if self._to_agree:
            return Lifecycle.LOST, f"seen again: {self._to_agree} more images must agree"
        if age <= c.coast_after_s:
            return Lifecycle.TRACKING, "images fused"
        if age <= c.validity_timeout_s:
            return Lifecycle.COASTING, "no image fused lately: predicted"
        return Lifecycle.LOST, "no image fused within the validity timeout"

    def _estimate(self, ownship: Ownship, report: MeasurementReport | None) -> Estimate:
        t_ns, mean, covariance = ownship.now_ns, None, None
        if self._history is not None:
            try:
                t_ns, belief = self._history.belief_at(t_ns, ownship)
                unscented.factor(belief.covariance)  # none goes out that has none
            except NotPositiveDefiniteError:
                self._forget("the covariance was lost")
            else:
                mean = tuple(belief.mean.tolist())
                # Our own attitude's error is no noise: it is nearly constant, so the images cannot average it out
                # and their innovations do not show it. It is added to what we say, not to what the filter knows.
                own = relative_motion.rotation_covariance(belief.mean, self._attitude_sigma)
                covariance = tuple(tuple(row) for row in (belief.covariance + own).tolist())
        age = self._age(t_ns)
        state, reason = self._state(age)
        self._sequence += 1
        return Estimate(
            name=NAME,
            target=NAME,
            sequence=self._sequence,
            t_ns=t_ns,
            state=state,
            valid=state in (Lifecycle.TRACKING, Lifecycle.COASTING),
            reason=reason,
            frame=relative_motion.FRAME,
            components=relative_motion.COMPONENTS,
            units=relative_motion.UNITS,
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
        seen: Seen | None = None,
        outcome: Outcome | None = None,
    ) -> MeasurementReport:
        update = outcome.update if outcome else None
        return MeasurementReport(
            source=message.camera,
            t_ns=message.t_ns,
            t_recv_ns=message.t_recv_ns,
            verdict=verdict,
            components=camera_angles.COMPONENTS,
            units=camera_angles.UNITS,
            measured=tuple(seen.angles.tolist()) if seen else None,
            predicted=tuple(update.predicted.tolist()) if update else None,
            innovation=tuple(update.innovation.tolist()) if update else None,
            innovation_sigma=tuple(np.sqrt(np.diag(update.innovation_covariance)).tolist()) if update else None,
            nis=update.nis if update else None,
            gate=self._gate,
            points=(message.center, message.left, message.right),
            predicted_points=_expected_points(message, update.predicted) if update else None,
        )


def _agree(a: Seen, b: Seen) -> bool:
    """Whether two images could be of one aircraft a moment apart: same direction in n, same span."""
    directions = []
    for seen in (a, b):
        tangents = np.array([1.0, np.tan(seen.angles[0]), np.tan(seen.angles[1])])
        directions.append(tangents / np.linalg.norm(tangents) @ seen.R_cn)
    ratio = a.angles[2] / b.angles[2]
    near = float(directions[0] @ directions[1]) > np.cos(AGREE_RAD)
    return bool(near and 1 / AGREE_RATIO < ratio < AGREE_RATIO)


def _expected_points(message: TargetPoints, predicted: Array) -> tuple[tuple[float, float], ...]:
    """Where the three points were expected: the center from the predicted angles, the wingtips at the predicted
    span along the wing line as seen (the filter does not predict the leader's bank)."""
    center = np.tan(predicted[:2])
    wing = np.array(message.right) - np.array(message.left)
    length = np.hypot(*wing)
    half = np.tan(0.5 * predicted[2]) * np.sqrt(1.0 + center @ center) * (wing / length if length else 0.0)
    return tuple((float(p[0]), float(p[1])) for p in (center, center - half, center + half))
