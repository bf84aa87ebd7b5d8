"""Which echo is whose: candidates and assignment, against brute force."""

import math

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from onboard.filters import FilterError
from onboard.filters.association import assign, candidates


def problem(tracks: int, echoes: int, seed: int, size: float) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 1, (tracks, 3, 3)) * np.array([5.0, 0.01, 0.01])[:, None]
    spread = root @ root.transpose(0, 2, 1)
    polar = np.column_stack([rng.uniform(500, 500 + size, tracks), rng.uniform(-0.2, 0.2, (tracks, 2))])
    measured = np.column_stack([rng.uniform(500, 500 + size, echoes), rng.uniform(-0.2, 0.2, (echoes, 2))])
    return polar, spread, measured, np.tile([64.0, 1e-4, 1e-4], (echoes, 1))


@pytest.mark.parametrize(("tracks", "echoes", "size"), [(40, 50, 300.0), (1, 200, 50.0), (60, 3, 100.0)])
def test_candidates_are_all_pairs_within_the_gate(tracks: int, echoes: int, size: float) -> None:
    polar, spread, measured, variance = problem(tracks, echoes, 6, size)
    got = {
        (int(i), int(j)): c for i, j, c in zip(*candidates(polar, spread, measured, variance, 16.0), strict=True)
    }
    wanted = {}
    for i in range(tracks):
        for j in range(echoes):
            S, e = spread[i] + np.diag(variance[j]), measured[j] - polar[i]
            d2 = e @ np.linalg.solve(S, e)
            if d2 <= 16.0:
                wanted[i, j] = d2 + np.linalg.slogdet(S)[1]
    assert got.keys() == wanted.keys()
    assert len(wanted) > 3
    for pair, cost in wanted.items():
        assert got[pair] == pytest.approx(cost, rel=1e-9)


def test_azimuths_either_side_of_the_tail_are_near() -> None:
    polar, spread = np.array([[1000.0, math.pi - 0.001, 0.0]]), np.diag([25.0, 1e-5, 1e-5])[None]
    measured, variance = np.array([[1001.0, -math.pi + 0.001, 0.0]]), np.array([[64.0, 1e-4, 1e-4]])
    assert len(candidates(polar, spread, measured, variance, 16.0)[0]) == 1


@pytest.mark.parametrize("seed", range(8))
def test_the_assignment_is_that_of_the_whole_problem(seed: int) -> None:
    """Solved knot by knot it pairs as many, at the same cost, as solved at once."""
    tracks, echoes, costs = candidates(*problem(60, 60, seed, 250.0), gate=16.0)
    t, e = assign(tracks, echoes, costs)
    assert len(set(t.tolist())) == len(t) == len(set(e.tolist()))
    matrix = np.full((60, 60), 1e9)
    matrix[tracks, echoes] = costs
    row, column = linear_sum_assignment(matrix)
    allowed = matrix[row, column] < 1e9
    assert len(t) == allowed.sum() > 15
    assert matrix[t, e].sum() == pytest.approx(matrix[row, column][allowed].sum())


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e9, 1e16, 1e100, -1.0, -1e9, -1e16])
@pytest.mark.parametrize("offset", [0.0, 1e9, -1e9])
def test_costs_of_any_size_are_assigned(scale: float, offset: float) -> None:
    """Two pairs are more than one, whatever they cost; costs of 1e9 were taken for pairs outside of the gate."""
    tracks, echoes = np.array([0, 0, 1]), np.array([0, 1, 0])
    costs = offset + scale * np.array([1.0, 8.0, 8.0])
    t, e = assign(tracks, echoes, costs)
    assert sorted(zip(t.tolist(), e.tolist(), strict=True)) == [(0, 1), (1, 0)]
    whole = assign(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), scale * np.array([1.0, 5.0, 2.0, 3.0]))
    best = [(0, 0), (1, 1)] if scale > 0 else [(0, 1), (1, 0)]
    assert sorted(zip(*(a.tolist() for a in whole), strict=True)) == best


@pytest.mark.parametrize("cost", [np.nan, np.inf, -np.inf])
def test_a_cost_that_is_not_finite_is_refused(cost: float) -> None:
    with pytest.raises(FilterError, match="costs: not finite"):
        assign(np.array([0, 0, 1]), np.array([0, 1, 0]), np.array([1.0, cost, 2.0]))


def test_nothing_to_assign() -> None:
    nothing = np.zeros(0, np.int64)
    assert [len(a) for a in assign(nothing, nothing, np.zeros(0))] == [0, 0]
