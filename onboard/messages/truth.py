"""What the simulator knows."""

from onboard.messages.base import Quaternion, Record, Vec3


class Truth(Record, frozen=True, kw_only=True):
    """What a simulator knows and an estimator never may. Boot clock; NED; the leader relative to the
    follower, the size (wingspan, m), Oh & Johnson's a_lat and a_long (m/s^2), and both absolute poses."""

    t_ns: int
    r_FL_n: Vec3
    v_FL_n: Vec3
    size: float
    a_lat: float
    a_long: float
    r_OF_n: Vec3
    v_F_n: Vec3
    a_F_n: Vec3
    q_nF: Quaternion
    r_OL_n: Vec3
    q_nL: Quaternion
    omega_b: Vec3 = (0.0, 0.0, 0.0)  # of the follower
    fault: str = ""  # what is wrong with the follower, "" when nothing is


class IntruderTruth(Record, frozen=True, kw_only=True):
    """One aircraft of a simulated traffic, relative to us, NED where we are. `detections` counts what the radar
    has seen of it so far, `messages` what it has said and was received."""

    name: str
    target: str
    r_FT_n: Vec3
    v_FT_n: Vec3
    messages: int
    detections: int


class TrafficTruth(Record, frozen=True, kw_only=True):
    """All simulated traffic at one time, on the boot clock."""

    t_ns: int
    intruders: tuple[IntruderTruth, ...]


class SimStatus(Record, frozen=True, kw_only=True):
    """What a simulator has sent so far, so that losses can be counted: images by camera, frames by name."""

    t_ns: int
    images: int
    frames: int
    finished: bool
