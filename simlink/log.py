"""Runs written to files as fast as possible: MAVLink as .tlog, the truth as CSV."""

import gzip
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Final

from onboard.messages import Datagram, Encoding, TrafficTruth, Truth
from onboard.units import S_PER_NS
from onboard.wire.logs.tlog import tlog_record
from simlink.scenarios.scenario import Scenario
from simlink.simulation import check_mavlink, datagrams
from simlink.world.truth import State

MAVLINK: Final = (Encoding.MAVLINK, Encoding.MAVLINK_STREAM)
COLUMNS: Final = (
    "time_boot_s,r_north_m,r_east_m,r_down_m,v_north_m_s,v_east_m_s,v_down_m_s,size_m,"
    "a_lat_m_s2,a_long_m_s2,leader_q_w,leader_q_x,leader_q_y,leader_q_z"
)

STATE_COLUMNS: Final = (
    "time_boot_s,r_north_m,r_east_m,r_down_m,v_north_m_s,v_east_m_s,v_down_m_s,q_w,q_x,q_y,q_z,"
    "p_rad_s,q_rad_s,r_rad_s,fault"
)


def write_log(
    scenario: Scenario,
    seed: int,
    duration: float,
    tlog: Path,
    truth: Path | None,
    state: Path | None = None,
    progress: Callable[[float], None] = lambda _: None,
    world: Iterator[State] | None = None,
) -> tuple[int, int]:
    """Write the files and return the numbers of frames and of truth rows.

    `truth` is the file of the leader, `state` that of our own vehicle. The same seed gives the same bytes, also in
    compressed files (names in .gz). `progress` is called with the simulated seconds so far. `world` replaces the
    states that follow from scenario and seed.

    Raises OSError if a file cannot be written, and ScenarioError if a .tlog cannot hold the images.
    """
    check_mavlink(scenario)
    frames = 0
    start_ns: int | None = None
    with ExitStack() as stack:
        out = stack.enter_context(_open(tlog, stack))
        tables = stack.enter_context(TruthTables(truth, state))
        for item in datagrams(scenario, seed, duration, camera="mavlink", world=world):
            if isinstance(item, TrafficTruth) or (isinstance(item, Datagram) and item.encoding not in MAVLINK):
                continue  # a .tlog contains MAVLink only
            if not isinstance(item, Truth):
                out.write(tlog_record(item.t_recv_ns, item.data))
                frames += 1
                continue
            start_ns = item.t_ns if start_ns is None else start_ns
            progress((item.t_ns - start_ns) * S_PER_NS)
            tables.write(item)
    return frames, tables.rows


class TruthTables(ExitStack):
    """CSV files of the truth of the leader and of our own vehicle; None means no file.

    Raises OSError if a file cannot be written.
    """

    def __init__(self, truth: Path | None, state: Path | None) -> None:
        super().__init__()
        self.rows = 0
        self._tables: list[tuple[IO[bytes], Callable[[Truth], str]]] = []
        for path, columns, row in ((truth, COLUMNS, truth_row), (state, STATE_COLUMNS, state_row)):
            if path is not None:
                self._tables.append((self.enter_context(_open(path, self)), row))
                self._tables[-1][0].write(f"{columns}\n".encode())

    def write(self, truth: Truth) -> None:
        """Write a row into each file."""
        for table, row in self._tables:
            table.write(row(truth).encode())
        self.rows += bool(self._tables)


def truth_row(truth: Truth) -> str:
    """One line of the leader's truth; its columns are `COLUMNS`."""
    numbers = (*truth.r_FL_n, *truth.v_FL_n, truth.size, truth.a_lat, truth.a_long, *truth.q_nL)
    return f"{truth.t_ns * S_PER_NS:.3f}," + ",".join(f"{x:.6f}" for x in numbers) + "\n"


def state_row(truth: Truth) -> str:
    """One line of the vehicle's own truth; its columns are `STATE_COLUMNS`."""
    numbers = (*truth.r_OF_n, *truth.v_F_n, *truth.q_nF, *truth.omega_b)
    return f"{truth.t_ns * S_PER_NS:.3f}," + ",".join(f"{x:.6f}" for x in numbers) + f',"{truth.fault}"\n'


def _open(path: Path, stack: ExitStack) -> IO[bytes]:
    """Open a file, through gzip if its name ends in .gz.

    The gzip header has neither name nor time, so that equal data give equal bytes.
    """
    file: IO[bytes] = path.open("wb")
    if path.suffix != ".gz":
        return file
    stack.enter_context(file)
    return gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0)  # type: ignore[return-value]  # same methods
