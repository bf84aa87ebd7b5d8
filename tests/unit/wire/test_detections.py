"""Detections as JSON: any subset of points, boxes, confidence; what is not known is ignored and named once."""

import json
from typing import Any

import pytest

from onboard.geometry.lens import Lens
from onboard.messages import Cause, Clock, Datagram, Encoding, TargetDetection, TargetPoints
from onboard.wire.datagrams import DatagramDecoder
from onboard.wire.documents.cameras import CameraInput
from onboard.wire.documents.detections import MAX_NAMED, MAX_UNNAMED
from tests.support.images import detections
from tests.support.mavlink_frames import RECEIVE_TIME_NS

LENS = Lens(fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0, width_px=640.0, height_px=480.0)
CAMERAS = {
    "front": CameraInput("front", LENS, sigma_px=1.0, min_confidence=0.3),
    "sized": CameraInput("sized", LENS, sigma_px=1.0, min_confidence=0.0, sizes=(1.8, 2.2)),
    "tele": CameraInput("tele", LENS, sigma_px=2.0, min_confidence=0.0),
    "shaped": CameraInput("shaped", LENS, 1.0, 0.0, points=("center", "left", "right", "nose", "tail")),
    "picky": CameraInput("picky", LENS, sigma_px=1.0, min_confidence=0.0, classes=("drone", "plane")),
}
CENTER, LEFT, RIGHT = ({"u_px": u, "v_px": 240.0} for u in (370.0, 320.0, 420.0))
BOX = {"u_px": 370.0, "v_px": 190.0, "width_px": 100.0, "height_px": 40.0}
HEAD: dict[str, Any] = {"t_ns": 5_000_000_000, "clock": "boot"}


class Decoded:
    """What becomes of one document: messages, and the reasons why parts of it were refused or ignored."""

    def __init__(self, *documents: dict[str, Any]) -> None:
        self.reasons: list[str] = []
        decoder = DatagramDecoder(on_refused=lambda _, why, __: self.reasons.append(why.words), cameras=CAMERAS)
        self.messages = []
        for document in documents:
            data = json.dumps(document).encode()
            datagram = Datagram(channel="c", encoding=Encoding.DETECTIONS, t_recv_ns=RECEIVE_TIME_NS, data=data)
            self.messages += detections(decoder.decode(datagram))
        self.rejected = dict(decoder.rejected)


def one(**detection: Any) -> Any:
    """The message of a document with one detection, of which nothing is refused."""
    decoded = Decoded({**HEAD, "detections": [detection]})
    assert decoded.reasons == []
    (message,) = decoded.messages
    return message


def test_all_three_points_are_target_points() -> None:
    m = one(points={"center": CENTER, "left": LEFT | {"sigma_px": 2.0}, "right": RIGHT})
    assert isinstance(m, TargetPoints)
    assert (m.center, m.left, m.right) == (pytest.approx((0.1, 0.0)), (0.0, 0.0), pytest.approx((0.2, 0.0)))
    assert m.sigma == pytest.approx((1 / 500, 2 / 500, 1 / 500))
    assert (m.t_ns, m.t_recv_ns, m.clock, m.camera, m.target) == (
        5_000_000_000,
        RECEIVE_TIME_NS,
        Clock.BOOT,
        "front",
        "",
    )
    assert m.view == pytest.approx((-0.64, -0.48, 0.64, 0.48))


@pytest.mark.parametrize("names", [("center",), ("left",), ("left", "right"), ("center", "right")], ids="+".join)
def test_fewer_points_stay_what_they_are(names: tuple[str, ...]) -> None:
    every = {"center": CENTER, "left": LEFT, "right": RIGHT}
    m = one(points={name: every[name] for name in names}, box=BOX)
    assert isinstance(m, TargetDetection)
    assert tuple(f.name for f in m.features) == (*names, "box")
    assert [f.point[0] * 500 + 320 for f in m.features[:-1]] == pytest.approx([every[n]["u_px"] for n in names])
    assert m.half_width == pytest.approx(50 / 500)
    assert one(points={names[0]: every[names[0]]}).half_width is None


