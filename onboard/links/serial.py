"""MAVLink over a serial port, configured by pyserial and served by the event loop."""

import asyncio
import os
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Final

from onboard.links.link import (
    DEVICE_ABSENT,
    OPENING,
    AbsentError,
    Deliver,
    Link,
    LinkError,
    NowNs,
    keep_connected,
    reason_of,
    until_lost,
)
from onboard.messages import Datagram, Encoding
from onboard.messages.causes import NO_REASON

if TYPE_CHECKING:
    from serial import Serial

READ_BYTES: Final = 4096
SEND_LIMIT: Final = 4096  # bytes in the send buffer, beyond which data are dropped: 0.35 s at 115200 baud


class SerialLink(Link):
    """A serial port. With `retry`, a port that was unplugged is opened again when it is back."""

    def __init__(self, spec: str, channel: str, device: str, baud: int, *, retry: bool = True) -> None:
        self.channel = channel
        self._spec, self._device, self._baud, self._retry = spec, device, baud, retry
        self._port: Serial | None = None
        self._pending = bytearray()

    async def open(self) -> None:
        """Open the port for exclusive use. Raises LinkError if it is absent, forbidden or in use."""
        self._port = self._open_port()

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each piece until cancelled.

        Without `retry`, raises LinkError when the port disappears.
        """
        await keep_connected(self, partial(self._converse, now_ns), deliver, retry=self._retry)

    def send(self, data: bytes) -> None:
        """Buffer data to send, or drop it if the port is closed or the buffer lacks room."""
        if self._port is None or len(self._pending) + len(data) > SEND_LIMIT:
            self.errors += 1
            return
        waiting = bool(self._pending)
        self._pending += data
        self.sent += 1
        if not waiting:
            self._flush(self._port.fileno())

    def _open_port(self) -> "Serial":
        from serial import Serial  # noqa: PLC0415 - most setups have no serial port

        try:
            return Serial(self._device, self._baud, timeout=0, exclusive=True)
        except OPENING as error:  # SerialException is an OSError
            hint = "is it plugged in, free, and are you in its group (dialout)?"
            kind = AbsentError if getattr(error, "errno", None) in DEVICE_ABSENT else LinkError
            raise kind(f"{self._spec}: cannot open {self._device} ({reason_of(error)}); {hint}") from error

    async def _converse(self, now_ns: NowNs, deliver: Deliver, failed: "asyncio.Future[None]") -> None:
        """Use the port until it is lost, which raises LinkError."""
        port = self._port or self._open_port()
        self._port = port
        self.trouble = NO_REASON
        fd = port.fileno()
        loop = asyncio.get_running_loop()
        lost: asyncio.Future[None] = loop.create_future()
        loop.add_reader(fd, self._read, fd, deliver, now_ns, lost)
        try:
            await until_lost(lost, failed)
        finally:
            loop.remove_reader(fd)
            loop.remove_writer(fd)
            self._pending.clear()
            self._port = None
            with suppress(*OPENING):  # the device is gone
                port.close()
        raise LinkError(f"{self._spec}: {self._device} is gone")

    def _read(self, fd: int, deliver: Deliver, now_ns: NowNs, lost: "asyncio.Future[None]") -> None:
        t_recv_ns = now_ns()
        try:
            data = os.read(fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.received += 1
            encoding = Encoding.MAVLINK_STREAM
            deliver(Datagram(channel=self.channel, encoding=encoding, t_recv_ns=t_recv_ns, data=data))
        elif not lost.done():  # unplugged
            lost.set_result(None)

    def _flush(self, fd: int) -> None:
        """Write as much as the port accepts; call again when it accepts more."""
        loop = asyncio.get_running_loop()
        try:
            del self._pending[: os.write(fd, self._pending)]
        except BlockingIOError:
            pass
        except OSError:  # unplugged: the reader notices too
            self.errors += 1
            self._pending.clear()
        if self._pending:
            loop.add_writer(fd, self._flush, fd)
        else:
            loop.remove_writer(fd)
