"""The leader in absolute terms, against numbers worked out by hand and pymap3d's geodesy."""

from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pymap3d
import pymap3d.vincenty
import pytest
from numpy.testing import assert_allclose

from onboard.autopilot.leader_state import (
    WITHHELD_RANGE_SIGMA_RATIO,
    WITHHELD_SIGMA_FACTOR,
    LeaderStates,
    acceleration,
)
from onboard.config import OwnErrors
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import Lifecycle
from onboard.messages.causes import Cause
from tests.support.leader import ORIGIN, T, estimate, origin, own_global, own_pose

MS = 1_000_000
HOST = 1_800_000_000_000_000_000


def states(errors: OwnErrors | None = None) -> LeaderStates:
    made = LeaderStates(errors or OwnErrors())
    made.update(own_pose())
    made.update(estimate())
    return made


def test_the_leader_is_where_we_are_plus_where_it_is_from_us_predicted_to_now() -> None:
    """130, 54, -38 at 11, 0, 0.5 m/s, turning right at 3 m/s^2; 0.2 s later."""
    s = states().at(T + 200 * MS, HOST)
    assert s is not None
    assert (s.valid, s.t_ns, s.t_host_ns, s.sequence, s.size) == (True, T + 200 * MS, HOST, 5, 2.5)
    assert_allclose(s.r_OL_n, (132.2, 54.06, -37.9), atol=1e-9)
    assert_allclose(s.v_L_n, (11.0, 0.6, 0.5), atol=1e-9)
    assert_allclose(s.a_L_n, (0.0, 3.0, 0.0), atol=1e-9)
    assert_allclose(s.r_FL_n, (30.2, 4.06, 2.1), atol=1e-9)  # we have flown 2 m
    assert s.age == pytest.approx(0.22)


def test_the_covariance_is_that_of_the_estimate_and_of_our_own_position_carried_on() -> None:
    s = states(OwnErrors(position_sigma_m=2.0, velocity_sigma_m_s=0.3)).at(T + 500 * MS, HOST)
    assert s is not None
    P = np.array(s.covariance)
    speed = 0.25 + 0.09  # of the estimate's velocity north, and of our own
    assert P[3, 3] == pytest.approx(speed)
    assert P[0, 3] == pytest.approx(0.5 * speed)
    assert P[0, 0] == pytest.approx(4.0 + 4.0 + 0.25 * speed)
    assert_allclose(P, P.T)
    relative = np.array(s.r_FL_covariance)  # without our own position
    assert relative.shape == (3, 3)
    assert relative[0, 0] == pytest.approx(4.0 + 0.25 * 0.25)


def test_a_pose_older_than_the_estimate_is_carried_on() -> None:
    """Attitudes, too, move the time to which estimates are predicted."""
    made = LeaderStates(OwnErrors())
    made.update(own_pose(a_F_n=(0.0, 1.0, 0.0)))
    made.update(estimate(t_ns=T + 20 * MS))
    s = made.at(T + 20 * MS, HOST)
    assert s is not None
    assert_allclose(s.r_OL_n, (130.2, 54.0002, -38.0), atol=1e-9)


def test_with_the_origin_it_is_in_degrees_as_pymap3d_has_it() -> None:
    made = states()
    assert made.at(T, HOST).lat_deg is None
    made.receive([origin()], 7, 1)
    s = made.at(T, HOST)
    assert s is not None
    expected = pymap3d.ned2geodetic(130.0, 54.0, -38.0, *ORIGIN)
    assert_allclose((s.lat_deg, s.lon_deg), expected[:2], atol=1e-9)
    assert s.alt_msl == pytest.approx(expected[2], abs=1e-4)
    assert made.has_stated_origin


def test_without_an_origin_our_own_global_position_gives_it() -> None:
    """We fly 10 m/s to the north; the message is 50 ms newer than our pose, and 20 ms older than its stamp."""
    made = states()
    made.delay_ns = 20 * MS
    made.receive([own_global(geodetic_from_ned((100.3, 50.0, -40.0), ORIGIN), T + 50 * MS)], 7, 1)
    assert not made.has_stated_origin
    assert made.origin is not None
    assert_allclose(made.origin[:2], ORIGIN[:2], rtol=0, atol=1e-7)
    assert made.origin[2] == pytest.approx(500.0, abs=0.01)


