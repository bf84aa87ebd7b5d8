"""Our own motion by an estimator of our own state, where it may replace the autopilot's."""

from collections.abc import Callable, Mapping

from onboard.config.sections import OwnshipConfig
from onboard.estimators import EstimatorProtocol, StatesOwnMotion
from onboard.messages import Attitude, GlobalPosition, LocalPosition, Message
from onboard.ownship import Ownship, StatedMotion

STATES: tuple[type[Message], ...] = (Attitude, LocalPosition, GlobalPosition)  # the autopilot's own motion


class OwnMotionSource:
    """The source that `[ownship] source` names. `on_error` gets the estimator's name and its exception."""

    def __init__(
        self,
        config: OwnshipConfig,
        estimators: Mapping[str, EstimatorProtocol],
        on_error: Callable[[str, Exception], None],
    ) -> None:
        self._config, self._on_error = config, on_error
        stating = [(name, e) for name, e in estimators.items() if isinstance(e, StatesOwnMotion)]
        self._stating = stating[:1] if config.source != "autopilot" else []

    def begin(self) -> Ownship:
        """Our own motion before any message."""
        return Ownship(max_extrapolation=self._config.max_extrapolation_s, source=self._config.source)

    def at(self, message: Message) -> StatedMotion | None:
        """The estimator's own motion at the time of a message that states the autopilot's; None without one."""
        if not isinstance(message, STATES):
            return None
        for name, estimator in self._stating:
            try:
                return estimator.own_motion_at(message.t_ns)
            except Exception as error:  # of any kind: the autopilot's own motion is there
                self._on_error(name, error)
        return None
