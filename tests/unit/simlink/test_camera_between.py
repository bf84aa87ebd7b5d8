"""`simlink camera`: what a camera on one simulated vehicle would see of another, from the true states of both."""

import asyncio
import math
import time
from itertools import islice
from typing import Any

import msgspec
import numpy as np
import pytest

from onboard.messages import CameraDetections, Clock, Exposure, Heartbeat, SimStatus, TargetPoints, Truth
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.autopilot import AutopilotLink
from simlink.cli import main
from simlink.scenarios.scenario import Scenario, ScenarioError, load_scenario
from simlink.sensors.camera import mount_quaternion
from simlink.sensors.navigation import readings
from simlink.server.between import CameraBetween, CameraOptions
from simlink.server.links import LinkError
from simlink.server.observed import LocalFrame, ObservedVehicle
from simlink.server.outlet import Outlet
from simlink.server.server import Options, Server
from simlink.world import attitude
from simlink.world.constants import STEP_NS
from simlink.world.truth import path_accelerations, states
from tests.support.simlink_server import UNIX_TIME_NS, run, until

SITL = load_scenario("sitl")
BOXES = msgspec.structs.replace(SITL, camera=msgspec.structs.replace(SITL.camera, sees="box"))
EPOCH_NS = 7 * 10**9  # the observer's clock when the vehicle's shows zero
LATE_NS = 3_000_000


def of(autopilot: str, boot: float = 40.0, **changed: Any) -> Scenario:
    vehicle = msgspec.structs.replace(SITL.vehicle, autopilot=autopilot, boot=boot)
    return msgspec.structs.replace(SITL, vehicle=vehicle, **changed)


def observed(
    scenario: Scenario, seconds: float, seed: int = 1, speed: float = 1.0
) -> tuple[ObservedVehicle, list[Any]]:
    """A vehicle that simlink flies, observed over a link, and its true states. `speed`: of its clock in ours."""
    link = AutopilotLink(scenario.vehicle, UNIX_TIME_NS, stream=False)
    vehicle = ObservedVehicle(LocalFrame(), stream=False)
    flown = []
    for state, reading in islice(readings(scenario, seed, states(scenario, seed)), round(200 * seconds)):
        t_ns = state.step * STEP_NS
        now_ns = EPOCH_NS + round(t_ns / speed) + LATE_NS
        for frame in link.send(t_ns, reading):
            vehicle.receive(frame, now_ns)
        for frame in vehicle.requests(now_ns):
            link.receive(frame, t_ns)
        flown.append(state)
    return vehicle, flown


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_vehicle_is_observed_where_it_is_seed_1(autopilot: str) -> None:
    vehicle, flown = observed(of(autopilot), 6.0)
    assert vehicle.missing(EPOCH_NS + flown[-1].step * STEP_NS) == ""
    assert vehicle.offset_ns == pytest.approx(EPOCH_NS + LATE_NS, abs=1e6)
    origin = None
    for state in flown[900:1180:7]:  # most are between two messages
        motion = vehicle.at(state.step * STEP_NS)
        assert motion is not None
        shift = np.subtract(motion.r_n, state.r_OF_n)
        origin = shift if origin is None else origin
        assert np.abs(shift - origin).max() < 0.03  # degrees come in steps of 11 mm
        assert np.abs(np.subtract(motion.v_n, state.v_F_n)).max() < 0.006
        assert np.abs(np.subtract(motion.a_n, state.a_F_n)).max() < 0.15
        assert abs(np.dot(motion.q_nb, state.q_nF)) > 1 - 1e-6


def test_the_truth_is_requested_and_is_nobody_elses() -> None:
    vehicle = ObservedVehicle(LocalFrame(), stream=False)
    assert vehicle.missing(0) == "no heartbeat of an autopilot has arrived"
    station = Heartbeat(t_ns=0, t_recv_ns=0, vehicle_type=6, autopilot=8, armed=False, status=4)
    vehicle.receive(MavlinkEncoder(255, 190).encode(station), 0)
    assert vehicle.sender is None
    beat = Heartbeat(t_ns=0, t_recv_ns=0, vehicle_type=2, autopilot=12, armed=True, status=4)
    vehicle.receive(MavlinkEncoder(7, 1).encode(beat), 0)
    assert vehicle.missing(0) == ("PX4, system 7, sends no HIL_STATE_QUATERNION; only simulated vehicles do")
    decoder = MavlinkDecoder(stream=False)
    commands: list[Any] = [m for frame in vehicle.requests(5 * 10**9) for m in decoder.decode(frame, 0)][1:]
    assert [(c.target_system, c.command, *c.params[:2]) for c in commands] == [
        (7, 511, 31.0, 20_000.0),
        (7, 511, 115.0, 20_000.0),
    ]


