"""The configuration in a recording, as JSON.

It holds all values that affect estimates, defaults included, so that a replay reproduces the flight even if
defaults have changed since.
"""

from pathlib import Path
from typing import Any, Final

import msgspec

from onboard.config.sections import Config
from onboard.wire.logs.recording import CONFIGURATION, JSON, read_configuration

# of the computer that flew
EXCLUDED_SECTIONS: Final = frozenset({"zenoh", "router", "recorder", "parameters", "warm_start"})


def flight_metadata(config: Config) -> dict[str, dict[str, str]]:
    """Return the metadata of a recording that is made with a configuration."""
    flown = {name: section for name, section in config.table().items() if name not in EXCLUDED_SECTIONS}
    return {CONFIGURATION: {JSON: msgspec.json.encode(flown).decode()}}


def read_recorded(path: Path) -> dict[str, Any]:
    """Return the table that a recording holds, or an empty one for any other file."""
    try:
        text = read_configuration(path)
        table = None if text is None else msgspec.json.decode(text, type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        return {}
    return table or {}
