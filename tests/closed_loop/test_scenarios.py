"""simlink's scenarios through the pipeline from bytes, configured by `simlink config`.

One of them also passes the command line. The seed is 1 unless a test says otherwise; bounds of errors are a third
above the measured ones.
"""

import io
import json
from pathlib import Path
from typing import NamedTuple

import pytest

from onboard.analysis.exports.csv_rows import CsvWriter
from simlink.cli import main as simlink
from simlink.scenarios.scenario import load_scenario
from simlink.world.drawn import draw_scenario
from tests.support import documents
from tests.support.cases import slow_but
from tests.support.honesty import assert_neither_too_sure_nor_too_unsure
from tests.support.programs import run
from tests.support.scenarios import SHORT_DURATION_S, Flights, seconds

SEED = 1
PAPER = "estimator.oh_johnson={size_prior_m=2.667}"
# Where the paper's filter flies beside ours; what ours estimates is the same without it (test_replay.py says so).
BESIDE = {"formation": (PAPER,), "formation-from-the-side": (PAPER,)}


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Flights:
    return Flights(tmp_path_factory.mktemp("flights"), SEED)


# Of 1000 correct images the gate rejects one on average, and more than five in one run of two thousand.
CHANCE_FACTOR = 5


class Bounds(NamedTuple):
    """The most of the range error, in percent, and of gated images."""

    range_percent: float
    gated: int = CHANCE_FACTOR


BOUNDS = {
    "formation": Bounds(2.2),
    "formation-drop-out": Bounds(3.8),
    "formation-late-image": Bounds(3.5),
    "formation-s-turn": Bounds(2.7),
    "formation-wrong-blobs": Bounds(3.4, 17),
    "formation-old-stamps": Bounds(3.2),
    "formation-nav-error": Bounds(2.4),
    "formation-speed-change": Bounds(3.2),
    "formation-from-the-side": Bounds(11.0),
    "formation-out-of-view": Bounds(13.7),  # two parts: to 30 m ahead and back, with a gap
}


# A flight takes some seconds of a core. What the others add has short tests: late and wrong images
# (properties/test_late_images.py, faults/test_matrix.py), delays (unit/test_delays.py), errors of our own state
# (unit/estimators/leader/test_honesty.py), a leader out of view (unit/estimators/leader/test_lifecycle.py).
@pytest.mark.parametrize("scenario", slow_but(["formation", "formation-drop-out"], BOUNDS))
def test_scenario_seed_1_keeps_its_bounds(replay: Flights, scenario: str) -> None:
    bounds, score = BOUNDS[scenario], replay(scenario, *BESIDE.get(scenario, ())).score
    assert not score.diverged
    assert score.range_error_rms_percent <= bounds.range_percent
    assert score.inside_95_percent >= 95.0
    assert_neither_too_sure_nor_too_unsure(score.nees_mean, 9)
    assert score.verdicts["fused"] + score.verdicts.get("fused_late", 0) > 0.65 * 25 * seconds(
        scenario
    )  # of one, 14 s are blind
    assert score.verdicts.get("gated", 0) <= bounds.gated
    # six numbers per image, whose noise is drawn; the daemon supposes a pixel
    sigma_px = draw_scenario(load_scenario(scenario), SEED).camera.sigma_px
    assert 4.3 < score.nis_mean / sigma_px**2 < 7.8


def test_the_command_line_seed_1_gives_the_same_rows_and_the_documented_keys(
    replay: Flights, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`simlink log`, `simlink config` and `onboard replay --truth` equal the pipeline bit for bit.

    The flight is simulated a second time.
    """
    log, truth, config, json_file, rows = (
        tmp_path / n for n in ("f.tlog", "f.csv.gz", "f.toml", "f.json", "f.csv")
    )
    scenario = ("formation", "--seed", str(SEED), "--duration", str(SHORT_DURATION_S))
    assert simlink(["log", *scenario, "--out", str(log), "--truth", str(truth)]) == 0
    capsys.readouterr()
    assert simlink(["config", scenario[0]]) == 0
    config.write_text(capsys.readouterr().out)
    files = ("--config", config, "--json", json_file, "--out", rows)
    done = run("onboard", "replay", log, "--truth", truth, *files)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    numbers = json.loads(json_file.read_bytes())
    assert documents.keys_of(numbers) == documents.scorecard_keys("replay")
    assert numbers["log"]["damaged"] == 0
    assert numbers["health"]["autopilot"] == "PX4, system 1"
    flight, text = replay(scenario[0], *BESIDE[scenario[0]]), io.StringIO()
    writer = CsvWriter(text)
    for estimate in flight.estimates:
        writer.write(estimate)
    assert rows.read_text(encoding="utf-8") == text.getvalue()
    assert len(flight.estimates) == pytest.approx(30 * SHORT_DURATION_S, rel=0.02)
    for name in ("range_error_rms_percent", "position_rmse_m", "nees_mean", "inside_95_percent"):
        assert numbers[name] == pytest.approx(getattr(flight.score, name), rel=1e-3), name  # the file has 6 digits
    assert numbers["verdicts"] == flight.score.verdicts


def test_the_papers_noise_seed_1_is_as_pessimistic_as_the_paper_shows(replay: Flights) -> None:
    """Oh & Johnson's settings give NEES near 0.2 of 9 and NIS near 0.003 of 3.

    Their bounds are far wider than the errors.
    """
    score = replay("formation", PAPER).beside["oh_johnson"]
    assert not score.diverged
    assert 0.16 < score.nees_mean < 0.3
    assert 0.0015 < score.nis_mean < 0.0028
    assert score.inside_95_percent == 100.0
    assert score.verdicts.get("gated", 0) == 0


@pytest.mark.slow
def test_a_leader_viewed_from_the_side_seed_1_is_too_far_by_the_papers_angles(replay: Flights) -> None:
    """A leader yawed by 40 degrees has a 0.8 times as wide image, which makes it a quarter too far.

    That holds if the wing is assumed in the image plane.
    """
    score = replay("formation-from-the-side", PAPER).beside["oh_johnson"]
    assert not score.diverged
    assert 15 < score.range_error_rms_percent < 35
