"""`onboard compile`: every module with kernels, in several processes, and only what a configuration needs."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path

import psutil
import pytest
from numba.core.caching import CacheImpl

from onboard.commands import compiling, ready
from onboard.commands.cli import main
from onboard.commands.compiling import (
    CompileError,
    compile_all,
    flight_modules,
    kernel_modules,
    needed_by,
    path_lengths,
)
from onboard.commands.ready import Module, Ready
from onboard.config import estimator_modules, parse_config
from onboard.filters import numba_internals
from onboard.filters.shipped import Code
from onboard.models import relative_motion
from simlink import cli as simlink

ROOT = Path(__file__).parents[3]
ARC = ["onboard.models.arc"]
LEADER_ONLY = {"onboard.models.relative_motion", "onboard.estimators.leader.hypotheses.motion"}


@pytest.mark.slow
def test_every_kernel_is_made_ready_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ready, "read", lambda _, digest: Ready(digest))
    reports: list[tuple[int, int]] = []
    modules: list[Module] = []

    def on_progress(done: int, total: int, module: Module | None) -> None:
        reports.append((done, total))
        modules.extend([module] if module is not None else [])

    assert compile_all(on_progress=on_progress) == sorted(modules)
    assert {*LEADER_ONLY, "onboard.filters.kernels.variable_structure"} <= {module.name for module in modules}
    assert all(module.loaded + module.compiled > 0 and module.seconds > 0 for module in modules)
    assert all(Path(module.folder).is_dir() for module in modules)
    total = len(reports)
    assert reports == [(done, total) for done in range(1, total + 1)]
    assert total > len(modules)  # some are only compiled where others call them


def test_with_a_configuration_only_what_it_flies_with_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", "--set", "estimator={leader={}}"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    names = {line.split()[0] for line in lines}
    assert {*LEADER_ONLY, "onboard.estimators.leader.hypotheses.view"} <= names
    assert names & {"onboard.filters.kernels.variable_structure", "onboard.filters.kernels.square_root"} == set()
    assert last.startswith("ready in ")


@pytest.mark.parametrize(
    "arguments", [["nowhere.toml"], ["--set", "estimator.nobody.x=1"], ["--set", "estimator.leader.x=1"]]
)
def test_a_mistake_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


FLIGHTS = """
import os, sys
from onboard.commands.cli import main
from onboard.pipeline import Pipeline  # what all flights need is imported once

for section, log in zip(sys.argv[1::2], sys.argv[2::2]):
    if not os.fork():
        assert main(["replay", log, "--set", f"estimator={{{section}={{}}}}"]) == 0
        print("imported", section, *sys.modules, flush=True)
        os._exit(0)
    assert os.wait()[1] == 0
