"""The files that are installed with the package, under `onboard/share`: configurations, the service unit,
parameter files and examples."""

from collections.abc import Mapping
from importlib.resources import files
from typing import Final

TOGETHER: Final[Mapping[str, tuple[str, ...]]] = {  # what `onboard init --example NAME` copies
    "companion": ("configs/companion.toml", "configs/onboard.service"),
    "demo": ("configs/demo.toml",),
    "detector": (
        "configs/detector.toml",
        *(f"examples/{name}.py" for name in ("contour", "learned", "learned_train", "live", "tag")),
    ),
    "fleet": (
        "configs/fleet.toml",
        "configs/router.toml",
        "configs/ground.toml",
        "configs/make-test-certificates.sh",
    ),
    "live": ("examples/live.py",),
    "sitl": ("configs/sitl.toml", "configs/ardupilot-follow.parm", "configs/px4-follow.params"),
    "traffic": ("configs/traffic.toml",),
    "wiring": ("configs/ardupilot-serial.parm", "configs/px4-serial.params"),
}


def shared_text(name: str) -> str:
    """The text of a file, by its folder and name, such as `configs/fleet.toml`."""
    return files("onboard").joinpath("share", name).read_text(encoding="utf-8")


def copied_text(name: str) -> str:
    """The same as it reads beside the other files of its example: all are in one folder."""
    return shared_text(name).replace("configs/", "./").replace("examples/", "./")
