"""The tunable keys of the configuration as MAVLink parameters.

A value is checked as in the configuration file, stored, and used from the next start, since an estimator whose
settings change in flight would lose its track.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from onboard.autopilot.requests import stamp
from onboard.config import Config, ConfigError, Storing, parse_config, read_stored
from onboard.messages import Message, ParamAck, ParamAction, ParamRequest, ParamValue
from onboard.wire.mavlink.parameters import decimal

KEYS: Final[Mapping[str, tuple[str, float]]] = {  # name (at most 16 characters) -> key, value if unset
    "LDR_SIZE_M": ("estimator.leader.size_prior_m", math.nan),
    "LDR_SIZE_SIG_M": ("estimator.leader.size_prior_sigma_m", math.nan),
    "OWN_TILT_DEG": ("ownship.errors.tilt_sigma_deg", math.nan),
    "OWN_YAW_DEG": ("ownship.errors.yaw_sigma_deg", math.nan),
    "OWN_VEL_M_S": ("ownship.errors.velocity_sigma_m_s", math.nan),
    "LDR_DELAY_SIG_S": ("estimator.leader.delay_sigma_s", math.nan),
    "LDR_VALID_S": ("estimator.leader.validity_timeout_s", math.nan),
    "CAM_F_PX": ("camera.f_px", math.nan),
    "CAM_SIGMA_PX": ("camera.sigma_px", math.nan),
    "CAM_ROLL_DEG": ("camera.mount_rpy_deg.0", math.nan),
    "CAM_PITCH_DEG": ("camera.mount_rpy_deg.1", math.nan),
    "CAM_YAW_DEG": ("camera.mount_rpy_deg.2", math.nan),
    "CAM_X_M": ("camera.mount_offset_m.0", math.nan),
    "CAM_Y_M": ("camera.mount_offset_m.1", math.nan),
    "CAM_Z_M": ("camera.mount_offset_m.2", math.nan),
    "CAM_DELAY_S": ("delay.camera_s", 0.0),
}
SIZE_SHARE: Final = 0.02  # sigma over size of a leader, if unset

Store = Callable[[dict[str, Any]], None]


class Parameters:
    """Values of the parameters at the next start.

    `store` saves the table of all keys that were set, or raises OSError; without it parameters are read-only.
    `stored`: the table of an earlier run."""

    def __init__(self, config: Config, store: Store | None = None, stored: dict[str, Any] | None = None) -> None:
        self._table: dict[str, Any] = config.table()
        self._store = store
        self._changed = stored or {}
        leader = self._table["estimator"].get("leader", {})
        if leader and leader.get("size_prior_sigma_m") is None:
            leader["size_prior_sigma_m"] = SIZE_SHARE * leader["size_prior_m"]
        self.names = tuple(name for name in KEYS if _has_key(self._table, KEYS[name][0]))

    def value(self, name: str) -> float:
        """Return the value of a parameter. Raises KeyError."""
        key, unset = KEYS[name]
        value: Any = self._table
        for part in key.split("."):
            value = value[int(part)] if isinstance(value, list | tuple) else value[part]
        return unset if value is None else float(value)

    def answer(self, request: ParamRequest, now_ns: int) -> tuple[list[Message], str]:
        """Answer a request. Returns the messages, and why a value was refused, or ""."""
        if request.action is ParamAction.LIST:
            return [self._value_of(name, request, now_ns) for name in self.names], ""
        name = request.name
        if 0 <= request.index < len(self.names) and request.action is ParamAction.READ:
            name = self.names[request.index]
        if name not in self.names:
            return [], ""
        if request.action is ParamAction.READ:
            return [self._value_of(name, request, now_ns)], ""
        reason = self.set(name, request.value)
        if request.extended:
            return [ParamAck(**stamp(now_ns), name=name, value=self.value(name), accepted=not reason)], reason
        return [self._value_of(name, request, now_ns)], reason

    def _value_of(self, name: str, request: ParamRequest, now_ns: int) -> ParamValue:
        return ParamValue(
            **stamp(now_ns),
            extended=request.extended,
            name=name,
            value=self.value(name),
            count=len(self.names),
            index=self.names.index(name),
        )

    def set(self, name: str, value: float | None) -> str:
        """Check and store a value. Returns why it was refused, or ""."""
        if self._store is None:
            return f"{name} is read-only: set `parameters.path`"
        if value is None or not math.isfinite(value):
            return f"{name} = {value}: expected a finite number"
        rounded = float(decimal(value))
        changed = _set_value(self._table, KEYS[name][0], rounded)
        try:
            parse_config(changed)
        except ConfigError as error:
            _, _, reason = str(error).partition(
                ": "
            )  # without the key, since the sender knows the parameter's name
            return f"{name} = {rounded:g}: {reason}"
        stored_keys = _copy_key(self._changed, changed, KEYS[name][0])
        try:
            self._store(stored_keys)
        except OSError as error:
            return f"{name} cannot be stored: {error.strerror}"
        self._table, self._changed = changed, stored_keys
        return ""


def _has_key(table: Any, key: str) -> bool:
    head, _, rest = key.partition(".")
    if isinstance(table, list | tuple):
        return int(head) < len(table)
    return head in table and (not rest or _has_key(table[head], rest))


def _set_value(table: Any, key: str, value: float) -> Any:
    """Return a copy of a table with one value changed."""
    head, _, rest = key.partition(".")
    if isinstance(table, list | tuple):
        return [value if i == int(head) else x for i, x in enumerate(table)]
    return {**table, head: _set_value(table[head], rest, value) if rest else value}


def _copy_key(stored_keys: dict[str, Any], table: dict[str, Any], key: str) -> dict[str, Any]:
    """Return `stored_keys` with a key's value of a table; an array is copied as a whole."""
    head, _, rest = key.partition(".")
    if not rest or not isinstance(table[head], dict):
        return {**stored_keys, head: table[head]}
    return {**stored_keys, head: _copy_key(stored_keys.get(head, {}), table[head], rest)}


def stored_parameters(config: Config, storing: Storing | None) -> Parameters:
    """Make the parameters, with what was stored before. Raises ConfigError."""
    if storing is None or config.parameters.path is None:
        return Parameters(config)
    return Parameters(config, storing.put, read_stored(Path(config.parameters.path)))
