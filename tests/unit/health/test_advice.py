"""Twenty causes of a missing or poor estimate: each is found, and its remedy named, from the health alone."""

import errno
import json
import os
import socket
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.arrays import Array
from onboard.autopilot.notices import MAX_TEXT_LENGTH, Notices
from onboard.commands import absent
from onboard.commands.absent import why_absent
from onboard.commands.status import describe, is_healthy
from onboard.config import Config, parse_config
from onboard.health import Advisor, Needs, causes_own
from onboard.health.causes_camera import stamp_reading
from onboard.health.causes_state import VALID
from onboard.health.needs import Moment
from onboard.health.words import WORDS
from onboard.messages import (
    DOUBT_PREFIX,
    Advice,
    Attitude,
    CameraHealth,
    Cause,
    Clock,
    ComputerLoad,
    Consistency,
    Datagram,
    Encoding,
    Health,
    Heartbeat,
    LinkHealth,
    LocalPosition,
    Message,
    Reason,
    Refusal,
    Severity,
    SinkHealth,
    TargetPoints,
)
from onboard.messages.stamps import Span, read_stamps
from onboard.pipeline import Pipeline, Rim
from onboard.sinks.console import ConsoleLines
from onboard.view import words
from onboard.wire.mavlink.signing import read_key
from tests.support.streams import CIRCLE, EPOCH, FOCAL_LENGTH_PX, MS, SIZE, Item, S, Stream, encode

SECONDS = 8
MOTION = (Attitude, LocalPosition)
UNREACHABLE = Reason(Cause.UNREACHABLE, "zenoh: no router answers (Connection refused)")


class Doctor(NamedTuple):
    """The health of the last second, and all advice by its cause, the newest of each."""

    health: Health
    found: dict[str, Advice]


def configured(**sections: Any) -> Config:
    leader = {"leader": {"size_prior_m": SIZE}}
    return parse_config({"estimator": leader, **sections})


def flown(
    change: Callable[[Message], Message | None] = lambda m: m,
    config: Config | None = None,
    rims: Callable[[int], Rim] = lambda _: Rim(),
    *,
    lead_ns: int = 0,
    extra: Iterable[Datagram] = (),
    keys: dict[str, bytes] | None = None,
    seconds: int = SECONDS,
    sparse: bool = True,
) -> Doctor:
    """A flight of which each message is changed (None: left out), with a health every second."""
    items = []
    for item in Stream(t1=5.0 + seconds, flight=CIRCLE, lead_ns=lead_ns, sparse=sparse).items():
        changed = change(item.message)
        if changed is not None:
            items.append(Item(item.t_recv_ns, changed))
    pipeline, found = Pipeline(config or configured(), keys or {}), dict[str, Advice]()
    datagrams = sorted([*encode(items, "autopilot"), *extra], key=lambda d: d.t_recv_ns)
    second = 0
    health = pipeline.health(EPOCH + 5 * S, rims(0))
    for datagram in datagrams:
        while datagram.t_recv_ns > EPOCH + (6 + second) * S:
            second += 1
            health = pipeline.health(EPOCH + (5 + second) * S, rims(second))
            found |= {advice.kind: advice for advice in reversed(health.advice)}
        pipeline.feed(datagram)
    return Doctor(health, found)


@cache
def faultless() -> Doctor:
    """A flight with stamps of the boot clock."""
    return flown(images(lambda m: replace(m, clock=Clock.BOOT)))


def images(change: Callable[[TargetPoints], Message | None]) -> Callable[[Message], Message | None]:
    return lambda m: change(m) if isinstance(m, TargetPoints) else m


def moved(change: Callable[[Array], Array]) -> Callable[[Message], Message | None]:
    """The flight with other image points (3, 2)."""

    def of(m: TargetPoints) -> Message:
        center, left, right = (tuple(p) for p in change(np.array([m.center, m.left, m.right])).tolist())
        return replace(m, center=center, left=left, right=right)

    return images(of)


def without(*kinds: type[Message]) -> Callable[[Message], Message | None]:
    return lambda m: None if isinstance(m, kinds) else m


