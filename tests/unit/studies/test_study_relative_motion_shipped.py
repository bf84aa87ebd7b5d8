"""What the study of Oh & Johnson's paper flies as ours is what ships: messages through the pipeline."""

from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from onboard.config import load_config
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Attitude, LocalPosition, TargetPoints
from onboard.models.relative_motion import POSITION, SIZE
from simlink.encounters.encounter import BOOT_NS, make_encounter
from simlink.simulation import EPOCH_NS
from studies.encounters import flights as encounters
from studies.relative_motion import shipped
from studies.relative_motion.flight import Flight
from studies.relative_motion.flights import fly_many
from studies.relative_motion.formation import Lateness
from studies.relative_motion.scores import truth_of
from studies.relative_motion.shipped import DEFAULT, known, messages
from studies.relative_motion.study import flown
from studies.relative_motion.variants import BY_NAME, VARIANTS, scenario_of, setting_of
from tests.support.images import detections

ALLOWED = {
    *("camera.f_px", "camera.width_px", "camera.height_px", "camera.mount_rpy_deg", "camera.mount_offset_m"),
    "camera.distortion",  # of the lens that is drawn, as its calibration says
    *("estimator.leader.size_prior_m", "estimator.leader.leader_class"),
}


@pytest.fixture(scope="module")
def flight() -> Flight:
    return flown(BY_NAME["a"], (1,))[0].one(0)


def changed(one: Any, other: Any, path: str = "") -> set[str]:
    """The dotted keys at which two configurations differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        return {k for key in one | other for k in changed(one.get(key), other.get(key), f"{path}.{key}")}
    return set() if one == other else {path.lstrip(".")}


def beyond_defaults(settings: tuple[str, ...]) -> set[str]:
    default, set_ = (msgspec.to_builtins(load_config(None, s)) for s in ((), settings))
    default["estimator"].setdefault("leader", {})
    return changed(default, set_)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: v.name)
def test_nothing_is_configured_but_camera_size_and_class(variant: Any) -> None:
    assert beyond_defaults(known(setting_of(variant, scenario_of(variant)))) <= ALLOWED


def test_nothing_is_configured_in_encounters_but_mount_size_and_class_seed_1() -> None:
    for family in ("crab", "hover"):
        assert beyond_defaults(encounters.known(make_encounter(family, 1, 1.0))) <= ALLOWED


def test_messages_are_the_flight_in_the_order_of_arrival_seed_1(flight: Flight) -> None:
    found = messages(flight, "front")
    assert [m.t_recv_ns for m in found] == sorted(m.t_recv_ns for m in found)
    positions = [m for m in found if isinstance(m, LocalPosition)]
    np.testing.assert_array_equal([m.v_F_n for m in positions], flight.nav_v_F_n)
    np.testing.assert_allclose([m.t_ns for m in positions], BOOT_NS + 1e9 * flight.nav_t, atol=1)
    attitudes = [m for m in found if isinstance(m, Attitude)]
    R_nb = matrix_from_quaternion(np.array([m.q_nb for m in attitudes]))
    turned = Rotation.from_rotvec(0.02 * np.array([m.omega_b for m in attitudes[1:]]))
    np.testing.assert_allclose(R_nb[:-1] @ turned.as_matrix(), R_nb[1:], atol=1e-4)
    images = [m for m in detections(found) if isinstance(m, TargetPoints)]
    seen = np.isfinite(flight.image_points).all(axis=(1, 2))
    np.testing.assert_allclose([m.t_ns for m in images], BOOT_NS + 1e9 * flight.image_t[seen], atol=1)
    np.testing.assert_array_equal([m.left for m in images], flight.image_points[seen, 1])
    assert {m.t_recv_ns - m.t_ns - EPOCH_NS for m in images} == {20_000_000}


@pytest.mark.parametrize(
    ("late", "stamp", "transport"), [(Lateness(stamp=4), 80, 20), (Lateness(delivery=4), 0, 100)]
)
def test_late_stamps_and_late_delivery_are_those_of_the_images_seed_1(
    flight: Flight, late: Lateness, stamp: int, transport: int
) -> None:
    images = [m for m in detections(messages(flight, "front", late)) if isinstance(m, TargetPoints)]
    exposed = flight.image_t[np.isfinite(flight.image_points).all(axis=(1, 2))]
    np.testing.assert_allclose([m.t_ns for m in images], BOOT_NS + 1e9 * exposed + 1e6 * stamp, atol=1)
    np.testing.assert_allclose([m.t_recv_ns - m.t_ns - EPOCH_NS for m in images], 1e6 * transport, atol=2)


def test_the_pipeline_estimates_the_flight_at_its_samples_seed_1() -> None:
    variant = BY_NAME["a"]
    scenario = scenario_of(variant)
    flight = fly_many(scenario, [1], duration=8.0).one(0)
    found = shipped.track(flight, setting_of(variant, scenario), DEFAULT)
    truth = truth_of(flight)
    late = flight.nav_t > 4.0
    r = truth[late, POSITION]
    error = np.linalg.norm(found.mean[late, POSITION] - r, axis=1) / np.linalg.norm(r, axis=1)
    assert np.isfinite(error).all()
    assert error.max() < 0.1
    assert np.isnan(found.mean[0]).all()  # no estimate before the first images agree
    assert np.ptp(found.mean[late, SIZE]) < 0.2
    seen = np.isfinite(flight.image_points).all(axis=(1, 2))
    assert np.isfinite(found.nis[seen & (flight.image_t > 1.0)]).mean() > 0.9
    assert not found.fused[~seen].any()
    assert found.degrees in (4, 6)
    assert 0.3 < np.nanmean(found.nis[flight.image_t > 1.0]) / found.degrees < 2.0
