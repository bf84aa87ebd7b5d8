"""A camera on a moving mount: what a gimbal says, or an attitude with each image, from bytes to the estimate."""

import json
import math
import struct

import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.clocks import Clocks
from onboard.config import Config, ConfigError, parse_config
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion, quaternion_from_euler
from onboard.messages import (
    Attitude,
    Clock,
    Datagram,
    Encoding,
    GimbalAttitude,
    MountAttitude,
    MountFrame,
    Verdict,
)
from onboard.ownship.gimbals import Gimbals
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.mavlink_frames import frame, one
from tests.support.moving_mount import BARREL, FLAT, GIMBAL, LENS, Mount, flown, range_error
from tests.support.streams import EPOCH, MS, SIZE, S, feed


def config(*, gimbal: bool = False, distorted: bool = True) -> Config:
    camera = LENS | ({"distortion": list(BARREL)} if distorted else {}) | ({"gimbal": GIMBAL} if gimbal else {})
    return parse_config({"camera": camera, "estimator": {"leader": {"size_prior_m": SIZE}}})


def ratios(mounts: list[tuple[Mount, bool]], seed: int, seconds: float) -> list[float]:
    """Range errors with moving mounts and a distorted lens over that of a fixed camera without distortion."""
    plain = config(distorted=False)
    fixed = range_error(flown(plain, None, seed=seed, seconds=seconds, distortion=FLAT, sparse=True), 8.0)
    found = []
    for mount, in_image in mounts:
        run = flown(config(gimbal=not in_image), mount, seed=seed, seconds=seconds, in_image=in_image, sparse=True)
        assert run.verdicts().get(Verdict.FUSED, 0) + run.verdicts().get(Verdict.FUSED_LATE, 0) > 75
        found.append(range_error(run, 8.0) / fixed)
    return found


def test_a_sweeping_gimbal_and_a_distorted_lens_cost_no_range_seed_1() -> None:
    """The gimbal's own clock is behind by three seconds, and it speaks ten times a second."""
    mounts = [(Mount(behind_ms=3000, error_deg=0.3), False), (Mount(frame="body"), True)]
    assert max(ratios(mounts, 1, 8.0)) < 1.25


# ---------------------------------------------------------------------------------------------- history


def gimbal_report(t_ns: int, yaw: float, frame_: MountFrame = "heading", device: int = GIMBAL) -> GimbalAttitude:
    mount = MountAttitude(q=tuple(quaternion_from_euler(0.0, 0.0, yaw).tolist()), frame=frame_)
    return GimbalAttitude(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, component=GIMBAL, device=device, mount=mount)


def test_a_mount_orientation_counts_where_its_device_sends_nothing_newer() -> None:
    old = [replace(gimbal_report(k * 40 * MS, 0.5), is_replaced=True) for k in range(3)]
    gimbals = known(*old)
    assert gimbals.at(GIMBAL, 80 * MS) is not None
    gimbals = known(gimbal_report(0, 0.0, "earth"), *old[1:], gimbal_report(80 * MS, 0.0, "earth"))
    found = gimbals.at(GIMBAL, 40 * MS)
    assert found is not None
    assert found.frame == "earth"


def known(*messages: GimbalAttitude) -> Gimbals:
    gimbals = Gimbals(0.1)
    for message in messages:
        assert gimbals.receive(message) == ""
    return gimbals


def yaw_at(gimbals: Gimbals, t_ns: int) -> float | None:
    mount = gimbals.at(GIMBAL, t_ns)
    return None if mount is None else 2 * math.atan2(mount.q[3], mount.q[0])


def test_an_attitude_is_interpolated_and_carried_on_for_a_short_while() -> None:
    gimbals = known(gimbal_report(S, 0.1), gimbal_report(S + 100 * MS, 0.3))
    assert yaw_at(gimbals, S + 25 * MS) == pytest.approx(0.15)
    assert yaw_at(gimbals, S + 150 * MS) == pytest.approx(0.4)
    assert yaw_at(gimbals, S + 201 * MS) is None
    assert yaw_at(gimbals, S - MS) is None
    assert [gimbals.knows(GIMBAL, S + ms * MS) for ms in (100, 101)] == [True, False]
    assert [gimbals.may_know(GIMBAL, S + ms * MS) for ms in (100, 101, 600, 601)] == [False, True, True, False]
    assert gimbals.at(7, S) is None