def test_a_box_alone_is_its_middle_with_the_noise_of_boxes() -> None:
    m = one(box=BOX)
    assert isinstance(m, TargetDetection)
    (feature,) = m.features
    assert (feature.name, feature.point) == ("box", pytest.approx((0.1, -0.1)))
    assert feature.sigma == pytest.approx(0.05 * 100 / 500)
    assert m.half_width == pytest.approx(50 / 500)
    left, upper, right, lower = m.sides
    assert (left, right) == (pytest.approx((0.0, -0.1)), pytest.approx((0.2, -0.1)))
    assert (upper, lower) == (pytest.approx((0.1, -0.14)), pytest.approx((0.1, -0.06)))
    assert one(box=BOX | {"sigma_px": 3.0}).features[0].sigma == pytest.approx(3 / 500)
    at_edge = one(box=BOX | {"u_px": 60.0})  # ends ten pixels inside
    assert (at_edge.sides, at_edge.half_width) == (None, pytest.approx(50 / 500))


def test_noise_grows_as_confidence_falls_and_a_sigma_of_its_own_stays() -> None:
    def sigma(confidence: float, **point: Any) -> float:
        value: float = one(points={"center": CENTER | point}, confidence=confidence).features[0].sigma
        return value * 500

    assert [sigma(1.0), sigma(0.5), sigma(0.3)] == pytest.approx([1.0, 2.0, 10 / 3])
    assert sigma(0.5, sigma_px=1.5) == pytest.approx(1.5)


def test_below_the_threshold_a_detection_is_refused_and_the_others_are_not() -> None:
    sure, unsure = ({"points": {"center": CENTER}, "confidence": c} for c in (0.31, 0.29))
    decoded = Decoded({**HEAD, "detections": [sure, unsure]})
    assert len(decoded.messages) == 1
    (reason,) = decoded.reasons
    assert reason == (
        "it is not confident enough; `min_confidence` of camera front is 0.3 - at `$.detections[1].confidence`"
    )
    assert len(Decoded({**HEAD, "camera": "tele", "detections": [unsure]}).messages) == 1


def test_a_named_camera_brings_its_noise_and_intrinsics_of_an_image_hold_for_it() -> None:
    zoomed = {"fx_px": 1000.0, "fy_px": 1000.0, "cx_px": 320.0, "cy_px": 240.0}
    document = {**HEAD, "camera": "tele", "intrinsics": zoomed, "detections": [{"points": {"center": CENTER}}]}
    (m,) = Decoded(document).messages
    assert isinstance(m, TargetDetection)
    assert m.camera == "tele"
    assert m.features[0].point == pytest.approx((0.05, 0.0))
    assert m.features[0].sigma == pytest.approx(2 / 1000)


def test_intrinsics_of_an_image_that_are_doubtful_say_so() -> None:
    quarter = {
        "fx_px": 500.0,
        "fy_px": 500.0,
        "cx_px": 160.0,
        "cy_px": 120.0,
        "width_px": 640.0,
        "height_px": 480.0,
    }
    document = {**HEAD, "intrinsics": quarter, "detections": [{"points": {"center": CENTER}}]}
    (m,) = Decoded(document).messages
    assert isinstance(m, TargetDetection)
    assert m.features[0].point == pytest.approx((0.05, 0.0))
    assert m.doubt is not None
    assert m.doubt.cause is Cause.BINNED
    assert m.doubt.words.startswith("the principal point (160, 120) is the middle of 1/2 of the image")
    assert not one(points={"center": CENTER}).doubt


def test_unknown_fields_and_points_are_ignored_and_named_once() -> None:
    detection = {
        "points": {"center": CENTER | {"score": 1}, "nose": CENTER},
        "box": BOX | {"angle": 3},
        "mask": [1, 2],
    }
    document = {**HEAD, "frame_id": 7, "detections": [detection, detection]}
    decoded = Decoded(document, document)
    assert len(decoded.messages) == 4
    assert [r.split(";")[0] for r in decoded.reasons] == [
        "(the rest is used) the field `frame_id`",
        "(the rest is used) the field `detections.mask`",
        "(the rest is used) the field `detections.points.score`",
        "(the rest is used) the field `detections.box.angle`",
        "(the rest is used) the point `nose`",
    ]
    assert decoded.rejected == {"ignored_fields": 5}


