"""The tunable keys of the configuration as MAVLink parameters. Sans-IO: what is to be stored is returned as text.

A value is checked as one of the configuration file is. It is stored, and holds from the next start: an estimator
whose settings change in flight would lose its track.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from onboard.autopilot.requests import stamp
from onboard.config import Config, ConfigError, Storing, parse_config, read_stored
from onboard.messages import Message, ParamAck, ParamAction, ParamRequest, ParamValue
from onboard.wire.mavlink.parameters import decimal

KEYS: Final[Mapping[str, tuple[str, float]]] = {  # name, at most 16 characters -> key, value if it is not set
    "LDR_SIZE_M": ("estimator.leader.size_prior_m", math.nan),
    "LDR_SIZE_SIG_M": ("estimator.leader.size_prior_sigma_m", math.nan),
    "LDR_OWN_TILT_DEG": ("estimator.leader.own_tilt_sigma_deg", math.nan),
    "LDR_OWN_YAW_DEG": ("estimator.leader.own_yaw_sigma_deg", math.nan),
    "LDR_OWN_VEL_M_S": ("estimator.leader.own_velocity_sigma_m_s", math.nan),
    "LDR_DELAY_SIG_S": ("estimator.leader.delay_sigma_s", math.nan),
    "LDR_COAST_S": ("estimator.leader.coast_after_s", math.nan),
    "LDR_VALID_S": ("estimator.leader.validity_timeout_s", math.nan),
    "LDR_RESET_S": ("estimator.leader.reset_timeout_s", math.nan),
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
SIZE_SHARE: Final = 0.02  # of the leader's size: its uncertainty if that is not set

Store = Callable[[dict[str, Any]], None]


class Parameters:
    """The values that hold from the next start. `store` keeps the keys that were set, now or (`stored`) before, as
    a table; it raises OSError if it cannot. Without it, parameters can only be read."""

    def __init__(self, config: Config, store: Store | None = None, stored: dict[str, Any] | None = None) -> None:
        self._table: dict[str, Any] = msgspec.to_builtins(config)
        self._store = store
        self._changed = stored or {}
        leader = self._table["estimator"].get("leader", {})
        if leader and leader.get("size_prior_sigma_m") is None:
            leader["size_prior_sigma_m"] = SIZE_SHARE * leader["size_prior_m"]
        self.names = tuple(name for name in KEYS if _has(self._table, KEYS[name][0]))

    def value(self, name: str) -> float:
        """The value of a parameter. Raises KeyError."""
        key, unset = KEYS[name]
        found: Any = self._table
        for part in key.split("."):
            found = found[int(part)] if isinstance(found, list | tuple) else found[part]
        return unset if found is None else float(found)

    def answer(self, request: ParamRequest, now_ns: int) -> tuple[list[Message], str]:
        """What to send on a request, and why a value was refused (or nothing)."""
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
        """Check and store a value; why it was refused, or nothing."""
        if self._store is None:
            return f"{name}: `parameters.path` is not configured"
        if value is None or not math.isfinite(value):
            return f"{name}: not a number"
        rounded = float(decimal(value))
        changed = _with(self._table, KEYS[name][0], rounded)
        try:
            parse_config(changed)
        except ConfigError as error:
            _, _, reason = str(error).partition(": ")  # behind the key: the sender knows the parameter's name
            return f"{name} = {rounded:g}: {reason}"
        kept = _with_key(self._changed, changed, KEYS[name][0])
        try:
            self._store(kept)
        except OSError as error:
            return f"{name} cannot be stored: {error.strerror}"
        self._table, self._changed = changed, kept
        return ""


def _has(table: Any, key: str) -> bool:
    head, _, rest = key.partition(".")
    if isinstance(table, list | tuple):
        return int(head) < len(table)
    return head in table and (not rest or _has(table[head], rest))


def _with(table: Any, key: str, value: float) -> Any:
    """A copy of a table with one value changed."""
    head, _, rest = key.partition(".")
    if isinstance(table, list | tuple):
        return [value if i == int(head) else x for i, x in enumerate(table)]
    return {**table, head: _with(table[head], rest, value) if rest else value}


def _with_key(kept: dict[str, Any], table: dict[str, Any], key: str) -> dict[str, Any]:
    """What is kept, with a key's value of a table; of an array, all of it."""
    head, _, rest = key.partition(".")
    if not rest or not isinstance(table[head], dict):
        return {**kept, head: table[head]}
    return {**kept, head: _with_key(kept.get(head, {}), table[head], rest)}


def stored_parameters(config: Config, storing: Storing | None) -> Parameters:
    """The parameters, and what was set before. Raises ConfigError."""
    if storing is None or config.parameters.path is None:
        return Parameters(config)
    return Parameters(config, storing.put, read_stored(Path(config.parameters.path)))
