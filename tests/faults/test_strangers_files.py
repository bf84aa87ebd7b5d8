"""Files that a stranger made: each is read or refused in a line, with little memory, and never for ever."""

import os
import signal
import struct
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from onboard import UserError
from onboard.analysis.flights.flight_folder import flight_folder
from onboard.config import ConfigError, LinkConfig, WarmFile, parse_config, read_stored, signing_key
from onboard.config.calibration import read_calibration
from onboard.config.storing import store
from onboard.config.warm_start import store_state
from onboard.sinks.secrets import secret
from onboard.sinks.sink import SinkError
from onboard.sinks.zenoh_stated import stated_in
from onboard.wire.logs.dataflash import read_dataflash
from onboard.wire.logs.tlog import NotALogError
from onboard.wire.logs.ulog import read_ulog
from tests.unit.wire.test_ulog import message

HANGS_S = 60
WHOLE = "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
MATRICES = "camera_matrix: {{data: {}}}\ndistortion_coefficients: {{data: [0, 0, 0, 0, 0]}}\n"
K = "[500, 0, 320, 0, 500, 240, 0, 0, 1]"
LAUGH = "xa: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"x{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(11)
)


@pytest.fixture(autouse=True)
def ends() -> Iterator[None]:
    """What takes longer hangs."""
    signal.alarm(HANGS_S)
    yield
    signal.alarm(0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAUGH + WHOLE + MATRICES.format("*l"), "camera_matrix: expected a number"),
        (LAUGH + WHOLE.replace("plumb_bob", "*l") + MATRICES.format(K), "distortion_model is"),
        (LAUGH + WHOLE.replace("640", "*l") + MATRICES.format(K), "image_width: expected a number"),
        (LAUGH + "cam0: {camera_model: *l, intrinsics: [1,2,3,4], resolution: [640, 480]}\n", "camera_model is"),
        (WHOLE + "camera_matrix: &x {data: [*x]}\ndistortion_coefficients: *x\n", "expected a number"),
        (WHOLE.replace("640", "9" * 400) + MATRICES.format(K), "expected a number"),
    ],
    ids=["matrix", "model", "width", "kalibr's model", "within itself", "400 digits"],
)
def test_aliases_within_each_other_are_refused_in_a_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(ValueError, match=words) as refused:
        read_calibration(tmp_path / "c.yaml")
    assert len(str(refused.value)) < 1000


def test_settings_without_end_are_refused(tmp_path: Path) -> None:
    nest = "a: &a {x: 1, y: 2}\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} {{x: *{chr(97 + i)}, y: *{chr(97 + i)}, z: *{chr(97 + i)}}}\n"
        for i in range(20)
    )
    (tmp_path / "z.yaml").write_text(nest)
    with pytest.raises(ValueError, match="more than 10000 settings"):
        stated_in(str(tmp_path / "z.yaml"))


ATTITUDE = "vehicle_attitude:uint64_t timestamp;{}"


@pytest.mark.parametrize(
    ("formats", "words"),
    [
        ((ATTITUDE.format("vehicle_attitude x;"),), "has 16 formats inside it"),
        ((ATTITUDE.format("b x;"), "b:vehicle_attitude y;"), "has 16 formats inside it"),
        (
            (*(f"f{i}:f{i + 1} x;" for i in range(2000)), "f2000:float x;", ATTITUDE.format("f0 x;")),
            "has 16 formats inside it",
        ),
        ((*(f"f{i}:f{i + 1} x;f{i + 1} y;" for i in range(40)), "f40:float x;"), "has 16 formats inside it"),
        ((*(f"f{i}:f{i + 1}[99] x;" for i in range(9)), "f9:float x;"), "more than 65535 bytes"),
        ((ATTITUDE.format("float[100000000] q;"),), "more than 65535 bytes"),
        ((ATTITUDE.format("float[" + "9" * 5000 + "] q;"),), "cannot be read"),
        ((ATTITUDE.format("nothing x;"),), "holds no attitude"),
    ],
    ids=[
        "within itself",
        "within each other",
        "2000 deep",
        "doubling",
        "9 of 99",
        "10^8",
        "5000 digits",
        "unknown",
    ],
)
def test_formats_of_a_ulog_without_end_are_refused(tmp_path: Path, formats: tuple[str, ...], words: str) -> None:
    rows = b"".join(message(b"D", struct.pack("<HQ4f", 0, 10**6 + k, 1, 0, 0, 0)) for k in range(9))
    subscribed = message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")
    head = b"ULog\x01\x12\x35" + struct.pack("<BQ", 1, 1000)
    (tmp_path / "x.ulg").write_bytes(
        head + b"".join(message(b"F", f.encode()) for f in formats) + subscribed + rows
    )
    with pytest.raises(NotALogError, match=words) as refused:
        list(read_ulog(tmp_path / "x.ulg"))
    assert len(str(refused.value)) < 1000


