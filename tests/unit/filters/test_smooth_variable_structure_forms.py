"""What holds of every form of the smooth variable structure filter: angles, batches, what is refused."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import FilterError
from onboard.filters.kernels import variable_structure as kernel
from onboard.filters.smooth_variable_structure import LayerUpdate
from tests.support.filter_problems import identity, rows, spd, system


@pytest.mark.parametrize(
    "update",
    [
        svsf.update,
        partial(svsf.update, layer=np.array([0.5, 1.0])),
        svsf.update_variable,
        cubature_smooth.update,
        cubature_smooth.update_robust,
        cubature_smooth.update_adaptive,
    ],
)
def test_a_batch_is_a_loop_in_all_that_is_answered_seed_14(update: Callable[..., LayerUpdate]) -> None:
    rng = np.random.default_rng(14)
    _, H, _, _, _, _, _ = system(14)
    means, Ps, ys = (
        rng.normal(0, 1, (5, 4)),
        np.array([spd(rng, 4) for _ in range(5)]),
        rng.normal(0, 9, (3, 5, 2)),
    )
    R = 0.1 * spd(rng, 2)
    together = svsf.start(means, Ps)
    for y in ys:
        last = update(together, y, rows(H), R)
        together = last.belief
    for b in range(5):
        alone = svsf.start(means[b], Ps[b])
        for y in ys[:, b]:
            answer = update(alone, y, rows(H), R)
            alone = answer.belief
        for a, c in zip((*together, *last[1:]), (*alone, *answer[1:]), strict=True):
            np.testing.assert_allclose(a[b], c, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("update", "name"),
    [
        (partial(svsf.update, gamma=1.0), "gamma"),
        (partial(svsf.update, gamma=-0.1), "gamma"),
        (partial(svsf.update_variable, gamma=float("nan")), "gamma"),
        (partial(svsf.update, sigmas=-1.0), "sigmas"),
        (partial(cubature_smooth.update, kappa=float("nan")), "kappa"),
        (partial(svsf.update, layer=np.array([1.0, -1.0])), "layer"),
        (partial(svsf.update, layer=np.array([1.0])), "layer"),
        (partial(svsf.update, layer=np.array([1.0, np.nan])), "layer"),
        (partial(cubature_smooth.update_robust, patience=0), "patience"),
        (partial(cubature_smooth.update_adaptive, patience=0), "patience"),
        (partial(cubature_smooth.update_adaptive, fading=0.0), "fading"),
        (partial(cubature_smooth.update_adaptive, fading=float("nan")), "fading"),
    ],
)
def test_settings_are_refused_by_name(update: Callable[..., LayerUpdate], name: str) -> None:
    state = svsf.start(np.zeros(2), np.eye(2))
    with pytest.raises(FilterError, match=rf"\b{name}\b"):
        update(state, np.zeros(2), identity, np.eye(2))


@pytest.mark.parametrize(
    ("R", "layer"),
    [(np.tile(np.eye(2), (2, 1, 1)), None), (np.eye(2), np.ones((2, 2))), (np.eye(2), np.ones((3, 1)))],
)
def test_a_batch_of_another_size_is_refused(R: Array, layer: Array | None) -> None:
    state = svsf.start(np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)))
    with pytest.raises(FilterError, match=r"\blayer\b"):
        svsf.update(state, np.zeros((3, 2)), identity, R, layer=layer)


@pytest.mark.parametrize("e", [0.4, -0.02, 3.0])
def test_a_switched_step_is_whole_however_small_the_innovation(e: float) -> None:
    """Beyond its layer there is no other width than the innovation's own."""
    gamma, residual = 0.5, 0.01
    made = np.zeros((3, 1))
    outside = np.zeros(1, bool)
    tuning = kernel.Tuning(kernel.SWITCHED_LAYER_TYPE, gamma, 3.0, patience=1, weighted=True, fading=0.0)
    memory = kernel.LayerMemory(np.array([residual]), *np.zeros((3, 1)))
    steps = kernel.SwitchingSteps(made[0], outside, made[1], made[2])
    S = R = np.array([[1e-6]])
    kernel.decide_into(tuning, memory, np.array([e]), np.ones((1, 1)), S, R, np.zeros(0), steps)
    size = abs(e) + gamma * residual
    assert outside[0]
    assert made[1, 0] == pytest.approx(np.copysign(size, e))
    assert made[2, 0] == pytest.approx(min(size / abs(e), 1 + gamma))
