"""What a scenario is made of: frozen records. SI throughout; the defaults are the reference formation flight."""

from typing import Annotated, Literal

import msgspec

from onboard.messages import Record, Vec3

MOST_AIRCRAFT = 100  # their MAVLink system numbers end at 255
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Probability = Annotated[float, msgspec.Meta(ge=0, le=1)]
Rate = Annotated[float, msgspec.Meta(ge=0, le=200)]


class Wave(Record, frozen=True, kw_only=True):
    """mean + amplitude sin(2 pi t / period + phase): a profile with a derivative everywhere."""

    mean: float = 0.0
    amplitude: float = 0.0
    period: Positive = 20.0
    phase_deg: float = 0.0


class Pulse(Record, frozen=True, kw_only=True):
    """A raised-cosine bump of height `change` from `start` to `end` (s): out and back, smooth at both ends; for
    `hold` seconds in the middle it stays out."""

    start: NotNegative
    end: Positive
    change: float
    hold: NotNegative = 0.0


class Interval(Record, frozen=True, kw_only=True):
    """From `start` to `end`, in seconds of flight."""

    start: NotNegative
    end: Positive


class GaussMarkov(Record, frozen=True, kw_only=True):
    """An exponentially correlated error: standard deviation (unit in the owner's name), correlation time s."""

    sigma: NotNegative = 0.0
    time: Positive = 10.0


class Leader(Record, frozen=True, kw_only=True):
    """The aircraft ahead: a point mass with a size, a bank and a heading that wobble about coordinated flight.

    `a_lat` is positive to the right, `a_long` positive up and normal to the velocity (m/s^2, Oh & Johnson).
    The size of a run is `size` (1 + size_sigma_percent / 100 N(0, 1)).
    """

    size: Positive = 2.667
    size_sigma_percent: NotNegative = 2.0
    speed: Positive = 21.336
    speed_pulses: tuple[Pulse, ...] = ()
    a_lat: Wave = Wave(mean=2.4384)
    a_long: Wave = Wave()
    course_deg: float = 0.0
    climb_deg: float = 0.0
    yaw_pulses_deg: tuple[Pulse, ...] = ()  # the heading beside the course: a multirotor need not look ahead
    height: float = 100.0
    bank_wobble_deg: GaussMarkov = GaussMarkov(sigma=2.0, time=1.0)
    heading_wobble_deg: GaussMarkov = GaussMarkov(sigma=2.0, time=3.0)


class Follower(Record, frozen=True, kw_only=True):
    """Our vehicle: it keeps a slot in the leader's path axes (forward along the course, right, down; m)."""

    slot: Vec3 = (-27.432, 3.048, 1.524)
    wander: Vec3 = (0.9144, 0.9144, 0.3048)
    wander_period: tuple[Positive, Positive, Positive] = (11.0, 7.0, 5.0)
    slot_pulses: tuple[Pulse, ...] = ()  # added to the forward component
    attitude: Literal["coordinated", "hover"] = "coordinated"  # "hover": nose along the leader's course
    position_gain: Positive = 1.0  # 1/s^2
    velocity_gain: Positive = 2.0  # 1/s


class Camera(Record, frozen=True, kw_only=True):
    """The camera and the vision process behind it. `mount_rpy_deg` ZYX body to camera, [0, 15, 0] looks up."""

    name: str = "front"
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 25.0
    f_px: Positive = 554.256
    width_px: Positive = 640.0
    height_px: Positive = 480.0
    mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)
    mount_offset: Vec3 = (0.0, 0.0, 0.0)
    sigma_px: NotNegative = 1.0
    p_lose: Probability = 0.02  # registered -> not, per image
    p_regain: Probability = 0.38  # not registered -> registered, per image
    latency: NotNegative = 0.02  # s, from exposure to delivery
    stamp_late: NotNegative = 0.0  # s by which stamps are later than the exposure, as if taken on the way
    wrong_blob: Probability = 0.0  # per registered image
    blob_span_px: tuple[Positive, Positive] = (10.0, 150.0)
    blackouts: tuple[Interval, ...] = ()


class Nav(Record, frozen=True, kw_only=True):
    """Errors of the autopilot's own state estimate, per axis, and how old its contents are."""

    attitude_deg: GaussMarkov = GaussMarkov(time=10.0)
    velocity: GaussMarkov = GaussMarkov(time=5.0)
    position: GaussMarkov = GaussMarkov(time=10.0)
    acceleration_white: NotNegative = 0.0  # m/s^2, only in `simlink.flight.fly`
    acceleration_bias: NotNegative = 0.0  # m/s^2, drawn once a run, only in `simlink.flight.fly`
    position_delay: NotNegative = 0.0  # s: LOCAL_POSITION_NED is that much older than its stamp
    attitude_white: Vec3 = (0.0, 0.0, 0.0)  # rad, per message and body axis
    rates_white: NotNegative = 0.0  # rad/s, of the body rates beside the attitude


