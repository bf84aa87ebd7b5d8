"""The simulator's truth and its pictures."""

from onboard.messages.base import Clock, Quaternion, Record, Vec3


class Truth(Record, frozen=True, kw_only=True):
    """The true state of a simulated formation, on the boot clock, in NED and SI.

    No estimator may use it.

    Attributes
    ----------
    r_FL_n, v_FL_n
        Leader relative to the follower.
    size
        The leader's wingspan, m.
    a_lat, a_long
        Oh & Johnson's lateral and longitudinal accelerations, m/s^2.
    """

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
    omega_b: Vec3 = (0.0, 0.0, 0.0)  # of the follower, rad/s
    fault: str = ""  # active faults of the follower, "" if none


class IntruderTruth(Record, frozen=True, kw_only=True):
    """One aircraft of the simulated traffic, relative to us, in NED at our position (m, m/s).

    Attributes
    ----------
    messages
        Its reports received so far.
    detections
        Its detections by our radar so far.
    """

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
    """Numbers of images and MAVLink frames that the simulator has sent so far, to count losses."""

    t_ns: int
    images: int
    frames: int
    finished: bool


class Picture(Record, frozen=True, kw_only=True):
    """An image of the simulated camera, as JPEG, exposed at `t_ns` on `clock`."""

    t_ns: int
    clock: Clock
    camera: str
    jpeg: bytes
