"""Diagnosis of routers that cannot be reached.

Zenoh retries silently for ever: an absent router, an expired certificate and a foreign router all look like a
flight without a router.
"""

import socket
import ssl
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from onboard.messages.causes import NO_REASON, Cause, Reason

ENDPOINT_TIMEOUT_S: Final = 1.0
NO_SESSION: Final = Reason(
    Cause.UNREACHABLE,
    "it answers but opens no session; check that it is a Zenoh router, and user and password",
)


class Trust(NamedTuple):
    """Zenoh's TLS settings: files (PEM), or None."""

    ca_file: str | None = None
    certificate_file: str | None = None
    private_key_file: str | None = None
    checks_name: bool = True


def diagnose(endpoints: Iterable[str], session: Any, trust: Trust) -> Reason:
    """Return the unreachable endpoints with reasons, or NO_REASON; at most a second for each.

    Two endpoints may lead to one router, with which Zenoh keeps one connection: an endpoint that answers is fine
    if another is connected.
    """
    linked = {(protocol(str(link.dst)), port(str(link.dst))) for link in session.info.links()}
    missing = [e for e in endpoints if (protocol(e), port(e)) not in linked]
    is_alone = len(missing) == len(tuple(endpoints))
    found = {e: why for e in missing if (why := probe(e, trust)) or is_alone}
    if not found:
        return NO_REASON
    words = "; ".join(f"cannot reach {e} ({(why or NO_SESSION).words})" for e, why in found.items())
    return Reason(worst((why or NO_SESSION).cause for why in found.values()), words)


def worst(causes: Iterable[Cause]) -> Cause:
    """Return the cause TLS if any endpoint has it, since only the user can fix it."""
    return Cause.TLS if Cause.TLS in causes else Cause.UNREACHABLE


def probe(endpoint: str, trust: Trust) -> Reason | None:
    """Return the reason why an endpoint refuses a TCP or TLS connection, or None.

    It is None if the endpoint accepts one, or has another protocol.
    """
    name = protocol(endpoint)
    if name not in ("tcp", "tls"):
        return None
    try:
        with socket.create_connection((host(endpoint), int(port(endpoint))), ENDPOINT_TIMEOUT_S) as plain:
            if name == "tls":
                _handshake(plain, host(endpoint), trust)
    except ssl.SSLCertVerificationError as error:
        return Reason(Cause.TLS, f"its certificate is not accepted: {error.verify_message}")
    except ssl.SSLError as error:
        return Reason(Cause.TLS, f"TLS: {(error.reason or str(error)).lower().replace('_', ' ')}")
    except (OSError, ValueError) as error:
        return Reason(Cause.UNREACHABLE, getattr(error, "strerror", None) or str(error) or "no answer")
    return None


def _handshake(plain: socket.socket, name: str, trust: Trust) -> None:
    """Open TLS as Zenoh does, and wait briefly for an alert that rejects our certificate.

    Raises OSError (including ssl.SSLError).
    """
    context = ssl.create_default_context(cafile=trust.ca_file)
    context.check_hostname = trust.checks_name
    if trust.certificate_file and trust.private_key_file:
        context.load_cert_chain(trust.certificate_file, trust.private_key_file)
    with context.wrap_socket(plain, server_hostname=name) as secured:
        secured.settimeout(0.2)
        try:
            secured.recv(1)
        except TimeoutError:
            return


def protocol(endpoint: str) -> str:
    """Return the protocol of an endpoint, such as `tls` of `tls/host:7447`."""
    return endpoint.partition("/")[0].lower()


def host(endpoint: str) -> str:
    """Return the host of an endpoint, without the brackets of IPv6."""
    return _address(endpoint).rpartition(":")[0].strip("[]")


def port(endpoint: str) -> str:
    """Return the port of an endpoint."""
    return _address(endpoint).rpartition(":")[2]


def _address(endpoint: str) -> str:
    """Return an endpoint without protocol, metadata and settings."""
    return endpoint.partition("/")[2].partition("?")[0].partition("#")[0]