def test_what_is_forgotten_of_a_gimbal_is_more_than_five_seconds_old() -> None:
    gimbals = known()
    for k in range(250):
        assert gimbals.receive(gimbal_report(S + 100 * k * MS, 1e-3 * k)) == ""
        for ago in range(0, min(k, 50), 10):
            assert yaw_at(gimbals, S + 100 * (k - ago) * MS) == pytest.approx(1e-3 * (k - ago), abs=1e-6)
    assert yaw_at(gimbals, S + 13_800 * MS) is None


def test_nothing_is_made_up_between_samples_that_are_far_apart_or_of_two_frames() -> None:
    assert yaw_at(known(gimbal_report(S, 0.1), gimbal_report(S + 600 * MS, 0.3)), S + 300 * MS) is None
    assert yaw_at(known(gimbal_report(S, 0.1), gimbal_report(S + 50 * MS, 0.3, "earth")), S + 25 * MS) is None


def test_what_cannot_be_an_attitude_or_comes_late_is_not_taken() -> None:
    gimbals = known(gimbal_report(S, 0.1))
    nan, none = MountAttitude(q=(math.nan,) * 4, frame="earth"), MountAttitude(q=(0.0,) * 4, frame="earth")
    head = {"t_recv_ns": EPOCH, "component": GIMBAL, "device": GIMBAL}
    for mount in (nan, none):
        assert gimbals.receive(GimbalAttitude(t_ns=2 * S, mount=mount, **head)) == "gimbal_unusable"
    assert gimbals.receive(gimbal_report(S, 0.2)) == "gimbal_out_of_order"
    others = [gimbals.receive(gimbal_report(S, 0.1, device=k)) for k in range(1, 10)]
    assert others == [""] * 7 + ["gimbal_too_many"] * 2


# ---------------------------------------------------------------------------------------------- bytes


@pytest.mark.parametrize(
    ("flags", "expected"), [(32, "heading"), (64, "earth"), (16, "earth"), (0, "heading"), (16 + 32, "heading")]
)
def test_flags_say_against_what_a_gimbal_s_yaw_is(flags: int, expected: str) -> None:
    q = (0.5, 0.5, -0.5, 0.5)
    payload = struct.pack("<I7fIH2B2fB", 5000, *q, 0.0, 0.0, 0.0, 0, flags, 0, 0, 0.0, 0.0, 2)
    m = one(frame(285, 137, payload, component=GIMBAL))
    assert (m.mount.q, m.mount.frame, m.device) == (q, expected, 2)
    assert (m.t_ns, m.clock) == (5 * S, Clock.BOOT)


def test_a_gimbal_without_a_device_id_has_its_component_s() -> None:
    m = one(MavlinkEncoder(1, GIMBAL).encode(gimbal_report(5 * S, 0.1)))
    assert m.device == GIMBAL
    assert_allclose(matrix_from_quaternion(m.mount.q), matrix_from_euler(0.0, 0.0, 0.1), atol=1e-7)


def test_a_gimbal_s_clock_is_its_own_and_never_that_of_the_autopilot() -> None:
    clocks = Clocks()
    assert clocks.align(gimbal_report(5 * S, 0.0)).message is None
    q = (1.0, 0.0, 0.0, 0.0)
    for ms in range(0, 400, 20):
        own = Attitude(t_ns=100 * S + ms * MS, t_recv_ns=EPOCH + (ms + 2) * MS, q_nb=q, omega_b=(0.0, 0.0, 0.0))
        assert clocks.align(own).message is not None
    for behind_ns in (0, 300 * S):  # the second time it has started anew
        for ms, late_ms in ((100, 9), (200, 2), (300, 30)):
            m = gimbal_report((1000 + ms) * MS - behind_ns, 0.0)
            m = GimbalAttitude(
                t_ns=m.t_ns, t_recv_ns=EPOCH + (ms + late_ms) * MS, component=GIMBAL, device=GIMBAL, mount=m.mount
            )
            aligned = clocks.align(m).message
        assert aligned is not None
        assert aligned.t_ns == 100 * S + 300 * MS
    assert (clocks.reboots, clocks.offset_ns) == (0, EPOCH + 2 * MS - 100 * S)


