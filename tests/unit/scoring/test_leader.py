"""Scores of the leader's estimate, against errors made by hand."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Estimate, Lifecycle, MeasurementReport, Verdict
from onboard.models import relative_motion
from onboard.scoring.leader import LeaderScorer, score_leader
from onboard.scoring.reference import TRUTH_COLUMNS, Reference
from onboard.scoring.statistics import percentiles

S = 1_000_000_000
TRUE = (30.0, 40.0, 0.0, 1.0, 2.0, 3.0, 2.0, 0.5, -0.5)  # 50 m away
SIGMA = (1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.1, 0.2, 0.2)
COVARIANCE = tuple(tuple(s * s if i == j else 0.0 for j in range(9)) for i, s in enumerate(SIGMA))
CLOSE = {"rel": 1e-12}


def report(t: float, verdict: Verdict = Verdict.FUSED, nis: float | None = 3.0) -> MeasurementReport:
    t_ns = round(t * S)
    components = ("azimuth", "elevation", "subtended")
    return MeasurementReport(
        source="front", t_ns=t_ns, t_recv_ns=t_ns, verdict=verdict, components=components, nis=nis
    )


def estimate(t: float, error: tuple[float, ...] = (0.0,) * 9, *, valid: bool = True) -> Estimate:
    return Estimate(
        name="leader",
        target="leader",
        sequence=round(t * 100),
        t_ns=round(t * S),
        state=Lifecycle.TRACKING if valid else Lifecycle.LOST,
        valid=valid,
        reason="",
        frame="n",
        components=relative_motion.COMPONENTS,
        units=relative_motion.UNITS,
        mean=tuple(a + b for a, b in zip(TRUE, error, strict=True)),
        covariance=COVARIANCE,
        age=0.0,
        reset_count=0,
    )


def flight(error: tuple[float, ...] = (0.0,) * 9, begin: float = 40.0, end: float = 70.0) -> list[Estimate]:
    return [estimate(t, error) for t in np.arange(begin, end, 0.1)]


def reference(begin: float = 40.0, end: float = 70.0, step: float = 0.04) -> Reference:
    time = np.arange(begin, end, step)
    return Reference(time, tuple(TRUTH_COLUMNS.values()), np.tile(TRUE, (len(time), 1)))


def test_rms_of_constant_errors() -> None:
    """(0.3, 0.4, 0) m along the line of sight of 50 m is 1 % farther; 0.1 m of 2 m is 5 %."""
    s = score_leader(flight((0.3, 0.4, 0.0, 0.0, 3.0, 4.0, 0.1, 0.2, 0.0)), reference())
    assert s.position_rmse_m == pytest.approx(0.5, **CLOSE)
    assert s.velocity_rmse_m_s == pytest.approx(5.0, **CLOSE)
    assert s.range_error_rms_percent == pytest.approx(1.0, rel=1e-9)
    assert s.size_error_rms_percent == pytest.approx(5.0, rel=1e-9)
    nees = 0.3**2 + 0.4**2 + (3 / 0.5) ** 2 + (4 / 0.5) ** 2 + 1 + 1
    assert s.nees_mean == pytest.approx(nees, rel=1e-9)
    assert s.nees_dof == 9


def test_rms_is_over_the_settled_and_valid_only() -> None:
    """Errors of 3 m while settling, of 100 m where not valid; after it 3 m and 4 m half the time each."""
    estimates = []
    for i, t in enumerate(np.arange(40.0, 69.95, 0.1)):
        error = 3.0 if t < 55 - 1e-9 else (3.0, 4.0)[i % 2]
        estimates.append(estimate(t, (0.0, 0.0, error, *(0.0,) * 6)))
        estimates.append(estimate(t + 0.05, (100.0,) * 9, valid=False))
    s = score_leader(estimates, reference())
    assert s.scored == 150
    assert s.valid == 300
    assert s.estimates == 600
    assert s.position_rmse_m == pytest.approx(math.sqrt((9 + 16) / 2), rel=1e-9)


def test_truth_is_interpolated() -> None:
    moving = reference()
    values = moving.values.copy()
    values[:, 0] += 2.0 * (moving.time - 40.0)
    estimates = [estimate(t, (2.0 * (t - 40.0), *(0.0,) * 8)) for t in np.arange(40.013, 69.9, 0.1)]
    s = score_leader(estimates, Reference(moving.time, moving.components, values))
    assert s.position_rmse_m == pytest.approx(0.0, abs=1e-9)


def test_estimates_in_a_gap_of_the_truth_or_beyond_its_ends_are_not_scored() -> None:
    whole = reference()
    kept = (whole.time < 60) | (whole.time > 62)
    broken = Reference(whole.time[kept], whole.components, whole.values[kept])
    estimates = flight(end=80.0)
    for i, e in enumerate(estimates):
        if 60.01 < e.t_ns / S < 61.99 or e.t_ns / S > 70.01:
            estimates[i] = estimate(e.t_ns / S, (1000.0, *(0.0,) * 8))
    s = score_leader(estimates, broken)
    assert s.position_rmse_m == pytest.approx(0.0, abs=1e-9)
    assert s.diverged is False
    assert 120 <= s.scored <= 135


def test_truth_inside_the_ellipsoid_is_counted() -> None:
    """chi-square(3) at 95 % is 7.815: a distance of 2.79 sigma is inside, of 2.80 outside."""
    estimates = [
        estimate(t, (0.0, 0.0, (2.79, 2.80, 2.79, 2.79)[i % 4], *(0.0,) * 6))
        for i, t in enumerate(np.arange(55.0, 69.0, 0.1))
    ]
    assert score_leader(estimates, reference()).inside_95_percent == pytest.approx(75.0)


def test_nis_is_the_mean_over_fused_images_after_settling() -> None:
    estimates = flight()
    for i, e in enumerate(estimates):
        t = e.t_ns / S
        fused = (Verdict.FUSED, Verdict.FUSED_LATE)[i % 2]
        estimates[i] = replace(e, measurement=report(t, fused, 2.0 if t > 54.99 else 50.0))
    estimates.append(replace(estimate(69.0), measurement=report(69.0, Verdict.GATED, 400.0)))
    estimates.append(replace(estimate(69.1), measurement=report(69.1, Verdict.TOO_OLD, None)))
    s = score_leader(estimates, reference())
    assert s.images_scored == 150
    assert s.nis_mean == pytest.approx(2.0)
    assert s.nis_dof == 3
    assert s.verdicts == {"fused": 150, "fused_late": 150, "gated": 1, "too_old": 1}
    # chi-square of 450 degrees of freedom is nearly normal: mean 3, standard deviation sqrt(2 * 450) / 150
    low, high = s.nis_bounds or (0.0, 0.0)
    assert (low, high) == pytest.approx((3 - 1.96 * 0.2, 3 + 1.96 * 0.2), abs=0.02)


@pytest.mark.parametrize(
    ("factor", "bearing_deg", "diverged"),
    [(1.49, 0, False), (1.51, 0, True), (0.51, 0, False), (0.49, 0, True), (1, 4.9, False), (1, 5.1, True)],
)
def test_diverged_by_the_last_five_seconds(factor: float, bearing_deg: float, diverged: bool) -> None:
    angle = math.radians(bearing_deg)
    x, y = 30.0 * factor, 40.0 * factor
    there = (x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle))
    error = (there[0] - 30.0, there[1] - 40.0, *(0.0,) * 7)
    good, bad = flight(end=64.8), flight(error, begin=64.9)
    assert score_leader([*good, *bad], reference()).diverged is diverged
    # only those last five seconds count
    bad_first = flight(error, end=64.8)
    assert score_leader([*bad_first, *flight(begin=64.9)], reference()).diverged is False


def test_nothing_valid_is_diverged_but_only_against_a_truth() -> None:
    silent = [estimate(t, valid=False) for t in np.arange(40, 70, 0.1)]
    assert score_leader(silent, reference()).diverged is True
    assert score_leader([], reference()).diverged is True
    assert score_leader(silent, None).diverged is False
    assert score_leader(silent, reference()).range_error_rms_percent is None


def test_a_flight_shorter_than_the_time_to_settle_is_judged_but_not_scored() -> None:
    s = score_leader(flight(end=50.0), reference(end=50.0))
    assert (s.scored, s.diverged) == (0, False)
    assert s.position_rmse_m is None
    far = score_leader(flight((100.0, *(0.0,) * 8), end=50.0), reference(end=50.0))
    assert far.diverged is True


def test_percentiles() -> None:
    assert percentiles([]) == (None, None)
    assert percentiles([float(i) for i in range(101)]) == (50.0, 99.0)


def test_time_without_a_valid_estimate_stands_beside_the_errors() -> None:
    """Valid from 40 s to 60 s of 40 to 100 s, settled from 55 s on: 5 s of 45 s."""
    estimates = [estimate(t, valid=bool(t < 60.0)) for t in np.arange(40.0, 100.0, 0.1)]
    s = score_leader(estimates, reference(40.0, 100.0))
    assert s.valid_percent == pytest.approx(100 * 5.0 / 45.0, abs=0.5)
    assert s.range_error_rms_percent == 0.0
    assert s.diverged


@pytest.mark.parametrize(("since", "diverged"), [(67.4, True), (67.6, False)])
def test_no_valid_estimate_for_most_of_the_last_five_seconds_is_diverged(since: float, diverged: bool) -> None:
    estimates = [estimate(t, valid=bool(t < since - 0.5)) for t in np.arange(40.0, 70.0, 0.02)]
    estimates = [e for e in estimates if e.valid]  # the last one counts for half a second
    assert score_leader(estimates, reference()).diverged == diverged


@pytest.mark.parametrize(
    ("metres", "share"), [(3.2, 100.0), (-3.2, 100.0), (2.9, 0.0)]
)  # sigma of the range 1 m, 5 % are 2.5 m
def test_confidently_wrong_is_off_by_three_sigma_and_five_percent(metres: float, share: float) -> None:
    along = (0.6 * metres, 0.8 * metres, 0.0, *(0.0,) * 6)
    assert score_leader(flight(along), reference()).confidently_wrong_percent == share


def test_a_truth_that_goes_on_after_the_flight_counts_until_its_end() -> None:
    scorer = LeaderScorer(reference(end=130.0))
    for e in flight():
        scorer.add(e)
    to_the_end, whole = scorer.score(end=70.0), scorer.score()
    assert to_the_end.valid_percent == pytest.approx(100.0, abs=1.0)
    assert not to_the_end.diverged
    assert whole.valid_percent == pytest.approx(100 * 15.5 / 75.0, abs=1.0)
    assert whole.diverged
    assert to_the_end.position_rmse_m == whole.position_rmse_m


def test_after_a_reboot_on_the_ground_the_flight_s_time_goes_on() -> None:
    """The settle time counted by the first boot's clock: 0 % of a good flight were valid."""
    ground = [estimate(t, valid=False) for t in np.arange(500.0, 510.0, 0.1)]
    for begin in (5.0, 490.0, 504.0):
        flown = ground + flight(begin=begin, end=begin + 30.0)
        score = score_leader(flown, None)
        assert (score.valid, score.valid_percent) == (300, 100.0)
