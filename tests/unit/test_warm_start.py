"""What a run leaves to the next in a file, and what of it the next run believes."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import Config, ConfigError, WarmFile, warm_datagram
from onboard.config.warm_start import MAX_AGE_S, digest, state_folder, store_state
from onboard.messages import Datagram, WarmState
from onboard.pipeline.warm_start import REBOOTED
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.warm_state import decode_warm_state
from studies.closed_loop.flight import Companion
from tests.support.streams import EPOCH, S, Stream, feed, heartbeat, make_config, position_error

OFFBOARD = 6 << 16  # custom_mode of a PX4
END = 9.0  # s, of the first run's stream
AGAIN = 11.0  # s: the second run begins


def config(*settings: str) -> Config:
    return make_config('leader_out=[{ link = "autopilot" }]', *settings)


@cache
def flown() -> Companion:
    """A run that heard a stream until END."""
    companion, next_ns = Companion(config()), 0
    for datagram in Stream(t1=END).datagrams():
        companion.receive(datagram)
        if datagram.t_recv_ns >= next_ns:
            companion.tick(datagram.t_recv_ns)
            next_ns = datagram.t_recv_ns + 20_000_000
    return companion


@cache
def left() -> WarmState:
    """What it leaves."""
    state = flown().left
    assert state is not None
    return replace(state, configuration=digest(config()))


def second_run(state: WarmState | None, seed: int = 2) -> list[Any]:
    """The pipeline and its valid estimates of a stream from AGAIN on, with or without what was left."""
    datagrams = Stream(t0=AGAIN + 0.02, t1=AGAIN + 1.2, seed=seed).datagrams()
    known = [] if state is None else [warm_datagram(state, EPOCH + round(AGAIN * S))]
    run = feed([*known, *datagrams], config())
    return [run.pipeline, [e for e in run.estimates if e.valid]]


def test_the_next_run_begins_where_the_last_one_was_without_a_heartbeat_seeds_2_to_6() -> None:
    late = []
    for seed in range(2, 7):
        pipeline, warm = second_run(left(), seed)
        assert warm[0].t_ns < (AGAIN + 0.2) * S  # the next heartbeat comes at 12 s
        assert pipeline.health(0).verdicts["leader.warm_start_used"] == 1
        _, cold = second_run(None, seed)
        late.append((cold[0].t_ns - warm[0].t_ns) / S)
        assert sigma(warm[0]) < 0.7 * sigma(cold[0])
        assert position_error(warm[0]) < 3.0 * sigma(warm[0])
        assert np.linalg.norm(speed_error(warm[0])) < 3.0
    assert min(late) > 0.6


def sigma(estimate: Any) -> float:
    return float(np.sqrt(np.trace(np.array(estimate.covariance)[:3, :3])))


def speed_error(estimate: Any) -> Any:
    return np.array(estimate.mean[3:6]) - Stream().flight.relative(estimate.t_ns / S)[1]


def test_the_guided_course_and_the_clocks_go_on() -> None:
    companion = Companion(config())
    state = replace(left(), course=1.5, round_trip_ns=4_000_000)
    companion.receive(warm_datagram(state, EPOCH + round(AGAIN * S)))
    first, *_ = Stream(t0=AGAIN + 0.02, t1=AGAIN + 0.1).datagrams()
    companion.receive(first)
    companion.tick(first.t_recv_ns)
    assert companion.output._guidance.course == 1.5
    assert companion.pipeline.clocks.source == "timesync"
    assert companion.pipeline.clocks.offset_ns == state.offset_ns


def test_after_a_reboot_of_the_autopilot_nothing_of_it_is_used() -> None:
    state = left()
    pipeline, valid = second_run(replace(state, offset_ns=state.offset_ns - S))
    assert "leader.warm_start_used" not in pipeline.health(0).verdicts
    assert pipeline.health(0).refusals[-1].reason == REBOOTED.words
    assert valid


def test_a_leader_that_is_elsewhere_by_now_contradicts_it() -> None:
    state = left()
    mean = (*(3.0 * x for x in state.estimate.mean or ()),)
    estimate = replace(state.estimate, mean=(*mean[:6], *(state.estimate.mean or ())[6:]))
    pipeline, valid = second_run(replace(state, estimate=estimate))
    assert pipeline.health(0).verdicts["leader.warm_start_contradicted"] == 1
    assert position_error(valid[-1]) < 3.0 * sigma(valid[-1])


def damaged(path: tuple[Any, ...], value: Any) -> bytes:
    """The state with one value in its place."""
    tree = msgspec.to_builtins(left())
    at = tree
    for key in path[:-1]:
        at[key] = list(at[key]) if isinstance(at[key], tuple) else at[key]
        at = at[key]
    at[path[-1]] = value
    return msgspec.json.encode(tree)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (lambda: msgspec.json.encode(left())[:-300], "truncated"),
        (lambda: b"", "truncated"),
        (lambda: b"[1]", "another version"),
        (lambda: damaged(("version",), 1), "another version"),
        (lambda: damaged(("estimate", "mean", 0), float("nan")), "estimate.mean"),
        (lambda: damaged(("estimate", "mean", 0), 1e7), "estimate.mean"),
        (lambda: damaged(("estimate", "mean"), [1.0] * 7), "components"),
        (lambda: damaged(("estimate", "covariance", 0, 0), -1.0), "covariance"),
        (lambda: damaged(("estimate", "covariance", 0, 1), 9.0), "covariance"),
        (lambda: damaged(("estimate", "valid"), False), "valid estimate"),
        (lambda: damaged(("own", "r_OF_n", 0), None), "own"),
        (lambda: damaged(("own", "t_ns"), 1), "one time"),
        (lambda: damaged(("course",), "north"), "course"),
        (lambda: damaged(("more",), 1), "more"),
    ],
)
def test_a_damaged_state_is_refused(data: Callable[[], bytes], reason: str) -> None:
    with pytest.raises(BadDocumentError, match=reason):
        decode_warm_state(data(), 1)


def test_the_next_run_is_told_the_flight_mode_of_the_last_heartbeat() -> None:
    run, end_ns = flown(), round(END * S)
    run.output.respond("autopilot", [replace(heartbeat(end_ns), custom_mode=OFFBOARD)], EPOCH + end_ns)
    state = run.output.warm_state(EPOCH + end_ns, EPOCH, None)
    assert state is not None
    assert state.heartbeat.custom_mode == OFFBOARD


class Kept:
    """A file, and what is reported and refused over it."""

    def __init__(self, path: Path, *settings: str) -> None:
        self.lines: list[str] = []
        self.refused: list[str] = []
        self.config = config(f"warm_start.path='{path}'", *settings)
        self.file = WarmFile(self.config, self.lines.append, lambda _, why, __: self.refused.append(why.words))

    def read(self, wall_ns: int) -> Datagram | None:
        return self.file.read(wall_ns)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state.json"


def test_a_file_is_read_back_and_is_private(path: Path) -> None:
    kept = Kept(path)
    kept.file.keep(left())
    kept.file.close()
    found = Kept(path).read(left().wall_ns + 2 * S)
    assert found is not None
    state, heartbeat = left(), replace(left().heartbeat, t_recv_ns=0)
    digest_ = digest(kept.config)
    assert decode_warm_state(found.data, 0) == replace(
        state, t_recv_ns=0, heartbeat=heartbeat, configuration=digest_
    )
    assert path.stat().st_mode & 0o077 == 0
    assert list(path.parent.iterdir()) == [path]
    assert kept.refused == []


@pytest.mark.parametrize(
    ("later_s", "settings", "reason"),
    [
        (MAX_AGE_S + 1.0, (), "11 s old; expected at most 10 s"),
        (-1.0, (), "1.0 s in the future"),
        (1.0, ("camera.f_px=600",), "belongs to another configuration"),
    ],
)
def test_a_file_that_is_no_use_is_ignored_with_a_reason(
    path: Path, later_s: float, settings: tuple[str, ...], reason: str
) -> None:
    store_state(path, left())
    kept = Kept(path, *settings)
    assert kept.read(left().wall_ns + round(later_s * S)) is None
    (line,) = kept.lines
    assert reason in line
    assert reason in kept.refused[0]


def test_damage_is_ignored_and_nothing_at_all_is_silent(path: Path) -> None:
    path.write_bytes(b"\0" * 1000)
    kept = Kept(path)
    assert kept.read(left().wall_ns) is None
    assert "is ignored" in kept.lines[0]
    path.unlink()
    kept = Kept(path)
    assert kept.read(left().wall_ns) is None
    assert kept.lines == kept.refused == []


def test_what_is_switched_off_neither_reads_nor_writes(path: Path) -> None:
    store_state(path, left())
    before = path.stat().st_mtime_ns
    kept = Kept(path, "warm_start.enabled=false")
    kept.file.keep(left())
    kept.file.close()
    assert kept.read(left().wall_ns + S) is None
    assert path.stat().st_mtime_ns == before


def test_a_configured_folder_that_is_not_there_is_an_error_and_another_only_a_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"warm_start\.path"):
        Kept(tmp_path / "none" / "state.json")
    (tmp_path / "file").write_text("")
    lines: list[str] = []
    WarmFile(config(), lines.append, lambda *_: None, {"STATE_DIRECTORY": str(tmp_path / "file")})
    assert "warm start is off" in lines[0]
    assert "set warm_start.path" in lines[0]


def test_states_are_where_systemd_or_xdg_has_them() -> None:
    assert state_folder({"STATE_DIRECTORY": "/var/lib/a:/var/lib/b", "HOME": "/h"}) == Path("/var/lib/a")
    assert state_folder({"XDG_STATE_HOME": "/x", "HOME": "/h"}) == Path("/x/onboard")
    assert state_folder({"XDG_STATE_HOME": "relative", "HOME": "/h"}) == Path("/h/.local/state/onboard")
    for homeless in ({}, {"HOME": ""}, {"HOME": "~"}):
        assert state_folder(homeless) == Path("/nonexistent/.local/state/onboard")


def test_two_daemons_on_other_links_have_files_of_their_own() -> None:
    other = config("link=[{name='autopilot', url='udpin:127.0.0.1:14599'}]")
    assert digest(other) != digest(config())
    assert digest(config("recorder.path='flight.mcap'")) == digest(config())
