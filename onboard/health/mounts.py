"""Whether a camera is mounted as configured, by how the leader's direction moves when we lean (`camera_errors`).
Nothing is corrected: a mount would take the blame for every other error. So what is found is named, and estimates
stay valid; an estimator may leave out images of a camera in doubt. A wrong focal length or delay is not claimed: a
leader that we follow on its own way accelerates as we lean some seconds later, and moves as if one were wrong.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion, matrix_from_euler, quaternion_from_matrix
from onboard.health.camera_errors import (
    LONGEST_DELAY_S,
    MIN_TILT_RMS,
    SIGMAS,
    Poses,
    Sights,
    Steps,
    Window,
    wrong_mount,
)
from onboard.messages import DOUBT_PREFIX, Estimate, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.ownship.ownship import Ownship
from onboard.units import NS_PER_S

FUSED: Final = (Verdict.FUSED, Verdict.FUSED_LATE)
WINDOW_NS: Final = 4 * NS_PER_S
OWN_MOTION_MARGIN_NS: Final = round(LONGEST_DELAY_S * NS_PER_S)  # of our own motion before and after a window
FEWEST_IMAGES: Final = 20  # in a window
MOST_IMAGES: Final = 40  # ... that are computed with
MAX_WINDOW_COUNT: Final = 20  # that are kept: 80 s
MIN_WINDOW_COUNT: Final = 5
STEP_NS: Final = NS_PER_S // 30  # of own motion, for each step of a search: some milliseconds ...
MOST_STEPS: Final = 30  # ... so many at once
MOST_NOISE: Final = (
    3e-3  # rad: white noise of the attitude turns what is compared and what it is compared with alike
)
SENSES: Final = (
    ("clockwise", "anticlockwise"),
    ("higher", "lower"),
    ("to the right", "to the left"),
)  # by the sign
LEADER_HOLD_TIME_NS: Final = (
    NS_PER_S  # after an image of the leader was fused, its camera shows no other target that counts
)
Found = tuple[Array, Array] | None
LEFT_OUT: Final = "its images are left out while another camera shows the leader"


class Sight(NamedTuple):
    """One image: its time, the leader's image point, and its distance, m."""

    t_ns: int
    u: float
    v: float
    distance: float


class Ended(NamedTuple):
    """Images of one camera in a window that has ended, and our own motion then, None until it is known.

    Also the arrival of the first image after it."""

    source: str
    sights: list[Sight]
    poses: Poses | None
    t_recv_ns: int