# ----------------------------------------------------------------------------------- configuration, refusals


def test_a_gimbal_is_asked_for_and_its_error_counts_as_our_attitude_s() -> None:
    plain, moving = config(), config(gimbal=True)
    assert "GIMBAL_DEVICE_ATTITUDE_STATUS" not in plain.autopilot.rates_hz
    assert moving.autopilot.rates_hz["GIMBAL_DEVICE_ATTITUDE_STATUS"] == 25.0
    leaders = [c.estimator["leader"] for c in (plain, moving)]
    sigmas = [(leader.own_tilt_sigma_deg, leader.own_yaw_sigma_deg) for leader in leaders]
    assert sigmas == [(0.3, 1.0), (pytest.approx(math.hypot(0.3, 0.5)), pytest.approx(math.hypot(1.0, 1.0)))]
    # what makes each of both anew, in deg^2/s, makes their sum anew
    assert leaders[0].own_attitude_time_s == pytest.approx(60.0)
    assert 2.0 / leaders[1].own_attitude_time_s == pytest.approx(1.0 / 60.0 + 1.0 / 120.0)
    with pytest.raises(ConfigError, match=r"camera\.gimbal"):
        parse_config({"camera": {"gimbal": 0}})


@pytest.mark.parametrize(
    ("camera", "tilt", "yaw"),
    [
        ({}, 0.0, 0.0),
        ({"mount_sigma_deg": 0.2}, 0.2, 0.2),
        ({"mount_yaw_sigma_deg": 2.0}, 0.0, 2.0),
        ({"gimbal": 1}, 0.5, 1.0),
        ({"gimbal": 1, "mount_sigma_deg": 0.0}, 0.0, 0.0),
        ({"gimbal": 1, "mount_yaw_sigma_deg": 0.3}, 0.5, 0.3),
    ],
)
def test_a_mount_s_error_has_defaults_with_a_gimbal_alone(
    camera: dict[str, float], tilt: float, yaw: float
) -> None:
    leader = parse_config({"camera": camera, "estimator": {"leader": {}}}).estimator["leader"]
    assert leader.own_tilt_sigma_deg == pytest.approx(math.hypot(0.3, tilt))
    assert leader.own_yaw_sigma_deg == pytest.approx(math.hypot(1.0, yaw))


def test_without_a_word_of_the_gimbal_images_are_refused_by_name() -> None:
    settings = parse_config({"camera": LENS | {"gimbal": 7}, "estimator": {"leader": {}}})
    run = flown(settings, Mount(), seed=1, seconds=1.0)
    assert set(run.verdicts()) == {Verdict.NO_POSE}
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason.endswith("is not known, or not that of the camera's gimbal")


@pytest.mark.parametrize(
    ("attitude", "expected"),
    [
        ({"q": [0, 0, 0, 0], "frame": "body"}, "expected a quaternion w, x, y, z of length 1 - at `$.attitude.q`"),
        ({"q": [1, 0, 0], "frame": "body"}, "Expected `array` of length 4, got 3 - at `$.attitude.q`"),
        ({"q": [1, 0, 0, 0], "frame": "ned"}, "Invalid enum value 'ned' - at `$.attitude.frame`"),
        ({"q": [1, 0, 0, 0]}, "Object missing required field `frame` - at `$.attitude`"),
        (
            {"q": [1, 0, 0, 0], "frame": "body", "roll": 1},
            "(the rest is used) the field `attitude.roll`; known: q, frame",
        ),
    ],
)
def test_an_attitude_that_cannot_be_is_refused_by_its_field(attitude: object, expected: str) -> None:
    data = json.dumps({"t_ns": 1, "clock": "boot", "attitude": attitude}).encode()
    run = feed([Datagram(channel="k", encoding=Encoding.DETECTIONS, t_recv_ns=EPOCH, data=data)], config())
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason == expected
