"""Estimators: a model, a filter and a policy; one file each, found by name.

`[estimator.NAME]` in the configuration runs `onboard/estimators/NAME.py`. To add one, write that file with

    LISTENS: Final = (TargetPoints,)                           # the messages it wants to be given
    class Config(Record, frozen=True, kw_only=True): ...       # its section's keys
    class Estimator:
        def __init__(self, config: Config, camera: Camera) -> None: ...

where Estimator does what the protocol below says. Nothing else needs to know of it.
"""

import pkgutil
from collections import Counter
from importlib import import_module
from types import ModuleType
from typing import Protocol, runtime_checkable

from onboard.messages import Estimate, Message
from onboard.ownship import Ownship


class EstimatorProtocol(Protocol):
    """What the pipeline asks of an estimator. Times are ns on the boot clock."""

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Take a message of a kind it listens for; an estimate for each target it was a measurement of."""

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """A new navigation sample has come: every target's estimate predicted to `ownship.now_ns`."""

    def reset(self, reason: str) -> None:
        """Forget the track: the time base or our own motion is no longer what it was."""


@runtime_checkable
class CountsVerdicts(Protocol):
    """An estimator of many targets, that takes more measurements than it tells of one by one."""

    @property
    def verdicts(self) -> Counter[str]:
        """What became of every measurement so far."""


def known() -> tuple[str, ...]:
    """Names of the estimators there are."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


def load(name: str) -> ModuleType:
    """The module of one estimator, with its `Config` and `Estimator`.

    Raises KeyError, naming those there are.
    """
    if name not in known():
        raise KeyError(f"no estimator named {name!r}; there are: {', '.join(known())}")
    return import_module(f"{__name__}.{name}")
