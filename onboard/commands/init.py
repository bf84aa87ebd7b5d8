"""`onboard init`: a folder with what one vehicle needs: a configuration with only what matters, the service unit,
and a parameter file for the autopilot; or a copy of an example. What no flag says is asked at a terminal."""

import argparse
import json
import math
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from onboard import UserError, __version__
from onboard.commands.share import TOGETHER, copied_text, shared_text
from onboard.config import ConfigError, GuidanceConfig, parse_config
from onboard.daemon import check_link
from onboard.terminal.files import make_folder
from onboard.terminal.output import show

WRITTEN_CONFIG: Final = "companion.toml"
UNIT: Final = "onboard.service"
PARAMETER_FILES: Final[Mapping[str, str]] = {"ardupilot": "ardupilot.parm", "px4": "px4.params"}
INSTALLED: Final = Path("/opt/wingline/bin/onboard")  # as the shared unit starts it
ETC: Final = Path("/etc/onboard")
PRIVATE: Final = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # noqa: S108 - what the unit hides from the daemon
HOMES: Final = ("/home", "/root", "/run/user")  # which ProtectHome of the unit hides
ALLOWED: Final = ("ttyS", "ttyAMA", "ttyTHS", "ttyACM", "ttyUSB")  # serial devices that the shared unit may open
CALIBRATION: Final = "camera.yaml"
MAX_FIELD_ANGLE_DEG: Final = 150.0
LINK_WORDS: Final = "serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT"
IMAGE: Final = re.compile(r"(\d{1,5})x(\d{1,5}):(\d{1,6}(?:\.\d{1,6})?)(deg)?")
BAUDS: Final = (  # of both autopilots
    *("9600", "19200", "38400", "57600", "115200", "230400", "460800", "500000", "921600", "1500000", "2000000"),
)
MAX_QUOTED_LENGTH: Final = 60  # letters of an answer that is refused
BAUD: Final = "921600"  # of the parameter files that are shared
CAMERA_WORDS: Final = "WIDTHxHEIGHT:FOCAL in pixels, WIDTHxHEIGHT:FOVdeg (horizontal), or a camera_info FILE.yaml"


class Question(NamedTuple):
    """A flag, what is asked at a terminal where it is missing, and what an empty answer means; "": nothing."""

    flag: str
    words: str
    usual: str = ""
    choices: tuple[str, ...] = ()


QUESTIONS: Final = (
    Question("autopilot", "which autopilot", "", ("ardupilot", "px4")),
    Question("link", f"link to it: {LINK_WORDS}", "serial:/dev/ttyAMA0:921600"),
    Question("camera", f"camera: {CAMERA_WORDS}"),
    Question("tilt", "by how many degrees the camera looks up", "15"),
    Question("aircraft", "the leader is a", "quadrotor", ("quadrotor", "hexarotor", "octorotor", "fixed-wing")),
    Question("span", "its span in m: wingtip to wingtip, or over its rotors, blades included"),
    Question("vehicle", "its name, which no other vehicle has", "1"),
    Question("purpose", "shall the autopilot follow the leader, or you watch it", "", ("follow", "watch")),
)


class Setup(NamedTuple):
    """Answers about a vehicle. `camera` holds keys of [camera] as TOML; `tilt` is in degrees, `span` in m."""

    autopilot: str
    link: str
    camera: tuple[str, ...]
    tilt: float
    aircraft: str
    span: float
    follows: bool
    vehicle: str
    calibration: Path | None = None  # of the camera, if a file describes it


def main(arguments: argparse.Namespace) -> int:
    """Write the files, and say what to do next. Raises UserError."""
    folder: Path = arguments.folder
    if arguments.example is not None:
        unused = [f"--{q.flag}" for q in QUESTIONS[:-1] if getattr(arguments, q.flag) is not None]
        if unused or arguments.purpose is not None:
            raise UserError(f"init: --example copies files as they are, without {' '.join(unused) or '--follow'}")
        files = {Path(name).name: copied_text(name) for name in TOGETHER[arguments.example]}
        write(folder, files, force=arguments.force)
        return 0
    setup = setup_of(_answers(arguments))
    files = files_of(setup)
    write(folder, files, force=arguments.force)
    for line in next_steps(setup, folder, tuple(files)):
        show(line)
    return 0