class Outliers(Record, frozen=True, kw_only=True):
    """Single wrong values: from `start` on (s), each channel of attitude, rates and GPS is at each step off by
    `sigmas` of its white noise with this probability."""

    probability: Probability = 0.0
    sigmas: NotNegative = 20.0
    start: NotNegative = 0.0


class ImuErrors(Record, frozen=True, kw_only=True):
    """White noise per sample and a bias drawn once a run, per axis."""

    accel_white: NotNegative = 0.02  # m/s^2
    gyro_white: NotNegative = 0.002  # rad/s
    accel_bias: NotNegative = 0.0
    gyro_bias: NotNegative = 0.0


class Barometer(Record, frozen=True, kw_only=True):
    """The altitude that a barometer tells, 50 times a second: white noise (m), an offset that drifts (m), and how
    far heights are stretched by air that is not the standard's (share, drawn once a run)."""

    white: NotNegative = 0.15
    drift: GaussMarkov = GaussMarkov(sigma=0.5, time=100.0)
    stretch: NotNegative = 0.02


class Gps(Record, frozen=True, kw_only=True):
    """Raw fixes: correlated and white position error per axis (m), white velocity error (m/s), age at the stamp
    (s), and when there is no fix."""

    position: GaussMarkov = GaussMarkov(sigma=1.0, time=30.0)
    position_white: Vec3 = (0.0, 0.0, 0.0)
    velocity_white: NotNegative = 0.1
    vertical_velocity_white: NotNegative = 0.3  # MAVLink does not carry it; records do
    delay: NotNegative = 0.0
    outages: tuple[Interval, ...] = ()


class Rates(Record, frozen=True, kw_only=True):
    """What the autopilot sends unasked, Hz; 0: only on request."""

    heartbeat: Rate = 1.0
    system_time: Rate = 2.0
    attitude: Rate = 50.0
    local_position: Rate = 50.0
    global_position: Rate = 10.0
    gps: Rate = 5.0
    imu: Rate = 100.0
    servo: Rate = 10.0


class Vehicle(Record, frozen=True, kw_only=True):
    """Who our vehicle says it is on MAVLink. `origin`: WGS-84 degrees and metres, of the local frame.

    A daemon may correct the stamps of an "ardupilot", known to be old (`Nav.position_delay`, `Gps.delay`).
    """

    type: Literal["fixed_wing", "quadrotor"] = "fixed_wing"
    autopilot: Literal["ardupilot", "px4"] = "px4"
    system: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    origin: tuple[float, float, float] = (47.397742, 8.545594, 488.0)
    boot: NotNegative = 40.0  # s on the boot clock when the flight begins
    rates: Rates = Rates()


class QuadrotorFault(Record, frozen=True, kw_only=True):
    """What goes wrong from `at` (s) on: one motor's share of thrust lost (motor 1 to 4, 0: none), and factors on
    all thrusts, on the mass and on the moments of inertia."""

    at: NotNegative = 10.0
    motor: Annotated[int, msgspec.Meta(ge=0, le=4)] = 0
    motor_loss: Probability = 0.0
    inputs: Positive = 1.0
    mass: Positive = 1.0
    inertia: Positive = 1.0


class Gust(Record, frozen=True, kw_only=True):
    """A push of the wind, as acceleration in n (m/s^2), and horizontally what comes and goes about it."""

    when: Interval | None = None
    acceleration: Vec3 = (0.0, 0.0, 0.0)
    wobble: GaussMarkov = GaussMarkov(time=0.5)


class Quadrotor(Record, frozen=True, kw_only=True):
    """The follower as a rigid body under four rotors. Rotors: forward and right of the centre (m), and the sense
    of the torque about b's z axis that its drag gives (+1, -1); `thrust_max` is of one of them (N).

    The defaults are the craft of Al-Shabi, Gadsden and Wilkerson. `path`: a figure eight, or the follower's slot.
    """

    path: Literal["figure_eight", "slot"] = "figure_eight"
    mass: Positive = 0.468
    inertia: tuple[Positive, Positive, Positive] = (4.856e-3, 4.856e-3, 8.801e-3)  # kg m^2
    rotors: tuple[Vec3, Vec3, Vec3, Vec3] = (
        (0.225, 0.0, 1.0),
        (0.0, 0.225, -1.0),
        (-0.225, 0.0, 1.0),
        (0.0, -0.225, -1.0),
    )
    thrust_max: Positive = 3.0
    torque_per_thrust: Positive = 0.03826  # m
    motor_time: Annotated[float, msgspec.Meta(ge=0.005)] = 0.02  # s, lag of a rotor's speed
    drag: NotNegative = 0.1  # 1/s, along b's x and y
    turbulence: GaussMarkov = GaussMarkov(sigma=0.1, time=1.0)  # m/s^2 per axis
    gust: Gust = Gust()
    fault: QuadrotorFault = QuadrotorFault()


