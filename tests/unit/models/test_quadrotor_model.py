"""The quadrotor against mechanics by hand, its reference flight, and how the filters fare on it."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import methods
from onboard.filters.belief import FilterError
from onboard.models import quadrotor
from onboard.models.quadrotor import Airframe
from studies.csvsf_quadrotor import reference_flight
from studies.csvsf_quadrotor.reference_flight import DT, as_commanded, fly, weak_inputs, weak_motor

AIR = Airframe()
HOVER = np.array([AIR.mass * AIR.gravity, 0.0, 0.0, 0.0])


def rate(state: dict[str, float], inputs: Array, airframe: Airframe = AIR) -> dict[str, float]:
    """The derivative of a state, by names."""
    row = np.array([[state.get(name, 0.0) for name in quadrotor.COMPONENTS]])
    after = quadrotor.process(row, inputs, 1.0, airframe)
    return dict(zip(quadrotor.COMPONENTS, (after - row)[0], strict=True))


def test_hovers() -> None:
    assert max(map(abs, rate({}, HOVER).values())) < 1e-14


def test_thrust_is_along_the_body_s_z_axis_seed_1() -> None:
    """Against the rotation matrix of ZYX Euler angles, made of three factors."""
    for phi, theta, psi in np.random.default_rng(1).uniform(-1.2, 1.2, (20, 3)):
        expected = np.array([0, 0, 9.81]) - 7.0 / AIR.mass * matrix(phi, theta, psi)[:, 2]
        d = rate({"phi": phi, "theta": theta, "psi": psi}, np.array([7.0, 0, 0, 0]))
        np.testing.assert_allclose([d["xd"], d["yd"], d["zd"]], expected, atol=1e-12)


def test_body_rates_turn_the_attitude_seed_2() -> None:
    """R_dot = R [w]x, by a small step of the matrix."""
    for phi, theta, psi, *w in np.random.default_rng(2).uniform(-1, 1, (20, 6)):
        d = rate({"phi": phi, "theta": theta, "psi": psi, "p": w[0], "q": w[1], "r": w[2]}, HOVER)
        step = 1e-6
        skew = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        rotated = matrix(phi, theta, psi) @ (np.eye(3) + step * skew)
        moved = matrix(phi + step * d["phi"], theta + step * d["theta"], psi + step * d["psi"])
        np.testing.assert_allclose(moved, rotated, atol=2e-11)


def matrix(phi: float, theta: float, psi: float) -> Array:
    c, s = np.cos, np.sin
    Rz = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    Ry = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    Rx = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    return np.asarray(Rz @ Ry @ Rx)


def test_euler_s_equations_with_the_rotors_as_a_gyroscope_seed_3() -> None:
    """I w_dot = torque - w x (I w + h), h the rotors' momentum along z. The usual equations have h = -Ir W."""
    air = AIR._replace(rotor_speed=300.0)
    inertia = np.diag([air.Ixx, air.Iyy, air.Izz])
    for w in np.random.default_rng(3).uniform(-2, 2, (10, 3)):
        torque = np.array([air.arm * 0.3, air.arm * -0.2, 0.01])
        momentum = inertia @ w + np.array([0, 0, air.Ir * air.rotor_speed])
        expected = np.linalg.solve(inertia, torque - np.cross(w, momentum))
        d = rate({"p": w[0], "q": w[1], "r": w[2]}, np.array([4.0, 0.3, -0.2, 0.01]), air)
        np.testing.assert_allclose([d["p"], d["q"], d["r"]], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("rows", "inputs", "dt", "name"),
    [
        (np.zeros((2, 11)), HOVER, 0.1, "rows"),
        (np.zeros((2, 12)), HOVER[:3], 0.1, "inputs"),
        (np.zeros((2, 12)), np.zeros((3, 4)), 0.1, "inputs"),
        (np.zeros((2, 12)), HOVER, 0.0, "dt"),
        (np.zeros((2, 12)), HOVER, float("nan"), "dt"),
    ],
)
def test_unusable_arguments_are_refused_by_name(rows: Array, inputs: Array, dt: float, name: str) -> None:
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        quadrotor.process(rows, inputs, dt)


# ------------------------------------------------------------------------------------- the reference flight


