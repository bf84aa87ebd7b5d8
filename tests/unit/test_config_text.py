"""Configuration as people write it: paths of a shell, files of other editors, names that look like numbers."""

from pathlib import Path

import pytest

from onboard.config import ConfigError, load_config

TABLES = """
[recorder]
path = "PLACE/flight.mcap"
[parameters]
path = "PLACE/set.toml"
[zenoh]
ca_file = "PLACE/ca.pem"
[[link]]
name = "a"
url = "udpin:127.0.0.1:14540"
key_file = "PLACE/key"
"""


@pytest.mark.parametrize("place", ["~", "$HOME", "${HOME}"])
def test_a_path_is_what_a_shell_makes_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "c.toml").write_text(TABLES.replace("PLACE", place))
    config = load_config(tmp_path / "c.toml")
    found = (config.recorder.path, config.parameters.path, config.zenoh.ca_file, config.link[0].key_file)
    assert found == tuple(f"{tmp_path}/{name}" for name in ("flight.mcap", "set.toml", "ca.pem", "key"))
    assert load_config(None, (f"recorder.path={place}/x.mcap",)).recorder.path == f"{tmp_path}/x.mcap"
    (tmp_path / "set.toml").write_text("[camera]\nsigma_px = 3.0\n")
    assert load_config(tmp_path / "c.toml").camera.sigma_px == 3.0


@pytest.mark.parametrize("place", ["~/x.mcap", "$HOME/x.mcap", "${HOME}/x.mcap", "~nobody-here/x.mcap"])
def test_a_home_that_is_not_known_is_one_line(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was a traceback, or a folder named $HOME."""

    def no_entry(_: int) -> None:
        raise KeyError

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("pwd.getpwuid", no_entry)
    with pytest.raises(ConfigError, match=r"^path: .*(home folder is unknown|is not set); write the full path"):
        load_config(None, (f"recorder.path={place}",))


def test_the_address_of_a_file_is_its_name(tmp_path: Path) -> None:
    (tmp_path / "a lens.yaml").write_text("image_width: 640\n")
    address = f"file://{tmp_path}/a%20lens.yaml"
    with pytest.raises(ConfigError, match=r"a lens\.yaml: it has no camera_matrix"):
        load_config(None, (f"camera.calibration='{address}'",))
    assert load_config(None, (f"recorder.path='file://{tmp_path}/x.mcap'",)).recorder.path == f"{tmp_path}/x.mcap"


def test_a_path_that_names_no_home_stays(tmp_path: Path) -> None:
    assert load_config(None, ("recorder.path='a~b$c.mcap'",)).recorder.path == "a~b$c.mcap"
    assert load_config(None, (f"recorder.path='{tmp_path}'",)).recorder.path == str(tmp_path)


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("\ufeff[camera]\r\nsigma_px = 2.0\r\n", encoding="utf-8")
    assert load_config(tmp_path / "c.toml").camera.sigma_px == 2.0


@pytest.mark.parametrize("text", ["484506", "4e1234", "000123", "4CA1F2"])
def test_an_address_of_digits_is_text(text: str) -> None:
    section = load_config(None, (f"estimator.leader.broadcast.icao={text}",)).estimator["leader"]
    assert section.broadcast.icao == text


@pytest.mark.parametrize("text", ["7", "0x1", "1.5", "true", "uav-1", "'7'"])
def test_a_key_for_text_takes_text(text: str) -> None:
    assert load_config(None, (f"zenoh.vehicle={text}",)).zenoh.vehicle == text.strip("'")
    assert load_config(None, (f"camera.name={text}",)).camera.name == text.strip("'")
    assert load_config(None, (f"zenoh.user={text}",)).zenoh.user == text.strip("'")


def test_a_key_for_a_number_takes_no_text() -> None:
    with pytest.raises(ConfigError, match=r"camera\.sigma_px"):
        load_config(None, ("camera.sigma_px=wide",))
    assert load_config(None, ("camera.sigma_px=2",)).camera.sigma_px == 2.0
