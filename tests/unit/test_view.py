"""The live view: what goes into a recording, and what must not stop it."""

import math
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
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
START_S = 12.0


def truth_of(t: float) -> Truth:
    """Both on a circle; the leader ahead, breathing in range, a little above and to the side."""
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
    look = math.atan2((r_L - r_F)[1], (r_L - r_F)[0]) - angle
    return Truth(
        t_ns=round((START_S + t) * 1e9),
        r_FL_n=tuple(r_L - r_F),
        v_FL_n=tuple(v_L - v_F),
        size=SIZE,
        a_lat=SPEED * rate,
        a_long=-0.49 * math.sin(0.35 * t),
        r_OF_n=tuple(r_F),
        v_F_n=tuple(v_F),
        a_F_n=(0.0, 0.0, 0.0),
        q_nF=tuple(quaternion_from_euler(0.15 * bank, 0.06, angle + look + 0.05 * math.sin(0.8 * t))),
        r_OL_n=tuple(r_L),
        q_nL=tuple(quaternion_from_euler(bank, 0.04, angle + ahead)),
    )


def points_of(truth: Truth, size: float, r: np.ndarray) -> np.ndarray:
    """Image points (3, 2) of centre, left and right tip of a leader at r (3,) NED."""
    tips = np.array([[0, 0, 0], [0, -size / 2, 0], [0, size / 2, 0]]) @ matrix_from_quaternion(truth.q_nL).T
    r_c = (r + tips) @ matrix_from_quaternion(truth.q_nF) - CAMERA.r_FC_b
    return project(r_c @ CAMERA.R_bc)


def report_of(truth: Truth, verdict: Verdict, r: np.ndarray, rng: np.random.Generator) -> MeasurementReport:
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
    """Mean and covariance like the real filter's: far worse along the line of sight; `fade` in s without image."""
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
    if t < 1.0:
        return None
    if t < 1.6:
        return Verdict.INITIALISING
    if 14.0 < t < 16.2 or 22.0 < t < 22.5:
        return None
    return Verdict.GATED if 19.0 < t < 19.35 or 26.4 < t < 26.6 else Verdict.FUSED


def health_of(t_ns: int) -> Health:
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
    """A synthetic flight: own pose at 50 Hz, truth, images and estimates at 25 Hz, health at 1 Hz."""
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


# ------------------------------------------------------------------------------------------------ tests


def late_estimate() -> Estimate:
    return [r for r in flight(4.0) if isinstance(r, Estimate)][-1]


def record_flight(path: Path, records: list[Estimate | OwnPose | Truth | Health]) -> Path:
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


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("view") / "flight.rrd", list(flight(8.0)))


