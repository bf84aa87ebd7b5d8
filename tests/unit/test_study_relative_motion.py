"""The study of Oh & Johnson's paper: its figures of merit by hand, and that it runs to the end."""

import json
from pathlib import Path

import numpy as np
import pytest

from onboard.geometry.rotations import Array, matrix_from_euler
from onboard.studies import relative_motion as study
from onboard.studies._formation import FT, SHIPPED, TUNED, Track, track
from onboard.studies._formation_scores import Score, score, truth_of
from onboard.studies._relative_motion_report import HEADER, comparison_table, table
from onboard.studies._relative_motion_table import compare, make_row
from simlink.flight import Flight, fly
from simlink.scenario import load_scenario

SCENARIO = load_scenario("formation")


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(SCENARIO, seed=1, duration=20.0)


def a_track(flight: Flight, mean: Array, *, failed_at: float | None = None) -> Track:
    """A filter that said `mean` throughout, with unit covariance, NIS 3 and no image gated."""
    n, m = len(mean), len(flight.image_t)
    return Track(
        t=flight.nav_t,
        mean=mean,
        covariance=np.broadcast_to(np.eye(9), (n, 9, 9)),
        angles=np.full((m, 3), np.nan),
        innovation=np.zeros((m, 3)),
        nis=np.full(m, 3.0),
        fused=np.ones(m, dtype=bool),
        failed_at=failed_at,
    )


def test_the_truth_scores_nothing(flight: Flight) -> None:
    s = score(1, flight, a_track(flight, truth_of(flight)))
    assert (s.position_ft, s.velocity_ft_s, s.range_percent, s.a_lat_ft_s2, s.nees) == (0, 0, 0, 0, 0)
    assert s.nis == 3.0
    assert s.diverged is None
    assert s.a_lat_converged_s == 0.0


def test_errors_are_lengths_of_vectors_in_feet(flight: Flight) -> None:
    mean = truth_of(flight)
    mean[:, :3] += np.array([3.0, 4.0, 0.0]) * FT
    mean[:, 3:6] += np.array([0.0, 0.6, 0.8]) * FT
    mean[:, 6] *= 1.02
    mean[:, 7] -= 2.0 * FT
    s = score(1, flight, a_track(flight, mean))
    assert s.position_ft == pytest.approx(5.0)
    assert s.velocity_ft_s == pytest.approx(1.0)
    assert s.size_percent == pytest.approx(2.0)
    assert s.a_lat_ft_s2 == pytest.approx(2.0)
    squares = np.array([5.0, 1.0, 0.02 * flight.size / FT, 2.0]) * FT
    assert s.nees == pytest.approx(float(squares @ squares))
    assert s.a_lat_converged_s is None  # 2 of 8 ft/s^2 is a quarter


def test_errors_before_15_s_do_not_count(flight: Flight) -> None:
    mean = truth_of(flight)
    mean[flight.nav_t < 14.99] += 1e6
    assert score(1, flight, a_track(flight, mean)).position_ft == 0.0


@pytest.mark.parametrize(("factor", "verdict"), [(1.49, None), (1.51, "range"), (0.51, None), (0.49, "range")])
def test_half_the_range_off_is_diverged(flight: Flight, factor: float, verdict: str | None) -> None:
    mean = truth_of(flight)
    mean[:, :3] *= factor
    s = score(1, flight, a_track(flight, mean))
    assert s.diverged == verdict
    assert s.range_percent == pytest.approx(100 * abs(factor - 1))


@pytest.mark.parametrize(("degrees", "verdict"), [(4.9, None), (5.1, "bearing")])
def test_five_degrees_off_is_diverged(flight: Flight, degrees: float, verdict: str | None) -> None:
    mean = truth_of(flight)
    # about an axis across the sight line, so that the whole angle shows
    turn = matrix_from_euler(0.0, 0.0, np.radians(degrees))
    mean[:, 2] = 0.0
    flat = flight.nav_truth.r_FL_n.copy()
    flat[:, 2] = 0.0
    level = flight._replace(nav_truth=flight.nav_truth._replace(r_FL_n=flat))
    mean[:, :3] = flat @ turn.T
    assert score(1, level, a_track(level, mean)).diverged == verdict


def test_a_numerical_failure_is_diverged(flight: Flight) -> None:
    s = score(1, flight, a_track(flight, truth_of(flight), failed_at=12.0))
    assert s.diverged == "numerical failure at 12.00 s"


# ----------------------------------------------------------------------------------------- the table


def scores(flight: Flight) -> list[Score]:
    rows = []
    for k, feet in enumerate((3.0, 4.0, 900.0)):
        mean = truth_of(flight)
        mean[:, 0] += feet * FT
        rows.append(score(k, flight, a_track(flight, mean)))
    return rows


def test_rows_pool_squares_over_the_runs_that_did_not_diverge(flight: Flight) -> None:
    row = make_row("a", "paper", scores(flight))
    assert row.runs == 3
    assert row.diverged_percent == pytest.approx(100 / 3)
    assert row.diverged_why == ("range",)
    assert row.quantities["position_ft"].value == pytest.approx(12.5**0.5)
    assert row.position_m == pytest.approx(12.5**0.5 * FT)
    # squares 9 and 16: their mean is off by 3.5; that of a root is 1 / (2 root) of it
    assert row.quantities["position_ft"].standard_error == pytest.approx(3.5 / (2 * 12.5**0.5))


