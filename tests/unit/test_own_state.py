"""The estimator of our own state: what it says, when it says nothing, and what it names as wrong."""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.config import ConfigError, parse_config
from onboard.estimators._own_filters import SensorFilter
from onboard.estimators._own_inputs import Manoeuvres, Samples
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_vector, quaternion_product
from onboard.messages import (
    Attitude,
    Barometer,
    FaultKind,
    GpsFix,
    Heartbeat,
    Imu,
    Message,
    NavState,
    Truth,
    Verdict,
)
from onboard.models import own_motion
from onboard.pipeline import Pipeline
from simlink.scenario import load_scenario
from simlink.simulation import datagrams
from tests.programs import run

MS = 1_000_000
ORIGIN = (47.4, 8.5, 500.0)
G = 9.80665
FILTERS = ("cubature", "unscented", "svsf", "csvsf-printed", "csvsf", "csvsf-robust", "csvsf-adaptive")


def pipeline(**section: Any) -> Pipeline:
    delay = {"gps_s": section.pop("gps_s", 0.0)}
    return Pipeline(parse_config({"estimator": {"own_state": section}, "delay": delay}))


def header(t_ms: int, late_ms: float = 1.0) -> dict[str, Any]:
    return {"t_ns": t_ms * MS, "t_recv_ns": round((t_ms + late_ms) * MS)}


def attitude(t_ms: int, q: Sequence[float] = (1, 0, 0, 0), omega: Sequence[float] = (0, 0, 0)) -> Attitude:
    return Attitude(**header(t_ms), q_nb=tuple(map(float, q)), omega_b=tuple(map(float, omega)))  # type: ignore[arg-type]


def imu(t_ms: int, f_b: Sequence[float] = (0, 0, -G), omega: Sequence[float] = (0, 0, 0)) -> Imu:
    return Imu(**header(t_ms), f_b=tuple(map(float, f_b)), omega_b=tuple(map(float, omega)))  # type: ignore[arg-type]


def fix(t_ms: int, r: Sequence[float] = (0, 0, 0), v: Sequence[float] = (0, 0), fix_type: int = 3) -> GpsFix:
    lat, lon, alt = geodetic_from_ned(np.array(r, float), ORIGIN)
    return GpsFix(
        **header(t_ms),
        fix_type=fix_type,
        satellites=12,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        ground_speed=math.hypot(*v[:2]),
        course_rad=math.atan2(v[1], v[0]),
        h_acc=0.5,
        v_acc=1.0,
    )


def heartbeat() -> Heartbeat:
    return Heartbeat(t_ns=0, t_recv_ns=0, vehicle_type=2, autopilot=12, armed=True, status=4)


def told(p: Pipeline, messages: Sequence[Message]) -> list[NavState]:
    return [o for o in p.advance(messages) if isinstance(o, NavState)]


def hovering(start_ms: int, end_ms: int) -> Iterator[Message]:
    for t in range(start_ms, end_ms, 10):
        yield imu(t)
        yield attitude(t)
        if t % 100 == 0:
            yield fix(t)


def flown(name: str, seed: int, seconds: float, **section: Any) -> tuple[Pipeline, list[NavState], list[Truth]]:
    p = pipeline(gps_s=0.1, **{"airframe": "csvsf", **section})
    states, truths = [], []
    for item in datagrams(load_scenario(name), seed, seconds, camera="none"):
        if isinstance(item, Truth):
            truths.append(item)
        else:
            states += [o for o in p.feed(item) if isinstance(o, NavState)]
    return p, states, truths


def velocity_rmse(states: list[NavState], truths: list[Truth], after: float) -> float:
    at = {s.t_ns: s for s in states if s.mean is not None}
    errors = [
        np.subtract(t.v_F_n, at[t.t_ns].mean[3:6])  # type: ignore[index]
        for t in truths
        if t.t_ns in at and t.t_ns - truths[0].t_ns > after * 1e9
    ]
    assert len(errors) > 100
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))


