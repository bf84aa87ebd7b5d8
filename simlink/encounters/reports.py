"""What our vehicle's computer receives of an encounter: the autopilot's messages and the camera's, with the errors
and delays of the conditions."""

import math
from collections.abc import Iterable, Iterator
from typing import Final

import msgspec
import numpy as np

from onboard.messages import (
    Attitude,
    Clock,
    Heartbeat,
    ImageFeature,
    LocalPosition,
    Message,
    Quaternion,
    TargetDetection,
    TargetPoints,
    Vec3,
    Wind,
)
from simlink.encounters.attitudes import body_rates
from simlink.encounters.conditions import JITTER_S, WIND_ERROR, WIND_STATED, Conditions
from simlink.encounters.curves import wobble
from simlink.encounters.gimbals import Mount, SweepingGimbal, draw_gimbal
from simlink.encounters.poses import PoseDetector
from simlink.encounters.shapes import Place, Sees, Shape, box_around, draw_rotors, draw_shape, projected
from simlink.encounters.truth import EncounterTruth, at
from simlink.sensors.arrays import Array
from simlink.sensors.camera import Points, in_camera, is_inside, leader_points_n, mount_quaternion, registrations
from simlink.world import attitude
from simlink.world.noise import stream

BOOT_NS: Final = 20_000_000_000  # boot clock when the encounter begins
ASSUMED_PX: Final = 1.0  # what is stated of a point's noise, whatever it is
BOX_SIGMA: Final = 0.05  # the same of a box's, as a share of its larger side
EPOCH_NS: Final = 1_735_689_600 * 10**9  # Unix time at boot
VISION: Final = 191  # component that sends image points
WIND_HZ: Final = 1.0
MULTIROTOR, ARDUPILOT, ACTIVE = 2, 3, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE


def boot_ns(t: float) -> int:
    """The boot clock at a time of the encounter."""
    return BOOT_NS + round(t * 1e9)


def received(
    truth: EncounterTruth, conditions: Conditions, seed: int, sees: Sees = "wing", mount: Mount = "fixed"
) -> tuple[Message, ...]:
    """All messages, in the order of their arrival. The detector `sees` as much of the leader."""
    gimbal = draw_gimbal(truth, conditions, seed) if mount == "gimbal" else None
    messages = [
        *_heartbeats(truth),
        *_attitudes(truth, conditions, seed),
        *_positions(truth, conditions, seed),
        *_images(truth, conditions, seed, sees, gimbal),
        *(gimbal.reports(seed, BOOT_NS, EPOCH_NS) if gimbal else ()),
    ]
    return in_order(messages)


def in_order(messages: Iterable[Message]) -> tuple[Message, ...]:
    """By their arrival."""
    return tuple(sorted(messages, key=lambda m: m.t_recv_ns))


def winds(truth: EncounterTruth, wind: Array, seed: int) -> Iterator[Message]:
    """WIND_COV each second: the wind (3,), m/s in n, with an error that lasts, and a standard deviation that is
    not quite its own."""
    rng = stream(seed, "encounters.wind")
    sigma = float(rng.uniform(*WIND_ERROR))
    north, east = (wind[:2] + sigma * rng.standard_normal(2)).tolist()
    stated = sigma * float(rng.uniform(*WIND_STATED))
    for t in _samples(truth, rng, WIND_HZ).tolist():
        ns = boot_ns(t)
        yield Wind(t_ns=ns, t_recv_ns=EPOCH_NS + ns, clock=Clock.NONE, north=north, east=east, sigma=stated)


def _samples(truth: EncounterTruth, rng: np.random.Generator, rate: float) -> Array:
    """Times of samples at a rate (Hz), their phase random."""
    return np.arange(rng.uniform(0.0, 1.0) / rate, truth.t[-1], 1.0 / rate)


def _heartbeats(truth: EncounterTruth) -> Iterator[Message]:
    for t in np.arange(0.0, truth.t[-1], 1.0).tolist():
        ns = boot_ns(t)
        yield Heartbeat(
            t_ns=ns,
            t_recv_ns=EPOCH_NS + ns,
            clock=Clock.NONE,
            vehicle_type=MULTIROTOR,
            autopilot=ARDUPILOT,
            armed=True,
            status=ACTIVE,
        )


def _attitudes(truth: EncounterTruth, conditions: Conditions, seed: int) -> Iterator[Message]:
    """ATTITUDE_QUATERNION: the attitude is off by a rotation in b that changes slowly."""
    tilt, yaw, n = conditions.tilt_error_deg, conditions.yaw_error_deg, len(truth.t)
    error = np.column_stack(
        [
            wobble(seed, f"encounters.attitude.{axis}", process, n, np.pi / 180)
            for axis, process in (("x", tilt), ("y", tilt), ("z", yaw))
        ]
    )
    when = _samples(truth, stream(seed, "encounters.attitude"), conditions.attitude_hz)
    rows = at(truth.t, np.hstack([truth.euler_F, body_rates(truth.euler_F), error]), when)
    for t, (roll, pitch, heading, p, q, r, *wrong) in zip(when.tolist(), rows.tolist(), strict=True):
        q_nb = attitude.product(attitude.from_euler(roll, pitch, heading), attitude.from_vector(*wrong))
        ns = boot_ns(t)
        yield Attitude(t_ns=ns, t_recv_ns=_arrival(ns, conditions.transport), q_nb=q_nb, omega_b=(p, q, r))


