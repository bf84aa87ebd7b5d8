"""Notifications to systemd (sd_notify) that we run, and each second that we progress."""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class ServiceManager:
    """The service manager of this program, if it asks for notifications (`NOTIFY_SOCKET`)."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        self._address = f"\0{address[1:]}" if address.startswith("@") else address  # of Linux's abstract names

    def notify(self, state: str) -> None:
        """Send READY=1, WATCHDOG=1 or STOPPING=1; it is lost where nobody listens."""
        if self._address:
            with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
                sender.setblocking(False)
                sender.sendto(state.encode(), self._address)
