"""An airframe's constants from one ordinary flight, by linear least squares.

Commands and motion are compared over 0.6 s, or over five samples where a log holds few: shorter windows show more
of the rounding of commands and of the gyro's noise. The specific force along b's z axis over the sum of squared
commands is thrust over mass; the growth of a body rate over their difference is thrust times arm over a moment of
inertia; the specific force along x and y over velocity is drag.
Sigmas are those of the residuals with their correlation over time (Newey & West 1987).

A flight does not show the mass: it is given. Nor does it show Izz: only the rotors' torque over Izz turns the
vehicle. A flat vehicle's Izz is Ixx + Iyy, which is used, and the torque goes with it.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard import UserError
from onboard.arrays import Array

AVERAGING_WINDOW_S: Final = 0.6
MIN_SAMPLES: Final = 5  # in a window
CORRELATION_TIME_S: Final = 4.0  # of residuals
MAX_GAP_RATIO: Final = 0.5  # of a window, between two of its samples
MIN_LIFT_RATIO: Final = 0.6  # of the median; with less, the ground carries the vehicle
MIN_FLIGHT_TIME_S: Final = 20.0
ACCELEROMETER_BIAS_RATIO: Final = 0.05 / 9.81  # of the weight; along z it looks like thrust


class RecordedFlight(NamedTuple):
    """One flight on one clock.

    IMU: times (n,) s, specific force and rates (n, 3) in b; velocity (n, 3) in b, m/s. Commands: times (k,),
    shares of the range (k, rotors), and the voltage at them (k,), 1 where it is unused."""

    t: Array
    f_b: Array
    omega_b: Array
    v_b: Array
    command_t: Array
    commands: Array
    voltage: Array


class AirframeMeasures(NamedTuple):
    """Measured constants of the airframe, which a flight does not show."""

    mass: float  # kg
    rotors: Array  # (n, 3): places forward and right (m), and the sense of rotation
    motor_time: float  # lag of the motors, s
    full_voltage: float  # V, at which the thrust is wanted; 1 where it is unused


class FittedValue(NamedTuple):
    """A value and its standard deviation."""

    value: float
    sigma: float

    @property
    def share(self) -> float:
        """The sigma over the value; infinite for a value that is not positive."""
        return self.sigma / self.value if self.value > 0 else math.inf


class AirframeFit(NamedTuple):
    """Fitted constants of the airframe."""

    thrust: FittedValue  # N, of one rotor at full command
    drag: FittedValue  # 1/s
    ixx: FittedValue  # kg m^2
    iyy: FittedValue  # kg m^2
    torque_over_izz: FittedValue  # 1/(kg m): torque per thrust over Izz
    hover: float  # the median command
    windows: int  # number of windows that were compared
    window: float  # s, length of each

    @property
    def izz(self) -> float:
        """Izz of a flat vehicle, kg m^2."""
        return self.ixx.value + self.iyy.value


def fit_airframe(flight: RecordedFlight, known: AirframeMeasures) -> AirframeFit:
    """Fit the constants to a flight. Raises UserError if too little of it is in the air."""
    squared = _motor_commands(flight, known.motor_time) ** 2
    squared *= (np.interp(flight.t, flight.command_t, flight.voltage)[:, None] / known.full_voltage) ** 2
    x, right, spin = known.rotors.T
    mixed = squared @ np.column_stack([np.ones(len(x)), -right, x, spin])
    window = max(
        AVERAGING_WINDOW_S, MIN_SAMPLES * max(float(np.median(np.diff(t))) for t in (flight.t, flight.command_t))
    )
    first, last = _windows(flight, mixed[:, 0], window)
    if len(first) * window < MIN_FLIGHT_TIME_S:
        flown_s = len(first) * window
        raise UserError(
            f"the log has {flown_s:.0f} s in the air without gaps; {MIN_FLIGHT_TIME_S:.0f} s are needed"
        )
    span = flight.t[last] - flight.t[first]

    def integral(values: Array) -> Array:
        steps = 0.5 * np.diff(flight.t)[:, None] * (values[1:] + values[:-1])
        return np.vstack([np.zeros(values.shape[1]), np.cumsum(steps, axis=0)])

    def mean(values: Array) -> Array:
        sums = integral(values)
        return np.asarray((sums[last] - sums[first]) / span[:, None])

    inputs, force, velocity = mean(mixed), mean(flight.f_b), mean(flight.v_b)
    p, q, r = flight.omega_b.T
    coupling = np.column_stack([q * r, p * r, p * q])
    turns = _window_slopes(
        flight.t, np.hstack([flight.omega_b, integral(mixed[:, 1:]), integral(coupling)]), first, last
    )
    t = flight.t[first]
    lift = _slope(t, -force[:, 2], inputs[:, :1])
    lift = FittedValue(lift.value, math.hypot(lift.sigma, ACCELEROMETER_BIAS_RATIO * lift.value))
    one, none = np.ones(len(t)), np.zeros(len(t))
    drag = _slope(
        np.concatenate([t, t]),
        -force[:, :2].T.ravel(),
        np.column_stack([velocity[:, :2].T.ravel(), np.concatenate([one, none]), np.concatenate([none, one])]),
    )
    roll, pitch, yaw = (_angular_gain(t, *turns[:, i::3].T) for i in range(3))
    thrust = FittedValue(known.mass * lift.value, known.mass * lift.sigma)
    return AirframeFit(
        thrust,
        drag,
        _ratio(thrust, roll),
        _ratio(thrust, pitch),
        _ratio(yaw, thrust),
        float(np.median(np.sqrt(inputs[:, 0] / len(x)))),
        len(t),
        window,
    )


def _motor_commands(flight: RecordedFlight, lag: float) -> Array:
    """The commands after the motors' lag, at the IMU's times."""
    index = np.clip(np.searchsorted(flight.command_t, flight.t, side="right") - 1, 0, None)
    sampled = flight.commands[index]
    if lag <= 0:
        return sampled
    fading = np.exp(-np.diff(flight.t, prepend=flight.t[0]) / lag)
    followed = sampled.copy()
    for i in range(1, len(sampled)):
        followed[i] = sampled[i] + (followed[i - 1] - sampled[i]) * fading[i]
    return followed


def _windows(flight: RecordedFlight, lift: Array, window: float) -> tuple[Array, Array]:
    """First and last sample of each window in the air without a gap in IMU or commands."""
    t = flight.t
    first = np.searchsorted(t, np.arange(t[0], t[-1] - window, window))
    last = np.searchsorted(t, t[first] + window * 0.999)
    inside = last < len(t)
    first, last = first[inside], last[inside]
    usual = np.median(lift[lift > 0.5 * np.quantile(lift, 0.9)])
    command_age = t - flight.command_t[np.clip(np.searchsorted(flight.command_t, t, side="right") - 1, 0, None)]
    bad = (lift < MIN_LIFT_RATIO * usual) | (np.diff(t, prepend=t[0]) > MAX_GAP_RATIO * window)
    bad |= (command_age < 0) | (command_age > MAX_GAP_RATIO * window)
    count = np.concatenate([[0], np.cumsum(bad)])
    good = count[last + 1] == count[first]
    return first[good], last[good]


def _window_slopes(t: Array, values: Array, first: Array, last: Array) -> Array:
    """Slope (1/s) of values (n, k) in each window, by a line through all its samples.

    A sensor's noise counts less in it than in the difference of two samples."""
    count = (last - first + 1)[:, None]

    def total(each: Array) -> Array:
        sums = np.vstack([np.zeros(each.shape[1]), np.cumsum(each, axis=0)])
        return np.asarray(sums[last + 1] - sums[first])

    at = (t - t[0])[:, None]
    spread = total(at**2) - total(at) ** 2 / count
    return np.asarray((total(at * values) - total(at) * total(values) / count) / spread)


