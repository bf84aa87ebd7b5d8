"""Detectors as the pages show them: the examples run, and the daemon's links receive what they send."""

import asyncio
import re
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from onboard.client import Camera
from onboard.config import load_config, parse_config
from onboard.links import Link, parse_link
from onboard.links.zenoh import ZenohLink
from onboard.messages import Box, CameraDetections, Clock, Datagram, Detection, Encoding, TargetDetection
from onboard.wire.datagrams import DatagramDecoder
from tests.support import documents
from tests.support.images import detections
from tests.support.programs import TIMEOUT_S, free_ports
from tests.unit.wire.test_ros import KEY as ROS_KEY
from tests.unit.wire.test_ros import golden


def example(k: int) -> str:
    """The k-th Python example of the page on detectors."""
    return documents.blocks(documents.text("detectors"), "python")[k]


def received(link: Link, send: Callable[[], None]) -> Datagram:
    """The first datagram of a link while something sends again and again: a subscription takes a while."""
    found: list[Datagram] = []

    async def main() -> None:
        await link.open()
        task = asyncio.create_task(link.run(found.append, time.time_ns))
        async with asyncio.timeout(TIMEOUT_S):
            while not found:
                await asyncio.to_thread(send)
                await asyncio.sleep(0.01)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    asyncio.run(main())
    return found[0]


def decoded(datagram: Datagram) -> list[Any]:
    """Its messages with the default configuration; nothing may be refused or ignored."""
    reasons: list[str] = []
    decoder = DatagramDecoder(
        on_refused=lambda _, why, __: reasons.append(why.words), cameras=load_config(None).camera_inputs()
    )
    messages = decoder.decode(datagram)
    assert reasons == []
    return detections(messages)


def test_the_page_s_python_example_sends_a_pair_of_wingtips(session: Any, endpoint: str) -> None:
    code = example(0).replace("Camera()", f"Camera(endpoint={endpoint!r})")
    link = ZenohLink(session, "onboard/1", camera="front")
    datagram = received(link, lambda: exec(code, {}))  # noqa: S102 - what a reader would paste
    assert (datagram.channel, datagram.encoding) == ("onboard/1/camera/any/detections", Encoding.DETECTIONS)
    (message,) = decoded(datagram)
    assert isinstance(message, TargetDetection)
    assert [f.name for f in message.features] == ["left", "right"]
    assert (message.t_ns, message.camera) == (1795212000123456789, "front")
    assert message.features[0].sigma == pytest.approx(1 / 0.8 / 554.256)


class _Tensor:
    """What a detector on a graphics card gives: numbers come by way of the processor."""

    def __init__(self, *rows: object) -> None:
        self._rows = np.array(rows, dtype=np.float32)

    def cpu(self) -> "_Tensor":
        return self

    def numpy(self) -> Any:
        return self._rows


