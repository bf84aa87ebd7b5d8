"""Any filter of `onboard.filters` under several sensors.

A smooth variable structure filter remembers, beside mean and covariance, the last residual of each measured
quantity and for how long it has been outside its layer. Of several sensors each has its own such memory, which
must not be another's: here it is taken out of the filter's state and put back by the name of the sensor.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from onboard.arrays import Array
from onboard.filters import methods
from onboard.filters.belief import Belief, Method, Rows, Update

BELIEF_FIELDS: Final = {"mean", "covariance", "factor", "model_error"}


class Filtered(NamedTuple):
    """A filter's state, and of each sensor what the filter remembers of it, and doubts by it."""

    state: Any
    memory: Mapping[str, Any]
    doubts: Mapping[str, Array]


class SensorFilter:
    """One method, called with the sensor's name. Holds nothing that changes."""

    def __init__(self, name: str) -> None:
        found = methods()
        if name not in found:
            raise ValueError(f"filter: there is none named {name!r}; there are: {', '.join(sorted(found))}")
        self._method: Method = found[name]

    def start(self, mean: Array, covariance: Array) -> Filtered:
        """A state that has seen no measurement."""
        return Filtered(self._method.start(mean, covariance), {}, {})

    def predict(self, filtered: Filtered, process: Rows, Q: Array) -> Filtered:
        """Time update. Raises FilterError, NotPositiveDefiniteError."""
        return filtered._replace(state=self._method.predict(filtered.state, process, Q))

    def update(
        self, filtered: Filtered, sensor: str, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]
    ) -> tuple[Filtered, Update]:
        """Measurement update. Raises FilterError, NotPositiveDefiniteError."""
        belief = self.belief(filtered)
        remembered = filtered.memory.get(sensor)
        if remembered is None:
            remembered = _memory(self._method.start(belief.mean, belief.covariance))
        state = _remembering(filtered.state, remembered)
        update = self._method.update(state, y, measure, R, angular)
        memory, after = {**filtered.memory, sensor: _memory(update.belief)}, update.belief
        if not hasattr(after, "model_error"):
            return Filtered(after, memory, {}), update
        doubts = {**filtered.doubts, sensor: after.model_error}
        return Filtered(after._replace(model_error=sum(doubts.values())), memory, doubts), update

    def belief(self, filtered: Filtered) -> Belief:
        """What the filter believes."""
        return self._method.belief(filtered.state)


def _memory(state: Any) -> Any:
    """What a state holds beside beliefs; of states within a state, of each."""
    fields = state._asdict()
    return {
        name: _memory(value) if hasattr(value, "_asdict") else value
        for name, value in fields.items()
        if name not in BELIEF_FIELDS
    }


def _remembering(state: Any, memory: Any) -> Any:
    """The state with a memory in place of its own."""
    return state._replace(
        **{
            name: _remembering(getattr(state, name), value) if isinstance(value, dict) else value
            for name, value in memory.items()
        }
    )
