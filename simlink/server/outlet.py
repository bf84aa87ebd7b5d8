"""A simulated camera's outputs: LANDING_TARGETs by UDP, images and truth by Zenoh."""

import asyncio
from typing import Final, Literal

from onboard.messages import Record
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.scenarios.scenario import Scenario
from simlink.sensors.camera import Image, document, target_points
from simlink.sensors.gimbal import make_gimbal
from simlink.sensors.pictures import Painter
from simlink.server.links import LinkError, UdpLink, parse_udp
from simlink.server.publish import Published, ZenohPublisher, check_vehicle
from simlink.simulation import CAMERA_COMPONENT_ID, check_mavlink
from simlink.world.drawn import draw_scenario
from simlink.world.truth import State, true_size

FLUSH_TIME_S: Final = 0.2  # for Zenoh to send the last records


class OutletOptions(Record, frozen=True, kw_only=True):
    """The scenario and seed of the camera, and the destinations of its images.

    Without `zenoh` no truth is published.
    """

    scenario: Scenario
    seed: int = 1
    camera: Literal["zenoh", "mavlink", "both", "none"] = "zenoh"
    camera_mavlink: str = "udpout:127.0.0.1:14560"
    zenoh: str | None = "tcp/127.0.0.1:7447"
    vehicle: str = "1"

    @property
    def destinations(self) -> str:
        """The destinations of images and truth, for a report."""
        both = f"{self.zenoh} and {self.camera_mavlink}"
        images = {"mavlink": self.camera_mavlink, "both": both, "none": "nowhere"}.get(self.camera, self.zenoh)
        return f"images {images}; truth {self.zenoh or 'nowhere'}"


class Outlet:
    """The outputs of one run; `images` counts the images sent.

    `system` is the MAVLink system of the vehicle with the camera. Raises LinkError and ScenarioError for invalid
    options, PictureError if pictures cannot be drawn.
    """

    def __init__(self, options: OutletOptions, system: int) -> None:
        if options.camera in ("zenoh", "both") and options.zenoh is None:
            raise LinkError(
                f"--camera {options.camera} needs an endpoint; set --zenoh, or choose --camera mavlink or none"
            )
        check_vehicle(options.vehicle)
        if options.camera in ("mavlink", "both"):
            check_mavlink(options.scenario)
        self.images = 0
        self._options = options
        self._camera = options.scenario.camera
        self._encoder = MavlinkEncoder(system, CAMERA_COMPONENT_ID)
        self._zenoh: ZenohPublisher | None = None
        self._udp: UdpLink | None = None
        if options.camera in ("mavlink", "both"):
            self._udp = UdpLink(parse_udp(options.camera_mavlink), lambda _: ())
        self._painter: Painter | None = None
        self._painting: asyncio.Task[None] | None = None  # the picture that is being drawn
        if self._camera.pictures != "none":
            flown = draw_scenario(options.scenario, options.seed)
            gimbal = make_gimbal(flown.camera, options.seed)
            mount = None if gimbal is None else gimbal.mount
            self._painter = Painter(flown.camera, true_size(flown, options.seed), options.seed, mount)

    async def open(self) -> None:
        """Open the links. Raises LinkError."""
        o = self._options
        if self._udp is not None:
            await self._udp.open()
        if o.zenoh is not None:
            arguments = (o.zenoh, o.vehicle, self._camera.name, o.scenario.traffic.radar.name)
            self._zenoh = await asyncio.to_thread(ZenohPublisher.open, *arguments)

    def has_viewer(self) -> bool:
        """Whether someone receives the images; True if that cannot be known."""
        if self._zenoh is None or self._options.camera not in ("zenoh", "both"):
            return True
        return self._zenoh.has_viewer()

    def send_image(self, image: Image) -> None:
        """Send the detections of one image, unless pictures are sent instead."""
        if self._painter is not None:
            return
        if self._options.camera in ("zenoh", "both"):
            self.publish(document(image, self._camera))
        if self._udp is not None:
            self._udp.send(self._encoder.encode(target_points(image, self._camera)))
        self.images += self._options.camera != "none"

    def draw(self, state: State, t_ns: int) -> None:
        """Draw and publish a picture if pictures are wanted.

        An exposure is skipped while the picture before it is still being drawn.
        """
        if self._painter is not None and (self._painting is None or self._painting.done()):
            self._painting = asyncio.create_task(self._paint(self._painter, state, t_ns))

    async def _paint(self, painter: Painter, state: State, t_ns: int) -> None:
        self.publish(await asyncio.to_thread(painter.picture, state, t_ns))
        self.images += 1

    def publish(self, record: Published) -> None:
        """Publish a record over Zenoh, if there is a session."""
        if self._zenoh is not None:
            self._zenoh.put(record)

    async def finish(self) -> None:
        """Wait for the picture that is being drawn, so that it is counted."""
        if self._painting is not None:
            await self._painting

    async def flush(self) -> None:
        """Wait until Zenoh has had time to send the last records."""
        if self._zenoh is not None:
            await asyncio.sleep(FLUSH_TIME_S)

    async def close(self) -> None:
        """Close the links that are open."""
        if self._udp is not None:
            self._udp.close()
        if self._zenoh is not None:
            await asyncio.to_thread(self._zenoh.close)