def test_the_page_s_yolo_example_sends_all_boxes_of_an_image(
    session: Any, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    boxes = SimpleNamespace(
        xywh=_Tensor((320.5, 240.25, 40.0, 12.5), (100.0, 50.0, 8.0, 8.0)),
        cls=_Tensor(4, 14),
        conf=_Tensor(0.75, 0.5),
    )
    result = SimpleNamespace(names={4: "airplane", 14: "bird"}, boxes=boxes)
    yolo = SimpleNamespace(YOLO=lambda _file: lambda **_given: iter([result]))
    monkeypatch.setitem(sys.modules, "ultralytics", yolo)
    code = example(1).replace("Camera()", f"Camera(endpoint={endpoint!r})")
    link = ZenohLink(session, "onboard/1", camera="front")
    datagram = received(link, lambda: exec(code, {}))  # noqa: S102 - what a reader would paste
    plane, bird = decoded(datagram)
    assert (plane.class_name, bird.class_name) == ("airplane", "bird")
    assert plane.features[0].point == pytest.approx((0.5 / 554.256, 0.25 / 554.256))
    sent = msgspec.json.decode(datagram.data, type=CameraDetections).detections[0]
    assert (sent.confidence, sent.box) == (0.75, Box(u_px=320.5, v_px=240.25, width_px=40.0, height_px=12.5))


def test_the_page_s_udp_example_sends_a_box() -> None:
    (port,) = free_ports(socket.SOCK_DGRAM)
    code = re.sub(r"14570", str(port), example(2))
    datagram = received(parse_link(f"json:127.0.0.1:{port}", "detector"), lambda: exec(code, {}))  # noqa: S102
    assert datagram.channel == "detector"
    (message,) = decoded(datagram)
    assert message.features[0].name == "box"
    assert message.t_ns <= datagram.t_recv_ns


def test_a_datagram_of_a_json_link_is_a_document() -> None:
    (port,) = free_ports(socket.SOCK_DGRAM)
    data = b'{"t_ns": 1, "clock": "boot"}'
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        link = parse_link(f"json:127.0.0.1:{port}", "detector")
        datagram = received(link, lambda: udp.sendto(data, ("127.0.0.1", port)) and None)
    assert (datagram.data, datagram.encoding) == (data, Encoding.DETECTIONS)


def test_a_camera_sends_all_aircraft_of_an_image_at_once(session: Any, endpoint: str) -> None:
    both = [
        Detection(box=Box(u_px=1.0, v_px=2.0, width_px=3.0, height_px=4.0), target=name) for name in ("a", "b")
    ]
    with Camera("front", endpoint=endpoint, clock=Clock.BOOT) as camera:
        link = ZenohLink(session, "onboard/1", camera="front")
        datagram = received(link, lambda: camera.send_all(both))
    assert datagram.channel == "onboard/1/camera/front/detections"
    one, other = decoded(datagram)
    assert (one.target, other.target) == ("a", "b")
    assert one.t_ns == other.t_ns <= datagram.t_recv_ns
    sent = msgspec.json.decode(datagram.data, type=CameraDetections)
    assert sent.clock is Clock.HOST  # a time that it did not get is Unix time


def test_nothing_is_sent_to_a_detector() -> None:
    (link,) = load_config(None, ("link=[{name='d', url='json:127.0.0.1:14570'}]",)).link
    assert not link.is_autopilot


def test_a_topic_of_ros_is_heard_under_the_keys_of_rmw_zenoh_and_of_the_bridge(session: Any) -> None:
    settings = parse_config({"camera": {"ros_topic": "detector/boxes"}})
    for key in (ROS_KEY, "detector/boxes"):
        link = ZenohLink(session, "onboard/1", camera="front", ros=settings.ros_keys())
        datagram = received(link, lambda key=key: session.put(key, golden()))
        assert (datagram.channel, datagram.encoding, datagram.data) == (key, Encoding.ROS, golden())


def test_numbers_of_numpy_are_sent_as_numbers(session: Any, endpoint: str) -> None:
    points = {"left": np.array([310.5, 226.0]), "right": (np.float32(352.5), np.float64(223.5), np.float32(0.5))}
    box = np.array([330.0, 225.0, 44.0, 12.0], dtype=np.float32)
    with Camera("front", endpoint=endpoint, clock=Clock.BOOT) as camera:
        link = ZenohLink(session, "onboard/1", camera="front")
        kinds = {"t_ns": np.int64(5), "confidence": np.float32(0.5)}
        datagram = received(link, lambda: camera.send(points, box=box, **kinds))
    sent = msgspec.json.decode(datagram.data, type=CameraDetections)
    assert (sent.t_ns, sent.clock) == (5, Clock.BOOT)
    (detection,) = sent.detections
    assert detection.box == Box(u_px=330.0, v_px=225.0, width_px=44.0, height_px=12.0)
    assert detection.points["right"].sigma_px == 0.5
