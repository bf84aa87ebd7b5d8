"""Configuration `[estimator.traffic]`: the keys of its section, with their units."""

from typing import Annotated, ClassVar, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3

FilterName = Literal["kf", "ekf", "ukf", "srukf", "imm"]
Rate = Annotated[float, msgspec.Meta(gt=0, le=50)]
Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
IcaoAddress = Annotated[str, msgspec.Meta(pattern="^([0-9a-fA-F]{6})?$")]


class Config(Record, frozen=True, kw_only=True):
    """Configuration `[estimator.traffic]`.

    Its constants are the properties of aircraft, of their reports and of the tracker. docs/defaults.md has their
    sources. A fleet's aircraft differ more than any one value could be adapted to.
    """

    filter: FilterName = "imm"
    publish_hz: Rate = 10.0  # estimates of each track
    max_tracks: ClassVar[int] = 1000  # bounds the memory and time that a flood of reports or echoes takes
    max_reported: Count = 200  # of these, tracks started by reports; the most distant gives way to a nearer one
    own_icao: IcaoAddress = ""  # address of our own transponder, six hexadecimal digits: its reports are ignored

    # ADS-B and other vehicles' GLOBAL_POSITION_INT: age on reception, noise, and steady error
    adsb_latency_s: NotNegative = 0.4
    adsb_latency_sigma_s: NotNegative = 0.15
    adsb_position_sigma_m: ClassVar[float] = 3.0
    adsb_altitude_sigma_m: ClassVar[float] = 4.0
    adsb_velocity_sigma_m_s: ClassVar[float] = 0.5
    max_tslc_s: ClassVar[float] = 5.0  # a report whose last communication (`tslc`) is older is stale
    peer_latency_s: ClassVar[float] = 0.05
    peer_latency_sigma_s: ClassVar[float] = 0.03
    peer_position_sigma_m: ClassVar[float] = 2.0
    peer_velocity_sigma_m_s: ClassVar[float] = 0.3
    gnss_range_sigma_m: ClassVar[float] = 5.0  # pseudoranges that bring no standard deviation, and their rates
    gnss_rate_sigma_m_s: ClassVar[float] = 0.1
    gnss_bias_m: ClassVar[float] = 2.0  # steady error of fixes by pseudoranges, relative to our own position
    report_bias_m: ClassVar[float] = 4.0  # steady error of reported positions relative to ours, horizontal
    report_bias_altitude_m: Positive = 10.0
    peer_bias_m: ClassVar[float] = 3.0  # the same for other vehicles, on each axis
    report_bias_time_s: ClassVar[float] = 60.0  # time constant of these errors
    geoid_undulation_m: float = 0.0  # of the ellipsoid here: mean sea level = GNSS height - this
    pressure_altitude_offset_m: float = 0.0  # mean sea level = reported pressure altitude + this; 0: not known

    # radar on our vehicle; standard deviations where a detection brings none
    radar_mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)  # body to radar, ZYX, as a camera's
    radar_offset_m: Vec3 = (0.0, 0.0, 0.0)  # from the vehicle's position, body FRD
    radar_range_sigma_m: Positive = 10.0
    radar_azimuth_sigma_deg: Positive = 0.5
    radar_elevation_sigma_deg: Positive = 0.5
    radar_glint_m: ClassVar[float] = 1.0  # distance of an echo's origin from the aircraft's center

    # Errors of our own autopilot's attitude and position, with their time constants, and of its velocity. A radar
    # has no camera mount, and far aircraft show errors of the attitude that last seconds.
    own_yaw_sigma_deg: NotNegative = 1.0
    own_tilt_sigma_deg: ClassVar[float] = 0.5
    own_attitude_time_s: ClassVar[float] = 10.0
    own_position_sigma_m: NotNegative = 1.0
    own_position_time_s: ClassVar[float] = 60.0
    own_velocity_sigma_m_s: NotNegative = 0.1

    # how aircraft move: gusts; accelerations and their time constants. The mixture (imm) has three modes: a quiet
    # one and one with a changing turn, which both keep the current turn, and one that manoeuvres. The other
    # filters have only the last one. `*_lasts_s`: mean time in a mode before it changes to another
    gust_m_s: ClassVar[float] = 0.5
    gust_vertical_m_s: ClassVar[float] = 0.25
    gust_time_s: ClassVar[float] = 5.0
    quiet_acceleration_m_s2: ClassVar[float] = 0.5
    quiet_time_s: ClassVar[float] = 170.0  # long: a turn that is kept does not decay
    quiet_lasts_s: ClassVar[float] = 50.0
    changing_acceleration_m_s2: ClassVar[float] = 1.5
    changing_time_s: ClassVar[float] = 20.0
    changing_lasts_s: ClassVar[float] = 15.0
    manoeuvre_acceleration_m_s2: ClassVar[float] = 2.5
    manoeuvre_time_s: ClassVar[float] = 8.0
    manoeuvre_lasts_s: ClassVar[float] = 5.0
    vertical_share: ClassVar[float] = 0.5  # vertical accelerations as a share of these, which are horizontal
    max_speed_m_s: ClassVar[float] = 350.0  # reports and jumps that are faster are implausible
    initial_speed_sigma_m_s: ClassVar[float] = 40.0  # of a track that begins with an echo

    # tracks
    gate_probability: ClassVar[float] = 0.999  # that a track's own measurement passes the gate
    confirm_hits: ClassVar[int] = 6  # echoes that confirm a track ...
    confirm_window: ClassVar[int] = 10  # ... within so many scans
    relock_after_s: ClassVar[float] = 2.0  # after coasting for longer, a track needs as many echoes again
    coast_after_s: ClassVar[float] = 3.0  # without a measurement: coasting
    validity_timeout_s: ClassVar[float] = 10.0  # lost, not valid
    forget_after_s: ClassVar[float] = 30.0  # removed
    late_horizon_s: ClassVar[float] = 8.0  # older measurements are rejected

    # threats
    threat_distance_m: Positive = 150.0
    threat_time_s: Positive = 60.0
