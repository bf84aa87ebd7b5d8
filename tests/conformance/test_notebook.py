"""The lines that docs/notebook.md gives a researcher, run as they stand there."""

import subprocess
import sys

import numpy as np
import pytest

import onboard.filters
from onboard.filters import FilterError, Method
from tests.support import documents
from tests.support.programs import ROOT

BLOCKS = documents.blocks(documents.text("notebook"), "python")


def test_the_five_lines_of_the_page_run_a_filter_on_a_model_of_ones_own() -> None:
    (block,) = BLOCKS
    assert len([line for line in block.splitlines() if line.strip()]) == 5
    names: dict[str, object] = {}
    exec(block, names)  # noqa: S102 - what a reader would paste
    update = names["update"]
    assert update.predicted == pytest.approx(np.sin(0.1) * np.exp(-1.02 / 2), abs=0.03)  # type: ignore[attr-defined]
    assert np.diag(update.belief.covariance)[0] < 0.2  # type: ignore[attr-defined]  # from 1.02, by R = 0.04


def test_every_method_and_module_is_found_by_name() -> None:
    assert all(isinstance(method, Method) for method in onboard.filters.methods().values())
    assert {"unscented", "gating"} <= {module.__name__.rsplit(".", 1)[1] for module in onboard.filters.modules()}
    with pytest.raises(AttributeError, match="no_such_filter"):
        onboard.filters.no_such_filter  # noqa: B018
    assert issubclass(FilterError, ValueError)


def test_two_methods_of_one_name_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from onboard.filters import unscented  # noqa: PLC0415

    monkeypatch.setattr(unscented, "METHODS", (*unscented.METHODS, unscented.METHODS[0]))
    with pytest.raises(ValueError, match="two filter methods are called 'unscented'"):
        onboard.filters.methods()


def test_importing_the_package_loads_no_compiler() -> None:
    code = "import sys, onboard.filters; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "False"
