"""A mount that is wrong is named with its amount, a right one never, and nothing else is."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.config import parse_config
from onboard.estimators import Withholds
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_matrix
from onboard.health import camera_errors
from onboard.health.camera_errors import (
    MAX_PATH_CORRELATION,
    Poses,
    Sights,
    Window,
    finished,
    path_correlation,
    wrong_mount,
)
from onboard.health.mounts import MIN_WINDOW_COUNT, Found, Mounts, why
from onboard.messages import (
    DOUBT_PREFIX,
    Estimate,
    Exposure,
    Lifecycle,
    MeasurementReport,
    TargetPoints,
    Verdict,
)
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship
from onboard.pipeline import Pipeline
from onboard.units import NS_PER_S
from tests.support.images import exposed
from tests.support.streams import Stream

CAMERA = parse_config({}).camera_model()
LEADER = {"size_prior_m": 2.667, "leader_class": "multirotor"}


def explain(found: list[Window]) -> Found:
    return finished(wrong_mount(found))


def windows(
    wrong: Any,
    seed: int,
    *,
    count: int = 12,
    nod: float = 0.1,
    focal: float = 1.0,
    delay: float = 0.0,
    follows: bool = False,
    moves_as_we_do: bool = False,
) -> list[Window]:
    """Windows of a vehicle that leans and turns behind a leader with a path of its own, seen by a camera that is
    turned by `wrong` (3,) rad against what is configured, whose focal length is `focal` times as long, and whose
    images are `delay` s older than their stamps. 1.5 mrad of noise. `follows`: the leader swerves by 3 to 9
    degrees, and we turn so that it stays in the middle."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        phases, rates, a = rng.uniform(0, 6, 3), rng.uniform(2, 5, 3), rng.normal(size=(3, 3))
        swerve = rng.uniform(0.05, 0.15) * np.sin(rng.uniform(0.8, 1.6) * np.arange(-1.0, 5.0, 0.02) + phases[0])

        def attitude(t: float, phases: Array = phases, rates: Array = rates, swerve: Array = swerve) -> Array:
            yaw = np.interp(t, np.arange(-1.0, 5.0, 0.02), swerve) if follows else 0.0
            return matrix_from_euler(*(nod * np.sin(rates * t + phases) + (0.0, 0.0, yaw)))

        def own(t: float, a: Array = a) -> Array:
            return np.asarray(0.5 * a[0] * t**2 + 0.2 * a[1] * np.sin(3 * t))

        rows = []
        for t in np.arange(0.0, 4.0, 0.08):
            at = t - delay
            yaw = np.interp(at, np.arange(-1.0, 5.0, 0.02), swerve) if follows else 0.0
            d = matrix_from_euler(0.0, 0.0, yaw) @ [30.0, 2.0, -4.0]
            d = d + (0.0 if moves_as_we_do else a[2] * at**2 - own(at))
            u = (attitude(at) @ matrix_from_euler(*wrong)).T @ d
            rows.append((t, *(focal * u[1:] / u[0] + 0.0015 * rng.normal(size=2)), np.linalg.norm(d)))
        t = np.arange(-1.0, 5.0, 0.02)
        poses = Poses(t, np.array([own(x) for x in t]), np.array([quaternion_from_matrix(attitude(x)) for x in t]))
        r = np.array(rows)
        found.append(Window(Sights(r[:, 0], r[:, 1:3], r[:, 3]), poses, CAMERA))
    return found


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("degrees", [-15.0, 30.0])
def test_a_wrong_mount_is_measured_within_its_sigma_seed_1(axis: int, degrees: float) -> None:
    wrong = np.zeros(3)
    wrong[axis] = np.radians(degrees)
    found = explain(windows(wrong, 1))
    assert found is not None
    theta, sigma = (np.degrees(x) for x in found)
    assert theta[axis] == pytest.approx(degrees, abs=max(5 * sigma[axis], 0.1 * abs(degrees)))
    assert sigma.max() < 1.5
    assert "`mount_rpy_deg`" in why(CAMERA, *found).words


@pytest.mark.parametrize(
    "wrong", [{"focal": 0.5}, {"focal": 0.7}, {"focal": 2.0}, {"delay": -0.3}, {"delay": 0.1}], ids=str
)
def test_a_focal_length_or_a_delay_is_no_mount_and_never_claimed_seed_1(wrong: dict[str, float]) -> None:
    """A leader that we follow on its own way moves as if one of them were wrong."""
    assert explain(windows(np.zeros(3), 1, **wrong)) is None


