"""Replay of a recorded flight through the pipeline, bit-exact from run to run.

Time is the recording's own, so nothing here depends on when or how fast it is replayed.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard import UserError
from onboard.analysis.flights.flight_folder import Documents, FlightFolder, flight_folder
from onboard.config import Config, ConfigError, read_recorded, signing_key
from onboard.messages import (
    DOUBT_PREFIX,
    Clock,
    Datagram,
    Estimate,
    Health,
    Heartbeat,
    Message,
    NavState,
    Output,
    OwnPose,
    ParamValue,
    StatusText,
)
from onboard.messages.causes import Cause, Reason
from onboard.messages.stamps import Span
from onboard.pipeline import Pipeline
from onboard.scoring.beside import judged
from onboard.units import NS_PER_S, S_PER_NS
from onboard.wire.logs import dataflash, ulog
from onboard.wire.logs.recording import is_recording, parts_of, read_flown, read_recording
from onboard.wire.logs.tlog import NotALogError, read_tlog

PROGRESS_RECORDS: Final = 2000  # between two calls of `progress`
HEALTH_PERIOD_NS: Final = NS_PER_S
FLOWN: Final = "flown"
UNVERIFIED: Final = (
    f"{DOUBT_PREFIX}{{}} signed frames were used unverified: this replay has not the key of link `{{}}`; name it "
    "in `key_file` of its [[link]]"
)
RAW: Final = "MAVLink without times, as Mission Planner's .rlog: replay the .tlog that it wrote beside it"
FOREIGN_FORMATS: Final = {  # by how a file begins: what it is, and what to do
    b"\x1f\x8b": "compressed (gzip): `gunzip` it first",
    b"PK\x03\x04": "a ZIP archive: unpack it, and replay the log in it",
    b"7z\xbc\xaf": "a 7-Zip archive: unpack it, and replay the log in it",
    b"SQLite format 3": "a database, as a bag of ROS 2 (.db3): replay the autopilot's own log; a bag is not read",
    b"#ROSBAG": "a bag of ROS 1: replay the autopilot's own log; a bag is not read",
    **dict.fromkeys((b"\xfe", b"\xfd"), RAW),
    b"FMT, ": "a DataFlash log as text: replay the .bin that it was made of",
}
UNTIMED_MESSAGES: Final = (Heartbeat, StatusText, ParamValue)
NO_OTHERS: Final[Mapping[str, Config]] = {}


class ReplayError(UserError, ValueError):
    """The log cannot be replayed; the message says why in one line."""


class ReplayResult(NamedTuple):
    """Results of a replay."""

    estimates: list[Estimate]  # of the judged estimator (`onboard.scoring.beside`)
    health: Health  # at the end
    records: int
    damaged: int  # stretches that were no record, and rows that could not be used
    duration: float  # s
    own_states: list[NavState]
    end: float  # boot time, s
    beside: dict[str, list[Estimate]]


def replay(
    log: Path,
    config: Config,
    *,
    take: Callable[[Output], None] = lambda _: None,
    take_health: Callable[[Health], None] | None = None,
    hear: Callable[[Message, float], None] | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    keep: bool = True,
    others: Mapping[str, Config] = NO_OTHERS,
) -> ReplayResult:
    """Feed a log, or a flight's folder, through a pipeline. Raises ReplayError.

    `take` gets each output in order, `take_health` the health after each second, `hear` each message of the
    autopilot with the boot time (s), `progress` the bytes done and in all. Without `keep` the result holds no
    estimates, which take gigabytes an hour.

    `others`: further configurations for the same bytes, by the names of their estimates. That of FLOWN is
    replaced by the estimates of the recording itself."""
    pipeline = pipeline_of(config)
    beside = {name: pipeline_of(other) for name, other in others.items() if name != FLOWN}
    results = Results(take, keep)
    total, is_ours = _size(log), is_recording(flight_of(log).log)
    count = damaged = first = last = lost = due = 0

    def lose(reason: str) -> None:
        nonlocal lost
        lost += 1
        pipeline.refuse(log.name, Reason(Cause.LOG, reason), last)

    try:
        for item, done in read_flight(log, pipeline, lose, flown=FLOWN in others):
            if item is None:
                damaged += 1
                continue
            if isinstance(item, Estimate):
                results.add([item], FLOWN)
                continue
            messages = pipeline.decode(item) if isinstance(item, Datagram) else [item]
            results.add(pipeline.advance(messages))
            if hear is not None:
                _forward(pipeline, messages, hear)
            for name, other in beside.items():
                results.add(other.feed(item) if isinstance(item, Datagram) else other.advance([item]), name)
            first = first or item.t_recv_ns
            last = max(last, item.t_recv_ns)
            if take_health is not None and last >= due:
                due = last + HEALTH_PERIOD_NS
                take_health(_health(pipeline, last, is_ours=is_ours))
            count += 1
            if count % PROGRESS_RECORDS == 0:
                progress(done, total)
    except NotALogError as error:
        raise ReplayError(f"{log}: {error}") from error
    progress(total, total)
    for channel, number in pipeline.unverified.items():
        pipeline.refuse(channel, Reason(Cause.UNVERIFIED, UNVERIFIED.format(number, channel)), last)
    health, end = _health(pipeline, last, is_ours=is_ours), pipeline.ownship.now_ns * S_PER_NS
    main = results.estimates.pop(judged(results.estimates), [])
    seconds = (last - first) * 1e-9
    return ReplayResult(main, health, count, damaged + lost, seconds, results.own_states, end, results.estimates)


def _health(pipeline: Pipeline, t_recv_ns: int, *, is_ours: bool) -> Health:
    """The health at a time. Remedies name keys and links of the configuration that only our own recording has."""
    health = pipeline.health(t_recv_ns)
    advice = health.advice if is_ours else tuple(replace(one, remedy="") for one in health.advice)
    return replace(health, advice=advice)


def aligned(log: Path, config: Config, wanted: Callable[[Message], bool]) -> Iterator[Message | OwnPose]:
    """Messages that are `wanted`, on the boot clock less their delays, and our own poses.

    Nothing is estimated. Raises UserError."""
    pipeline = pipeline_of(replace(config, estimator={}))
    try:
        for item, _ in read_flight(log, pipeline):
            if not isinstance(item, Datagram | Message):
                continue
            messages = pipeline.decode(item) if isinstance(item, Datagram) else [item]
            yield from (output for output in pipeline.advance(messages) if isinstance(output, OwnPose))
            found = (pipeline.clocks.align(m, pipeline.delay_ns(m)).message for m in messages if wanted(m))
            yield from (message for message in found if message is not None)
    except NotALogError as error:
        raise UserError(f"{log}: {error}") from error


def pipeline_of(config: Config) -> Pipeline:
    """Make the pipeline that flew, with the keys of its links.

    A link whose key cannot be read here verifies nothing: unsigned frames are refused as in flight, and signed
    ones are counted."""
    keys: dict[str, bytes | None] = {}
    reasons: dict[str, str] = {}
    for link in config.link:
        if link.key_file is not None:
            keys[link.name] = None
            try:
                keys[link.name] = signing_key(link)
            except ConfigError as error:
                reasons[link.name] = str(error)
    pipeline = Pipeline(config, keys)
    for name, reason in reasons.items():
        pipeline.refuse(name, Reason(Cause.KEY_UNREADABLE, f"{DOUBT_PREFIX}{reason}"), 0)
    return pipeline


class Results:
    """Outputs of all pipelines in order: passed to `take`, and kept if wanted.

    Those of another configuration than the flight's go by its name."""

    def __init__(self, take: Callable[[Output], None], keep: bool) -> None:
        self._take, self._keep = take, keep
        self.estimates: dict[str, list[Estimate]] = {}
        self.own_states: list[NavState] = []

    def add(self, outputs: Iterable[Output], name: str = "") -> None:
        """Add the next outputs of the configuration of this name."""
        for made in outputs:
            output = _renamed(made, name) if name else made
            if output is None:
                continue
            self._take(output)
            if not self._keep:
                continue
            if isinstance(output, NavState):
                self.own_states += [] if name else [output]
            elif isinstance(output, Estimate) and output.is_primary:
                self.estimates.setdefault(output.name, []).append(output)


