"""The types of `onboard.filters`, whose names load when they are first asked for."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any

from onboard.filters.belief import Belief as Belief
from onboard.filters.belief import FilterError as FilterError
from onboard.filters.belief import Method as Method
from onboard.filters.belief import NotPositiveDefiniteError as NotPositiveDefiniteError
from onboard.filters.belief import Update as Update
from onboard.filters.estimation import expectation_maximisation as expectation_maximisation
from onboard.filters.estimation import maximum_likelihood as maximum_likelihood
from onboard.filters.families import method as method
from onboard.filters.mode_smoothing import smooth_modes as smooth_modes
from onboard.filters.particle_smoothing import smooth_particles as smooth_particles
from onboard.filters.runs import Run as Run
from onboard.filters.runs import log_likelihood as log_likelihood
from onboard.filters.runs import run as run
from onboard.filters.simulation import simulate as simulate
from onboard.filters.smoothers import smooth as smooth
from onboard.filters.state_space import LinearModel as LinearModel
from onboard.filters.state_space import Model as Model
from onboard.filters.state_space import Step as Step

def modules() -> Iterator[ModuleType]: ...
def methods() -> dict[str, Method]: ...
def __getattr__(name: str) -> Any: ...
