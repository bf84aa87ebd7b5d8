"""This computer's load, memory and temperature, from Linux; None or empty if unavailable."""

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Final

from onboard.messages import Clock, ComputerLoad, ComputerStatus

PROC: Final = Path("/proc")
THERMAL: Final = Path("/sys/class/thermal")


class HostComputer:
    """Reader of the computer's state, with each core's load since the last call."""

    def __init__(self, folder: Path = Path(), *, proc: Path = PROC, thermal: Path = THERMAL) -> None:
        self._folder, self._proc, self._thermal = folder, proc, thermal
        self._before: list[tuple[int, int]] = []

    def read(self, now_ns: int) -> ComputerStatus:
        """The state now; `now_ns` becomes its time."""
        used, total = self._memory()
        storage_used = storage_total = None
        with suppress(OSError):
            storage_total, storage_used, _ = shutil.disk_usage(self._folder)
        return ComputerStatus(
            t_ns=now_ns,
            t_recv_ns=now_ns,
            clock=Clock.HOST,
            uptime=self._uptime(),
            cpu_percent=self._processor_load(),
            memory_used=used,
            memory_total=total,
            storage_used=storage_used,
            storage_total=storage_total,
            temperature=self._temperature(),
        )

    def _read_rows(self, name: str) -> list[list[str]]:
        with suppress(OSError):
            return [line.split() for line in (self._proc / name).read_text().splitlines()]
        return []

    def _uptime(self) -> float:
        return float(next((words[0] for words in self._read_rows("uptime")), 0.0))

    def _processor_load(self) -> tuple[float, ...]:
        now = []
        for words in self._read_rows("stat"):
            if words[0].startswith("cpu") and words[0] != "cpu":
                times = [int(word) for word in words[1:9]]
                now.append((sum(times), sum(times[3:5])))  # all; idle and waiting for a disk
        before, self._before = self._before, now
        if len(before) != len(now):
            return ()
        spans = [(a - b, i - j) for (a, i), (b, j) in zip(now, before, strict=True)]
        return tuple(100.0 * (1.0 - idle / whole) if whole > 0 else 0.0 for whole, idle in spans)

    def _memory(self) -> tuple[int | None, int | None]:
        found = {words[0]: 1024 * int(words[1]) for words in self._read_rows("meminfo") if len(words) > 1}
        total, available = found.get("MemTotal:"), found.get("MemAvailable:")
        return (None, total) if total is None or available is None else (total - available, total)

    def _temperature(self) -> float | None:
        """The hottest of all sensors, deg C."""
        found = []
        for path in self._thermal.glob("thermal_zone*/temp"):
            with suppress(OSError, ValueError):
                found.append(int(path.read_text()) / 1000.0)
        return max(found, default=None)


def load_of(status: ComputerStatus, lag: float) -> ComputerLoad:
    """The same for the health; `lag` (s): by how much the daemon's own timer was late."""
    cpu, pairs = (
        status.cpu_percent,
        ((status.memory_total, status.memory_used), (status.storage_total, status.storage_used)),
    )
    memory, storage = (None if total is None or used is None else total - used for total, used in pairs)
    return ComputerLoad(
        cpu_busiest=max(cpu, default=None),
        cpu=sum(cpu) / len(cpu) if cpu else None,
        memory_free=memory,
        storage_free=storage,
        lag=lag,
        uptime=status.uptime,
    )