def _positions(truth: EncounterTruth, conditions: Conditions, seed: int) -> Iterator[Message]:
    """LOCAL_POSITION_NED: older than its stamp, its velocity off by what changes slowly."""
    n, process = len(truth.t), conditions.velocity_error
    error = np.column_stack([wobble(seed, f"encounters.velocity.{axis}", process, n) for axis in "xyz"])
    when = _samples(truth, stream(seed, "encounters.position"), conditions.position_hz)
    motion = np.hstack([truth.follower.r, truth.follower.v + error])
    for t, row in zip(when.tolist(), at(truth.t, motion, when - conditions.position_lag).tolist(), strict=True):
        ns = boot_ns(t)
        yield LocalPosition(
            t_ns=ns,
            t_recv_ns=_arrival(ns, conditions.transport),
            r_OF_n=(row[0], row[1], row[2]),
            v_F_n=(row[3], row[4], row[5]),
        )


def _images(
    truth: EncounterTruth, conditions: Conditions, seed: int, sees: Sees, gimbal: SweepingGimbal | None
) -> Iterator[Message]:
    """What is found of the leader in each image in which it is."""
    camera, rng = conditions.camera, stream(seed, "encounters.images")
    q_bc, found = mount_quaternion(camera), registrations(camera, seed)
    when = _samples(truth, rng, camera.rate)
    noise = camera.sigma_px / camera.f_px * rng.standard_normal((len(when), 3, 2))
    late = camera.latency + JITTER_S * rng.random(len(when))
    shape_rng = stream(seed, "encounters.shape")
    poses = PoseDetector(stream(seed, "encounters.pose"))
    shape, beyond = draw_shape(shape_rng), shape_rng.standard_normal((len(when), 4))
    if sees == "rotor_box":
        shape = shape._replace(bounds=draw_rotors(stream(seed, "encounters.rotors")))
    rows = at(truth.t, np.hstack([truth.r_FL_n, truth.euler_L, truth.euler_F]), when).tolist()
    for t, row, off, more, delay, is_found in zip(
        when.tolist(), rows, noise.tolist(), beyond, late.tolist(), found, strict=False
    ):
        r_FL_n: Vec3 = (row[0], row[1], row[2])
        q_nL, q_nF = attitude.from_euler(*row[3:6]), attitude.from_euler(*row[6:9])
        q_bc = gimbal.q_bc(t, q_nF) if gimbal else q_bc
        points = image_points(r_FL_n, q_nL, q_nF, conditions, q_bc)
        if is_found and points is not None:
            center, left, right = (
                named_by_side(points, off) if sees in ("wing", "wing_pose") else noisy(points, off)
            )
            ns = boot_ns(t)
            whole = TargetPoints(
                t_ns=ns,
                t_recv_ns=_arrival(ns, delay),
                component=VISION,
                camera=camera.name,
                center=center,
                left=left,
                right=right,
            )
            place = conditions.size, r_FL_n, q_nL, q_nF, camera, q_bc
            if sees in ("pose", "wing_pose"):
                posed = poses.see(whole, place)
                yield posed if sees == "pose" else msgspec.structs.replace(whole, pose=posed.pose)
            else:
                yield whole if sees == "wing" else _more_or_less(whole, sees, shape, place, more, conditions)


def _more_or_less(
    whole: TargetPoints, sees: Sees, shape: Shape, place: Place, noise: Array, conditions: Conditions
) -> Message:
    """The image with nose and tail, or with a box in place of the wing; `noise` (4,) is standard normal."""
    sigma = conditions.camera.sigma_px / conditions.camera.f_px
    if sees == "points":
        points = projected(tuple(shape.named.values()), *place)
        off = (sigma * noise.reshape(2, 2)).tolist()
        others = tuple(
            ImageFeature(name=name, point=(u + du, v + dv), sigma=ASSUMED_PX / conditions.camera.f_px)
            for name, (u, v), (du, dv) in zip(shape.named, points, off, strict=True)
        )
        return msgspec.structs.replace(whole, others=others)
    middle, half = box_around(projected(shape.bounds, *place), shape, noise)
    side = 2.0 * max(half)
    least = ASSUMED_PX / conditions.camera.f_px
    features = [ImageFeature(name="box", point=middle, sigma=max(least, BOX_SIGMA * side))]
    if sees == "center_box":
        features.insert(0, ImageFeature(name="center", point=whole.center, sigma=least))
    return TargetDetection(
        t_ns=whole.t_ns,
        t_recv_ns=whole.t_recv_ns,
        component=whole.component,
        camera=whole.camera,
        target=whole.target,
        features=tuple(features),
        half_width=max(half),
        half_sides=half,
    )


def image_points(
    r_FL_n: Vec3, q_nL: Quaternion, q_nF: Quaternion, conditions: Conditions, q_bc: Quaternion
) -> Points | None:
    """Center and both wingtips without noise, in units of the focal length; None where a point is not in view, or
    the leader too small to be found."""
    camera, points = conditions.camera, []
    for r_FP_n in leader_points_n(r_FL_n, q_nL, conditions.size):
        x, y, z = in_camera(r_FP_n, q_nF, camera, q_bc)
        if not is_inside(camera, x, y, z):
            return None
        points.append((y / x, z / x))
    if camera.f_px * conditions.size < conditions.smallest_px * math.hypot(*r_FL_n):
        return None
    return points[0], points[1], points[2]


def named_by_side(points: Points, noise: list[list[float]]) -> Points:
    """Points with noise. A detector knows no wing from the other: left is the tip that it finds further left."""
    center, *tips = noisy(points, noise)
    first, second = sorted(tips)
    return center, first, second


def noisy(points: Points, noise: list[list[float]]) -> Points:
    """Points with noise, as a detector of named points gives them."""
    center, left, right = ((y + dy, z + dz) for (y, z), (dy, dz) in zip(points, noise, strict=True))
    return center, left, right


def _arrival(t_ns: int, delay: float) -> int:
    """Arrival on this computer's clock."""
    return EPOCH_NS + t_ns + round(delay * 1e9)
