"""A detector of boxes, image by image."""

from onboard.messages import Box, CameraDetections, Clock, Detection, Intrinsics
from simlink.encounters.shapes import box_around, draw_shape, projected
from simlink.scenarios.camera import Camera
from simlink.sensors.camera import mount_quaternion
from simlink.world.attitude import difference
from simlink.world.noise import stream
from simlink.world.truth import State


class BoxDetector:
    """The boxes of one run, around a leader whose shape is drawn by `seed`. Call `document` once per image, in
    order."""

    def __init__(self, camera: Camera, seed: int) -> None:
        self._camera, self._q_bc = camera, mount_quaternion(camera)
        self._random = stream(seed, "camera.box")
        self._shape = draw_shape(self._random)

    def document(self, state: State, size: float, t_ns: int) -> CameraDetections:
        """The box around a leader of wingspan `size` (m) in an image stamped `t_ns` on the boot clock."""
        c = self._camera
        r_FL_n = difference(state.r_OL_n, state.r_OF_n)
        points = projected(self._shape.bounds, size, r_FL_n, state.q_nL, state.q_nF, c, self._q_bc)
        middle, half = box_around(points, self._shape, self._random.standard_normal(4))
        cx, cy = c.width_px / 2, c.height_px / 2
        box = Box(
            u_px=cx + c.f_px * middle[0],
            v_px=cy + c.f_px * middle[1],
            width_px=2 * c.f_px * half[0],
            height_px=2 * c.f_px * half[1],
        )
        return CameraDetections(
            t_ns=t_ns,
            clock=Clock.BOOT,
            camera=c.name,
            intrinsics=Intrinsics(fx_px=c.f_px, fy_px=c.f_px, cx_px=cx, cy_px=cy),
            detections=(Detection(box=box, target="leader"),),
        )
