"""`simlink camera`: images of one simulated vehicle by another one's camera.

Both vehicles are simulated by other programs, and only their true states arrive. Exposures are on the follower's
boot clock. The leader's clock is aligned with it by the mean arrival delay of each, so that one late message
changes nothing.
"""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from typing import Final

from onboard.messages import SimStatus, Truth
from onboard.units import NS_PER_S
from simlink.scenarios.scenario import ScenarioError
from simlink.sensors.camera import Image
from simlink.sensors.detector import Vision
from simlink.server.observed import LocalFrame
from simlink.server.outlet import Outlet, OutletOptions
from simlink.server.peer import PeerLink
from simlink.simulation import check_mavlink
from simlink.world.drawn import draw_scenario
from simlink.world.truth import Motion, make_state, true_size, truth_record

POLL_PERIOD_S: Final = 0.004
MAX_LATENCY_NS: Final = NS_PER_S // 2  # an exposure without true states is skipped after this
GRACE_PERIOD_NS: Final = 3 * NS_PER_S  # before missing data are reported
STATUS_PERIOD_NS: Final = NS_PER_S // 5


class CameraOptions(OutletOptions, frozen=True, kw_only=True):
    """Links of both vehicles, and `duration` (s) from the first exposure, None is endless."""

    follower: str
    leader: str
    duration: float | None = None


