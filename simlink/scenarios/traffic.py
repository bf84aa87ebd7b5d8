"""Other aircraft in a scenario: how they fly, what they report, and our radar."""

from typing import Annotated, Final, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import GaussMarkov, Interval, Probability, Rate, Wave

MOST_AIRCRAFT: Final = 100  # their MAVLink system numbers end at 255
FIRST_ICAO: Final = 0x4B1A00
FIRST_SYSTEM: Final = 101
LEADER: Final = -1  # the number of the leader among other aircraft: system 100


class Reports(Record, frozen=True, kw_only=True):
    """Position reports of other aircraft: `rate` (Hz), latency drawn between two bounds (s), drop-outs, errors of
    the sender's GNSS (correlated and white, m and m/s), and quantisation steps (m, m/s)."""

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


class Broadcast(Reports, frozen=True, kw_only=True):
    """The leader's own position: as its GLOBAL_POSITION_INT, or as ADS-B through our receiver."""

    says: Literal["position", "adsb"] = "position"


class TrafficRadar(Record, frozen=True, kw_only=True):
    """A phased array on our vehicle (De Vivo et al., Table 4), with `panels` all round. During `jammed` every
    aircraft radiates `jammer_power` (W); during `lost` there is no signal. `glint`: distance (m, 1 sigma on each
    axis, new in each scan) from an aircraft's centre to the point that reflects. `range_max` in m."""

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
    elevation_deg: Positive = 30.0  # false alarms lie within this, up and down
    jammed: tuple[Interval, ...] = ()
    jammer_power: Positive = 15.0
    jammed_false_alarms: NotNegative = 10.0
    lost: tuple[Interval, ...] = ()


class PeerReceiver(Record, frozen=True, kw_only=True):
    """The GNSS receiver of an aircraft that shares pseudoranges over Zenoh: rate (Hz), standard deviations of the
    pseudoranges (m, without multipath) and of their rates (m/s). During `masked` only three satellites are in
    view, during `lost` none."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    sigma: Positive = 5.0
    rate_sigma: Positive = 0.1
    masked: tuple[Interval, ...] = ()
    lost: tuple[Interval, ...] = ()


class Aircraft(Record, frozen=True, kw_only=True):
    """Another aircraft. `start`: r_OT_n at time 0 (m). Start and course differ from run to run by their sigmas.
    `speed` and `climb` in m/s; `a_lat` turns it to the right (m/s^2); its transponder is off from `silent_from`
    (s) on."""

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
    """All aircraft except the two of the formation, and the sensors that observe them."""

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
