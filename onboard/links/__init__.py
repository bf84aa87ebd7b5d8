"""Links: bytes in and out, with one module for each kind; `parse_link` selects it."""

import math
from typing import Any, Final

from onboard.links.link import AbsentError, Deliver, Link, LinkError, NowNs
from onboard.links.serial import SerialLink
from onboard.links.tcp import TcpClientLink, TcpServerLink
from onboard.links.udp import Surplus, UdpLink
from onboard.messages import Encoding

__all__ = ["AbsentError", "Deliver", "Link", "LinkError", "NowNs", "parse_link"]

FORMS: Final = (
    "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, serial:DEVICE:BAUD or json:HOST:PORT"
)


def parse_link(
    spec: str,
    channel: str,
    *,
    retry: bool = True,
    surplus: Surplus = lambda _: 0,
    longest_wait_s: float = math.inf,
) -> Link:
    """The link that a link string describes, not opened yet.

    With `retry`, TCP clients and serial ports that lose their peer reconnect, with growing delays; without, their
    `run` raises LinkError. `json` listens for detections, one JSON document in each UDP datagram. An IPv6 address
    is in brackets. Port 0 of a listening link: any free port. `surplus`: how readily a UDP link leaves a datagram
    out where too many wait, 0: never; it also leaves out what has waited for `longest_wait_s` here.

    Raises LinkError with the string and the valid forms.
    """
    kind, _, rest = spec.partition(":")
    if kind == "serial":
        device, _, baud = rest.rpartition(":")
        if not device or not baud.isdecimal() or int(baud) == 0:
            raise LinkError(f"link {spec!r}: use serial:DEVICE:BAUD, such as serial:/dev/ttyAMA0:921600")
        return SerialLink(spec, channel, device, int(baud), retry=retry)
    if kind not in ("udpin", "udpout", "tcp", "tcpin", "json"):
        raise LinkError(f"link {spec!r}: not a link string; use {FORMS}")
    host, port = _host_and_port(spec, rest, listening=kind in ("udpin", "tcpin", "json"))
    if kind == "tcp":
        return TcpClientLink(spec, channel, host, port, retry=retry)
    if kind == "tcpin":
        return TcpServerLink(spec, channel, host, port)
    if kind == "json":
        options: dict[str, Any] = {"listening": True, "encoding": Encoding.DETECTIONS}
    else:
        options = {"listening": kind == "udpin", "surplus": surplus}
    return UdpLink(spec, channel, host, port, longest_wait_s=longest_wait_s, **options)


def _host_and_port(spec: str, text: str, *, listening: bool) -> tuple[str, int]:
    """("127.0.0.1", 14550) of "127.0.0.1:14550". Raises LinkError."""
    host, _, port = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if not host or (":" in host and not bracketed):
        raise LinkError(f"link {spec!r}: host and port are missing or unclear; use {FORMS}")
    if not (port.isascii() and port.isdecimal()) or not (0 if listening else 1) <= int(port) <= 65535:
        raise LinkError(f"link {spec!r}: port {port!r} is invalid; use 1 to 65535")
    return host.strip("[]"), int(port)
