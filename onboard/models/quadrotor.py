"""Quadrotor with twelve states: Al-Shabi, Gadsden & Wilkerson, section 4.

State rows: [x, xd, y, yd, z, zd, phi, p, theta, q, psi, r], local NED, ZYX Euler angles, body rates, SI.
Inputs: [u, d_roll, d_pitch, d_yaw]: thrust along -z of the body in N, two differential thrusts in N, a torque in
N m.

Erratum: eq 4.1 is missing from the paper's text, so equations and parameters are the usual ones for this craft. R
(eq 4.2) reads as twelve numbers when it is split at every comma. Those for the gyros (1e-12) are impossible, so
MEASUREMENT_NOISE has 4e-4 for p, q and r; the exponents of the velocities are assumed.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FLOAT, MAKING, ROWS, kernel, record
from onboard.filters.belief import FilterError

STATE_SIZE: Final = 12
POSITION: Final = (0, 2, 4)
VELOCITY: Final = (1, 3, 5)
ATTITUDE: Final = (6, 8, 10)
RATES: Final = (7, 9, 11)
COMPONENTS: Final = ("x", "xd", "y", "yd", "z", "zd", "phi", "p", "theta", "q", "psi", "r")
INPUTS: Final = ("u", "d_roll", "d_pitch", "d_yaw")

MEASUREMENT_NOISE: Final = 1e-4 * np.diag([8.0, 8, 6, 7, 7, 8, 8, 4, 8, 4, 6, 4])
MEASUREMENT_NOISE.flags.writeable = False


class Airframe(NamedTuple):
    """Constants of a quadrotor.

    Attributes
    ----------
    mass
        kg.
    Ixx, Iyy, Izz, Ir
        Moments of inertia of the craft and of a rotor, kg m^2.
    arm
        Distance of a rotor from the center, m.
    gravity
        m/s^2.
    rotor_speed
        Net speed of the rotors, rad/s; their gyroscopic torque is small and unknown.
    """

    mass: float = 0.468
    Ixx: float = 4.856e-3
    Iyy: float = 4.856e-3
    Izz: float = 8.801e-3
    Ir: float = 3.357e-5
    arm: float = 0.225
    gravity: float = 9.81
    rotor_speed: float = 0.0


PARAMETERS: Final = record(tuple, *(FLOAT,) * len(Airframe._fields))


def process(rows: Array, inputs: Array, dt: float, airframe: Airframe = Airframe()) -> Array:  # noqa: B008 - immutable
    """Return state rows (k, 12) after `dt` seconds of constant `inputs`.

    One explicit Euler step, as in the paper. `inputs` are (4,), or (B, 4) for k a multiple of B: rows then come in
    B equal runs, one for each filter of a batch. Raises FilterError.
    """
    table = np.atleast_2d(inputs)
    if (
        rows.ndim != 2
        or rows.shape[1] != STATE_SIZE
        or table.shape[1] != len(INPUTS)
        or rows.shape[0] % len(table)
    ):
        raise FilterError(f"rows, inputs: must be (k, 12) and (4,) or (B, 4), not {rows.shape} and {inputs.shape}")
    if not (dt > 0 and np.isfinite(dt)):
        raise FilterError(f"dt: must be positive, not {dt}")
    after: Array = _process(rows, table, dt, tuple(map(float, airframe)))
    return after


@kernel((ROWS, ROWS, FLOAT, PARAMETERS), **MAKING)
def _process(rows, inputs, dt, airframe):
    mass, Ixx, Iyy, Izz, Ir, arm, gravity, W = airframe
    after = np.empty(rows.shape)
    run = rows.shape[0] // inputs.shape[0]
    for s in range(rows.shape[0]):
        u, d_roll = inputs[s // run, 0], inputs[s // run, 1]
        d_pitch, d_yaw = inputs[s // run, 2], inputs[s // run, 3]
        phi, p, theta, q, psi, r = rows[s, 6], rows[s, 7], rows[s, 8], rows[s, 9], rows[s, 10], rows[s, 11]
        c_phi, s_phi, c_th, s_th = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
        c_psi, s_psi = np.cos(psi), np.sin(psi)
        lift = u / mass
        turn = q * s_phi + r * c_phi
        after[s, 0] = rows[s, 0] + dt * rows[s, 1]
        after[s, 1] = rows[s, 1] - dt * lift * (c_phi * s_th * c_psi + s_phi * s_psi)
        after[s, 2] = rows[s, 2] + dt * rows[s, 3]
        after[s, 3] = rows[s, 3] - dt * lift * (c_phi * s_th * s_psi - s_phi * c_psi)
        after[s, 4] = rows[s, 4] + dt * rows[s, 5]
        after[s, 5] = rows[s, 5] + dt * (gravity - lift * c_phi * c_th)
        after[s, 6] = phi + dt * (p + turn * s_th / c_th)
        after[s, 7] = p + dt / Ixx * ((Iyy - Izz) * q * r - Ir * q * W + arm * d_roll)
        after[s, 8] = theta + dt * (q * c_phi - r * s_phi)
        after[s, 9] = q + dt / Iyy * ((Izz - Ixx) * p * r + Ir * p * W + arm * d_pitch)
        after[s, 10] = psi + dt * turn / c_th
        after[s, 11] = r + dt / Izz * ((Ixx - Iyy) * p * q + d_yaw)
    return after
