"""Parameters as a ground station lists, reads and sets them, in pymavlink's frames."""

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.parameters import KEYS, Parameters
from onboard.config import Config, ConfigError, load_config, read_stored, store
from onboard.wire.mavlink.decode import MavlinkDecoder
from tests.support.leader import AUTOPILOT, S

NOW = 1_800_000_000 * S


class Station:
    """A ground station of pymavlink's, and the daemon's side of the link."""

    def __init__(self, config: Config, path: Path | None = None) -> None:
        keep = None if path is None else lambda table: store(path, table)
        stored = None if path is None else read_stored(path)
        self.refused: list[str] = []
        parameters = Parameters(config, keep, stored)
        self.output = AutopilotOutput(config, parameters, refuse=lambda _, why, __: self.refused.append(why.words))
        self.output.connect(AUTOPILOT)
        self._mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)

    def send(self, message: Any) -> list[Any]:
        """What is answered."""
        messages = MavlinkDecoder(stream=False).decode(message.pack(self._mav), NOW)
        parser = dialect.MAVLink(None)
        frames = self.output.respond("autopilot", messages, NOW).frames
        return [m for frame in frames for m in parser.parse_buffer(frame) or []]

    def set(self, name: str, value: float) -> list[Any]:
        """Set a parameter."""
        return self.send(dialect.MAVLink_param_set_message(7, 191, name.encode(), value, 9))


def config(*settings: str) -> Config:
    return load_config(None, ("estimator.leader.size_prior_m=2.5", *settings))


def test_names_fit_and_every_key_exists() -> None:
    assert all(len(name) <= 16 for name in KEYS)
    assert Parameters(config()).names == tuple(KEYS)
    without = load_config(None, ("estimator={}",))
    assert not any(name.startswith("LDR") for name in Parameters(without).names)


@pytest.mark.parametrize("component", [191, 0])
def test_a_list_has_every_parameter_with_its_value(component: int) -> None:
    answers = Station(config()).send(dialect.MAVLink_param_request_list_message(7, component))
    assert [m.param_id for m in answers] == list(KEYS)
    assert [(m.param_index, m.param_count, m.param_type) for m in answers] == [
        (i, len(KEYS), 9) for i in range(len(KEYS))
    ]
    assert (answers[0].get_srcSystem(), answers[0].get_srcComponent()) == (7, 191)
    values = {m.param_id: m.param_value for m in answers}
    assert values["LDR_SIZE_M"] == 2.5
    assert values["LDR_SIZE_SIG_M"] == pytest.approx(0.05)  # not set: 2 %
    assert values["CAM_DELAY_S"] == 0.0
    assert Station(config()).send(dialect.MAVLink_param_request_list_message(7, 1)) == []


def test_one_is_read_by_name_or_by_number_and_a_wrong_name_is_not_answered() -> None:
    station = Station(config())
    for number, name in ((-1, b"CAM_F_PX"), (7, b"")):
        (m,) = station.send(dialect.MAVLink_param_request_read_message(7, 191, name, number))
        assert (m.param_id, m.param_value) == ("CAM_F_PX", pytest.approx(554.256))
    assert station.send(dialect.MAVLink_param_request_read_message(7, 191, b"CAM_F", -1)) == []
    assert station.send(dialect.MAVLink_param_request_read_message(7, 191, b"", 99)) == []


def test_a_value_that_is_set_is_kept_and_holds_after_a_restart(tmp_path: Path) -> None:
    stored, file = tmp_path / "set.toml", tmp_path / "onboard.toml"
    file.write_text(f'[camera]\nf_px = 600.0\n[parameters]\npath = "{stored}"\n', encoding="utf-8")
    for name, value in (("CAM_F_PX", 610.5), ("CAM_PITCH_DEG", 15.0), ("LDR_SIZE_M", 0.3)):
        (m,) = Station(load_config(file), stored).set(name, value)  # a restart before each
        assert (m.get_type(), m.param_id, m.param_value) == ("PARAM_VALUE", name, pytest.approx(value))
    after = load_config(file)
    assert after.camera.f_px == 610.5
    assert after.camera.mount_rpy_deg == (0.0, 15.0, 0.0)
    assert after.estimator["leader"].size_prior_m == 0.3  # as a person writes it, not as 32 bits have it
    assert load_config(file, ("camera.f_px=300.0",)).camera.f_px == 300.0
    assert stored.stat().st_mode & 0o777 == 0o640
    stored.write_text("[camera]\nf_px = -1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"camera\.f_px"):
        load_config(file)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("CAM_F_PX", -5.0, "CAM_F_PX = -5: expected `float` > 0.0"),
        ("CAM_F_PX", float("nan"), "expected a finite number"),
        ("LDR_VALID_S", 0.001, "LDR_VALID_S = 0.001: coast_after_s"),  # shorter than coasting
    ],
)
def test_a_value_that_the_file_could_not_have_is_refused_and_said(
    tmp_path: Path, name: str, value: float, reason: str
) -> None:
    path = tmp_path / "set.toml"
    station = Station(config(), path)
    before = Parameters(config()).value(name)
    (m,) = station.set(name, value)
    assert m.param_value == pytest.approx(before)
    assert not path.exists()
    (line,) = station.refused
    assert reason in line


def test_without_a_file_parameters_are_read_only() -> None:
    station = Station(config())
    assert station.set("CAM_F_PX", 700.0)[0].param_value == pytest.approx(554.256)
    assert station.refused == ["CAM_F_PX is read-only: set `parameters.path`"]
    assert station.output.take_lines() == [], "ten a second would fill the console"


def test_a_disk_that_fails_refuses_the_value(tmp_path: Path) -> None:
    station = Station(config(), tmp_path / "gone" / "set.toml")
    assert station.set("CAM_F_PX", 700.0)[0].param_value == pytest.approx(554.256)
    assert "cannot be stored" in station.refused[0]


def test_the_extended_protocol_says_the_same_in_text(tmp_path: Path) -> None:
    station = Station(config(), tmp_path / "set.toml")
    answers = station.send(dialect.MAVLink_param_ext_request_list_message(7, 191))
    assert [m.param_id for m in answers] == list(KEYS)
    (m,) = station.send(dialect.MAVLink_param_ext_request_read_message(7, 191, b"LDR_SIZE_M", -1))
    assert (m.get_type(), m.param_value, m.param_type) == ("PARAM_EXT_VALUE", "2.5", 9)
    for text, result, value in ((b"3.25", 0, "3.25"), (b"wide", 2, "3.25"), (b"-1", 2, "3.25")):
        (ack,) = station.send(dialect.MAVLink_param_ext_set_message(7, 191, b"LDR_SIZE_M", text, 9))
        assert (ack.get_type(), ack.param_result, ack.param_value) == ("PARAM_EXT_ACK", result, value)
