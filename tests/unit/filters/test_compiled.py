"""Machine code of the kernels: what it takes and gives, what a wrong argument does, what is said without it."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.compiled import machine, sources
from onboard.compiled.machine import PROCESSORS, REPAIR, MachineCodeError
from onboard.estimators.leader.hypotheses import particles, prediction, summary, view
from onboard.filters import association
from onboard.filters.kernels import definite, gains, linear, records
from onboard.models import quadrotor
from tests.support import kernels
from tests.support.programs import ROOT, TIMEOUT_S, environment

pytestmark = pytest.mark.skipif(not kernels.are_compiled(), reason="WINGLINE_KERNELS: nothing is compiled")
EYE = np.eye(3)[None]


def test_kernels_are_machine_code_and_no_compiler_is_loaded() -> None:
    code = (
        "import sys, onboard.daemon\n"
        "from onboard.estimators.leader import estimator\n"
        "from onboard.estimators.own_state import estimator\n"
        "from onboard.filters.kernels import linear\n"
        "print(type(linear.correct).__name__, {'numba', 'llvmlite', 'scipy'} & {*sys.modules})"
    )
    done = python(code, ROOT)
    assert done.stdout == "builtin_function_or_method set()\n"


class Odd(np.ndarray[Any, Any]):
    """A subclass."""


READ_ONLY = np.eye(3)
READ_ONLY.flags.writeable = False
WRONG_ARRAYS: dict[str, Any] = {
    "fewer axes": np.eye(3),
    "more axes": EYE[None],
    "many more axes": np.zeros((1,) * 30),
    "float32": EYE.astype(np.float32),
    "integers": EYE.astype(np.int64),
    "complex": EYE.astype(complex),
    "booleans": EYE.astype(bool),
    "objects": EYE.astype(object),
    "text": np.full((1, 3, 3), "a text of 8"),
    "other byte order": EYE.astype(">f8"),
    "a structure": np.zeros((1, 3, 3), [("a", "f8")]),
    "not aligned": np.frombuffer(bytes(73), np.uint8)[1:].view(float).reshape(1, 3, 3),
    "a list": EYE.tolist(),
    "a number": 1.0,
    "None": None,
    "a type": np.ndarray,
    "a scalar": np.float64(1.0),
}


@pytest.mark.parametrize("wrong", WRONG_ARRAYS.values(), ids=WRONG_ARRAYS)
@pytest.mark.parametrize("place", range(3))
def test_a_wrong_array_raises_and_names_its_place(wrong: Any, place: int) -> None:
    arguments = [EYE, EYE, EYE]
    arguments[place] = wrong
    with pytest.raises(TypeError, match=rf"linear\.propagate: argument {place + 1} "):
        linear.propagate(*arguments)


@pytest.mark.parametrize("count", [0, 2, 4, 400])
def test_a_wrong_number_of_arguments_raises(count: int) -> None:
    with pytest.raises(TypeError, match=f"called with {count} arguments"):
        linear.propagate(*[EYE] * count)


def test_arguments_by_name_raise() -> None:
    with pytest.raises(TypeError):
        linear.propagate(EYE, EYE, Q=EYE)


def test_an_array_with_gaps_a_subclass_and_whole_numbers_for_numbers_are_taken() -> None:
    strided = np.zeros((2, 6, 6))[::2, ::2, ::2] + 0.0
    strided[:] = EYE
    expected = linear.propagate(EYE, EYE, EYE)[0]
    for other in (strided, EYE.view(Odd), np.asfortranarray(EYE)):
        np.testing.assert_array_equal(linear.propagate(other, EYE, EYE)[0], expected)
    log_l, believed = np.array([-1.0, -2.0]), 1
    np.testing.assert_array_equal(particles.evidence(log_l, believed), log_l)
    np.testing.assert_array_equal(particles.evidence(log_l, np.float64(1.0)), log_l)


def test_an_array_to_write_into_must_be_whole_and_writable() -> None:
    for wrong in (READ_ONLY[0], np.zeros(6)[::2], np.zeros(3, np.float32)):
        with pytest.raises(TypeError, match=r"particles\.evidence: argument 1 "):
            particles.evidence(wrong, 1.0)


@pytest.mark.parametrize("wrong", ["1", None, np.zeros(1), 1j, [1.0]])
def test_a_wrong_number_raises(wrong: Any) -> None:
    with pytest.raises(TypeError, match=r"particles\.evidence: argument 2 "):
        particles.evidence(np.zeros(2), wrong)


@pytest.mark.parametrize("wrong", [1, 0.0, None, np.zeros(1, bool)])
def test_a_flag_must_be_true_or_false(wrong: Any) -> None:
    points, _ = linear.corners(np.zeros((1, 2)))
    assert linear.affine(points, points, np.zeros(2, bool), np.True_)[-1] == 0
    with pytest.raises(TypeError, match=r"linear\.affine: argument 4 "):
        linear.affine(points, points, np.zeros(2, bool), wrong)


def rows(**changed: Any) -> view.ImageRows:
    one, whole = np.ones((1, 2)), np.zeros((1, 2), np.int64)
    fields = {
        "points": np.zeros((2, 3)),
        "of": whole,
        "shares": one,
        "axis": np.zeros(1, np.int64),
        "y": np.zeros(1),
        "R": np.eye(1),
        "is_wing": False,
        "tilts": 0.0,
        "pitch": 0.0,
        "place_sigma": 0.0,
        "r_FC": np.zeros(3),
        "axes": np.eye(3),
        "bias": 0,
        "course_locked": np.zeros(1),
    }
    return view.ImageRows(**fields | changed)


WRONG_RECORDS = {
    "a plain tuple": lambda: (*rows(),),
    "another record": lambda: view.Scratch(*[np.zeros((1, 1))] * 7),
    "a field of another type": lambda: rows(of=np.zeros((1, 2))),
    "a list": lambda: [*rows()],
    "None": lambda: None,
}


@pytest.mark.parametrize("make", WRONG_RECORDS.values(), ids=WRONG_RECORDS)
def test_a_wrong_record_raises(make: Any) -> None:
    arrays = np.full((1, 18), 1.0), np.eye(18)[None], np.zeros(1)
    view.expect(*arrays, np.ones(1), rows())
    with pytest.raises(TypeError, match=r"view\.expect: argument 5 "):
        view.expect(*arrays, np.ones(1), make())


@pytest.mark.parametrize("wrong", [(0.0, 0.0), (0.0,) * 4, None])
def test_a_wrong_tuple_raises(wrong: Any) -> None:
    summary.add_ours(np.eye(6), np.zeros(3), (0.0, 0.0, 0.0), 0.0, 0.0)
    with pytest.raises(TypeError, match=r"summary\.add_ours: argument 3 "):
        summary.add_ours(np.eye(6), np.zeros(3), wrong, 0.0, 0.0)


def test_a_record_comes_back_as_its_class() -> None:
    *_, found = view.expect(np.full((1, 18), 1.0), np.eye(18)[None], np.zeros(1), np.ones(1), rows())
    assert type(found) is view.Expectation
    assert type(quadrotor._process(np.zeros((1, 12)), np.zeros((1, 4)), 0.1, quadrotor.Airframe())) is np.ndarray


def test_results_outlive_each_other_and_hold_no_memory_that_is_gone() -> None:
    kept = [linear.propagate(k * EYE, EYE, EYE)[0] for k in range(1, 2000)]
    assert all(one[0, 0, 0] == k + 1.0 for k, one in enumerate(kept, start=1))
    part = kept[-1][0, 1:]
    del kept
    assert part[0, 1] == 2000.0


def test_calls_leave_no_references_behind() -> None:
    counts = []
    for _ in range(3):
        for _ in range(100):
            linear.propagate(EYE, EYE, EYE)
            with pytest.raises(TypeError):
                linear.propagate(EYE, EYE, None)
        counts.append((sys.getrefcount(EYE), sys.getrefcount(None)))
    assert counts[0][0] == counts[-1][0]
    assert counts[0][1] == counts[-1][1]


def test_a_kernel_without_types_is_called_from_kernels_and_runs_in_python() -> None:
    assert linear.common_batch((1, 4, 1)) == 4
    assert gains.tolerance.__module__ == "onboard.filters.kernels.gains"


def python(code: str, folder: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """A program with the package of a folder."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment() | {"PYTHONPATH": str(folder), **more},
        check=False,
        cwd=folder,
        timeout=TIMEOUT_S,
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A tree with its machine code."""
    ignored = shutil.ignore_patterns("__pycache__", machine.OBJECTS)
    shutil.copytree(ROOT / "onboard", tmp_path / "onboard", ignore=ignored, symlinks=True)
    return tmp_path


USE = "from onboard.filters.kernels import definite; import numpy as np; print(definite.factor(np.eye(2)))"
CHECK = "import sys; from onboard.commands import cli; sys.exit(cli.main(['check', '--wait', '1']))"


def machine_code_in(folder: Path) -> Path:
    return folder / machine.path().relative_to(ROOT)


def test_missing_machine_code_is_one_line_with_the_remedy(copy: Path) -> None:
    machine_code_in(copy).unlink()
    done = python(CHECK, copy)
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout.startswith("FAIL filters")
    assert REPAIR in done.stdout
    assert done.stdout.count("\n") == 1
    flown = python("import sys; from onboard.commands import cli; sys.exit(cli.main(['run']))", copy)
    assert flown.returncode == 2
    assert REPAIR in flown.stderr
    assert flown.stderr.count("\n") == 1


@pytest.mark.parametrize("content", [b"", b"no library", None])
def test_damaged_machine_code_is_one_line_with_the_remedy(copy: Path, content: bytes | None) -> None:
    """None: its first half alone."""
    path = machine_code_in(copy)
    whole = path.read_bytes()
    path.unlink()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    done = python(CHECK, copy)
    assert (done.returncode, done.stderr) == (1, "")
    assert REPAIR in done.stdout
    assert done.stdout.count("\n") == 1


def test_machine_code_of_other_sources_is_refused(copy: Path) -> None:
    source = copy / "onboard" / "geometry" / "arctangent.py"
    source.write_text(source.read_text(encoding="utf-8") + "# changed\n", encoding="utf-8")
    done = python(CHECK, copy)
    assert done.returncode == 1
    assert "other sources" in done.stdout
    assert REPAIR in done.stdout


def test_what_is_compiled_anew_depends_on_code_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "ROOT", tmp_path)
    texts = {
        "plain": "def f(x):\n    return x\n",
        "described": '"""A module."""\n\n# a comment\ndef f(x):\n    """A function."""\n    return x\n',
        "changed": "def f(x):\n    return -x\n",
    }
    found = {}
    for name, text in texts.items():
        (tmp_path / "a.py").write_text(text, encoding="utf-8")
        sources._code.cache_clear()
        found[name] = sources.code_digest(["a.py"])
    sources._code.cache_clear()
    assert found["plain"] == found["described"] != found["changed"]


def test_kernels_run_in_python_without_machine_code(copy: Path) -> None:
    machine_code_in(copy).unlink()
    assert REPAIR in python(USE, copy).stderr
    done = python(USE, copy, WINGLINE_KERNELS="python")
    assert done.stdout == f"{definite.factor(np.eye(2))}\n", done.stderr


def test_an_unknown_mode_is_refused() -> None:
    done = python(USE, ROOT, WINGLINE_KERNELS="fast")
    assert "WINGLINE_KERNELS: fast is unknown" in done.stderr


def test_code_is_for_the_best_processor_that_can_run_it() -> None:
    best, least = PROCESSORS["x86_64"]
    assert machine.processor("x86_64", best.needs | {"sse2"}) is best
    assert machine.processor("x86_64", frozenset({"sse2"})) is least
    assert machine.processor("x86_64", best.needs - {"avx2"}) is least
    with pytest.raises(MachineCodeError, match="riscv64"):
        machine.processor("riscv64", frozenset())


def test_every_kernel_that_python_may_call_is_in_the_extension_module() -> None:
    for function in (records.filter_record, prediction.step, summary.moments, association._columns):
        assert type(function).__name__ == "builtin_function_or_method"