def _answers(arguments: argparse.Namespace) -> dict[str, str]:
    """Flags, and at a terminal what else is asked. Raises UserError."""
    given = {q.flag: getattr(arguments, q.flag) for q in QUESTIONS}
    missing = [q for q in QUESTIONS if given[q.flag] is None]
    if missing and not (sys.stdin.isatty() and sys.stdout.isatty()):
        needed = [q for q in missing if not q.usual]
        if needed:
            flags = " ".join("--follow or --watch" if q.flag == "purpose" else f"--{q.flag}" for q in needed)
            raise UserError(f"init: missing {flags} (at a terminal, it asks)")
        return given | {q.flag: q.usual for q in missing}
    return given | {q.flag: ask(q, input) for q in missing}


def ask(question: Question, read: Callable[[str], str]) -> str:
    """Ask until there is an answer. Raises UserError at the end of the input."""
    among = f" ({'/'.join(question.choices)})" if question.choices else ""
    usual = f" [{question.usual}]" if question.usual else ""
    while True:
        try:
            answer = read(f"{question.words}{among}{usual}: ").strip() or question.usual
        except EOFError as error:
            raise UserError("init: the answers ended before the questions") from error
        fits = [choice for choice in question.choices if choice.startswith(answer)] if answer else []
        if answer and (not question.choices or len(fits) == 1):
            return fits[0] if fits else answer


def setup_of(answers: Mapping[str, str]) -> Setup:
    """Answers as numbers. Raises UserError for what cannot be."""
    for flag, text in answers.items():
        if not text.isprintable() or (flag == "link" and " " in text):
            raise UserError(
                f"init: --{flag} {text[:MAX_QUOTED_LENGTH]!r}: no line ends, control characters or spaces in it"
            )
    try:
        check_link(answers["link"])
    except UserError as error:
        raise UserError(f"init: --link {answers['link']!r}: expected {LINK_WORDS}") from error
    if answers["link"].startswith("json:"):
        raise UserError(f"init: --link {answers['link']!r} is of a detector: expected {LINK_WORDS}")
    if answers["link"].startswith("serial:") and (baud := answers["link"].rpartition(":")[2]) not in BAUDS:
        raise UserError(
            f"init: --link: no autopilot has {baud[:MAX_QUOTED_LENGTH]} baud: expected one of {', '.join(BAUDS)}"
        )
    return Setup(
        autopilot=answers["autopilot"],
        link=answers["link"],
        camera=_camera(answers["camera"]),
        tilt=_number("tilt", answers["tilt"], -90.0, 90.0),
        aircraft=answers["aircraft"],
        span=_number("span", answers["span"], 0.05, 100.0),
        follows=answers["purpose"] == "follow",
        vehicle=answers.get("vehicle", "1"),
        calibration=None if IMAGE.fullmatch(answers["camera"]) else Path(answers["camera"]).absolute(),
    )


def _camera(text: str) -> tuple[str, ...]:
    """The keys of [camera] that describe the lens. Raises UserError."""
    found = IMAGE.fullmatch(text)
    if found is None:
        if not text.endswith((".yaml", ".yml")):
            raise UserError(f"init: --camera {text[:MAX_QUOTED_LENGTH]!r}: expected {CAMERA_WORDS}")
        return (f"calibration = {json.dumps(str(Path(text).absolute()), ensure_ascii=False)}",)
    width, height, number = int(found[1]), int(found[2]), float(found[3])
    if found[4] and not 1.0 <= number <= 150.0:
        raise UserError(f"init: --camera {text!r}: a field of view is from 1 to 150 degrees; name a calibration")
    f_px = round(0.5 * width / math.tan(math.radians(0.5 * number)), 1) if found[4] else number
    if not (width and height and f_px):
        raise UserError(f"init: --camera {text!r}: every number must be above 0")
    seen_deg = math.degrees(2.0 * math.atan(0.5 * width / f_px))
    if seen_deg > MAX_FIELD_ANGLE_DEG:
        raise UserError(
            f"init: --camera {text!r}: a focal length of {f_px:g} pixels is a field of view of {seen_deg:.0f} "
            f"degrees; {f_px:g} degrees are {width}x{height}:{f_px:g}deg, and a wider lens needs a calibration"
        )
    return (f"f_px = {f_px}", f"width_px = {float(width)}", f"height_px = {float(height)}")


