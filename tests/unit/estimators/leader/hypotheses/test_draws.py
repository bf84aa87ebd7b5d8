"""The random numbers of the particles: fixed, uniform, normal, and not alike from one draw to the next."""

import numpy as np
import pytest
from scipy import stats

from onboard.estimators.leader.hypotheses import draws
from onboard.estimators.leader.hypotheses.draws import normal, uniform

MASK = 2**64 - 1


def splitmix(seed: int) -> int:
    """The output function of splitmix64, in Python's integers."""
    z = seed * 0x9E3779B97F4A7C15 & MASK
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & MASK
    z = (z ^ z >> 27) * 0x94D049BB133111EB & MASK
    return z ^ z >> 31


@pytest.mark.parametrize("draw", [0, 1, 12345678901])
def test_uniform_numbers_are_those_of_splitmix(draw: int) -> None:
    expected = [((splitmix(k + draw * 0x632BE59BD9B4E019 & MASK) >> 11) + 0.5) * 2.0**-53 for k in range(1, 9)]
    assert uniform(draw, 8) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("draw", [3, 4_000_000])
def test_numbers_have_their_distribution_and_depend_on_the_draw(draw: int) -> None:
    assert stats.kstest(uniform(draw, 20_000), "uniform").pvalue > 1e-3
    assert stats.kstest(normal(draw, 20_000), "norm").pvalue > 1e-3
    assert abs(np.corrcoef(uniform(draw, 20_000), uniform(draw + 1, 20_000))[0, 1]) < 0.03
    assert np.array_equal(normal(draw, 5), normal(draw, 10)[:5])


def test_no_number_is_drawn_for_two_ends_in_two_steps() -> None:
    uniform_ones = {"OF_TURNING", "OF_REGIME", "OF_RESAMPLED_HEADING", "OF_HEADING", "OF_TYING", "OF_ACCEPTANCE"}
    streams = {k: v for k, v in vars(draws).items() if k.startswith("OF_") and not k.startswith("OF_FIRST")}
    del streams["OF_INTENSITIES"]  # three of them
    assert uniform_ones < set(streams)
    of_step = [int(n) + k for name, n in streams.items() for k in range(1 if name in uniform_ones else 2)]
    taken = [first + n for first in (4, 4 + draws.STREAMS_PER_STEP) for n in of_step]
    assert len(set(taken)) == len(taken)
