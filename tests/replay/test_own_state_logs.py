"""Our own state on real autopilots' streams, beside their own estimates and, where it is known, the truth."""

import gzip
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.config import parse_config
from onboard.messages import Barometer, Datagram, LocalPosition, Message, NavState
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog
from onboard.wire.logs.ulog import read_ulog
from tests.support.programs import DATA

S = 1_000_000_000
EXCERPT = Path(__file__).parent / "data"
shared = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recorded flights are not part of this repository (../shared/data)"
)


def fly(items: Iterator[Datagram | Message], **delay: Any) -> tuple[list[NavState], list[LocalPosition]]:
    """Our states, and the autopilot's own positions as stamped."""
    pipeline = Pipeline(parse_config({"estimator": {"own_state": {}}, "delay": delay}))
    states: list[NavState] = []
    theirs: list[LocalPosition] = []
    for item in items:
        messages = pipeline.decode(item) if isinstance(item, Datagram) else [item]
        theirs += [m for m in messages if isinstance(m, LocalPosition) and m.system in ours(pipeline)]
        states += [o for o in pipeline.advance(messages) if isinstance(o, NavState) and o.mean is not None]
    return states, theirs


def ours(pipeline: Pipeline) -> set[int]:
    """The system of the autopilot that is followed; 0 is a log's."""
    return {0} if pipeline.autopilot is None else {0, pipeline.autopilot.system}


def within(states: list[NavState], t: np.ndarray, velocity: np.ndarray, settle: float) -> tuple[float, float]:
    """How often a velocity (N, 3) at times t (s) is within 3 of our sigmas, per axis; and the RMS difference."""
    at = np.array([s.t_ns for s in states]) / S
    mean = np.array([s.mean[3:6] for s in states])
    sigma = np.sqrt(np.array([np.diag(np.array(s.covariance))[3:6] for s in states]))
    judged = (t > at[0] + settle) & (t < at[-1])
    assert judged.sum() > 100
    ours = np.stack([np.interp(t[judged], at, mean[:, k]) for k in range(3)], axis=1)
    spread = np.stack([np.interp(t[judged], at, sigma[:, k]) for k in range(3)], axis=1)
    difference = np.abs(ours - velocity[judged])
    return float((difference < 3 * spread).mean(axis=0).min()), float(np.sqrt((difference**2).sum(axis=1).mean()))


@shared
@pytest.mark.slow
def test_a_real_px4_that_loses_a_motor_agrees_with_its_own_filter() -> None:
    """The IMU is logged at 9 Hz and shaken by 4 to 12 m/s^2: the attitude shows the force better than it does, and
    our covariance must follow."""
    messages = list(read_ulog(DATA / "logs" / "frrs_motor_failure.ulg"))
    assert sum(isinstance(m, Barometer) for m in messages) > 100
    states, theirs = fly(iter(messages), gps_s=0.11)
    t = np.array([m.t_ns for m in theirs]) / S
    share, difference = within(states, t, np.array([m.v_F_n for m in theirs]), 10.0)
    assert share >= 0.95
    assert difference < 0.5
    assert states[-1].reset_count == 0


@pytest.mark.parametrize("part", ["excerpt", pytest.param("take-off", marks=[shared, pytest.mark.slow])])
def test_ardupilots_stream_agrees_with_the_truth_more_than_its_own_filter_does(part: str) -> None:
    if part == "excerpt":
        log = gzip.decompress((EXCERPT / "copter.tlog.gz").read_bytes())
        truth = _truth(EXCERPT / "copter_state_truth.csv.gz")
    else:
        log = (DATA / "formation-copter" / "follower.tlog").read_bytes()
        truth = _truth(DATA / "formation-copter" / "follower_state_truth.csv.gz")
    datagrams = (d for d, _ in read_tlog(log) if d is not None)
    first = next(datagrams)
    states, theirs = fly(takewhile(lambda d: d.t_recv_ns - first.t_recv_ns < 45 * S, datagrams))
    share, error = within(states, truth[:, 0], truth[:, 4:7], 15.0)
    assert share >= 0.99
    t = np.array([m.t_ns for m in theirs]) / S - 0.0225  # older than their stamps
    velocity = np.array([m.v_F_n for m in theirs])
    _, difference = within(states, t, velocity, 15.0)
    assert difference < 0.046
    # It reports no sigmas, and is the worse one: what it differs by from us is its own error.
    judged = (t > states[0].t_ns / S + 15.0) & (t < states[-1].t_ns / S)
    true = np.stack([np.interp(t[judged], truth[:, 0], truth[:, k]) for k in (4, 5, 6)], axis=1)
    assert error < 0.7 * np.sqrt(((velocity[judged] - true) ** 2).sum(axis=1).mean())
    assert not [f for s in states for f in s.faults]


def _truth(path: Path) -> np.ndarray:
    """SIM2 rows: time (s), position, velocity, (N, 7)."""
    with gzip.open(path, "rt") as file:
        rows = [line.split(",") for line in file if line.startswith("SIM2")]
    table = np.array([[float(x) for x in row[1:8]] for row in rows])
    table[:, 0] *= 1e-6
    return table
