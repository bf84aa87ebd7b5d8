"""The encounters of simlink: what is sent of them by independent formulas, what is drawn, and determinism."""

from collections.abc import Sequence
from itertools import islice
from typing import TypeVar

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.messages import Attitude, LocalPosition, Message, TargetPoints
from simlink.encounters import encounter as encounter_module
from simlink.encounters.attitudes import multirotor_attitude
from simlink.encounters.curves import Motion
from simlink.encounters.encounter import BOOT_NS, Encounter, make_encounter
from simlink.encounters.families import FAMILIES
from simlink.encounters.truth import states
from simlink.sensors.camera import name_by_side
from simlink.world.constants import DT, step_count
from studies.encounters.flights import received
from tests.support.images import detections

Array = NDArray[np.float64]
M = TypeVar("M", bound=Message)
SEEDS = range(1, 4)


def rotation(euler: Sequence[float]) -> Array:
    """R_nb (3, 3) of roll, pitch, yaw, as the product of three matrices."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(euler), np.sin(euler)
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(yaw @ pitch @ roll)


def sampled(encounter: Encounter, values: Array, messages: Sequence[Message], late: float = 0.0) -> Array:
    """Rows of the truth at the stamps of messages, `late` s before."""
    when = [(m.t_ns - BOOT_NS) * 1e-9 - late for m in messages]
    return np.column_stack([np.interp(when, encounter.truth.t, x) for x in values.T])


def of(encounter: Encounter, kind: type[M]) -> list[M]:
    return [m for m in detections(received(encounter)) if isinstance(m, kind)]


@pytest.mark.parametrize("family", [family for family in FAMILIES if family not in ("cut", "two_cross")])
def test_image_points_are_the_projection_of_the_wing_seed_1(family: str) -> None:
    encounter = make_encounter(family, 1, 12.0)
    truth, camera, size = encounter.truth, encounter.scenario.camera, encounter.scenario.leader.size
    images = of(encounter, TargetPoints)
    R_bc, r_FC_b = rotation(np.radians(camera.mount_rpy_deg)), np.array(camera.mount_offset)
    assert len(images) > 6.0 * camera.rate
    rows = sampled(encounter, np.hstack([truth.r_FL_n, truth.euler_L, truth.euler_F]), images)
    errors = []
    for image, row in zip(images, rows, strict=True):
        wing = 0.5 * size * rotation(row[3:6])[:, 1]
        seen = [R_bc.T @ (rotation(row[6:9]).T @ (row[:3] + k * wing) - r_FC_b) for k in (0.0, -1.0, 1.0)]
        center, *tips = [(p[1] / p[0], p[2] / p[0]) for p in seen]
        measured = np.array([image.center, image.left, image.right])
        off = [np.abs(measured - np.array([center, *pair])).max() for pair in (tips, tips[::-1])]
        errors.append(min(off) * camera.f_px)
    # six numbers with noise: their largest lies between these multiples of it; a lens bends its edge by a fifth
    assert max(errors) < 6.5 * camera.sigma_px
    assert 0.8 * camera.sigma_px < np.median(errors) < 2.4 * camera.sigma_px


def test_wingtips_are_named_by_their_side_in_the_image_seeds_1_to_3() -> None:
    for seed in SEEDS:
        images = of(make_encounter("hover", seed, 5.0), TargetPoints)
        assert all(image.left[0] <= image.right[0] for image in images)
    swapped = name_by_side(((0.0, 0.0), (0.2, 0.1), (-0.2, -0.1)))
    assert swapped == ((0.0, 0.0), (-0.2, -0.1), (0.2, 0.1))


def test_our_own_state_is_late_and_off_by_what_was_drawn_seeds_1_to_3() -> None:
    in_sigmas = []  # of yaw and pitch
    for seed in SEEDS:
        encounter = make_encounter("circling", seed, 10.0)
        nav, truth = encounter.scenario.nav, encounter.truth
        positions, lag = of(encounter, LocalPosition)[10:], DT * step_count(nav.position_delay)
        px4 = encounter.scenario.vehicle.autopilot == "px4"
        assert lag == 0.0 if px4 else 0.015 <= lag <= 0.03
        r = sampled(encounter, truth.follower.r, positions, lag)
        assert np.abs(np.array([p.r_OF_n for p in positions]) - r).max() < 1e-5  # of single precision
        v = sampled(encounter, truth.follower.v, positions, lag)
        off = np.abs(np.array([p.v_F_n for p in positions]) - v)
        assert 0.0 < off.max() < 4.5 * nav.velocity.sigma
        attitudes = of(encounter, Attitude)
        euler = sampled(encounter, truth.euler_F, attitudes)
        for m, angles in zip(attitudes, euler, strict=True):
            w, x, y, z = m.q_nb
            forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
            turned = rotation(angles).T @ forward
            sigmas = (nav.yaw_deg.sigma, nav.attitude_deg.sigma)
            in_sigmas.append(np.degrees(turned[1:]) / sigmas)
    assert np.abs(in_sigmas).max() < 4.0
    assert (np.sqrt(np.mean(np.square(in_sigmas), axis=0)) > 0.5).all()


def test_body_rates_are_those_of_the_rotation_seed_3() -> None:
    truth = make_encounter("stop_turn_leave", 3, 10.0).truth
    for k, state in enumerate(islice(states(truth), 2000)):
        if k % 300 != 200:
            continue
        step = rotation(truth.euler_F[k - 1]).T @ rotation(truth.euler_F[k])
        turn = np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]]) / 2.0
        assert np.allclose(turn / DT, state.omega_b, atol=1e-4)


def test_a_multirotor_leans_so_that_its_thrust_carries_it() -> None:
    """Thrust is along -z of the body: f_n = a + drag (v - wind) - g."""
    motion = Motion(*(np.array([row]) for row in ([0.0, 0.0, 0.0], [6.0, -3.0, 0.0], [1.0, 2.0, -0.5])))
    wind = np.array([1.0, 1.0, 0.0])
    (euler,) = multirotor_attitude(motion, np.array([2.0]), wind, 0.2)
    f = np.array([1.0 + 0.2 * 5.0, 2.0 - 0.2 * 4.0, -0.5 - 9.80665])
    assert np.allclose(-rotation(euler)[:, 2], f / np.linalg.norm(f))
    assert euler[2] == 2.0


def test_other_families_leave_an_encounter_as_it_is_seed_4(monkeypatch: pytest.MonkeyPatch) -> None:
    one = make_encounter("hover", 4, 1.0)
    monkeypatch.setattr(encounter_module, "FAMILIES", {"further": FAMILIES["crab"], "hover": FAMILIES["hover"]})
    assert np.array_equal(one.truth.r_FL_n, make_encounter("hover", 4, 1.0).truth.r_FL_n)
    assert encounter_module._stream_seed("hover", 4) == 4 << 32 | 0xFAD8B7D4  # in every process


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_family_and_seed_give_the_same_bytes_seeds_4_and_5(family: str) -> None:
    one, again, other = (msgspec.json.encode([*make_encounter(family, s, 3.0).datagrams()]) for s in (4, 4, 5))
    assert one == again != other


def test_an_unknown_family_is_refused() -> None:
    with pytest.raises(ValueError, match="choose one of behind"):
        make_encounter("upside_down", 1)