class Mounts:
    """The cameras of a flight. `add(source, reason, t_recv_ns)` takes what is found. `see` only collects, as an
    estimate waits behind it; `judge` computes, some milliseconds each time. `doubts`: what is wrong with a camera,
    by its name."""

    def __init__(self, camera: Camera, add: Callable[[str, Reason, int], None]) -> None:
        self._camera, self._add = camera, add
        self.doubts: dict[str, Reason] = {}  # by camera
        self._sound: set[str] = set()  # cameras that were judged while we leaned, of which nothing is wrong
        self._fused_ns: dict[str, int] = {}  # the newest image of each camera that was fused
        self._windows: dict[str, deque[Window]] = {}
        self._sights: dict[str, tuple[str, list[Sight]]] = {}  # by camera, of one target
        self._ended: list[Ended] = []
        self._searches: dict[str, tuple[int, Steps[Found]]] = {}  # by camera, since when
        self._judged_ns = 0

    @property
    def withheld(self) -> dict[str, Reason]:
        """The doubts for which images may be left out: none, unless every other camera that shows the leader was
        judged and is sound."""
        others = self._fused_ns.keys() - self.doubts.keys()
        return self.doubts if others and others <= self._sound else {}

    def see(self, estimate: Estimate, ownship: Ownship) -> None:
        """Take an estimate. It counts if it is of the leader, follows from an image that was fused, and is valid,
        or would be but for images that do not fit each other. One of another target counts where its camera does
        not show the leader: it may be the leader itself, seen elsewhere by a wrong mount."""
        report = estimate.measurement
        if not (estimate.valid or estimate.cause is Cause.NOISE):
            return
        if report is None or report.verdict not in FUSED or not report.points or estimate.mean is None:
            return
        if estimate.name != "leader":
            return
        if estimate.is_primary:
            self._fused_ns[report.source] = report.t_ns
        elif abs(report.t_ns - self._fused_ns.get(report.source, -LEADER_HOLD_TIME_NS)) < LEADER_HOLD_TIME_NS:
            return
        camera, pose = self._camera.named(report.source), ownship.pose_at(report.t_ns)
        if pose is None or camera.gimbal is not None or not all(map(math.isfinite, pose.r_OF_n.tolist())):
            return
        if max(pose.attitude_noise.tolist()) > MOST_NOISE:
            return
        self._keep_motion(ownship)
        target, sights = self._sights.setdefault(report.source, (estimate.target, []))
        if sights and not (target == estimate.target and 0 <= report.t_ns - sights[0].t_ns < WINDOW_NS):
            self._ended.append(Ended(report.source, sights, None, report.t_recv_ns))
            self._sights[report.source] = estimate.target, (sights := [])
        u, v = map(sum, zip(*report.points, strict=True))
        count = len(report.points)
        sights.append(Sight(report.t_ns, u / count, v / count, math.hypot(*estimate.mean[:3])))

    def _keep_motion(self, ownship: Ownship) -> None:
        """Our own motion about windows that have ended, once it is known as far as it is needed."""
        for i, one in enumerate(self._ended):
            if one.poses is None and ownship.knows(one.sights[-1].t_ns + OWN_MOTION_MARGIN_NS):
                from_ns, to_ns = (
                    one.sights[0].t_ns - OWN_MOTION_MARGIN_NS,
                    one.sights[-1].t_ns + OWN_MOTION_MARGIN_NS,
                )
                self._ended[i] = one._replace(poses=Poses(*ownship.motion(from_ns, to_ns)))

    def judge(self, t_recv_ns: int) -> None:
        """Go on in finding what the windows that have ended show."""
        for i, one in enumerate(self._ended):
            if one.poses is not None or t_recv_ns - one.t_recv_ns > WINDOW_NS:  # our own motion has ended
                self._add_window(self._ended.pop(i))
                break
        count = min((t_recv_ns - self._judged_ns) // STEP_NS, MOST_STEPS)
        if count != 0:  # below 0: this computer's clock was set back
            self._judged_ns = t_recv_ns
        for source, (since_ns, steps) in list(self._searches.items()):
            try:
                for _ in range(count):
                    next(steps)
            except StopIteration as end:
                del self._searches[source]
                self._decide(source, end.value, since_ns)

    def _add_window(self, one: Ended) -> None:
        """A window that has ended, and a search for what it and those before it show."""
        source, sights, poses, t_recv_ns = one
        if poses is None or not poses.is_defined or min(len(sights), len(poses.t)) < FEWEST_IMAGES:
            return
        few = sights[:: 1 + len(sights) // MOST_IMAGES]
        rows = np.array([(1e-9 * s.t_ns, s.u, s.v, s.distance) for s in few])
        camera = self._camera.named(source)
        windows = self._windows.setdefault(source, deque(maxlen=MAX_WINDOW_COUNT))
        windows.append(Window(Sights(rows[:, 0], rows[:, 1:3], rows[:, 3]), poses, camera))
        if len(windows) >= MIN_WINDOW_COUNT and source not in self._searches:
            self._searches[source] = t_recv_ns, wrong_mount(tuple(windows))

    def _decide(self, source: str, found: Found, t_recv_ns: int) -> None:
        """Take the result of a search of one camera."""
        self.doubts.pop(source, None)
        self._sound.discard(source)
        if found is not None:
            reason = why(self._camera.named(source), *found)
            self.doubts[source] = reason = reason.also(LEFT_OUT) if self._camera.others else reason
            self._add(f"camera {source}", reason, t_recv_ns)
        elif np.mean([window.lean for window in self._windows[source]]) >= MIN_TILT_RMS**2:
            self._sound.add(source)


def why(camera: Camera, errors: Array, sigmas: Array) -> Reason:
    """A wrong mount of a camera: by which angles (3,) rad about its axes, and their sigmas."""
    axis = int(np.argmax(np.abs(errors) - SIGMAS * sigmas))
    degrees, sigma = math.degrees(errors[axis]), math.degrees(sigmas[axis])
    small = np.where(np.abs(errors) > SIGMAS * sigmas, errors, 0.0)
    w, x, y, z = quaternion_from_matrix(camera.R_bc @ matrix_from_euler(*small)).tolist()
    fits = [round(math.degrees(angle)) for angle in euler_from_quaternion((w, x, y, z))]
    wrong = f"{abs(degrees):.0f} degrees {SENSES[axis][degrees < 0.0]} (sigma {max(sigma, 0.1):.1f})"
    words = f"the leader moves in the image as we lean as if the camera looked {wrong} than `mount_rpy_deg` says"
    return Reason(Cause.MOUNT, f"{DOUBT_PREFIX}{words}: {fits} fits")
