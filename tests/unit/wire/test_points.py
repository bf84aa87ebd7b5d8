"""Camera points as JSON: good documents, and bad ones whose errors name the field."""

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.messages import Clock
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.points import decode_points
from tests.support.mavlink_frames import RECEIVE_TIME_NS


def document(**changes: Any) -> dict[str, Any]:
    return {
        "t_ns": 5_000_000_000,
        "clock": "boot",
        "camera": "front",
        "intrinsics": {"fx_px": 500.0, "fy_px": 400.0, "cx_px": 320.0, "cy_px": 240.0},
        "center": {"u_px": 370.0, "v_px": 200.0},
        "left": {"u_px": 320.0, "v_px": 240.0},
        "right": {"u_px": 420.0, "v_px": 280.0},
        **changes,
    }


def pixel(u: float, v: float, sigma: float | None = None) -> dict[str, Any]:
    return {"u_px": u, "v_px": v, "sigma_px": sigma}


def decode(value: Any) -> Any:
    return decode_points(json.dumps(value).encode(), RECEIVE_TIME_NS).detections[0]


def test_pixels_become_image_points_right_and_down_positive() -> None:
    m = decode(document())
    assert m.center == pytest.approx((0.1, -0.1))
    assert m.left == (0.0, 0.0)
    assert m.right == pytest.approx((0.2, 0.1))
    assert (m.t_ns, m.t_recv_ns, m.clock, m.camera, m.target, m.sigma) == (
        5_000_000_000, RECEIVE_TIME_NS, Clock.BOOT, "front", "leader", None,
    )  # fmt: skip
    assert (m.system, m.component) == (0, 0)


def test_sigmas_are_in_focal_lengths_and_count_only_if_all_are_given() -> None:
    all_given = document(center=pixel(2, 2, 1.0), left=pixel(2, 2, 2.0), right=pixel(2, 2, 4.0))
    f = (500 * 400) ** 0.5
    assert decode(all_given).sigma == pytest.approx((1 / f, 2 / f, 4 / f))
    assert decode(document(center=pixel(2, 2, 1.0))).sigma is None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"t_ns": "5"}, "$.t_ns"),
        ({"t_ns": 1.5}, "$.t_ns"),
        ({"clock": "gps"}, "$.clock"),
        ({"center": {"u_px": 1.0}}, "v_px"),
        ({"left": None}, "$.left"),
        ({"right": {"u_px": "a", "v_px": 0}}, "$.right.u_px"),
        ({"intrinsics": {"fx_px": 0.0, "fy_px": 1.0, "cx_px": 0, "cy_px": 0}}, "$.intrinsics"),
        ({"intrinsics": {"fx_px": 1.0, "fy_px": -1.0, "cx_px": 0, "cy_px": 0}}, "$.intrinsics"),
        ({"centre": {"u_px": 1.0, "v_px": 1.0}}, "centre"),
    ],
    ids=str,
)
def test_errors_name_the_field(change: dict[str, Any], named: str) -> None:
    with pytest.raises(BadDocumentError) as caught:
        decode(document(**change))
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b"{", b"null", b"[]", b"\xff\xfe", b'{"t_ns": NaN}', b"1" * 5000, b"[" * 5000]
)
def test_other_bytes_raise_our_own_error(data: bytes) -> None:
    with pytest.raises(BadDocumentError):
        decode_points(data, RECEIVE_TIME_NS)


@pytest.mark.parametrize("target", ["a*", "a b", "/a", "a//b", "a/", "$", "?x", "#", "x" * 65, "\u00e9", "a\n"])
def test_a_target_that_cannot_be_part_of_a_key_is_refused(target: str) -> None:
    with pytest.raises(BadDocumentError, match="target"):
        decode(document(target=target))


def test_a_target_may_be_any_part_of_a_key() -> None:
    for fine in ("", "leader", "target/1", "unnamed/12", "alpha-2.b_c"):
        assert decode(document(target=fine)).target == fine


def test_a_time_beyond_64_bits_is_refused() -> None:
    """It could not be published again."""
    for t_ns in (2**63, -(2**63) - 1, 10**30):
        with pytest.raises(BadDocumentError, match="t_ns"):
            decode(document(t_ns=t_ns))


@pytest.mark.parametrize("f_px", [1e-200, 1e-300, 5e-324, 1e300])
def test_absurd_focal_lengths_never_raise_anything_else(f_px: float) -> None:
    intrinsics = {"fx_px": f_px, "fy_px": f_px, "cx_px": 0.0, "cy_px": 0.0}
    one = pixel(1e300, 1.0, 1.0)
    with contextlib.suppress(BadDocumentError):
        decode(document(intrinsics=intrinsics, center=one, left=one, right=one))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.binary(max_size=300))
def test_random_bytes_raise_our_own_error(data: bytes) -> None:
    with pytest.raises(BadDocumentError):
        decode_points(data, RECEIVE_TIME_NS)


def test_an_image_ends_at_its_size_or_lies_about_its_principal_point() -> None:
    k = {"fx_px": 500.0, "fy_px": 400.0, "cx_px": 200.0, "cy_px": 240.0}
    size = {"width_px": 640.0, "height_px": 480.0}
    assert decode(document(intrinsics=k | size)).view == pytest.approx((-0.4, -0.6, 0.88, 0.6))
    assert decode(document(intrinsics=k)).view == pytest.approx((-0.4, -0.6, 0.4, 0.6))
    assert decode(document(intrinsics=k | {"cx_px": 0.0})).view is None
    for wrong in ({"width_px": 0.0}, {"height_px": -1.0}):
        with pytest.raises(BadDocumentError, match="intrinsics"):
            decode(document(intrinsics=k | size | wrong))
