"""Chi-square thresholds and bounds against scipy.stats, and the normalised square by hand."""

import numpy as np
import pytest
from scipy.stats import chi2

from onboard.filters.gating import chi_square_threshold, mean_bounds, normalised_squared


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 6, 9, 450])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.95, 0.99, 0.999, 0.999999])
def test_threshold_is_the_quantile(probability: float, degrees: int) -> None:
    assert chi_square_threshold(probability, degrees) == pytest.approx(chi2.ppf(probability, degrees), rel=1e-10)


@pytest.mark.parametrize(("probability", "degrees"), [(0.0, 3), (1.0, 3), (1.5, 3), (np.nan, 3), (0.5, 0)])
def test_what_has_no_quantile_is_refused(probability: float, degrees: int) -> None:
    with pytest.raises(ValueError, match="no quantile"):
        chi_square_threshold(probability, degrees)


def test_thresholds_from_the_tables() -> None:
    assert chi_square_threshold(0.95, 1) == pytest.approx(3.841, abs=5e-4)
    assert chi_square_threshold(0.95, 3) == pytest.approx(7.815, abs=5e-4)
    assert chi_square_threshold(0.999, 3) == pytest.approx(16.266, abs=5e-4)


@pytest.mark.parametrize("samples", [1, 50, 3000])
def test_mean_bounds_are_those_of_the_sum(samples: int) -> None:
    low, high = mean_bounds(9, samples)
    assert low * samples == pytest.approx(chi2.ppf(0.025, 9 * samples), rel=1e-9)
    assert high * samples == pytest.approx(chi2.ppf(0.975, 9 * samples), rel=1e-9)
    assert low < 9 < high


def test_mean_bounds_of_nothing_are_not_numbers() -> None:
    assert np.isnan(mean_bounds(3, 0)).all()


def test_normalised_squared_of_one_and_of_many() -> None:
    P = np.array([[2.0, 1.0], [1.0, 2.0]])  # inverse [[2, -1], [-1, 2]] / 3
    assert float(normalised_squared([1.0, 0.0], P)) == pytest.approx(2 / 3, rel=1e-15)
    assert float(normalised_squared([1.0, 1.0], P)) == pytest.approx(2 / 3, rel=1e-15)
    assert float(normalised_squared([1.0, -1.0], P)) == pytest.approx(2.0, rel=1e-15)
    many = normalised_squared([[1.0, 0.0], [1.0, -1.0]], np.stack([P, P]))
    assert many == pytest.approx([2 / 3, 2.0], rel=1e-15)


def test_normalised_squared_is_infinite_where_nothing_is_unsure() -> None:
    P = np.array([[2.0, 1.0], [1.0, 2.0]])
    exact = np.array([[1.0, 1.0], [1.0, 1.0]])
    assert float(normalised_squared([1.0, -1.0], exact)) == np.inf
    assert normalised_squared([1.0, -1.0], np.stack([P, exact, P])) == pytest.approx([2.0, np.inf, 2.0])
    one_for_all = normalised_squared([[1.0, -1.0], [1.0, 0.0]], exact)
    assert one_for_all.shape == (2,)
    assert np.isinf(one_for_all).all()
    assert normalised_squared(np.ones((2, 3, 2)), np.broadcast_to(exact, (2, 3, 2, 2))).shape == (2, 3)
