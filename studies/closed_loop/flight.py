"""One closed-loop flight: simlink's follower, the daemon's pipeline and all its outputs, in bytes.

The follower's autopilot flies on setpoints as ArduCopter's GUIDED or PX4's OFFBOARD does (`simlink.world`), and
has no other information on the leader. Both computers run in one process on simulated time, so that a flight is a
function of scenario and seed.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.autopilot.output import AutopilotOutput
from onboard.config import Config, load_config, warm_datagram
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import Datagram, Severity, WarmState
from onboard.pipeline import Pipeline
from onboard.units import NS_PER_S
from simlink.scenarios.scenario import Scenario
from simlink.sensors.camera import mount_quaternion, project
from simlink.simulation import Detect, GuidedRun, Tick, boot_time_ns
from simlink.world.truth import true_size

LINK: Final = "autopilot"
TIMER_STEPS: Final = 4  # 20 ms, the daemon's timer
DELAY_STEPS: Final = 2  # 10 ms, from the daemon to the autopilot
ROWS_PER_S: Final = 10
STEPS_PER_S: Final = 200
MIN_COURSE_SPEED_M_S: Final = 0.5  # a slower leader has no course
TURN_BACK_TIME_S: Final = 8.0  # after it, a leader that flies back has turned round, wherever its nose points
NO_RATES: Final[dict[str, float]] = {}
# The kinds of advice that name a part of the set-up, which is right in every flight here.
SET_UP: Final = frozenset(
    {"camera", "class", "clock", "focal", "lens", "misfit", "mount", "noise", "pixels", "stamps", "target"}
)


class Flight(NamedTuple):
    """A flight in ten rows a second, each field (n,) if not stated otherwise."""

    t: Array  # s
    distance: Array  # m, between both aircraft
    slot_error: Array  # m, the follower's distance from its slot
    speed: Array  # m/s, the follower's over ground
    closing: Array  # m/s, at which the distance shrinks
    turn_rate: Array  # rad/s, the leader's
    valid: Array  # whether the estimate was
    following: Array  # whether the autopilot was
    pitch: Array  # rad, the follower's
    pitch_rate: Array  # rad/s
    north: Array  # m, the follower's position
    east: Array  # m
    in_view: Array  # whether the leader was inside the image
    aside: Array  # rad, about the leader, between the follower and its side of it
    advice: tuple[str, ...]  # kinds of advice about the set-up, worse than a notice, that the daemon gave


class Companion:
    """The daemon without its links: bytes in, frames for the autopilot out."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.pipeline = Pipeline(config)
        self.output = AutopilotOutput(config)
        self.left: WarmState | None = None  # as the daemon keeps it, once a second
        self.advice: set[str] = set()
        self._next_ns = 0

    def receive(self, datagram: Datagram) -> list[bytes]:
        """Frames that answer a datagram."""
        pipeline, output = self.pipeline, self.output
        messages = pipeline.decode(datagram)
        before, frames = pipeline.autopilot, []
        for published in pipeline.advance(messages):
            frames += [frame for out in output.publish(published) if out.channel == LINK for frame in out.frames]
        if pipeline.autopilot is not None and pipeline.autopilot is not before:
            output.connect(pipeline.autopilot)
        for left in (m for m in messages if isinstance(m, WarmState)):
            output.resume(left)
        if messages and output.is_autopilot(datagram.channel):
            frames += output.respond(datagram.channel, messages, datagram.t_recv_ns).frames
        return frames

    def tick(self, now_ns: int) -> list[bytes]:
        """Frames that are due."""
        offset_ns = self.pipeline.clocks.offset_ns
        boot_ns = None if offset_ns is None else now_ns - offset_ns
        for published in self.pipeline.tick(now_ns):
            list(self.output.publish(published))
        sent = self.output.tick(now_ns, healthy=True, rates=NO_RATES, boot_ns=boot_ns)
        frames = [frame for out in sent if out.channel == LINK for frame in out.frames]
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + NS_PER_S
            kept = self.output.warm_state(now_ns, offset_ns, self.pipeline.clocks.round_trip_ns)
            self.left = kept or self.left
            advice = self.pipeline.health(now_ns).advice
            self.advice |= {a.cause for a in advice if a.cause in SET_UP and a.severity is not Severity.NOTICE}
        return frames


def config_of(scenario: Scenario, settings: Sequence[str] = ()) -> Config:
    """Return the default configuration with the known data of the leader and the output links."""
    kind = "multirotor" if scenario.follower.attitude == "hover" else "fixed_wing"
    known = (
        f"camera.mount_rpy_deg={list(scenario.camera.mount_rpy_deg)}",
        f"estimator.leader.size_prior_m={scenario.leader.size}",
        f"estimator.leader.leader_class={kind}",
        f'leader_out=[{{ link = "{LINK}", rates_hz = {{ SET_POSITION_TARGET_LOCAL_NED = 25.0 }} }}]',
        *(() if scenario.follow is None else (f"guidance.slot_m={list(scenario.follow.offset)}",)),
    )
    return load_config(None, (*known, *settings))