def test_a_rebooted_vehicle_begins_anew_seed_1() -> None:
    vehicle, flown = observed(of("ardupilot"), 4.0)
    link = AutopilotLink(SITL.vehicle, UNIX_TIME_NS, stream=False)
    for state, reading in islice(readings(SITL, 1, states(SITL, 1)), 400):
        t_ns = state.step * STEP_NS
        now_ns = EPOCH_NS + 8 * 10**9 + t_ns
        for frame in link.send(t_ns, reading):
            vehicle.receive(frame, now_ns)
        for frame in vehicle.requests(now_ns):
            link.receive(frame, t_ns)
    assert vehicle.latest_ns is not None
    assert vehicle.latest_ns < 2 * 10**9
    assert vehicle.at(flown[-10].step * STEP_NS) is None


@pytest.mark.parametrize("speed", [0.7, 3.0])
def test_a_clock_of_another_speed_is_said_seed_1(speed: float) -> None:
    vehicle, flown = observed(of("ardupilot"), 12.0, speed=speed)
    now_ns = EPOCH_NS + round(flown[-1].step * STEP_NS / speed)
    assert vehicle.missing(now_ns).startswith(
        "its clock and this computer's run at different speeds; set speedup 1"
    )


class Screen(asyncio.DatagramProtocol):
    """The receiver of the image points."""

    def __init__(self) -> None:
        self.images: list[Exposure] = []
        self._decoder = MavlinkDecoder(stream=False)

    def datagram_received(self, data: bytes, _: Any) -> None:
        self.images += self._decoder.decode(data, 0)


async def fly(lines: list[str], truths: list[Truth], **changed: Any) -> list[Exposure]:
    """The camera between a follower and an aircraft that flies where the follower's leader would be."""
    screen, stop = Screen(), asyncio.Event()
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: screen, local_addr=("127.0.0.1", 0))
    port = transport.get_extra_info("sockname")[1]
    ahead = msgspec.structs.replace(SITL.follower, slot=(0.0, 0.0, 0.0))
    flown = [of("ardupilot"), of("px4", boot=70.0, follower=ahead)]
    quiet: dict[str, Any] = {"camera": "none", "zenoh": None, "mavlink": None, "tcp_port": 0}
    servers = [Server(Options(scenario=s, **quiet), time.monotonic, UNIX_TIME_NS, lambda _: None) for s in flown]
    flights = [asyncio.create_task(server.run(stop)) for server in servers]
    await until(lambda: all(server.tcp is not None and server.tcp.is_open for server in servers))
    urls = [f"tcp:127.0.0.1:{server.tcp.port}" for server in servers if server.tcp is not None]
    given: dict[str, Any] = {"camera": "mavlink", "camera_mavlink": f"udpout:127.0.0.1:{port}", "zenoh": None}
    given |= {"scenario": SITL, "follower": urls[0], "leader": urls[1], "duration": 2.0}
    options = CameraOptions(**(given | changed))
    await CameraBetween(options, time.monotonic_ns, lines.append, truths.append).run(asyncio.Event())
    stop.set()
    await asyncio.gather(*flights)
    transport.close()
    return screen.images


