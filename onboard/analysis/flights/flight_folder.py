"""A folder of one flight: an autopilot's log, and a detector's JSON lines.

The documents are those that the detector sends in flight (`CameraDetections`). Each is delivered when the log
has reached its time, so none arrives before it was true.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard import UserError
from onboard.messages import NO_REASON, Cause, Clock, Datagram, Encoding, Reason
from onboard.messages.stamps import Span, read_stamps
from onboard.units import S_PER_NS
from onboard.wire.logs.recording import parts_of
from onboard.wire.logs.tlog import NotALogError

LOGS: Final = (".bin", ".mcap", ".tlog", ".ulg")
DETECTIONS: Final = (".jsonl", ".ndjson")
FLIGHT_CONFIG: Final = "config.toml"
TRUTHS: Final = ("truth.csv", "truth.csv.gz")


class FlightFolder(NamedTuple):
    """Files of a flight's folder; configuration and truth may be missing."""

    log: Path
    detections: tuple[Path, ...]
    config: Path | None
    truth: Path | None


class Stamp(msgspec.Struct):
    """The time of a document, and its clock."""

    t_ns: int
    clock: Clock


def flight_folder(folder: Path) -> FlightFolder:
    """Find the files of a flight's folder. Raises UserError unless it holds exactly one log.

    The parts of one log count as one."""
    wanted = (path for path in folder.iterdir() if path.suffix.lower() in (*LOGS, *DETECTIONS))
    files = sorted(path for path in wanted if is_given(path))
    logs = [path for path in files if path.suffix.lower() in LOGS]
    whole = max(map(parts_of, logs), key=len, default=())
    if not logs or set(whole) != set(logs):
        found = ", ".join(path.name for path in logs) or "none"
        raise UserError(f"{folder}: expected one log ({', '.join(LOGS)}) in this folder; found: {found}")
    config, truths = folder / FLIGHT_CONFIG, [folder / name for name in TRUTHS]
    return FlightFolder(
        whole[0],
        tuple(path for path in files if path.suffix.lower() in DETECTIONS),
        config if is_given(config) else None,
        next((path for path in truths if is_given(path)), None),
    )


def is_given(path: Path) -> bool:
    """Whether a folder, perhaps of unknown origin, has this file.

    Raises UserError for a symbolic link, which could lead to any file of ours."""
    if path.is_symlink():
        raise UserError(f"{path} is a symbolic link, which is not followed; copy the file there")
    return path.is_file()


class Documents:
    """The documents of one detector's file, in order, each when its time has come."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise NotALogError(f"cannot read {path.name}: {error.strerror or error}") from error
        self._decoder = msgspec.json.Decoder(Stamp)
        self._next: tuple[Stamp | None, bytes] | None = None
        self._seen: dict[Clock, Span] = {}  # of the stamps, by their clock
        self._read()

    def due(self, t_recv_ns: int, boot_ns: int) -> Iterator[Datagram]:
        """The documents that were true by now.

        `t_recv_ns` is on the clock of the log's arrivals, `boot_ns` on the autopilot's. A line without a time
        comes at once, since the decoder refuses it with a reason."""
        while self._next is not None:
            stamp, line = self._next
            if stamp is not None and stamp.t_ns > (boot_ns if stamp.clock is Clock.BOOT else t_recv_ns):
                return
            yield Datagram(channel=self.name, encoding=Encoding.DETECTIONS, t_recv_ns=t_recv_ns, data=line)
            self._read()

    def rest(self, spans: Mapping[Clock, Span]) -> Reason:
        """Close the file, and say why its stamps do not fit the log, or why documents are left.

        `spans`: begin and end of the log by each clock. Returns NO_REASON if all is well."""
        first, count = self._next, 0
        while self._next is not None:
            count += 1
            self._read()
        self._file.close()
        for of, seen in self._seen.items():
            reading = read_stamps(seen, of, spans)
            if reading is not None:
                times = f"images {seen}" + (f", the log {spans[of]}" if of in spans else "")
                return Reason(Cause.OTHER_CLOCK, f"`t_ns` is {reading.words} ({times}): {reading.remedy}")
        if first is None or first[0] is None:
            return NO_REASON
        t_s, clock = first[0].t_ns * S_PER_NS, first[0].clock
        return Reason(
            Cause.LOG,
            f"{count} lines are later than the log's end, the first with `t_ns` of {t_s:.3f} s; expected the time "
            f"of exposure on the clock `{clock}`: boot is the autopilot's time since its start, host Unix time",
        )

    def _read(self) -> None:
        self._next = None
        while line := self._file.readline():
            if text := line.strip():
                stamp = self._stamp(text)
                self._next = stamp, text
                if stamp is not None:
                    seen = self._seen.get(stamp.clock, Span(stamp.t_ns, stamp.t_ns))
                    self._seen[stamp.clock] = Span(min(seen.begin, stamp.t_ns), max(seen.end, stamp.t_ns))
                return

    def _stamp(self, line: bytes) -> Stamp | None:
        try:
            return self._decoder.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return None
