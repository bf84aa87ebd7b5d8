"""What a detector finds of a leader beyond the wing's three points: nose and tail, a box, a pose."""

from collections.abc import Iterable, Iterator
from typing import Final

from onboard.messages import Box, DetectedPoint, Detection, ImagePoint
from simlink.scenarios.camera import Camera
from simlink.sensors.camera import Mount, Points, mount_quaternion, stated_sigma_px
from simlink.sensors.poses import PoseDetector
from simlink.sensors.shapes import Place, box_around, draw_rotors, draw_shape, projected
from simlink.world.attitude import difference
from simlink.world.noise import stream
from simlink.world.truth import State

WING: Final = ("center", "left", "right")


class Detector:
    """The detector of one run, for a leader of wingspan `size` (m) whose shape is drawn by `seed`: `detect` once
    for each registered image, in order. `mount`: q_bc of a moving mount."""

    def __init__(self, camera: Camera, seed: int, size: float, mount: Mount | None = None) -> None:
        fixed = mount_quaternion(camera)
        self._camera, self._size = camera, size
        self._mount = mount or (lambda _: fixed)
        self._random = stream(seed, "camera.box")
        self._shape = draw_shape(self._random)
        if camera.sees == "rotor_box":
            self._shape = self._shape._replace(bounds=draw_rotors(stream(seed, "camera.rotors")))
        self._poses = PoseDetector(stream(seed, "camera.pose"))

    def detect(self, state: State, points: Points) -> Detection | None:
        """What it finds beside or in place of the wing's `points`; None: these alone."""
        sees = self._camera.sees
        if sees == "wing":
            return None
        r_FL_n = difference(state.r_OL_n, state.r_OF_n)
        place = Place(self._size, r_FL_n, state.q_nL, state.q_nF, self._camera, self._mount(state))
        if sees in ("pose", "wing_pose"):
            named = self._named(zip(WING, points, strict=True)) if sees == "wing_pose" else {}
            return Detection(points=named, pose=self._poses.see(place), target="leader")
        if sees == "points":
            return Detection(points=self._named(self._all(points, place)), target="leader")
        named = self._named([(WING[0], points[0])]) if sees == "center_box" else {}
        return Detection(points=named, box=self._box(place), target="leader")

    def _all(self, points: Points, place: Place) -> Iterator[tuple[str, ImagePoint]]:
        """The wing's points, and nose and tail with as much noise."""
        yield from zip(WING, points, strict=True)
        sigma = self._camera.sigma_px / self._camera.f_px
        for name, (u, v) in zip(self._shape.named, projected(self._shape.named.values(), place), strict=True):
            du, dv = (sigma * self._random.standard_normal(2)).tolist()
            yield name, (u + du, v + dv)

    def _named(self, points: Iterable[tuple[str, ImagePoint]]) -> dict[str, DetectedPoint]:
        c = self._camera
        cx, cy, sigma_px = c.width_px / 2, c.height_px / 2, stated_sigma_px(c)
        return {
            name: DetectedPoint(u_px=cx + c.f_px * u, v_px=cy + c.f_px * v, sigma_px=sigma_px)
            for name, (u, v) in points
        }

    def _box(self, place: Place) -> Box:
        c = self._camera
        corners = projected(self._shape.bounds, place)
        (u, v), half = box_around(corners, self._shape, self._random.standard_normal(4))
        return Box(
            u_px=c.width_px / 2 + c.f_px * u,
            v_px=c.height_px / 2 + c.f_px * v,
            width_px=2 * c.f_px * half[0],
            height_px=2 * c.f_px * half[1],
        )
