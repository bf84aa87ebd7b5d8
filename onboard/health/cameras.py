"""Which cameras are heard: how often, how late, by which clock, and which names their detectors give; and what
their images show of a wrong set-up, though each of them can be used: that is reported beside the refusals.

Nothing in a pixel shows of how large an image it is. Pixels of an image that was halved lie in the upper left
quarter of the image that is configured, all of them, which those of a whole image hardly do for long. Where the
leader stays in that quarter anyway, nothing shows the difference.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final

from onboard.messages import DOUBT_PREFIX, CameraHealth, Exposure, TargetImage
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S, S_PER_NS

MAX_CAMERA_COUNT: Final = 16  # cameras
MAX_NAME_COUNT: Final = 8  # targets, or classes, of each
RATE_WINDOW_NS: Final = 2 * NS_PER_S
MAX_WATCHED_COUNT: Final = 32  # cameras whose images' quarter is watched
QUARTER_IMAGES: Final = 500  # in a row, of one camera
MIN_QUARTER_DURATION_NS: Final = 60 * NS_PER_S  # a leader of a formation may stay in that quarter for less
UNUSED: Final = Reason(
    Cause.RANGE_UNUSED,
    f"{DOUBT_PREFIX}`range_m` of its detections is not used: set `detections = true` in [estimator.leader.range], "
    "or leave it out",
)
QUARTER_REASON: Final = Reason(
    Cause.QUARTER,
    f"{DOUBT_PREFIX}the points of all its images are in the upper left quarter of the configured image: are they "
    "pixels of an image of half the size? Then set `width_px` and `height_px`, or send `intrinsics`",
)


class _Camera:
    """The images of one camera."""

    def __init__(self) -> None:
        self.count = 0
        self.arrivals: deque[int] = deque()  # within the window; one exposure may bring several targets
        self.exposed_ns: int | None = None
        self.latency: float | None = None
        self.lead: float | None = None
        self.clock = ""
        self.stamp_ns: int | None = None
        self.off_axis = 0.0
        self.targets: dict[str, None] = {}
        self.classes: dict[str, None] = {}


class Cameras:
    """The cameras whose images come."""

    def __init__(self) -> None:
        self._cameras: dict[str, _Camera] = {}

    def see(self, image: Exposure, exposed_ns: int, offset_ns: int | None, now_ns: int) -> None:
        """Take an image as it came; `exposed_ns`: its time of exposure on the boot clock; `offset_ns`: host
        clock minus boot clock; `now_ns`: the time of our newest own motion on the boot clock, 0 without any."""
        camera = self._cameras.get(image.camera)
        if camera is None:
            if len(self._cameras) >= MAX_CAMERA_COUNT:
                return
            camera = self._cameras[image.camera] = _Camera()
        for detection in image.detections:
            _keep_newest(camera.targets, detection.target)
            _keep_newest(camera.classes, detection.class_name)
        if exposed_ns == camera.exposed_ns:
            return  # another target of the same image
        points = image.detections[0].image_points
        camera.off_axis = max((math.atan(math.hypot(*point)) for point in points), default=0.0)
        camera.exposed_ns, camera.clock, camera.stamp_ns = exposed_ns, image.clock.value, image.t_ns
        camera.count += 1
        camera.arrivals.append(image.t_recv_ns)
        _trim(camera.arrivals, image.t_recv_ns)
        camera.latency = None if offset_ns is None else (image.t_recv_ns - offset_ns - exposed_ns) * S_PER_NS
        camera.lead = (exposed_ns - now_ns) * S_PER_NS if now_ns else None

    def health(self, t_recv_ns: int) -> dict[str, CameraHealth]:
        """Return the health of each camera at a time."""
        return {name: _health(camera, t_recv_ns) for name, camera in self._cameras.items()}


def _health(camera: _Camera, t_recv_ns: int) -> CameraHealth:
    age_ns = t_recv_ns - camera.arrivals[-1]
    _trim(camera.arrivals, t_recv_ns)
    recent = len(camera.arrivals) if age_ns <= RATE_WINDOW_NS else 0
    return CameraHealth(
        count=camera.count,
        rate=recent / (RATE_WINDOW_NS * S_PER_NS),
        age=age_ns * S_PER_NS,
        latency=camera.latency,
        lead=camera.lead,
        clock=camera.clock,
        stamp_ns=camera.stamp_ns,
        off_axis=camera.off_axis,
        targets=tuple(camera.targets),
        classes=tuple(name for name in camera.classes if name),
    )


def _trim(arrivals: deque[int], t_recv_ns: int) -> None:
    """Keep what came within the window, and the newest."""
    while len(arrivals) > 1 and not 0 <= t_recv_ns - arrivals[0] <= RATE_WINDOW_NS:
        arrivals.popleft()


def _keep_newest(names: dict[str, None], name: str) -> None:
    """Keep a name as the newest; the oldest gives way."""
    names.pop(name, None)
    names[name] = None
    if len(names) > MAX_NAME_COUNT:
        del names[next(iter(names))]


class Hints:
    """`add(source, reason, t_recv_ns)` takes what is found. `takes_ranges`: ranges of detections are used."""

    def __init__(self, add: Callable[[str, Reason, int], None], *, takes_ranges: bool) -> None:
        self._add, self._takes_ranges = add, takes_ranges
        self._quarters: dict[str, tuple[int, int]] = {}  # by camera: images in a row, and the first one's arrival

    def see(self, image: TargetImage) -> None:
        """Take an image that goes further."""
        source = f"camera {image.camera}"
        if image.range is not None and not self._takes_ranges:
            self._add(source, UNUSED, image.t_recv_ns)
        if image.doubt:
            self._add(source, Reason(image.doubt.cause, DOUBT_PREFIX + image.doubt.words), image.t_recv_ns)
        left, upper, right, lower = image.view or (0.0, 0.0, 0.0, 0.0)
        middle = _mid_coordinate(left, right), _mid_coordinate(upper, lower)
        count, since_ns = self._quarters.get(image.camera, (0, image.t_recv_ns))
        if any(u >= middle[0] or v >= middle[1] for u, v in image.image_points):
            self._quarters.pop(image.camera, None)
        elif count or len(self._quarters) < MAX_WATCHED_COUNT:
            self._quarters[image.camera] = count + 1, since_ns
            if count >= QUARTER_IMAGES and image.t_recv_ns - since_ns > MIN_QUARTER_DURATION_NS:
                self._add(source, QUARTER_REASON, image.t_recv_ns)


def _mid_coordinate(a: float, b: float) -> float:
    """The image coordinate in the middle of two, by their angles: one edge of a wide image may be very far."""
    return math.tan(0.5 * (math.atan(a) + math.atan(b)))