def generators(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(count)]


@pytest.mark.parametrize("actuation", [as_commanded, weak_inputs, weak_motor])
def test_flies_the_path_seeds_0_to_3(actuation: Callable[[float, Array], Array]) -> None:
    flight = fly(generators(4), actuation=actuation)
    path = reference_flight.draw_path(generators(4))
    wanted = np.array([reference_flight.along(path, k * DT)[0] for k in range(2001)])
    error = np.linalg.norm(flight.states[:, :, quadrotor.POSITION] - wanted, axis=2)
    assert error[:1000].max() < 0.6
    assert error[1000:].max() < 1.5
    assert np.abs(flight.states[:, :, [6, 8]]).max() < 0.8


def test_a_weak_motor_loses_a_quarter_of_its_share() -> None:
    inputs = np.array([[4.0, 0.1, 0.2, 0.01]])
    np.testing.assert_array_equal(weak_motor(9.99, inputs), inputs)
    loss = 0.25 * (4.0 / 4 + 0.2 / 2 + 0.01 / (4 * 0.03826))
    np.testing.assert_allclose(weak_motor(10.0, inputs), [[4 - loss, 0.1, 0.2 - loss, 0.01 - 0.03826 * loss]])


# ------------------------------------------------------------------------------------- the filters on it


@cache
def flown(actuation: Callable[[float, Array], Array], outliers: float) -> tuple[reference_flight.Flight, Array]:
    """8 flights, simulated once for all filters, and where these begin."""
    makers = generators(8)
    flight = fly(makers, actuation=actuation, outliers=outliers)
    sigma = 2 * np.sqrt(np.diag(quadrotor.MEASUREMENT_NOISE))
    return flight, flight.states[0] + np.stack([sigma * g.standard_normal(12) for g in makers])


def velocity_rmse(
    name: str,
    actuation: Callable[[float, Array], Array],
    outliers: float,
    factor: float = 1.0,
    columns: tuple[int, ...] = quadrotor.VELOCITY,
) -> float:
    """The reference table's figure, on 8 of its 60 flights: metres a second over 10-20 s."""
    method = methods()[name]
    flight, x0 = flown(actuation, outliers)
    R, Q = np.array(quadrotor.MEASUREMENT_NOISE), reference_flight.process_noise()
    inflated = [*quadrotor.VELOCITY, *quadrotor.RATES]
    Q[inflated, inflated] *= factor
    state, errors = method.start(x0, np.tile(4 * R, (8, 1, 1))), []
    for k, inputs in enumerate(flight.inputs):
        state = method.predict(state, lambda rows, u=inputs: quadrotor.process(rows, u, DT), Q)
        state = method.update(state, flight.measurements[k], lambda rows: rows, R, ()).belief
        if k >= 1000:
            errors.append(method.belief(state).mean - flight.states[k + 1])
    squared = np.square(np.array(errors)[:, :, columns])
    return float(np.sqrt(squared.sum(axis=2).mean()))


@pytest.mark.parametrize(
    ("name", "none", "weak", "motor", "outliers"),
    [
        ("cubature", 0.0129, 0.574, 0.113, 0.031),
        pytest.param("svsf-zero-layer", 0.048, 0.048, 0.048, 0.145, marks=pytest.mark.slow),
        pytest.param("csvsf-printed", 0.034, 0.040, 0.034, 0.092, marks=pytest.mark.slow),
        pytest.param("csvsf", 0.0129, 0.083, 0.065, 0.140, marks=pytest.mark.slow),
        ("csvsf-robust", 0.0129, 0.126, 0.107, 0.0138),
    ],
)
def test_the_reference_table_within_8_percent_seeds_0_to_7(
    name: str, none: float, weak: float, motor: float, outliers: float
) -> None:
    """Independent figures of 60 seeds each."""
    assert velocity_rmse(name, as_commanded, 0.0) == pytest.approx(none, rel=0.08)
    assert velocity_rmse(name, weak_inputs, 0.0) == pytest.approx(weak, rel=0.08)
    assert velocity_rmse(name, weak_motor, 0.0) == pytest.approx(motor, rel=0.08)
    assert velocity_rmse(name, as_commanded, 0.02) == pytest.approx(outliers, rel=0.08)
