"""Estimators: a model, a filter and a policy; one file or one folder each, found by name.

`[estimator.NAME]` in the configuration runs `onboard/estimators/NAME.py`. To add one, write that file with

    LISTENS: Final = (Exposure,)                               # the messages it receives
    class Config(Record, frozen=True, kw_only=True): ...       # its section's keys, checked in __post_init__
    class Estimator:
        def __init__(self, config: Config, camera: Camera) -> None: ...

where Estimator follows the protocol below. Nothing else needs to know of it. One that outgrows a file is a folder:
`Config` in `config.py`, which imports no numerics, the rest in `estimator.py`.
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
    """What the pipeline asks of an estimator. Times are ns on the boot clock."""

    def observe(self, message: Message, ownship: "Ownship") -> list[Estimate]:
        """Fuse a message of a kind it listens for; an estimate for each target that was measured."""

    def tick(self, ownship: "Ownship") -> list[Estimate]:
        """After a new navigation sample: the estimates that are due, predicted to `ownship.now_ns`."""

    def reset(self, why: Reason) -> None:
        """Forget everything: the time base or the origin of our own motion has changed."""


@runtime_checkable
class Listens(Protocol):
    """An estimator whose configuration decides what it listens for."""

    @property
    def listens(self) -> tuple[type[Message], ...]:
        """In place of its module's LISTENS."""


@runtime_checkable
class Withholds(Protocol):
    """An estimator that may leave out images of a camera that the health doubts."""

    def withholds(self, exposure: Exposure, doubts: Mapping[str, Reason]) -> Reason | None:
        """Why an exposure is not to be used, None if it is; `doubts`: what is wrong with a camera, by its name."""


@runtime_checkable
class StatesOwnMotion(Protocol):
    """An estimator of our own motion that may replace the autopilot's (`[ownship] source`)."""

    def own_motion_at(self, t_ns: int) -> "StatedMotion | None":
        """Our own motion at a time, by measurements until then; None where it is not valid."""


@runtime_checkable
class NamesModules(Protocol):
    """A configuration of an estimator that decides which further modules are loaded."""

    def named_modules(self) -> tuple[str, ...]:
        """The whole names of modules that no import of the estimator names, without loading any."""


@runtime_checkable
class CountsVerdicts(Protocol):
    """An estimator of many targets, which reports only some of its measurements one by one."""

    @property
    def verdicts(self) -> Counter[str]:
        """Verdicts on all measurements so far."""


def counted_verdicts(estimators: Mapping[str, EstimatorProtocol]) -> dict[str, int]:
    """What those estimators have counted that count their verdicts themselves, by estimator and verdict."""
    return {
        f"{name}.{verdict}": count
        for name, estimator in estimators.items()
        if isinstance(estimator, CountsVerdicts)
        for verdict, count in estimator.verdicts.items()
        if count
    }


@cache  # a folder is listed, and every parameter that is set asks
def known() -> tuple[str, ...]:
    """The names of all estimators."""
    found = (m.name for m in pkgutil.iter_modules(__path__))
    return tuple(sorted(name for name in found if name != KIT))


def config_type(name: str) -> type[Record]:
    """The record of an estimator's section, without loading its numerics where `config.py` keeps it apart.

    Raises KeyError, with the known names, for any other.
    """
    module = _module(name, "config")
    config: type[Record] = module.Config
    return config


def load(name: str) -> ModuleType:
    """The module of one estimator, with its `LISTENS` and `Estimator`.

    Raises KeyError, with the known names, for any other.
    """
    return _module(name, "estimator")


@cache
def module_name(name: str, part: str = "estimator") -> str:
    """The module that holds a part ("config" or "estimator") of an estimator: a file in its folder, or itself."""
    whole = f"{__name__}.{name}"
    found = find_spec(whole)
    return f"{whole}.{part}" if found is not None and found.submodule_search_locations is not None else whole


def flown_modules(name: str, section: Record) -> tuple[str, ...]:
    """The modules that an estimator with this configuration loads by their names: its own, and those that the
    configuration names."""
    return (module_name(name), *(section.named_modules() if isinstance(section, NamesModules) else ()))


def _module(name: str, part: str) -> ModuleType:
    if name not in known():
        raise KeyError(f"no estimator named {name!r}; there are: {', '.join(known())}")
    return import_module(module_name(name, part))