@pytest.mark.parametrize(
    "detection",
    [
        {"points": {"center": {"u_px": 0.5, "v_px": 0.4}, "left": {"u_px": 0.45, "v_px": 0.4}}},
        {"box": {"u_px": 0.5, "v_px": 0.4, "width_px": 0.1, "height_px": 0.05}},
    ],
    ids=str,
)
def test_normalised_coordinates_are_named(detection: dict[str, Any]) -> None:
    decoded = Decoded({**HEAD, "detections": [detection]})
    assert decoded.reasons == ["coordinates look normalised, from 0 to 1: send pixels - at `$.detections[0]`"]


def test_the_names_of_ignored_fields_are_bounded() -> None:
    documents = [{**HEAD, f"x{i}": 1} for i in range(200)]
    assert Decoded(*documents).rejected == {"ignored_fields": 64}


def with_detection(**detection: Any) -> dict[str, Any]:
    return {**HEAD, "detections": [detection]}


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"t_ns": 1}, "missing required field `clock`; the fields of CameraDetections are t_ns, clock, came"),
        (
            {**HEAD, "camera": "rear"},
            "no camera is called `rear`; known: front, sized, tele, shaped, picky - at `$.camera`",
        ),
        (
            {**HEAD, "intrinsics": {"fx_px": 0, "fy_px": 1, "cx_px": 1, "cy_px": 1}},
            "must be positive - at `$.in",
        ),
        ({**HEAD, "detections": {}}, "Expected `array`, got `object` - at `$.detections`"),
        (
            with_detection(),
            "some of center, left, right, a `box`, or a `pose` with `position_m` - at `$.detections[0]`",
        ),
        (with_detection(points={"nose": CENTER}), "expected `points` with some of center, left, right"),
        (
            with_detection(points={"left": {"u_px": 1}}),
            "missing required field `v_px` - at `$.detections[0].poi",
        ),
        (
            with_detection(box=BOX | {"width_px": 0}),
            "height must be positive - at `$.detections[0].box`",
        ),
        (with_detection(box=BOX, confidence=80), "from 0 to 1 - at `$.detections[0].confidence`"),
        (with_detection(box=BOX, confidence="high"), "Expected `float | null`, got `str`"),
        (with_detection(box=BOX, target="a b"), "64 at most - at `$.detections[0].target`"),
    ],
    ids=lambda value: value[:32] if isinstance(value, str) else "",
)
def test_what_cannot_be_used_is_refused_by_its_field(document: dict[str, Any], expected: str) -> None:
    decoded = Decoded(document)
    assert decoded.messages == []
    assert expected in decoded.reasons[0]


def test_other_classes_than_those_that_are_followed_are_refused() -> None:
    def reasons(class_name: str) -> list[str]:
        return Decoded({**HEAD, "camera": "picky", "detections": [{"box": BOX, "class": class_name}]}).reasons

    assert reasons("bird") == [
        "`bird` is not followed; `classes` of camera picky are drone, plane - at `$.detections[0].class`"
    ]
    assert reasons("plane") == reasons("") == []
    assert one(box=BOX, **{"class": "bird"}).camera == "front"


def test_points_of_a_class_come_along_with_the_wing_or_without_it() -> None:
    points = {"tail": CENTER | {"sigma_px": 3.0}, "nose": LEFT, "center": CENTER, "left": LEFT, "right": RIGHT}
    document = {**HEAD, "camera": "shaped", "detections": [{"points": points, "class": "plane"}]}
    decoded = Decoded(document)
    (m,) = decoded.messages
    assert isinstance(m, TargetPoints)
    assert (m.class_name, decoded.reasons) == ("plane", [])
    assert [(f.name, round(f.sigma * 500, 6)) for f in m.others] == [("nose", 1.0), ("tail", 3.0)]
    assert m.image_points[3:] == ((0.0, 0.0), pytest.approx((0.1, 0.0)))
    del points["center"]
    (m,) = Decoded(document).messages
    assert isinstance(m, TargetDetection)
    assert [f.name for f in m.features] == ["left", "right", "nose", "tail"]


def test_a_keypoint_at_exactly_0_0_is_not_seen_and_that_is_named_once() -> None:
    """As Ultralytics writes it; it cost the whole image."""
    unseen = {"u_px": 0.0, "v_px": 0.0}
    image = {**HEAD, "detections": [{"points": {"center": CENTER, "left": unseen, "right": RIGHT}}]}
    nothing = {**HEAD, "detections": [{"points": dict.fromkeys(("center", "left", "right"), unseen)}]}
    decoded = Decoded(image, image)
    found = [[f.name for f in m.features] for m in decoded.messages if isinstance(m, TargetDetection)]
    assert found == [["center", "right"]] * 2
    assert ["(0, 0)" in reason for reason in decoded.reasons] == [True]
    assert "expected `points` with some of" in Decoded(nothing).reasons[-1]
    assert [f.name for f in one(points={"left": {"u_px": 0.0, "v_px": 3.0}, "right": RIGHT}).features] == [
        *("left", "right")
    ]


