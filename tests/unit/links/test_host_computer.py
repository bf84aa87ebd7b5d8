"""What Linux says of this computer, from files made by hand."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.links.host_computer import HostComputer
from onboard.wire.mavlink.encode import MavlinkEncoder


def write(folder: Path, busy: int, idle: int) -> None:
    core = f"cpu0 {busy} 0 0 {idle // 2} {idle // 2} 0 0 0 0 0"
    (folder / "stat").write_text(f"cpu  9 9 9 9 9 9 9 9 0 0\n{core}\nintr 5\n")
    (folder / "meminfo").write_text("MemTotal:  4194304 kB\nMemFree: 1 kB\nMemAvailable: 1048576 kB\n")
    (folder / "uptime").write_text("12.50 20.00\n")
    for k, milli in enumerate((45_000, 61_400)):
        zone = folder / f"thermal_zone{k}"
        zone.mkdir(exist_ok=True)
        (zone / "temp").write_text(f"{milli}\n")


def test_load_memory_and_temperature_are_read(tmp_path: Path) -> None:
    computer = HostComputer(tmp_path, proc=tmp_path, thermal=tmp_path)
    write(tmp_path, 100, 100)
    assert computer.read(1).cpu_percent == ()
    write(tmp_path, 130, 170)
    status = computer.read(2)
    assert status.cpu_percent == pytest.approx((30.0,))
    assert (status.memory_used, status.memory_total) == (3 * 2**30, 4 * 2**30)
    assert (status.uptime, status.temperature, status.t_ns) == (12.5, 61.4, 2)
    assert status.storage_total is not None
    (m,) = dialect.MAVLink(None).parse_buffer(MavlinkEncoder(7, 191).encode(status))
    assert (m.uptime, list(m.cpu_cores), m.ram_usage, m.ram_total) == (12_500, [30, *[255] * 7], 3072, 4096)
    assert (m.temperature_board, m.storage_usage[1]) == (61, 2**32 - 1)


def test_where_nothing_is_to_be_read_nothing_is_claimed(tmp_path: Path) -> None:
    status = HostComputer(tmp_path / "no", proc=tmp_path, thermal=tmp_path).read(1)
    assert (status.cpu_percent, status.memory_used, status.storage_total, status.temperature) == ((),) + (
        None,
    ) * 3
    (m,) = dialect.MAVLink(None).parse_buffer(MavlinkEncoder(7, 191).encode(status))
    assert (status.uptime, m.uptime) == (0.0, 0)
    assert (m.ram_total, m.temperature_board, list(m.cpu_cores)) == (2**32 - 1, 127, [255] * 8)