class CameraBetween:
    """The camera of one run.

    `now_ns` is a monotonic clock; `report` is called with one line at a time, `on_truth` with the truth of each
    exposure. Raises LinkError and ScenarioError for invalid options.
    """

    def __init__(
        self,
        options: CameraOptions,
        now_ns: Callable[[], int],
        report: Callable[[str], None],
        on_truth: Callable[[Truth], None] = lambda _: None,
    ) -> None:
        if options.scenario.camera.gimbal is not None:
            raise ScenarioError(
                f"{options.scenario.name}: camera.gimbal: `simlink camera` supports a fixed mount only; remove it"
            )
        scenario = draw_scenario(options.scenario, options.seed)
        self.exposures = 0
        self._options, self._now_ns, self._report, self._on_truth = options, now_ns, report, on_truth
        self._camera = scenario.camera
        self._size = true_size(scenario, options.seed)
        self._vision = Vision(scenario, options.seed, self._size)
        if options.camera in ("mavlink", "both"):
            check_mavlink(scenario)
        frame = LocalFrame()
        self.follower = PeerLink("follower", options.follower, frame, now_ns, report)
        self.leader = PeerLink("leader", options.leader, frame, now_ns, report)
        self._outlet: Outlet | None = None
        self._begin_ns: int | None = None  # the first exposure
        self._count = 0  # of periods since
        self._in_transit: deque[tuple[int, Image]] = deque()  # with the time of exposure
        self._missing = {"follower": "", "leader": ""}

    @property
    def images(self) -> int:
        """Images sent so far."""
        return 0 if self._outlet is None else self._outlet.images

    async def run(self, stop: asyncio.Event) -> None:
        """Send images until the duration is over or `stop` is set. Raises LinkError."""
        o = self._options
        self._report(f"{o.scenario.name}, seed {o.seed}: {o.follower} sees {o.leader}; {o.destinations}")
        links = [asyncio.create_task(link.run()) for link in (self.follower, self.leader)]
        try:
            await self._wait_for_follower(stop, links)
            await self._run_exposures(stop, links)
        finally:
            for link in links:
                link.cancel()
            await asyncio.gather(*links, return_exceptions=True)
            if self._outlet is not None:
                await self._outlet.close()

    async def _wait_for_follower(self, stop: asyncio.Event, links: list[asyncio.Task[None]]) -> None:
        """Wait until the follower's system id is known, then open the outputs."""
        begin_ns = self._now_ns()
        while not stop.is_set() and (sender := self.follower.vehicle.sender) is None:
            self._report_missing(begin_ns)
            await self._poll(links)
        if not stop.is_set() and sender is not None:
            self._outlet = Outlet(self._options, sender[0])
            await self._outlet.open()

    async def _run_exposures(self, stop: asyncio.Event, links: list[asyncio.Task[None]]) -> None:
        outlet = self._outlet
        if outlet is None:
            return
        begin_ns, status_ns = self._now_ns(), 0
        while not stop.is_set() and not self._is_over():
            now_ns = self._now_ns()
            self._report_missing(begin_ns)
            self._expose(outlet)
            self._deliver(outlet, now_ns)
            if now_ns - status_ns >= STATUS_PERIOD_NS:
                self._status(outlet, finished=False)
                status_ns = now_ns
            await self._poll(links)
        await outlet.finish()
        self._status(outlet, finished=True)
        self._report(f"sent {outlet.images} images of {self.exposures} exposures")
        await outlet.flush()

    async def _poll(self, links: list[asyncio.Task[None]]) -> None:
        for link in links:
            if link.done():
                link.result()  # raises what ended it
        await asyncio.sleep(POLL_PERIOD_S)

    def _is_over(self) -> bool:
        duration, rate = self._options.duration, self._camera.rate
        return duration is not None and self.exposures >= duration * rate

    def _report_missing(self, begin_ns: int) -> None:
        """Report when a vehicle's true states do not arrive, and when they do again."""
        now_ns = self._now_ns()
        for link in (self.follower, self.leader):
            missing = link.vehicle.missing(now_ns)
            if missing == self._missing[link.name] or now_ns - begin_ns < GRACE_PERIOD_NS:
                continue
            self._missing[link.name] = missing
            self._report(f"{link.name} {link.url}: {missing or 'its true states arrive'}")

    def _expose(self, outlet: Outlet) -> None:
        """Take all exposures for which the true states of both vehicles have arrived."""
        follower, leader = self.follower.vehicle, self.leader.vehicle
        if follower.latest_ns is None or follower.offset_ns is None or leader.offset_ns is None:
            return
        period = NS_PER_S / self._camera.rate
        if self._begin_ns is None or follower.latest_ns < self._begin_ns:  # the beginning, or a reboot
            self._begin_ns, self._count = follower.latest_ns, 0
        between_ns = follower.offset_ns - leader.offset_ns
        while (t_ns := self._begin_ns + round(self._count * period)) <= follower.latest_ns:
            own, other = follower.at(t_ns), leader.at(t_ns + between_ns)
            if own is not None and other is not None:
                self._image(outlet, t_ns, own, other)
            elif t_ns > follower.latest_ns - MAX_LATENCY_NS:
                return  # its true state may still come
            self._count += 1

    def _image(self, outlet: Outlet, t_ns: int, own: Motion, other: Motion) -> None:
        state = make_state(self.exposures, self.exposures / self._camera.rate, other, own)
        truth = truth_record(state, self._size, t_ns)
        image = self._vision.expose(state, t_ns + round(self._camera.stamp_late * NS_PER_S))
        if image is not None:
            self._in_transit.append((t_ns, image))
        if not self.exposures:
            distance = math.dist(own.r_n, other.r_n)
            self._report(
                f"the first exposure: the leader is {distance:.1f} m away, {_visibility(image is not None)}"
            )
        outlet.draw(state, t_ns)
        outlet.publish(truth)
        self._on_truth(truth)
        self.exposures += 1

    def _deliver(self, outlet: Outlet, now_ns: int) -> None:
        """Send the images whose latency is over."""
        offset_ns = (self.follower.vehicle.offset_ns or 0.0) + self._camera.latency * NS_PER_S
        while self._in_transit and self._in_transit[0][0] + offset_ns <= now_ns:
            outlet.send_image(self._in_transit.popleft()[1])

    def _status(self, outlet: Outlet, *, finished: bool) -> None:
        t_ns = self.follower.vehicle.latest_ns or 0
        outlet.publish(SimStatus(t_ns=t_ns, images=outlet.images, frames=0, finished=finished))


def _visibility(is_seen: bool) -> str:
    return "in the image" if is_seen else "outside the image or missed"