"""


def test_a_flight_imports_no_kernels_but_those_foreseen(tmp_path: Path) -> None:
    """Each in a process that has flown no other."""
    arguments: list[str] = []
    for section, scenario in (("leader", "formation"), ("own_state", "formation"), ("traffic", "traffic")):
        log = tmp_path / f"{section}.tlog"
        assert simlink.main(["log", scenario, "--seed", "1", "--duration", "2", "--out", str(log)]) == 0
        arguments += [section, str(log)]
    command = [sys.executable, "-c", FLIGHTS, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    flown = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("imported")]
    assert [section for section, *_ in flown] == arguments[::2]
    for section, *modules in flown:
        imported = {name for name in modules if name in kernel_modules()}
        assert any("kernels" in name for name in imported)
        estimators = estimator_modules(parse_config({"estimator": {section: {}}}).estimator)
        assert imported <= needed_by(flight_modules(estimators))


def test_a_flight_needs_the_kernels_of_the_filter_that_its_configuration_names_and_of_no_other() -> None:
    kernels = "onboard.filters.kernels"
    others = {f"{kernels}.{name}" for name in ("augmented", "multiple_model", "square_root", "triangularisation")}
    expected = {"csvsf-adaptive": "variable_structure", "augmented": "augmented", "imm": "multiple_model"}
    for name, kernel in expected.items():
        config = parse_config({"estimator": {"own_state": {"filter": name}}})
        needed = needed_by(flight_modules(estimator_modules(config.estimator)))
        assert needed & (others | {f"{kernels}.variable_structure"}) == {f"{kernels}.{kernel}"}


def test_modules_with_kernels_are_found() -> None:
    found = kernel_modules()
    assert {*LEADER_ONLY, "onboard.geometry.arctangent", "onboard.estimators.leader.hypotheses.view"} <= found
    assert found & {"onboard.filters.kernels.calls", "onboard.filters.compiled", compiling.__name__} == set()


def test_the_longest_path_goes_first() -> None:
    needs: dict[str, set[str]] = {
        "onboard.filters.kernels.cholesky": set(),
        "onboard.models.arc": set(),
        "onboard.filters.kernels.gains": {"onboard.filters.kernels.cholesky"},
    }
    lengths = path_lengths(needs)
    lines = {name: len(compiling._source(name).read_text(encoding="utf-8").splitlines()) for name in needs}
    root, alone, user = needs
    assert lengths == {root: lines[root] + lines[user], alone: lines[alone], user: lines[user]}


def test_machine_code_older_than_a_source_is_dropped_and_nothing_else(tmp_path: Path) -> None:
    code = [tmp_path / name for name in ("a.f-1.py311.nbi", "a.f-1.py311.1.nbc", "a.g-9.py311.nbi")]
    for path, age in zip(code, (5.0, 5.0, 50.0), strict=True):
        path.touch()
        os.utime(path, (age, age))
    assert not compiling.drop_stale(code, newest=4.0)
    assert len(list(tmp_path.iterdir())) == 3
    assert compiling.drop_stale(code, newest=10.0)
    assert [path.name for path in tmp_path.iterdir()] == ["a.g-9.py311.nbi"]


def test_a_changed_source_drops_the_machine_code_of_the_modules_above_it_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = {"below": tmp_path / "below.py", "above": tmp_path / "above.py", "beside": tmp_path / "beside.py"}
    for name, source in sources.items():
        source.touch()
        os.utime(source, (20.0, 20.0) if name == "below" else (1.0, 1.0))
        code = tmp_path / f"{name}.f-1.py311.nbi"
        code.touch()
        os.utime(code, (10.0, 10.0))
    monkeypatch.setattr(compiling, "kernel_modules", lambda: frozenset(sources))
    monkeypatch.setattr(compiling, "_source", sources.__getitem__)
    monkeypatch.setattr(compiling, "cache_folder", lambda source: source.parent)
    monkeypatch.setattr(compiling, "needed_by", lambda names: {*names, "below"} if "above" in names else {*names})
    compiling.drop_all_stale()
    assert [path.name for path in tmp_path.glob("*.nbi")] == ["beside.f-1.py311.nbi"]


def test_the_folder_of_the_machine_code_is_known() -> None:
    """If it were not, nothing would ever be stale."""
    folder = compiling.cache_folder(Path(relative_motion.__file__))
    assert folder is not None
    assert str(folder) == relative_motion._process.stats.cache_path
    code = compiling.machine_code(relative_motion.__name__)
    assert {path.parent for path in code} == {folder}
    assert {path.suffix for path in code} == {".nbi", ".nbc"}


def test_nowhere_to_keep_it_is_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    assert main(["compile"]) == 2
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err


def test_a_numba_that_does_not_say_where_its_code_is_still_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(numba_internals, "cache_folder", lambda _: None)
    assert main(["compile", "--set", "estimator={}"]) == 0
    output = capsys.readouterr()
    assert output.out.splitlines()[-1].startswith("ready in ")
    assert "delete it yourself" in output.err


def test_a_numba_whose_cache_cannot_be_locked_compiles_in_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []
    processes = compiling._processes

    def counted(count: int, into: Code | None) -> AbstractContextManager[ProcessPoolExecutor]:
        counts.append(count)
        return processes(count, into)

    monkeypatch.setattr(ready, "read", lambda _, digest: Ready(digest))
    monkeypatch.setattr(compiling, "_processes", counted)
    monkeypatch.setattr(numba_internals, "can_lock_cache_files", lambda: False)
    made = compile_all(
        ["onboard.models.arc", "onboard.geometry.arctangent"], workers=4, on_progress=lambda *_: None
    )
    assert [module.name for module in made] == ["onboard.models.arc"]
    assert counts == [1]


def test_what_a_record_says_to_be_ready_is_not_loaded_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until its machine code or a source changes, and for each precision by itself."""
    opened: list[int] = []
    processes = compiling._processes

    def counted(count: int, into: Code | None) -> AbstractContextManager[ProcessPoolExecutor]:
        opened.append(count)
        return processes(count, into)

    def reports() -> list[tuple[int, int, str]]:
        calls: list[tuple[int, int, str]] = []
        opened.clear()
        compile_all(ARC, workers=1, on_progress=lambda done, total, m: calls.append((done, total, m.name)))
        return calls

    code = tmp_path / "arc.f-1.py311.nbi"
    code.write_text("code")
    source = tmp_path / "onboard" / "a.py"
    source.parent.mkdir()
    source.touch()
    monkeypatch.setattr(compiling, "_processes", counted)
    monkeypatch.setattr(compiling, "cache_folder", lambda _: tmp_path)
    monkeypatch.setattr(compiling, "machine_code", lambda _: [code])
    monkeypatch.setattr(compiling, "_digest", lambda: ready.digest([source.parent]))
    monkeypatch.setattr(compiling, "drop_all_stale", lambda: None)
    monkeypatch.setenv("WINGLINE_PRECISION", "double")
    first = reports()
    assert [(done, total) for done, total, _ in first] == [(1, 1)]
    assert opened == [1]
    for precision, expected in [("double", []), ("another", [1]), ("double", []), ("another", [])]:
        monkeypatch.setenv("WINGLINE_PRECISION", precision)  # what this one is said to need, no process asks
        assert reports() == first
        assert opened == expected
    for change in (lambda: code.write_text("more code"), lambda: source.write_text("1"), code.unlink):
        change()
        assert reports() == first
        assert opened == [1]
        reports()
        assert opened == []


