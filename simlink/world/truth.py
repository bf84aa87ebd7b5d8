"""The truth: the states of leader and follower, step by step.

`states` is endless and depends on the scenario and the seed alone. The follower flies coordinated (heading along
its course, pitch along its path, bank atan(a_right / g)), tilts like a hovering multirotor, or is the rigid body
of `simlink.world.quadrotor`. The leader flies coordinated, with errors in bank and heading. Frames are those of
`onboard.geometry`. No filter's model is used here.
"""

import math
from collections.abc import Callable, Iterator
from itertools import tee
from types import ModuleType
from typing import Final, NamedTuple

from onboard.messages import Quaternion, Truth, Vec3
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario
from simlink.world import attitude
from simlink.world.attitude import difference
from simlink.world.constants import DT, GRAVITY, STEPS_PER_SECOND
from simlink.world.motion import Derivative, Kinematics, Real, Real3, advance, make_motion, pulses
from simlink.world.noise import gauss_markov, normals, uniforms
from simlink.world.quadrotor import quadrotor_states
from simlink.world.quadrotor_control import Pilot, Reference, figure_eight

NO_ROTATION: Final[Vec3] = (0.0, 0.0, 0.0)


class State(NamedTuple):
    """The world after `step` steps of 5 ms, in SI units; n is NED at the scenario's origin O."""

    step: int
    t: float
    r_OL_n: Vec3
    v_L_n: Vec3
    a_L_n: Vec3
    q_nL: Quaternion
    a_lat: float
    a_long: float
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    q_nF: Quaternion
    omega_b: Vec3  # mean body rate over the step that ends here; zero at the first
    f_b: Vec3  # specific force R_bn (a_F_n - g_n)
    pwm_us: tuple[int, ...] | None = None  # commands to a quadrotor's motors
    fault: str = ""  # the active faults of the follower
    voltage_v: float | None = None  # of a quadrotor's battery
    others: tuple["Motion", ...] = ()  # further aircraft that the camera sees


class Motion(NamedTuple):
    """The true motion of a vehicle: position, velocity, acceleration in n, attitude, body rates."""

    r_n: Vec3
    v_n: Vec3
    a_n: Vec3
    q_nb: Quaternion
    omega_b: Vec3


def make_state(
    step: int, t: float, leader: Motion, follower: Motion, across: tuple[float, float] | None = None
) -> State:
    """Return the world of two vehicles after `step` steps, at `t` s.

    `across` holds the leader's a_lat and a_long if they do not follow from its motion.
    """
    a_lat, a_long = across or path_accelerations(leader.v_n, leader.a_n)
    a_F = follower.a_n
    return State(
        step=step,
        t=t,
        r_OL_n=leader.r_n,
        v_L_n=leader.v_n,
        a_L_n=leader.a_n,
        q_nL=leader.q_nb,
        a_lat=a_lat,
        a_long=a_long,
        r_OF_n=follower.r_n,
        v_F_n=follower.v_n,
        a_F_n=a_F,
        q_nF=follower.q_nb,
        omega_b=follower.omega_b,
        f_b=attitude.to_b(follower.q_nb, (a_F[0], a_F[1], a_F[2] - GRAVITY)),
    )


def path_accelerations(v_n: Vec3, a_n: Vec3) -> tuple[float, float]:
    """Return Oh & Johnson's a_lat (right) and a_long (up, normal to v); 0 without horizontal speed."""
    horizontal, speed = math.hypot(v_n[0], v_n[1]), math.hypot(*v_n)
    if horizontal == 0.0:
        return 0.0, 0.0
    along = (a_n[0] * v_n[0] + a_n[1] * v_n[1]) / horizontal
    climb = (v_n[2] * along - horizontal * a_n[2]) / speed
    return (a_n[1] * v_n[0] - a_n[0] * v_n[1]) / horizontal, climb