def detections(change: Callable[[dict[str, Any], float], object], seconds: int) -> list[Datagram]:
    """The camera's images as documents of a detector, in pixels of 640 x 480."""
    found = []
    for item in Stream(t1=5.0 + seconds, flight=CIRCLE, sparse=True).items():
        m = item.message
        if not isinstance(m, TargetPoints):
            continue
        points = {
            name: {"u_px": 320 + FOCAL_LENGTH_PX * p[0], "v_px": 240 + FOCAL_LENGTH_PX * p[1]}
            for name, p in (("center", m.center), ("left", m.left), ("right", m.right))
        }
        one = {"target": "leader", "points": points}
        document = {"t_ns": m.t_ns, "clock": "boot", "camera": "front", "detections": [one]}
        change(document, m.t_ns * 1e-9)
        data, key = json.dumps(document).encode(), "onboard/1/camera/front/detections"
        encoding = Encoding.DETECTIONS
        found.append(Datagram(channel=key, encoding=encoding, t_recv_ns=item.t_recv_ns, data=data))
    return found


def detected(change: Callable[[dict[str, Any], float], object], seconds: int = SECONDS, **sections: Any) -> Doctor:
    extra = detections(change, seconds)
    return flown(without(TargetPoints), configured(**sections), extra=extra, seconds=seconds)


def named(doctor: Doctor, cause: str, remedy: str) -> Advice:
    """The advice of this cause, whose remedy names this line or key."""
    assert cause in doctor.found, sorted(doctor.found)
    advice = doctor.found[cause]
    assert remedy in advice.remedy
    assert advice.text
    return advice


def test_a_flight_without_faults_needs_no_advice() -> None:
    doctor = faultless()
    assert [a for a in doctor.found.values() if a.severity is not Severity.NOTICE] == []
    assert is_healthy(doctor.health)


def test_01_a_silent_camera() -> None:
    advice = named(flown(without(TargetPoints)), "camera-silent", "`onboard/1/camera/front/detections`")
    assert advice.severity is Severity.ERROR


def test_01_a_camera_that_falls_silent() -> None:
    doctor = flown(images(lambda m: m if m.t_ns < 8 * S else None))
    assert "no image for" in named(doctor, "camera-silent", "/camera/landing_target/detections").what


def test_01_a_detector_that_finds_nothing() -> None:
    rims = lambda second: Rim(links={"zenoh": LinkHealth(received=25 * second)})  # noqa: E731
    doctor = flown(without(TargetPoints), rims=rims)
    assert "no aircraft is in it" in named(doctor, "camera-silent", "detections").what


@pytest.mark.parametrize(
    ("channel", "encoding", "data"),
    [
        ("camera", Encoding.DETECTIONS, b'{"t_ns": 1, "detections": []}'),
        ("vision", Encoding.DETECTIONS, b'{"t_ns": 1, "detections": []}'),
        ("onboard/1/camera/front/detections", Encoding.DETECTIONS, b"{}"),
        ("0/perception/boxes/vision_msgs::msg::dds_::Detection2DArray_/RIHS01_0", Encoding.ROS, bytes(20)),
    ],
)
def test_01_a_detector_that_is_refused_is_not_said_to_find_nothing(
    channel: str, encoding: Encoding, data: bytes
) -> None:
    """Only sources with "camera" in their name were noticed."""
    name = "zenoh" if "/" in channel else channel
    link = [] if name == "zenoh" else [{"name": name, "url": "json:127.0.0.1:1", "autopilot": False}]
    pipeline = Pipeline(configured(link=link))
    for k in range(8):
        t_ns = EPOCH + k * S
        pipeline.decode(Datagram(channel=channel, encoding=encoding, t_recv_ns=t_ns, data=data))
        health = pipeline.health(t_ns, Rim(links={name: LinkHealth(received=k + 1)}))
    assert "camera-silent" not in [advice.kind for advice in health.advice]
    assert any(channel[:10] in advice.what for advice in health.advice)