def test_nothing_is_ready_by_a_record_whose_sources_changed_while_it_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digests = iter(["before", "after"])
    monkeypatch.setattr(compiling, "cache_folder", lambda _: tmp_path)
    monkeypatch.setattr(compiling, "machine_code", lambda _: [])
    monkeypatch.setattr(compiling, "_digest", lambda: next(digests))
    compile_all(ARC, workers=1, on_progress=lambda *_: None)
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(("precision", "expected"), [("double", "1"), ("both", "2"), (None, "2")])
def test_a_program_says_which_precisions_it_needs(precision: str | None, expected: str) -> None:
    kept = {key: value for key, value in os.environ.items() if key != "WINGLINE_PRECISION"}
    precision_set = {} if precision is None else {"WINGLINE_PRECISION": precision}
    code = "from onboard.filters.compiled import signatures; print(len(signatures(2)))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=kept | precision_set, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == expected


KERNEL = """
from numba import njit
from onboard.filters.compiled import MAKING, signatures

@njit(signatures("f"), **MAKING)
def f(x):
    return x + x
"""
COUNTED = "from kernel import f; print(sum(f.stats.cache_misses.values()))"


def test_to_switch_between_the_precisions_compiles_nothing_twice(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    compiled = []
    for precision in ("double", "both", "double", "both"):
        own = {"PYTHONPATH": f"{tmp_path}:{ROOT}", "WINGLINE_PRECISION": precision, "NUMBA_DISABLE_JIT": "0"}
        command = [sys.executable, "-c", COUNTED]
        done = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=True)
        compiled.append(int(done.stdout))
    assert compiled == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["replay", "nowhere.tlog"], "double"),
        (["run", "nowhere.toml"], "double"),
        (["compile", "nowhere.toml"], None),  # nothing flies
        (["study", "nowhere"], None),
    ],
)
def test_what_flies_needs_double_precision_alone(
    arguments: list[str], expected: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WINGLINE_PRECISION", "")  # so that it is restored
    monkeypatch.delenv("WINGLINE_PRECISION")
    assert main(arguments) == 2
    assert os.environ.get("WINGLINE_PRECISION") == expected


def test_no_more_processes_compile_than_there_is_memory_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal:  3900000 kB\nMemAvailable:    2200000 kB\n")
    assert compiling._available(meminfo) == 2_200_000 * 1024
    assert compiling._available(tmp_path / "nowhere") > 1 << 50
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    for available, expected in ((2.2, 2), (0.1, 1), (100.0, 4)):
        monkeypatch.setattr(compiling, "_available", lambda n=available: int(n * compiling.EACH))
        assert compiling._cores() == expected


def test_a_process_that_is_killed_is_an_error() -> None:
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
            time.sleep(0.02)
        children = psutil.Process(it.pid).children(recursive=True)
        it.send_signal(signal.SIGINT)
        assert it.wait() == 130
    assert children
    assert psutil.wait_procs(children, timeout=300.0)[1] == []


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_in_a_terminal_is_for_whoever_started_the_processes() -> None:
    """It reaches all of them; one that has nothing to do would end with a traceback."""
    with compiling._processes(1) as pool:
        worker = pool.submit(os.getpid).result()
        while psutil.Process(worker).status() != psutil.STATUS_SLEEPING:  # the test has a time limit
            time.sleep(0.01)
        os.kill(worker, signal.SIGINT)
        assert pool.submit(os.getpid).result() == worker
