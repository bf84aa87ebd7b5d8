"""MAVLink over a serial port. pyserial sets the port up; the event loop reads and writes its descriptor."""

import asyncio
import os
from typing import TYPE_CHECKING, Final

from onboard.links.link import (
    FIRST_RETRY_S,
    LONGEST_RETRY_S,
    Deliver,
    LinkError,
    NowNs,
    guarded,
    until_lost,
)
from onboard.messages import Datagram, Encoding

if TYPE_CHECKING:
    from serial import Serial

READ_SIZE: Final = 4096
SEND_LIMIT: Final = 4096  # bytes waiting to be sent beyond which we drop: a third of a second at 115200 baud


class SerialLink:
    """A serial port. With `retry` one that is unplugged while in use is opened again when it is back."""

    def __init__(self, spec: str, channel: str, device: str, baud: int, *, retry: bool = True) -> None:
        self.channel = channel
        self.received = 0
        self.sent = 0
        self.errors = 0
        self._spec, self._device, self._baud, self._retry = spec, device, baud, retry
        self._port: Serial | None = None
        self._pending = bytearray()

    async def open(self) -> None:
        """Open the port for ourselves alone. Raises LinkError: no such device, not allowed, in use."""
        self._port = self._open_port()

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Hand on what arrives until cancelled. Without `retry`: LinkError when the port is gone."""
        failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        delay_s = FIRST_RETRY_S
        while True:
            received = self.received
            try:
                await self._converse(guarded(deliver, failed), now_ns, failed)
            except LinkError:
                if not self._retry:
                    raise
                self.errors += 1
            if self.received > received:
                delay_s = FIRST_RETRY_S
            await asyncio.sleep(delay_s)
            delay_s = min(2 * delay_s, LONGEST_RETRY_S)

    def send(self, data: bytes) -> None:
        """Queue for sending if the port is open and not congested. Whole pieces are dropped, never parts."""
        if self._port is None or len(self._pending) + len(data) > SEND_LIMIT:
            self.errors += 1
            return
        waiting = bool(self._pending)
        self._pending += data
        self.sent += 1
        if not waiting:
            self._flush(self._port.fileno())

    def _open_port(self) -> "Serial":
        from serial import Serial, SerialException  # noqa: PLC0415 - most setups have no serial port

        try:
            return Serial(self._device, self._baud, timeout=0, exclusive=True)
        except (SerialException, ValueError, OSError) as error:
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            hint = "is it plugged in, free, and are you in its group (dialout)?"
            raise LinkError(f"{self._spec}: cannot open {self._device} ({reason}); {hint}") from error

    async def _converse(self, deliver: Deliver, now_ns: NowNs, failed: "asyncio.Future[None]") -> None:
        """One use of the port from opening to loss, which is a LinkError."""
        port = self._port or self._open_port()
        self._port = port
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
            port.close()
        raise LinkError(f"{self._spec}: {self._device} is gone")

    def _read(self, fd: int, deliver: Deliver, now_ns: NowNs, lost: "asyncio.Future[None]") -> None:
        t_recv_ns = now_ns()
        try:
            data = os.read(fd, READ_SIZE)
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
        """Write what the port takes; come back when it takes more."""
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