def row_format(kind: int, length: int, name: bytes, form: bytes, columns: bytes) -> bytes:
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name, form, columns)


@pytest.mark.parametrize("form", [b"Q???", b"Q\x1b[2J", b"Qff\xff"], ids=["?", "escape", "no ASCII"])
@pytest.mark.parametrize("is_late", [False, True], ids=["at first", "after rows"])
def test_a_bin_with_an_unknown_letter_is_refused_in_a_line(tmp_path: Path, form: bytes, is_late: bool) -> None:
    own = row_format(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    good = row_format(1, 23, b"ATT", b"Qfff", b"TimeUS,Roll,Pitch,Yaw")
    rows = b"".join(b"\xa3\x95\x01" + struct.pack("<Qfff", 10**6 + k, 1.0, 2.0, 3.0) for k in range(9))
    bad = row_format(2, 23, b"EVIL", form, b"TimeUS,Roll,Pitch,Yaw")
    (tmp_path / "x.bin").write_bytes(own + (good + rows + bad if is_late else bad + good) + rows)
    with pytest.raises(NotALogError, match="cannot be read"):
        list(read_dataflash(tmp_path / "x.bin"))


@pytest.mark.parametrize("kind", ["pipe", "link", "link to nothing"])
def test_a_state_that_no_run_of_ours_left_is_not_read(tmp_path: Path, kind: str) -> None:
    path, refused = tmp_path / "state.json", list[str]()
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(tmp_path / "elsewhere")
        if kind == "link":
            (tmp_path / "elsewhere").write_text("{}")
    rows = {"warm_start": {"path": str(path)}, "estimator": {"leader": {}}}
    file = WarmFile(parse_config(rows), lambda _: None, lambda _, why, __: refused.append(why.words))
    assert file.read(1_800_000_000 * 10**9) is None
    assert refused == ["is not our file: it is a link, a pipe, or another user's"]


@pytest.mark.parametrize("kind", ["pipe", "link"])
@pytest.mark.parametrize("what", ["parameters", "state"])
def test_what_lies_in_the_way_of_a_file_is_not_written_to(tmp_path: Path, kind: str, what: str) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    for name in ("kept", "kept.new"):
        if kind == "pipe":
            os.mkfifo(tmp_path / name)
        else:
            (tmp_path / name).symlink_to(victim)
    if what == "parameters":
        store(tmp_path / "kept", {"camera": {"f_px": 600.0}})
    else:
        store_state(tmp_path / "kept", msgspec.json.decode(b"null"))
    assert victim.read_text() == "precious"
    assert (tmp_path / "kept").is_file()
    assert not (tmp_path / "kept").is_symlink()


def test_a_pipe_is_no_key_no_secret_and_no_parameters(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    pipe = str(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="is not a regular file"):
        signing_key(LinkConfig(name="fc", url="udpin:127.0.0.1:0", key_file=pipe))
    with pytest.raises(ConfigError, match="is not a regular file"):
        read_stored(tmp_path / "pipe")
    with pytest.raises(SinkError, match="others can read it"):
        secret(pipe, "zenoh.password_file")


@pytest.mark.parametrize("name", ["flight.tlog", "truth.csv", "config.toml", "camera.jsonl"])
def test_no_link_in_a_flight_s_folder_is_followed(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    (folder / "log.tlog").write_bytes(b"")
    (tmp_path / "ours").write_text("ours")
    (folder / name).symlink_to(tmp_path / "ours")
    with pytest.raises(UserError, match=f"{name} is a symbolic link"):
        flight_folder(folder)
