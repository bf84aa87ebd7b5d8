"""`onboard demo` as a user runs it: a scorecard, files, and no remaining process."""

import json
import re
import signal
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import pytest

from simlink.scenarios.scenario import load_scenario
from simlink.world.drawn import draw_scenario
from tests.support import documents
from tests.support.honesty import assert_neither_too_sure_nor_too_unsure
from tests.support.programs import TIMEOUT_S, Program, all_gone, started, until

SECONDS, SHORT = 21, 4  # with settled numbers, and without


class Flown(NamedTuple):
    code: int
    numbers: dict[str, Any]
    stdout: str
    stderr: str
    folder: Path
    family: list[psutil.Process]
    addresses: set[str]


def addresses(processes: list[psutil.Process]) -> set[str]:
    """Local addresses of all their sockets."""
    found: set[str] = set()
    for process in processes:
        try:
            found |= {c.laddr.ip for c in process.net_connections() if c.laddr}
        except psutil.NoSuchProcess:
            continue
    return found


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    return fly(tmp_path_factory.mktemp("short"), SHORT)


@pytest.fixture(scope="module")
def settled(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    return fly(tmp_path_factory.mktemp("demo"), SECONDS)


def fly(folder: Path, seconds: int) -> Flown:
    command = (
        *("onboard", "demo", "--headless", "--scenario", "formation", "--duration", seconds, "--seed", 1),
        *("--json", folder / "score.json", "--out", folder / "out"),
    )
    family: set[psutil.Process] = set()
    local: set[str] = set()
    with started(folder / "demo.log", *map(str, command), cwd=folder) as demo:
        while demo.popen.poll() is None:
            present = [demo.process, *demo.descendants()]
            family |= set(present)
            local |= addresses(present)
            with suppress(subprocess.TimeoutExpired):
                demo.popen.wait(0.5)
    return Flown(
        demo.popen.returncode,
        json.loads((folder / "score.json").read_bytes()),
        demo.stdout.read_text(),
        demo.output(),
        folder,
        list(family),
        local,
    )


def was_starved(numbers: dict[str, Any]) -> bool:
    """Whether the daemon left out messages that waited too long, so that errors are this computer's."""
    return numbers["drops"]["skipped"] > 0


@pytest.mark.slow  # the short one tracks, too
def test_demo_seed_1_tracks_within_the_documented_error(settled: Flown) -> None:
    assert settled.code == 0, settled.stderr
    assert settled.numbers["diverged"] is False
    assert settled.numbers["settle_s"] == 15.0
    assert re.search(r"\bdiverged\W+no\b", settled.stdout)
    if was_starved(settled.numbers):
        return
    assert 0 < settled.numbers["range_error_rms_percent"] <= 2.6
    assert 0 < settled.numbers["position_rmse_m"] <= 0.75
    assert 0 < settled.numbers["velocity_rmse_m_s"] <= 0.28
    assert_neither_too_sure_nor_too_unsure(settled.numbers["nees_mean"], 9)
    # six numbers an image, whose noise is drawn; the daemon supposes a pixel, and learns that it is less
    sigma_px = draw_scenario(load_scenario("formation"), 1).camera.sigma_px
    assert 4.8 * sigma_px**2 < settled.numbers["nis_mean"] < 7.2
    assert settled.numbers["inside_95_percent"] > 98.0
    assert f"{settled.numbers['range_error_rms_percent']:.2f} %" in settled.stdout


def test_a_short_demo_seed_1_tracks_and_has_no_settled_numbers(flown: Flown) -> None:
    starved = was_starved(flown.numbers)
    assert flown.code == 0 or starved, flown.stderr
    assert flown.numbers["diverged"] is False or starved
    assert flown.numbers["settle_s"] == 15.0
    assert flown.numbers["scored"] == 0
    assert flown.numbers["range_error_rms_percent"] is None
    assert flown.numbers["valid"] > 0.8 * flown.numbers["estimates"] > 80 or starved


def test_demo_seed_1_accounts_for_every_image(flown: Flown) -> None:
    drops = flown.numbers["drops"]
    assert drops["images_sent"] > SHORT * 25 * 0.85  # the scenario loses some: 2 % chance per image
    assert drops["images_received"] + drops["images_lost"] == drops["images_sent"]
    assert 0 <= drops["images_lost"] <= drops["skipped"]
    assert drops["sink_drops"] == 0
    # on a busy machine Zenoh drops some between daemon and view, rather than hold up the daemon
    dropped = drops["images_received"] - sum(flown.numbers["verdicts"].values())
    assert 0 <= dropped <= abs(drops["estimates_missed"]) + drops["skipped"]


def test_demo_without_our_own_state_writes_the_documented_keys_seed_1(flown: Flown) -> None:
    theirs = ("own_state.", "fault.")
    documented = {name for name in documents.scorecard_keys("demo") if not name.startswith(theirs)}
    assert documents.keys_of(flown.numbers) == documented
    assert flown.numbers["own_state"] is flown.numbers["fault"] is None
    latency = flown.numbers["latency_ms"]
    assert latency["p50"] >= 20.0  # the camera's latency alone
    assert 0 < latency["receive_to_publish_p50"] < latency["p50"]


def test_demo_prints_a_scorecard_that_agrees_with_the_numbers(flown: Flown) -> None:
    assert "Traceback" not in flown.stderr
    assert f"formation, seed 1, {SHORT} s" in flown.stdout
    drops = flown.numbers["drops"]
    assert f"lost: {drops['images_lost']} of {drops['images_sent']} images" in flown.stdout
    assert (f"left out: {drops['skipped']} messages" in flown.stdout) is was_starved(flown.numbers)
    estimates, valid = flown.numbers["estimates"], flown.numbers["valid"]
    assert f"{estimates} ({valid} valid, 0 scored)" in flown.stdout
    assert ("diverged" in flown.stdout) is flown.numbers["diverged"]  # too short to be told that it has not


def test_demo_writes_the_view_the_configuration_and_the_logs(flown: Flown) -> None:
    out = flown.folder / "out"
    recording = out / "formation-1.rrd"
    assert recording.read_bytes()[:3] == b"RRF"
    assert recording.stat().st_size > 50_000
    assert "size_prior_m = 2.667" in (out / "formation-1.toml").read_text()
    assert "tracking" in (out / "formation-1.daemon.log").read_text()
    assert (out / "formation-1.simlink.log").stat().st_size > 0
    assert {p.name for p in flown.folder.iterdir()} == {"out", "score.json", "demo.log", "demo.out"}


def test_demo_leaves_no_process_behind_and_only_used_loopback(flown: Flown) -> None:
    assert len(flown.family) >= 3  # itself, the simulator and the daemon
    until(lambda: all_gone(flown.family), "the end of Python's helper")
    assert flown.addresses <= {"127.0.0.1", "::1"}
    assert flown.addresses


@pytest.mark.parametrize(
    ("number", "group"),
    [(signal.SIGINT, True), pytest.param(signal.SIGTERM, False, marks=pytest.mark.slow)],
    ids=["ctrl-c in a terminal", "sigterm to the demo alone"],
)
def test_interrupted_demo_takes_its_programs_along(tmp_path: Path, number: int, group: bool) -> None:
    command = ("onboard", "demo", "--headless", "--scenario", "formation", "--duration", "600", "--seed", "2")
    command += ("--out", str(tmp_path))
    with started(tmp_path / "demo.err", *command) as demo:
        log = tmp_path / "formation-2.simlink.log"
        until(lambda: log.exists() and "flying" in log.read_text(), "a flight")
        family = demo.descendants()
        programs = [p for p in family if {"onboard", "simlink"} & set(p.cmdline())]
        assert len(programs) == 2
        assert demo.end(number, group=group) == 130
        assert all_gone(programs)
        # the helper process of Python's multiprocessing (its resource tracker) ends a moment later
        until(lambda: all_gone(family), "the end of Python's helper")
    for path in (*tmp_path.glob("*.log"), tmp_path / "demo.err"):
        assert "Traceback" not in path.read_text()


def test_demo_of_an_unknown_scenario_is_one_line(tmp_path: Path) -> None:
    with started(
        tmp_path / "demo.err", "onboard", "demo", "--headless", "--scenario", "no-such", cwd=tmp_path
    ) as demo:
        assert demo.popen.wait(TIMEOUT_S) == 2
    (line,) = demo.output().splitlines()
    assert "'no-such'" in line
    assert "formation-s-turn" in line  # the known scenarios


def test_program_helper_notices_an_end(tmp_path: Path) -> None:
    with started(tmp_path / "x.err", "onboard", "no-such-command") as program, pytest.raises(AssertionError):
        Program.wait_for(program, "never printed")