def test_comparisons_agree_within_two_standard_errors(flight: Flight) -> None:
    position = next(c for c in compare(make_row("a", "paper", scores(flight))) if c.quantity == "position_ft")
    assert position.reference == 2.72
    assert position.tolerance == pytest.approx(2 * 3.5 / (2 * 12.5**0.5) * (1 + 3 / 50) ** 0.5 + 0.005)
    assert position.agrees
    alike = make_row("a", "paper", [scores(flight)[1]] * 2)
    assert not next(c for c in compare(alike) if c.quantity == "position_ft").agrees


# ------------------------------------------------------------------------------------------ the runs


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> tuple[study.Result, Path, list[tuple[int, int]]]:
    out, calls = tmp_path_factory.mktemp("study"), []
    found = study.run(
        seeds=1, first_seed=3, jobs=1, out=out, progress=lambda done, total: calls.append((done, total))
    )
    return found, out, calls


def test_a_run_writes_report_figures_and_json_seed_3(
    result: tuple[study.Result, Path, list[tuple[int, int]]],
) -> None:
    found, out, calls = result
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert len(found.figures) == 8
    for name in found.figures:
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    document = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert document["seeds"] == 1
    report = (out / "report.md").read_text(encoding="utf-8")
    assert all(claim.claim in report for claim in found.claims)
    assert all(f"]({name})" in report for name in found.figures)
    assert {len(cells) for cells in table(found.rows)} == {len(HEADER)}
    assert len(comparison_table(found.comparisons)) == len(found.comparisons)


def test_the_settings_behave_as_the_reference_says_seed_3(
    result: tuple[study.Result, Path, list[tuple[int, int]]],
) -> None:
    """Bands wide enough for one flight; the fifty flights of the full study are compared by `compare`."""
    rows = {(row.variant, row.method): row for row in result[0].rows}
    values = {key: {n: q.value or np.nan for n, q in row.quantities.items()} for key, row in rows.items()}
    assert values["a", "paper"]["nees"] < 1.5  # far too cautious: 9 would be right
    assert values["a", "paper"]["nis"] == pytest.approx(0.0034, rel=0.3)
    assert 1.5 < values["a", "tuned"]["nis"] < 4.5
    assert values["a", "tuned"]["velocity_ft_s"] < 0.8 * values["a", "paper"]["velocity_ft_s"]
    assert values["a", "honest"]["nees"] < 30
    assert rows["e", "tuned"].diverged_percent == 100.0  # wrong blobs and no gate
    assert rows["e", "honest"].diverged_percent == 0.0
    verdicts = {claim.where: claim.verdict for claim in result[0].claims}
    assert verdicts["eq 54"] == "does not hold"


def test_processes_find_what_one_process_finds_seed_2() -> None:
    """The order of results and their bits do not depend on who computed them."""
    names, seeds = ["e"], [2]
    alone = [study.fly_one(*task) for task in zip(names, seeds, strict=True)]
    variant = next(v for v in study.VARIANTS if v.name == "e")
    together = list(study._map([(variant, 2)], 2))
    assert together == alone


def test_the_course_differs_between_seeds_and_only_the_course() -> None:
    one, two = (study.scenario_of(study.VARIANTS[0], seed) for seed in (1, 2))
    assert one.leader.course_deg != two.leader.course_deg
    assert study.scenario_of(study.VARIANTS[0], 1) == one
    assert one.camera == two.camera == SCENARIO.camera


@pytest.mark.parametrize(("seeds", "first"), [(0, 1), (1, -1)])
def test_no_seed_and_negative_seeds_are_refused(seeds: int, first: int) -> None:
    with pytest.raises(ValueError, match="seed"):
        study.run(seeds=seeds, first_seed=first)


# ----------------------------------------------------------------------------------------- the filter


def test_the_gate_holds_and_the_considered_size_stays_seed_1(flight: Flight) -> None:
    found = track(flight, SCENARIO.camera, SHIPPED)
    started = np.isfinite(found.mean[:, 6])
    assert np.ptp(found.mean[started, 6]) < 1e-9
    assert np.nanmax(found.nis[found.fused]) <= 16.27
    ungated = track(flight, SCENARIO.camera, TUNED)
    assert ungated.fused.sum() == np.isfinite(ungated.nis).sum() > 400


def test_cameras_that_the_study_does_not_know_are_refused(flight: Flight) -> None:
    tilted = load_scenario("formation").camera.__class__(mount_rpy_deg=(0.0, 15.0, 0.0))
    with pytest.raises(ValueError, match="straight ahead"):
        track(flight, tilted, TUNED)
    late = flight._replace(image_t=flight.image_t + 0.005)
    with pytest.raises(ValueError, match="navigation samples"):
        track(late, SCENARIO.camera, TUNED)
