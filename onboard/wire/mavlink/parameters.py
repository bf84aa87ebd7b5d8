"""Parameters, PING and AUTOPILOT_VERSION <-> records; all parameters are real numbers."""

import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Message, ParamAck, ParamAction, ParamRequest, ParamValue, Ping, Version

REAL32: Final = dialect.MAV_PARAM_TYPE_REAL32  # MAV_PARAM_EXT_TYPE has the same number
NO_GIT_HASH: Final = (0,) * 8
WHOLE: Final = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}  # MAV_PARAM_TYPE


Fields = tuple[Any, ...]


def _text(field: bytes) -> str:
    return field.split(b"\0", 1)[0].decode("ascii", "replace")


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _list(f: Fields, h: dict[str, Any], *, extended: bool) -> Message:
    return ParamRequest(**h, **_target(f), action=ParamAction.LIST, extended=extended)


def _read(f: Fields, h: dict[str, Any], *, extended: bool) -> Message:
    index, *rest, name = f
    return ParamRequest(
        **h, **_target(rest), action=ParamAction.READ, extended=extended, name=_text(name), index=index
    )


def _set(f: Fields, h: dict[str, Any]) -> Message:
    value, system, component, name, _ = f
    target = _target((system, component))
    return ParamRequest(**h, **target, action=ParamAction.SET, extended=False, name=_text(name), value=value)


def _set_extended(f: Fields, h: dict[str, Any]) -> Message:
    system, component, name, value, _ = f
    return ParamRequest(
        **h,
        **_target((system, component)),
        action=ParamAction.SET,
        extended=True,
        name=_text(name),
        value=_number(_text(value)),
    )


def _value_of(f: Fields, h: dict[str, Any]) -> Message:
    """Decode PARAM_VALUE, whose integers are converted (ArduPilot) or bytewise (PX4).

    A value that is no integer although its type is one is bytewise; integers above 10^9 remain ambiguous.
    """
    value, count, index, name, kind = f
    form = WHOLE.get(kind)
    if form is not None and not float(value).is_integer():
        value = float(struct.unpack_from(form, struct.pack("<f", value))[0])
    return ParamValue(**h, extended=False, name=_text(name), value=value, count=count, index=index)


def _target(f: Sequence[int]) -> dict[str, Any]:
    return {"target_system": f[0], "target_component": f[1]}


# by name: the layout of the payload, and what reads it
CONVERT: Final[dict[str, tuple[str, Callable[[Fields, dict[str, Any]], Message | None]]]] = {
    "PARAM_REQUEST_LIST": ("<2B", partial(_list, extended=False)),
    "PARAM_REQUEST_READ": ("<h2B16s", partial(_read, extended=False)),
    "PARAM_SET": ("<f2B16sB", _set),
    "PARAM_VALUE": ("<f2H16sB", _value_of),
    "PARAM_EXT_REQUEST_LIST": ("<2B", partial(_list, extended=True)),
    "PARAM_EXT_REQUEST_READ": ("<h2B16s", partial(_read, extended=True)),
    "PARAM_EXT_SET": ("<2B16s128sB", _set_extended),
    "PING": ("<QI2B", lambda f, h: Ping(**h, **_target(f[2:]), time_us=f[0], number=f[1])),
}


def _value(m: Any) -> list[Any]:
    name = m.name.encode("ascii")
    if m.extended:
        text = decimal(m.value).encode("ascii")
        return [dialect.MAVLink_param_ext_value_message(name, text, REAL32, m.count, m.index)]
    return [dialect.MAVLink_param_value_message(name, m.value, REAL32, m.count, m.index)]


def _request(m: Any) -> list[Any]:
    """The request for one parameter by its name."""
    name = m.name.encode("ascii")
    return [dialect.MAVLink_param_request_read_message(m.target_system, m.target_component, name, m.index)]


def _ack(m: Any) -> list[Any]:
    result = dialect.PARAM_ACK_ACCEPTED if m.accepted else dialect.PARAM_ACK_FAILED
    value = decimal(m.value).encode("ascii")
    return [dialect.MAVLink_param_ext_ack_message(m.name.encode("ascii"), value, REAL32, result)]


def _version(m: Any) -> list[Any]:
    major, minor, patch = m.version
    number = major << 24 | minor << 16 | patch << 8 | dialect.FIRMWARE_VERSION_TYPE_OFFICIAL
    args = (m.capabilities, number, 0, 0, 0, NO_GIT_HASH, NO_GIT_HASH, NO_GIT_HASH, 0, 0, 0)
    return [dialect.MAVLink_autopilot_version_message(*args)]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {
    ParamValue: _value,
    ParamRequest: _request,
    ParamAck: _ack,
    Ping: lambda m: [dialect.MAVLink_ping_message(m.time_us, m.number, m.target_system, m.target_component)],
    Version: _version,
}


def decimal(value: float) -> str:
    """The shortest decimal that a 32-bit float distinguishes."""
    return format(value, ".7g") if math.isfinite(value) else "nan"