def vertical_rmse(states: list[NavState], truths: list[Truth]) -> float:
    """Of the velocity from 8 s on, m/s."""
    at = {s.t_ns: s for s in states if s.mean is not None}
    late = [t for t in truths if t.t_ns in at and t.t_ns - truths[0].t_ns > 8e9]
    return float(np.sqrt(np.mean([(t.v_F_n[2] - at[t.t_ns].mean[5]) ** 2 for t in late])))  # type: ignore[index]


# ------------------------------------------------------------------------------------- what it says


def test_hovering_it_stands_still_and_says_so() -> None:
    p = pipeline()
    states = told(p, [heartbeat(), *hovering(1000, 9000)])
    last = states[-1]
    assert last.valid
    assert last.state == "tracking"
    assert last.components[:6] == ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down")
    assert_allclose(last.mean, np.zeros(12), atol=1e-2)
    assert last.q_nb == pytest.approx((1, 0, 0, 0), abs=1e-6)
    assert last.origin == pytest.approx(ORIGIN)
    assert (last.quality, last.reset_count, last.faults) == (100, 0, ())
    assert last.switch_fraction == 0.0
    assert last.layer is not None
    assert last.measurement is not None
    assert len(last.layer) == len(last.measurement.components)
    assert last.nis_ratio is not None
    assert last.nis_ratio < 0.1  # the messages here have no noise
    eigenvalues = np.linalg.eigvalsh(np.array(last.covariance))
    assert eigenvalues.min() > 0


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 0, 0), (0, 0, 1), (0.6, 0.8, 0.0)])
@pytest.mark.parametrize("name", ["cubature", "csvsf-adaptive", "csvsf-printed"])
def test_through_pitch_90_degrees_and_the_wrap_of_yaw_there_is_no_jump(name: str, axis: tuple[float, ...]) -> None:
    """Three full turns at 2.5 rad/s about each axis; the specific force is that of standing still."""
    p, omega = pipeline(filter=name), 2.5 * np.array(axis)
    messages: list[Message] = [heartbeat()]
    truth = {}
    for t in range(1000, 9500, 10):
        q = quaternion_from_vector(omega * (t - 1000) * 1e-3)
        truth[t] = q
        down_b = quaternion_product(quaternion_product([q[0], *-q[1:]], [0, 0, 0, -G]), q)[1:]
        messages += [imu(t, down_b, omega), attitude(t, q, omega)]
        messages += [fix(t)] if t % 100 == 0 else []
    states = [s for s in told(p, messages) if s.mean is not None]
    assert len(states) > 300
    assert np.isfinite([s.mean for s in states]).all()
    errors = [1 - abs(float(np.dot(truth[s.t_ns // MS], s.q_nb))) for s in states]  # type: ignore[arg-type]
    assert max(errors) < 1e-4  # 1 - cos(half the angle): 0.03 rad
    velocity = np.array([s.mean[3:6] for s in states])  # type: ignore[index]
    assert np.abs(velocity).max() < 0.2
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.05
    assert states[-1].reset_count == 0


def test_a_late_fix_gives_the_same_state_as_one_in_order_seed_1() -> None:
    rng = np.random.default_rng(1)
    prompt: list[Message] = []
    late: list[tuple[int, Message]] = []
    for t in range(1000, 6000, 10):
        q = quaternion_from_vector(0.01 * rng.normal(size=3))
        for m in (imu(t, [*0.3 * rng.normal(size=2), -G]), attitude(t, q, 0.01 * rng.normal(size=3))):
            prompt.append(m)
            late.append((t, m))
        if t % 100 == 50 and t < 5800:
            m = fix(t, rng.normal(size=3), 0.1 * rng.normal(size=2))
            prompt.append(m)
            late.append((t + 143, m))
    in_order = told(pipeline(), [heartbeat(), *prompt])[-1]
    delayed = told(pipeline(), [heartbeat(), *[m for _, m in sorted(late, key=lambda x: x[0])]])[-1]
    assert in_order.t_ns == delayed.t_ns
    assert_allclose(delayed.mean, in_order.mean, atol=1e-9)
    assert_allclose(delayed.covariance, in_order.covariance, atol=1e-9)


def test_the_delay_of_a_fix_is_taken_off_seed_2() -> None:
    """10 m/s north: a fix believed 0.1 s too new would be a metre behind."""
    messages: list[Message] = [heartbeat()]
    for t in range(1000, 9000, 10):
        messages += [imu(t), attitude(t)]
        messages += [fix(t, (10 * (t - 100) * 1e-3, 0, 0), (10, 0))] if t % 100 == 0 else []
    last = told(pipeline(gps_s=0.1), messages)[-1]
    ignored = told(pipeline(), messages)[-1]
    assert last.mean is not None
    assert ignored.mean is not None
    assert last.mean[0] - ignored.mean[0] == pytest.approx(1.0, abs=0.05)


def test_irregular_rates_drop_outs_and_partial_fixes_seed_3() -> None:
    rng = np.random.default_rng(3)
    messages: list[Message] = [heartbeat()]
    for t in range(1000, 15000, 5):
        messages += [imu(t)] if rng.random() < 0.3 else []
        messages += [attitude(t)] if rng.random() < 0.1 else []
        if rng.random() < 0.02:
            whole = fix(t, 0.3 * rng.normal(size=3), 0.1 * rng.normal(size=2))
            partial = replace(whole, ground_speed=None, course_rad=None, h_acc=None, v_acc=None)
            messages.append(whole if rng.random() < 0.5 else replace(partial, alt_msl=whole.alt_msl))
    states = told(pipeline(filter="csvsf-robust"), messages)
    assert states[-1].reset_count == 0
    assert np.isfinite([s.mean for s in states if s.mean]).all()
    assert_allclose(states[-1].mean, np.zeros(12), atol=0.7)


def test_without_an_accelerometer_it_is_less_sure_but_goes_on() -> None:
    without = [m for m in hovering(1000, 9000) if not isinstance(m, Imu)]
    blind = told(pipeline(), [heartbeat(), *without])[-1]
    seeing = told(pipeline(), [heartbeat(), *hovering(1000, 9000)])[-1]
    assert blind.valid
    assert np.array(blind.covariance)[3, 3] > 4 * np.array(seeing.covariance)[3, 3]


def test_with_the_thrust_only_a_sideways_push_is_estimated() -> None:
    """3 m/s^2 east from 4 s to 6 s, felt by the lateral accelerometer or not used: both follow."""
    for force, limit in (("accelerometer", 0.1), ("thrust", 1.0)):
        messages: list[Message] = [heartbeat()]
        v = r = 0.0
        error = []
        p = pipeline(force=force)
        for t in range(1000, 9000, 10):
            a = 3.0 if 4000 <= t < 6000 else 0.0
            messages = [imu(t, (0, a, -G)), attitude(t)]
            r, v = r + 0.01 * v + 5e-5 * a, v + 0.01 * a
            messages += [fix(t, (0, r, 0), (0, v))] if t % 100 == 0 else []
            messages = [heartbeat(), *messages] if t == 1000 else messages
            error += [s.mean[4] - v for s in told(p, messages) if s.mean is not None]
        assert np.abs(error).max() < limit, force


# ------------------------------------------------------------------------------- when it says nothing


def test_it_waits_for_a_fix_coasts_through_an_outage_is_lost_and_comes_back() -> None:
    p = pipeline()
    before = told(p, [heartbeat(), *[attitude(t) for t in range(1000, 3000, 10)]])
    assert {(s.state, s.valid, s.quality) for s in before} == {("searching", False, -1)}
    assert before[-1].mean is None
    told(p, list(hovering(3000, 9000)))
    outage = [m for m in hovering(9000, 17000) if not isinstance(m, GpsFix)]
    states = told(p, outage)
    assert [s.state for s in states if s.t_ns == 9_400 * MS] == ["tracking"]
    assert [s.state for s in states if s.t_ns == 12_000 * MS] == ["coasting"]
    assert (states[-1].state, states[-1].valid) == ("lost", False)
    sigma = [math.sqrt(s.covariance[0][0]) for s in states if s.covariance is not None]
    assert sigma[-1] > 3 * sigma[0]
    assert told(p, list(hovering(17000, 18000)))[-1].state == "tracking"
    gone = told(p, [m for m in hovering(18000, 50000) if not isinstance(m, GpsFix)])[-1]
    assert (gone.mean, gone.reset_count) == (None, 1)


def test_an_autopilot_that_falls_silent_is_noticed() -> None:
    p = pipeline()
    told(p, [heartbeat(), *hovering(1000, 5000)])
    from onboard.messages import LocalPosition  # noqa: PLC0415 - only here

    where = [LocalPosition(**header(t), r_OF_n=(0, 0, 0), v_F_n=(0, 0, 0)) for t in range(5000, 7000, 20)]
    states = told(p, where)
    assert [(s.state, s.valid) for s in states] == [("lost", False)]
    assert "attitude" in states[0].reason


@pytest.mark.parametrize(
    ("message", "verdict"),
    [
        (attitude(5010, (math.nan, 0, 0, 0)), Verdict.NOT_FINITE),
        (attitude(5010, (0, 0, 0, 0)), Verdict.DEGENERATE),
        (attitude(5010, (1, 0, 0, 0), (1e4, 0, 0)), Verdict.DEGENERATE),
        (replace(fix(5000), lat_deg=math.nan), Verdict.NOT_FINITE),
        (replace(fix(5000), lat_deg=-47.0), Verdict.DEGENERATE),
        (fix(3000), Verdict.TOO_OLD),
        (fix(5900), Verdict.TOO_NEW),
        (Barometer(**header(5000), pressure_altitude=math.nan), Verdict.NOT_FINITE),
        (replace(imu(5000), pressure_altitude=1e7), Verdict.DEGENERATE),
    ],
)
def test_what_cannot_be_used_is_told_and_leaves_the_state_as_it_was(message: Message, verdict: Verdict) -> None:
    p = pipeline(publish_rate_hz=100.0)
    before = told(p, [heartbeat(), *hovering(1000, 5000)])[-1]
    (after,) = told(p, [message])
    assert after.measurement is not None
    assert after.measurement.verdict is verdict
    assert after.mean == before.mean
    assert after.valid


def test_a_barometer_steadies_the_vertical_velocity_seed_3() -> None:
    """MAVLink's fixes have no vertical velocity."""
    with_it, without = (flown("quadrotor", 3, 14.0, pressure_rate_hz=r)[1:] for r in (20.0, 0.0))
    assert vertical_rmse(*with_it) < 0.5 * vertical_rmse(*without)
    assert vertical_rmse(*with_it) < 0.05


@pytest.mark.parametrize("name", ["cubature", "csvsf-adaptive"])
def test_a_barometer_that_jumps_moves_nothing_and_is_believed_anew(name: str) -> None:
    p, datum = pipeline(filter=name, gps_position_sigma_m=(0.5, 0.5, 1.0)), 620.0
    messages: list[Message] = [heartbeat()]
    for message in hovering(1000, 31000):
        t_ms = message.t_ns // MS
        if t_ms >= 11000:
            datum = 623.0  # a door opened, or the ground was left
        messages.append(replace(message, pressure_altitude=datum) if isinstance(message, Imu) else message)
    states = [s for s in told(p, messages) if s.valid and s.t_ns > 10000 * MS]
    assert max(abs(s.mean[5]) for s in states) < 0.1  # type: ignore[index]
    assert abs(states[-1].mean[5]) < 0.05  # type: ignore[index]
    assert abs(states[-1].mean[2]) < 0.3  # type: ignore[index]
    assert (states[-1].reset_count, states[-1].faults) == (0, ())


def test_nan_from_the_accelerometer_is_ignored() -> None:
    p = pipeline()
    messages = list(hovering(1000, 5000))
    states = told(p, [heartbeat(), *messages, imu(5000, (math.nan, 0, 0)), attitude(5010), attitude(5020)])
    assert states[-1].valid
    assert np.isfinite(states[-1].mean).all()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("section", "says"),
    [
        ({"filter": "kalmann"}, "there is none named 'kalmann'; there are: augmented"),
        ({"airframe": "custom"}, "custom"),
        ({"airframe": "boat"}, "estimator.own_state.airframe"),
        ({"validity_timeout_s": 0.1}, "coast_after_s <= validity_timeout_s"),
        ({"custom": {"mass_kg": -1.0}}, "estimator.own_state.custom"),
    ],
)
def test_a_configuration_that_does_not_hold_is_one_line(section: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=r"^estimator\.own_state") as caught:
        parse_config({"estimator": {"own_state": section}})
    assert says in str(caught.value)


# -------------------------------------------------------------------------------------- its parts


def test_each_sensor_has_its_own_memory_of_being_outside_seed_4() -> None:
    """Two sensors of two components each: what the one has thrown out does not count for the other."""
    filters = SensorFilter("csvsf-robust")
    state = filters.start(np.zeros(4), np.eye(4) * 1e-2)
    R = 1e-4 * np.eye(2)
    far = np.array([50.0, 0.0])
    for _ in range(2):
        state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    state, _ = filters.update(state, "b", far, lambda rows: rows[:, 2:], R, ())
    assert np.abs(filters.belief(state).mean).max() < 1.0  # the third in a row, but not of one sensor
    state, _ = filters.update(state, "a", far, lambda rows: rows[:, :2], R, ())
    assert filters.belief(state).mean[0] > 49.0


def test_the_mean_of_samples_is_that_of_the_line_through_them() -> None:
    s = Samples(1)
    for k in range(11):
        s.add(k * 10 * MS, np.array([float(k * k)]))
    fine = np.linspace(23 * MS, 77 * MS, 5401)
    assert s.mean(23 * MS, 77 * MS) == pytest.approx(
        np.interp(fine, np.arange(11) * 1e7, np.arange(11) ** 2).mean(), abs=1e-3
    )
    assert s.mean(90 * MS, 110 * MS) == pytest.approx((9.5 * 9.5 + 0.25 - 0.0) * 0.5 + 50.0, abs=0.3)
    assert s.mean(0, 400 * MS) is None
    assert not s.add(5 * MS, np.array([1.0]))


def manoeuvres(acceleration: float, seconds: int, roll: float = 0.0) -> Manoeuvres:
    """Of fixes five times a second that gather speed to the east, at a steady bank."""
    found = Manoeuvres()
    for k in range(5 * seconds + 1):
        t_ns = k * 200 * MS
        found.add_attitude(t_ns, matrix_from_euler(roll, 0.0, 0.0))
        found.add_fix(t_ns, np.array([0.0, acceleration * t_ns * 1e-9]), np.full(2, 0.15))
    return found


def test_how_freely_a_flight_manoeuvres_is_seen_in_its_fixes() -> None:
    nothing = Manoeuvres()
    assert_allclose(nothing.at(0), 4.0)
    steady, gathering = manoeuvres(0.0, 10), manoeuvres(2.0, 10)
    assert_allclose(steady.at(10**10), [0.045, 0.045, 4.0])  # what the fixes' noise hides: 2 x .15^2 over 1 s
    assert_allclose(gathering.at(10**10), [3.955, 3.955, 4.0])  # 2 m/s in a second, less that
    assert_allclose(gathering.at(500 * MS), 4.0)
    banked = manoeuvres(G * math.tan(math.radians(5.0)), 10, math.radians(5.0))
    assert banked.at(10**10)[0] == pytest.approx(0.045, abs=0.01)  # where attitude explains it
    late = gathering.at(10**10)[0]
    for k in range(51, 76):
        gathering.add_attitude(k * 200 * MS, np.eye(3))
        gathering.add_fix(k * 200 * MS, np.array([0.0, 20.0]), np.full(2, 0.15))
    assert gathering.at(15 * 10**9)[0] == pytest.approx(late * math.exp(-5.0 / 5.0), rel=0.01)


def test_the_frame_follows_the_vehicle_and_angles_stay_small() -> None:
    rows = np.zeros((1, own_motion.N))
    rows[0, 8] = 0.6
    R = own_motion.rotations(rows)[0]
    assert_allclose(own_motion.turned(rows, R.T)[0, [6, 8, 10]], 0.0, atol=1e-15)


# ---------------------------------------------------------------------------------- flown by simlink


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_flies_seed_11(name: str) -> None:
    _, states, truths = flown("quadrotor", 11, 12.0, filter=name)
    assert states[-1].reset_count == 0
    assert states[-1].valid
    limit = 0.2 if name not in {"svsf", "csvsf-printed"} else 0.6  # whose gains are not the optimal ones
    assert velocity_rmse(states, truths, 5.0) < limit  # the vertical one, of heights alone, has not settled yet


def test_the_same_bytes_give_the_same_states_seed_12() -> None:
    first, again = flown("quadrotor-gust", 12, 6.0)[1], flown("quadrotor-gust", 12, 6.0)[1]
    assert first == again


@pytest.mark.parametrize(
    ("name", "kind", "part"),
    [
        ("quadrotor-motor", FaultKind.MOTOR, "motor 1"),
        ("quadrotor-heavier", FaultKind.MASS, ""),
        ("quadrotor-weak-inputs", FaultKind.MASS, ""),
        ("quadrotor-gust", FaultKind.GUST, ""),
        ("quadrotor-outliers", FaultKind.OUTLIERS, None),
    ],
)
def test_faults_are_named_with_their_onset_and_the_velocity_holds_seed_13(
    name: str, kind: FaultKind, part: str | None
) -> None:
    p, states, truths = flown(name, 13, 16.0)
    begin = 50_000_000_000
    assert all(not s.faults for s in states if s.t_ns < begin)
    named = [(s.t_ns, f) for s in states for f in s.faults]
    assert {f.kind for _, f in named} == {kind}
    first, fault = named[0]
    assert first - begin < 1_000_000_000
    assert abs(fault.t_onset_ns - begin) < 400_000_000
    assert part is None or fault.part == part
    health = p.health(states[-1].t_ns)
    assert [f.kind for f in health.faults] == ([] if kind is FaultKind.GUST else [kind])  # a gust passes
    assert velocity_rmse(states, truths, 10.0) < 0.1


def test_nothing_is_named_where_nothing_is_wrong_or_only_the_inertia_seed_14() -> None:
    for name in ("quadrotor", "quadrotor-inertia-half", "quadrotor-gps-loss"):
        _, states, _ = flown(name, 14, 25.0)
        assert not [f for s in states for f in s.faults], name


def test_a_replay_writes_our_own_state_seed_1(tmp_path: Path) -> None:
    log, config, rows = tmp_path / "f.tlog", tmp_path / "f.toml", tmp_path / "own.csv"
    assert simlink("log", "quadrotor-heavier", "--duration", "12", "--out", log).returncode == 0
    config.write_text(simlink("config", "quadrotor-heavier").stdout)
    done = run("onboard", "replay", log, "--config", config, "--own", rows)
    assert done.returncode == 0, done.stderr
    assert re.search(r"own state: \d+ \(\d+ valid\), NIS 0\.\d+ of its expectation", done.stdout)
    assert re.search(r"50\.\d+ s: mass, 1\.[23]\d times the known mass", done.stdout)
    table = list(csv.DictReader(rows.read_text().splitlines()))
    assert {"time_boot_s", "r_north_m", "v_down_m_s", "sigma_yaw_rad", "p_rad_s", "q_w"} <= set(table[0])
    assert table[-1]["faults"] == "mass"
    assert float(table[-1]["r_down_m"]) == pytest.approx(-10.0, abs=2.0)
    assert table[0]["r_north_m"] == ""  # nothing known yet


def simlink(*command: str | Path) -> Any:
    return run("simlink", *command)
