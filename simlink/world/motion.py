"""Equations of motion of the two aircraft: the leader's point mass, the follower's slot.

For the leader dcourse/dt = a_lat / (V cos climb) and dclimb/dt = a_long / V, with the speed V a function of time.
The follower accelerates as its slot does, plus proportional and derivative feedback of its position error.

Functions with an argument `maths` work on floats with `math`, step by step, and on whole flights as arrays with
`numpy`.
"""

import math
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, NamedTuple

from onboard.messages import Vec3
from simlink.scenarios.formation import Follower
from simlink.scenarios.profiles import Pulse, Wave
from simlink.scenarios.scenario import Scenario

Row = tuple[float, ...]  # the state of a system
Kinematics = Row  # course, climb, r_L (3), r_F (3), v_F (3)
Real = Any  # a float, or an array of them
Real3 = tuple[Real, Real, Real]


class Derivative(NamedTuple):
    """The derivative of the kinematics, with its velocities and accelerations (m/s, m/s^2)."""

    kinematics: Kinematics
    v_L_n: Vec3
    a_L_n: Vec3
    a_F_n: Vec3
    a_lat: float
    a_long: float


EquationsOfMotion = Callable[[float, Kinematics], Derivative]


def wave(w: Wave, maths: ModuleType = math) -> Callable[[Real], tuple[Real, Real]]:
    """Return (value, derivative) of a Wave as a function of time."""
    mean, amplitude = w.mean, w.amplitude
    omega, phase = 2 * math.pi / w.period, math.radians(w.phase_deg)

    def at(t: Real) -> tuple[Real, Real]:
        if amplitude == 0.0:
            return mean, 0.0
        angle = omega * t + phase
        return mean + amplitude * maths.sin(angle), amplitude * omega * maths.cos(angle)

    return at


def pulses(
    items: Sequence[Pulse], repeat: float, maths: ModuleType = math
) -> Callable[[Real], tuple[Real, Real, Real]]:
    """Return (value, first, second derivative) of the sum of pulses as a function of time.

    It repeats every `repeat` seconds.
    """
    rows = [(p.start, p.end, p.hold, p.change / 2, 2 * math.pi / (p.end - p.start - p.hold)) for p in items]

    def at(t: Real) -> tuple[Real, Real, Real]:
        value = first = second = 0.0
        t = t % repeat
        for start, end, hold, half, omega in rows:
            # comparisons serve as factors, so that t may be an array
            top = t - start - math.pi / omega
            holds = (top > 0.0) * (top < hold)
            angle = omega * (t - start - top * holds - hold * (top >= hold))
            inside = (start <= t) * (t < end)
            s, c = maths.sin(angle), maths.cos(angle)
            value = value + inside * half * (1.0 - c)
            first = first + inside * half * omega * s
            second = second + inside * (1 - holds) * half * omega * omega * c
        return value, first, second

    return at


def slot(
    f: Follower, phases: Real3, repeat: float, maths: ModuleType = math
) -> Callable[[Real], tuple[Real3, Real3, Real3]]:
    """Return position, velocity and acceleration of the slot as a function of time.

    They are in the leader's path axes (forward, right, down).
    """
    (x0, y0, z0), (ax, ay, az), (px, py, pz) = f.slot, f.wander, phases
    wx, wy, wz = (2 * math.pi / period for period in f.wander_period)
    forward = pulses(f.slot_pulses, repeat, maths)

    def at(t: Real) -> tuple[Real3, Real3, Real3]:
        sx, cx = ax * maths.sin(wx * t + px), ax * maths.cos(wx * t + px)
        sy, cy = ay * maths.sin(wy * t + py), ay * maths.cos(wy * t + py)
        sz, cz = az * maths.sin(wz * t + pz), az * maths.cos(wz * t + pz)
        p, dp, ddp = forward(t)
        return (
            (x0 + sx + p, y0 + sy, z0 + sz),
            (wx * cx + dp, wy * cy, wz * cz),
            (ddp - wx * wx * sx, -wy * wy * sy, -wz * wz * sz),
        )

    return at


class SlotMotion(NamedTuple):
    """The slot in n: position, velocity, acceleration."""

    r_n: Real3
    v_n: Real3
    a_n: Real3


class LeaderMotion(NamedTuple):
    """The leader's path rates (rad/s, rad/s^2), and its velocity and acceleration in n."""

    course_rate: Real
    course_rate_dot: Real
    climb_rate: Real
    v_n: Real3
    a_n: Real3
    a_lat: Real
    a_long: Real


