"""A replay keeps no estimates: its memory does not grow with the flight."""

import gc
import tracemalloc
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from onboard.analysis.flights import replay as log_replay
from onboard.analysis.flights.replay import replay
from onboard.messages import Estimate
from onboard.scoring.leader import LeaderScorer, score_leader
from onboard.scoring.reference import Reference
from tests.support.streams import Flight, Stream, advance, make_config

NEAR = Flight(radius=None, gap=25.0)


def kept(seconds: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """Bytes that a replay of a flight keeps at its end."""
    (tmp_path / "flight").write_bytes(b"a log")
    datagrams = Stream(flight=NEAR, t1=5.0 + seconds).datagrams()

    def read_log(_: Path, *_more: object, **_options: object) -> Iterator[tuple[object, int]]:
        return ((d, 0) for d in datagrams)

    monkeypatch.setattr(log_replay, "read_log", read_log)
    tracemalloc.start()
    try:
        replayed = replay(tmp_path / "flight", make_config(), keep=False)
        gc.collect()
        size, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert replayed.health.verdicts["leader.fused"] > 20 * seconds
    return size


def test_a_longer_flight_takes_no_more_memory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kept(1.0, monkeypatch, tmp_path)  # loads
    short, long = kept(2.0, monkeypatch, tmp_path), kept(5.0, monkeypatch, tmp_path)
    assert long - short < 100_000  # bytes; three seconds of estimates are two millions


@cache
def estimates() -> list[Estimate]:
    config = make_config("estimator.leader.publish_rate_hz=1000")
    run = advance((i.message for i in Stream(flight=NEAR, t1=22.0).items()), config)
    return [e for e in run.estimates if e.is_primary]


def truth() -> Reference:
    time = np.arange(5.0, 21.0, 0.1)
    ours = np.tile([25.0, 0, 0, 0, 0, 0, 2.0], (len(time), 1))
    return Reference(time, ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size"), ours)


@pytest.mark.parametrize("reference", [truth(), None], ids=["truth", "no truth"])
def test_a_score_in_pieces_is_that_of_the_whole(reference: Reference | None) -> None:
    whole = estimates()
    scorer = LeaderScorer(reference, settle=5.0, piece=100)
    for estimate in whole:
        scorer.add(estimate)
    score = scorer.score()
    assert score == score_leader(whole, reference, settle=5.0)
    assert score.images_scored > 200
    if reference is not None:
        assert score.scored > 350
        assert score.range_error_rms_percent is not None