def test_an_origin_that_our_own_positions_contradict_is_not_used() -> None:
    """After a reboot in flight, or an origin moved by a person."""
    made = states()
    made.receive([origin()], 7, 1)
    made.receive([own_global(geodetic_from_ned((115.0, 50.0, -40.0), ORIGIN))], 7, 1)
    assert made.has_stated_origin
    moved = (47.41, 8.5, 500.0)
    made.receive([own_global(geodetic_from_ned((100.0, 50.0, -40.0), moved))], 7, 1)
    assert not made.has_stated_origin
    assert made.origin is not None
    assert_allclose(made.origin[:2], moved[:2], rtol=0, atol=1e-7)


def test_origins_of_others_are_not_ours() -> None:
    made = states()
    made.receive([origin(system=8), origin(component=2)], 7, 1)
    assert made.origin is None


@pytest.mark.parametrize(
    ("changed", "late_ms", "reason"),
    [
        ({"valid": False, "state": Lifecycle.LOST, "reason": "no image", "age": 3.0}, 0, "no image"),
        ({"mean": None, "covariance": None, "valid": False, "reason": "no image yet"}, 0, "no image yet"),
        ({}, 501, "no own motion for 0.5 s: not predicted further"),
    ],
)
def test_what_is_not_valid_has_no_position(changed: dict[str, object], late_ms: int, reason: str) -> None:
    made = LeaderStates(OwnErrors())
    made.update(own_pose())
    made.update(estimate(**changed))
    s = made.at(T + late_ms * MS, HOST)
    assert s is not None
    assert (s.valid, s.reason, s.r_OL_n, s.v_L_n, s.covariance) == (False, reason, None, None, None)


@pytest.mark.parametrize(
    ("changed", "has_vectors"),
    [
        ({"age": 0.1}, True),
        ({"age": 0.5}, False),
        ({"age": None}, False),
        ({"age": 0.1, "mean": None, "covariance": None}, False),
    ],
)
def test_a_leader_that_is_withheld_in_the_image_is_published_with_an_open_range(
    changed: dict[str, object], has_vectors: bool
) -> None:
    sure = states().at(T, HOST)
    made = LeaderStates(OwnErrors())
    made.update(own_pose())
    made.update(
        estimate(valid=False, state=Lifecycle.LOST, cause=Cause.UNEXPECTED, reason="unexpected", **changed)
    )
    withheld = made.at(T, HOST)
    assert sure is not None
    assert withheld is not None
    assert (withheld.valid, withheld.cause, withheld.reason) == (False, Cause.UNEXPECTED, "unexpected")
    assert (withheld.r_OL_n is not None) is has_vectors
    if has_vectors:
        assert withheld.r_OL_n == sure.r_OL_n
        distance = float(np.linalg.norm(withheld.r_FL_n))
        u = np.array(withheld.r_FL_n) / distance
        P, of_sure = np.array(withheld.r_FL_covariance), np.array(sure.r_FL_covariance)
        aside = np.cross(u, (0.0, 0.0, 1.0))
        open_range = (WITHHELD_RANGE_SIGMA_RATIO * distance) ** 2
        assert u @ P @ u == pytest.approx(WITHHELD_SIGMA_FACTOR**2 * u @ of_sure @ u + open_range)
        assert aside @ P @ aside == pytest.approx(WITHHELD_SIGMA_FACTOR**2 * aside @ of_sure @ aside)


def test_without_our_own_position_there_is_none_of_the_leader() -> None:
    made = LeaderStates(OwnErrors())
    assert made.at(T, HOST) is None
    made.update(own_pose(r_OF_n=(None, None, -40.0)))
    made.update(estimate())
    s = made.at(T, HOST)
    assert s is not None
    assert (s.valid, s.reason) == (False, "our own position is not known")


