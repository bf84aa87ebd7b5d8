"""The study of encounters: two families from flight to report, scores and verdicts on flights made up by hand."""

from pathlib import Path

import matplotlib
import msgspec
import numpy as np
import pytest

from simlink.encounters.encounter import make_encounter
from simlink.encounters.truth import at
from studies.encounters import flights as flown
from studies.encounters import study
from studies.encounters.assumptions import BROKEN
from studies.encounters.flights import (
    BOXES,
    CASES,
    GIMBALS,
    ON_WING,
    POINTS,
    POSES,
    Case,
    Flight,
    judged,
)
from studies.encounters.scores import is_wrong, ratio, score

STEPS = 200


def made(off: float = 0.0, sigma: float = 0.5, nees: float = 3.0, invalid: int = 0, bad: int = 0) -> Flight:
    """A flight at 20 m: its last `bad` estimates are off by `off` (m), the first `invalid` are not valid."""
    range_ = np.full(STEPS, 20.0)
    range_[STEPS - bad :] += off
    of_nees = np.full(STEPS, nees)
    of_nees[STEPS - bad :] = 100.0 if bad else nees
    sigmas = np.full(STEPS, sigma)
    for values in (range_, of_nees, sigmas):
        values[:invalid] = np.nan
    return Flight(np.linspace(5.0, 45.0, STEPS), np.full(STEPS, 20.0), range_, sigmas, of_nees)


def verdicts(changed: dict[Case, list[Flight]]) -> list[str]:
    every = {case: [made()] * 4 for case in CASES} | changed
    return [str(claim.verdict) for claim in study.findings(every, 1).claims]


def test_the_score_of_flights_made_up_by_hand() -> None:
    good = made(sigma=0.4)
    bad = made(off=2.0, sigma=0.4, invalid=100, bad=50)  # 10 %, 5 sigma
    found = score([good, bad])
    assert found.valid.percent == pytest.approx(75.0)
    assert found.inside.percent == pytest.approx(100.0 * 250 / 300)
    assert found.wrong.percent == pytest.approx(100.0 * 50 / 300)
    assert found.range_error.percent == pytest.approx(10.0 * np.sqrt(50 / 300))
    assert found.worst_flight == pytest.approx(10.0 * np.sqrt(0.5))
    assert found.median_flight == pytest.approx(0.5 * found.worst_flight)
    assert found.sigma == pytest.approx(2.0)


def test_what_follows_another_aircraft_is_wrong_seed_1() -> None:
    truth = make_encounter("two_cross", 1, 8.0).truth
    assert truth.other is not None
    t = np.array([6.0, 7.0, 7.5])
    at_leader, at_other = at(truth.t, truth.r_FL_n, t), at(truth.t, truth.other.r - truth.follower.r, t)
    rows = np.hstack([t[:, None], at_leader, np.zeros((3, 3)), np.tile((100.0**2 * np.eye(6)).ravel(), (3, 1))])
    rows[1:, 1:4] = at_other[1:]
    rows[2, 7:] = np.eye(6).ravel()
    found = judged(rows, truth)
    assert np.ravel(found.strays).tolist() == [False, False, True]  # the second is not sure that it is no leader
    assert is_wrong(found).tolist()[2] == 1.0


@pytest.mark.parametrize(
    ("off", "sigma", "wrong"), [(2.0, 0.5, 100.0), (-2.0, 0.5, 100.0), (0.9, 0.1, 0.0), (2.0, 0.7, 0.0)]
)
def test_confidently_wrong_is_off_by_three_sigma_and_five_percent(off: float, sigma: float, wrong: float) -> None:
    assert score([made(off=off, sigma=sigma, bad=STEPS)]).wrong.percent == wrong


def test_a_flight_without_a_valid_estimate_counts_against_availability_only() -> None:
    found = score([made(), made(invalid=STEPS)])
    assert (found.valid.percent, found.inside.percent, found.worst_flight) == (50.0, 100.0, 0.0)
    alone = score([made(invalid=STEPS)])
    assert alone.valid.percent == 0.0
    assert np.isnan([alone.inside.percent, alone.range_error.percent, alone.sigma]).all()


def test_the_error_of_a_share_is_its_scatter_over_flights_seed_3() -> None:
    rng = np.random.default_rng(3)
    hits = rng.binomial(1, 0.8, (4000, 40)).sum(axis=1)  # 4000 studies of 40 flights, each all in or all out
    shares = [ratio(x, np.ones(40)) for x in rng.binomial(1, 0.8, (2000, 40))]
    assert np.mean([s.error for s in shares]) == pytest.approx(100.0 * np.std(hits / 40), rel=0.05)
    assert np.isnan(ratio([1], [2]).error)


def test_good_flights_meet_every_requirement() -> None:
    assert verdicts({}) == ["holds"] * 8


@pytest.mark.parametrize(
    ("case", "flights", "which"),
    [
        (Case("hover"), [made(off=0.1, bad=30)] * 4, {0}),  # 85 % inside
        (Case("wander"), [made(off=3.0, nees=3.0, bad=4)] * 4, {1}),  # 2 % wrong
        (Case("crab"), [made(off=1.0, sigma=1.0, bad=STEPS)._replace(nees=np.ones(STEPS))] * 4, {2}),  # 5 %
        (Case("hover", ON_WING), [made(off=1.4, sigma=2.0, bad=STEPS)] * 4, {2}),  # 7 %; not among the defaults
        (Case("behind"), [made(invalid=30)] * 4, {3}),  # 85 % valid
        (BOXES[0], [made(off=0.1, bad=17)] * 4, {4}),  # 91.5 % inside; not among the defaults
        (POINTS[0], [made(off=0.2, bad=STEPS)] * 4, {5}),  # 1 %, where the wing alone has none
        (POSES[0], [made(off=0.1, bad=17)] * 4, {6}),  # 91.5 % inside
        (POSES[0], [made(off=2.0, bad=3)] * 4, {6}),  # 1.5 % wrong
        (GIMBALS[0], [made(off=0.2, bad=STEPS)] * 4, {7}),  # 1 %, where a fixed camera has none
    ],
)
def test_bad_flights_fail_their_requirement(case: Case, flights: list[Flight], which: set[int]) -> None:
    found = verdicts({case: flights})
    assert {k for k, verdict in enumerate(found) if verdict == "does not hold"} == which
    assert {k for k, verdict in enumerate(found) if verdict == "holds"} == set(range(8)) - which


