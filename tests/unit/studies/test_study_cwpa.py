"""The study of the Wiener-acceleration tracker: golden numbers, the misprint, and that it runs to the end."""

import json
from pathlib import Path

import numpy as np
import pytest

from onboard.filters.discretisation import wiener_acceleration
from studies.csvsf_quadrotor import study as csvsf
from studies.cwpa_kalman_tracker_3d import runs, study
from studies.relative_motion import study as relative_motion
from studies.report import findings


def test_the_last_covariance_and_gain_are_golden() -> None:
    P, K = study.final()
    np.testing.assert_allclose(np.diag(P)[:3], [4.427842, 3.639966, 2.406474], atol=5e-7)
    np.testing.assert_allclose([K[0, 0], K[3, 0], K[6, 0]], [0.442784, 0.257108, 0.074647], atol=5e-7)


def test_the_paper_s_equations_are_the_package_s_filter() -> None:
    covariances, gains = runs.schedule(*wiener_acceleration(runs.DT, runs.DENSITY))
    P, K = study.final()
    np.testing.assert_allclose(covariances[-1], P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(gains[-1], K, rtol=1e-9, atol=1e-12)


def test_eq_14_is_not_what_eqs_5_and_7_give() -> None:
    right, fraction = wiener_acceleration(0.5, 0.2).Q, runs.fraction_noise(0.5, 0.2)
    np.testing.assert_allclose(right, fraction, rtol=0, atol=1e-15)
    assert np.abs(runs.printed_noise(0.5, 0.2) - fraction).max() > 0.05
    assert np.linalg.eigvalsh(runs.printed_noise(0.5, 0.2))[0] < 0 < np.linalg.eigvalsh(right)[0]


@pytest.mark.slow  # a few seeds of it are in test_study_all.py
def test_the_study_runs_and_its_checks_agree_seeds_1_to_30(tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    found = study.run(seeds=30, out=tmp_path, progress=lambda done, total: steps.append((done, total)))
    assert [c.name for c in found.checks if not c.agrees] == []
    assert all(m.proven for m in found.misprints)
    printed = found.tables[0].rows[2]
    assert printed[1] == printed[7] == "failed"  # eq 14's covariance is none: it has no error to rank by
    position, error = found.tables[0].rows[0][1:3]
    assert position == pytest.approx(found.tables[0].rows[0][6], rel=0.03)  # the bound
    assert error == pytest.approx(position / 600**0.5 / 5, rel=0.7)  # 600 runs of some 12 independent steps
    assert [c.verdict for c in found.claims] == ["holds", "does not hold", "holds", "does not hold"]
    assert steps[-1] == (3, 3)
    assert json.loads((tmp_path / "result.json").read_bytes())["study"] == study.NAME
    assert "does not hold" in (tmp_path / "report.md").read_text(encoding="utf-8")
    for name in found.figures:
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_checks_can_fail() -> None:
    assert not findings.near("x", "m", 1.2, 1.0, 0.1).agrees
    assert not findings.check("x", "m", float("nan")).agrees
    assert findings.check("x", "m", 3.0, high=3.0).agrees
    assert not findings.check("x", "m", 3.1, high=3.0).agrees


@pytest.mark.parametrize(("seeds", "first"), [(0, 1), (1, -1)])
def test_no_seed_and_negative_seeds_are_refused(seeds: int, first: int) -> None:
    for run in (study.run, csvsf.run, relative_motion.run):
        with pytest.raises(ValueError, match="seed"):
            run(seeds=seeds, first_seed=first)