def _number(flag: str, text: str, low: float, high: float) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        raise UserError(f"init: --{flag}: must be a number from {low:g} to {high:g}, not {text!r}")
    return number


def files_of(setup: Setup, program: Path | None = None) -> dict[str, str]:
    """The text of each file, by its name. `program`: which `onboard` the service starts, by default this one.
    Raises UserError for answers of which no configuration can be made."""
    files = {WRITTEN_CONFIG: configuration(setup), UNIT: service(program or _program(), setup.link)}
    try:
        parse_config(tomllib.loads(files[WRITTEN_CONFIG]))
    except ConfigError as error:
        raise UserError(f"init: {error}") from error
    if (calibration := setup.calibration) is not None and is_in(calibration, HOMES):
        files[CALIBRATION] = calibration.read_text(encoding="utf-8")
        own, copied = (json.dumps(str(path), ensure_ascii=False) for path in (calibration, ETC / CALIBRATION))
        files[WRITTEN_CONFIG] = files[WRITTEN_CONFIG].replace(own, copied)
    if parameters := autopilot_parameters(setup):
        files[PARAMETER_FILES[setup.autopilot]] = parameters
    return files


def configuration(setup: Setup) -> str:
    """The configuration file, with only what matters."""
    leader_class = "fixed_wing" if setup.aircraft == "fixed-wing" else "multirotor"
    lines = [
        "# One vehicle, written by `onboard init`. Try it on the ground: onboard check " + WRITTEN_CONFIG,
        "# All keys: docs/configuration.md.",
        "",
        "[[link]]",
        'name = "autopilot"',
        f"url = {json.dumps(setup.link, ensure_ascii=False)}",
        "",
        "[camera]",
        *setup.camera,
        f"mount_rpy_deg = [0.0, {setup.tilt}, 0.0]  # roll, pitch (up) and yaw of the camera against the vehicle",
        "",
        "[estimator.leader]",
        f"size_prior_m = {setup.span}  # the range can be no better, in percent: measure it",
        f'aircraft = "{setup.aircraft}"',
        f'leader_class = "{leader_class}"',
    ]
    if setup.follows:
        mode = "OFFBOARD" if setup.autopilot == "px4" else "GUIDED"
        lines += [
            "",
            f"[[leader_out]]  # leads the vehicle once the pilot enters {mode}",
            'link = "autopilot"',
            "rates_hz = { SET_POSITION_TARGET_LOCAL_NED = 25.0 }",
            "",
            "[guidance]",
            f"slot_m = {list(GuidanceConfig().slot_m)}  # from the leader: forward, right, down",
        ]
    lines += [
        "",
        "[zenoh]",
        f"vehicle = {json.dumps(setup.vehicle, ensure_ascii=False)}  # of each vehicle another",
        'mode = "router"',
        'listen = ["tcp/127.0.0.1:7447"]  # the detector sends here, `onboard status` and `view` look here',
        "",
        "[recorder]",
        'path = "flight.mcap"  # in the folder of the start: of the service, /var/lib/onboard',
        "file_mb = 200.0",
        "keep_mb = 4000.0  # the oldest recordings make room",
        "",
    ]
    return "\n".join(lines)


def service(program: Path, link: str = "") -> str:
    """The unit for systemd, which starts `program` on the configuration in /etc/onboard, and may open the serial
    device of `link`."""
    installed = INSTALLED if is_in(program, PRIVATE) else program
    text = shared_text(f"configs/{UNIT}").replace(str(INSTALLED), str(installed))
    kind, _, device = link.rpartition(":")[0].partition(":")
    driver = Path(device).resolve().name.rstrip("0123456789")
    if kind != "serial" or driver in ALLOWED:
        return text
    # A driver's name holds whenever the device comes; a path, where nothing says the driver, if it is there then.
    allowed = f"char-{driver}" if driver.startswith("tty") else device.replace("%", "%%")
    return text.replace("DeviceAllow=char-ttyS rw\n", f"DeviceAllow={allowed} rw\nDeviceAllow=char-ttyS rw\n")


