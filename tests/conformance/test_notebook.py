"""The lines that docs/notebook.md gives a researcher, run as they stand there."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import onboard.filters
from onboard.filters import FilterError, Method, consistency, families, particle, run, smooth
from tests.support import documents
from tests.support.programs import ROOT

SMOOTH = ("cubature_smooth", "smooth_variable_structure")  # modules of smooth variable structure filters
BLOCKS = documents.blocks(documents.text("notebook"), "python")


def test_the_five_lines_of_the_page_run_a_filter_on_a_model_of_ones_own() -> None:
    block = BLOCKS[0]
    assert len([line for line in block.splitlines() if line.strip()]) == 5
    names: dict[str, object] = {}
    exec(block, names)  # noqa: S102 - what a reader would paste
    update = names["update"]
    assert update.predicted == pytest.approx(np.sin(0.1) * np.exp(-1.02 / 2), abs=0.03)  # type: ignore[attr-defined]
    assert np.diag(update.belief.covariance)[0] < 0.2  # type: ignore[attr-defined]  # from 1.02, by R = 0.04


def test_the_tracker_by_bearings_is_as_good_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mpl.use("agg")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(BLOCKS[1], names)  # noqa: S102 - what a reader would paste
    found, truth = names["found"], names["truth"]
    np.testing.assert_allclose(
        consistency.rms(found.beliefs, truth, (0, 1))[[20, 40, 59]], [971, 155, 43], atol=0.6
    )
    smoothed = smooth(found)
    np.testing.assert_allclose(consistency.rms(smoothed, truth, (0, 1))[[20, 40, 59]], [141, 79, 43], atol=0.6)
    nees = consistency.nees(found.beliefs, truth)
    assert (round(nees.mean[59], 1), round(nees.low[59], 1), round(nees.high[59], 1)) == (4.4, 3.5, 4.6)
    lost = run("posterior-linearisation", names["at"], names["start"], names["ys"]).lost
    assert 40 < len(lost) < 60  # docs/choosing.md
    assert (lost[0].member, lost[0].k) == (82, 10)
    exec(BLOCKS[2], names)  # noqa: S102 - what a reader would paste
    plt.close("all")
    assert {path.name for path in tmp_path.iterdir()} == {"track.png", "nees.png"}


def test_whole_records_run_smooth_and_estimate_as_the_page_says() -> None:
    names: dict[str, Any] = {}
    exec(BLOCKS[3], names)  # noqa: S102 - what a reader would paste
    variances = [names["fit"].model.Q[0, 0], names["fit"].model.R[0, 0]]
    np.testing.assert_allclose(np.exp(names["found"].theta), variances, rtol=0.1)
    assert np.isfinite(names["level"]).all()
    exec(BLOCKS[4], names)  # noqa: S102 - what a reader would paste
    np.testing.assert_array_equal(names["found"].degrees, [1, 0, 2])


def test_every_method_and_module_is_found_by_name() -> None:
    assert all(isinstance(method, Method) for method in onboard.filters.methods().values())
    assert {"unscented", "gating"} <= {module.__name__.rsplit(".", 1)[1] for module in onboard.filters.modules()}
    with pytest.raises(AttributeError, match="no_such_filter"):
        onboard.filters.no_such_filter  # noqa: B018
    assert issubclass(FilterError, ValueError)


def test_dir_lists_what_there_is_and_each_of_it_is_there() -> None:
    listed = dir(onboard.filters)
    assert {"Model", "run", "smooth", "unscented", "discretisation"} <= set(listed)
    assert all(getattr(onboard.filters, name) is not None for name in listed)
    stub = Path(str(onboard.filters.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    assert all(f'"{name}",' in stub for name in onboard.filters.__all__)  # the types of all names


def test_each_method_is_in_the_module_that_the_table_says() -> None:
    named = {name: families.method(name) for name in families.MODULES}
    assert named == onboard.filters.methods() | {"particle": particle.METHOD}
    with pytest.raises(KeyError, match="no filter named 'kalmann'; there are: augmented, "):
        families.method("kalmann")


def test_two_methods_of_one_name_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from onboard.filters import unscented  # noqa: PLC0415

    monkeypatch.setattr(unscented, "METHODS", (*unscented.METHODS, unscented.METHODS[0]))
    with pytest.raises(ValueError, match="two filter methods are called 'unscented'"):
        onboard.filters.methods()


def loaded(code: str) -> set[str]:
    """The modules that a process of its own has loaded after some code."""
    command = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    return {*subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout.split()}


def test_importing_the_package_loads_no_compiler() -> None:
    assert "numba" not in loaded("import onboard.filters")


def test_no_filter_loads_what_the_daemon_needs() -> None:
    """The page says so to whoever wants the filters alone."""
    code = (
        "import onboard.filters as f; f.methods(); f.run; f.smooth; f.simulate; f.smooth_modes; f.smooth_particles"
    )
    others = {"zenoh", "pymavlink", "rerun", "serial", "mcap", "pyulog", "lxml", "msgspec", "matplotlib"}
    found = loaded(code)
    assert "onboard.filters.particle_smoothing" in found
    assert not found & others


def test_one_method_loads_no_other_family() -> None:
    every = {f"onboard.filters.{module}" for module in families.MODULES.values()}
    found = every & loaded("from onboard.filters.families import method; method('csvsf-adaptive')")
    assert found == {f"onboard.filters.{m}" for m in (*SMOOTH, "cubature", "unscented")}
