"""The types of `onboard.filters`, whose names load when they are first asked for."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any

from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError, Update
from onboard.filters.estimation import expectation_maximisation, maximum_likelihood
from onboard.filters.families import method
from onboard.filters.mode_smoothing import smooth_modes
from onboard.filters.particle_smoothing import smooth_particles
from onboard.filters.runs import Run, log_likelihood, run
from onboard.filters.simulation import simulate
from onboard.filters.smoothers import smooth
from onboard.filters.state_space import LinearModel, Model, Step

__all__ = [
    "Belief",
    "FilterError",
    "LinearModel",
    "Method",
    "Model",
    "NotPositiveDefiniteError",
    "Run",
    "Step",
    "Update",
    "expectation_maximisation",
    "log_likelihood",
    "maximum_likelihood",
    "method",
    "methods",
    "modules",
    "run",
    "simulate",
    "smooth",
    "smooth_modes",
    "smooth_particles",
]

def modules() -> Iterator[ModuleType]: ...
def methods() -> dict[str, Method]: ...
def __getattr__(name: str) -> Any: ...
