"""The configuration in a recording, as JSON: all values that affect estimates, defaults included, so that a replay
reproduces the flight even if defaults have changed since."""

from pathlib import Path
from typing import Any, Final

import msgspec

from onboard.config.sections import Config
from onboard.wire.logs.recording import CONFIGURATION, JSON, read_configuration

# of the computer that flew
LEFT_OUT: Final = frozenset({"zenoh", "router", "recorder", "parameters", "warm_start"})


def of_flight(config: Config) -> dict[str, dict[str, str]]:
    """The metadata of a recording that is made with a configuration."""
    table = msgspec.to_builtins(config)
    flown = {name: section for name, section in table.items() if name not in LEFT_OUT}
    return {CONFIGURATION: {JSON: msgspec.json.encode(flown).decode()}}


def read_recorded(path: Path) -> dict[str, Any]:
    """The table that a recording holds; an empty one for any other file, and for a recording without one."""
    try:
        text = read_configuration(path)
        table = None if text is None else msgspec.json.decode(text, type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        return {}
    return table or {}