class Nodding:
    """Our own motion, as `Ownship` has it: at rest, in a sum of nods, rolls and turns of 0.1 rad."""

    samples = 0

    def attitude(self, t: float) -> Array:
        return matrix_from_euler(*(0.1 * np.sin(np.array([2.1, 2.9, 3.7]) * t + [0.0, 1.0, 2.0])))

    def pose_at(self, _: int) -> Any:
        return SimpleNamespace(r_OF_n=np.zeros(3), attitude_noise=np.zeros(3))

    def knows(self, _: int) -> bool:
        return True

    def motion(self, from_ns: int, to_ns: int) -> tuple[Array, Array, Array]:
        t = np.arange(1e-9 * from_ns, 1e-9 * to_ns, 0.02)
        return t, np.zeros((len(t), 3)), np.array([quaternion_from_matrix(self.attitude(x)) for x in t])


def test_a_camera_is_left_out_only_for_one_that_is_judged_and_sound_seed_4() -> None:
    """The first one looks 14 degrees lower than configured, and the second one comes later."""
    rng, own, leader = np.random.default_rng(4), Nodding(), np.array([30.0, 2.0, -4.0])
    config, withheld = parse_config({"cameras": {"low": {}}}), list[tuple[float, list[str]]]()
    second = config.camera_model().name
    mounts = Mounts(config.camera_model(), lambda *_: None)
    for t in np.arange(10.0, 70.0, 0.14):
        for name, turned in (("low", np.radians(-14.0)), *(((second, 0.0),) if t > 36.0 else ())):
            u = matrix_from_euler(0.0, turned, 0.0).T @ own.attitude(t).T @ leader
            point = (u[1:] / u[0] + 0.0015 * rng.normal(size=2)).tolist()
            mounts.see(estimate_of(name, round(t * NS_PER_S), point, leader), cast(Ownship, own))
        mounts.judge(round(t * NS_PER_S))
        if not withheld or withheld[-1][1] != list(mounts.withheld):
            withheld.append((float(t), list(mounts.withheld)))
    assert [names for _, names in withheld] == [[], ["low"]]
    assert withheld[1][0] > 36.0 + 4.0 * MIN_WINDOW_COUNT, "nobody has judged the second one before"
    mounts.doubts[second] = Reason(Cause.MOUNT, "it looks lower")
    assert mounts.withheld == {}


def test_a_camera_that_shows_the_leader_elsewhere_is_named_by_that_track_seed_5() -> None:
    """One looks 14 degrees lower than configured, so its images make a target of their own. What a camera that
    shows the leader sees beside it, such as a part of our own that stays in the image, says nothing of it."""
    rng, own, found = np.random.default_rng(5), Nodding(), list[tuple[str, str]]()
    config = parse_config({"cameras": {"low": {}}})
    sound, leader = config.camera_model().name, np.array([30.0, 2.0, -4.0])
    mounts = Mounts(config.camera_model(), lambda *why: found.append((why[0], why[1].words)))
    for t in np.arange(10.0, 38.0, 0.08):
        for name, target, turn in ((sound, "leader", 0.0), ("low", "unnamed/1", np.radians(-14.0))):
            u = matrix_from_euler(0.0, turn, 0.0).T @ own.attitude(t).T @ leader
            point = (u[1:] / u[0] + 0.0015 * rng.normal(size=2)).tolist()
            mounts.see(estimate_of(name, round(t * NS_PER_S), point, leader, target), cast(Ownship, own))
        skid = estimate_of(sound, round(t * NS_PER_S), (0.3, 0.4), leader, "unnamed/2")
        mounts.see(skid, cast(Ownship, own))
        mounts.judge(round(t * NS_PER_S))
    assert {source for source, _ in found} == {"camera low"}
    assert all("14 degrees lower" in words for _, words in found)


