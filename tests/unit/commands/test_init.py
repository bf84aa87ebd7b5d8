"""`onboard init`: what it writes loads and fits together for every combination of answers, and it writes over
nothing."""

import difflib
import itertools
import shutil
import tomllib
from pathlib import Path

import pytest

from onboard import UserError, __version__
from onboard.commands import cli, init
from onboard.commands.share import TOGETHER, shared_text
from onboard.config import load_config
from onboard.links import parse_link
from tests.support.golden import assert_golden
from tests.support.programs import ROOT
from tests.support.tables import each

CALIBRATION = """
image_width: 1280
image_height: 720
camera_matrix: {rows: 3, cols: 3, data: [900.0, 0.0, 640.0, 0.0, 900.0, 360.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.01, 0.0, 0.0, 0.0]}
"""
LINKS = (
    "tcp:[::1]:5760",
    "udpout:pixhawk.local:14550",
    "serial:/dev/ttyAMA0:921600",
    "serial:/dev/ttyUSB0:57600",
    "udpin:127.0.0.1:14540",
    "tcp:127.0.0.1:5762",
)
CAMERAS = ("640x480:554.3", "1280x720:62deg", "front.yaml")
AIRCRAFT = ("quadrotor", "hexarotor", "octorotor", "fixed-wing")
AUTOPILOTS, PURPOSES = ("ardupilot", "px4"), ("follow", "watch")
ANSWERS = [  # every autopilot, link and purpose together, and every pair of answers
    (AUTOPILOTS[a], LINKS[k], CAMERAS[(2 * a + p + 2 * k) % 3], AIRCRAFT[(2 * a + p + k) % 4], PURPOSES[p])
    for k, a, p in itertools.product(range(len(LINKS)), (0, 1), (0, 1))
]
USUAL = ("--autopilot", "px4", "--camera", "640x480:554", "--span", "2", "--watch")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("front.yaml").write_text(CALIBRATION, encoding="utf-8")
    return tmp_path


def rows(text: str) -> dict[str, float]:
    """The parameters of a file of either kind, each once."""
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    pairs = [line[:2] if len(line) == 2 else line[2:4] for line in lines if line]
    assert len({name for name, _ in pairs}) == len(pairs)
    return {name: float(value) for name, value in pairs}


@each("answered", {" ".join(answered): answered for answered in ANSWERS})
def test_what_is_written_loads_and_says_what_was_answered(
    answered: tuple[str, str, str, str, str], folder: Path
) -> None:
    autopilot, link, camera, aircraft, purpose = answered
    shutil.rmtree(folder / "new", ignore_errors=True)
    flags = ["--autopilot", autopilot, "--link", link, "--camera", camera, "--aircraft", aircraft, f"--{purpose}"]
    assert cli.main(["init", "new", *flags, "--span", "1.7", "--tilt", "-5"]) == 0
    config = load_config(folder / "new" / "companion.toml")
    parse_link(config.link[0].url, "autopilot")
    assert [k.url for k in config.link] == [link]
    leader, lens = config.estimator["leader"], config.camera_model().view
    assert (leader.size_prior_m, leader.aircraft) == (1.7, aircraft)
    assert leader.leader_class == ("fixed_wing" if aircraft == "fixed-wing" else "multirotor")
    assert config.camera.mount_rpy_deg == (0.0, -5.0, 0.0)
    assert lens is not None
    assert [out.link for out in config.leader_out] == (["autopilot"] if purpose == "follow" else [])
    parameters = folder / "new" / ("ardupilot.parm" if autopilot == "ardupilot" else "px4.params")
    assert parameters.exists() == (link.startswith("serial:") or purpose == "follow")
    found = rows(parameters.read_text(encoding="utf-8")) if parameters.exists() else {}
    if link.startswith("serial:"):
        baud = int(link.rpartition(":")[2])
        assert (found.get("SER_TEL2_BAUD") or found["SERIAL2_BAUD"]) == (
            baud if autopilot == "px4" else baud // 1000
        )
    if purpose == "follow":
        assert config.leader_out[0].rates_hz == {"SET_POSITION_TARGET_LOCAL_NED": 25.0}
        assert found["COM_OBL_RC_ACT" if autopilot == "px4" else "GUID_TIMEOUT"] in {1.0, 5.0}
    else:
        assert not config.leader_out
        assert not {"COM_OBL_RC_ACT", "GUID_TIMEOUT"} & found.keys()