def test_the_camera_sees_one_vehicle_from_the_other_seed_1() -> None:
    lines: list[str] = []
    truths: list[Truth] = []
    images = run(lambda: fly(lines, truths))
    assert len(truths) == 50
    assert 35 < len(images) <= 50
    q_bc = mount_quaternion(SITL.camera)
    by_time = {truth.t_ns // 1000: truth for truth in truths}
    off = []
    for exposure in images:
        (image,) = exposure.detections
        assert isinstance(image, TargetPoints)
        truth = by_time[image.t_ns // 1000]
        assert math.hypot(*truth.r_FL_n) == pytest.approx(25.0, abs=1.5)  # they do not begin at one instant
        x, y, z = attitude.to_b(q_bc, attitude.to_b(truth.q_nF, truth.r_FL_n))
        off.append(np.subtract(image.center, (y / x, z / x)) * SITL.camera.f_px)
    assert image.system == 1
    assert 0.7 < np.std(off) < 1.4  # px, as configured
    assert {truth.size for truth in truths} == {2.0}
    assert any(line.startswith("the first exposure: the leader is 2") for line in lines)
    assert lines[-1] == f"sent {len(images)} images of 50 exposures"


def test_boxes_contain_the_wing_seed_1(monkeypatch: pytest.MonkeyPatch) -> None:
    documents: list[Any] = []
    truths: list[Truth] = []
    monkeypatch.setattr(Outlet, "publish", lambda _, record: documents.append(record))
    run(lambda: fly([], truths, camera="zenoh", zenoh="tcp/127.0.0.1:1", scenario=BOXES))
    boxes = [d for d in documents if isinstance(d, CameraDetections)]
    assert 35 < len(boxes) <= 50
    assert boxes[0].clock is Clock.BOOT
    (detection,) = boxes[0].detections
    assert detection.box is not None
    assert detection.box.width_px == pytest.approx(SITL.camera.f_px * 2.0 / 25.0, rel=0.3)
    assert detection.box.height_px < detection.box.width_px
    status = [d for d in documents if isinstance(d, SimStatus) and d.frames == 0]  # the vehicles send theirs
    assert status[-1] == SimStatus(t_ns=status[-1].t_ns, images=len(boxes), frames=0, finished=True)


def test_accelerations_are_across_the_path() -> None:
    assert path_accelerations((0.0, 0.0, 1.0), (1.0, 1.0, 1.0)) == (0.0, 0.0)
    assert path_accelerations((10.0, 0.0, 0.0), (3.0, 2.0, -1.0)) == pytest.approx((2.0, 1.0))
    climbing = path_accelerations((0.0, 5.0, -5.0), (0.0, 1.0, 0.0))  # ahead, on the way up: pushed below the path
    assert climbing == pytest.approx((0.0, -math.sqrt(0.5)))


def test_what_cannot_be_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(LinkError, match="expected tcp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT"):
        CameraBetween(CameraOptions(scenario=SITL, follower="tcp:x", leader="tcp:x"), time.monotonic_ns, print)
    gimbal = load_scenario("formation-gimbal")
    with pytest.raises(ScenarioError, match="fixed mount only; remove it"):
        CameraBetween(CameraOptions(scenario=gimbal, follower="", leader=""), time.monotonic_ns, print)
    boxes = CameraOptions(scenario=BOXES, follower="", leader="", camera="mavlink")
    with pytest.raises(ScenarioError, match="sees is 'box', but LANDING_TARGET carries 'wing' only"):
        CameraBetween(boxes, time.monotonic_ns, print)
    assert main(["camera", "--follower", "", "--leader", "", "--sees", "box", "--camera", "both"]) == 2
    assert "camera.sees is 'box', but LANDING_TARGET" in capsys.readouterr().err
    assert main(["camera", "formation-wrong-blobs", "--follower", "", "--leader", "", "--sees", "box"]) == 2
    assert "--sees: camera.wrong_blob needs camera.sees = 'wing'" in capsys.readouterr().err
    assert main(["camera", "--follower", "serial:x", "--leader", "tcp:127.0.0.1:1"]) == 2
    assert "bad link 'serial:x'" in capsys.readouterr().err


def test_what_is_missing_is_said() -> None:
    """No leader at its port: the reason at once, once; then which vehicle is not heard."""

    async def fly_alone() -> list[str]:
        lines: list[str] = []
        stop, seconds = asyncio.Event(), 0.0

        def now_ns() -> int:
            nonlocal seconds
            seconds += 0.05
            return round(seconds * 1e9)

        options = CameraOptions(scenario=SITL, follower="tcp:127.0.0.1:1", leader="udpin:127.0.0.1:0", zenoh=None)
        camera = CameraBetween(msgspec.structs.replace(options, camera="mavlink"), now_ns, lines.append)
        flight = asyncio.create_task(camera.run(stop))
        await until(lambda: len(lines) >= 4)
        stop.set()
        await flight
        return lines

    lines = run(fly_alone)
    assert lines[1] == "follower tcp:127.0.0.1:1: connection refused; retrying"
    assert lines[2] == "follower tcp:127.0.0.1:1: no heartbeat of an autopilot has arrived"
    assert lines[3] == "leader udpin:127.0.0.1:0: no heartbeat of an autopilot has arrived"
    assert len(lines) == 4