def _angular_gain(t: Array, y: Array, x: Array, coupling: Array) -> FittedValue:
    """The angular acceleration (n,) per unit of `x`.

    Commands are rounded and sampled, and the noise of their differences would make the slope too small. So the
    two windows on either side are the instruments (two-stage least squares)."""
    middle = slice(2, -2)
    others = np.column_stack([coupling[middle], np.ones(len(t) - 4)])
    neighbours = np.column_stack([x[1:-3] + x[3:-1], x[:-4] + x[4:], others])
    instrument = neighbours @ np.linalg.lstsq(neighbours, x[middle], rcond=None)[0]
    X = np.column_stack([x[middle], others])
    return _slope(t[middle], y[middle], X, np.column_stack([instrument, others]))


def _slope(t: Array, y: Array, X: Array, Z: Array | None = None) -> FittedValue:
    """The first coefficient of y = X b with instruments Z, and its sigma.

    Residuals (n,) at the times `t` may be correlated."""
    Z = X if Z is None else Z
    inverse = np.linalg.pinv(Z.T @ X)
    b = inverse @ Z.T @ y
    scores = Z * (y - X @ b)[:, None]
    bins = np.round((t - t.min()) / AVERAGING_WINDOW_S).astype(int)
    series = np.zeros((bins.max() + 1, X.shape[1]))
    np.add.at(series, bins, scores)
    lags = min(round(CORRELATION_TIME_S / AVERAGING_WINDOW_S), len(series) - 1)
    middle = series.T @ series
    for lag in range(1, lags + 1):
        cross = series[lag:].T @ series[:-lag]
        middle += (1 - lag / (lags + 1)) * (cross + cross.T)
    variance = max(float((inverse @ middle @ inverse.T)[0, 0]), 0.0)
    return FittedValue(float(b[0]), math.sqrt(variance))


def _ratio(a: FittedValue, b: FittedValue) -> FittedValue:
    """a / b; of infinite sigma if either is zero."""
    if a.value == 0.0 or b.value == 0.0:
        return FittedValue(0.0, math.inf)
    value = a.value / b.value
    return FittedValue(value, abs(value) * math.hypot(a.sigma / a.value, b.sigma / b.value))
