"""All other aircraft of a run: their reports, our radar's scans and the truth.

Random numbers belong to the seed and one aircraft or sensor: a further aircraft leaves the others unchanged.
"""

from typing import Final, Literal, NamedTuple

from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import IntruderTruth, Message, Pseudoranges, RadarDetections, TrafficTruth, Vec3
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import LEADER_INDEX, Aircraft
from simlink.traffic.aircraft import STRIDE_STEPS, Motion, level_at, motions, rotate
from simlink.traffic.radar import RadarSensor
from simlink.traffic.reports import Transmitter
from simlink.world.attitude import difference
from simlink.world.constants import STEPS_PER_SECOND
from simlink.world.truth import State

TRUTH_STRIDE_STEPS: Final = 20  # steps of the world: 10 Hz


class TrafficOutput(NamedTuple):
    """The traffic's output at one step: reports, pseudoranges, a radar scan, the truth."""

    reports: tuple[Message, ...] = ()
    ranges: tuple[Pseudoranges, ...] = ()
    scan: RadarDetections | None = None
    truth: TrafficTruth | None = None


class Traffic:
    """All other aircraft of a run: call `step` once per step of the world, in order."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._radar = scenario.traffic.radar
        self._origin = scenario.vehicle.origin
        aircraft = scenario.traffic.aircraft
        self._transmitters = [Transmitter(a, number, scenario, seed) for number, a in enumerate(aircraft)]
        self._leader = _leader(scenario, seed)
        self._motions = [motions(a, seed) for a in aircraft]
        self._sensor = RadarSensor(self._radar, seed)
        self._detections = [0] * len(self._motions)
        rate = self._radar.rate or STEPS_PER_SECOND  # 0: it is off
        self._scan_steps = max(round(STEPS_PER_SECOND / rate / STRIDE_STEPS) * STRIDE_STEPS, STRIDE_STEPS)

    def step(self, state: State, t_ns: int) -> TrafficOutput:
        """Return the traffic's output at this state of the world, `t_ns` on the boot clock."""
        if state.step % STRIDE_STEPS:
            return TrafficOutput()
        if self._leader is None:
            return self._others(state, t_ns)
        reports = self._leader.step(state.t, Motion(state.r_OL_n, state.v_L_n))
        others = self._others(state, t_ns)
        return others._replace(reports=(*others.reports, *reports))

    def _others(self, state: State, t_ns: int) -> TrafficOutput:
        """Return the output of all aircraft except the leader."""
        if not self._motions:
            return TrafficOutput()
        now = [next(m) for m in self._motions]
        pairs = list(zip(self._transmitters, now, strict=True))
        reports = tuple(report for transmitter, motion in pairs for report in transmitter.step(state.t, motion))
        ranges = tuple(e for transmitter, motion in pairs for e in transmitter.ranges(state.t, t_ns, motion))
        scanning = self._radar.rate > 0 and state.step % self._scan_steps == 0
        if not scanning and state.step % TRUTH_STRIDE_STEPS:
            return TrafficOutput(reports, ranges)
        # the autopilot's attitude refers to the horizon at our position, and so do the radar's angles
        lat_deg, lon_deg, _ = geodetic_from_ned(state.r_OF_n, self._origin)
        level = level_at(lat_deg, lon_deg, self._origin)
        r = [rotate(level, difference(m.r, state.r_OF_n)) for m in now]
        scan = truth = None
        if scanning:
            scan, detected = self._sensor.scan(state.t, t_ns, state.q_nF, r)
            self._detections = [count + hit for count, hit in zip(self._detections, detected, strict=True)]
        if state.step % TRUTH_STRIDE_STEPS == 0:
            v = [rotate(level, difference(m.v, state.v_F_n)) for m in now]
            truth = self._truth(t_ns, r, v)
        return TrafficOutput(reports, ranges, scan, truth)

    def _truth(self, t_ns: int, r: list[Vec3], v: list[Vec3]) -> TrafficTruth:
        intruders = tuple(
            IntruderTruth(
                name=transmitter.aircraft.name,
                target=transmitter.target,
                r_FT_n=r[i],
                v_FT_n=v[i],
                messages=transmitter.received,
                detections=self._detections[i],
            )
            for i, transmitter in enumerate(self._transmitters)
        )
        return TrafficTruth(t_ns=t_ns, intruders=intruders)


def _leader(scenario: Scenario, seed: int) -> Transmitter | None:
    """Return the transmitter of the leader's own position, or None if it sends none."""
    if scenario.broadcast is None:
        return None
    says: Literal["adsb", "peer"] = "adsb" if scenario.broadcast.says == "adsb" else "peer"
    aircraft = Aircraft(name="leader", says=says, start=(0.0, 0.0, 0.0))
    return Transmitter(aircraft, LEADER_INDEX, scenario, seed, scenario.broadcast)
