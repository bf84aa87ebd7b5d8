"""`onboard compile`: every module with kernels, in several processes, and only what a configuration needs."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from numba.core.caching import CacheImpl, IndexDataCacheFile

from onboard.commands import compiling
from onboard.commands.cli import main
from onboard.commands.compiling import FIRST, CompileError, Module, all_modules, compile_all, needed_by_flight
from onboard.models import relative_motion

ROOT = Path(__file__).parents[3]
LEADER_ONLY = {
    "onboard.filters.kernels.unscented",
    "onboard.models.relative_motion",
    "onboard.models.camera_angles",
}


def test_every_kernel_is_made_ready_and_told() -> None:
    heard: list[tuple[int, int]] = []
    modules: list[Module] = []

    def told(done: int, total: int, module: Module | None) -> None:
        heard.append((done, total))
        modules.extend([module] if module is not None else [])

    assert compile_all(told=told) == sorted(modules)
    assert {*LEADER_ONLY, "onboard.filters.kernels.variable_structure"} <= {module.name for module in modules}
    assert all(module.loaded + module.compiled > 0 and module.seconds > 0 for module in modules)
    assert all(Path(module.folder).is_dir() for module in modules)
    total = len(heard)
    assert heard == [(done, total) for done in range(1, total + 1)]
    assert total > len(modules)  # some are only compiled where others call them


def test_the_command_says_what_it_did(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert any(line.startswith("onboard.filters.kernels.variable_structure ") for line in lines)
    assert last.startswith("ready in ")


def test_with_a_configuration_only_what_it_flies_with_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", str(ROOT / "configs/demo.toml")]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    names = {line.split()[0] for line in lines}
    assert {*LEADER_ONLY, "onboard.estimators.leader.modes"} <= names
    assert names & {"onboard.filters.kernels.variable_structure", "onboard.filters.kernels.square_root"} == set()
    assert last.startswith("ready in ")


@pytest.mark.parametrize(
    "arguments", [["nowhere.toml"], ["--set", "estimator.nobody.x=1"], ["--set", "estimator.leader.x=1"]]
)
def test_a_mistake_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("scenario", "sections"),
    [("formation", "leader={}"), ("formation", "own_state={}"), ("traffic", "traffic={}")],
)
def test_a_flight_imports_no_kernels_but_those_foreseen(tmp_path: Path, scenario: str, sections: str) -> None:
    log = tmp_path / "flight.tlog"
    files = ["--out", str(log), "--truth", str(tmp_path / "truth.csv")]
    simlink = [sys.executable, "-m", "simlink", "log", scenario, "--seed", "1", "--duration", "3", *files]
    subprocess.run(simlink, check=True, capture_output=True)
    code = (
        "import sys; from onboard.commands.cli import main\n"
        f"assert main(['replay', {str(log)!r}, '--set', 'estimator={{{sections}}}']) == 0\n"
        "print('imported', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT)
    imported = {name for name in done.stdout.splitlines()[-1].split() if name in all_modules()}
    assert any("kernels" in name for name in imported)
    assert imported <= needed_by_flight([sections.partition("=")[0]])


def test_what_is_to_go_first_exists() -> None:
    assert set(FIRST) <= all_modules()


def test_machine_code_older_than_a_source_is_dropped_and_nothing_else(tmp_path: Path) -> None:
    for name, age in (("a.f-1.py311.nbi", 5.0), ("a.f-1.py311.1.nbc", 5.0), ("b.nbi", 50.0), ("a.pyc", 5.0)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (age, age))
    assert not compiling.drop_stale(tmp_path, newest=4.0)
    assert len(list(tmp_path.iterdir())) == 4
    assert compiling.drop_stale(tmp_path, newest=10.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.pyc", "b.nbi"]


def test_the_folder_of_the_machine_code_is_known() -> None:
    """If it were not, nothing would ever be stale."""
    assert str(compiling.kept_in("onboard.models")) == relative_motion._process.stats.cache_path
    assert list(compiling.kept_in("onboard.models").glob("relative_motion.*.nbi"))


def test_nowhere_to_keep_it_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    assert main(["compile"]) == 2
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err


def test_two_that_save_code_of_one_function_do_not_mix_it_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("load", "save"):  # so that they are put back
        monkeypatch.setattr(IndexDataCacheFile, name, getattr(IndexDataCacheFile, name))
    load_index = IndexDataCacheFile._load_index
    both_have_read = threading.Barrier(2)

    def slowly(file: IndexDataCacheFile) -> dict[str, str]:
        found: dict[str, str] = load_index(file)
        with suppress(threading.BrokenBarrierError):
            both_have_read.wait(0.2)
        return found

    monkeypatch.setattr(IndexDataCacheFile, "_load_index", slowly)
    compiling.one_at_a_time(threading.Lock())
    file = IndexDataCacheFile(str(tmp_path), "f", "stamp")
    savers = [threading.Thread(target=file.save, args=(types, f"code for {types}")) for types in "ab"]
    for saver in savers:
        saver.start()
    for saver in savers:
        saver.join()
    assert [file.load(types) for types in "ab"] == ["code for a", "code for b"]


def test_a_process_that_is_killed_is_told() -> None:
    with pytest.raises(CompileError, match="killed"), compiling._processes(1) as pool:
        pool.submit(os._exit, 9).result()


def test_an_interruption_does_not_wait_for_what_is_being_compiled() -> None:
    others = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt), compiling._processes(1) as pool:
        _interrupt_at_work(pool)
    assert set(multiprocessing.active_children()) <= others


def _interrupt_at_work(pool: ProcessPoolExecutor) -> None:
    pool.submit(os.getpid).result()  # it has begun
    first, *_ = [pool.submit(time.sleep, 3600.0) for _ in range(5)]
    while not first.running():  # the test has a time limit
        time.sleep(0.01)
    raise KeyboardInterrupt


@pytest.fixture
def interruptible() -> Iterator[None]:
    """As in a terminal: what a shell starts in the background ignores interruptions, and so do its children."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interruption_leaves_no_process_behind(tmp_path: Path) -> None:
    """It comes while they compile: nothing is there yet."""
    environment = dict(os.environ, NUMBA_CACHE_DIR=str(tmp_path))
    command = [sys.executable, "-m", "onboard", "compile"]
    with subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.DEVNULL) as it:
        while not list(tmp_path.glob("**/*.nbi")):  # the test has a time limit
            assert it.poll() is None
        children = psutil.Process(it.pid).children(recursive=True)
        it.send_signal(signal.SIGINT)
        assert it.wait() == 130
    assert children
    assert psutil.wait_procs(children, timeout=10.0)[1] == []


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_in_a_terminal_is_for_whoever_started_the_processes() -> None:
    """It reaches all of them; one that has nothing to do would end with a traceback."""
    with compiling._processes(1) as pool:
        worker = pool.submit(os.getpid).result()
        while psutil.Process(worker).status() != psutil.STATUS_SLEEPING:  # the test has a time limit
            time.sleep(0.01)
        os.kill(worker, signal.SIGINT)
        assert pool.submit(os.getpid).result() == worker
