"""Requests of others, from pymavlink's messages: commands, parameters, pings.

See `pymavlink_records`.
"""

import struct
from collections.abc import Callable
from typing import Any, Final

from onboard.messages import (
    Clock,
    Command,
    CommandAck,
    Message,
    ParamAction,
    ParamRequest,
    ParamValue,
    Ping,
)


def _command(m: Any, h: dict[str, Any], x: float, y: float, z: float) -> Message:
    params = (m.param1, m.param2, m.param3, m.param4, x, y, z)
    return Command(**h, **_addressee(m), command=m.command, params=params)


def _addressee(m: Any) -> dict[str, Any]:
    return {"target_system": m.target_system, "target_component": m.target_component}


def _parameter(m: Any, h: dict[str, Any], action: ParamAction, **fields: Any) -> Message:
    return ParamRequest(**h, **_addressee(m), action=action, extended="_EXT_" in m.get_type(), **fields)


def _parameter_read(m: Any, h: dict[str, Any]) -> Message:
    return _parameter(m, h, ParamAction.READ, name=m.param_id, index=m.param_index)


def _real(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _parameter_value(m: Any, h: dict[str, Any]) -> Message:
    """PX4 sends the bytes of a whole number, ArduPilot the number."""
    value = m.param_value
    if 1 <= m.param_type <= 6 and value % 1 != 0:  # also of what is no number
        size = 2 ** ((m.param_type - 1) // 2)
        signed = m.param_type % 2 == 0
        value = float(int.from_bytes(struct.pack("<f", value)[:size], "little", signed=signed))
    place = {"count": m.param_count, "index": m.param_index}
    return ParamValue(**h, extended=False, name=m.param_id, value=value, **place)


def _ping(m: Any, h: dict[str, Any]) -> Message:
    """Its stamp is of whoever asks, so not of a clock that we know."""
    unstamped = {**h, "t_ns": h["t_recv_ns"], "clock": Clock.NONE}
    return Ping(**unstamped, **_addressee(m), time_us=m.time_usec, number=m.seq)


PROTOCOLS: Final[dict[str, Callable[[Any, dict[str, Any]], Message | None]]] = {
    "COMMAND_LONG": lambda m, h: _command(m, h, m.param5, m.param6, m.param7),
    "COMMAND_INT": lambda m, h: _command(m, h, float(m.x), float(m.y), m.z),
    "COMMAND_ACK": lambda m, h: CommandAck(**h, **_addressee(m), command=m.command, result=m.result),
    "PARAM_REQUEST_LIST": lambda m, h: _parameter(m, h, ParamAction.LIST),
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": lambda m, h: _parameter(m, h, ParamAction.SET, name=m.param_id, value=m.param_value),
    "PARAM_VALUE": _parameter_value,
    "PARAM_EXT_REQUEST_LIST": lambda m, h: _parameter(m, h, ParamAction.LIST),
    "PARAM_EXT_REQUEST_READ": lambda m, h: _parameter(
        m, h, ParamAction.READ, name=m.param_id, index=m.param_index
    ),
    "PARAM_EXT_SET": lambda m, h: _parameter(m, h, ParamAction.SET, name=m.param_id, value=_real(m.param_value)),
    "PING": _ping,
}
