"""A synthetic flight as records for the view, and functions to record and read it."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.geometry.camera import make_camera, project
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_euler
from onboard.messages import (
    Estimate,
    Health,
    Lifecycle,
    MeasurementReport,
    OwnPose,
    SinkHealth,
    StreamHealth,
    Truth,
    Verdict,
)

NEEDS_RERUN = "rerun is not installed: pip install wingline[view]"
CAMERA = make_camera(f_px=620.0, width_px=640.0, height_px=480.0, mount_offset=(0.2, 0.0, 0.05))
NAMES = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size", "a_lat", "a_long")
UNITS = ("m", "m", "m", "m/s", "m/s", "m/s", "m", "m/s^2", "m/s^2")
SIZE, SPEED, RADIUS = 2.67, 18.0, 120.0
START_TIME_S = 12.0


def truth_of(t: float) -> Truth:
    """Return the truth of two aircraft on a circle.

    The leader is ahead at a varying range, a little above and to the side.
    """
    rate = SPEED / RADIUS
    bank = math.atan(SPEED * rate / 9.81)

    def place(angle: float, height: float) -> tuple[np.ndarray, np.ndarray]:
        r = np.array([RADIUS * math.sin(angle), RADIUS * (1 - math.cos(angle)), -height])
        return r, SPEED * np.array([math.cos(angle), math.sin(angle), 0.0])

    angle = rate * t
    ahead = (26 + 4 * math.sin(0.35 * t)) / RADIUS
    r_F, v_F = place(angle, 60.0)
    r_L, v_L = place(angle + ahead, 62.0 + 1.5 * math.sin(0.5 * t))
    v_L = v_L * (1 + 4 * 0.35 * math.cos(0.35 * t) / SPEED) - np.array([0, 0, 0.75 * math.cos(0.5 * t)])
    direction = math.atan2((r_L - r_F)[1], (r_L - r_F)[0]) - angle
    return Truth(
        t_ns=round((START_TIME_S + t) * 1e9),
        r_FL_n=tuple(r_L - r_F),
        v_FL_n=tuple(v_L - v_F),
        size=SIZE,
        a_lat=SPEED * rate,
        a_long=-0.49 * math.sin(0.35 * t),
        r_OF_n=tuple(r_F),
        v_F_n=tuple(v_F),
        a_F_n=(0.0, 0.0, 0.0),
        q_nF=tuple(quaternion_from_euler(0.15 * bank, 0.06, angle + direction + 0.05 * math.sin(0.8 * t))),
        r_OL_n=tuple(r_L),
        q_nL=tuple(quaternion_from_euler(bank, 0.04, angle + ahead)),
    )


def points_of(truth: Truth, size: float, r: np.ndarray) -> np.ndarray:
    """Image points (3, 2) of centre, left and right tip of a leader at r (3,) NED."""
    tips = np.array([[0, 0, 0], [0, -size / 2, 0], [0, size / 2, 0]]) @ matrix_from_quaternion(truth.q_nL).T
    r_c = (r + tips) @ matrix_from_quaternion(truth.q_nF) - CAMERA.r_FC_b
    return project(r_c @ CAMERA.R_bc)


def report_of(truth: Truth, verdict: Verdict, r: np.ndarray, rng: np.random.Generator) -> MeasurementReport:
    """Return the report of an image of the true leader, predicted at r (3,) NED; a gated one is far off."""
    measured = points_of(truth, SIZE, np.array(truth.r_FL_n)) + rng.normal(0, CAMERA.sigma, (3, 2))
    gated = verdict is Verdict.GATED
    if gated:
        measured = measured + np.array([0.16, -0.1])
    ratio = rng.normal(0, 1, 3) + (8 if gated else 0)
    return MeasurementReport(
        source="front",
        t_ns=truth.t_ns,
        t_recv_ns=truth.t_ns + 40_000_000,
        verdict=verdict,
        components=("azimuth", "elevation", "subtended"),
        units=("rad", "rad", "rad"),
        innovation=tuple(0.002 * ratio),
        innovation_sigma=(0.002, 0.002, 0.002),
        nis=float(ratio @ ratio),
        gate=11.34,
        points=tuple(map(tuple, measured.tolist())),
        predicted_points=tuple(map(tuple, points_of(truth, SIZE, r).tolist())),
    )


def estimate_of(k: int, truth: Truth, fade: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance like the real filter's, much worse along the line of sight.

    `fade` is the time in s without an image.
    """
    r = np.array(truth.r_FL_n)
    u = r / np.linalg.norm(r)
    settle = math.exp(-k / 150)
    along, across = 0.45 + 1.3 * settle + 1.2 * fade, 0.05 + 0.25 * fade
    P = np.diag([0.1, 0.1, 0.1, *[(0.25 + 0.4 * settle + 0.3 * fade) ** 2] * 3, 0.0, 0.35**2, 0.3**2])
    P[:3, :3] = across**2 * np.eye(3) + (along**2 - across**2) * np.outer(u, u)
    P[6, 6] = (0.04 + 0.35 * settle) ** 2
    wander = math.sin(0.013 * k) * 0.9 * settle + 0.5 * math.sin(0.031 * k)
    truth_vector = np.array([*truth.r_FL_n, *truth.v_FL_n, truth.size, truth.a_lat, truth.a_long])
    mean = truth_vector + 0.25 * np.sqrt(np.diag(P)) * rng.normal(0, 1, 9)
    mean[:3] = r + along * wander * u + across * rng.normal(0, 0.6, 3)
    mean[6] = SIZE + wander * P[6, 6] ** 0.5
    mean[7:] += np.array([0.4 * math.sin(0.02 * k), 0.3 * math.cos(0.017 * k)])
    return mean, P