def test_an_image_in_which_nothing_was_found_is_no_refusal() -> None:
    assert Decoded({**HEAD, "detections": []}).reasons == []


def test_a_range_beside_a_detection_is_kept_with_its_sigma() -> None:
    assert (one(points={"center": CENTER}).range, one(points={"center": CENTER}).range_sigma) == (None, None)
    m = one(points={"center": CENTER, "left": LEFT, "right": RIGHT}, range_m=28.5, range_sigma_m=0.2)
    assert (m.range, m.range_sigma) == (28.5, 0.2)
    assert one(box=BOX, range_m=28.5).range == 28.5


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"range_m": 0.0}, "expected metres above 0 and below 100000 - at `$.detections[0].range_m`"),
        ({"range_m": -3.0}, "expected metres above 0 and below 100000 - at `$.detections[0].range_m`"),
        (
            {"range_m": 3.0, "range_sigma_m": 0.0},
            "expected metres above 0 and below 100000 - at `$.detections[0].range_sigma_m`",
        ),
        (
            {"range_sigma_m": 0.1},
            "a sigma without a range; send `range_m` too - at `$.detections[0].range_sigma_m`",
        ),
    ],
)
def test_a_range_that_is_none_is_refused(given: dict[str, float], reason: str) -> None:
    decoded = Decoded({**HEAD, "detections": [{"points": {"center": CENTER}, **given}]})
    assert decoded.reasons == [reason]
    assert not decoded.messages


SEEN = {"u_px": 370.0, "v_px": 300.0, "width_px": 40.0, "height_px": 20.0}  # 2 m at 25 m
WHERE = (2.5, 3.0, 25.0)  # right, down, forward: so it is there
BOTH = "`$.detections[0].pose.position_m` and `$.detections[0].box`"


def sized(**detection: Any) -> Decoded:
    return Decoded({**HEAD, "camera": "sized", "detections": [detection, {"box": SEEN}]})


@pytest.mark.parametrize(
    "detection",
    [
        {"box": SEEN, "pose": {"position_m": WHERE}},
        {"box": SEEN, "range_m": 25.0},
        {"box": SEEN | {"width_px": 12.0, "height_px": 12.0}, "range_m": 25.0},  # from its edge
        {"box": SEEN, "range_m": 40.0},
        {"points": {"center": CENTER}, "pose": {"position_m": (2.5, 0.5, 25.0)}},
        {"box": {"u_px": 630.0, "v_px": 240.0, "width_px": 20.0, "height_px": 6.0}, "range_m": 5.0},  # cut off
    ],
)
def test_statements_of_one_detection_that_agree_are_used(detection: dict[str, Any]) -> None:
    decoded = sized(**detection)
    assert decoded.reasons == []
    assert len(decoded.messages) == 2


@pytest.mark.parametrize(
    ("detection", "reason"),
    [
        (
            {"pose": {"position_m": (2500.0, 3000.0, 25000.0)}},
            f"1.99e+03 m large, of a wingspan of 1.8 to 2.2 m; expected metres - at {BOTH}",
        ),
        (
            {"pose": {"position_m": (2.5, -3.0, 25.0)}},
            f"the position is 14 degrees from `box`; expected right, down, forward in metres - at {BOTH}",
        ),
        (
            {"pose": {"position_m": (-2.5, 3.0, 25.0)}},
            f"the position is 11 degrees from `box`; expected right, down, forward in metres - at {BOTH}",
        ),
        ({"range_m": 25000.0}, "expected metres - at `$.detections[0].range_m` and `$.detections[0].box`"),
        (
            {"range_m": 0.5},
            "at 0.5 m the box would be 0.0393 m large, of a wingspan of 1.8 to 2.2 m; expected metres",
        ),
        ({"range_m": 82.0}, "at 82 m the box would be 6.44 m large"),  # feet
    ],
)
def test_statements_of_one_detection_that_cannot_both_be_are_refused_and_both_named(
    detection: dict[str, Any], reason: str
) -> None:
    decoded = sized(box=SEEN, **detection)
    assert len(decoded.messages) == 1
    (found,) = decoded.reasons
    assert reason in found


