"""Machine code that a wheel carries: on which processors it is used, for which sources, and that it is."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from numba.core import caching
from numba.core import dispatcher as numba_dispatcher
from numba.core.caching import CacheImpl, FunctionCache
from numba.core.registry import cpu_target

from onboard.commands import compiling
from onboard.filters import numba_internals, shipped
from onboard.filters.numba_internals import Made
from onboard.filters.shipped import PROCESSORS, Code, Processor, chosen
from tests.unit.filters.test_numba_internals import IndexDataCacheFile, load_kernel

(V3,) = PROCESSORS["x86_64"]
ARMV8_2, ARMV8 = PROCESSORS["aarch64"]
HASWELL = V3.needs | {"sse", "sse2", "aes"}
RASPBERRY_PI_4, RASPBERRY_PI_5 = {"fp-armv8", "neon", "crc"}, {"fp-armv8", "neon", "crc", "lse", "dotprod"}
KERNEL = "from numba import njit\n@njit('float64(float64)', cache=True)\ndef f(x): return 2.0 * x\n"


@pytest.mark.parametrize(
    ("machine", "can", "expected"),
    [
        ("x86_64", HASWELL, V3),
        *(("x86_64", HASWELL - {missing}, None) for missing in sorted(V3.needs)),
        ("aarch64", RASPBERRY_PI_5, ARMV8_2),
        ("aarch64", RASPBERRY_PI_4, ARMV8),
        ("aarch64", {"fp-armv8"}, None),
        ("riscv64", HASWELL, None),
        ("x86_64", frozenset(), None),  # this Numba does not say what the processor can do
    ],
)
def test_the_code_is_for_a_processor_that_can_do_all_that_it_needs(
    machine: str, can: set[str], expected: Processor | None
) -> None:
    assert chosen(machine, frozenset(can)) is expected


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        (("x86-64-v3", ""), V3),
        (("x86-64-v3", None), None),  # with this computer's features beside the name
        (("skylake", None), None),
        (("generic", ""), None),
        ((None, "+avx2"), None),
    ],
)
def test_who_asks_for_another_processor_gets_no_code_of_this_one(
    asked: tuple[str | None, str | None], expected: Processor | None
) -> None:
    assert chosen("x86_64", frozenset(HASWELL), asked) is expected


def test_each_processor_needs_what_the_compiler_may_use() -> None:
    for one in (one for of_kind in PROCESSORS.values() for one in of_kind):
        features = {flag[1:] for flag in one.made.features.split(",") if flag}
        assert features <= one.needs
        assert one.needs


def test_numba_tells_of_this_computer() -> None:
    assert numba_internals.processor_features()
    assert {*numba_internals.compiler_versions()} == {"numba", "llvm", "python"}
    assert len(numba_internals.asked_for()) == 2


class Tree(NamedTuple):
    """Packages with one kernel, and a folder for their machine code, as made for this very computer."""

    source: Path
    below: Path
    folder: Path

    def fresh(self) -> Code:
        """As the next process sees it."""
        shipped._hashed.cache_clear()
        return Code(self.folder, HERE, {"a/kernel.py": ["a/kernel.py", "b/below.py"]}, self.source.parents[1])


dispatcher: Any = numba_dispatcher
HERE = Processor("here", Made("", ""), frozenset())


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Tree]:
    monkeypatch.setattr(caching, "IndexDataCacheFile", IndexDataCacheFile)
    monkeypatch.setattr(dispatcher, "FunctionCache", FunctionCache)
    monkeypatch.setattr(FunctionCache, "_impl_class", caching.CompileResultCacheImpl)
    monkeypatch.setattr(CacheImpl, "_locator_classes", list(CacheImpl._locator_classes))
    numba_internals.keep_cache_files_whole("damaged")
    source, below = tmp_path / "a" / "kernel.py", tmp_path / "b" / "below.py"
    for path, text in ((source, KERNEL), (below, "WIDTH = 1\n")):
        path.parent.mkdir()
        path.write_text(text)
    yield Tree(source, below, tmp_path / "machine_code")
    shipped._hashed.cache_clear()


def keep(tree: Tree) -> None:
    """Compile the kernel into the folder; nothing of it stays loaded."""
    before = list(CacheImpl._locator_classes)
    assert numba_internals.keep_code_in(tree.fresh().place)
    assert load_kernel(tree.source) == (42.0, 1)
    CacheImpl._locator_classes[:] = before
    CacheImpl._locator_classes = before
    FunctionCache._impl_class = caching.CompileResultCacheImpl


def look(tree: Tree, made: Made | None = None) -> None:
    here = Made(*cpu_target.target_context.codegen().magic_tuple()[1:])
    assert numba_internals.look_first(tree.fresh().place, made or here)


def test_what_is_there_is_not_compiled(tree: Tree) -> None:
    keep(tree)
    assert {path.suffix for path in tree.folder.rglob("kernel.*")} == {".nbi", ".nbc"}
    assert not list(tree.source.parent.rglob("*.nb?"))
    look(tree)
    os.utime(tree.source, (1.0, 1.0))  # by content, not by time
    assert load_kernel(tree.source) == (42.0, 0)
    assert not list(tree.source.parent.rglob("*.nb?"))


def test_it_does_not_say_where_its_source_was_compiled(tree: Tree) -> None:
    keep(tree)
    for path in tree.folder.rglob("*.nb?"):
        assert str(tree.source.parent).encode() not in path.read_bytes()


@pytest.mark.parametrize("which", ["source", "below"])
def test_of_other_sources_it_is_not_used(which: str, tree: Tree) -> None:
    """Also of one that the kernel's file only imports: Numba alone does not see that it has changed."""
    keep(tree)
    path: Path = getattr(tree, which)
    path.write_text(path.read_text() + "\n")
    look(tree)
    assert load_kernel(tree.source) == (42.0, 1)


