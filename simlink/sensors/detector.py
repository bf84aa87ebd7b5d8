"""Detections beyond the wing's three points: nose and tail, a box, a pose, a class."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from onboard.messages import Box, DetectedPoint, Detection, ImagePoint
from simlink.scenarios.camera import Camera, cuts, is_plain
from simlink.scenarios.scenario import Scenario
from simlink.sensors.camera import (
    CameraSensor,
    Image,
    Mount,
    Points,
    correlated_normals,
    mount_quaternion,
    stated_sigma_px,
)
from simlink.sensors.poses import PoseDetector
from simlink.sensors.shapes import Place, box_around, draw_rotors, draw_shape, project_points
from simlink.world.attitude import difference
from simlink.world.noise import stream
from simlink.world.truth import State

WING: Final = ("center", "left", "right")


class Detector:
    """The detector of one run, for an aircraft of wingspan `size` (m) and a random shape.

    Call `detect` once for each registered image, in order. `mount` gives q_bc of a moving mount, `target` is the
    id in each detection.
    """

    def __init__(
        self, camera: Camera, seed: int, size: float, mount: Mount | None = None, target: str = "leader"
    ) -> None:
        fixed = mount_quaternion(camera)
        self._camera, self._size, self._target = camera, size, target
        self._mount = mount or (lambda _: fixed)
        random = stream(seed, "camera.box")
        self._shape = draw_shape(random)
        self._noise = correlated_normals(iter(random.standard_normal, None), 4, camera)
        if camera.sees == "rotor_box":
            self._shape = self._shape._replace(bounds=draw_rotors(stream(seed, "camera.rotors")))
        self._poses = PoseDetector(stream(seed, "camera.pose"))

    def detect(self, state: State, points: Points) -> tuple[Detection, ...] | None:
        """Return the detections of an image, or None if it holds only the wing's `points`."""
        camera, sees = self._camera, self._camera.sees
        if is_plain(camera):
            return None
        r_FL_n = difference(state.r_OL_n, state.r_OF_n)
        place = Place(self._size, r_FL_n, state.q_nL, state.q_nF, camera, self._mount(state))
        named, box, pose = {}, None, None
        if sees in ("wing", "wing_pose"):
            named = self._named(zip(WING, points, strict=True))
        elif sees == "points":
            named = self._named(self._all(points, place))
        elif sees == "center_box":
            named = self._named([(WING[0], points[0])])
        if sees in ("pose", "wing_pose"):
            pose = self._poses.detect(place)
        elif sees in ("box", "center_box", "rotor_box"):
            box = self._box(place)
            if box is None:
                return ()
        wrong = [m.class_name for m in camera.mistaken if m.start <= state.t < m.end]
        name = (*wrong, camera.class_name)[0]
        return (Detection(points=named, box=box, pose=pose, target=self._target, class_name=name),)

    def _all(self, points: Points, place: Place) -> Iterator[tuple[str, ImagePoint]]:
        """Yield the wing's points, then nose and tail with the same noise."""
        yield from zip(WING, points, strict=True)
        sigma = self._camera.sigma_px / self._camera.f_px
        at, z = project_points(self._shape.named.values(), place), next(self._noise)
        for name, (u, v), du, dv in zip(self._shape.named, at, z[::2], z[1::2], strict=True):
            yield name, (u + sigma * du, v + sigma * dv)

    def _named(self, points: Iterable[tuple[str, ImagePoint]]) -> dict[str, DetectedPoint]:
        c = self._camera
        cx, cy, sigma_px = c.width_px / 2, c.height_px / 2, stated_sigma_px(c)
        return {
            name: DetectedPoint(u_px=cx + c.f_px * u, v_px=cy + c.f_px * v, sigma_px=sigma_px)
            for name, (u, v) in points
        }

    def _box(self, place: Place) -> Box | None:
        """Return the box, cut at the image's edge, or None if too little of it is inside."""
        c = self._camera
        corners = project_points(self._shape.bounds, place)
        (u, v), half = box_around(corners, self._shape, np.array(next(self._noise)))
        middle, sides = np.array([u, v]), np.array(half)
        if cuts(c):
            edge = np.array([c.width_px, c.height_px]) / 2 / c.f_px
            ends = middle - sides, middle + sides
            gap = c.edge_gap_px / c.f_px
            low, high = (
                np.where(ends[0] < -edge, gap - edge, ends[0]),
                np.where(ends[1] > edge, edge - gap, ends[1]),
            )
            if (high <= low).any() or np.prod((high - low) / (2.0 * sides)) < c.least_inside:
                return None
            middle, sides = 0.5 * (low + high), 0.5 * (high - low)
        (u_px, v_px), (width_px, height_px) = (c.f_px * middle).tolist(), (2.0 * c.f_px * sides).tolist()
        return Box(u_px=c.width_px / 2 + u_px, v_px=c.height_px / 2 + v_px, width_px=width_px, height_px=height_px)


class Vision:
    """Camera and detector of one run, for aircraft of wingspan `size` (m).

    Call `expose` once per image, in order. `mount` gives q_bc of a moving mount.
    """

    def __init__(self, scenario: Scenario, seed: int, size: float, mount: Mount | None = None) -> None:
        self._arguments = scenario, seed, size, mount
        self._pairs: list[tuple[CameraSensor, Detector]] = []

    def expose(self, state: State, stamp_ns: int) -> Image | None:
        """Return the image exposed now, or None if no aircraft is found."""
        first: Points | None = None
        found: list[Detection] = []
        places = ((state.r_OL_n, state.q_nL), *((other.r_n, other.q_nb) for other in state.others))
        for k, (r_n, q_n) in enumerate(places):
            aircraft = state._replace(r_OL_n=r_n, q_nL=q_n)
            camera, detector = self._pair(k)
            if (points := camera.expose(aircraft)) is None:
                continue
            detections = detector.detect(aircraft, points)
            if detections is None:
                return Image(stamp_ns, points)
            first = first or points
            found += detections
        return Image(stamp_ns, first, tuple(found)) if first and found else None

    def _pair(self, k: int) -> tuple[CameraSensor, Detector]:
        """Return camera and detector of the leader (0) or of another aircraft.

        Each pair has its own random numbers.
        """
        while len(self._pairs) <= k:
            scenario, seed, size, mount = self._arguments
            own, name = seed + (len(self._pairs) << 96), f"other-{len(self._pairs)}" if self._pairs else "leader"
            detector = Detector(scenario.camera, own, size, mount, name if scenario.camera.has_ids else "")
            self._pairs.append((CameraSensor(scenario, own, size, mount), detector))
        return self._pairs[k]
