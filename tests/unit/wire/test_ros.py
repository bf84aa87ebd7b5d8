"""vision_msgs/Detection2DArray in CDR. The golden bytes were written by another library (rosbags 0.11.9)."""

import base64
import struct
import zlib
from typing import Any

import numpy as np
import pytest

from onboard.config import Config, ConfigError, parse_config
from onboard.messages import Clock, Datagram, Encoding, TargetDetection
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.ros.received import decode_boxes
from tests.support.images import detections
from tests.support.streams import EPOCH, feed

LITTLE = (
    "c-muNWMF7*ElF?K^o);%fq@}8F_(df0lOG05GQ38r7)m?1NIR51C(ZPfKVI`40r)t{V2cz*nl{tC_gV1MfAmJc+(Palt99fBM&V+U7&nT2T"
    ")!x$C5`-K_path=YW#OUQ4<pV08PgNmy-FoGxmjo>3y"
)
BIG = (
    "c-muNU|>iuX>H|uwy6QgWJylU1yT%5*u;RCH7T<wg#ile4?yV;5ZVDM?!du-7r@ky0)l`or6@ly6&7wUM#Gzyz@Y>ZkPdmM0qWoar8VI~Oy"
    "=104Mbfeln#N0|4+r=AuhTS4t7v+6}VDH1_04sBUA"
)
NO_BOXES = "the bytes are no vision_msgs/Detection2DArray"
KEY = "0/detector/boxes/vision_msgs::msg::dds_::Detection2DArray_/RIHS01_0123"


def golden(text: str = LITTLE) -> bytes:
    """Two detections at 1735689605.25 s: a drone (0.75; a bird, 0.125) of id 7, and a turned box."""
    return zlib.decompress(base64.b85decode(text))


def config(**camera: Any) -> Config:
    return parse_config({"camera": {"ros_topic": "detector/boxes"} | camera, "estimator": {"leader": {}}})


def sent(data: bytes, key: str = KEY) -> Datagram:
    return Datagram(channel=key, encoding=Encoding.ROS, t_recv_ns=EPOCH, data=data)


@pytest.mark.parametrize("text", [LITTLE, BIG])
def test_boxes_have_the_class_and_score_of_the_best_hypothesis_in_either_byte_order(text: str) -> None:
    document = decode_boxes(golden(text))
    assert (document.t_ns, document.clock) == (1_735_689_605_250_000_000, Clock.HOST)
    drone, turned = document.detections
    assert (drone.class_name, drone.confidence, drone.id) == ("drone", 0.75, "7")
    assert drone.box is not None
    assert (drone.box.u_px, drone.box.v_px, drone.box.width_px, drone.box.height_px) == (320.5, 240.25, 40.0, 12.5)
    assert turned.box is not None
    assert (turned.box.width_px, turned.box.height_px) == pytest.approx((10.0, 30.0))
    assert (turned.class_name, turned.confidence, turned.id) == ("", None, None)


@pytest.mark.parametrize("key", [KEY, "detector/boxes", KEY.replace("0/", "42/", 1)])
def test_a_message_becomes_images_of_the_camera_that_has_its_topic(key: str) -> None:
    settings = parse_config(
        {"camera": {"ros_topic": "other"}, "cameras": {"tele": {"ros_topic": "detector/boxes"}}}
    )
    first: Any
    second: Any
    first, second = detections(feed([], settings).pipeline.decode(sent(golden(), key)))
    assert isinstance(first, TargetDetection)
    assert (first.camera, second.camera) == ("tele", "tele")
    assert first.features[0].point == pytest.approx((0.5 / 554.256, 0.25 / 554.256))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", NO_BOXES),
        (b"\0\3\0\0" + bytes(100), f"{NO_BOXES}.*encapsulation"),
        (golden()[:-1], NO_BOXES),
        (golden()[:40], NO_BOXES),
        (b"\0\1\0\0" + struct.pack("<iIII", 5, 0, 0, 2**31), NO_BOXES),
        (b"\0\1\0\0" + struct.pack("<iIIII", 0, 0, 1, 0, 0), "`header.stamp` is not set"),
        (bytes(70_000), "the message has more than 65536 bytes"),
        (
            golden().replace(struct.pack("<d", 320.5), struct.pack("<d", float("nan"))),
            r"at `\$.detections\[0\].bbox`",
        ),
    ],
)
def test_what_is_no_such_message_is_refused(data: bytes, expected: str) -> None:
    with pytest.raises(BadDocumentError, match=expected):
        decode_boxes(data)
    run = feed([sent(data)], config())
    assert run.rejected["bad_ros"] == 1


def test_a_message_with_wrong_bytes_costs_itself_at_most_seed_1() -> None:
    rng, pipeline = np.random.default_rng(1), feed([], config()).pipeline
    for _ in range(500):
        data = bytearray(golden())
        for at in rng.integers(0, len(data), size=rng.integers(1, 6)):
            data[at] = rng.integers(0, 256)
        pipeline.feed(sent(bytes(data)))
    assert pipeline.errors == []
    assert pipeline.health(EPOCH).rejected["bad_ros"] > 20


def test_a_topic_that_no_camera_has_is_refused_by_name() -> None:
    run = feed([sent(golden(), "0/elsewhere/type/hash")], config())
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason == "no camera has this `ros_topic`; known: detector/boxes"


def test_one_box_that_is_not_followed_costs_the_other_nothing() -> None:
    run = feed([], config(classes=["bird"]))
    (message,) = detections(run.pipeline.decode(sent(golden())))
    assert isinstance(message, TargetDetection)
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason.startswith("`drone` is not followed")


def test_keys_are_those_of_rmw_zenoh_and_of_the_bridge() -> None:
    assert config().ros_keys() == [
        "*/detector/boxes/*/*",
        "detector/boxes",
    ]
    with pytest.raises(ConfigError, match="write its name without the leading slash"):
        config(ros_topic="/detector/boxes")
