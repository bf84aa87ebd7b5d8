"""Image points from LANDING_TARGET frames: three make an image, in any order, and which belong together."""

import math
import struct
from typing import Any

import pytest

from onboard.messages import Clock, TargetPoints
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.images import detections
from tests.support.mavlink_frames import RECEIVE_TIME_NS, decode, frame, independent, one


def landing(number: int, x: float, y: float, t_us: int = 5_000_000, component: int = 191) -> bytes:
    head = struct.pack("<Q5fBB", t_us, x, y, 0.0, 0.0, 0.0, number, 12)
    return frame(149, 200, head, component=component)


def labelled(t_us: int = 5_000_000, base: int = 0) -> list[bytes]:
    angles = ((0.1, -0.2), (0.05, -0.25), (0.15, -0.15))
    return [landing(base + k, *angle, t_us=t_us) for k, angle in enumerate(angles)]


def points_of(m: Any) -> tuple[float, ...]:
    return (*m.center, *m.left, *m.right)


EXPECTED = tuple(math.tan(a) for a in (0.1, -0.2, 0.05, -0.25, 0.15, -0.15))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (2, 0, 1)], ids=str)
def test_three_targets_in_any_order_are_one_image(order: tuple[int, ...]) -> None:
    frames = labelled()
    m = one(b"".join(frames[i] for i in order))
    assert isinstance(m, TargetPoints)
    assert points_of(m) == pytest.approx(EXPECTED, abs=1e-7)
    assert (m.t_ns, m.clock, m.target, m.component) == (5_000_000_000, Clock.BOOT, "leader", 191)


def test_a_missing_third_point_costs_that_image_only_and_is_counted() -> None:
    decoder = MavlinkDecoder(stream=False)
    found = 0
    for i in range(100):
        frames = labelled(5_000_000 + 40_000 * i)
        for f in frames if i % 2 else frames[:2]:
            found += len(decoder.decode(f, RECEIVE_TIME_NS))
    assert found == 50
    assert decoder.rejected["incomplete_points"] >= 50 - 8
    assert len(decoder._points) <= 8


def test_target_numbers_from_three_on_are_another_target() -> None:
    m = one(b"".join(labelled(base=3)))
    assert m.target == "target/1"
    assert points_of(m) == pytest.approx(EXPECTED, abs=1e-7)
    both = detections(
        decode(b"".join([labelled()[0], labelled(base=3)[0], *labelled()[1:], *labelled(base=3)[1:]]))
    )
    assert [m.target for m in both if isinstance(m, TargetPoints)] == ["leader", "target/1"]
    encoded = MavlinkEncoder(1, 191).encode(m)
    assert [f.target_num for f in independent(encoded)] == [3, 4, 5]


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf, math.pi / 2, -math.pi / 2, 3.0, 1e30])
def test_impossible_angles_become_nan(angle: float) -> None:
    m = one(landing(0, angle, 0.1) + b"".join(labelled()[1:]))
    assert math.isnan(m.center[0])
    assert m.center[1] == pytest.approx(math.tan(0.1))


def test_an_image_without_a_stamp_has_no_clock() -> None:
    m = one(b"".join(landing(k, 0.1, 0.1, t_us=0) for k in range(3)))
    assert m.clock is Clock.NONE


def test_an_image_stamped_with_unix_time_is_on_the_host_clock() -> None:
    m = one(b"".join(labelled(1_735_689_605_000_000)))
    assert m.clock is Clock.HOST


def test_foreign_points_never_cost_a_pending_image() -> None:
    """Ten incomplete images of other senders between any two of our points, and of further targets of ours."""
    decoder = MavlinkDecoder(stream=False)
    found: list[Any] = []
    for i in range(100):
        for k, f in enumerate(labelled(5_000_000 + 40_000 * i)):
            foreign = [
                landing(0, 0.1, 0.1, t_us=7_000_000 + 100 * i + 10 * k + n, component=99) for n in range(10)
            ]
            further = [landing(3 * n, 0.1, 0.1, t_us=5_000_000 + 40_000 * i + k) for n in range(1, 11)]
            found += [m for g in (*foreign, *further, f) for m in detections(decoder.decode(g, RECEIVE_TIME_NS))]
    assert [(m.target, m.component) for m in found] == [("leader", 191)] * 100