def true_size(scenario: Scenario, seed: int) -> float:
    """Return the leader's true size in this run, m: the nominal size with its random error."""
    sigma = scenario.leader.size_sigma_percent / 100
    return scenario.leader.size * (1.0 + sigma * next(normals(seed, "leader.size")))


def states(scenario: Scenario, seed: int, pilot: Pilot | None = None) -> Iterator[State]:
    """Yield the world, 200 states per second of flight, without end.

    `pilot` flies the craft of `[follow]`; its references are the scenario's slot, with the nose along the leader's
    course.
    """
    formation = _formation(scenario, seed)
    if pilot is not None and scenario.follow is not None:
        formation, slots = tee(formation)
        return _with_quadrotor(scenario.follow.craft, seed, formation, map(_as_slot, slots), pilot)
    if scenario.quadrotor is None:
        return formation
    if scenario.quadrotor.path == "figure_eight":
        return _with_quadrotor(scenario.quadrotor, seed, formation, figure_eight(seed, DT))
    formation, slots = tee(formation)
    return _with_quadrotor(scenario.quadrotor, seed, formation, map(_as_reference, slots))


def _with_quadrotor(
    craft: Quadrotor,
    seed: int,
    formation: Iterator[State],
    path: Iterator[Reference],
    pilot: Pilot | None = None,
) -> Iterator[State]:
    """Yield the same world with a quadrotor on a path as follower."""
    q_before = None
    for state, m in zip(formation, quadrotor_states(craft, seed, path, DT, pilot), strict=True):
        yield state._replace(
            r_OF_n=m.r_n,
            v_F_n=m.v_n,
            a_F_n=m.a_n,
            q_nF=m.q_nb,
            omega_b=body_rate(q_before, m.q_nb),
            f_b=m.f_b,
            pwm_us=m.pwm_us,
            fault=m.fault,
            voltage_v=m.voltage_v,
        )
        q_before = m.q_nb


def _as_slot(state: State) -> Reference:
    """Return the follower's motion as a reference for the quadrotor, with the follower's heading."""
    w, x, y, z = state.q_nF
    return Reference(
        state.r_OF_n, state.v_F_n, state.a_F_n, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    )


def _as_reference(state: State) -> Reference:
    """Return the follower's motion as a reference for the quadrotor, with the nose along its course."""
    course = math.atan2(state.v_F_n[1], state.v_F_n[0])
    return Reference(state.r_OF_n, state.v_F_n, state.a_F_n, course)


def _formation(scenario: Scenario, seed: int) -> Iterator[State]:
    """Yield leader and follower as point masses with an attitude."""
    phase = uniforms(seed, "follower.wander")
    turn = 2 * math.pi
    f, y = make_motion(scenario, (turn * next(phase), turn * next(phase), turn * next(phase)))
    leader_attitude = leader_attitudes(scenario, seed)
    hovers = scenario.follower.attitude == "hover"
    step, q_before = 0, None
    while True:
        t = step / STEPS_PER_SECOND
        rates = f(t, y)
        r_F_n, v_F_n = (y[5], y[6], y[7]), (y[8], y[9], y[10])
        q_nF = hovering_attitude(rates.a_F_n, y[0]) if hovers else coordinated_attitude(v_F_n, rates.a_F_n)
        q_nL = leader_attitude(t, y, rates)
        leader = Motion((y[2], y[3], y[4]), rates.v_L_n, rates.a_L_n, q_nL, NO_ROTATION)
        follower = Motion(r_F_n, v_F_n, rates.a_F_n, q_nF, body_rate(q_before, q_nF))
        yield make_state(step, t, leader, follower, (rates.a_lat, rates.a_long))
        y = advance(f, t, y, rates, DT)
        step, q_before = step + 1, q_nF


