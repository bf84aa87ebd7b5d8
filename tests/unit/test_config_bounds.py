"""Numbers out of bounds are refused, in the file and as parameters alike; those at the bounds are not."""

from pathlib import Path

import pytest

from onboard.autopilot.parameters import KEYS, Parameters
from onboard.config import ConfigError, load_config
from onboard.config.bounds import CAMERA_RANGES, RANGES, TUNABLE, out_of_range
from onboard.messages import Estimate
from onboard.sinks import SinkError
from onboard.sinks.recorder import Recorder
from tests.support.faulty_flight import DATAGRAMS
from tests.support.streams import feed, make_config

LEADER = "estimator.leader.size_prior_m=2.5"
CANNOT = [
    ("CAM_F_PX", 1e-45),
    ("CAM_F_PX", 1e20),
    ("CAM_F_PX", 1.0),
    ("CAM_SIGMA_PX", 100.0),
    ("CAM_SIGMA_PX", 1e-30),
    ("OWN_YAW_DEG", 1e9),
    ("OWN_TILT_DEG", 1e9),
    ("OWN_VEL_M_S", 1e6),
    ("LDR_SIZE_M", 1e-9),
    ("LDR_SIZE_M", 1e9),
    ("LDR_SIZE_SIG_M", 1e9),
    ("LDR_DELAY_SIG_S", 1e3),
    ("LDR_VALID_S", 1e30),
    ("CAM_X_M", 3e38),
    ("CAM_Y_M", -3e38),
    ("CAM_Z_M", 51.0),
    ("CAM_ROLL_DEG", 1e9),
    ("CAM_YAW_DEG", -361.0),
    ("CAM_DELAY_S", 1e9),
]


@pytest.mark.parametrize(("name", "value"), CANNOT)
def test_a_parameter_that_cannot_fly_is_refused_with_the_reason_and_not_stored(name: str, value: float) -> None:
    stored: list[object] = []
    parameters = Parameters(load_config(None, (LEADER,)), stored.append)
    before = parameters.value(name)
    reason = parameters.set(name, value)
    key = KEYS[name][0]
    assert reason.startswith(f"{name} = ")
    assert not stored
    assert parameters.value(name) == before
    if not key[-1].isdecimal():
        with pytest.raises(ConfigError, match=r"is out of range; expected|must") as refused:
            load_config(None, (LEADER, f"{key}={value!r}"))
        assert str(refused.value).split(";")[0].rpartition(": ")[2] in reason


def test_every_parameter_has_a_range() -> None:
    for key, _ in KEYS.values():
        section, _, rest = key.partition(".")
        assert key in RANGES or (
            section == "camera" and rest.split(".")[0] in {*CAMERA_RANGES, "f_px", "sigma_px"}
        )


def test_further_cameras_and_arrays_are_named() -> None:
    with pytest.raises(
        ConfigError, match=r"^cameras\.rear\.mount_offset_m\[1\]: 60 is out of range; expected -50 to 50"
    ):
        load_config(None, ("cameras.rear.mount_offset_m=[0, 60, 0]",))
    with pytest.raises(ConfigError, match=r"^cameras\.rear\.f_px: 1 "):
        load_config(None, ("cameras.rear.f_px=1",))


def test_the_defaults_are_within() -> None:
    assert not list(out_of_range(load_config(None, (LEADER,))))


@pytest.mark.parametrize("setting", ["camera.sigma_px=12", "camera.sigma_px=0.0064"])
def test_at_the_bounds_estimates_are_valid(setting: str) -> None:
    run = feed(DATAGRAMS, make_config(setting))
    assert any(e.valid for e in run.outputs if isinstance(e, Estimate))


@pytest.mark.parametrize(
    "line",
    [
        'recorder.path = "/tmp/x.mcap"',
        'link = [{name = "a", url = "udpin:0.0.0.0:1"}]',
        "autopilot.trusted = [66]",
    ],
)
def test_the_file_of_stored_parameters_sets_nothing_else(tmp_path: Path, line: str) -> None:
    stored, file = tmp_path / "set.toml", tmp_path / "onboard.toml"
    file.write_text(f'[parameters]\npath = "{stored}"\n', encoding="utf-8")
    stored.write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="is not a parameter; move it to the configuration file"):
        load_config(file)
    stored.write_text("camera.f_px = 610.0\n", encoding="utf-8")
    assert load_config(file).camera.f_px == 610.0


def test_every_parameter_is_read_again() -> None:
    assert {key.rstrip("012").rstrip(".") for key, _ in KEYS.values()} == TUNABLE


@pytest.mark.parametrize("text", ["a = " + "[" * 10_000, "a = " + "{b = " * 10_000])
def test_a_file_that_is_nested_ten_thousand_deep_is_refused_in_words(tmp_path: Path, text: str) -> None:
    (tmp_path / "deep.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="nested too deeply"):
        load_config(tmp_path / "deep.toml")


@pytest.mark.parametrize("path", ["/dev/full", "/dev/null/flight.mcap", "/dev"])
def test_what_cannot_hold_a_recording_is_refused_at_the_start(path: str) -> None:
    with pytest.raises(SinkError, match="cannot record to"):
        Recorder(Path(path)).check()