def _renamed(output: Output, name: str) -> Estimate | None:
    """Rename an estimate of the leader or our own state to its configuration; else None."""
    if not isinstance(output, Estimate) or not output.is_primary:
        return None
    return replace(output, name=name, target=name)


def _forward(pipeline: Pipeline, messages: Iterable[Message], hear: Callable[[Message, float], None]) -> None:
    """Pass on the autopilot's own messages: numbers once its clock is known, texts at once."""
    mine, t = pipeline.autopilot, pipeline.ownship.now_ns * S_PER_NS
    for message in messages:
        if mine is None or (message.system, message.component) != (mine.system, mine.component):
            continue
        if t > 0.0 or isinstance(message, UNTIMED_MESSAGES):
            hear(message, t)


def read_flight(
    log: Path, pipeline: Pipeline, lose: Callable[[str], None] = lambda _: None, *, flown: bool = False
) -> Iterator[tuple[Datagram | Message | Estimate | None, int]]:
    """Read a log, and the detectors' documents of a flight's folder.

    A document follows when `pipeline`, which must have been fed all before, has reached its time; one later
    than the log is refused. Raises ReplayError, NotALogError."""
    flight = flight_of(log)
    documents = [Documents(path) for path in flight.detections]
    last, spans = 0, dict[Clock, Span]()
    for item, done in _read_parts(flight.log, lose, flown=flown):
        yield item, done
        if isinstance(item, Datagram | Message):
            last = max(last, item.t_recv_ns)
            times = {Clock.HOST: last, Clock.BOOT: pipeline.ownship.now_ns}
            spans |= {clock: Span(spans.get(clock, Span(t, t)).begin, t) for clock, t in times.items() if t > 0}
            for each in documents:
                yield from ((document, done) for document in each.due(last, pipeline.ownship.now_ns))
    for each in documents:
        reason = each.rest(spans)
        if reason.words:
            pipeline.refuse(each.name, reason, last)