def test_a_position_beside_its_center_elsewhere_is_refused() -> None:
    decoded = sized(points={"center": CENTER | {"v_px": 300.0}}, pose={"position_m": (2.5, -3.0, 25.0)})
    assert "the position is 14 degrees from `points.center`" in decoded.reasons[0]


@pytest.mark.parametrize(
    ("odd", "reason"),
    [
        ({"class": 4}, "Expected `str`, got `int` - at `$.detections[0].class`"),
        ({"class": None}, "Expected `str`, got `null` - at `$.detections[0].class`"),
        ({"id": 7.5}, "Expected `int | str | null`, got `float` - at `$.detections[0].id`"),
        ({"target": None}, "Expected `str`, got `null` - at `$.detections[0].target`"),
        ({"confidence": float("nan")}, "expected a finite number, got nan - at `$.detections[0].confidence`"),
        ({"confidence": float("inf")}, "expected a finite number, got inf - at `$.detections[0].confidence`"),
        ({"confidence": "0.9"}, "Expected `float | null`, got `str` - at `$.detections[0].confidence`"),
        ({"box": [1, 2, 3, 4]}, "Expected `object | null`, got `array` - at `$.detections[0].box`"),
        ({"points": {"left": None}}, "Expected `object`, got `null` - at `$.detections[0].points[...]`"),
        ({"range_m": [float("-inf")]}, "expected a finite number, got -inf - at `$.detections[0].range_m[0]`"),
    ],
    ids=str,
)
def test_a_detection_that_cannot_be_read_costs_the_others_nothing(odd: dict[str, Any], reason: str) -> None:
    decoded = Decoded({**HEAD, "detections": [{"box": BOX, **odd}, {"box": BOX, "confidence": 0.9}]})
    assert decoded.messages == Decoded({**HEAD, "detections": [{"box": BOX, "confidence": 0.9}]}).messages
    assert decoded.reasons == [reason]
    assert decoded.rejected == {"bad_detections": 1}


def test_what_follows_a_detection_that_cannot_be_read_is_named_by_its_own_number() -> None:
    rows = [{"box": BOX, "class": 4}, {"box": BOX}, {"box": BOX, "confidence": 80}]
    reasons = Decoded({**HEAD, "detections": rows}).reasons
    assert [reason.split(" - at ")[1] for reason in reasons] == [
        "`$.detections[0].class`",
        "`$.detections[2].confidence`",
    ]


def test_a_whole_number_may_be_written_with_a_point() -> None:
    plain = Decoded({**HEAD, "detections": [{"box": BOX, "id": 7}]})
    floats = Decoded({**HEAD, "t_ns": 5e9, "detections": [{"box": BOX, "id": 7.0}]})
    assert (floats.messages, floats.reasons) == (plain.messages, [])
    assert "Expected `int`, got `float` - at `$.t_ns`" in Decoded({**HEAD, "t_ns": 1.7e9 + 0.25}).reasons[0]


def test_of_too_many_detections_the_most_confident_ones_are_used_and_the_rest_named() -> None:
    """Each without an id is compared with each track: a hundred would cost more time than an image has."""
    boxes = [{"box": BOX, "confidence": 0.4 + 0.005 * (7 * k % 100)} for k in range(100)]
    decoded = Decoded({**HEAD, "detections": [*boxes, {"box": BOX, "target": "leader"}, {"box": BOX}]})
    assert len(decoded.messages) == MAX_UNNAMED + 1
    assert [m.target for m in decoded.messages[-2:] if isinstance(m, TargetDetection)] == ["leader", ""]
    surest = sorted(boxes, key=lambda box: -float(str(box["confidence"])))[: MAX_UNNAMED - 1]
    alone = Decoded({**HEAD, "detections": [box for box in boxes if box in surest]})
    assert decoded.messages[:-2] == alone.messages
    (reason,) = decoded.reasons
    assert reason.startswith("102 detections in one image: the 12 most confident ones are used")
    named = [{"box": BOX, "target": f"target/{k}"} for k in range(MAX_NAMED + 1)]
    assert len(Decoded({**HEAD, "detections": named}).messages) == MAX_NAMED
