"""Estimators: each is a model, a filter and a policy, in one file or one folder, found by name.

`[estimator.NAME]` in the configuration runs `onboard/estimators/NAME.py`. To add one, write that file with

    LISTENS: Final = (Exposure,)                               # the messages it receives
    class Config(Record, frozen=True, kw_only=True): ...       # its section's keys, checked in __post_init__
    class Estimator:
        def __init__(self, config: Config, camera: Camera) -> None: ...

where Estimator follows the protocol below. Nothing else refers to it. An estimator too large for a file is a
folder: `Config` in `config.py`, which imports no numerics, the rest in `estimator.py`.
"""

import pkgutil
from collections import Counter
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Final, Protocol, runtime_checkable

from onboard.messages import Estimate, Exposure, Message, Record
from onboard.messages.causes import Reason

if TYPE_CHECKING:  # it loads numerics, which reading a configuration need not
    from onboard.ownship import Ownship, StatedMotion

KIT: Final = "kit"  # what estimators share


class EstimatorProtocol(Protocol):
    """Interface between the pipeline and an estimator. Times are ns on the boot clock."""

    def observe(self, message: Message, ownship: "Ownship") -> list[Estimate]:
        """Fuse a message of a listed kind. Returns an estimate of each target that was measured."""

    def tick(self, ownship: "Ownship") -> list[Estimate]:
        """Process a new navigation sample.

        Returns the due estimates, predicted to `ownship.now_ns`.
        """

    def reset(self, why: Reason) -> None:
        """Forget everything: the time base or the origin of our own motion has changed."""


@runtime_checkable
class Listens(Protocol):
    """An estimator whose configuration decides which messages it receives."""

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """The messages it receives, instead of its module's LISTENS."""


@runtime_checkable
class Withholds(Protocol):
    """An estimator that may refuse images of a camera whose health is in doubt."""

    def withholds(self, exposure: Exposure, doubts: Mapping[str, Reason]) -> Reason | None:
        """Return why an exposure must not be used, or None.

        `doubts`: reasons to doubt a camera, by its name.
        """


@runtime_checkable
class StatesOwnMotion(Protocol):
    """An estimator of our own motion that may replace the autopilot's (`[ownship] source`)."""

    def own_motion_at(self, t_ns: int) -> "StatedMotion | None":
        """Return our own motion at a time, from measurements until then; None if it is not valid."""


@runtime_checkable
class CountsVerdicts(Protocol):
    """An estimator of many targets, which reports only some of its measurements one by one."""

    @property
    def verdicts(self) -> Counter[str]:
        """Counts of the verdicts on all measurements."""


def counted_verdicts(estimators: Mapping[str, EstimatorProtocol]) -> dict[str, int]:
    """Return the verdicts of estimators that count them themselves, by estimator and verdict."""
    return {
        f"{name}.{verdict}": count
        for name, estimator in estimators.items()
        if isinstance(estimator, CountsVerdicts)
        for verdict, count in estimator.verdicts.items()
        if count
    }


@cache  # a folder is listed, and every parameter that is set asks
def known() -> tuple[str, ...]:
    """Return the names of all estimators."""
    found = (m.name for m in pkgutil.iter_modules(__path__))
    return tuple(sorted(name for name in found if name != KIT))


def config_type(name: str) -> type[Record]:
    """Return the record of an estimator's section.

    It loads no numerics if there is a `config.py`. Raises KeyError, with the known names, for an unknown
    estimator.
    """
    module = _module(name, "config")
    config: type[Record] = module.Config
    return config


def load(name: str) -> ModuleType:
    """Return the module of an estimator, with its `LISTENS` and `Estimator`.

    Raises KeyError, with the known names, for an unknown estimator.
    """
    return _module(name, "estimator")


@cache
def module_name(name: str, part: str = "estimator") -> str:
    """Return the name of the module with a part ("config" or "estimator") of an estimator."""
    whole = f"{__name__}.{name}"
    found = find_spec(whole)
    return f"{whole}.{part}" if found is not None and found.submodule_search_locations is not None else whole


def _module(name: str, part: str) -> ModuleType:
    if name not in known():
        raise KeyError(f"no estimator named {name!r}; there are: {', '.join(known())}")
    return import_module(module_name(name, part))
