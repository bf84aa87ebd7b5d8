"""Camera points as JSON, and .tlog recordings: whole, damaged, cut off, or no such thing."""

import contextlib
import json
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.messages import Clock, Encoding
from onboard.wire.mavlink_decode import MavlinkDecoder
from onboard.wire.points import BadPointsError, decode_points, encode_points
from onboard.wire.tlog import NotALogError, frame_length, read_tlog, tlog_record
from tests.support.streams import STRAIGHT, Stream

RECV = 1_735_689_605_000_000_000


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
    return decode_points(json.dumps(value).encode(), RECV)


def test_pixels_become_image_points_right_and_down_positive() -> None:
    m = decode(document())
    assert m.center == pytest.approx((0.1, -0.1))
    assert m.left == (0.0, 0.0)
    assert m.right == pytest.approx((0.2, 0.1))
    assert (m.t_ns, m.t_recv_ns, m.clock, m.camera, m.target, m.sigma) == (
        5_000_000_000, RECV, Clock.BOOT, "front", "leader", None,
    )  # fmt: skip
    assert (m.system, m.component) == (0, 0)


def test_sigmas_are_in_focal_lengths_and_count_only_if_all_are_given() -> None:
    given_ = document(center=pixel(0, 0, 1.0), left=pixel(0, 0, 2.0), right=pixel(0, 0, 4.0))
    f = (500 * 400) ** 0.5
    assert decode(given_).sigma == pytest.approx((1 / f, 2 / f, 4 / f))
    assert decode(document(center=pixel(0, 0, 1.0))).sigma is None


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
    with pytest.raises(BadPointsError) as caught:
        decode(document(**change))
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["t_ns", "clock", "camera", "intrinsics", "center", "left", "right"])
def test_a_missing_field_is_named(key: str) -> None:
    value = document()
    del value[key]
    with pytest.raises(BadPointsError, match=key):
        decode(value)


@pytest.mark.parametrize(
    "data", [b"", b"{", b"null", b"[]", b"\xff\xfe", b'{"t_ns": NaN}', b"1" * 5000, b"[" * 5000]
)
def test_what_is_no_json_of_ours_is_an_error_of_ours(data: bytes) -> None:
    with pytest.raises(BadPointsError):
        decode_points(data, RECV)


@pytest.mark.parametrize("target", ["a*", "a b", "/a", "a//b", "a/", "$", "?x", "#", "x" * 65, "\u00e9", "a\n"])
def test_a_target_that_can_stand_in_no_key_is_refused(target: str) -> None:
    with pytest.raises(BadPointsError, match="target"):
        decode(document(target=target))


def test_a_target_is_what_can_stand_in_a_key() -> None:
    for fine in ("", "leader", "target/1", "unnamed/12", "alpha-2.b_c"):
        assert decode(document(target=fine)).target == fine


def test_a_time_beyond_64_bits_is_refused() -> None:
    """It could not be published again."""
    for t_ns in (2**63, -(2**63) - 1, 10**30):
        with pytest.raises(BadPointsError, match="t_ns"):
            decode(document(t_ns=t_ns))


@pytest.mark.parametrize("f_px", [1e-200, 1e-300, 5e-324, 1e300])
def test_absurd_focal_lengths_never_raise_anything_else(f_px: float) -> None:
    intrinsics = {"fx_px": f_px, "fy_px": f_px, "cx_px": 0.0, "cy_px": 0.0}
    one = pixel(1e300, 1.0, 1.0)
    with contextlib.suppress(BadPointsError):
        decode(document(intrinsics=intrinsics, center=one, left=one, right=one))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.binary(max_size=300))
def test_random_bytes_are_an_error_of_ours(data: bytes) -> None:
    with pytest.raises(BadPointsError):
        decode_points(data, RECV)


def test_points_go_out_and_come_back() -> None:
    import msgspec  # noqa: PLC0415 - beside its one use

    from onboard.messages import CameraPoints  # noqa: PLC0415 - as above

    record = msgspec.convert(document(center=pixel(1.5, 2.5, 0.5)), CameraPoints)
    assert msgspec.json.decode(encode_points(record), type=CameraPoints) == record


# ------------------------------------------------------------------------------------------- tlog

DATAGRAMS = Stream(flight=STRAIGHT, t1=6.0, images=lambda _t: False).datagrams()
LOG = b"".join(tlog_record(d.t_recv_ns, d.data) for d in DATAGRAMS)


def records(log: bytes) -> list[Any]:
    return [datagram for datagram, _ in read_tlog(log)]


def test_a_log_gives_back_what_was_written() -> None:
    found = records(LOG)
    assert [d.data for d in found] == [d.data for d in DATAGRAMS]
    assert [d.t_recv_ns for d in found] == [d.t_recv_ns // 1000 * 1000 for d in DATAGRAMS]
    assert {d.encoding for d in found} == {Encoding.MAVLINK}
    assert list(read_tlog(LOG))[-1][1] == len(LOG)


def test_the_time_stamp_is_big_endian_unix_microseconds() -> None:
    assert tlog_record(1_735_689_605_123_456_789, b"") == struct.pack(">Q", 1_735_689_605_123_456)


def test_garbage_in_the_middle_is_told_once_and_costs_only_itself() -> None:
    cut = sum(8 + len(d.data) for d in DATAGRAMS[:30])
    garbage = np.random.default_rng(2).integers(0, 200, 500, dtype=np.uint8).tobytes()
    found = records(LOG[:cut] + garbage + LOG[cut:])
    assert found.count(None) == 1
    assert found[30] is None
    assert [d.data for d in found if d is not None] == [d.data for d in DATAGRAMS]


def test_damage_that_hides_a_header_costs_that_record() -> None:
    damaged = bytearray(LOG)
    damaged[sum(8 + len(d.data) for d in DATAGRAMS[:10]) + 8] = 0x00
    found = records(bytes(damaged))
    assert found.count(None) == 1
    assert len(found) == len(DATAGRAMS)


def test_a_log_cut_off_anywhere_gives_all_whole_records() -> None:
    short = LOG[: sum(8 + len(d.data) for d in DATAGRAMS[:5])]
    ends = np.cumsum([8 + len(d.data) for d in DATAGRAMS[:5]])
    for length in range(9, len(short)):
        found = records(short[:length])
        whole = int((ends <= length).sum())
        assert sum(d is not None for d in found) == whole, length
        assert found.count(None) == (0 if length in ends else 1), length


@pytest.mark.parametrize("data", [b"", b"\0", b"\0" * 8, b"\0" * 100, b"hello, this is some text, no log at all"])
def test_what_is_no_log_is_said_at_once(data: bytes) -> None:
    with pytest.raises(NotALogError, match=r"no \.tlog"):
        next(iter(read_tlog(data)))


def test_frame_lengths_of_both_versions_and_of_signed_ones() -> None:
    for head, length in ((b"\xfe\x09\0", 17), (b"\xfd\x09\0", 21), (b"\xfd\x09\x01", 34), (b"\xfd\x09", None)):
        assert frame_length(memoryview(head), 0) == length
    assert frame_length(memoryview(b"\0\0\0\0"), 0) is None


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(9, len(LOG) - 1), st.binary(max_size=200))
def test_a_log_with_anything_in_it_never_raises(at: int, noise: bytes) -> None:
    decoder = MavlinkDecoder(stream=False)
    for datagram, consumed in read_tlog(LOG[:at] + noise + LOG[at:][:400]):
        assert consumed <= len(LOG) + 200
        if datagram is not None:
            decoder.decode(datagram.data, datagram.t_recv_ns)