def answers(**changed: str) -> dict[str, str]:
    usual = {
        "autopilot": "px4",
        "link": "serial:/dev/ttyAMA0:921600",
        "camera": "640x480:554",
        "tilt": "15",
        "aircraft": "quadrotor",
        "span": "2",
        "purpose": "watch",
    }
    return usual | changed


@pytest.mark.parametrize(
    ("flag", "value", "words"),
    [
        ("link", "udp:1.2.3.4", "expected serial:DEVICE:BAUD"),
        ("link", "json:127.0.0.1:14570", "expected serial:DEVICE:BAUD"),  # that is for detections
        ("link", "serial:/dev/ttyAMA0", "expected serial:DEVICE:BAUD"),
        ("link", "tcp:127.0.0.1", "expected serial:DEVICE:BAUD"),
        ("camera", "640x480", "expected WIDTHxHEIGHT:FOCAL"),
        ("camera", "640x480:170deg", "1 to 150 degrees"),
        ("camera", "1280x720:62", "a field of view of 169 degrees; 62 degrees are 1280x720:62deg"),
        ("camera", "640x0:500", "above 0"),
        ("camera", f"{'9' * 400}x480:500", "expected WIDTHxHEIGHT:FOCAL"),
        ("camera", f"640x480:{'9' * 400}", "expected WIDTHxHEIGHT:FOCAL"),
        ("camera", "zero.yaml", "expected a file of at most 1048576 bytes"),
        ("link", "serial:/dev/ttyS0\nExecStartPre=/bin/sh -c x:921600", "no line ends, control characters"),
        ("link", "serial:/dev/ttyS0 rwm:921600", "no line ends, control characters or spaces"),
        ("link", "serial:/dev/ttyAMA0:5000", "no autopilot has 5000 baud: expected one of 9600, 19200"),
        ("vehicle", "a\x1b[2J", "no line ends, control characters"),
        ("tilt", "up", "--tilt: must be a number from -90 to 90, not 'up'"),
        ("span", "-1", "--span: must be a number"),
        ("span", "nan", "--span: must be a number"),
    ],
)
def test_an_answer_that_cannot_be_is_one_line(flag: str, value: str, words: str) -> None:
    Path("zero.yaml").symlink_to("/dev/zero")
    with pytest.raises(UserError, match=words) as error:
        init.files_of(init.setup_of(answers(**{flag: value})))
    assert len(str(error.value)) < 400
    assert "\n" not in str(error.value)


def test_a_calibration_that_is_not_there_is_one_line_and_nothing_is_written(
    capsys: pytest.CaptureFixture[str], folder: Path
) -> None:
    flags = ["--autopilot", "px4", "--camera", "none.yaml", "--span", "2", "--watch"]
    assert cli.main(["init", "new", *flags]) == 2
    assert "none.yaml" in capsys.readouterr().err
    assert not (folder / "new").exists()


def test_nothing_is_written_over_unless_forced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = folder / "onboard.service"
    kept.write_text("mine", encoding="utf-8")
    assert cli.main(["init", *USUAL]) == 2
    assert "has onboard.service already; --force" in capsys.readouterr().err
    assert kept.read_text(encoding="utf-8") == "mine"
    assert not (folder / "companion.toml").exists()
    assert cli.main(["init", *USUAL, "--force"]) == 0
    assert "[Service]" in kept.read_text(encoding="utf-8")


def test_without_a_terminal_what_is_missing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["init", "--autopilot", "px4"]) == 2
    assert "missing --camera --span --follow or --watch" in capsys.readouterr().err