def flight_of(log: Path) -> FlightFolder:
    """Files of a flight's folder, or of a log alone. Raises UserError.

    A recording holds the configuration that it was made with."""
    flight = flight_folder(log) if log.is_dir() else FlightFolder(log, (), None, None)
    return flight._replace(config=flight.log) if flight.config is None and read_recorded(flight.log) else flight


def check_log(log: Path) -> None:
    """Raise ReplayError for a file that is no log, before anything is written for it."""
    log = flight_of(log).log
    try:
        items = read_log(log)
        is_whole = log.suffix.lower() in (".ulg", ".bin")  # which are parsed as a whole
        empty = not is_whole and all(item is None for item, _ in items)
    except (NotALogError, OSError) as error:
        raise ReplayError(f"{log}: {error}") from error
    if empty and len(parts_of(log)) == 1:
        raise ReplayError(f"{log}: there is no record in it that can be read")


def read_log(
    log: Path, lose: Callable[[str], None] = lambda _: None, *, flown: bool = False
) -> Iterator[tuple[Datagram | Message | Estimate | None, int]]:
    """Items of a log with the bytes read so far; None for damage.

    A .tlog or a recording has datagrams, and with `flown` its estimates; a ULog or a DataFlash log has
    messages. `lose` is called with the reason for each row that cannot be used. Raises ReplayError,
    NotALogError."""
    try:
        with log.open("rb") as file:
            head = file.read(16)
        if head.startswith(ulog.MAGIC):
            return ((message, 0) for message in ulog.read_ulog(log, lose))
        if head.startswith(dataflash.MAGIC):
            return dataflash.read_dataflash(log, lose)
        if is_recording(log):
            return read_flown(log) if flown else read_recording(log)
    except OSError as error:
        raise ReplayError(f"cannot read {log}: {error.strerror or error}") from error
    if not head:
        raise ReplayError(f"{log} is empty")
    foreign = RAW if log.suffix.lower() == ".rlog" else None
    if foreign := next((words for begin, words in FOREIGN_FORMATS.items() if head.startswith(begin)), foreign):
        raise ReplayError(f"{log} is no .tlog, .bin, .ulg or .mcap, but {foreign}")
    return _read_tlog(log)


def _read_parts(
    log: Path, lose: Callable[[str], None], *, flown: bool
) -> Iterator[tuple[Datagram | Message | Estimate | None, int]]:
    """Items of a log and of the parts that follow it."""
    before = 0
    for part in parts_of(log):
        for item, done in read_log(part, lose, flown=flown):
            yield item, before + done
        before += part.stat().st_size


def _read_tlog(log: Path) -> Iterator[tuple[Datagram | None, int]]:
    with log.open("rb") as file:
        yield from read_tlog(file)


def _size(log: Path) -> int:
    try:
        return sum(part.stat().st_size for part in parts_of(flight_of(log).log))
    except OSError as error:
        raise ReplayError(f"cannot read {log}: {error.strerror or error}") from error
