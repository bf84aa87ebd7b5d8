"""Camera messages that are refused: each names its field, on standard error, in the health and in the view."""

import json
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.daemon import Daemon
from onboard.health.refusals import MAX_REFUSAL_COUNT, MAX_SIMILAR_COUNT, MAX_TEXT_LENGTH, OTHERS, Refusals
from onboard.messages import Cause, Datagram, Encoding, Health, LocalPosition, Reason, Verdict
from onboard.sinks.console import MAX_LINE_COUNT
from onboard.view import words
from tests.support.streams import CIRCLE, EPOCH, MS, Item, S, Stream, encode, feed, heartbeat, make_config
from tests.unit.wire.test_points import document

KEY = "onboard/1/camera/front/points"


def points(t_recv_ns: int = EPOCH, **changes: Any) -> Datagram:
    """One document of points, changed; a change to None leaves the field out."""
    fields = {name: value for name, value in document(**changes).items() if value is not None}
    return raw(json.dumps(fields).encode(), t_recv_ns)


def raw(data: bytes, t_recv_ns: int = EPOCH) -> Datagram:
    return Datagram(channel=KEY, encoding=Encoding.POINTS, t_recv_ns=t_recv_ns, data=data)


class Flight:
    """A daemon without links, whose clock a test moves; `lines` is what it writes to standard error."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.daemon = Daemon(make_config("zenoh.enabled=false", "link=[]"), report=self.lines.append)
        self.t_ns = EPOCH

    def second(self, *datagrams: Datagram) -> list[str]:
        """The lines of a second with these datagrams."""
        before = len(self.lines)
        for datagram in datagrams:
            self.daemon._deliver(replace(datagram, t_recv_ns=self.t_ns))
        self.t_ns += S
        self.daemon._tick(self.t_ns)
        return [line for line in self.lines[before:] if "refused" in line]


@pytest.mark.parametrize(
    ("datagram", "expected"),
    [
        (points(t_ns="5"), "Expected `int`, got `str` - at `$.t_ns`"),
        (points(t_ns=1.5), "Expected `int`, got `float` - at `$.t_ns`"),
        (points(t_ns=2**63), "a time must fit into 64 bits - at `$.t_ns`"),
        (points(clock="gps"), "Invalid enum value 'gps' - at `$.clock`"),
        (
            points(camera=None),
            "missing required field `camera`; the fields of CameraPoints are t_ns, clock, camera",
        ),
        (points(camera="../x"), "a name is of letters, digits and -_., 64 at most - at `$.camera`"),
        (points(center={"u_px": 1.0}), "missing required field `v_px` - at `$.center`"),
        (points(right={"u_px": "a", "v_px": 0}), "Expected `float`, got `str` - at `$.right.u_px`"),
        (points(intrinsics={"fx_px": 0, "fy_px": 1, "cx_px": 0, "cy_px": 0}), "focal lengths must be positive"),
        (points(target="a b"), "letters, digits and -_. with / between, 64 at most - at `$.target`"),
        (points(centre={}), "unknown field `centre`; the fields of CameraPoints are t_ns, clock, camera, intr"),
        (points(clock="none"), "it has no time; expected the time of exposure, on the clock `boot` or `host`"),
        (raw(b"\xff"), "expected one JSON object of CameraPoints"),
        (raw(b"[1, 2]"), "Expected `object`, got `array`"),
        (raw(b""), "expected one JSON object of CameraPoints"),
        (raw(bytes(70_000)), "the document has more than 65536 bytes"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_what_is_refused_is_named_within_a_second(datagram: Datagram, expected: str) -> None:
    flight = Flight()
    (line,) = flight.second(datagram)
    assert line.startswith("refused from ")
    assert expected in line
    health = flight.daemon._pipeline.health(flight.t_ns)
    assert [r.count for r in health.refusals] == [1]
    assert health.refusals[0].reason in line
    shown = words.health(health)
    assert f"**refused** from {health.refusals[0].source}: {health.refusals[0].reason} (1 times)" in shown


def test_before_any_autopilot_is_heard_an_image_is_counted_and_its_reason_is_the_autopilot_s() -> None:
    flight = Flight()
    assert not flight.second(points())
    assert not flight.second(*encode([Item(EPOCH, heartbeat(5 * S))]), points())
    heard, stamped = flight.daemon._pipeline.health(flight.t_ns).refusals
    assert heard.reason.startswith("no autopilot has sent a heartbeat yet")
    assert stamped.reason.startswith("the autopilot has sent no time stamp yet")


def test_a_detector_that_is_always_wrong_is_named_every_ten_seconds_with_a_count() -> None:
    flight = Flight()
    wrong = points(clock="gps")
    (first,) = flight.second(wrong)
    assert "times" not in first
    later = [line for _ in range(10) for line in flight.second(*[wrong] * 11)]
    assert len(later) == 0
    (again,) = flight.second(wrong)
    assert "(112 times)" in again
    assert flight.second() == []


def test_a_flood_of_kinds_gets_few_lines_and_little_room() -> None:
    flight = Flight()
    flood = [points(**{f"x{i}" + "y" * 1000: 1}) for i in range(3 * MAX_REFUSAL_COUNT)]
    assert len(flight.second(*flood)) == MAX_LINE_COUNT
    assert len(flight.second(*flood)) == 1
    refusals = flight.daemon._pipeline.health(flight.t_ns).refusals
    assert len(refusals) <= MAX_REFUSAL_COUNT
    assert max(len(r.reason) for r in refusals) <= MAX_TEXT_LENGTH
    assert sum(r.count for r in refusals) == 6 * MAX_REFUSAL_COUNT


def test_names_without_end_cost_no_other_refusal_its_count() -> None:
    """Strangers choose the names of their cameras; that another sender asks for too much stays known."""
    refusals = Refusals()
    refusals.add("system 66, component 66", Reason(Cause.RATIONED, "answers are rationed"), 0)
    for n in range(1000):
        why = Reason(Cause.UNKNOWN_CAMERA, f"no camera is called `stranger{n}`")
        refusals.add(f"onboard/1/camera/stranger{n}/points", why, n)
    rationed, *strangers = refusals.latest
    assert (rationed.source, rationed.count) == ("system 66, component 66", 1)
    assert [r.count for r in strangers] == [1] * MAX_SIMILAR_COUNT + [1000 - MAX_SIMILAR_COUNT]
    assert (strangers[-1].source, strangers[-1].reason) == (OTHERS, "no camera is called `stranger8`")


def test_reasons_of_every_kind_have_room_for_the_latest() -> None:
    refusals = Refusals()
    for n in range(3 * MAX_REFUSAL_COUNT):
        refusals.add("camera", Reason(Cause.DOCUMENT, "x" * (1 + n)), n)
    assert [len(r.reason) for r in refusals.latest] == [
        *range(2 * MAX_REFUSAL_COUNT + 1, 3 * MAX_REFUSAL_COUNT + 1)
    ]


def test_what_comes_from_outside_is_shown_in_printable_characters() -> None:
    (line,) = Flight().second(points(**{"a\n\x1b[31mb": 1}))
    assert line.isprintable()


def images(change: Any, *overrides: str) -> Health:
    """The health after a flight whose images are changed."""
    items = []
    for item in Stream(t1=6.6).items():
        message = item.message
        items.append(item if item.message.component == 1 else Item(item.t_recv_ns, change(message)))
    return feed(encode(items), make_config(*overrides)).pipeline.health(EPOCH + 7 * S)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda m: replace(m, center=(float("nan"), 0.0)), "not_finite: a coordinate or a sigma is not a finite"),
        (lambda m: replace(m, left=m.center, right=m.center), "degenerate: the wingtips coincide"),
        (lambda m: replace(m, left=(-0.9, 0.0)), "out_of_view: a point is at or beyond the edge of the image"),
        (lambda m: replace(m, t_ns=5500 * MS), "duplicate: `t_ns` is that of an earlier image of this target"),
        (lambda m: replace(m, t_ns=m.t_ns + 20 * S), "too_new: `t_ns` is 19.96 s after"),
        (lambda m: replace(m, t_ns=m.t_ns - 900 * MS), "too_old: `t_ns` is 0.9"),
        (lambda m: replace(m, t_ns=5500 * MS, left=(-0.9, 0.0)), "out_of_view: a point is at or beyond the edge"),
        (lambda m: replace(m, t_ns=m.t_ns - 3 * S), "too_old: `t_ns` is 3.0"),
        (lambda m: replace(m, system=9), "it is of another MAVLink system; expected the system of our autopilot"),
    ],
    ids=[
        "not finite",
        "degenerate",
        "out of view",
        "duplicate",
        "too new",
        "too old",
        "out of view, though of a stamp that came",
        "another clock",
        "other system",
    ],
)
def test_images_that_cannot_be_used_are_named_too(change: Any, expected: str) -> None:
    kinds = [r for r in images(change).refusals if expected in r.reason]
    assert len(kinds) == 1, images(change).refusals
    assert kinds[0].count > 10
    assert kinds[0].source == "camera landing_target"


def test_good_images_refuse_nothing_and_a_gated_one_is_no_refusal() -> None:
    assert images(lambda m: m).refusals == ()
    shifted = images(lambda m: replace(m, center=(m.center[0] + 0.1, m.center[1])) if m.t_ns == 6 * S else m)
    assert shifted.verdicts[f"leader.{Verdict.GATED}"] == 1
    assert shifted.refusals == ()


def test_before_a_heartbeat_an_image_over_mavlink_is_named() -> None:
    items = [Item(EPOCH + 5 * S, CIRCLE.image(5 * S)), Item(EPOCH + 6 * S, heartbeat(6 * S))]
    (refusal,) = feed(encode(items)).pipeline.health(EPOCH + 6 * S).refusals
    assert refusal.reason.startswith("no autopilot has sent a heartbeat yet")


def test_while_the_autopilot_aligns_no_camera_is_to_blame() -> None:
    items = Stream(t1=8.0).items()
    aligning = [item for item in items if not isinstance(item.message, LocalPosition)]
    assert feed(encode(aligning)).pipeline.health(0).refusals == ()
    stopped = [item for item in items if not isinstance(item.message, LocalPosition) or item.message.t_ns < 6 * S]
    assert feed(encode(stopped)).pipeline.health(0).refusals[0].reason.startswith("no_pose")


FIRST = "pixel (9000, -0.25) is outside - at `$.detections[0].points.left`"


@pytest.mark.parametrize(
    ("reason", "kinds"),
    [
        ("pixel (12.5, 1e+06) is outside - at `$.detections[11].points.left`", 1),
        ("pixel (9000, -0.25) is outside - at `$.detections[0].points.right`", 2),
        ("no camera is called `cam2`", 2),
    ],
)
def test_reasons_that_differ_only_in_numbers_are_one(reason: str, kinds: int) -> None:
    refusals = Refusals()
    for n, text in enumerate((FIRST, reason)):
        refusals.add("onboard/1/camera/front/detections", Reason(Cause.DOCUMENT, text), n)
    assert len(refusals.latest) == kinds
    assert refusals.latest[0].reason == FIRST
    assert sum(refusal.count for refusal in refusals.latest) == 2


def test_names_with_numbers_are_not_one() -> None:
    refusals = Refusals()
    for name in ("cam1", "cam2", "cam-3"):
        refusals.add("c", Reason(Cause.UNKNOWN_CAMERA, f"no camera is called `{name}`"), 0)
    assert len(refusals.latest) == 3


def test_the_hash_of_a_ros_type_is_left_out() -> None:
    """64 digits of a key took the place of the reason."""
    refusals = Refusals()
    key = "0/perception/boxes/vision_msgs::msg::dds_::Detection2DArray_"
    refusals.add(f"{key}/RIHS01_{'0af3' * 16}", Reason(Cause.DOCUMENT, "it is not CDR"), 1)
    assert [refusal.source for refusal in refusals.latest] == [key]
