"""The lines that docs/notebook.md gives a researcher, run as they stand there."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import onboard.filters
from onboard.filters import Belief, FilterError, LinearModel, Method, consistency, families, particle, run, smooth
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


def test_a_bank_of_eight_filters_finds_an_unknown_range_as_the_page_says() -> None:
    names: dict[str, Any] = {}
    exec(BLOCKS[1], names)  # noqa: S102 - what a reader would paste
    assert len(BLOCKS[5].splitlines()) <= 9  # two of them imports
    truth, ys = names["truth"], names["ys"]
    squared, nees, count = np.zeros(60), np.zeros(60), 40
    for b in range(count):
        names["ys"] = ys[:, b : b + 1]
        exec(BLOCKS[5], names)  # noqa: S102 - what a reader would paste
        assert names["bank"].lost == ()
        merged = names["merged"]
        error = merged.mean - truth[:, b]
        squared += np.sum(error[:, :2] ** 2, axis=1) / count
        nees += np.einsum("ti,tij,tj->t", error, np.linalg.inv(merged.covariance), error) / count
    first = Belief(truth[0, :count], np.tile(np.diag([4000.0, 4000, 5, 5]) ** 2, (count, 1, 1)))
    bound = consistency.cramer_rao(names["at"], first, truth[:, :count], names["t"])
    least = np.sqrt(np.trace(bound[..., :2, :2], axis1=-2, axis2=-1).mean(axis=1))
    np.testing.assert_allclose(np.sqrt(squared)[[40, 59]], [165, 48], atol=0.6)
    np.testing.assert_allclose(least[[40, 59]], [175, 40], atol=0.6)
    assert nees[59] == pytest.approx(4.2, abs=0.06)


@pytest.mark.parametrize(("lasts", "common"), [(0.95, 0.03), (0.0, 0.1)])
def test_correlated_noises_are_states_of_an_honest_filter_as_the_page_says_seed_5(
    lasts: float, common: float
) -> None:
    rng, T, size = np.random.default_rng(5), 400, 2.0
    F = np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, lasts]])
    Q = np.array([[0, 0, 0], [0, 0.01, common], [0, common, size**2 * (1 - lasts**2)]])
    truth = np.empty((T, 3))
    truth[0] = rng.normal(0, [10, 1, size])
    for k in range(1, T):
        truth[k] = F @ truth[k - 1] + rng.multivariate_normal(np.zeros(3), Q, method="eigh")
    record = truth[:, :1] + truth[:, 2:] + 0.1 * rng.normal(size=(T, 1))
    names: dict[str, Any] = {"np": np, "run": run, "Belief": Belief, "record": record}
    block = BLOCKS[6].replace("0.95, 2.0, 0.03", f"{lasts}, 2.0, {common}")
    exec(block, names)  # noqa: S102 - what a reader would paste
    found = names["coloured"]
    white = LinearModel(F[:2, :2], Q[:2, :2], np.eye(1, 2), np.array([[size**2 + 0.01]]))
    plain = run("kalman", white, Belief(np.zeros(2), np.diag([100.0, 1])), record)

    def off(beliefs: Belief) -> tuple[float, float]:
        error = (beliefs.mean - truth[:, : beliefs.mean.shape[1]])[20:]
        nees = np.einsum(
            "ti,tij,tj->t", error[:, :2], np.linalg.inv(beliefs.covariance[20:, :2, :2]), error[:, :2]
        )
        return float(np.sqrt(np.mean(error[:, 0] ** 2))), float(nees.mean())

    assert 1.0 < off(found.beliefs)[1] < 3.5
    assert off(found.beliefs)[0] < off(plain.beliefs)[0]


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
    typed = {name.partition("(")[0] for name in re.findall(r"(?:def| as) (\S+)", stub)}
    assert typed >= {*onboard.filters.__all__}


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