def test_02_a_silent_autopilot() -> None:
    pipeline = Pipeline(configured())
    advice = [pipeline.health(EPOCH + k * S).advice for k in range(6)]
    assert advice[0] == ()
    (autopilot, _camera) = advice[5]
    assert (autopilot.kind, autopilot.severity) == ("autopilot-silent", Severity.ERROR)
    assert "mavproxy.py --out=udpout:127.0.0.1:14540" in autopilot.remedy


def test_03_another_system() -> None:
    doctor = flown(config=configured(autopilot={"system": 7}))
    assert "system 7" in named(doctor, "system", "`system = 1` in [autopilot]").what


def test_04_another_component() -> None:
    doctor = flown(lambda m: replace(m, component=158) if isinstance(m, MOTION) else m)
    assert "1/158" in named(doctor, "component", "mavlink stream -d DEVICE -s").what


def test_05_an_unknown_camera_name() -> None:
    doctor = detected(lambda d, _: d.update(camera="nose"))
    assert "no camera is called `nose`; known: front" in named(doctor, "camera", "[cameras.NAME]").what


def test_06_an_unknown_target_name() -> None:
    doctor = detected(lambda d, _: d["detections"][0].update(target="bird"))
    assert "`bird`" in named(doctor, "target", "`target: leader`").what


def test_07_a_class_that_is_not_followed() -> None:
    doctor = detected(lambda d, _: d["detections"][0].update({"class": "kite"}), camera={"classes": ["plane"]})
    assert "`kite`" in named(doctor, "class", "`classes`").what


def test_07_a_class_without_a_section() -> None:
    sections = {"target": {"plane": {"size_prior_m": 2.0}}}
    doctor = detected(lambda d, _: d["detections"][0].update({"class": "kite"}), **sections)
    assert "`kite`" in named(doctor, "class", "[target.kite]").what


def test_08_a_mount_that_is_off() -> None:
    pipeline = Pipeline(configured())
    reason = f"{DOUBT_PREFIX}the leader moves as we lean, as if the camera looked higher than `mount_rpy_deg` says"
    pipeline.refuse("camera front", Reason(Cause.MOUNT, reason), EPOCH)
    (advice,) = [a for a in pipeline.health(EPOCH + S).advice if a.kind == "mount"]
    assert advice.severity is Severity.WARNING
    assert "`onboard calibrate LOG`" in advice.remedy


def test_09_a_size_that_is_four_times_too_small() -> None:
    """The leader is four times as large as configured, and so seems four times as near as it is. Three times as
    large fits another flight of a nearer leader, and nothing shows it (docs/status.md)."""
    doctor = flown(moved(lambda p: p[:1] + 4.0 * (p - p[:1])), seconds=12)
    advice = named(doctor, "not-valid", "how the leader flies")
    assert "not valid: it moves as no hypothesis expects" in advice.what


@pytest.mark.parametrize("sends", [True, False])
def test_a_detector_that_has_just_stopped_is_not_said_to_find_nothing(sends: bool) -> None:
    """Its last images lay within the seconds that were looked back on."""
    health, advisor = faultless().health, Advisor(Needs(images=True))
    for k in range(6):
        received = 100 * min(k, 6 if sends else 2)
        age = max(k - 2.0, 0.0) + 0.5
        cameras = {name: replace(camera, age=age) for name, camera in health.cameras.items()}
        links = {"zenoh": LinkHealth(received=received)}
        now = replace(health, t_recv_ns=health.t_recv_ns + k * S, cameras=cameras, links=links)
        advice = [a.what for a in advisor.advise(now) if a.cause == "camera-silent"]
    assert ["finds no aircraft" in what for what in advice] == [sends]


@pytest.mark.parametrize(("nis", "advised"), [(9.0, True), (1.4, False)])
def test_own_motion_that_does_not_fit_is_named_without_an_airframe(nis: float, advised: bool) -> None:
    """In strong vibration our own state's NIS was 9 times its expectation, without an advice."""
    found = {"own_state.gps": Consistency(count=200, nis=nis, low=0.8, high=1.2)}
    advice = Advisor(Needs()).advise(replace(flown().health, consistency=found))
    assert [a.about for a in advice if a.kind == "own-misfit"] == ["own gps"] * advised


