"""What is known of the leader beside the images: where it is and how large, by its own reports and by ranges.

`reference` holds the mathematics, `broadcast` and `ranging` prepare what arrives. A measurement is used at the
time at which it was true, beside what the camera showed then. While images follow the leader well, the estimate
stays theirs, with the size as it is known by then. Without images, or while they leave the range open, the
estimate is that of the reports, as long as they come; a leader that no image has shown yet is not followed.

Images come first: a report or a range that contradicts them is rejected.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec
import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.beside import reference
from onboard.estimators.leader.beside.carried import as_leader
from onboard.estimators.leader.beside.reference import SIZE, Errors, Shown
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.size import Size
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.units import NS_PER_S, S_PER_NS
from onboard.messages import Estimate, Lifecycle, Verdict
from onboard.models import relative_motion
from onboard.ownship import Ownship

ELSEWHERE: Final = "its broadcast had led elsewhere"
CARRIED: Final = "carried by its broadcast"
PRESSURE_BIAS: Final = 30.0  # m: of a height by a pressure whose reference at sea level is not known
UNSURE: Final = 1.4  # times the configured errors of our yaw and velocity: those are guesses, too
LIAR: Final = 15.0  # m/s: so fast a false report could lead an estimate away, unnoticed
SIZES: Final = 3.0  # sigmas of the configured size: no report that may be false teaches another
DISTRUSTED_S: Final = 10.0  # for so long a broadcast that was wrong is not used, and an estimate says so
SHOWN_SPEED: Final = 8.0  # m/s: how far the velocity may be off before the first report
KEPT_NS: Final = 4 * NS_PER_S  # what the camera showed
APART_NS: Final = 50_000_000  # between two samples of that
LOST_NS: Final = 30 * NS_PER_S  # without a measurement: nothing that was known of the place is of use
NEAR_NS: Final = 150_000_000  # of a measurement's time: so near it is used
GATE: Final = 0.9999  # the probability that a measurement passes that is true
AGAIN_S: Final = 1.0  # after so long without images the leader is seen again: is it where it was believed?
AGAIN: Final = 0.999  # the probability that its place then fits: once in a while, not at each measurement
CONTRADICTED: Final = 4  # positions in a row that contradict what is carried: it is not believed
TAUGHT: Final = (0.25, 0.9)  # of its sigma: a size that moved by more, or is surer than this share, is passed on
SUREST: Final = 0.003  # of the size: as sure as the filters are made of it

Correct = Callable[[Belief], tuple[Belief, float]]


class Sample(NamedTuple):
    """What the camera showed at a time, and the velocity (3,) of it relative to us."""

    t_ns: int
    shown: Shown
    v: Array
    size_sigma: float


class Beside:
    """The belief of one leader beside its images."""

    def __init__(self, config: Config) -> None:
        b = config.broadcast
        self._timeout_s = b.timeout_s + b.latency_s
        self._is_trusted, self._validity_s = b.trusted or not b.is_used, config.validity_timeout_s
        sigma = config.size_prior_sigma_m or 0.02 * config.size_prior_m
        self._sizes = config.size_prior_m - SIZES * sigma, config.size_prior_m + SIZES * sigma
        self.contradictions = 0  # how often the leader, seen again, was not where reports had led it
        height = b.altitude_bias_m if b.altitude_bias_m is not None else (PRESSURE_BIAS if b.icao else b.bias_m)
        bias = np.hypot([b.bias_m, b.bias_m, height], config.own_position_sigma_m)
        own, lasting = UNSURE * config.own_velocity_sigma_m_s, config.range.bias_m
        yaw = UNSURE * math.radians(config.own_yaw_sigma_deg)
        lasts = config.own_attitude_time_s
        self._errors = Errors(bias, b.latency_sigma_s, b.bias_time_s, own, lasting, yaw, lasts)
        self.clear()

    def clear(self) -> None:
        """Forget all: the time base or our own motion is another."""
        self._samples: deque[Sample] = deque()
        self._belief: Belief | None = None
        self._t_ns = self._seen_ns = self._reported_ns = 0
        self._image_ns = 0  # the newest fused image
        self._was_used = self._is_shown = False  # the last measurement; and an image near it
        self._gated = 0  # positions in a row
        self._taught: Size | None = None
        self._ahead = 0, np.zeros(3)  # our way since `_t_ns`, and until when
        self._template: Estimate | None = None  # the last estimate with a belief
        self._since_ns: int | None = None  # since when it carries the track
        self._contradicted_ns: int | None = None

    # ------------------------------------------------------------------------------- measurements

    def fuse(self, t_ns: int, rows: int, correct: Correct, ownship: Ownship, *, is_position: bool) -> Verdict:
        """Use a measurement of `rows` numbers, true at t_ns, beside what the camera showed then. `correct` gives
        the belief after it and its NIS; only a position can carry the track."""
        try:
            verdict = self._fuse(t_ns, rows, correct, ownship, is_position=is_position)
        except FilterError:
            self._belief, verdict = None, Verdict.NUMERICAL
        self._was_used = verdict is Verdict.FUSED
        if is_position and self._was_used:
            self._reported_ns, self._gated = t_ns, 0
        elif is_position and verdict is Verdict.GATED:
            self._gated += 1
        return verdict

    def _fuse(self, t_ns: int, rows: int, correct: Correct, ownship: Ownship, *, is_position: bool) -> Verdict:
        near = min(self._samples, key=lambda s: abs(s.t_ns - t_ns), default=None)
        if near is not None and abs(near.t_ns - t_ns) > NEAR_NS:
            near = None
        if self._belief is not None and t_ns < self._t_ns:
            return Verdict.STALE
        belief = self._predicted(t_ns, near, ownship)
        if belief is None:
            pose = None if near is None else ownship.pose_at(near.t_ns)
            if near is None or pose is None:
                self._belief = None
                return Verdict.INITIALISING
            size = self._taught or Size(near.shown.size, near.size_sigma)
            v = near.v + pose.v_F_n
            belief = reference.start(self._errors, _at(near, t_ns), *size, v, SHOWN_SPEED)
            self._seen_ns = t_ns
        self._is_shown = near is not None
        self._belief, self._t_ns, self._ahead = belief, t_ns, (t_ns, np.zeros(3))
        if is_position and self._was_wrong(t_ns):
            return Verdict.GATED
        if not (is_position or reference.knows_direction(belief)):
            return Verdict.UNASSOCIATED
        after, nis = correct(belief)
        if not nis <= chi_square_threshold(GATE, rows):
            return Verdict.GATED
        self._belief = after
        return Verdict.FUSED

    def _predicted(self, t_ns: int, near: Sample | None, ownship: Ownship) -> Belief | None:
        """The belief at a measurement's time, with what the camera showed near it. None where none is of use:
        too old, or the leader is seen again and was lost from sight meanwhile, or is not where reports led it."""
        if self._belief is None or t_ns - self._t_ns > LOST_NS:
            return None
        dt = (t_ns - self._t_ns) * S_PER_NS
        belief = reference.predict(self._errors, self._belief, dt, self._way_to(t_ns, ownship))
        since = (t_ns - self._seen_ns) * S_PER_NS
        if near is None or since <= 0.0:
            return belief
        if since > AGAIN_S:
            if reference.misfit(belief, _at(near, t_ns), since) > chi_square_threshold(AGAIN, 3):
                if self._reported_ns > self._seen_ns:
                    self.contradictions, self._contradicted_ns = self.contradictions + 1, t_ns
                return None
            if not reference.knows_direction(belief):
                return None
        self._seen_ns = t_ns
        return reference.see(belief, _at(near, t_ns), since)

    def lesson(self) -> Size | None:
        """The size, if it has become another or surer by the last measurement since it was passed on, beside
        an image: alone, a report or a range says nothing of the size."""
        if self._belief is None or not (self._was_used and self._is_shown and self._is_credible(self._belief)):
            return None
        value, variance = float(self._belief.mean[SIZE]), self._size_variance(self._belief)
        sigma, last = max(math.sqrt(variance), SUREST * value), self._taught
        if (
            last is not None
            and abs(value - last.value) < TAUGHT[0] * last.sigma
            and sigma > TAUGHT[1] * last.sigma
        ):
            return None
        self._taught = Size(value, sigma)
        return self._taught

    def _is_credible(self, belief: Belief) -> bool:
        """Whether reports that may be false have left the size within what was configured."""
        return self._is_trusted or self._sizes[0] < float(belief.mean[SIZE]) < self._sizes[1]

    def _size_variance(self, belief: Belief) -> float:
        """With what a delay of reports does, if there were any."""
        if self._reported_ns == 0:
            return float(belief.covariance[SIZE, SIZE])
        return reference.size_variance(self._errors, belief)

    # ----------------------------------------------------------------------------------- estimates

    def over(self, estimate: Estimate, ownship: Ownship, *, shows_size: bool = True) -> Estimate:
        """The estimate to publish, once the images gave this one. `shows_size`: whether its range is that of a
        leader of its size; else it teaches none."""
        if self._belief is not None and estimate.t_ns > self._ahead[0]:
            self._ahead = estimate.t_ns, self._way_to(estimate.t_ns, ownship)
        if estimate.mean is not None:
            self._template = estimate
        if estimate.age is not None:
            self._image_ns = estimate.t_ns - round(estimate.age * NS_PER_S)
        follows = estimate.state is Lifecycle.TRACKING
        if follows:
            self._remember(estimate, shows_size=shows_size)
        made = None
        if not (follows and self._samples and not self._samples[-1].shown.is_open):
            made = self._carried(estimate, ownship)
        if made is None or (estimate.valid and not _is_nearer(made, estimate)):
            self._since_ns = None
            return self._told(estimate)
        if self._since_ns is None:
            self._since_ns = estimate.t_ns
        state = estimate.state if estimate.valid else Lifecycle.COASTING
        return msgspec.structs.replace(
            estimate,
            state=state,
            state_since_ns=estimate.state_since_ns if estimate.valid else self._since_ns,
            valid=True,
            reason=f"{CARRIED}; {estimate.reason}",
            mean=tuple(made.mean.tolist()),
            covariance=tuple(map(tuple, made.covariance.tolist())),
            modes=(),
        )

    def _told(self, estimate: Estimate) -> Estimate:
        """The estimate of images, which says whether its broadcast was wrong lately."""
        if not self._was_wrong(estimate.t_ns):
            return estimate
        return msgspec.structs.replace(estimate, reason=f"{estimate.reason}; {ELSEWHERE}")

    def _was_wrong(self, t_ns: int) -> bool:
        """Whether the leader, seen again lately, was not where reports had led it."""
        wrong_ns = self._contradicted_ns
        return wrong_ns is not None and (t_ns - wrong_ns) * S_PER_NS < DISTRUSTED_S

    def _remember(self, estimate: Estimate, *, shows_size: bool) -> None:
        """Keep what the camera shows at an estimate's time."""
        if estimate.mean is None or estimate.covariance is None:
            return
        if self._samples and estimate.t_ns - self._samples[-1].t_ns < APART_NS:
            return
        mean, P = np.array(estimate.mean), np.array(estimate.covariance)
        size, sigma = float(mean[relative_motion.SIZE]), math.sqrt(P[relative_motion.SIZE, relative_motion.SIZE])
        seen = reference.shown(mean[relative_motion.R], P[relative_motion.R, relative_motion.R], size, sigma)
        if not shows_size:
            seen = reference.of_any_range(seen)
        self._samples.append(Sample(estimate.t_ns, seen, mean[relative_motion.V], sigma))
        while estimate.t_ns - self._samples[0].t_ns > KEPT_NS:
            self._samples.popleft()

    def _way_to(self, t_ns: int, ownship: Ownship) -> Array:
        """How far (3,) we moved since the belief's time: our own motion is kept for some seconds only."""
        until_ns, moved = self._ahead
        if t_ns < until_ns:
            return moved - _way(t_ns, until_ns, ownship)
        return moved + _way(until_ns, t_ns, ownship)

    def _carried(self, estimate: Estimate, ownship: Ownship) -> Belief | None:
        """The belief by the reports at an estimate's time; None without one, without a report for too long, or
        where reports contradict it. Reports that may be false carry for no longer than images are valid, and the
        covariance holds what a liar could do meanwhile."""
        t_ns, template, pose = estimate.t_ns, self._template, ownship.pose_at(estimate.t_ns)
        if self._belief is None or template is None or pose is None or self._gated >= CONTRADICTED:
            return None
        if (t_ns - self._reported_ns) * S_PER_NS > self._timeout_s:
            return None
        dt, moved = (t_ns - self._t_ns) * S_PER_NS, self._way_to(t_ns, ownship)
        now = reference.with_delay(self._errors, reference.predict(self._errors, self._belief, dt, moved))
        if not self._is_trusted:
            unseen = (t_ns - self._image_ns) * S_PER_NS
            if unseen > self._validity_s or not self._is_credible(now):
                return None
            now.covariance[reference.R, reference.R] += (LIAR * unseen) ** 2 * np.eye(3)
        return as_leader(now, template, pose.v_F_n)


def _at(sample: Sample, t_ns: int) -> Shown:
    """What the camera showed at a time near a sample's."""
    return sample.shown._replace(r=sample.shown.r + (t_ns - sample.t_ns) * S_PER_NS * sample.v)


def _way(begin_ns: int, end_ns: int, ownship: Ownship) -> Array:
    """How far (3,) we moved between two times, in n."""
    way = np.zeros(3)
    for step in ownship.steps(begin_ns, end_ns):
        way += step.dt * step.v0 + (0.5 * step.dt**2) * step.a
    return way


def _is_nearer(made: Belief, estimate: Estimate) -> bool:
    """Whether a position is surer than an estimate's."""
    of_estimate = np.array(estimate.covariance)[relative_motion.R, relative_motion.R]
    return bool(np.trace(made.covariance[relative_motion.R, relative_motion.R]) < np.trace(of_estimate))
