"""The leader's own broadcast position.

It teaches the size, and carries the track while no image shows it.

What arrives is prepared here; `filters.auxiliary` says what it measures, `tracks.track` when it is used."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.frame import Frame
from onboard.estimators.kit.peer_position import MIN_MOVING_SPEED_M_S, ReportedPosition, of_adsb, of_peer
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.auxiliary import (
    DELAY,
    OWN_VELOCITY,
    REPORT_POSITION,
    TURN,
    Auxiliary,
    Report,
)
from onboard.estimators.leader.hypotheses.particles import Bias
from onboard.messages import AdsbVehicle, FollowTarget, GlobalPosition, Message, PeerPosition, Verdict
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

COUNTED: Final = "broadcast_"  # before the verdicts in the health

Broadcasts = AdsbVehicle | PeerPosition | FollowTarget


class Broadcast:
    """The reports of one leader, which are given to `take`.

    `verdicts` counts what became of them, by name."""

    def __init__(self, config: Config, take: Callable[[Auxiliary, Ownship], Verdict]) -> None:
        self.verdicts: Counter[str] = Counter()
        self._config, self._take = config.broadcast, take
        self._biases = biases_of(config)
        theirs = (AdsbVehicle,) if self._config.icao else (PeerPosition, FollowTarget)
        self._listens: tuple[type[Message], ...] = (GlobalPosition, *theirs)
        self.clear()

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """The messages it uses."""
        return self._listens

    def clear(self) -> None:
        """Forget all but the counts: the time base or our own motion is another."""
        self._frame = Frame()
        self._newest: tuple[int, Any] | None = None  # time and place of the newest report

    def receive(self, message: Message, ownship: Ownship) -> None:
        """Take a report, or our own position."""
        if isinstance(message, GlobalPosition):
            self._frame.receive(message)
            return
        if not isinstance(message, Broadcasts) or not self._is_leaders(message):
            return
        report = self._prepared(message, ownship)
        verdict = report if isinstance(report, Verdict) else self._take(report, ownship)
        self.verdicts[COUNTED + verdict] += 1

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
        is_repeated = place == reported.place and math.hypot(*reported.v) > MIN_MOVING_SPEED_M_S
        if t_ns <= newest_ns or is_repeated or ownship.now_ns - t_ns > given.MAX_REPORT_AGE_NS:
            return Verdict.STALE
        own = self._frame.own_motion(t_ns, ownship) if self._frame.known else None
        if own is None:
            return Verdict.NO_POSE
        self._newest = t_ns, reported.place
        turn = own.R_nl.T @ self._frame.rotation_nl(*reported.place[:2])
        r = own.R_nl.T @ (self._frame.position(*reported.place) - own.r)
        sigma = m.position_sigma if isinstance(m, FollowTarget) else (0.0, 0.0, 0.0)
        return self._report(t_ns, reported, r, turn, sigma)

    def _report(
        self, t_ns: int, reported: ReportedPosition, r: Array, turn: Array, known: tuple[float, ...]
    ) -> Report:
        """The report with its noise.

        `turn` from NED there to NED here, `known` what it says of its own error."""
        c = self._config
        white = np.full(3, c.position_sigma_m)
        white = np.maximum(white, np.where(np.isfinite(known), known, 0.0))
        level = c.velocity_sigma_m_s if reported.has_level else given.UNKNOWN_VELOCITY_SIGMA
        climb = c.velocity_sigma_m_s if reported.has_climb else given.UNKNOWN_VELOCITY_SIGMA
        v = turn @ np.array(reported.v)
        R = np.zeros((6, 6))
        R[:3, :3] = (turn * white**2) @ turn.T + c.latency_sigma_s**2 * np.outer(v, v)
        R[3:, 3:] = (turn * np.array([level, level, climb]) ** 2) @ turn.T
        return Report(t_ns, r, v, R, self._biases, c.trusted)


def biases_of(config: Config) -> tuple[Bias, ...]:
    """Return the lasting errors of a report: position, delay, our own velocity and yaw."""
    b = config.broadcast
    height = given.PRESSURE_BIAS_M if b.icao else b.bias_m
    position = np.hypot([b.bias_m, b.bias_m, height], config.own_position_sigma_m).tolist()
    velocity = given.OWN_SIGMA_FACTOR * config.own_velocity_sigma_m_s
    its_time = LeaderModel._field_defaults["own_velocity_time"]
    return (
        *(Bias(name, sigma, b.bias_time_s) for name, sigma in zip(REPORT_POSITION, position, strict=True)),
        *(Bias(name, velocity, its_time) for name in OWN_VELOCITY),
        Bias(TURN, given.OWN_SIGMA_FACTOR * math.radians(config.own_yaw_sigma_deg), config.own_attitude_time_s),
        Bias(DELAY, b.latency_sigma_s, given.DELAY_TIME_S),
    )