def is_in(path: Path, folders: tuple[str, ...]) -> bool:
    """Whether a path is in one of these folders, as those that the unit cannot see."""
    return str(path).startswith(tuple(f"{folder}/" for folder in folders))


def autopilot_parameters(setup: Setup) -> str:
    """The parameters of the autopilot for a ground station to load; "" where none must be set."""
    kind, ending = setup.autopilot, Path(PARAMETER_FILES[setup.autopilot]).suffix
    texts = []
    if setup.link.startswith("serial:"):
        baud = setup.link.rpartition(":")[2]
        text = shared_text(f"configs/{kind}-serial{ending}")
        if baud != BAUD:
            old, new = (BAUD, baud) if kind == "px4" else (f"{BAUD[:-3]} ", f"{_ardupilot_baud(baud)} ".ljust(4))
            text = text.replace(BAUD + " Bd", baud + " Bd").replace(old, new)
        texts.append(text)
    if setup.follows:
        texts.append(shared_text(f"configs/{kind}-follow{ending}"))
    return "".join(texts)


def _ardupilot_baud(baud: str) -> str:
    """Return a baud rate as ArduPilot writes it: 57 is 57600, 1500 is 1500000."""
    return str(int(baud) // 1000)


def _program() -> Path:
    """This `onboard`, as a shell finds it; of `python -m onboard` where the package's programs are."""
    called = Path(sys.argv[0]).absolute()
    return called if called.name == "onboard" else Path(sys.executable).absolute().with_name("onboard")


def write(folder: Path, files: Mapping[str, str], *, force: bool) -> None:
    """Write all files, or none of them. Raises UserError."""
    make_folder(folder)
    there = [name for name in files if (folder / name).exists()]
    if there and not force:
        raise UserError(f"init: {folder} has {', '.join(there)} already; --force writes over it")
    try:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
            if name.endswith(".sh"):
                (folder / name).chmod(0o755)
    except OSError as error:
        raise UserError(f"cannot write {folder / name}: {error.strerror}") from error
    show(f"written to {folder}: {', '.join(files)}")


def next_steps(setup: Setup, folder: Path, files: tuple[str, ...]) -> list[str]:
    """Return the commands that a person types next."""
    config = shlex.quote(str(folder / WRITTEN_CONFIG))
    unit = shlex.quote(str(folder / UNIT))
    steps = []
    if CALIBRATION in files:
        copied = shlex.quote(str(folder / CALIBRATION))
        steps.append(f"sudo install -D -m 644 {copied} {ETC / CALIBRATION}    (the service sees no home)")
    if PARAMETER_FILES[setup.autopilot] in files:
        steps.append(
            f"load {folder / PARAMETER_FILES[setup.autopilot]} with a ground station, and restart the autopilot"
        )
    steps += [
        f"start your detector; it sends to onboard/{setup.vehicle}/camera/front/detections (docs/fly-it.md)",
        f"onboard check {config}",
        f"onboard run {config}, and beside it: onboard status, onboard view",
    ]
    if setup.follows:
        guide = "docs/ardupilot.md" if setup.autopilot == "ardupilot" else "docs/px4.md"
        steps.append(f"before the autopilot follows, read {guide}: in which order, and what silence does")
    install = []
    if is_in(_program(), PRIVATE):
        # The wheel's own file: who owns a name in an index runs as root here.
        install.append(f"sudo python3 -m venv {INSTALLED.parents[1]}")
        install.append(f"sudo {INSTALLED.with_name('pip')} install ./wingline-{__version__}-*.whl")
    install.append(f"sudo install -D -m 644 {config} {ETC / WRITTEN_CONFIG}")
    install.append(f"sudo install -m 644 {unit} /etc/systemd/system/")
    install.append("sudo systemctl enable --now onboard")
    return [
        "next:",
        *(f"  {number}. {step}" for number, step in enumerate(steps, 1)),
        "to start it at boot:",
        *(f"  {line}" for line in install),
    ]
