"""How the two aircraft move: profiles in time, the leader's point mass, the follower's slot and its control.

Leader: dcourse/dt = a_lat / (V cos climb), dclimb/dt = a_long / V, speed V a function of time. The follower
accelerates exactly as its slot does, plus proportional and derivative terms on what error is left.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from onboard.messages import Vec3
from simlink.scenario import Follower, Pulse, Scenario, Wave

Kinematics = tuple[float, ...]  # course, climb, r_L (3), r_F (3), v_F (3)


class Rates(NamedTuple):
    """What `Derivative` knows at one time: derivative of the kinematics and the quantities behind it."""

    derivative: Kinematics
    v_L_n: Vec3
    a_L_n: Vec3
    a_F_n: Vec3
    a_lat: float
    a_long: float


Derivative = Callable[[float, Kinematics], Rates]


def wave(w: Wave) -> Callable[[float], tuple[float, float]]:
    """(value, derivative) of a Wave as a function of time."""
    mean, amplitude = w.mean, w.amplitude
    omega, phase = 2 * math.pi / w.period, math.radians(w.phase_deg)

    def at(t: float) -> tuple[float, float]:
        if amplitude == 0.0:
            return mean, 0.0
        angle = omega * t + phase
        return mean + amplitude * math.sin(angle), amplitude * omega * math.cos(angle)

    return at


def pulses(items: Sequence[Pulse], repeat: float) -> Callable[[float], tuple[float, float, float]]:
    """(value, first, second derivative) of the sum of pulses, which come again every `repeat` seconds."""
    rows = [(p.start, p.end, p.change / 2, 2 * math.pi / (p.end - p.start)) for p in items]

    def at(t: float) -> tuple[float, float, float]:
        value = first = second = 0.0
        t = t % repeat
        for start, end, half, omega in rows:
            if start <= t < end:
                s, c = math.sin(omega * (t - start)), math.cos(omega * (t - start))
                value += half * (1.0 - c)
                first += half * omega * s
                second += half * omega * omega * c
        return value, first, second

    return at


def slot(f: Follower, phases: Vec3, repeat: float) -> Callable[[float], tuple[Vec3, Vec3, Vec3]]:
    """Place, velocity and acceleration of the slot in the leader's path axes (forward, right, down)."""
    (x0, y0, z0), (ax, ay, az), (px, py, pz) = f.slot, f.wander, phases
    wx, wy, wz = (2 * math.pi / period for period in f.wander_period)
    forward = pulses(f.slot_pulses, repeat)

    def at(t: float) -> tuple[Vec3, Vec3, Vec3]:
        sx, cx = ax * math.sin(wx * t + px), ax * math.cos(wx * t + px)
        sy, cy = ay * math.sin(wy * t + py), ay * math.cos(wy * t + py)
        sz, cz = az * math.sin(wz * t + pz), az * math.cos(wz * t + pz)
        p, dp, ddp = forward(t)
        return (
            (x0 + sx + p, y0 + sy, z0 + sz),
            (wx * cx + dp, wy * cy, wz * cz),
            (ddp - wx * wx * sx, -wy * wy * sy, -wz * wz * sz),
        )

    return at


class SlotMotion(NamedTuple):
    """The slot in n: position, velocity, acceleration."""

    r_n: Vec3
    v_n: Vec3
    a_n: Vec3


def slot_in_n(
    course: float, rate: float, rate_dot: float, r_L: Vec3, v_L: Vec3, a_L: Vec3, s: tuple[Vec3, Vec3, Vec3]
) -> SlotMotion:
    """The slot in n from the slot in path axes, which turn about the vertical with the leader's course:
    a = a_L + R (s'' + 2 w x s' + w' x s + w x (w x s)), w = (0, 0, course rate)."""
    c, n = math.cos(course), math.sin(course)
    (x, y, z), (dx, dy, dz), (ddx, ddy, ddz) = s
    vx, vy = dx - rate * y, dy + rate * x
    ax = ddx - 2 * rate * dy - rate_dot * y - rate * rate * x
    ay = ddy + 2 * rate * dx + rate_dot * x - rate * rate * y
    return SlotMotion(
        (r_L[0] + c * x - n * y, r_L[1] + n * x + c * y, r_L[2] + z),
        (v_L[0] + c * vx - n * vy, v_L[1] + n * vx + c * vy, v_L[2] + dz),
        (a_L[0] + c * ax - n * ay, a_L[1] + n * ax + c * ay, a_L[2] + ddz),
    )