def leader_attitudes(scenario: Scenario, seed: int) -> Callable[[float, Kinematics, Derivative], Quaternion]:
    """Return a function that gives the leader's attitude; call it once per step, in order."""
    bank, heading = _wobbles(scenario, seed)
    yaw_at = pulses(scenario.leader.yaw_pulses_deg, scenario.repeat)

    def at(t: float, y: Kinematics, rates: Derivative) -> Quaternion:
        return _leader_attitude(y[0], y[1], rates, next(bank), next(heading) + math.radians(yaw_at(t)[0]))

    return at


def _wobbles(scenario: Scenario, seed: int) -> tuple[Iterator[float], Iterator[float]]:
    """Return the leader's bank and heading errors, rad, one per step."""
    b, h = scenario.leader.bank_wobble_deg, scenario.leader.heading_wobble_deg
    return (
        gauss_markov(normals(seed, "leader.bank"), b, DT, math.pi / 180),
        gauss_markov(normals(seed, "leader.heading"), h, DT, math.pi / 180),
    )


def _leader_attitude(
    course: float, climb: float, rates: Derivative, bank_error: float, heading_error: float
) -> Quaternion:
    return attitude.from_euler(math.atan(rates.a_lat / GRAVITY) + bank_error, climb, course + heading_error)


def coordinated_attitude(v_n: Vec3, a_n: Vec3) -> Quaternion:
    """Return q_nb of coordinated flight.

    Heading is along the course, pitch along the path, bank atan(a_right / g).
    """
    return attitude.from_euler(*coordinated_angles(v_n, a_n))


def coordinated_angles(v_n: Real3, a_n: Real3, maths: ModuleType = math) -> Real3:
    """Return roll, pitch and yaw of coordinated flight, rad."""
    horizontal = maths.hypot(v_n[0], v_n[1])
    right = (a_n[1] * v_n[0] - a_n[0] * v_n[1]) / (horizontal + (horizontal == 0.0))
    return maths.atan(right / GRAVITY), maths.atan2(-v_n[2], horizontal), maths.atan2(v_n[1], v_n[0])


def hovering_attitude(a_n: Vec3, yaw: float) -> Quaternion:
    """Return q_nb of a multirotor with this heading (rad), tilted for this acceleration."""
    return attitude.from_euler(*hovering_angles(a_n, yaw))


def hovering_angles(a_n: Real3, yaw: Real, maths: ModuleType = math) -> Real3:
    """Return roll, pitch and yaw of `hovering_attitude`, rad."""
    c, s = maths.cos(yaw), maths.sin(yaw)
    forward, right, up = c * a_n[0] + s * a_n[1], c * a_n[1] - s * a_n[0], GRAVITY - a_n[2]
    return maths.atan2(right, maths.hypot(forward, up)), maths.atan2(-forward, up), yaw


def body_rate(q_before: Quaternion | None, q_now: Quaternion) -> Vec3:
    """Return the mean body rate over one step, rad/s in b, as an integrating gyro gives it.

    It is 0 at the first step.
    """
    if q_before is None:
        return NO_ROTATION
    x, y, z = attitude.to_vector(attitude.product(attitude.conjugate(q_before), q_now))
    return x * STEPS_PER_SECOND, y * STEPS_PER_SECOND, z * STEPS_PER_SECOND


def truth_record(s: State, size: float, t_ns: int) -> Truth:
    """Return the record of the truth to publish at boot time `t_ns`."""
    return Truth(
        t_ns=t_ns,
        r_FL_n=difference(s.r_OL_n, s.r_OF_n),
        v_FL_n=difference(s.v_L_n, s.v_F_n),
        size=size,
        a_lat=s.a_lat,
        a_long=s.a_long,
        r_OF_n=s.r_OF_n,
        v_F_n=s.v_F_n,
        a_F_n=s.a_F_n,
        q_nF=s.q_nF,
        r_OL_n=s.r_OL_n,
        q_nL=s.q_nL,
        omega_b=s.omega_b,
        fault=s.fault,
    )
