"""The leader's own broadcast position: it teaches the size, and carries the track while no image shows it.

`reference` holds the mathematics. A report is used at the time at which it was true, some tenths of a second
before it arrives, beside what the camera showed then. While images follow the leader well, the estimate stays
theirs, with the size as it is known by then. Without images, or while they leave the range open, the estimate is
that of the reports, as long as they come; a leader that no image has shown yet is not followed.

Images come first: a report that contradicts them is rejected.
"""

import math
from collections import Counter, deque
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from onboard.arrays import Array
from onboard.estimators.frame import Frame
from onboard.estimators.leader import reference
from onboard.estimators.leader.carried import as_leader
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.reference import SIZE, Errors, Shown
from onboard.estimators.leader.size import Size
from onboard.estimators.reported import STANDSTILL, Reported, of_adsb, of_peer
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold
from onboard.geometry.units import NS_PER_S, S_PER_NS
from onboard.messages import (
    AdsbVehicle,
    Estimate,
    FollowTarget,
    GlobalPosition,
    Lifecycle,
    Message,
    PeerPosition,
    Verdict,
)
from onboard.models import relative_motion
from onboard.ownship import Ownship

CARRIED: Final = "carried by its broadcast"
COUNTED: Final = "broadcast_"  # before the verdicts in the health
OWN_POSITION_TIMEOUT_S: Final = 3.0
PRESSURE_BIAS: Final = 30.0  # m: of a height by a pressure whose reference at sea level is not known
SHOWN_SPEED: Final = 8.0  # m/s: how far the velocity may be off before the first report
WITHOUT_SPEED: Final = 300.0  # m/s: noise of a velocity that is not reported
OLDEST_NS: Final = 1_500_000_000  # an older report is stale: what we and the camera did then is forgotten soon
KEPT_NS: Final = 4 * NS_PER_S  # what the camera showed
APART_NS: Final = 50_000_000  # between two of it
NEAR_NS: Final = 150_000_000  # of a report's time: so near it is used
GATE: Final = 0.9999  # the probability that a report passes that is true
TAUGHT: Final = (0.25, 0.9)  # of its sigma: a size that moved by more, or is surer than this share, is passed on
SUREST: Final = 0.003  # of the size: as sure as the filters are made of it

Broadcasts = AdsbVehicle | PeerPosition | FollowTarget


class Report(NamedTuple):
    """r_FL_n and v_L_n (None: not reported), true at `t_ns`, and their noise (6, 6)."""

    t_ns: int
    r: Array
    v: Array | None
    R: Array


class Sample(NamedTuple):
    """What the camera showed at a time, and the velocity (3,) of it relative to us."""

    t_ns: int
    shown: Shown
    v: Array
    size_sigma: float