def test_a_miss_within_the_error_of_sampling_is_reported_so() -> None:
    one_in_four = [made()] * 3 + [made(off=0.1, bad=120)]  # 85 ± 15 % inside
    assert verdicts({Case("hover"): one_in_four}) == ["holds only if", *["holds"] * 7]


def test_estimates_are_judged_beside_the_truth_at_their_own_times_seed_1() -> None:
    truth = make_encounter("crossing", 1, 8.0).truth
    t = np.array([1.0, 5.5, 6.2504, 7.9, 8.1])
    r = at(truth.t, truth.r_FL_n, t)
    v = at(truth.t, truth.v_FL_n, t)
    off = np.array([0.0, 3.0, 0.0])
    P = np.diag([4.0, 4.0, 4.0, 1.0, 1.0, 1.0])
    rows = np.hstack([t[:, None], 1.1 * r, v + off, np.tile(P.ravel(), (5, 1))])
    rows[2, 1:] = np.nan
    found = judged(rows, truth)
    distance = np.linalg.norm(r, axis=1)[1:4]
    assert np.allclose(found.t, t[1:4])  # from 5 s to the encounter's end
    assert np.allclose(found.distance, distance)
    assert np.isnan(found.range_).tolist() == np.isnan(found.nees).tolist() == [False, True, False]
    assert np.allclose(found.range_[[0, 2]], 1.1 * distance[[0, 2]])
    assert np.allclose(found.sigma[[0, 2]], 2.0)
    assert np.allclose(found.nees[[0, 2]], (0.1 * distance[[0, 2]]) ** 2 / 4.0)
    assert np.allclose(found.velocity_nees[[0, 2]], 9.0)
    assert np.isnan(found.manoeuvre)
    after = judged(rows, truth, 6.0).after
    assert after.t.tolist() == found.t[1:].tolist()
    assert np.array_equal(after.velocity_nees, found.velocity_nees[1:], equal_nan=True)


def test_only_what_follows_a_manoeuvre_decides_what_is_required_of_it() -> None:
    """Of the 40 estimates in the 8 s after a manoeuvre, 37.2 must be inside, and 0.8 may be beyond."""

    def flown_so(wrong: slice, nees: float, off: float = 0.0) -> list[str]:
        flight = made()._replace(velocity_nees=np.ones(STEPS), manoeuvre=20.0)
        flight.velocity_nees[wrong] = nees
        flight.range_[wrong] += off
        findings = study.findings({Case("stops"): [flight] * 3}, 1)
        return [c.name for c in findings.checks if "after" in c.name and not c.agrees]

    after = np.flatnonzero((made().t >= 20.0) & (made().t <= 28.0))
    assert len(after) == 40
    assert flown_so(slice(after[0], after[0] + 2), 10.0) == []
    assert flown_so(slice(after[0], after[0] + 3), 10.0) == ["velocity inside after the manoeuvre, stops"]
    assert flown_so(slice(0, after[0]), 10.0) == []
    assert flown_so(slice(after[0], after[0] + 1), 15.0) == ["velocity beyond after the manoeuvre, stops"]
    assert flown_so(slice(after[0], after[0] + 1), 1.0, 2.0) == ["range beyond 3 sigma after the manoeuvre, stops"]


def test_parts_of_the_study_are_chosen_by_the_names_of_cases() -> None:
    part = study.options(None, "leaves_hover,hover_five_points", departures=False)
    assert [case.name for case in part["cases"]] == ["leaves hover", "hover, five points"]
    assert (part["compared"], part["broken"]) == (0, 0)
    astray = study.options(3, "hover", departures=True)
    assert (astray["cases"], astray["broken"]) == ((), 3)
    assert {case.family for case in astray["departures"]} == {"hover"}
    assert len(study.options(3, None, departures=True)["departures"]) == len(BROKEN)
    with pytest.raises(ValueError, match="no case 'upside_down'; there are: behind, hover"):
        study.options(None, "hover,upside_down", departures=False)


def test_two_families_fly_and_are_reported_seed_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flown, "DURATION_S", 8.0)
    monkeypatch.setitem(matplotlib.rcParams, "savefig.dpi", 20)
    cases = (Case("behind"), Case("circling", ON_WING))
    found = study.run(1, 1, 1, tmp_path, cases=cases)
    assert msgspec.json.decode((tmp_path / "result.json").read_bytes())["first_seed"] == 1
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "| behind | 1 |" in report
    assert "| circling, center on wing | 1 |" in report
    assert found.figures == ("ranges.png",)
    assert (tmp_path / "ranges.png").stat().st_size > 2000
    row = dict(zip(found.tables[0].header, found.tables[0].rows[0], strict=False))
    assert float(row["valid %"] or 0) > 90.0
    assert 0.1 < float(row["range error %"] or 0) < 10.0
    assert [c.name for c in found.checks if "valid" in c.name] == [
        "valid, behind",
        "valid, circling, center on wing",
    ]
