"""Oh & Johnson's unscented filter of one leader: nine states, three angles.

Read it with the paper.

    state         [r_FL_n (3), v_FL_n (3), b, a_lat, a_long]   eqs 1-10    onboard/models/relative_motion.py
    measurement   azimuth, elevation, subtended angle          eqs 11-18   onboard/models/camera_angles.py
    filter        sigma points, predict, update                eqs 19-42   onboard/filters/unscented.py
    noise         first belief, Q and R as printed             eqs 43-54   noise.py, next to this file

The rest is common to all estimators: images are fused at their own time however late they arrive, with a gate, a
life cycle, and a report on each image. The only target is the leader; images of others are ignored.
"""

from collections import deque
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.history import History
from onboard.estimators.kit.life_cycle import life_by_age
from onboard.estimators.kit.reports import belief_fields, image_report
from onboard.estimators.oh_johnson.config import Config
from onboard.estimators.oh_johnson.noise import ANGLES, HOVER_SPEED, first_belief, process_noise
from onboard.filters import unscented
from onboard.filters.belief import Belief, FilterError, Update
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.camera import Camera
from onboard.geometry.lens import MAX_IMAGE_RADIUS
from onboard.messages import Estimate, Exposure, Lifecycle, MeasurementReport, Message, TargetPoints, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import FollowerMotion
from onboard.ownship import Ownship, head_attitude
from onboard.units import NS_PER_S

NAME: Final = "oh_johnson"
LISTENS: Final = (Exposure,)
LEADER: Final = ("leader", "")  # ids of its images
WEIGHTS: Final = unscented.julier_weights(relative_motion.STATE_SIZE)  # eqs 23-25
STAMP_HISTORY_LENGTH: Final = 64  # images whose repetition is noticed


class CameraPlace(NamedTuple):
    """The camera's attitude R_cn (3, 3), n to camera, and its place r_FC_n (3,), m."""

    R_cn: Array
    r_FC_n: Array