def make_motion(scenario: Scenario, phases: Vec3) -> tuple[Derivative, Kinematics]:
    """The derivative of the kinematics, and where they begin: the follower on its slot, moving with it."""
    leader, repeat = scenario.leader, scenario.repeat
    cruise, speed_change = leader.speed, pulses(leader.speed_pulses, repeat)
    lateral, normal = wave(leader.a_lat), wave(leader.a_long)
    slot_at = slot(scenario.follower, phases, repeat)
    kp, kd = scenario.follower.position_gain, scenario.follower.velocity_gain

    def leader_and_slot(t: float, course: float, climb: float, r_L: Vec3) -> tuple[SlotMotion, Rates]:
        change, dV, _ = speed_change(t)
        V = cruise + change
        (lat, dlat), (long, _) = lateral(t), normal(t)
        cc, sc, cg, sg = math.cos(course), math.sin(course), math.cos(climb), math.sin(climb)
        v_L = (V * cg * cc, V * cg * sc, -V * sg)
        along = dV * cg - long * sg
        a_L = (along * cc - lat * sc, along * sc + lat * cc, -dV * sg - long * cg)
        climb_rate, course_rate = long / V, lat / (V * cg)
        course_rate_dot = dlat / (V * cg) - course_rate * (dV / V - climb_rate * sg / cg)
        place = slot_in_n(course, course_rate, course_rate_dot, r_L, v_L, a_L, slot_at(t))
        return place, Rates((course_rate, climb_rate), v_L, a_L, place.a_n, lat, long)

    def derivative(t: float, y: Kinematics) -> Rates:
        course, climb, lx, ly, lz, fx, fy, fz, ux, uy, uz = y
        place, rates = leader_and_slot(t, course, climb, (lx, ly, lz))
        (sx, sy, sz), (vx, vy, vz), (ax, ay, az) = place
        a_F = (
            ax + kp * (sx - fx) + kd * (vx - ux),
            ay + kp * (sy - fy) + kd * (vy - uy),
            az + kp * (sz - fz) + kd * (vz - uz),
        )
        dy = (*rates.derivative, *rates.v_L_n, ux, uy, uz, *a_F)
        return Rates(dy, rates.v_L_n, rates.a_L_n, a_F, rates.a_lat, rates.a_long)

    course, climb = math.radians(leader.course_deg), math.radians(leader.climb_deg)
    r_L = (0.0, 0.0, -leader.height)
    start, _ = leader_and_slot(0.0, course, climb, r_L)
    return derivative, (course, climb, *r_L, *start.r_n, *start.v_n)


def advance(f: Derivative, t: float, y: Kinematics, first: Rates, dt: float) -> Kinematics:
    """One step of the classical fourth-order Runge-Kutta method; `first` is f(t, y), known already."""
    h = dt / 2
    k1 = first.derivative
    k2 = f(t + h, tuple([a + h * b for a, b in zip(y, k1, strict=True)])).derivative
    k3 = f(t + h, tuple([a + h * b for a, b in zip(y, k2, strict=True)])).derivative
    k4 = f(t + dt, tuple([a + dt * b for a, b in zip(y, k3, strict=True)])).derivative
    sixth = dt / 6
    return tuple([a + sixth * (p + 2 * (q + r) + s) for a, p, q, r, s in zip(y, k1, k2, k3, k4, strict=True)])
