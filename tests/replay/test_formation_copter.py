"""Recorded flights: an ArduPilot follower behind a leader, one that looks away, and one with no camera at all.

35 s of the first, a left circle and the reversal, are in `data` beside this file; all else is not part of the
repository, and slow.
"""

import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from onboard.commands.replay import replay_log
from onboard.messages import Estimate, Health, Lifecycle, Verdict
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog
from tests.support.honesty import assert_neither_too_sure_nor_too_unsure, nees
from tests.support.streams import Run, assert_sane, make_config

DATA = Path(__file__).parents[3] / "shared" / "data"
EXCERPT = Path(__file__).parent / "data"
WHOLE = pytest.param("whole", marks=pytest.mark.slow)
S = 1_000_000_000
CAMERA = "camera.mount_rpy_deg=[0,15,0]"
WARM_UP = 15.0  # s of boot-clock time after the first image
VALIDITY = 2.0


def recording(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the recorded flight {name} is not here: put the data folder beside the repository")
    return path


def replay(log: bytes) -> tuple[Run, Health]:
    """The pipeline over a whole log."""
    pipeline = Pipeline(make_config(CAMERA))
    outputs, last = [], 0
    for datagram, _ in read_tlog(log):
        if datagram is not None:
            outputs.extend(pipeline.feed(datagram))
            last = datagram.t_recv_ns
    run = Run(pipeline, outputs)
    assert_sane(run.estimates)
    return run, pipeline.health(last)


class Copter(NamedTuple):
    """The formation's flight, or 35 s of it; at least so many images are judged. `truth` is the relative position
    (3,) at a boot time, s. The RMS errors of position (m) and range (relative) are at most a third above what is
    measured."""

    run: Run
    health: Health
    images: int
    truth: Callable[[float], np.ndarray]
    position_error: float
    range_error: float


@pytest.fixture(scope="module", params=["excerpt", WHOLE])
def copter(request: pytest.FixtureRequest) -> Copter:
    if request.param == "excerpt":
        log = gzip.decompress((EXCERPT / "copter.tlog.gz").read_bytes())
        return Copter(*replay(log), 450, truth_of(EXCERPT / "copter_truth.csv.gz"), 0.7, 0.02)
    log = recording("formation-copter/follower.tlog").read_bytes()
    truth = truth_of(recording("formation-copter/follower_truth.csv.gz"))
    return Copter(*replay(log), 4500, truth, 1.9, 0.058)


def truth_of(path: Path) -> Callable[[float], np.ndarray]:
    """Relative position (3,) at a boot time, s."""
    with gzip.open(path, "rt") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    times = np.array([float(r["time_boot_s"]) for r in rows])
    r = np.array([[float(row[k]) for k in list(row) if k.startswith("r_")][:3] for row in rows])
    return lambda t: np.array([np.interp(t, times, r[:, k]) for k in range(3)])


def judged(run: Run) -> list[Estimate]:
    """Valid estimates at images, once warmed up."""
    start = min(r.t_ns for r in run.reports) + WARM_UP * S
    return [e for e in run.estimates if e.valid and e.measurement is not None and e.t_ns >= start]


def test_position_and_range_are_right_while_valid(copter: Copter) -> None:
    estimates = judged(copter.run)
    estimated = np.array([e.mean[:3] for e in estimates if e.mean])
    true = np.array([copter.truth(e.t_ns / S) for e in estimates])
    error = np.linalg.norm(estimated - true, axis=1)
    true_range = np.linalg.norm(true, axis=1)
    relative = (np.linalg.norm(estimated, axis=1) - true_range) / true_range
    assert len(estimates) > copter.images
    assert np.sqrt(np.mean(error**2)) <= copter.position_error
    assert np.sqrt(np.mean(relative**2)) <= copter.range_error


def test_the_ellipsoid_is_neither_too_small_nor_too_large(copter: Copter) -> None:
    """The NEES of three is 0.54 in the excerpt and 0.59 in the whole flight: the leader's nose is left open."""
    found = [
        nees(np.array(e.mean[:3]) - copter.truth(e.t_ns / S), np.array(e.covariance)[:3, :3])
        for e in judged(copter.run)
        if e.mean
    ]
    assert_neither_too_sure_nor_too_unsure(float(np.mean(found)), 3)


def test_it_is_valid_nearly_always_while_the_leader_is_in_view(copter: Copter) -> None:
    run = copter.run
    start = min(r.t_ns for r in run.reports) + WARM_UP * S
    in_view = [e for e in run.estimates if e.measurement is not None and e.t_ns >= start]
    assert sum(e.valid for e in in_view) / len(in_view) > 0.97
    assert run.estimates[-1].reset_count <= 1


def test_every_image_has_a_verdict(copter: Copter) -> None:
    run, health = copter.run, copter.health
    verdicts = run.verdicts()
    total = sum(verdicts.values())
    # the camera's clock is half a second ahead: the last images wait in vain for our own motion
    missing = health.streams["Exposure"].count - total - len(run.pipeline._waiting)
    assert 0 <= missing <= 1  # one that comes before anything of our own motion, where a recording is cut
    assert len(run.pipeline._waiting) < 20
    assert verdicts[Verdict.FUSED] > 0.93 * total
    assert 0.003 * total < verdicts[Verdict.GATED] < 0.04 * total  # one in a hundred is a wrong blob
    assert set(verdicts) <= {
        Verdict.FUSED,
        Verdict.FUSED_LATE,
        Verdict.GATED,
        Verdict.INITIALISING,
        Verdict.NO_POSE,
        Verdict.OUT_OF_VIEW,
    }


def test_the_clocks_of_a_real_autopilot_are_followed(copter: Copter) -> None:
    health = copter.health
    assert health.autopilot == "ArduPilot, system 1"
    assert health.autopilot_reboots == 0
    assert health.clock_source == "timesync"
    assert "odd_stamp" not in health.rejected
    assert "host_clock_steps" not in health.rejected


@pytest.mark.slow
def test_out_of_view_it_is_never_valid_for_longer_than_the_timeout() -> None:
    run, health = replay(recording("target-out-of-view/follower.tlog").read_bytes())
    fused = np.array(
        sorted(
            r.t_ns for r in run.reports if r.verdict in (Verdict.FUSED, Verdict.FUSED_LATE, Verdict.INITIALISING)
        )
    )
    valid = [e for e in run.estimates if e.valid]
    assert valid
    for e in valid:
        i = int(np.searchsorted(fused, e.t_ns, side="right")) - 1
        assert i >= 0
        assert (e.t_ns - fused[i]) / S <= VALIDITY
    states = {e.state for e in run.estimates}
    assert {Lifecycle.SEARCHING, Lifecycle.TRACKING, Lifecycle.COASTING, Lifecycle.LOST} <= states
    assert sum(e.valid for e in run.estimates) < 0.35 * len(run.estimates)
    assert health.autopilot_reboots == 0


@pytest.mark.slow
def test_a_flight_without_a_camera_gives_no_estimate_of_a_leader() -> None:
    run, health = replay(recording("logs/dronekit_flight.tlog").read_bytes())
    assert not any(e.valid or e.mean is not None for e in run.estimates)
    assert {e.state for e in run.estimates} == {Lifecycle.SEARCHING}
    assert health.streams["Attitude"].count > 1000
    assert health.rejected["bad_frame"] > 1000  # one a second
    assert health.autopilot_reboots == 1  # the log begins before it was switched on again, boot clock at 19 s


def test_a_truth_that_is_longer_than_its_log_counts_until_the_logs_end(tmp_path: Path) -> None:
    """The first 60 % of the excerpt, beside the truth of all of it."""
    log = gzip.decompress((EXCERPT / "copter.tlog.gz").read_bytes())
    (tmp_path / "cut.tlog").write_bytes(log[: len(log) * 6 // 10])
    truth, numbers = EXCERPT / "copter_truth.csv.gz", tmp_path / "score.json"
    config = make_config(CAMERA)
    replay_log(tmp_path / "cut.tlog", config, truth=truth, json_file=numbers, rrd=None)
    score = json.loads(numbers.read_bytes())
    assert score["valid_percent"] > 95.0
    assert not score["diverged"]