def test_a_closed_recording_is_whole(recording: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    command = [str(viewer.viewer_path()), "rrd", "verify", str(recording)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_everything_promised_is_in_the_recording(recording: Path) -> None:
    rows = rows_of(recording)
    for entity, least in {
        "/scene/leader": 150,
        "/scene/leader_truth": 190,
        "/scene/uncertainty/ellipsoid": 150,
        "/scene/follower": 190,
        "/scene/ground/trail_estimate": 25,
        "/scene/ground/trail_own": 35,
        "/scene/follower/camera/measured": 150,
        "/scene/follower/camera/magnifier/predicted": 150,
        "/plots/range/estimate": 190,
        "/plots/range/truth": 190,
        "/plots/range_error": 150,
        "/plots/error/down": 150,
        "/plots/size/estimate": 190,
        "/plots/acceleration/lateral/truth": 190,
        "/plots/innovation/value": 150,
        "/plots/nis/value": 150,
        "/plots/rate/ATTITUDE_QUATERNION": 8,
        "/status": 30,
        "/health": 8,
        "/track": 3,
        "/images": 3,
    }.items():
        assert rows.get(entity, 0) >= least, entity
    # space is drawn at no more than 25 Hz, whatever the rate of the records
    assert rows["/scene/follower"] <= 8 * 26 + 2


def test_errors_are_those_of_the_moment_of_the_estimate(recording: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)
    drawn = {}
    for one in chunk.RrdReader(recording).stream().to_chunks():
        if one.entity_path == "/plots/error/down" and not one.is_static:
            batch = one.to_record_batch().to_pydict()
            rows = zip(batch["boot_time"], batch["Scalars:scalars"], strict=True)
            drawn |= {round(t.total_seconds() * 1e9): values for t, values in rows}
    estimates = [r for r in flight(8.0) if isinstance(r, Estimate) and r.mean and r.t_ns in drawn]
    assert len(estimates) > 150
    for estimate in estimates:
        assert estimate.mean is not None
        assert estimate.covariance is not None
        truth = truth_of(estimate.t_ns * 1e-9 - START_S)
        edge = 3 * math.sqrt(estimate.covariance[2][2])
        expected = [estimate.mean[2] - truth.r_FL_n[2], edge, -edge]
        np.testing.assert_allclose(drawn[estimate.t_ns], expected, atol=2e-5)


def test_before_a_track_nothing_is_drawn_of_the_leader(tmp_path: Path) -> None:
    records = [r for r in flight(0.9) if not isinstance(r, Truth)]
    rows = rows_of(record_flight(tmp_path / "early.rrd", records))
    assert "/scene/uncertainty/ellipsoid" not in rows
    assert "/scene/leader" in rows  # a scale of nothing: it must not sit on us


NAN = math.nan


@pytest.mark.parametrize(
    "changes",
    [
        {"mean": (NAN,) * 9},
        {"mean": (*(1.0,) * 8, NAN)},
        {"mean": (30.0, 0.0, 0.0, NAN, NAN, NAN, NAN, NAN, NAN)},
        {"covariance": ((NAN,) * 9,) * 9},
        {"covariance": ((0.0,) * 9,) * 9},
        {"covariance": tuple(tuple(-1.0 if i == j else 0.0 for i in range(9)) for j in range(9))},
        {"mean": (0.0,) * 9},
        {"mean": None},
        {"covariance": None},
        {"components": (), "units": (), "mean": (), "covariance": ()},
        {"measurement": None},
        {"age": None},
        {"reason": "non-Latin: 見 💡"},
    ],
)
def test_no_estimate_stops_the_view(tmp_path: Path, changes: dict[str, object]) -> None:
    odd = msgspec.structs.replace(late_estimate(), **changes)
    later = msgspec.structs.replace(late_estimate(), t_ns=odd.t_ns + 500_000_000)
    rows = rows_of(record_flight(tmp_path / "odd.rrd", [odd, later]))
    assert rows["/status"] == 2


@pytest.mark.parametrize("verdict", list(Verdict))
def test_no_measurement_stops_the_view(tmp_path: Path, verdict: Verdict) -> None:
    estimate = late_estimate()
    assert estimate.measurement is not None
    bare = MeasurementReport(source="front", t_ns=estimate.t_ns, t_recv_ns=estimate.t_ns, verdict=verdict)
    odd = msgspec.structs.replace(
        estimate.measurement,
        t_ns=estimate.t_ns + 10**8,
        points=((NAN, 0.0), (0.1, NAN), (0.2, 0.1)),
        predicted_points=((NAN, NAN),) * 3,
        innovation=(NAN, 1.0, 2.0),
        innovation_sigma=(0.0, 1.0, NAN),
        nis=NAN,
    )
    records = [msgspec.structs.replace(estimate, t_ns=r.t_ns, measurement=r) for r in (bare, odd)]
    assert rows_of(record_flight(tmp_path / "odd.rrd", records))["/images"] >= 1


def test_poses_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    records = list(flight(0.1))
    own = next(r for r in records if isinstance(r, OwnPose))
    truth = next(r for r in records if isinstance(r, Truth))
    odd_own = msgspec.structs.replace(own, r_OF_n=(NAN, 0.0, 0.0))
    no_attitude = msgspec.structs.replace(own, q_nb=(0.0, 0.0, 0.0, 0.0))
    odd_truth = msgspec.structs.replace(truth, r_FL_n=(NAN, 0.0, 0.0), q_nL=(0.0, 0.0, 0.0, 0.0))
    rows = rows_of(record_flight(tmp_path / "odd.rrd", [odd_own, no_attitude, odd_truth]))
    assert rows["/scene/follower"] == 1  # the row that hides it


def test_another_boot_begins_anew(tmp_path: Path) -> None:
    first = list(flight(2.0))
    again = [msgspec.structs.replace(r, t_ns=r.t_ns - 11_000_000_000) for r in flight(2.0)]
    rows = rows_of(record_flight(tmp_path / "boots.rrd", first + again))
    assert rows["/scene/follower"] >= 2 * 49


def test_close_twice_and_then_no_more(tmp_path: Path) -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    view = view_module.View(camera=CAMERA, rrd=tmp_path / "empty.rrd")
    view.close()
    view.close()
    with pytest.raises(ValueError, match="closed"):
        view.show(late_estimate())


def test_a_view_must_go_somewhere() -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    with pytest.raises(ValueError, match="rrd"):
        view_module.View(camera=CAMERA)


def test_the_server_listens_on_loopback_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    psutil = pytest.importorskip("psutil")
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with view_module.View(camera=CAMERA, rrd=tmp_path / "both.rrd", grpc_port=0, spawn=True) as view:
        assert view.viewer is None  # no display, no window
        port = int(view.url.split(":")[-1].split("/")[0])
        deadline = time.monotonic() + 10
        addresses: set[str] = set()
        while not addresses and time.monotonic() < deadline:
            listening = [c for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN]
            addresses = {c.laddr.ip for c in listening if c.laddr.port == port}
            time.sleep(0.05)
        for record in flight(0.5):
            view.show(record)
    assert addresses == {"127.0.0.1"}
    assert rows_of(tmp_path / "both.rrd")["/scene/leader_truth"] >= 12


def test_a_port_that_is_taken_is_an_error() -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(OSError, match="cannot serve the view"):
            view_module.View(camera=CAMERA, grpc_port=other.getsockname()[1])


def test_without_rerun_the_package_imports_and_the_view_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['rerun'] = None\n"
        "import onboard.view\n"
        "try:\n    import onboard.view.view\n"
        "except ImportError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert "pip install wingline[view]" in done.stdout, done.stderr


def test_a_picture_of_what_is_not_there(tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    with pytest.raises(FileNotFoundError, match="no such recording"):
        viewer.screenshot(tmp_path / "none.rrd", tmp_path / "none.png")


def test_a_picture_without_a_screen(recording: Path, tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    psutil = pytest.importorskip("psutil")
    png = tmp_path / "view.png"
    try:
        viewer.screenshot(recording, png, at=START_S + 6.0, size=(1000, 700), timeout=60.0)
    except viewer.ViewerError as error:
        if "graphics adapter" in str(error):
            pytest.skip("no Vulkan driver here: Debian's mesa-vulkan-drivers has one in software")
        raise
    assert png.read_bytes().startswith(b"\x89PNG")
    assert png.stat().st_size > 30_000  # an empty window has a tenth of it
    # other tests' worker pools may have left Python's own helper process to this one
    assert not [c for c in psutil.Process().children(recursive=True) if "rerun" in c.name()]
