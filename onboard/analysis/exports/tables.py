"""Writers of `onboard replay --out` and `--own`, by the suffix of the file."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Protocol

from onboard import UserError, with_extra
from onboard.analysis.exports.csv_rows import LEADER_TABLE, OWN_TABLE, TEXT_COLUMNS, CsvTable, CsvWriter
from onboard.messages import Estimate, Health, NavState, Output
from onboard.messages.ros import Ros2Config
from onboard.scoring.reference import Reference
from onboard.units import S_PER_NS

PARQUET_BATCH_ROWS: Final = 10_000
EXTRAS: Final = {  # module and extra
    ".parquet": ("pyarrow", "parquet"),
    ".mcap": ("mcap_protobuf", "foxglove"),
    ".ros2": ("rosbags", "ros2"),
}
IDENTITY: Final = (1.0, 0.0, 0.0, 0.0)
OWN_STATE: Final = "own_state"
BAG: Final = ".ros2"
DEFAULT_ROS2: Final = Ros2Config()


class Writer(Protocol):
    """Writes each output in order."""

    def write(self, output: Any) -> None:
        """Append an output; formats with `takes_health` also take the health."""

    def close(self) -> None:
        """Finish the file."""


def check_exports(*paths: Path | None) -> None:
    """Raise UserError for a suffix that is not known, or whose library is not installed."""
    for path in paths:
        if path is None:
            continue
        if suffix_of(path) not in (*WRITERS, BAG):
            raise UserError(
                f"cannot write {path}: the suffix says the format, one of {', '.join((*WRITERS, BAG))}"
            )
        module, extra = EXTRAS.get(path.suffix, ("", ""))
        if module and find_spec(module) is None:
            raise UserError(f"cannot write {path}: it needs {module}: {with_extra(extra)}")
        if path.suffix == BAG and path.exists():
            raise UserError(f"cannot write {path}: it exists, and a bag is a folder of its own: give a new name")


def suffix_of(path: Path) -> str:
    """Suffix that names the format; `.csv` for a file without one, such as /dev/stdout."""
    return path.suffix or ".csv"


def open_export(
    path: Path, stack: ExitStack, *, of_own: bool, ros2: Ros2Config = DEFAULT_ROS2
) -> Callable[[Output | Health], None]:
    """Open a new file, closed by `stack`, and return its `write`. Raises UserError.

    `of_own`: write our own state instead of the leader; a bag of ROS 2 has both."""
    try:
        if path.suffix == BAG:
            from onboard.analysis.exports.ros_bag import RosBagWriter  # noqa: PLC0415 - an extra

            return stack.enter_context(closing(RosBagWriter(path, ros2))).write
        writer = stack.enter_context(WRITERS[suffix_of(path)](path, of_own))
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error
    return writer.write


def takes_health(path: Path) -> bool:
    """Whether an export holds the health."""
    return path.suffix == BAG


class TumWriter:
    """Valid poses as TUM trajectories, which evo reads, in NED.

    A line has time (s), position (m), quaternion (x, y, z, w): our own state from the origin, or a leader
    relative to us. A leader has the identity as its attitude, since that is not estimated."""

    def __init__(self, path: Path, of_own: bool) -> None:
        self._file, self._of_own = path.open("w", encoding="utf-8"), of_own
        self._leader = ""  # the name of the first estimator of a leader
        self._last_ns = -1

    def write(self, output: Output) -> None:
        """Append a pose if the output has a newer one."""
        if not isinstance(output, Estimate) or not output.is_primary or not output.valid or output.mean is None:
            return
        if not isinstance(output, NavState):
            self._leader = self._leader or output.name
        if output.name != (OWN_STATE if self._of_own else self._leader) or output.t_ns <= self._last_ns:
            return
        self._last_ns = output.t_ns
        q = output.q_nb if isinstance(output, NavState) and output.q_nb is not None else IDENTITY
        write_pose(self._file.write, output.t_ns * S_PER_NS, output.mean[:3], q)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def write_pose(write: Callable[[str], Any], t: float, r: Any, q: Any) -> None:
    """One line of a trajectory; `q` scalar first."""
    w, x, y, z = q
    write(f"{t:.6f} {' '.join(f'{v:.6f}' for v in (*r, x, y, z, w))}\n")


def write_truth(path: Path, reference: Reference) -> Path:
    """Write the leader's truth next to a trajectory at `path`, for evo. Raises OSError."""
    target = path.with_name(f"{path.stem}-truth.tum")
    with target.open("w", encoding="utf-8") as file:
        for t, row in zip(reference.time.tolist(), reference.values[:, :3].tolist(), strict=True):
            write_pose(file.write, t, row, IDENTITY)
    return target


class ParquetWriter:
    """A table as Parquet: numbers are doubles, unknown values are null."""

    def __init__(self, path: Path, table: CsvTable) -> None:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415

        self._arrow, self._values = pa, table.values
        self._schema = pa.schema(
            [(name, pa.string() if name in TEXT_COLUMNS else pa.float64()) for name in table.columns]
        )
        self._writer = parquet.ParquetWriter(path, self._schema)
        self._waiting: list[Any] = []

    def write(self, output: Output) -> None:
        """Append an output's row, if it has one."""
        values = self._values(output)
        if values is not None:
            self._waiting.append(values)
            if len(self._waiting) >= PARQUET_BATCH_ROWS:
                self._flush()

    def close(self) -> None:
        """Finish the file."""
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        columns = list(zip(*self._waiting, strict=True)) or [()] * len(self._schema)
        arrays = [self._arrow.array(c, type=f.type) for c, f in zip(columns, self._schema, strict=True)]
        self._writer.write_batch(self._arrow.record_batch(arrays, schema=self._schema))
        self._waiting.clear()


class _Csv:
    """A table as CSV in a file of its own."""

    def __init__(self, path: Path, table: CsvTable) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self.write, self.close = CsvWriter(self._file, table).write, self._file.close


def _mcap(path: Path) -> Writer:
    from onboard.analysis.exports.foxglove import FoxgloveWriter  # noqa: PLC0415 - an extra

    return FoxgloveWriter(path)


def _table(of_own: bool) -> CsvTable:
    return OWN_TABLE if of_own else LEADER_TABLE


WRITERS: Final[dict[str, Callable[[Path, bool], AbstractContextManager[Writer]]]] = {
    ".csv": lambda path, of_own: closing(_Csv(path, _table(of_own))),
    ".parquet": lambda path, of_own: closing(ParquetWriter(path, _table(of_own))),
    ".tum": lambda path, of_own: closing(TumWriter(path, of_own)),
    ".mcap": lambda path, _: closing(_mcap(path)),
}
