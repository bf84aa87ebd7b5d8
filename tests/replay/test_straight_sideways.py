"""Recorded flights of a leader that flies straight with its nose off its course, which no image shows."""

import gzip
import json
from pathlib import Path

import pytest

from onboard.commands.cli import main
from tests.support.programs import DATA

FLIGHTS = DATA / "field4" / "streams"
MOST = 5.0  # percent


@pytest.mark.slow  # 25 s of a core each; `test_tilt` is beside it
@pytest.mark.skipif(not FLIGHTS.exists(), reason="the recorded flights of ../shared/data are not here")
@pytest.mark.parametrize("flight", ["75010", "75013", "75015"])
def test_it_is_not_surely_wrong_where_a_nose_off_the_course_leaves_the_range_open(
    flight: str, tmp_path: Path
) -> None:
    """Before, 27, 93 and 52 % of the estimates were confidently wrong."""
    log, score = tmp_path / "flight.tlog", tmp_path / "score.json"
    recorded = FLIGHTS / f"straight-sideways-{flight}.tlog.gz"
    log.write_bytes(gzip.decompress(recorded.read_bytes()))
    truth = recorded.with_name(f"straight-sideways-{flight}_truth.csv.gz")
    settings = ("estimator.leader.leader_class=multirotor", "estimator.leader.size_prior_m=2.0")
    overrides = [word for setting in settings for word in ("--set", setting)]
    main(["replay", str(log), "--truth", str(truth), "--json", str(score), *overrides])
    found = json.loads(score.read_text(encoding="utf-8"))
    assert found["valid_percent"] > 95.0
    assert found["confidently_wrong_percent"] <= MOST