def verdict_at(t: float) -> Verdict | None:
    """None where there is no image: before the first, and in two gaps."""
    if t < 1.0:
        return None
    if t < 1.6:
        return Verdict.INITIALISING
    if 14.0 < t < 16.2 or 22.0 < t < 22.5:
        return None
    return Verdict.GATED if 19.0 < t < 19.35 or 26.4 < t < 26.6 else Verdict.FUSED


def health_of(t_ns: int) -> Health:
    """Health as a session tells it that has a camera and an autopilot."""
    return Health(
        t_ns=t_ns,
        t_recv_ns=t_ns,
        uptime=t_ns * 1e-9,
        autopilot="PX4",
        autopilot_reboots=0,
        clock_source="timesync",
        clock_offset_ns=1_000,
        round_trip=0.0031,
        streams={
            "ATTITUDE_QUATERNION": StreamHealth(count=500, rate=49.8, age=0.01),
            "camera/front": StreamHealth(count=200, rate=24.9, age=0.03),
        },
        states={"leader": Lifecycle.TRACKING},
        verdicts={"fused": 190, "gated": 9},
        rejected={"crc": 1},
        sinks={"zenoh": SinkHealth(sent=900)},
    )


def flight(seconds: float = 30.0) -> Iterator[Estimate | OwnPose | Truth | Health]:
    """Yield own pose at 50 Hz, truth, images and estimates at 25 Hz, health at 1 Hz."""
    rng = np.random.default_rng(7)
    last_image = -1.0
    for tick in range(round(seconds * 50)):
        t = tick / 50
        truth = truth_of(t)
        yield OwnPose(t_ns=truth.t_ns, r_OF_n=truth.r_OF_n, v_F_n=truth.v_F_n, a_F_n=(0, 0, 0), q_nb=truth.q_nF)
        if tick % 50 == 0:
            yield health_of(truth.t_ns)
        if tick % 2:
            continue
        yield truth
        verdict = verdict_at(t)
        last_image = t if verdict is Verdict.FUSED else last_image
        age = t - last_image if last_image >= 0 else None
        mean, P = estimate_of(tick // 2, truth, (age or 0.0), rng)
        tracked = t >= 1.6
        state = Lifecycle.SEARCHING if t < 1.0 else Lifecycle.INITIALISING
        if tracked:
            state = Lifecycle.TRACKING if age is not None and age < 0.3 else Lifecycle.COASTING
            state = Lifecycle.LOST if age is not None and age > 1.5 else state
        yield Estimate(
            name="leader",
            target="leader",
            sequence=tick // 2,
            t_ns=truth.t_ns,
            state=state,
            valid=state in (Lifecycle.TRACKING, Lifecycle.COASTING),
            reason="",
            frame="NED, leader relative to follower",
            components=NAMES,
            units=UNITS,
            mean=tuple(mean.tolist()) if tracked else None,
            covariance=tuple(map(tuple, P.tolist())) if tracked else None,
            age=age,
            reset_count=0,
            measurement=None if verdict is None else report_of(truth, verdict, mean[:3], rng),
        )


def late_estimate() -> Estimate:
    """Return an estimate of a settled track."""
    return [r for r in flight(4.0) if isinstance(r, Estimate)][-1]


class Kept:
    """The drawn data: the newest value of each entity."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}

    def add(self, _kind: Any, entity: str, _t_ns: int, value: Any) -> None:
        self.values[entity] = np.asarray(value)


class Drawn(Kept):
    """The newest value by entity, as it was given."""

    def add(self, _kind: Any, entity: str, _t_ns: int, value: Any) -> None:
        self.values[entity] = value


def record_flight(path: Path, records: list[Estimate | OwnPose | Truth | Health]) -> Path:
    """The recording made of the records; skips the test where there is no rerun."""
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    with view_module.View(camera=CAMERA, rrd=path) as view:
        for record in records:
            view.show(record)
    return path


def rows_of(path: Path) -> dict[str, int]:
    """Rows with a time, by entity."""
    chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)
    rows: dict[str, int] = {}
    for one in chunk.RrdReader(path).stream().to_chunks():
        if not one.is_static:
            rows[one.entity_path] = rows.get(one.entity_path, 0) + one.num_rows
    return rows
