"""What holds of every form of the smooth variable structure filter: angles, batches, what is refused."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from onboard.filters import cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import FilterError
from onboard.filters.kernels import variable_structure as kernel
from onboard.filters.smooth_variable_structure import LayerUpdate
from tests.support.filter_problems import identity


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
