"""Recorded flights: an ArduPilot follower behind a leader, one that looks away, and one with no camera at all."""

import csv
import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from onboard.messages import Estimate, Health, Lifecycle, Verdict
from onboard.pipeline import Pipeline
from onboard.wire.tlog import read_tlog
from tests.support.streams import Run, assert_sane, make_config

DATA = Path(__file__).parents[3] / "shared" / "data"
S = 1_000_000_000
CAMERA = "camera.mount_rpy_deg=[0,15,0]"
WARM_UP = 15.0  # s of boot-clock time after the first image
VALIDITY = 2.0


def recording(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the recorded flight {name} is not here: put the data folder beside the repository")
    return path


def replay(name: str) -> tuple[Run, Health]:
    """The pipeline over a whole log."""
    pipeline = Pipeline(make_config(CAMERA))
    outputs, last = [], 0
    for datagram, _ in read_tlog(recording(name).read_bytes()):
        if datagram is not None:
            outputs.extend(pipeline.feed(datagram))
            last = datagram.t_recv_ns
    run = Run(pipeline, outputs)
    assert_sane(run.estimates)
    return run, pipeline.health(last)


@pytest.fixture(scope="module")
def formation() -> tuple[Run, Health]:
    return replay("formation-copter/follower.tlog")


@pytest.fixture(scope="module")
def away() -> tuple[Run, Health]:
    return replay("target-out-of-view/follower.tlog")


@pytest.fixture(scope="module")
def truth() -> Callable[[float], np.ndarray]:
    """Relative position (3,) at a boot time, s."""
    with gzip.open(recording("formation-copter/follower_truth.csv.gz"), "rt") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    times = np.array([float(r["time_boot_s"]) for r in rows])
    r = np.array([[float(row[k]) for k in list(row) if k.startswith("r_")][:3] for row in rows])
    return lambda t: np.array([np.interp(t, times, r[:, k]) for k in range(3)])


def judged(run: Run) -> list[Estimate]:
    """Valid estimates at images, once warmed up."""
    start = min(r.t_ns for r in run.reports) + WARM_UP * S
    return [e for e in run.estimates if e.valid and e.measurement is not None and e.t_ns >= start]


def test_position_and_range_are_right_while_valid(
    formation: tuple[Run, Health], truth: Callable[[float], np.ndarray]
) -> None:
    estimates = judged(formation[0])
    estimated = np.array([e.mean[:3] for e in estimates if e.mean])
    true = np.array([truth(e.t_ns / S) for e in estimates])
    error = np.linalg.norm(estimated - true, axis=1)
    true_range = np.linalg.norm(true, axis=1)
    relative = (np.linalg.norm(estimated, axis=1) - true_range) / true_range
    assert len(estimates) > 4500
    assert np.sqrt(np.mean(error**2)) <= 2.0
    assert np.sqrt(np.mean(relative**2)) <= 0.05


def test_it_is_valid_nearly_always_while_the_leader_is_in_view(formation: tuple[Run, Health]) -> None:
    run, _ = formation
    start = min(r.t_ns for r in run.reports) + WARM_UP * S
    in_view = [e for e in run.estimates if e.measurement is not None and e.t_ns >= start]
    assert sum(e.valid for e in in_view) / len(in_view) > 0.97
    assert run.estimates[-1].reset_count <= 1


def test_every_image_has_a_verdict(formation: tuple[Run, Health]) -> None:
    run, health = formation
    verdicts = run.verdicts()
    total = sum(verdicts.values())
    # the camera's clock is half a second ahead: the last images wait in vain for our own motion
    assert total + len(run.pipeline._waiting) == health.streams["TargetPoints"].count
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


def test_the_clocks_of_a_real_autopilot_are_followed(formation: tuple[Run, Health]) -> None:
    _, health = formation
    assert health.autopilot == "ArduPilot, system 1"
    assert health.autopilot_reboots == 0
    assert health.clock_source == "timesync"
    assert "odd_stamp" not in health.rejected
    assert "host_clock_steps" not in health.rejected


def test_out_of_view_it_is_never_valid_for_longer_than_the_timeout(away: tuple[Run, Health]) -> None:
    run, health = away
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


def test_a_flight_without_a_camera_gives_no_estimate_of_a_leader() -> None:
    run, health = replay("logs/dronekit_flight.tlog")
    assert not any(e.valid or e.mean is not None for e in run.estimates)
    assert {e.state for e in run.estimates} == {Lifecycle.SEARCHING}
    assert health.streams["Attitude"].count > 1000
    assert health.rejected["bad_frame"] > 1000  # one a second
    assert health.autopilot_reboots == 1  # the log begins before it was switched on again, boot clock at 19 s