class Reports(Record, frozen=True, kw_only=True):
    """What other aircraft say of themselves, per second `rate` times, and how it reaches us: between `latency` s
    late, with drop-outs, with errors of their GNSS (correlated, m, and white) and quantised (m, m/s)."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=50)] = 1.0
    latency: tuple[NotNegative, NotNegative] = (0.2, 0.6)
    p_lose: Probability = 0.05  # received -> not, per report
    p_regain: Probability = 0.5
    position: GaussMarkov = GaussMarkov(sigma=2.5, time=60.0)
    position_white: NotNegative = 1.5
    velocity_white: NotNegative = 0.2
    position_step: NotNegative = 5.1  # of the compact position reports
    altitude_step: NotNegative = 7.62  # 25 feet
    velocity_step: NotNegative = 0.5144  # a knot
    climb_step: NotNegative = 0.3251  # 64 feet a minute


class TrafficRadar(Record, frozen=True, kw_only=True):
    """A phased array on our vehicle (De Vivo et al., Table 4), of `panels` all round. While it is jammed every
    aircraft radiates `jammer_power` (W); while it is lost there is no signal. `glint`: how far (m, each axis, from
    scan to scan) from an aircraft's centre its echo comes; what is seen at all is missed once in a while."""

    name: str = "nose"
    rate: Rate = 10.0
    panels: Annotated[int, msgspec.Meta(ge=3, le=12)] = 3
    range_max: Positive = 6000.0
    cross_section: Positive = 1.0233  # m^2: 0.1 dBsm
    glint: NotNegative = 1.0
    rain_mm_h: NotNegative = 0.0
    p_detect: Probability = 0.9  # of a signal far above the threshold
    false_alarm_probability: Annotated[float, msgspec.Meta(gt=0, lt=0.5)] = 1e-6  # sets the threshold
    false_alarms: NotNegative = 2.0  # on average, per scan
    elevation_deg: Positive = 30.0  # up and down to which there are false alarms
    jammed: tuple[Interval, ...] = ()
    jammer_power: Positive = 15.0
    jammed_false_alarms: NotNegative = 10.0
    lost: tuple[Interval, ...] = ()


class PeerReceiver(Record, frozen=True, kw_only=True):
    """The GNSS receiver of an aircraft that shares its pseudoranges over Zenoh: standard deviations of them (m,
    without multipath) and of their rates (m/s); when only three satellites are in sight, and when none is."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    sigma: Positive = 5.0
    rate_sigma: Positive = 0.1
    masked: tuple[Interval, ...] = ()
    lost: tuple[Interval, ...] = ()


class Aircraft(Record, frozen=True, kw_only=True):
    """One of the others. `start` NED from the origin at time 0, and how much it and the course differ from run to
    run; `a_lat` turns it to the right; `silent_from`: its transponder is switched off then (s)."""

    name: str
    says: Literal["adsb", "peer", "ranges", "nothing"] = "adsb"
    start: Vec3
    start_sigma: NotNegative = 15.0
    speed: Annotated[float, msgspec.Meta(ge=1)] = 30.0
    course_deg: float = 0.0
    course_sigma_deg: NotNegative = 0.5
    climb: float = 0.0
    a_lat: Wave = Wave()
    turbulence: GaussMarkov = GaussMarkov(sigma=0.5, time=5.0)
    silent_from: NotNegative | None = None


class TrafficScene(Record, frozen=True, kw_only=True):
    """All other aircraft but the leader, and the sensors that tell of them."""

    aircraft: tuple[Aircraft, ...] = ()
    adsb: Reports = Reports()
    peer: Reports = Reports(
        rate=5.0,
        latency=(0.02, 0.1),
        p_lose=0.02,
        position=GaussMarkov(sigma=1.5, time=60.0),
        position_white=0.5,
        velocity_white=0.1,
        position_step=0.0,
        altitude_step=0.0,
        velocity_step=0.0,
        climb_step=0.0,
    )
    receiver: PeerReceiver = PeerReceiver()
    radar: TrafficRadar = TrafficRadar()