def test_a_leader_that_climbs_has_its_acceleration_in_the_axes_of_its_path() -> None:
    climb = np.radians(30.0)
    v_L = 12.0 * np.array([np.cos(climb), 0.0, -np.sin(climb)])
    for name, a_n in (("a_along", v_L / 6.0), ("a_long", [-1.5, 0.0, -1.5 * np.sqrt(3.0)])):
        size = 2.0 if name == "a_along" else 3.0
        known = {"a_lat": 0.0, "a_long": 0.0, "a_along": 0.0, name: size}
        estimate = SimpleNamespace(mean=tuple(known.values()), components=tuple(known))
        assert acceleration(estimate, v_L) == pytest.approx(np.array(a_n))


def test_a_leader_that_hovers_has_no_acceleration() -> None:
    made = states()
    slow = (30.0, 4.0, 2.0, -9.5, 0.3, 0.0, 2.5, 3.0, 0.0)  # 0.6 m/s over ground
    made.update(estimate(mean=slow))
    s = made.at(T, HOST)
    assert s is not None
    assert s.a_L_n == (0.0, 0.0, 0.0)


def ardupilot_local(place: tuple[float, float, float], start: tuple[float, float, float]) -> tuple[float, ...]:
    """Local NED as ArduPilot has it: degrees by their lengths, those of longitude half-way."""
    degree, east = 111319.4908, (place[1] - start[1] + 180.0) % 360.0 - 180.0
    middle = np.radians(0.5 * (place[0] + start[0]))
    return (place[0] - start[0]) * degree, east * degree * np.cos(middle), start[2] - place[2]


def px4_local(place: tuple[float, float, float], start: tuple[float, float, float]) -> tuple[float, ...]:
    """Local NED as PX4 has it: distance and course from the origin, on a sphere."""
    distance, course_deg, *_ = pymap3d.vincenty.vdist(*start[:2], *place[:2])
    course = np.radians(course_deg)
    return float(distance * np.cos(course)), float(distance * np.sin(course)), start[2] - place[2]


@pytest.mark.parametrize("local", [ardupilot_local, px4_local], ids=["ArduPilot", "PX4"])
@pytest.mark.parametrize("is_stated", [False, True], ids=["origin not stated", "stated"])
@pytest.mark.parametrize(
    ("start", "flown"),
    [
        ((47.4, 8.5, 500.0), (100.0, 50.0)),
        ((47.4, 8.5, 500.0), (0.0, 3000.0)),
        ((60.0, 10.0, 500.0), (0.0, 10_000.0)),
        ((60.0, 10.0, 500.0), (7000.0, -7000.0)),
        ((-60.0, 179.99, 0.0), (0.0, 10_000.0)),
        ((89.9973, 20.0, 0.0), (0.0, 100.0)),
        ((-89.9973, -70.0, 2800.0), (50.0, 250.0)),
    ],
    ids=["near", "3 km", "60 N, 10 km", "60 N, north-west", "antimeridian", "300 m from the pole", "south pole"],
)
def test_far_from_the_origin_and_near_the_poles_north_is_that_of_here(
    start: tuple[float, float, float], flown: tuple[float, float], is_stated: bool, local: Any
) -> None:
    """The leader is 30 m north, 4 m east of us, by what north and east are where we are; pymap3d says where."""
    ours = pymap3d.ned2geodetic(*flown, -40.0, *start)
    made = LeaderStates(OwnErrors())
    made.update(own_pose(r_OF_n=local(ours, start), v_F_n=(0.0, 0.0, 0.0)))
    made.update(estimate())
    if is_stated:
        stated = {"lat_deg": start[0], "lon_deg": start[1], "alt_msl": start[2]}
        made.receive([msgspec.structs.replace(origin(), **stated)], 7, 1)
    made.receive([own_global(ours)], 7, 1)
    s = made.at(T, HOST)
    assert s is not None
    assert s.lat_deg is not None
    wrong = pymap3d.geodetic2ned(s.lat_deg, s.lon_deg, s.alt_msl, *pymap3d.ned2geodetic(30.0, 4.0, 2.0, *ours))
    assert np.linalg.norm(wrong) < 0.3
