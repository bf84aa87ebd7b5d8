"""The sense-and-avoid study with few runs: every misprint, the reference's numbers, claims judged."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from onboard.filters.discretisation import van_loan
from simlink.sensors import gnss
from studies.joseph_srukf_sense_and_avoid import runs, scenes, study
from studies.joseph_srukf_sense_and_avoid.misprints import models
from studies.report.findings import Findings, Misprint


@pytest.mark.parametrize("formula", study.FORMULAS, ids=lambda f: f.__name__)
def test_the_printed_form_fails_and_the_right_one_holds(formula: Callable[[], Misprint]) -> None:
    found = formula()
    assert found.proven
    assert found.printed_value is not None
    assert found.right_value is not None
    assert abs(found.printed_value - found.right_value) > 1e-5
    assert found.printed != found.right


def test_all_17_known_misprints_are_there() -> None:
    assert len({f.__name__ for f in study.FORMULAS}) == 17


def test_corrected_closed_forms_cancel_where_van_loan_does_not() -> None:
    """Why the model uses the integral: alpha -> 0."""
    w, a, dt = 0.2, 1e-7, 0.1
    A = np.array([[0.0, 1, 0], [0, 0, 1], [0, -(a * a + w * w), -2 * a]])
    right = van_loan(A, np.diag([0.0, 0.0, 1.0]), dt).Q
    assert np.linalg.eigvalsh(right)[0] > 0
    assert right[0, 0] == pytest.approx(dt**5 / 20, rel=1e-3)
    assert abs(models.corrected_q1(w, a, dt)[0, 0] / right[0, 0] - 1) > 0.1


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Findings, Path]:
    out = tmp_path_factory.mktemp("avoid")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "MIN_SEED_COUNT", 1)
        return study.run(seeds=8, first_seed=200, jobs=1, out=out), out


@pytest.mark.slow
def test_the_reference_s_numbers_seeds_200_to_207(found: tuple[Findings, Path]) -> None:
    """20 runs of the validation, 8 of radar and GNSS: wider than the full study's tolerance where it scatters."""
    ours = {c.name: c for c in found[0].checks}
    wide = {"validation: position RMSE, UKF", "validation: position RMSE, Joseph"}
    scattered = {
        "α as printed: share diverged",
        "20 km: NEES of Joseph over UKF",
        "20 km: first position, UKF",
        "eqs 21, 22 as printed: share diverged",
    }
    assert ours["eqs 21, 22 as printed: share diverged"].ours > 0.7
    assert ours["20 km: first position, UKF"].ours > 4 * ours["20 km: first position, iterated"].ours
    for name in wide:
        assert ours[name].ours == pytest.approx(88.8, abs=9)
    assert [n for n, c in ours.items() if not c.agrees and n not in wide | scattered] == []


@pytest.mark.slow
def test_written_files_can_be_read_seeds_200_to_207(found: tuple[Findings, Path]) -> None:
    written = json.loads((found[1] / "result.json").read_bytes())
    assert len(written["misprints"]) == 19
    assert len(written["figures"]) == 10
    assert all((found[1] / name).read_bytes().startswith(b"\x89PNG") for name in written["figures"])
    report = (found[1] / "report.md").read_text(encoding="utf-8")
    assert "NOT PROVEN" not in report
    assert "nan" not in report


def test_both_filters_agree_but_for_rounding_seeds_1_to_3() -> None:
    assert runs.fly_validation(range(1, 4)).gap < 1e-8


def test_the_receiver_s_sigmas_stay_with_the_degraded_clock() -> None:
    fixes = [f for f in scenes.receptions(range(1))[0].fixes if isinstance(f, gnss.Fix)]
    sigmas = np.array([f.sigma[0] for f in fixes])
    assert sigmas.max() < 6