class Broadcast:
    """The reports of one leader. `verdicts` counts what became of them, by name."""

    def __init__(self, config: Config) -> None:
        self.verdicts: Counter[str] = Counter()
        self._config = config.broadcast
        b = config.broadcast
        height = b.altitude_bias_m if b.altitude_bias_m is not None else (PRESSURE_BIAS if b.icao else b.bias_m)
        bias = np.hypot([b.bias_m, b.bias_m, height], config.own_position_sigma_m)
        self._errors = Errors(bias, b.latency_sigma_s, b.bias_time_s, config.own_velocity_sigma_m_s)
        self._listens = (GlobalPosition, AdsbVehicle) if b.icao else (GlobalPosition, PeerPosition, FollowTarget)
        self.clear()

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """The messages it uses."""
        return self._listens if self._config.is_used else ()

    def clear(self) -> None:
        """Forget all but the counts: the time base or our own motion is another."""
        self._frame = Frame(OWN_POSITION_TIMEOUT_S)
        self._samples: deque[Sample] = deque()
        self._belief: Belief | None = None
        self._t_ns = self._seen_ns = self._used_ns = 0
        self._newest: tuple[int, Any] | None = None  # time and place of the newest report
        self._taught: Size | None = None
        self._ahead: tuple[int, Array] | None = None  # our way since `_t_ns`
        self._template: Estimate | None = None  # the last estimate with a belief
        self._since_ns: int | None = None  # since when it carries the track

    # ------------------------------------------------------------------------------------ reports

    def receive(self, message: Message, ownship: Ownship) -> Size | None:
        """Take a report, or our own position. The size, if it is known better by it."""
        if isinstance(message, GlobalPosition):
            self._frame.receive(message)
            return None
        if not isinstance(message, Broadcasts) or not self._is_leaders(message):
            return None
        report = self._prepared(message, ownship)
        try:
            verdict = report if isinstance(report, Verdict) else self._fuse(report, ownship)
        except FilterError:
            self._belief, verdict = None, Verdict.NUMERICAL
        self.verdicts[COUNTED + verdict] += 1
        return self._lesson()

    def _is_leaders(self, message: Broadcasts) -> bool:
        if isinstance(message, AdsbVehicle):
            return bool(self._config.icao) and message.icao == int(self._config.icao, 16)
        return self._config.system != 0 and message.system == self._config.system

    def _prepared(self, m: Broadcasts, ownship: Ownship) -> Report | Verdict:
        """The report in a message, relative to us; else the reason why there is none."""
        c = self._config
        height = m.altitude if isinstance(m, AdsbVehicle) else m.alt_msl
        v = (m.ground_speed, m.course, m.climb) if isinstance(m, AdsbVehicle) else m.v_n
        if not all(math.isfinite(x) for x in (m.lat_deg, m.lon_deg, height, *v) if x is not None):
            return Verdict.NOT_FINITE
        if isinstance(m, AdsbVehicle):
            offsets = {"geoid_undulation": c.geoid_undulation_m, "pressure_altitude_offset": 0.0}
            reported = of_adsb(m, **offsets, fastest=c.max_speed_m_s)
        else:
            reported = of_peer(m, fastest=c.max_speed_m_s)
        if isinstance(reported, Verdict):
            return reported
        age = c.latency_s + (m.tslc if isinstance(m, AdsbVehicle) else 0.0)
        t_ns = m.t_ns - round(age * NS_PER_S)
        newest_ns, place = self._newest or (0, None)
        is_repeated = place == reported.place and math.hypot(*reported.v) > STANDSTILL
        if t_ns <= newest_ns or is_repeated or ownship.now_ns - t_ns > OLDEST_NS:
            return Verdict.STALE
        own = self._frame.own_motion(t_ns, ownship) if self._frame.known else None
        if own is None:
            return Verdict.NO_POSE
        self._newest = t_ns, reported.place
        turn = own.R_nl.T @ self._frame.rotation_nl(*reported.place[:2])
        r = own.R_nl.T @ (self._frame.position(*reported.place) - own.r)
        sigma = m.position_sigma if isinstance(m, FollowTarget) else (0.0, 0.0, 0.0)
        return self._report(t_ns, reported, r, turn, sigma)

    def _report(self, t_ns: int, reported: Reported, r: Array, turn: Array, known: tuple[float, ...]) -> Report:
        """The report with its noise: `turn` from NED there to NED here, `known` what it says of its own error."""
        c = self._config
        white = np.array([c.position_sigma_m, c.position_sigma_m, c.altitude_sigma_m or c.position_sigma_m])
        white = np.maximum(white, np.where(np.isfinite(known), known, 0.0))
        level = c.velocity_sigma_m_s if reported.has_level else WITHOUT_SPEED
        climb = c.velocity_sigma_m_s if reported.has_climb else WITHOUT_SPEED
        v = turn @ np.array(reported.v)
        R = np.zeros((6, 6))
        R[:3, :3] = (turn * white**2) @ turn.T + c.latency_sigma_s**2 * np.outer(v, v)
        R[3:, 3:] = (turn * np.array([level, level, climb]) ** 2) @ turn.T
        return Report(t_ns, r, v, R)

    def _fuse(self, report: Report, ownship: Ownship) -> Verdict:
        """Use a report beside what the camera showed at its time. Raises FilterError."""
        near = min(self._samples, key=lambda s: abs(s.t_ns - report.t_ns), default=None)
        if near is not None and abs(near.t_ns - report.t_ns) > NEAR_NS:
            near = None
        if self._belief is None or report.t_ns - self._t_ns > KEPT_NS:
            if near is None:
                self._belief = None
                return Verdict.INITIALISING
            size = self._taught or Size(near.shown.size, near.size_sigma)
            pose = ownship.pose_at(near.t_ns)
            if pose is None:
                return Verdict.NO_POSE
            v = near.v + pose.v_F_n
            belief = reference.start(self._errors, _at(near, report.t_ns), *size, v, SHOWN_SPEED)
            self._seen_ns = report.t_ns
        else:
            dt = (report.t_ns - self._t_ns) * S_PER_NS
            belief = reference.predict(self._errors, self._belief, dt, _way(self._t_ns, report.t_ns, ownship))
            if near is not None:
                since = (report.t_ns - self._seen_ns) * S_PER_NS
                belief, self._seen_ns = reference.see(belief, _at(near, report.t_ns), since), report.t_ns
        self._belief, self._t_ns, self._ahead = belief, report.t_ns, None
        after, nis = reference.report(belief, report.r, report.v, report.R)
        if not nis <= chi_square_threshold(GATE, 6):
            return Verdict.GATED
        self._belief, self._used_ns = after, report.t_ns
        return Verdict.FUSED

    def _lesson(self) -> Size | None:
        """The size, if it has become another or surer since it was passed on."""
        if self._belief is None or self._used_ns != self._t_ns:
            return None
        value, variance = float(self._belief.mean[SIZE]), float(self._belief.covariance[SIZE, SIZE])
        sigma = max(math.sqrt(variance), SUREST * value)
        last = self._taught
        if (
            last is not None
            and abs(value - last.value) < TAUGHT[0] * last.sigma
            and sigma > TAUGHT[1] * last.sigma
        ):
            return None
        self._taught = Size(value, sigma)
        return self._taught

    # ----------------------------------------------------------------------------------- estimates

    def over(self, estimate: Estimate, ownship: Ownship) -> Estimate:
        """The estimate to publish, once the images gave this one."""
        if estimate.mean is not None:
            self._template = estimate
        follows = estimate.state is Lifecycle.TRACKING
        if follows:
            self._remember(estimate)
        made = None
        if not (follows and self._samples and not self._samples[-1].shown.is_open):
            made = self._carried(estimate, ownship)
        if made is None or (estimate.valid and not _is_nearer(made, estimate)):
            self._since_ns = None
            return estimate
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

    def _remember(self, estimate: Estimate) -> None:
        """Keep what the camera shows at an estimate's time."""
        if estimate.mean is None or estimate.covariance is None:
            return
        if self._samples and estimate.t_ns - self._samples[-1].t_ns < APART_NS:
            return
        mean, P = np.array(estimate.mean), np.array(estimate.covariance)
        size, sigma = float(mean[relative_motion.SIZE]), math.sqrt(P[relative_motion.SIZE, relative_motion.SIZE])
        seen = reference.shown(mean[relative_motion.R], P[relative_motion.R, relative_motion.R], size, sigma)
        self._samples.append(Sample(estimate.t_ns, seen, mean[relative_motion.V], sigma))
        while estimate.t_ns - self._samples[0].t_ns > KEPT_NS:
            self._samples.popleft()

    def _carried(self, estimate: Estimate, ownship: Ownship) -> Belief | None:
        """The belief by the reports at an estimate's time; None without one, or without a report for too long."""
        t_ns, template, pose = estimate.t_ns, self._template, ownship.pose_at(estimate.t_ns)
        if self._belief is None or template is None or pose is None:
            return None
        if (t_ns - self._used_ns) * S_PER_NS > self._config.timeout_s + self._config.latency_s:
            return None
        begin_ns, moved = self._ahead or (self._t_ns, np.zeros(3))
        self._ahead = t_ns, moved + _way(begin_ns, t_ns, ownship)
        now = reference.predict(self._errors, self._belief, (t_ns - self._t_ns) * S_PER_NS, self._ahead[1])
        return as_leader(now, template, pose.v_F_n, self._errors.own_velocity)


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