def test_for_another_processor_it_is_not_used(tree: Tree) -> None:
    keep(tree)
    look(tree, Made("x86-64-v2", ""))
    assert load_kernel(tree.source) == (42.0, 1)


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_damaged_it_is_not_used(suffix: str, tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    keep(tree)
    (file,) = tree.folder.rglob(f"*.{suffix}")
    file.write_bytes(file.read_bytes()[:-40] + bytes(40))
    look(tree)
    assert load_kernel(tree.source) == (42.0, 1)
    assert "damaged" in capsys.readouterr().err


def test_it_needs_no_folder_that_can_be_written_to(tree: Tree) -> None:
    keep(tree)
    CacheImpl._locator_classes = []
    look(tree)
    assert load_kernel(tree.source) == (42.0, 0)
    tree.source.write_text(tree.source.read_text() + "\n")
    look(tree)
    with pytest.raises(RuntimeError, match="cannot cache function"):
        load_kernel(tree.source)


def test_other_functions_are_compiled_and_kept_as_ever(tree: Tree) -> None:
    look(tree)
    own = tree.source.parents[1] / "own.py"
    own.write_text(KERNEL)
    assert [load_kernel(own) for _ in range(2)] == [(42.0, 1), (42.0, 0)]


@pytest.mark.parametrize("name", ["_load_overload", "_index_key", "_impl_class"])
def test_a_cache_of_another_kind_is_left_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for owner in caching.FunctionCache.__mro__:
        if name in vars(owner):
            monkeypatch.delattr(owner, name)
    before = (dispatcher.FunctionCache, CacheImpl._locator_classes)
    assert not numba_internals.look_first(lambda _: None, V3.made)
    assert not numba_internals.keep_code_in(lambda _: None)
    assert before == (dispatcher.FunctionCache, CacheImpl._locator_classes)


def test_a_folder_tells_what_it_holds_once_all_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert shipped.sources_of(tmp_path) is None
    shipped.write_contents(tmp_path, {"a.py": ["a.py", "b.py"]})
    assert shipped.sources_of(tmp_path) == {"a.py": ["a.py", "b.py"]}
    for content in ("", "[]", '{"made_with": {}}', (tmp_path / shipped.CONTENTS).read_text()[:-4]):
        (tmp_path / "half").mkdir(exist_ok=True)
        (tmp_path / "half" / shipped.CONTENTS).write_text(content)
        assert shipped.sources_of(tmp_path / "half") is None
    for name, version in numba_internals.compiler_versions().items():
        others = numba_internals.compiler_versions() | {name: f"{version}.9"}
        with monkeypatch.context() as patch:
            patch.setattr(numba_internals, "compiler_versions", lambda others=others: others)
            assert shipped.sources_of(tmp_path) is None


def test_a_tree_of_sources_has_none(tmp_path: Path) -> None:
    assert not shipped.use(tmp_path / "nowhere")
    assert not shipped.use(tmp_path)
    assert not shipped.FOLDER.exists()


def test_the_sources_of_a_kernel_are_its_own_and_those_that_it_imports() -> None:
    sources = compiling.sources()
    assert len(sources) == len(compiling.kernel_modules())
    of_shape = sources["onboard/estimators/leader/hypotheses/view.py"]
    assert {
        "onboard/estimators/leader/hypotheses/view.py",
        "onboard/estimators/leader/hypotheses/motion.py",
    } < {*of_shape}
    assert "onboard/models/radar.py" not in of_shape
    assert all((shipped.PACKAGES / path).is_file() for paths in sources.values() for path in paths)


def test_numba_knows_where_to_look_before_it_sees_a_kernel() -> None:
    """A kernel that is met before would be compiled, or refused where nothing can be written."""
    firsts: Any = compiling.kernel_modules() - {"onboard.geometry.arctangent"}  # below filters; in others' code
    for name in firsts:
        assert "onboard.filters.compiled" in compiling.imported_by(name, at_once=True), name