def fly(
    scenario: Scenario,
    seed: int,
    duration: float,
    settings: Sequence[str] = (),
    killed: tuple[float, float] = (math.inf, math.inf),
    detect: Detect | None = None,
) -> Flight:
    """The flight over `duration` s.

    From the first to the second time of `killed` (s) there is no daemon; then it has been started again, with what
    it has left. `detect`: what finds the leader in images, if not simlink.
    """
    run, companion = GuidedRun(scenario, seed, detect), Companion(config_of(scenario, settings))
    row = Row(scenario, seed)
    epoch_ns: int | None = None
    advice: set[str] = set()  # of a daemon that was killed
    on_way: deque[tuple[int, bytes]] = deque()
    rows = []
    for step in range(round(duration * STEPS_PER_S) + 1):
        tick, datagrams = run.step()
        t = step / STEPS_PER_S
        if killed[0] <= t < killed[1]:
            datagrams = []
        if t == killed[1] and epoch_ns is not None:
            left, advice, companion = companion.left, companion.advice, Companion(companion.config)
            if left is not None:
                companion.receive(warm_datagram(left, epoch_ns + tick.t_ns))
        while on_way and on_way[0][0] <= step:
            datagrams += run.receive(on_way.popleft()[1], tick)
        for datagram in datagrams:
            if epoch_ns is None:
                epoch_ns = datagram.t_recv_ns - tick.t_ns
            on_way.extend((step + DELAY_STEPS, frame) for frame in companion.receive(datagram))
        if epoch_ns is not None and step % TIMER_STEPS == 0 and not killed[0] <= t < killed[1]:
            frames = companion.tick(epoch_ns + tick.t_ns)
            on_way.extend((step + DELAY_STEPS, frame) for frame in frames)
        if step % (STEPS_PER_S // ROWS_PER_S) == 0:
            leader = companion.output.leader
            rows.append(row.of(tick, leader is not None and leader.valid, run.mode.is_following))
    return Flight._make([*np.array(rows).T, tuple(sorted(advice | companion.advice))])


class Row:
    """Rows of one flight, made one after the other.

    The slot turns with the leader's path. A leader that backs up keeps its course for TURN_BACK_TIME_S, and a
    hovering leader keeps its last course.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        follow = scenario.follow
        assert follow is not None  # noqa: S101 - GuidedRun raises otherwise
        self._offset, self._begin_ns = follow.offset, boot_time_ns(scenario)
        self._camera, self._size = scenario.camera, true_size(scenario, seed)
        self._mount = mount_quaternion(scenario.camera)
        self._course = math.radians(scenario.leader.course_deg)
        self._back_for = 0.0  # s

    def of(self, tick: Tick, is_valid: bool, is_following: bool) -> tuple[float, ...]:
        """The row of one step."""
        s = tick.state
        speed = math.hypot(s.v_L_n[0], s.v_L_n[1])
        if speed > MIN_COURSE_SPEED_M_S:
            course = math.atan2(s.v_L_n[1], s.v_L_n[0])
            backs = math.cos(course - self._course) < 0.0
            self._back_for = self._back_for + 1.0 / ROWS_PER_S if backs else 0.0
            backs = backs and self._back_for < TURN_BACK_TIME_S
            self._course = course + math.pi if backs else course
        c, n, (x, y, z) = math.cos(self._course), math.sin(self._course), self._offset
        slot = (s.r_OL_n[0] + c * x - n * y, s.r_OL_n[1] + n * x + c * y, s.r_OL_n[2] + z)
        r = np.subtract(s.r_OL_n, s.r_OF_n)
        away = math.atan2(-r[1], -r[0]) - math.atan2(slot[1] - s.r_OL_n[1], slot[0] - s.r_OL_n[0])
        distance = float(np.linalg.norm(r))
        closing = -float(r @ np.subtract(s.v_L_n, s.v_F_n)) / distance
        _, pitch, _ = euler_from_quaternion(s.q_nF)
        return (
            (tick.t_ns - self._begin_ns) * 1e-9,
            distance,
            math.dist(slot, s.r_OF_n),
            math.hypot(s.v_F_n[0], s.v_F_n[1]),
            closing,
            s.a_lat / max(speed, MIN_COURSE_SPEED_M_S),
            float(is_valid),
            float(is_following),
            pitch,
            s.omega_b[1],
            s.r_OF_n[0],
            s.r_OF_n[1],
            float(project(s, self._size, self._camera, self._mount) is not None),
            abs(math.remainder(away, 2.0 * math.pi)),
        )
