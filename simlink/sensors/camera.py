"""The camera and its vision process: exposures, noise, drop-outs, wrong blobs.

A point is (Y_c/X_c, Z_c/X_c), positive right and down, as in `onboard.geometry.camera`. Lens distortion moves it,
in units of the focal length.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, NamedTuple

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import (
    CameraDetections,
    CameraPoints,
    Clock,
    Detection,
    ImagePoint,
    Intrinsics,
    Pixel,
    Quaternion,
    TargetPoints,
    Vec3,
)
from simlink.scenarios.camera import Camera, cuts, lens_of
from simlink.scenarios.profiles import is_within
from simlink.scenarios.scenario import Scenario
from simlink.world import attitude
from simlink.world.attitude import difference
from simlink.world.constants import STEPS_PER_SECOND
from simlink.world.motion import Real
from simlink.world.noise import normals, uniforms
from simlink.world.truth import State

Mount = Callable[[State], Quaternion]
Points = tuple[ImagePoint, ImagePoint, ImagePoint]  # center, left wing, right wing of the leader
SIDE_NAMING: Final = ("wing", "wing_pose")  # detectors that name the wing tips by their side in the image


class Image(NamedTuple):
    """One image: the leader's points in focal lengths, and its boot stamp.

    `detections` replaces the points when the detector finds something else than these alone.
    """

    t_ns: int
    points: Points
    detections: tuple[Detection, ...] | None = None


def mount_quaternion(camera: Camera) -> Quaternion:
    """q_bc of the mount."""
    roll, pitch, yaw = (math.radians(angle) for angle in camera.mount_rpy_deg)
    w, x, y, z = quaternion_from_euler(roll, pitch, yaw).tolist()
    return w, x, y, z


def leader_points_n(r_FL_n: Vec3, q_nL: Quaternion, size: float) -> tuple[Vec3, Vec3, Vec3]:
    """Return the center, left and right wing point relative to the follower, in n."""
    x, y, z = attitude.to_n(q_nL, (0.0, size / 2, 0.0))
    r = r_FL_n
    return r, (r[0] - x, r[1] - y, r[2] - z), (r[0] + x, r[1] + y, r[2] + z)


def in_camera(r_FP_n: Vec3, q_nF: Quaternion, camera: Camera, q_bc: Quaternion) -> Vec3:
    """Return r_CP_c of a point P; the components are floats, or arrays of them."""
    return attitude.to_b(q_bc, difference(attitude.to_b(q_nF, r_FP_n), camera.mount_offset))


def is_inside(camera: Camera, x: Real, y: Real, z: Real) -> Real:
    """Whether points at (x, y, z) in c lie in front of the lens and inside the image."""
    half_width, half_height = camera.width_px / 2 / camera.f_px, camera.height_px / 2 / camera.f_px
    return (x > 0.0) & (abs(y) <= half_width * x) & (abs(z) <= half_height * x)


def project(state: State, size: float, camera: Camera, q_bc: Quaternion) -> Points | None:
    """Project the leader's points into the image; None if that is not possible.

    That is so if a point is behind the lens or outside the image, or if the leader is too small.
    """
    points = []
    r_FL_n, lens = difference(state.r_OL_n, state.r_OF_n), lens_of(camera)
    if camera.f_px * size < camera.smallest_px * math.hypot(*r_FL_n):
        return None
    for r_FP_n in leader_points_n(r_FL_n, state.q_nL, size):
        x, y, z = in_camera(r_FP_n, state.q_nF, camera, q_bc)
        if x <= 0.0:
            return None
        point = lens.pixel(y / x, z / x)
        if not (cuts(camera) or is_inside(camera, 1.0, *point)):
            return None
        points.append(point)
    return points[0], points[1], points[2]


def is_exposure(step: int, rate: float) -> bool:
    """Whether an image is taken at this step of the world.

    It is the first step at or after each multiple of 1 / rate.
    """
    per_step = rate / STEPS_PER_SECOND
    # a millionth of a step tolerates the rounding of rates such as 60, whose period is no binary fraction
    return math.floor(step * per_step + 1e-6) > math.floor((step - 1) * per_step + 1e-6)


def registrations(camera: Camera, seed: int) -> Iterator[bool]:
    """Yield for each image whether the vision process finds the leader.

    It is a Markov chain that begins with a registered image.
    """
    u = uniforms(seed, "camera.registration")
    registered = True
    while True:
        yield registered
        registered = next(u) >= camera.p_lose if registered else next(u) < camera.p_regain


def _add_noise(points: Points, z: Sequence[float], sigma: float) -> Points:
    """Add noise to points, from six standard normal numbers `z`.

    They are drawn even for sigma 0, so that each image has its own place in the stream.
    """
    (a, b), (c, d), (e, f) = points
    return (
        (a + sigma * z[0], b + sigma * z[1]),
        (c + sigma * z[2], d + sigma * z[3]),
        (e + sigma * z[4], f + sigma * z[5]),
    )


def name_by_side(points: Points) -> Points:
    """Name the wing tips by their side in the image: left is the one further left."""
    center, *tips = points
    left, right = sorted(tips)
    return center, left, right


def blob(camera: Camera, u: Real, v: Real, w: Real) -> Points:
    """Return a wrong detection from three uniform draws u, v and w.

    Its center is uniform in the image and its horizontal span uniform in `blob_span_px`.
    """
    low, high = camera.blob_span_px
    x = (u - 0.5) * camera.width_px / camera.f_px
    y = (v - 0.5) * camera.height_px / camera.f_px
    half = (low + (high - low) * w) / 2 / camera.f_px
    return (x, y), (x - half, y), (x + half, y)


def correlated_normals(white: Iterator[float], count: int, camera: Camera) -> Iterator[list[float]]:
    """Yield for each image `count` standard normal numbers.

    They are correlated over the camera's `noise_time` from one image to the next.
    """
    decay = math.exp(-1.0 / (camera.rate * camera.noise_time)) if camera.noise_time else 0.0
    drive = math.sqrt(1.0 - decay * decay)
    x = list(islice(white, count))
    while True:
        yield x
        x = [decay * before + drive * z for before, z in zip(x, islice(white, count), strict=True)]


class CameraSensor:
    """The camera of one run: call `expose` once per image, in order.

    `mount` gives q_bc of a moving mount.
    """

    def __init__(self, scenario: Scenario, seed: int, size: float, mount: Mount | None = None) -> None:
        self._camera, fixed = scenario.camera, mount_quaternion(scenario.camera)
        self._repeat = scenario.repeat
        self._size = size
        self._mount = mount or (lambda _: fixed)
        self._registered = registrations(scenario.camera, seed)
        self._noise = correlated_normals(normals(seed, "camera.noise"), 6, scenario.camera)
        self._wrong = uniforms(seed, "camera.wrong")

    def expose(self, state: State) -> Points | None:
        """Return the points in an image exposed now, None if the leader is not registered."""
        camera, t = self._camera, state.t % self._repeat
        registered = next(self._registered) and not is_within(t, camera.blackouts)
        wrong = next(self._wrong) < camera.wrong_blob
        other = blob(camera, next(self._wrong), next(self._wrong), next(self._wrong))
        truth = project(state, self._size, camera, self._mount(state))
        noisy = _add_noise(truth or other, next(self._noise), camera.sigma_px / camera.f_px)
        if not registered or truth is None:
            return None
        if wrong:
            return other
        return name_by_side(noisy) if camera.sees in SIDE_NAMING else noisy


def target_points(image: Image, camera: Camera) -> TargetPoints:
    """The record that the MAVLink encoder sends as three LANDING_TARGETs."""
    center, left, right = image.points
    return TargetPoints(
        t_ns=image.t_ns, t_recv_ns=image.t_ns, camera=camera.name, center=center, left=left, right=right
    )


def stated_sigma_px(camera: Camera) -> float | None:
    """Return the noise that is reported with a point, or None if none is."""
    return camera.sigma_px or None if camera.states_sigma else None


def document(image: Image, camera: Camera) -> CameraPoints | CameraDetections:
    """The record that a vision process publishes on Zenoh: pixels and intrinsics."""
    cx, cy = camera.width_px / 2, camera.height_px / 2
    pinhole = None
    if not camera.distortion:
        pinhole = Intrinsics(fx_px=camera.f_px, fy_px=camera.f_px, cx_px=cx, cy_px=cy)
    head: dict[str, Any] = {
        "t_ns": image.t_ns,
        "clock": Clock.BOOT,
        "camera": camera.name,
        "intrinsics": pinhole,
    }
    if image.detections is not None:
        return CameraDetections(**head, detections=image.detections)
    sigma_px = stated_sigma_px(camera)
    center, left, right = (
        Pixel(u_px=cx + camera.f_px * y, v_px=cy + camera.f_px * z, sigma_px=sigma_px) for y, z in image.points
    )
    return CameraPoints(**head, center=center, left=left, right=right)
