"""Results of parts as rows of Parquet, readable while others are computed. Needs pyarrow."""

from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import msgspec
import numpy as np

BATCH_ROWS: Final = 64
# the number of the part, and JSON of the other three
PART_KEYS: Final = ("part", "function", "arguments", "result")


class PartRows:
    """A file with one row for each part, in order: the same bytes every time."""

    def __init__(self, path: Path) -> None:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415

        self._arrow = pa
        self._schema = pa.schema([("part", pa.int64()), *((name, pa.string()) for name in PART_KEYS[1:])])
        self._writer = parquet.ParquetWriter(path, self._schema)
        self._waiting: list[tuple[Any, ...]] = []
        self._number = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._flush()
        self._writer.close()

    def add(self, function: str, arguments: Any, result: Any) -> None:
        """Append the next part's row."""
        self._waiting.append((self._number, function, as_json(arguments), as_json(result)))
        self._number += 1
        if len(self._waiting) >= BATCH_ROWS:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            columns = zip(zip(*self._waiting, strict=True), self._schema, strict=True)
            arrays = [self._arrow.array(column, type=field.type) for column, field in columns]
            self._writer.write_batch(self._arrow.record_batch(arrays, schema=self._schema))
            self._waiting.clear()


def as_json(value: Any) -> str:
    """Encode any result as JSON: arrays as lists, unknown types as their text."""
    return msgspec.json.encode(_plain(value)).decode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, msgspec.Struct):
        return _plain(msgspec.structs.asdict(value))
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, dict):
        return {key if isinstance(key, str) else str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, range)):
        return [_plain(inner) for inner in value]
    return value if isinstance(value, (str, int, float, bool)) or value is None else str(value)