def test_at_a_terminal_it_asks_until_it_understands(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    given = iter(["x", "ardu", "tcp:127.0.0.1:5762", "", "640x480:554", "", "fixed", "2.5", "uav-7", "f"])
    asked: list[str] = []

    def read(words: str) -> str:
        asked.append(words)
        return next(given)

    monkeypatch.setattr("builtins.input", read)
    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    assert cli.main(["init"]) == 0
    config = load_config(folder / "companion.toml")
    assert config.estimator["leader"].aircraft == "fixed-wing"
    assert config.camera.mount_rpy_deg == (0.0, 15.0, 0.0)
    assert (folder / "ardupilot.parm").exists()
    assert config.zenoh.prefix == "onboard/uav-7"
    assert len(asked) == len(init.QUESTIONS) + 2  # "x" is no autopilot, "" no camera
    assert "[serial:/dev/ttyAMA0:921600]" in asked[2]


class Terminal:
    def isatty(self) -> bool:
        return True


def test_answers_that_end_are_one_line() -> None:
    def read(_: str) -> str:
        raise EOFError

    with pytest.raises(UserError, match="answers ended"):
        init.ask(init.QUESTIONS[0], read)


@pytest.mark.parametrize("example", TOGETHER)
def test_an_example_is_copied_beside_each_other(example: str, folder: Path) -> None:
    assert cli.main(["init", "here", "--example", example]) == 0
    copied = sorted((folder / "here").iterdir())
    assert [path.name for path in copied] == sorted(Path(name).name for name in TOGETHER[example])
    for path in copied:
        text = path.read_text(encoding="utf-8")
        assert "configs/" not in text
        if path.suffix == ".toml":
            assert tomllib.loads(text) == tomllib.loads(shared_text(f"configs/{path.name}"))
        assert path.suffix != ".sh" or path.stat().st_mode & 0o111


def test_every_file_that_is_shared_is_in_an_example() -> None:
    shared = {f"{folder}/{path.name}" for folder in ("configs", "examples") for path in (ROOT / folder).iterdir()}
    assert {name for names in TOGETHER.values() for name in names} == {n for n in shared if "__pycache__" not in n}


def changed(name: str, text: str) -> list[str]:
    """The lines in which a text differs from a shared file."""
    kept = shared_text(f"configs/{name}").splitlines()
    found = difflib.unified_diff(kept, text.splitlines(), name, "now", n=0, lineterm="")
    return [line for line in found if line[:1] in "+-"]


SETUPS = (
    {"link": "serial:/dev/ttymxc2:57600", "purpose": "follow", "camera": "front.yaml"},
    {
        "link": "serial:/dev/serial/by-path/pci-0:0:1.0:57600",
        "vehicle": 'a"b',
        "aircraft": "fixed-wing",
        "tilt": "-90",
        "span": "0.05",
    },
    {
        "autopilot": "ardupilot",
        "link": "serial:/dev/ttyUSB0:1500000",
        "purpose": "follow",
        "camera": "640x480:60deg",
    },
    {"autopilot": "ardupilot", "link": "udpin:0.0.0.0:14550", "camera": "640x480:90", "span": "100", "tilt": "90"},
)


@pytest.mark.parametrize("program", ["/usr/bin/onboard", "/tmp/v/bin/onboard"])  # noqa: S108 - hidden by the unit
def test_all_that_is_written(program: str, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setattr("sys.argv", [program])
    monkeypatch.setattr(init, "HOMES", (str(folder),))
    lines = []
    for setup in (init.setup_of(answers(**given)) for given in SETUPS):
        files = init.files_of(setup)
        lines += [f"SETUP {sorted(files)}", files[init.WRITTEN_CONFIG], *changed(init.UNIT, files[init.UNIT])]
        ending = Path(init.PARAMETER_FILES[setup.autopilot]).suffix
        for kind, part in (("serial", setup._replace(follows=False)), ("follow", setup._replace(link=""))):
            text, full = init.autopilot_parameters(part), f"{setup.autopilot}-{kind}{ending}"
            lines += changed(full, text) if text else [f"no {full}"]
        lines += init.next_steps(setup, Path("my folder"), tuple(files))
    text = "\n".join(lines).replace(str(folder), "HERE").replace(__version__, "VERSION")
    assert_golden(f"init-{Path(program).parts[1]}.txt", [text])