def test_images_of_a_camera_in_doubt_are_left_out_while_another_shows_the_leader() -> None:
    pipeline = Pipeline(parse_config({"estimator": {"leader": LEADER}}))
    images = [item.message for item in Stream(t1=7.0, sparse=True).items()]
    for message in images:
        pipeline.advance(exposed([message]))
    newest_ns = max(m.t_ns for m in images if isinstance(m, TargetPoints))
    doubt, estimator = Reason(Cause.MOUNT, "low"), pipeline.estimators["leader"]
    assert isinstance(estimator, Withholds)
    for camera, later_ns, doubts, expected in (
        ("late", 0, {"late": doubt}, doubt),
        ("late", 2 * NS_PER_S, {"late": doubt}, None),
        ("landing_target", 0, {"late": doubt}, None),
        ("late", 0, {"late": doubt, "landing_target": doubt}, None),
    ):
        image = Exposure(t_ns=newest_ns + later_ns, t_recv_ns=0, camera=camera, detections=())
        assert estimator.withholds(image, doubts) is expected


def test_an_image_that_is_left_out_reaches_no_estimator_and_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = Pipeline(parse_config({"estimator": {"leader": LEADER}}))
    why = Reason(Cause.MOUNT, f"{DOUBT_PREFIX}it looked 15 degrees lower")
    pipeline._mounts.doubts["landing_target"] = why
    pipeline._mounts._sound.add("other")
    pipeline._mounts._fused_ns["other"] = 0
    monkeypatch.setattr(pipeline.estimators["leader"], "withholds", lambda *_: why)
    for item in Stream(t1=7.0, sparse=True).items():
        pipeline.advance(exposed([replace(item.message, t_recv_ns=item.t_recv_ns)]))
    health = pipeline.health(0)
    assert health.rejected[Cause.MOUNT] > 10
    assert {r.reason for r in health.refusals if r.cause is Cause.MOUNT} == {why.words}
    assert not health.verdicts


def test_cameras_are_judged_as_our_own_motion_comes_and_not_as_health_is_asked() -> None:
    """A replay that asks for no health gives the same estimates, and names a camera at its end."""
    pipeline, judged = Pipeline(parse_config({"estimator": {"leader": LEADER}})), list[int]()
    pipeline._mounts.judge = judged.append
    for item in Stream(t1=7.0, sparse=True).items():
        pipeline.advance(exposed([replace(item.message, t_recv_ns=item.t_recv_ns)]))
    count = len(judged)
    pipeline.health(judged[-1])
    assert len(judged) == count > 5


def estimate_of(camera: str, t_ns: int, point: Sequence[float], leader: Array, target: str = "leader") -> Estimate:
    """One that would be valid if images fitted each other, from an image that was fused."""
    return Estimate(
        name="leader",
        target=target,
        sequence=0,
        t_ns=t_ns,
        state=Lifecycle.LOST,
        valid=False,
        cause=Cause.NOISE,
        reason="",
        frame="",
        components=(),
        units=(),
        mean=tuple(leader.tolist()),
        covariance=None,
        age=0.0,
        reset_count=0,
        measurement=MeasurementReport(
            source=camera, t_ns=t_ns, t_recv_ns=t_ns, verdict=Verdict.FUSED, points=((point[0], point[1]),)
        ),
    )


def test_a_right_camera_is_never_doubted_seeds_1_to_5() -> None:
    assert [seed for seed in range(1, 6) if explain(windows(np.zeros(3), seed)) is not None] == []


@pytest.mark.parametrize("nod", [0.02, 0.05])
def test_a_leader_that_swerves_and_is_kept_in_the_middle_is_no_focal_length_seeds_1_to_3(nod: float) -> None:
    """What leans as it turns, such as a delta wing ahead, and is followed by our own yaw: it was a focal length of
    0.13."""
    found = [explain(windows(np.zeros(3), seed, follows=True, nod=nod)) for seed in range(1, 4)]
    assert found == [None, None, None]


def test_a_leader_that_moves_as_we_do_is_told_by_its_path_seed_1(monkeypatch: pytest.MonkeyPatch) -> None:
    """It accelerates as we lean: a sound camera seemed to look 30 degrees lower, in 18 of 45 formations."""
    ours, own = (path_correlation(windows(np.zeros(3), 1, moves_as_we_do=x)) for x in (True, False))
    assert own < MAX_PATH_CORRELATION < ours
    monkeypatch.setattr(camera_errors, "path_correlation", lambda _: ours)
    assert explain(windows(np.radians([0.0, 15.0, 0.0]), 1)) is None


def test_a_wrong_camera_without_lean_is_not_claimed_seeds_1_to_8() -> None:
    """Nothing shows it: neither an error nor a guess."""
    wrong = np.radians([0.0, 15.0, 0.0])
    found = [explain(windows(wrong, seed, nod=0.0, focal=2.0)) for seed in range(1, 9)]
    assert found == [None] * 8
