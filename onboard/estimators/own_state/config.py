"""Configuration `[estimator.own_state]`: its keys, its filters, and the known airframes.

It imports no numerics, so that a configuration is read and checked before anything slow is loaded.
"""

from typing import ClassVar, Final, Literal

from onboard.messages import NotNegative, Positive, Record

Positive3 = tuple[Positive, Positive, Positive]
Rotor = tuple[float, float, Literal[-1, 1]]

# Names of `onboard.filters.methods()`, which a test compares with this list.
FILTERS: Final = (
    *("augmented", "augmented-scaled-1", "csvsf", "csvsf-adaptive", "csvsf-printed", "csvsf-robust", "cubature"),
    *("ensemble", "extended", "gauss-hermite", "imm", "kalman", "posterior-linearisation", "square-root"),
    *("square-root-cubature", "square-root-downdated", "square-root-joseph", "svsf", "svsf-zero-layer"),
    *("unscented", "unscented-considered", "unscented-scaled-0.1", "unscented-scaled-1", "vbl-svsf"),
)


class AirframeConfig(Record, frozen=True, kw_only=True):
    """Constants of a multirotor.

    Each of `rotors` has its place forward and right of the centre (m), and the sign of the torque about b's z axis
    that its drag gives: +1 if it turns counter-clockwise seen from above. A rotor gives no thrust at the first of
    `pwm_us` and `thrust_max_n` at the second; between them thrust grows with the square of the command. With
    `full_voltage_v`, `thrust_max_n` is the thrust at this battery voltage, and grows with its square. Without it,
    the rotors' speed is governed, or the dependence is unknown.
    """

    mass_kg: Positive
    inertia_kg_m2: Positive3
    rotors: tuple[Rotor, ...]
    thrust_max_n: Positive
    torque_per_thrust_m: Positive
    motor_time_s: NotNegative = 0.02
    pwm_us: tuple[float, float] = (1000.0, 2000.0)
    drag_per_s: NotNegative = 0.0
    full_voltage_v: Positive | None = None

    def __post_init__(self) -> None:
        """Raise ValueError for rotors that cannot hold a vehicle, or a PWM range without a width."""
        if len(self.rotors) < 4:
            raise ValueError("an airframe needs at least four rotors")
        if not self.pwm_us[0] < self.pwm_us[1]:
            raise ValueError("pwm_us: the smaller number comes first")


AIRFRAMES: Final = {
    # Al-Shabi, Gadsden & Wilkerson; the rotors' places follow from d_pitch and d_roll, the thrust is simlink's
    "csvsf": AirframeConfig(
        mass_kg=0.468,
        inertia_kg_m2=(4.856e-3, 4.856e-3, 8.801e-3),
        rotors=((0.225, 0.0, 1), (0.0, 0.225, -1), (-0.225, 0.0, 1), (0.0, -0.225, -1)),
        thrust_max_n=3.0,
        torque_per_thrust_m=0.03826,
        drag_per_s=0.1,
        full_voltage_v=12.6,  # simlink's
    ),
    # PX4's Gazebo model x500: motorConstant 8.54858e-06, 1000 rad/s, momentConstant .016; outputs are rad/s
    "x500": AirframeConfig(
        mass_kg=2.064,
        inertia_kg_m2=(0.02166666666666667, 0.02166666666666667, 0.04000000000000001),
        rotors=((0.174, 0.174, 1), (-0.174, -0.174, 1), (0.174, -0.174, -1), (-0.174, 0.174, -1)),
        thrust_max_n=8.54858,
        torque_per_thrust_m=0.016,
        pwm_us=(0.0, 1000.0),
    ),
}


class Config(Record, frozen=True, kw_only=True):
    """Configuration `[estimator.own_state]`. The keys carry their units."""

    filter: str = "csvsf-adaptive"  # one of FILTERS
    airframe: Literal["unknown", "csvsf", "x500", "custom"] = "unknown"
    custom: AirframeConfig | None = None
    force: Literal["accelerometer", "thrust"] = "accelerometer"  # thrust: f_z only, lateral force is estimated
    pressure_rate_hz: NotNegative = 20.0  # rate at which a barometer's altitudes are fused; 0: never
    own_tilt_sigma_deg: NotNegative = 0.3  # constant error of the reported roll and pitch
    own_yaw_sigma_deg: NotNegative = 1.0  # the same of the reported yaw
    publish_rate_hz: Positive = 50.0

    # Withdrawn as keys. The noise of attitudes, rates, turns and a fix's velocity is learnt from their scatter;
    # these hold until it is known. docs/defaults.md has their sources.
    attitude_sigma_deg: ClassVar[tuple[float, float, float]] = (0.573, 0.573, 1.72)  # of one message
    rates_sigma_deg_s: ClassVar[float] = 0.573
    gps_velocity_sigma_m_s: ClassVar[tuple[float, float, float]] = (0.15, 0.15, 0.3)
    pressure_sigma_m: ClassVar[float] = 0.3  # of one altitude of the barometer
    pressure_drift: ClassVar[float] = 0.07  # random walk of its offset, m per square root of a second
    force_noise: ClassVar[float] = 0.005  # of the specific force, m/s^2 per square root of Hz, beside its scatter
    bias_sigma_m_s2: ClassVar[float] = 0.05  # of the accelerometer; with force = "thrust" lateral gusts have 3
    bias_time_s: ClassVar[float] = 50.0  # correlation time of the bias; of gusts 1 s
    layer_sigmas: ClassVar[float] = 5.0  # an innovation beyond this many deviations is a model error or an outlier
    gate_probability: ClassVar[float] = 0.99999  # of filters without a layer
    rewind_horizon_s: ClassVar[float] = 0.5  # older measurements are rejected
    coast_after_s: ClassVar[float] = 0.5  # without a fix: coasting
    validity_timeout_s: ClassVar[float] = 5.0  # without a fix: not valid
    reset_timeout_s: ClassVar[float] = 30.0  # without a fix: forgotten
    silence_s: ClassVar[float] = 0.5  # without an attitude: not valid
    learn_noise: ClassVar[bool] = True
    gps_position_sigma_m: ClassVar[None] = None  # that of the receiver
    turning_noise: ClassVar[None] = None  # depends on the airframe

    def __post_init__(self) -> None:
        """Raise ValueError for contradictory values.

        They are a missing or surplus custom table, or an unknown filter.
        """
        if (self.airframe == "custom") != (self.custom is not None):
            raise ValueError('airframe = "custom" and a table estimator.own_state.custom go together')
        if self.filter not in FILTERS:
            raise ValueError(f"filter: there is none named {self.filter!r}; there are: {', '.join(FILTERS)}")

    def known_airframe(self) -> AirframeConfig | None:
        """Return the airframe's constants; None if they are unknown."""
        return self.custom if self.airframe == "custom" else AIRFRAMES.get(self.airframe)