@pytest.mark.parametrize(
    ("armed", "pwm_us", "is_reported"), [(True, 1000, True), (False, 1000, False), (True, 1500, False)]
)
def test_that_no_motor_is_observed_is_reported(armed: bool, pwm_us: int, is_reported: bool) -> None:
    """Of an armed vehicle whose main outputs rest, as with DShot: its motors' faults are not named."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    outputs = [
        Datagram(
            channel="autopilot",
            encoding=Encoding.MAVLINK,
            t_recv_ns=EPOCH + ms * MS + 3 * MS,
            data=sender.servo_output_raw_encode(1000 * ms, 0, *[pwm_us] * 8).pack(sender),
        )
        for ms in range(6000, 5000 + 1000 * SECONDS, 200)
    ]
    own = {"own_state": {"airframe": "csvsf"}, "leader": {"size_prior_m": SIZE}}
    arm = lambda m: replace(m, armed=armed) if isinstance(m, Heartbeat) else m  # noqa: E731
    found = flown(arm, configured(estimator=own), extra=outputs).found.get("refused")
    assert ("no motor is observed" in (found.what if found else "")) is is_reported


@pytest.mark.parametrize(("beyond", "advised"), [(20, False), (300, True)])
def test_a_leader_at_the_edge_is_not_one_of_another_image(beyond: int, advised: bool) -> None:
    health = faultless().health
    edge = Refusal(
        source="camera front",
        cause=Cause.OUT_OF_VIEW,
        reason="out_of_view: a point",
        count=20,
        t_recv_ns=health.t_recv_ns,
    )
    counts = {"leader.out_of_view": beyond, "leader.fused": 400}
    now = replace(health, refusals=(edge,), verdicts=counts)
    assert ("pixels" in {a.kind for a in Advisor(Needs()).advise(now)}) is advised


@pytest.mark.parametrize(
    ("refused", "used", "without_position", "later", "advised"),
    [
        (3, 1, 0, 0, False),
        (20, 400, 0, 0, False),
        (20, 0, 0, 0, True),
        (20, 0, 10, 0, False),
        (20, 0, 0, 1, False),
    ],
)
def test_images_from_before_our_own_motion_are_none_with_a_wrong_stamp(
    refused: int, used: int, without_position: int, later: int, advised: bool
) -> None:
    """A daemon that has just begun takes images that were exposed before the first attitude that it has heard. An
    ArduCopter sends a position 30 s before its filter has one; once it has, those images are past."""
    health = faultless().health
    early = Refusal(
        source="camera front",
        cause=Cause.NO_POSE,
        reason="no_pose: our own attitude",
        count=refused,
        t_recv_ns=health.t_recv_ns,
    )
    counts, rejected = (
        {"leader.no_pose": refused, "leader.fused": used},
        {"filter_has_no_position": without_position},
    )
    now, advisor = replace(health, refusals=(early,), verdicts=counts, rejected=rejected), Advisor(Needs())
    for _ in range(later):
        advisor.advise(replace(now, t_recv_ns=now.t_recv_ns - 6 * S))
    advisor.advise(replace(now if later else health, t_recv_ns=now.t_recv_ns - S))
    assert ("stamps" in {a.cause for a in advisor.advise(now)}) is advised


@pytest.mark.parametrize(("known", "advised"), [(False, True), (True, False)])
def test_our_own_transponder_is_named_unless_its_address_is_set(known: bool, advised: bool) -> None:
    before = replace(flown().health, verdicts={"traffic.ourselves": 2})
    moment = Moment(replace(before, verdicts={"traffic.ourselves": 3}), before, Needs(transponder=known), 10.0)
    found = [a for a in causes_own.own_transponder(moment) if "`own_icao`" in a.remedy]
    assert len(found) == advised


@pytest.mark.parametrize(("lead_s", "wrong"), [(0.3, "later than the message arrived"), (-1.0, "too old")])
def test_10_stamps_that_are_late_or_early(lead_s: float, wrong: str) -> None:
    assert wrong in named(flown(lead_ns=round(lead_s * S)), "stamps", "exposure").what


@pytest.mark.parametrize(("off_ns", "stated", "meant"), [(EPOCH, "boot", "host"), (0, "host", "boot")])
def test_11_the_wrong_clock(off_ns: int, stated: str, meant: str) -> None:
    """Unix time that is called time since boot, and the other way round."""
    doctor = detected(lambda d, _: d.update(t_ns=d["t_ns"] + off_ns, clock=stated))
    causes = [a for a in doctor.found.values() if a.cause == "clock"]
    assert causes, doctor.found
    assert any(f"clock: {meant}" in a.remedy + a.what for a in causes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: (t + EPOCH) // 10**9, "Unix time in seconds"),
        (lambda t: (t + EPOCH) // 10**6, "Unix time in milliseconds"),
        (lambda t: (t + EPOCH) // 10**3, "Unix time in microseconds"),
        (lambda t: t + EPOCH - 3600 * S, "Unix time of a clock that is 1 hours behind"),
        (lambda t: t + EPOCH + 7 * 86_400 * S, "Unix time of a clock that is 7 days ahead"),
        (lambda t: t // 10**6, "the autopilot's time since its boot in milliseconds"),
        (lambda t: t + 1000 * S, "s after 1970, of a clock that began at 0, as a simulator's does"),
    ],
)
def test_11_another_unit_or_a_clock_that_is_off(change: Callable[[int], int], words: str) -> None:
    """The advice was to send `clock: boot`, which mended nothing."""
    doctor = detected(lambda d, _: d.update(t_ns=change(d["t_ns"]), clock="host"), 14)
    causes = [a for a in doctor.health.advice if a.severity is not Severity.NOTICE]
    assert [a.cause for a in causes] == ["clock"]
    assert words in causes[0].what


def test_11_the_uptime_of_this_computer() -> None:
    """As libcamera and V4L2 stamp. It was a simulator's clock; the autopilot's own time is still that."""
    camera = CameraHealth(count=9, rate=9.0, age=0.5, latency=1e9, lead=None, clock="host", stamp_ns=17_999 * S)
    for uptime, is_uptime in ((18_000.0, True), (18_010.0, False), (None, False)):
        load = ComputerLoad(uptime=uptime)
        now = SimpleNamespace(clock_offset_ns=EPOCH, t_recv_ns=EPOCH + 60 * S, computer=load)
        moment = cast(Moment, SimpleNamespace(now=now, needs=SimpleNamespace(ros=())))
        reading = stamp_reading(moment, "front", camera)
        assert reading is not None
        assert ("CLOCK_MONOTONIC" in reading.words, "monotonic_ns" in reading.remedy) == (is_uptime, is_uptime)
    reading = stamp_reading(moment, "front", replace(camera, stamp_ns=59 * S))
    assert reading is not None
    assert "autopilot's time since its boot" in reading.words


@pytest.mark.parametrize("began_s", [0, 1000])
def test_11_a_simulator_s_clock_in_ros(began_s: int) -> None:
    """There is no `clock` to send."""
    spans = {Clock.HOST: Span(EPOCH, EPOCH), Clock.BOOT: Span(40 * S, 40 * S)}
    reading = read_stamps([(40 + began_s) * S], Clock.HOST, spans, is_ros=True)
    assert reading is not None
    assert ("`use_sim_time`" in reading.remedy, "`clock" in reading.words + reading.remedy) == (True, False)


def test_12_pixels_that_are_distorted() -> None:
    """A wide lens without coefficients; the leader is far from the axis."""

    def to_the_side(document: dict[str, Any], _t: float) -> None:
        for p in document["detections"][0]["points"].values():
            p["u_px"] += 170.0

    wide = {"width_px": 960.0, "height_px": 960.0}
    named(detected(to_the_side, camera=wide), "lens", "`distortion`")
    calibrated = {"camera": {**wide, "distortion": [-0.1, 0.0, 0.0, 0.0]}}
    assert "lens" not in detected(to_the_side, **calibrated).found


def test_13_rates_that_are_refused() -> None:
    from onboard.autopilot.session import Session  # noqa: PLC0415 - of this test alone
    from onboard.messages import CommandAck  # noqa: PLC0415
    from tests.support.streams import heartbeat  # noqa: PLC0415

    pipeline = Pipeline(configured())
    pipeline.feed(encode([Item(EPOCH, heartbeat(0))], "autopilot")[0])
    session = Session(Config().autopilot, "autopilot", refuse=pipeline.refuse)
    session.connect(heartbeat(0))
    for _ in range(3):
        ack = CommandAck(
            t_ns=0,
            t_recv_ns=EPOCH,
            system=1,
            component=1,
            clock=Clock.NONE,
            command=511,
            result=4,
            target_system=1,
            target_component=191,
        )
        session.respond([ack], EPOCH)
    (advice,) = [a for a in pipeline.health(EPOCH + S).advice if a.cause == "rates"]
    assert "SR1_EXTRA1" in advice.remedy


def test_14_no_origin() -> None:
    link = [{"name": "autopilot", "url": "udpin:127.0.0.1:14540"}]
    doctor = flown(config=configured(link=link, leader_out=[{"link": "autopilot"}]))
    assert "GPS_GLOBAL_ORIGIN" in named(doctor, "origin", "SET_GPS_GLOBAL_ORIGIN").what


def test_15_no_attitude() -> None:
    advice = named(flown(without(Attitude)), "attitude", "mavlink stream -d DEVICE -s ATTITUDE_QUATERNION -r 50")
    assert advice.severity is Severity.ERROR


def test_16_tls_of_the_daemon() -> None:
    error = "cannot reach tls/hub:7447 (its certificate is not accepted: certificate has expired)"
    doctor = flown(rims=lambda _: Rim(links={"zenoh": LinkHealth(cause=Cause.TLS, error=error)}))
    assert "has expired" in named(doctor, "tls", "`ca_file`").what


@pytest.mark.parametrize("reason", ["Connection refused", "timed out", "No route to host", "no answer"])
def test_16_a_router_that_is_off_is_no_matter_of_certificates(reason: str) -> None:
    error = f"cannot reach tls/hub:7447 ({reason})"
    rim = Rim(links={"zenoh": LinkHealth(cause=Cause.UNREACHABLE, error=error)})
    (advice,) = Pipeline(configured()).health(EPOCH, rim).advice
    assert (advice.cause, "start `onboard router CONFIG.toml` there" in advice.remedy) == ("link", True)
    why = Reason(Cause.UNREACHABLE, f"zenoh: no router answers at {error}")
    found = why_absent(configured(link=[]), "tls/hub:7447", why)
    assert [advice.kind for advice in found] == ["daemon"]


@pytest.mark.parametrize(
    ("cause", "severity"), [(Cause.WARM_STATE, Severity.NOTICE), (Cause.OTHER_TARGET, Severity.ERROR)]
)
def test_a_state_that_is_too_old_costs_nothing_and_another_target_the_flight(
    cause: Cause, severity: Severity
) -> None:
    assert WORDS[cause].refusal.severity is severity


def test_16_two_vehicles_of_one_name() -> None:
    error = "vehicle `1` is the name of two: of this session, a1, and of b2; no sample is used"
    doctor = flown(rims=lambda _: Rim(links={"zenoh": LinkHealth(cause=Cause.NAME_SHARED, error=error)}))
    advice = named(doctor, "name", "`vehicle` of [zenoh]")
    assert (advice.severity, advice.what) == (Severity.ERROR, error)


def test_16_tls_of_the_status_itself() -> None:
    error = "zenoh: no router answers at tls/hub:7447 (tls/hub:7447: its certificate is not accepted: expired)"
    (advice, *_) = why_absent(configured(link=[]), "tls/hub:7447", Reason(Cause.TLS, error))
    assert (advice.cause, "`ca_file`" in advice.remedy) == ("tls", True)


def test_an_estimate_that_is_not_valid_for_five_seconds_has_advice() -> None:
    """By each cause, whatever its state: one in doubt is still tracked. Of our own motion in doubt nothing was
    said."""
    healthy = faultless().health
    for cause in set(Cause) - VALID:
        advisor, found = Advisor(Needs()), list[tuple[Advice, ...]]()
        for t_s in range(6):
            doubted = replace(healthy, t_recv_ns=healthy.t_recv_ns + t_s * S, causes={"leader": cause})
            found.append(tuple(a for a in advisor.advise(doubted) if a.about == "estimate leader"))
        assert found[:5] == [()] * 5
        remedies = [a for a in advisor.advise(doubted) if a.cause == "not-valid"]
        assert all(a.remedy for a in remedies)
        assert remedies, cause
        if cause in (Cause.OWN_MOTION_DOUBT, Cause.FIXES_CONTRADICT):
            assert remedies[0].severity is Severity.ERROR


def test_every_cause_that_an_estimate_states_has_a_remedy_of_its_own() -> None:
    """Those between the state of a track and the refusals of messages."""
    causes = list(Cause)
    stated = causes[causes.index(Cause.NO_MEASUREMENT) : causes.index(Cause.DOCUMENT)]
    assert set(stated) - set(WORDS) == set()


def test_17_a_port_in_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        link = [{"name": "autopilot", "url": f"udpin:127.0.0.1:{port}"}]
        config = configured(link=link, zenoh={"enabled": False})
        found = why_absent(config, "tcp/127.0.0.1:1", UNREACHABLE)
    (advice,) = [a for a in found if a.cause == "port"]
    assert f"port {port} of 127.0.0.1 is in use by" in advice.what
    assert f"(process {os.getpid()})" in advice.what
    assert "`url` of [[link]] autopilot" in advice.remedy


@pytest.mark.parametrize("enabled", [True, False])
def test_17_a_port_that_the_daemon_itself_has(enabled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """`onboard status` advised to end the very daemon that it asked for."""
    monkeypatch.setattr(absent, "_is_daemon", lambda process: process == str(os.getpid()))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = [{"name": "autopilot", "url": f"udpin:127.0.0.1:{taken.getsockname()[1]}"}]
        config = configured(link=link, zenoh={"enabled": enabled, "listen": []})
        (advice,) = why_absent(config, "tcp/127.0.0.1:1", UNREACHABLE)
    assert (advice.cause, "end that program" in advice.remedy) == ("daemon", False)
    assert f"(process {os.getpid()}) is a daemon" in advice.what
    assert "[zenoh]" in advice.remedy


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["/opt/wingline/bin/python3", "/opt/wingline/bin/onboard", "run", "c.toml"], True),
        (["/usr/bin/python3", "-m", "onboard", "run"], True),
        (["/opt/wingline/bin/onboard", "status"], False),
        (["simlink", "run", "formation"], False),
    ],
)
def test_17_what_is_a_daemon(
    words: list[str], expected: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "7").mkdir()
    (tmp_path / "7" / "cmdline").write_bytes("\0".join([*words, ""]).encode())
    monkeypatch.setattr(absent, "PROC", tmp_path)
    assert [absent._is_daemon(process) for process in ("7", "8", "")] == [expected, False, False]


def test_18_a_full_disk_is_no_slow_computer() -> None:
    def rims(second: int) -> Rim:
        error = "[Errno 28] No space left on device" if second < 9 else ""  # it was opened anew, and loses more
        load = ComputerLoad(storage_free=0 if second > 5 else None)
        sinks = {
            "recorder": SinkHealth(
                cause=Cause.DISK_FULL if error else Cause.NONE, error=error, dropped_important=1000 * second
            )
        }
        return Rim(sinks=sinks, computer=load)

    pipeline = Pipeline(configured(estimator={}))
    found = [{a.kind for a in pipeline.health(EPOCH + k * S, rims(k)).advice} for k in range(14)]
    assert all("disk" in causes and "slow" not in causes for causes in found)


def test_18_a_full_disk() -> None:
    full = SinkHealth(
        cause=Cause.DISK_FULL, error=f"[Errno {errno.ENOSPC}] {os.strerror(errno.ENOSPC)}: 'flight.mcap'"
    )
    doctor = flown(rims=lambda _: Rim(sinks={"recorder": full}))
    assert "No space left" in named(doctor, "disk", "`path` of [recorder]").what
    load = ComputerLoad(storage_free=50_000_000)
    doctor = flown(rims=lambda _: Rim(sinks={"recorder": SinkHealth()}, computer=load))
    assert "50 MB" in named(doctor, "disk", "df -h").what


def test_19_signing() -> None:
    key = read_key(b"a passphrase")
    assert key is not None
    doctor = flown(keys={"autopilot": key})
    assert "frames are not signed" in named(doctor, "signing", "`key_file` of the [[link]]").what
    assert "autopilot-silent" not in doctor.found


def test_20_a_slow_computer() -> None:
    def rims(second: int) -> Rim:
        links = {"autopilot": LinkHealth(received=1000 * second, dropped=40 * second)}
        return Rim(links=links, computer=ComputerLoad(cpu=99.0, cpu_busiest=100.0, lag=0.6))

    what = named(flown(rims=rims), "slow", "`particles`").what
    assert "lost" in what
    assert "0.60 s late" in what


def test_a_program_that_stood_still_blames_nobody_else() -> None:
    """What it did not read was not missing, and what came too late for it was not wrong."""
    pipeline, found = Pipeline(configured()), list[Advice]()
    seconds = iter([6, 7, 8, 9, 13, 14, 15, 16, 17])  # of its healths: from 9.0 to 12.8 it stood still
    due = next(seconds)
    for datagram in encode(Stream(t1=18.0, flight=CIRCLE).items(), "autopilot"):
        t = (datagram.t_recv_ns - EPOCH) / S
        if t > due:
            links = {"autopilot": LinkHealth(received=1000, skipped=400 if due > 12 else 0)}
            rim = Rim(links=links, computer=ComputerLoad(lag=4.0 if due == 13 else 0.0))
            found += pipeline.health(EPOCH + due * S, rim).advice
            due = next(seconds, 99)
        if not 9.0 < t < 12.8:
            pipeline.feed(datagram)
    assert [advice.what for advice in found if advice.cause != "timesync"] == [
        "this program stood still for 4.0 s, link autopilot: 400 datagrams had waited too long and were left out"
    ]


def test_all_four_readers_show_the_same_advice() -> None:
    """The console's lines, the pilot's STATUSTEXT, the view's panel and `onboard status`."""
    health = flown(without(TargetPoints)).health
    (advice,) = [a for a in health.advice if a.cause == "camera-silent"]
    lines: list[str] = []
    notices = Notices()
    ConsoleLines(lines.append, pilot=notices.advise).show_health(health)
    assert any(advice.what in line and advice.remedy in line for line in lines)
    assert advice.text[:MAX_TEXT_LENGTH] in [m.text for m in notices.due(0)]
    assert words.plain(advice.remedy).replace("`", "") in words.advice(health)
    shown = describe("1", health)
    assert advice.what in shown
    assert f"-> {advice.remedy}" in shown
    assert shown.startswith("vehicle 1: NOT HEALTHY")


def test_storage_of_the_recorder_that_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = configured(link=[], zenoh={"enabled": False}, recorder={"path": str(tmp_path / "flight.mcap")})
    usage = type("usage", (), {"free": 1_000_000})
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    found = why_absent(config, "tcp/127.0.0.1:1", UNREACHABLE)
    assert [a.cause for a in found] == ["disk", "daemon"]


def test_an_advice_is_published_under_its_old_name_too_and_read_by_either() -> None:
    given = {"severity": Severity.ERROR, "about": "udp", "what": "w", "remedy": "r", "text": "t"}
    new, old = Advice(kind="link", **given), Advice(cause="link", **given)
    assert new == old
    assert (new.kind, new.cause) == ("link", "link")
