"""Adapter of any filter of `onboard.filters` to several sensors.

A smooth variable structure filter keeps, besides mean and covariance, the last residual of each measured quantity
and how long it has been outside its layer. Each sensor needs a memory of its own: it is taken out of the filter's
state after an update, and put back, by the sensor's name, before the next.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from onboard.arrays import Array
from onboard.filters.belief import Belief, Method, Rows, Update
from onboard.filters.families import method

BELIEF_FIELDS: Final = {"mean", "covariance", "factor", "model_error"}


class FilterState(NamedTuple):
    """A filter's state and its memory of each sensor.

    Attributes
    ----------
    state
        The filter's own state.
    memories
        The filter's memory, by sensor.
    model_errors
        Covariance of the model error that the filter has detected but does not follow, by sensor.
    """

    state: Any
    memories: Mapping[str, Any]
    model_errors: Mapping[str, Array]


class SensorFilter:
    """A stateless filter of `onboard.filters`, called with the sensor's name.

    Only the named filter is loaded.
    """

    def __init__(self, name: str) -> None:
        self._method: Method = method(name)

    def start(self, mean: Array, covariance: Array) -> FilterState:
        """Return a state before any measurement."""
        return FilterState(self._method.start(mean, covariance), {}, {})

    def predict(self, filtered: FilterState, process: Rows, Q: Array) -> FilterState:
        """Time update. Raises FilterError, NotPositiveDefiniteError."""
        state, memories, model_errors = filtered
        return FilterState(self._method.predict(state, process, Q), memories, model_errors)

    def update(
        self, filtered: FilterState, sensor: str, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]
    ) -> tuple[FilterState, Update]:
        """Measurement update. Raises FilterError, NotPositiveDefiniteError."""
        memory = filtered.memories.get(sensor)
        if memory is None:
            belief = self.belief(filtered)
            memory = _memory(self._method.start(belief.mean, belief.covariance))
        state = _with_memory(filtered.state, memory)
        update = self._method.update(state, y, measure, R, angular)
        memories, after = {**filtered.memories, sensor: _memory(update.belief)}, update.belief
        if not hasattr(after, "model_error"):
            return FilterState(after, memories, {}), update
        errors = {**filtered.model_errors, sensor: after.model_error}
        return FilterState(after._replace(model_error=sum(errors.values())), memories, errors), update

    def belief(self, filtered: FilterState) -> Belief:
        """Return the filter's mean and covariance."""
        return self._method.belief(filtered.state)


def _memory(state: Any) -> Any:
    """Return a state's fields outside its belief, also those of nested states."""
    fields = state._asdict()
    return {
        name: _memory(value) if hasattr(value, "_asdict") else value
        for name, value in fields.items()
        if name not in BELIEF_FIELDS
    }


def _with_memory(state: Any, memory: Any) -> Any:
    """Return the state with another memory."""
    return state._replace(
        **{
            name: _with_memory(getattr(state, name), value) if isinstance(value, dict) else value
            for name, value in memory.items()
        }
    )