class AngleImage(NamedTuple):
    """A usable image: its three angles (3,), rad, and the camera's pose as known on arrival."""

    message: TargetPoints
    angles: Array
    pose: CameraPlace


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`."""

    def __init__(self, config: Config, camera: Camera) -> None:
        self._config, self._camera = config, camera
        self._size = config.size_prior_m
        self._size_sigma = config.size_prior_sigma_m or 0.02 * config.size_prior_m
        self._Q = process_noise(self._size)
        self._gate = chi_square_threshold(config.gate_probability, camera_angles.MEASUREMENT_SIZE)
        self._history: History[Belief, Ownship] | None = None
        self._fused_ns = 0  # time of the newest fused image; means nothing without a history
        self._seen: deque[tuple[str, int]] = deque(maxlen=STAMP_HISTORY_LENGTH)
        self._why = Reason(Cause.NO_MEASUREMENT, "no image yet")
        self._since = Lifecycle.SEARCHING, 0
        self._published_ns: int | None = None
        self._resets = self._sequence = 0

    # ------------------------------------------------------------------------ what the pipeline calls

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse an image of the leader at its own time."""
        seen = message.detections if isinstance(message, Exposure) else ()
        images = [m for m in seen if isinstance(m, TargetPoints) and m.target in LEADER]
        return [self._observe(image, ownship) for image in images]

    def _observe(self, message: TargetPoints, ownship: Ownship) -> Estimate:
        image = self._prepare(message, ownship)
        try:
            report = self._report(message, image) if isinstance(image, Verdict) else self._insert(image, ownship)
        except FilterError as error:
            self._fail(error)
            report = self._report(message, Verdict.NUMERICAL)
        return self._estimate(ownship, report)

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Recompute provisional nodes after new own motion, and predict if an estimate is due."""
        now_ns, last_ns = ownship.now_ns, self._published_ns
        if last_ns is not None and 0 <= now_ns - last_ns < NS_PER_S / self._config.publish_rate_hz:
            return []
        try:
            self._settle(ownship)
        except FilterError as error:
            self._fail(error)
        if self._history is not None and self._age(now_ns) > self._config.reset_timeout_s:
            self._forget(Reason(Cause.FORGOTTEN, "no image for longer than the reset timeout"))
        return [self._estimate(ownship, None)]

    def reset(self, why: Reason) -> None:
        """Forget everything: times and frames no longer hold."""
        self._forget(why)
        self._seen.clear()
        self._published_ns = None

    # ------------------------------------------------------------------------ one image

    def _prepare(self, message: TargetPoints, ownship: Ownship) -> AngleImage | Verdict:
        """Return the image's angles and the camera's pose, or the verdict on an unusable image."""
        key = message.camera, message.t_ns
        if key in self._seen:
            return Verdict.DUPLICATE
        points = np.array([message.center, message.left, message.right])
        if not np.isfinite(points).all():
            return Verdict.NOT_FINITE
        if np.abs(points).max() > MAX_IMAGE_RADIUS or message.left == message.right:
            return Verdict.DEGENERATE
        pose = self._pose(message, ownship)
        if pose is None:
            return Verdict.TOO_NEW if message.t_ns > ownship.now_ns > 0 else Verdict.NO_POSE
        self._seen.append(key)
        return AngleImage(message, camera_angles.angles_from_points(points), pose)  # eq 18

    def _insert(self, image: AngleImage, ownship: Ownship) -> MeasurementReport:
        """Start with an image, or insert it into the history at its own time."""
        message, history = image.message, self._history
        if history is None:
            belief = first_belief(image.angles, self._size, self._size_sigma, *image.pose)  # eqs 43-51
            horizon_ns = round(self._config.rewind_horizon_s * NS_PER_S)
            self._history = History(
                message.t_ns, belief, horizon_ns=horizon_ns, advance=self._advance, fuse=self._fuse
            )
            self._fused_ns = message.t_ns
            self._settle(ownship)
            return self._report(message, Verdict.INITIALISING, image)
        if not history.reaches(message.t_ns):
            return self._report(message, Verdict.TOO_OLD, image)
        late = message.t_ns < self._fused_ns
        update: Update = history.insert(message.t_ns, image, ownship)
        self._settle(ownship)
        if not update.passes:
            return self._report(message, Verdict.GATED, image, update)
        self._fused_ns = max(self._fused_ns, message.t_ns)
        return self._report(message, Verdict.FUSED_LATE if late else Verdict.FUSED, image, update)

    def _settle(self, ownship: Ownship) -> None:
        """Advance to the newest own motion; an image rejected by the gate may pass now."""
        if self._history is not None:
            self._history.settle(ownship)
            self._fused_ns = max(self._fused_ns, self._history.newest(lambda update: update.passes) or 0)

    # ------------------------------------------------------------------------ the paper's filter

    def _advance(self, belief: Belief, t0_ns: int, t1_ns: int, ownship: Ownship) -> Belief:
        """Time update: the sigma points through eqs 5-10, and their moments, eqs 29-33."""
        for step in ownship.steps(t0_ns, t1_ns):
            motion = FollowerMotion(step.v0, step.v1, step.a, step.a)
            process = partial(relative_motion.process, dt=step.dt, follower=motion, eps=HOVER_SPEED)
            belief = unscented.predict(belief, process, self._Q * step.dt, WEIGHTS)
        return belief

    def _fuse(self, belief: Belief, image: AngleImage, ownship: Ownship) -> tuple[Belief, Update]:
        """Measurement update, eqs 34-42, with the angles of eqs 11-17. The gate is ours."""
        pose = self._pose(image.message, ownship) or image.pose
        measure = partial(camera_angles.measure, R_cn=pose.R_cn, r_FC_n=pose.r_FC_n)
        update = unscented.update(belief, image.angles, measure, ANGLES, WEIGHTS, camera_angles.ANGULAR)
        update = update._replace(passes=update.nis <= self._gate)
        return (update.belief if update.passes else belief), update

    def _pose(self, message: TargetPoints, ownship: Ownship) -> CameraPlace | None:
        """Return the camera's pose at the time of an image.

        None if ours, or its gimbal's, is unknown.
        """
        camera, pose = self._camera.named(message.camera), ownship.pose_at(message.t_ns)
        if pose is None:
            return None
        R_nb, mount = pose.R_nb, message.mount
        if mount is None and camera.gimbal is not None:
            mount = ownship.gimbals.of(camera, message.t_ns)
            if mount is None:
                return None
        R_nm = R_nb if mount is None else head_attitude(mount, R_nb)
        return CameraPlace((R_nm @ camera.R_bc).T, R_nb @ camera.r_FC_b)

    # ------------------------------------------------------------------------ what is published

    def _fail(self, error: FilterError) -> None:
        self._forget(Reason(Cause.FILTER_FAILED, f"the filter failed: {error}"))

    def _forget(self, why: Reason) -> None:
        self._resets += self._history is not None
        self._history, self._why = None, why

    def _age(self, t_ns: int) -> float:
        return (t_ns - self._fused_ns) / NS_PER_S

    def _state(self, t_ns: int) -> tuple[Lifecycle, Reason]:
        if self._history is None:
            return Lifecycle.SEARCHING, self._why
        return life_by_age(self._age(t_ns), self._config, one="image", many="images")

    def _estimate(self, ownship: Ownship, report: MeasurementReport | None) -> Estimate:
        t_ns, belief = ownship.now_ns, None
        try:
            if self._history is not None:
                t_ns, belief = self._history.belief_at(t_ns, ownship)
                unscented.factor(belief.covariance)  # it must be one
        except FilterError as error:
            self._fail(error)
            belief = None
        state, (cause, reason) = self._state(t_ns)
        if self._since[0] is not state:
            self._since = state, t_ns
        self._sequence += 1
        self._published_ns = ownship.now_ns
        return Estimate(
            name=NAME,
            target=NAME,
            sequence=self._sequence,
            t_ns=t_ns,
            state=state,
            valid=state.is_valid,
            cause=cause,
            reason=reason,
            frame=relative_motion.FRAME,
            components=relative_motion.COMPONENTS,
            units=relative_motion.UNITS,
            age=None if belief is None else self._age(t_ns),
            reset_count=self._resets,
            state_since_ns=self._since[1],
            measurement=report,
            **belief_fields(belief),
        )

    def _report(
        self,
        message: TargetPoints,
        verdict: Verdict,
        image: AngleImage | None = None,
        update: Update | None = None,
    ) -> MeasurementReport:
        """Return the record of one image, with everything known when the verdict was reached."""
        return image_report(
            message,
            verdict,
            components=camera_angles.COMPONENTS,
            units=camera_angles.UNITS,
            gate=self._gate,
            measured=None if image is None else image.angles,
            update=update,
        )
