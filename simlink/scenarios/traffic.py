"""Other aircraft in a scenario: how they fly, what they report, and our radar."""

from typing import Annotated, Final, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import GaussMarkov, Interval, Probability, Rate, Wave

MAX_AIRCRAFT_COUNT: Final = 100  # their MAVLink system numbers end at 255
FIRST_ICAO: Final = 0x4B1A00
FIRST_SYSTEM_ID: Final = 101
LEADER_INDEX: Final = -1  # relative to the other aircraft, so that the leader is system 100


class Reports(Record, frozen=True, kw_only=True):
    """The position reports of other aircraft: rate, latency, drop-outs and errors."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=50)] = 1.0  # Hz
    latency: tuple[NotNegative, NotNegative] = (0.2, 0.6)  # s, uniform between these
    p_lose: Probability = 0.05  # received -> not, per report
    p_regain: Probability = 0.5
    position: GaussMarkov = GaussMarkov(sigma=2.5, time=60.0)  # m, of the sender's GNSS
    position_white: NotNegative = 1.5  # m
    velocity_white: NotNegative = 0.2  # m/s
    position_step: NotNegative = 5.1  # m, quantisation of compact position reports
    altitude_step: NotNegative = 7.62  # m: 25 feet
    velocity_step: NotNegative = 0.5144  # m/s: a knot
    climb_step: NotNegative = 0.3251  # m/s: 64 feet a minute


class Broadcast(Reports, frozen=True, kw_only=True):
    """The leader's own position, as GLOBAL_POSITION_INT or as ADS-B through our receiver."""

    says: Literal["position", "adsb"] = "position"


class TrafficRadar(Record, frozen=True, kw_only=True):
    """A phased array on our vehicle (De Vivo et al., Table 4), with `panels` all round.

    During `jammed` every aircraft radiates `jammer_power` (W); during `lost` there is no signal. `glint` is the
    distance from an aircraft's centre to the reflecting point (m, 1 sigma on each axis, new in each scan).
    `range_max` is in m.
    """

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
    """The GNSS receiver of an aircraft that shares pseudoranges over Zenoh.

    During `masked` only three satellites are in view, during `lost` none.
    """

    rate: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0  # Hz
    sigma: Positive = 5.0  # m, of the pseudoranges, without multipath
    rate_sigma: Positive = 0.1  # m/s
    masked: tuple[Interval, ...] = ()
    lost: tuple[Interval, ...] = ()


class Aircraft(Record, frozen=True, kw_only=True):
    """Another aircraft; its start and course differ from run to run by their sigmas.

    `start` is r_OT_n at time 0 (m); `speed` and `climb` are in m/s; `a_lat` turns it to the right (m/s^2). Its
    transponder is off from `silent_from` (s) on.
    """

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
