"""Classes of targets: named points, boxes, and what both do for a track."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import ConfigError, parse_config
from onboard.estimators.leader import assumptions
from onboard.estimators.leader.assumptions import GENERIC_BOX_BIAS, OFFSET_BIAS_FACTOR
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.belief import make_filter
from onboard.estimators.leader.hypotheses.start import start
from onboard.estimators.leader.hypotheses.summary import summarise
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.prepare import features_of, measure
from onboard.estimators.leader.image.shape import ROTORS, shape_of
from onboard.messages import ImageFeature, TargetDetection, TargetPoints
from onboard.models.relative_motion import POSITION
from tests.support.images import fused
from tests.support.streams import CIRCLE, FOCAL_LENGTH_PX, S, Stream, advance

SIGMA = 1 / FOCAL_LENGTH_PX
WINGED = {"aircraft": "fixed-wing"}
PLANE = {"size_prior_m": 2.0, "points_m": {"nose": [0.7, 0.0, 0.0], "tail": [-0.8, 0.0, -0.1]}}
IMAGE = CIRCLE.image(6 * S)


def leader(**section: Any) -> Any:
    return parse_config({"estimator": {"leader": section}}).estimator["leader"]


def feature(name: str, u: float, v: float, sigma: float = SIGMA) -> ImageFeature:
    return ImageFeature(name=name, point=(u, v), sigma=sigma)


def detection(*features: ImageFeature, half: tuple[float, float] | None = None) -> TargetDetection:
    fields = {name: getattr(IMAGE, name) for name in ("t_ns", "t_recv_ns", "system", "component", "camera")}
    if half is None:
        return TargetDetection(**fields, target="leader", features=features)
    (u, v), (a, b) = features[-1].point, half
    sides = (u - a, v), (u, v - b), (u + a, v), (u, v + b)
    return TargetDetection(**fields, target="leader", features=features, half_width=max(half), sides=sides)


def measured(image: Any, **section: Any) -> Any:
    saw = features_of(image, SIGMA, center_on_wing=False, half_wing=0.04)
    return measure(shape_of(leader(**section)), saw)


def test_a_box_measures_its_sides_and_no_wing() -> None:
    m = measured(detection(feature("box", 0.1, 0.05), half=(0.04, 0.01)), **WINGED)
    rows = m.rows
    assert (m.has_wing, m.has_extent, rows.is_box, rows.names) == (False, True, True, ())
    assert rows.y == pytest.approx([0.0, 0.0, 0.08, 0.02], rel=0.03, abs=2e-4)
    assert np.sqrt(rows.R.diagonal()) == pytest.approx(0.05 * 0.08 * np.sqrt([0.5, 0.5, 2.0, 2.0]), rel=0.03)
    assert m.span == pytest.approx(math.hypot(0.04, 0.01) * math.sqrt(2.0), rel=0.02)


def test_a_class_without_wings_is_bounded_by_its_points_alone() -> None:
    rotors = {f"r{k}": [0.2 * (-1) ** k, 0.2 * (-1) ** (k // 2), -0.02] for k in range(4)}
    copter = {"size_prior_m": 0.8, "points_m": rotors}
    winged, plain = (
        measured(detection(feature("box", 0.1, 0.05), half=(0.04, 0.01)), **copter, wings=wings).rows.points
        for wings in (True, False)
    )
    assert np.abs(winged[:, 1]).max() == 0.5
    assert np.abs(plain[:, 1]).max() == pytest.approx(0.25)
    assert len(plain) == len(winged) - 2


def width(bounds: Any, azimuth: float) -> float:
    return float(np.ptp(bounds[:, :2] @ [-math.sin(azimuth), math.cos(azimuth)]))


@pytest.mark.parametrize(
    ("section", "narrowest", "widest"),
    [
        ({}, 1.0, 1.22),
        ({"aircraft": "quadrotor", "leader_class": "fixed_wing"}, 1.0, 1.22),
        ({"aircraft": "hexarotor"}, 0.9, 1.0),
        ({"aircraft": "octorotor"}, 1.0, 1.06),
        ({"leader_class": "fixed_wing"}, 0.62, 1.0),
        (WINGED | {"size_prior_m": 3.0}, 0.62, 1.0),
        (PLANE | {"aircraft": "quadrotor"}, 1.0, 1.22),
        (PLANE, 0.61, 1.0),
    ],
)
def test_a_box_bounds_what_aircraft_of_its_kind_have(
    section: dict[str, Any], narrowest: float, widest: float
) -> None:
    """The rotors of a quadrotor are a fifth wider from its corners, a wing is narrower from its side."""
    bounds = shape_of(leader(**section)).bounds
    widths = [width(bounds, azimuth) for azimuth in np.linspace(0.0, 0.5 * math.pi, 91)]
    assert min(widths) == pytest.approx(narrowest, abs=0.03)
    assert max(widths) == pytest.approx(widest, abs=0.03)


@pytest.mark.parametrize(("name", "count"), ROTORS.items())
def test_a_multirotor_is_as_wide_as_its_rotors_from_every_side(name: str, count: int) -> None:
    """Beside true disks, none of them in front, whose width from the front is 1."""
    at = math.tau * (np.arange(count) + 0.5) / count
    radius = 0.8 * math.sin(math.pi / count)

    def true(azimuth: float) -> float:
        return float(np.ptp(np.sin(at - azimuth))) + 2.0 * radius

    bounds = shape_of(leader(aircraft=name)).bounds
    for azimuth in np.linspace(0.0, math.tau, 720, endpoint=False):
        assert width(bounds, azimuth) == pytest.approx(true(azimuth) / true(0.0), abs=0.01)


def test_points_of_a_class_keep_their_names_whatever_its_boxes_bound() -> None:
    plain, rotors = shape_of(leader(**PLANE)), shape_of(leader(**PLANE, aircraft="quadrotor"))
    assert rotors.names == plain.names == ("nose", "tail")
    assert rotors.points.tolist() == plain.points.tolist()


def test_how_high_a_multirotor_is_is_not_known() -> None:
    R = measured(detection(feature("box", 0.0, 0.0), half=(0.04, 0.01))).rows.R
    assert math.sqrt(R[2, 2]) == pytest.approx(math.sqrt(2.0) * 0.05 * 0.08, rel=0.01)
    assert math.sqrt(R[3, 3]) == pytest.approx(math.sqrt(2.0) * math.hypot(0.05, 0.08) * 0.08, rel=0.01)


def test_a_box_that_the_edge_may_cut_off_is_a_direction_off_by_half_a_wing() -> None:
    cut = replace(detection(feature("box", 0.3, 0.0), half=(0.01, 0.01)), sides=None)
    m = measured(cut)
    assert (m.further, m.has_extent, len(m.y)) == (None, False, 2)
    assert math.sqrt(m.rows.R[0, 0]) == pytest.approx(OFFSET_BIAS_FACTOR * 0.04, rel=0.01)


def test_a_box_beside_points_that_show_the_range_is_not_used() -> None:
    box = feature("box", 0.1, 0.05)
    tips = feature("left", 0.06, 0.05), feature("right", 0.14, 0.05)
    with_tips = measured(detection(*tips, box, half=(0.04, 0.01)))
    assert (with_tips.further, with_tips.has_wing, with_tips.has_extent) == (None, True, True)
    ends = feature("nose", 0.06, 0.05), feature("tail", 0.14, 0.05)
    with_ends = measured(detection(*ends, box, half=(0.04, 0.01)), **PLANE)
    assert (with_ends.rows.is_box, with_ends.has_wing) == (False, False)
    assert with_ends.span == pytest.approx(0.08 / math.sqrt(2.0), rel=0.03)
    assert measured(detection(feature("center", 0.1, 0.05), box, half=(0.04, 0.01))).rows.is_box


def test_points_too_near_to_each_other_show_no_range() -> None:
    ends = feature("center", 0.1, 0.05), feature("tail", 0.1 + SIGMA, 0.05)
    assert not measured(detection(*ends), **PLANE).has_extent


def test_named_wingtips_say_which_one_is_left_and_nothing_of_their_distance() -> None:
    plain, sided = measured(IMAGE, **PLANE), measured(IMAGE, **PLANE, named_wingtips=True)
    assert plain.further is None
    span = math.dist(IMAGE.left, IMAGE.right)
    assert sided.further.points[:, 1].tolist() == [-0.5, 0.5]
    assert np.sqrt(sided.further.R.diagonal()) == pytest.approx(np.full(4, 0.3 * span))
    assert sided.y.tolist() == plain.y.tolist()
    assert sided.keypoint_bias == 0.0


def test_further_points_are_misplaced_as_a_share_of_the_length_that_shows_the_nose() -> None:
    """3 % of the span of 2 m at both ends of 1.5 m."""
    image = detection(*(feature(n, 0.1, 0.05) for n in ("center", "left", "right", "nose", "tail")))
    assert measured(image, **PLANE).keypoint_bias == pytest.approx(math.sqrt(2.0) * 0.06 / 1.5)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"target": {"plane": {}}}, "target.plane: object missing required field `size_prior_m`"),
        ({"target": {"plane": {"size": 1}}}, "unknown key target.plane.size"),
        ({"target": {"plane": {"size_prior_m": 0.0}}}, "target.plane.size_prior_m is 0.0: expected `float` > 0.0"),
        (
            {"target": {"plane": {"size_prior_m": 2.0, "points_m": {"left": [0, -1, 0]}}}},
            "points_m.left: every class",
        ),
        (
            {"target": {"plane": {"size_prior_m": 2.0, "points_m": {"box": [0, -1, 0]}}}},
            "the name is reserved",
        ),
        (
            {"target": {"plane": {"size_prior_m": 2.0, "points_m": {"fin": [0, 0, -7]}}}},
            "points_m.fin: farther than 3",
        ),
        ({"target": {"plane": {"size_prior_m": 2.0, "points_m": {"fin": [0, 0]}}}}, "of length 3, got 2"),
        (
            {"target": {"copter": {"size_prior_m": 0.5, "wings": False}}},
            "wings = false: points_m must say how long and how wide it is",
        ),
        (
            {"estimator": {"leader": {"wings": False, "points_m": {"nose": [1, 0, 0], "tail": [-1, 0, 0]}}}},
            "wings = false: points_m must say how long and how wide it is",
        ),
        (
            {"target": {"copter": {"size_prior_m": 0.5, "wings": False, "aircraft": "quadrotor"}}},
            'target.copter: aircraft = "quadrotor" and wings = false: both say what boxes bound',
        ),
        (
            {"estimator": {"leader": {"aircraft": "tricopter"}}},
            "estimator.leader.aircraft is 'tricopter': expected one of 'fixed-wing', ",
        ),
        (
            {"estimator": {"leader": {"points_m": {"center": [0, 0, 0]}}}},
            "estimator.leader: points_m.center: every",
        ),
        (
            {"target": {"plane": {"size_prior_m": 2.0, "points_m": {f"p{i}": [0, 0, 0] for i in range(33)}}}},
            "32 points at most, not 33",
        ),
    ],
)
def test_a_class_that_cannot_be_used_is_refused_by_its_key(table: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_config({"estimator": {"leader": {}}, **table})
    assert expected in str(error.value)


def test_points_that_any_class_names_are_used_by_every_camera() -> None:
    config = parse_config(
        {
            "cameras": {"tele": {}},
            "target": {"plane": PLANE},
            "estimator": {"leader": {"points_m": {"tail": [-0.5, 0, 0], "rotor": [0.4, 0.4, 0]}}},
        }
    )
    for camera in config.camera_inputs().values():
        assert camera.points == ("center", "left", "right", "tail", "rotor", "nose")


def test_each_class_has_its_own_size_seed_1() -> None:
    config = parse_config(
        {"target": {"big": {"size_prior_m": 4.0}}, "estimator": {"leader": {"size_prior_m": 2.0}}}
    )

    def size(class_name: str) -> float:
        images = (item.message for item in Stream(t1=6.5).items())
        named = [_named(m, class_name) if isinstance(m, TargetPoints) else m for m in images]
        newest = advance(named, config).estimates[-1]
        assert newest.mean is not None, newest.reason
        return newest.mean[newest.components.index("size")]

    assert size("big") == pytest.approx(4.0, rel=0.01)
    assert size("") == size("small") == pytest.approx(2.0, rel=0.01)


def _named(m: TargetPoints, class_name: str) -> TargetPoints:
    return replace(m, class_name=class_name)


def test_images_do_not_reduce_the_bias_of_named_points() -> None:
    """It stays in the range of a wing seen along itself, and an image of the wing alone does not take it away."""
    settings = make_filter(leader(**PLANE))._settings
    pose = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
    named = measured(
        replace(IMAGE, others=(feature("nose", *IMAGE.center), feature("tail", *IMAGE.center))), **PLANE
    )
    cloud = start(settings, named, pose)
    for seen_ in (named, named, measured(IMAGE, **PLANE)):
        cloud, _ = update.update(settings, prediction.predict(settings, cloud, 0.1, np.zeros(3)), seen_, pose)
    assert cloud.keypoint_bias == named.keypoint_bias > 0.03
    line = cloud.means[:, POSITION] / np.linalg.norm(cloud.means[:, POSITION], axis=1)[:, None]
    edge_on_visibility = cloud._replace(headings=np.arctan2(line[:, 1], line[:, 0]) + 0.5 * np.pi)
    with_it, without = (
        summarise(settings, c).range_sigma()
        for c in (edge_on_visibility, edge_on_visibility._replace(keypoint_bias=0.0))
    )
    assert with_it**2 - without**2 == pytest.approx(cloud.keypoint_bias**2, rel=0.1)


def test_the_bias_of_boxes_is_in_the_range_and_points_reduce_it_seed_3() -> None:
    settings = make_filter(leader())._settings
    m = measured(detection(feature("box", 0.1, 0.05), half=(0.04, 0.01)), **WINGED)
    pose = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
    cloud = start(settings, m, pose)
    assert [(bias.name, bias.sigma) for bias in cloud.biases] == [("boxes", GENERIC_BOX_BIAS)]
    exact = start(settings, m._replace(rows=m.rows._replace(bias=0.0)), pose)
    with_it, without = (summarise(settings, c).range_sigma() for c in (cloud, exact))
    assert with_it**2 - without**2 == pytest.approx(GENERIC_BOX_BIAS**2, rel=0.03)
    after, _ = update.update(settings, cloud, measured(IMAGE), pose)
    assert after.edge_on_visibility == assumptions.MIN_VISIBLE_FRACTION


def judged(box: Any, noise: float = 0.0) -> Any:
    """The update by a box, of a filter that started with another, at a camera of so noisy an attitude, rad."""
    filter_ = make_filter(leader())
    first = measured(detection(feature("box", 0.0, 0.0), half=(0.04, 0.012)))
    pose = CameraPose(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), noise**2 * np.eye(3))
    return fused(filter_, filter_.start(first, pose, None), box, pose)


def test_a_box_is_judged_by_where_its_middle_and_how_large_it_is() -> None:
    same = judged(measured(detection(feature("box", 0.0, 0.0), half=(0.04, 0.012))))
    box = measured(detection(feature("box", 0.0, 0.0), half=(0.04, 0.012)))
    wider = box._replace(rows=box.rows._replace(y=box.rows.y + np.array([0.005, -0.0005, 0.006, -0.001])))
    off = judged(wider).innovation - same.innovation
    assert off[:4] == pytest.approx([0.005, -0.0005, 0.006, -0.001])
    assert np.sqrt(same.innovation_covariance.diagonal()[2:4]).max() < 0.1  # rad: it measures width and height


def test_the_white_noise_of_our_attitude_moves_a_box_and_makes_it_no_larger() -> None:
    box = measured(detection(feature("box", 0.0, 0.0), half=(0.04, 0.012)))
    calm, shaken = judged(box).innovation_covariance, judged(box, 0.01).innovation_covariance
    more = np.diag(shaken - calm)
    assert more[:2] == pytest.approx([1e-4, 1e-4], rel=1e-3)
    assert np.abs(more[2:4]).max() < 1e-9
