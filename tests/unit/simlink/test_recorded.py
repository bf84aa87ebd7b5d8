"""Leaders that others flew: what a log says becomes a smooth trajectory, or is refused in words, and is flown."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.geometry.rotations import matrix_from_quaternion
from simlink.cli import main
from simlink.encounters.others import GEOMETRIES, GEOMETRY_NAMES, MIN_DISTANCE, quaternions, recorded_encounter
from simlink.encounters.recording import (
    ATTITUDE_COLUMNS,
    POSITION_COLUMNS,
    VELOCITY_COLUMNS,
    LogError,
    Recording,
    read_recording,
)
from simlink.encounters.trajectory import Trajectory, read_trajectories, stretches
from simlink.log import write_log
from simlink.scenarios.scenario import load_scenario
from simlink.world.constants import DT, GRAVITY
from simlink.world.truth import hovering_angles
from tests.support.golden import assert_golden, numbers
from tests.unit.simlink.test_all_simulated import flown

Array = NDArray[np.float64]
RADIUS, RATE, SECONDS = 12.0, 0.5, 40.0  # of a circle: 6 m/s, 3 m/s^2


def circle(t: Array) -> tuple[Array, Array, Array, Array]:
    """Position, velocity, acceleration (n, 3) and q_nb (n, 4) of a multirotor in a circle that looks north."""
    s, c, o = np.sin(RATE * t), np.cos(RATE * t), np.zeros_like(t)
    r, v = RADIUS * np.column_stack([c, s, o]), RADIUS * RATE * np.column_stack([-s, c, o])
    a = -(RATE**2) * r
    return r, v, a, quaternions(np.column_stack(hovering_angles((a[:, 0], a[:, 1], a[:, 2]), o, np)))


def recording(*, hz: float = 10.0, late: float = 0.0, is_gps: bool = False, bias: float = 0.0) -> Recording:
    """The circle as a log of that rate; `late`: of the positions, behind their stamps."""
    t, fast = np.arange(0.0, SECONDS, 1.0 / hz), np.arange(0.0, SECONDS, 0.02)
    r, v, _, _ = circle(t - late)
    _, _, a, q = circle(fast)
    force = np.einsum("nij,ni->nj", matrix_from_quaternion(q), a - [0.0, 0.0, GRAVITY]) + np.array(
        [bias, 0.0, 0.0]
    )
    rows = (np.column_stack([t, r, v]), np.column_stack([fast, q]), np.column_stack([fast, force]))
    return Recording("circle", *rows, np.empty((0, 2)), is_gps=is_gps)


def only(of: Recording) -> Trajectory:
    """Its one stretch."""
    (one,) = stretches(of)[0]
    return one


def off(one: Trajectory) -> Array:
    """The greatest errors of position (but for the place of the first), velocity and acceleration."""
    r, v, a, _ = circle(one.begin + DT * np.arange(len(one.q_nb)))
    pairs = ((one.motion.r, r - r[0]), (one.motion.v, v), (one.motion.a, a))
    return np.array([np.linalg.norm(found - true, axis=1).max() for found, true in pairs])


def as_csv(path: Path, of: Recording, *, velocity: bool = True) -> Path:
    """The positions of a recording as a .csv, with the attitudes of their times."""
    _, _, _, q = circle(of.places[:, 0])
    names = (
        (*POSITION_COLUMNS, *VELOCITY_COLUMNS, *ATTITUDE_COLUMNS)
        if velocity
        else (*POSITION_COLUMNS, *ATTITUDE_COLUMNS)
    )
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(np.hstack([of.places if velocity else of.places[:, :4], q]).tolist())
    return path


def test_a_circle_is_what_was_flown_and_its_velocity_is_the_derivative_of_its_position() -> None:
    one = only(recording())
    assert one.seconds == pytest.approx(SECONDS - 4.2, abs=0.3)
    assert np.all(off(one) < [0.1, 0.05, 0.1])
    assert np.gradient(one.motion.r, DT, axis=0)[1:-1] == pytest.approx(one.motion.v[1:-1], abs=1e-9)
    _, _, _, q = circle(one.begin + DT * np.arange(len(one.q_nb)))
    assert one.q_nb == pytest.approx(q, abs=1e-4)


def test_fixes_alone_are_carried_by_the_imu_and_their_lateness_and_its_bias_are_found() -> None:
    found = off(only(recording(hz=5.0, late=0.22, is_gps=True, bias=0.3)))
    assert np.all(found < [0.25, 0.15, 0.15])


def test_positions_without_velocity_do(tmp_path: Path) -> None:
    path = as_csv(tmp_path / "circle.csv", recording(hz=20.0), velocity=False)
    (one,) = read_trajectories(path)
    assert np.all(off(one) < [0.1, 0.1, 0.1])
    assert (one.name, one.leader_class) == ("circle", "multirotor")
    typed = [f"{line},{'1' if k else 'mav_type'}" for k, line in enumerate(path.read_text("utf-8").splitlines())]
    path.write_text("\n".join(typed), encoding="utf-8")
    assert read_recording(path).leader_class == "fixed_wing"


def test_a_gap_and_a_step_of_the_position_part_a_flight() -> None:
    whole = recording()
    t = whole.places[:, 0]
    parted = whole._replace(places=whole.places[(t < 9.0) | (t > 11.0)])
    ((after,), lost) = stretches(parted)
    assert after.begin == pytest.approx(13.0, abs=0.3)
    assert lost["in gaps and at steps of the position"] == pytest.approx(2.0, abs=0.3)
    stepped = whole.places.copy()
    stepped[t > 10.0, 1] += 1.5
    ((after,), _) = stretches(whole._replace(places=stepped))
    assert after.begin == pytest.approx(14.0, abs=0.3)
    assert np.all(off(after) < [0.1, 0.05, 0.1])


def test_at_rest_nothing_flies_and_armed_motors_are_heeded() -> None:
    whole = recording()
    disarmed = whole._replace(arms=np.array([[0.0, 0.0], [15.0, 1.0]]))
    assert only(disarmed).begin == pytest.approx(15.0, abs=0.1)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(whole.attitudes), 1))
    still = whole._replace(
        places=np.column_stack([whole.places[:, 0], np.zeros((len(whole.places), 6))]),
        attitudes=np.column_stack([whole.attitudes[:, 0], q]),
        forces=np.empty((0, 4)),
    )
    found, lost = stretches(still)
    assert found == []
    assert lost["at rest"] == pytest.approx(SECONDS, abs=0.3)


@pytest.mark.parametrize("has_forces", [True, False])
def test_an_attitude_that_disagrees_with_the_acceleration_is_refused_in_words(
    tmp_path: Path, has_forces: bool
) -> None:
    whole = recording()
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(whole.attitudes), 1))
    level[::2] = quaternions(np.tile([0.0, 0.0, 0.05], (len(level[::2]), 1)))  # so that it moves
    wrong = whole._replace(attitudes=np.column_stack([whole.attitudes[:, 0], level]))
    found, lost = stretches(wrong if has_forces else wrong._replace(forces=np.empty((0, 4))))
    assert found == []
    assert lost["whose attitude and acceleration disagree"] > 10.0
    path = as_csv(tmp_path / "short.csv", recording()._replace(places=whole.places[:150]))
    with pytest.raises(
        LogError, match=r"short\.csv: no 20 s of flight without interruption; left out: 15 s too short"
    ):
        read_trajectories(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", r"lacks the column\(s\) time_s"),
        ("time_s,north_m\n", r"lacks the column\(s\) east_m"),
        (",".join((*POSITION_COLUMNS, *ATTITUDE_COLUMNS)) + "\n", "no position"),
        (",".join((*POSITION_COLUMNS, *ATTITUDE_COLUMNS)) + "\n0,0,0,x,1,0,0,0\n", "line 2: could not convert"),
    ],
)
def test_a_table_that_is_none_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "flight.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LogError, match=rf"flight\.csv.*{says}"):
        read_recording(path)


def test_a_tlog_gives_the_flight_of_its_vehicle_seed_3(tmp_path: Path) -> None:
    write_log(load_scenario("recorded"), 3, 26.0, tmp_path / "own.tlog", None, tmp_path / "own.csv")
    recorded = read_recording(tmp_path / "own.tlog")
    truth = np.genfromtxt(tmp_path / "own.csv", delimiter=",", skip_header=1)[:, :7]
    at = np.column_stack([np.interp(recorded.places[:, 0], truth[:, 0], x) for x in truth[:, 1:].T])
    assert recorded.places[:, 1:4] == pytest.approx(at[:, :3], abs=2.5)  # as far as our own errors go
    assert recorded.places[:, 4:] == pytest.approx(at[:, 3:], abs=0.4)
    assert recorded.leader_class == "multirotor"
    assert len(recorded.forces) > 1000


@pytest.mark.parametrize("geometry", GEOMETRY_NAMES)
def test_a_geometry_keeps_its_distance_and_has_the_leader_in_view_seed_2(geometry: str) -> None:
    leader, scenario = only(recording()), load_scenario("recorded")
    one = recorded_encounter(scenario, 2, leader, geometry, 15.0)
    again = recorded_encounter(scenario, 2, leader, geometry, 15.0)
    assert np.array_equal(one.truth.follower.r, again.truth.follower.r)
    apart = np.linalg.norm(one.truth.r_FL_n, axis=1)
    assert apart.min() >= MIN_DISTANCE
    images = [d for d in one.datagrams() if d.channel == "points"]
    assert len(images) > 0.55 * 15.0 * scenario.camera.rate


def test_a_recorded_follower_sways_and_leans_as_it_flew_seed_4() -> None:
    leader, scenario = only(recording()), load_scenario("recorded")
    one = recorded_encounter(scenario, 4, leader, "behind", 15.0, follower=leader)
    down = matrix_from_quaternion(quaternions(one.truth.euler_F))[:, :, 2]
    tilts = matrix_from_quaternion(leader.q_nb)[:, :, 2]
    count = len(down)
    nearest = min(float(np.abs(tilts[k : k + count] - down).max()) for k in range(len(tilts) - count + 1))
    assert nearest < 1e-6  # its thrust points where it pointed in some part of its flight
    sight = np.arctan2(one.truth.r_FL_n[:, 1], one.truth.r_FL_n[:, 0])
    aside = np.angle(np.exp(1j * (one.truth.euler_F[:, 2] - sight)))
    assert np.degrees(np.median(np.abs(aside))) < 10.0
    assert np.degrees(np.abs(aside)).max() < 35.0


def test_flights_that_are_too_short_and_geometries_that_are_none_are_refused() -> None:
    leader, scenario = only(recording()), load_scenario("recorded")
    with pytest.raises(LogError, match="the flight lasts 36 s, shorter than 60 s"):
        recorded_encounter(scenario, 1, leader, "hover", 60.0)
    with pytest.raises(ValueError, match="unknown geometry 'below'; choose one of behind"):
        recorded_encounter(scenario, 1, leader, "below", 10.0)
    assert set(GEOMETRIES) < set(GEOMETRY_NAMES)


def test_the_command_line_flies_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = as_csv(tmp_path / "circle.csv", recording(hz=20.0)), str(tmp_path / "x.tlog")
    flags = [
        "--leader-from",
        str(path),
        "--geometry",
        "orbit",
        "--duration",
        "4",
        "--truth",
        str(tmp_path / "x.csv"),
    ]
    assert main(["log", "recorded", *flags, "--out", out]) == 0
    said = capsys.readouterr().err
    assert "circle, orbit: 4 s; camera.mount_rpy_deg=[0.0, " in said
    assert len((tmp_path / "x.csv").read_text(encoding="utf-8").splitlines()) == 102
    assert main(["log", "recorded", "--geometry", "orbit", "--out", out]) == 2
    assert "--geometry needs --leader-from" in capsys.readouterr().err
    assert main(["log", "guided", *flags, "--out", out]) == 2
    assert "[follow] excludes --leader-from" in capsys.readouterr().err
    assert main(["log", "recorded", "--leader-from", str(tmp_path / "none.bin"), "--out", out]) == 2
    assert "none.bin: No such file" in capsys.readouterr().err


def test_every_geometry_of_a_recorded_leader_seed_2() -> None:
    leader, scenario = only(recording()), load_scenario("recorded")
    late = only(recording(hz=5.0, late=0.22, is_gps=True, bias=0.3))
    lines = [f"{part} {numbers(value)}" for part, value in zip(late._fields, late, strict=True) if part == "q_nb"]
    lines += [f"{name} {numbers(values)}" for name, values in late.motion._asdict().items()]
    for geometry in GEOMETRY_NAMES:
        follower = leader if geometry == "behind" else None
        found = flown(recorded_encounter(scenario, 2, leader, geometry, 15.0, follower=follower))
        lines += [f"GEOMETRY {geometry}", *(line for line in found if "truth" in line or "mount" in line)]
    assert_golden("recorded.txt", lines)