def leader_motion(scenario: Scenario, maths: ModuleType = math) -> Callable[[Real, Real, Real], LeaderMotion]:
    """Return the leader's motion as a function of time (s), course and climb angle (rad)."""
    leader = scenario.leader
    cruise, speed_change = leader.speed, pulses(leader.speed_pulses, scenario.repeat, maths)
    lateral, normal = wave(leader.a_lat, maths), wave(leader.a_long, maths)
    turns = pulses(leader.a_lat_pulses, scenario.repeat, maths)
    lifts = pulses(leader.climb_pulses, scenario.repeat, maths)

    def at(t: Real, course: Real, climb: Real) -> LeaderMotion:
        change, dV, _ = speed_change(t)
        V = cruise + change
        (lat, dlat), (long, _) = lateral(t), normal(t)
        turn, dturn, _ = turns(t)
        lift, dlift, _ = lifts(t)
        lat, dlat = lat + turn, dlat + dturn
        cc, sc, cg, sg = maths.cos(course), maths.sin(course), maths.cos(climb), maths.sin(climb)
        along = dV * cg - long * sg
        # `scenario` ensures that it turns only while it moves: at rest the rates are 0, not 0/0
        moving = V + (V == 0.0)
        climb_rate, course_rate = long / moving, lat / (moving * cg)
        return LeaderMotion(
            course_rate,
            dlat / (moving * cg) - course_rate * (dV / moving - climb_rate * sg / cg),
            climb_rate,
            (V * cg * cc, V * cg * sc, -V * sg - lift),
            (along * cc - lat * sc, along * sc + lat * cc, -dV * sg - long * cg - dlift),
            lat,
            long,
        )

    return at


def slot_in_n(
    course: Real, leader: LeaderMotion, r_L: Real3, s: tuple[Real3, Real3, Real3], maths: ModuleType = math
) -> SlotMotion:
    """Return the slot in n from the slot s in path axes.

    The axes rotate about the vertical with the leader's course, so a = a_L + R (s'' + 2 w x s' + w' x s + w x (w x
    s)), w = (0, 0, course rate).
    """
    rate, rate_dot, v_L, a_L = leader.course_rate, leader.course_rate_dot, leader.v_n, leader.a_n
    c, n = maths.cos(course), maths.sin(course)
    (x, y, z), (dx, dy, dz), (ddx, ddy, ddz) = s
    vx, vy = dx - rate * y, dy + rate * x
    ax = ddx - 2 * rate * dy - rate_dot * y - rate * rate * x
    ay = ddy + 2 * rate * dx + rate_dot * x - rate * rate * y
    return SlotMotion(
        (r_L[0] + c * x - n * y, r_L[1] + n * x + c * y, r_L[2] + z),
        (v_L[0] + c * vx - n * vy, v_L[1] + n * vx + c * vy, v_L[2] + dz),
        (a_L[0] + c * ax - n * ay, a_L[1] + n * ax + c * ay, a_L[2] + ddz),
    )


def make_motion(scenario: Scenario, phases: Vec3) -> tuple[EquationsOfMotion, Kinematics]:
    """Return the equations of motion and the initial state, the follower on its slot."""
    leader = scenario.leader
    leader_at = leader_motion(scenario)
    slot_at = slot(scenario.follower, phases, scenario.repeat)
    kp, kd = scenario.follower.position_gain, scenario.follower.velocity_gain

    def leader_and_slot(t: float, course: float, climb: float, r_L: Vec3) -> tuple[SlotMotion, LeaderMotion]:
        m = leader_at(t, course, climb)
        return slot_in_n(course, m, r_L, slot_at(t)), m

    def derivative(t: float, y: Kinematics) -> Derivative:
        course, climb, lx, ly, lz, fx, fy, fz, ux, uy, uz = y
        place, m = leader_and_slot(t, course, climb, (lx, ly, lz))
        (sx, sy, sz), (vx, vy, vz), (ax, ay, az) = place
        a_F = (
            ax + kp * (sx - fx) + kd * (vx - ux),
            ay + kp * (sy - fy) + kd * (vy - uy),
            az + kp * (sz - fz) + kd * (vz - uz),
        )
        dy = (m.course_rate, m.climb_rate, *m.v_n, ux, uy, uz, *a_F)
        return Derivative(dy, m.v_n, m.a_n, a_F, m.a_lat, m.a_long)

    course, climb = math.radians(leader.course_deg), math.radians(leader.climb_deg)
    r_L = (0.0, 0.0, -leader.height)
    start, _ = leader_and_slot(0.0, course, climb, r_L)
    return derivative, (course, climb, *r_L, *start.r_n, *start.v_n)


def advance(f: EquationsOfMotion, t: float, y: Kinematics, first: Derivative, dt: float) -> Kinematics:
    """Return the kinematics one step later; `first` is f(t, y)."""
    return runge_kutta(lambda t, y: f(t, y).kinematics, t, y, first.kinematics, dt)


def runge_kutta(f: Callable[[float, Row], Row], t: float, y: Row, k1: Row, dt: float) -> Row:
    """Advance y' = f(t, y) by one step of the classical Runge-Kutta method; k1 is f(t, y)."""
    h = dt / 2
    k2 = f(t + h, tuple([a + h * b for a, b in zip(y, k1, strict=True)]))
    k3 = f(t + h, tuple([a + h * b for a, b in zip(y, k2, strict=True)]))
    k4 = f(t + dt, tuple([a + dt * b for a, b in zip(y, k3, strict=True)]))
    sixth = dt / 6
    return tuple([a + sixth * (p + 2 * (q + r) + s) for a, p, q, r, s in zip(y, k1, k2, k3, k4, strict=True)])
