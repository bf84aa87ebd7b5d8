"""`[estimator.traffic]`: the keys of its section, with their units."""

from typing import Annotated

import msgspec

from onboard.estimators.traffic.filter import FilterName
from onboard.messages import NotNegative, Positive, Record, Vec3

Probability = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Share = Annotated[float, msgspec.Meta(gt=0, le=1)]
Rate = Annotated[float, msgspec.Meta(gt=0, le=50)]
Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
IcaoAddress = Annotated[str, msgspec.Meta(pattern="^([0-9a-fA-F]{6})?$")]


class Config(Record, frozen=True, kw_only=True):
    """`[estimator.traffic]`."""

    filter: FilterName = "imm"
    publish_hz: Rate = 10.0  # estimates of each track
    max_tracks: Annotated[int, msgspec.Meta(ge=1, le=10_000)] = 1000
    own_icao: IcaoAddress = ""  # of our own transponder, six hexadecimal digits: it is no traffic

    # ADS-B and other vehicles' GLOBAL_POSITION_INT: how old when received, how noisy, how steadily off
    adsb_latency_s: NotNegative = 0.4
    adsb_latency_sigma_s: NotNegative = 0.15
    adsb_position_sigma_m: Positive = 3.0
    adsb_altitude_sigma_m: Positive = 4.0
    adsb_velocity_sigma_m_s: Positive = 0.5
    max_tslc_s: NotNegative = 5.0  # reports of aircraft not heard for longer are stale
    peer_latency_s: NotNegative = 0.05
    peer_latency_sigma_s: NotNegative = 0.03
    peer_position_sigma_m: Positive = 2.0
    peer_velocity_sigma_m_s: Positive = 0.3
    gnss_range_sigma_m: Positive = 5.0  # of others' pseudoranges that do not say it, and of their rates
    gnss_rate_sigma_m_s: Positive = 0.1
    gnss_bias_m: Positive = 2.0  # how far fixes of pseudoranges are steadily off, ours with them
    report_bias_m: Positive = 4.0  # horizontally: how far reported positions are steadily off, ours with them
    report_bias_altitude_m: Positive = 10.0
    peer_bias_m: Positive = 3.0  # the same of other vehicles, on each axis
    report_bias_time_s: Positive = 60.0  # for how long
    geoid_undulation_m: float = 0.0  # of the ellipsoid here: mean sea level = GNSS height - this
    pressure_altitude_offset_m: float = 0.0  # mean sea level = reported pressure altitude + this

    # radar on our vehicle; standard deviations where a detection brings none
    radar_mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)  # body to radar, ZYX, as a camera's
    radar_offset_m: Vec3 = (0.0, 0.0, 0.0)  # from the vehicle's position, body FRD
    radar_range_sigma_m: Positive = 10.0
    radar_azimuth_sigma_deg: Positive = 0.5
    radar_elevation_sigma_deg: Positive = 0.5
    radar_glint_m: NotNegative = 1.0  # how far from an aircraft's centre its echo comes

    # how well our own autopilot knows its attitude and position, for how long each errs the same way; its velocity
    own_yaw_sigma_deg: NotNegative = 1.0
    own_tilt_sigma_deg: NotNegative = 0.5
    own_attitude_time_s: Positive = 10.0
    own_position_sigma_m: NotNegative = 1.0
    own_position_time_s: Positive = 60.0
    own_velocity_sigma_m_s: NotNegative = 0.1

    # how aircraft move: gusts; accelerations and their time constants. The mixture (imm) has a quiet mode and one
    # in which the turn changes, both of which keep the turn they are in, and one that manoeuvres; other filters
    # have the last only. An aircraft stays in each for so long on average, before it passes to one of the others
    gust_m_s: NotNegative = 0.5
    gust_vertical_m_s: NotNegative = 0.25
    gust_time_s: Positive = 5.0
    quiet_acceleration_m_s2: Positive = 0.5
    quiet_time_s: Positive = 170.0  # a turn that is kept does not fade
    quiet_lasts_s: Positive = 50.0
    changing_acceleration_m_s2: Positive = 1.5
    changing_time_s: Positive = 20.0
    changing_lasts_s: Positive = 15.0
    manoeuvre_acceleration_m_s2: Positive = 2.5
    manoeuvre_time_s: Positive = 8.0
    manoeuvre_lasts_s: Positive = 5.0
    vertical_share: Share = 0.5  # vertical accelerations, of these, which are horizontal
    max_speed_m_s: Positive = 350.0  # nothing is faster: of jumps, and of what is said
    initial_speed_sigma_m_s: Positive = 40.0  # of a track begun by radar alone

    # tracks
    gate_probability: Probability = 0.999  # that a measurement passes which is of the track
    confirm_hits: Count = 6  # echoes that make a track ...
    confirm_window: Annotated[int, msgspec.Meta(ge=1, le=60)] = 10  # ... among so many scans
    relock_after_s: NotNegative = 2.0  # coasting for longer, a track is seen again only by as many echoes
    coast_after_s: NotNegative = 3.0  # without a measurement: coasting
    validity_timeout_s: NotNegative = 10.0  # lost, not valid
    forget_after_s: NotNegative = 30.0  # forgotten
    late_horizon_s: NotNegative = 8.0  # older measurements are rejected

    # what is too near
    threat_distance_m: Positive = 150.0
    threat_time_s: Positive = 60.0
