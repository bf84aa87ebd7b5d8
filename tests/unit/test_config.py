"""Configuration: an error is one line that names the place."""

from pathlib import Path

import msgspec
import pytest

from onboard.config import AutopilotConfig, Config, ConfigError, load_config, parse_config, source_delays_ns
from onboard.messages import Exposure, GpsFix, LocalPosition


def load(tmp_path: Path, text: str, *overrides: str) -> Config:
    path = tmp_path / "onboard.toml"
    path.write_text(text, encoding="utf-8")
    return load_config(path, overrides)


def refusal(tmp_path: Path, text: str, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text, *overrides)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_no_file_is_the_defaults_with_the_leader() -> None:
    config = load_config(None)
    assert list(config.estimator) == ["leader"]
    assert config.estimator["leader"].size_prior_m == 2.0
    assert config.camera.f_px == 554.256


def test_values_of_a_file_are_taken(tmp_path: Path) -> None:
    config = load(
        tmp_path,
        """
        [[link]]
        name = "serial"
        url = "serial:/dev/ttyAMA0:921600"
        [camera]
        mount_rpy_deg = [0, 15, 0]
        [estimator.leader]
        size_prior_m = 2.67
        particles = 400
        """,
    )
    assert config.link[0].name == "serial"
    assert config.camera.mount_rpy_deg == (0.0, 15.0, 0.0)
    assert config.estimator["leader"].particles == 400
    assert config.camera_model().R_bc[2, 0] == pytest.approx(-0.2588, abs=1e-4), "15 degrees up"


@pytest.mark.parametrize(
    ("text", "path", "known"),
    [
        ("camra = 1", "camra", ["camera", "estimator", "did you mean camera?"]),
        ("[camera]\nf_pix = 500", "camera.f_pix", ["f_px", "sigma_px"]),
        ("[zenoh]\nlistne = []", "zenoh.listne", ["listen", "connect"]),
        ('[[link]]\nname = "a"\nurl = "b"\nbaud = 5', "link[0].baud", ["name", "url"]),
        ("[estimator.leader]\nsize = 2", "estimator.leader.size", ["size_prior_m", "particles"]),
        ("[estimator.leader]\nedge_px = 2.0", "estimator.leader.edge_px: it was withdrawn, and is always 1.0", []),
        ("[estimator.traffic]\nquiet_time_s = 9.0", "it was withdrawn, and is always 170.0", []),
        ("[estimator.leader]\nown_yaw_sigma_deg = 2.0", "it was withdrawn; set ownship.errors.yaw_sigma_deg", []),
        ("[estimator.follower]\n", "estimator.follower", ["leader"]),
        ("[autopilot.rates_hz]\nATITUDE = 5.0", "autopilot.rates_hz.ATITUDE", []),
    ],
)
def test_an_unknown_key_is_named_with_those_known(tmp_path: Path, text: str, path: str, known: list[str]) -> None:
    line = refusal(tmp_path, text)
    assert path in line
    for name in known:
        assert name in line


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ('[camera]\nf_px = "wide"', "camera.f_px"),
        ("[camera]\nmount_rpy_deg = [0, 15]", "camera.mount_rpy_deg"),
        ('[camera]\nmount_rpy_deg = [0, 15, "a"]', "camera.mount_rpy_deg[2]"),
        ("camera = 5", "camera"),
        ("estimator = 5", "estimator"),
        ("[estimator]\nleader = 5", "estimator.leader"),
        ("[estimator.leader]\nsize_prior_m = true", "estimator.leader.size_prior_m"),
        ('[estimator.traffic]\nfilter = "loud"', "estimator.traffic.filter"),
        ("[estimator.leader]\nmax_targets = 1.5", "estimator.leader.max_targets"),
        ("[zenoh]\nvehicle = 7", "zenoh.vehicle"),
        ('[zenoh]\nmode = "broker"', "zenoh.mode"),
        ("link = 3", "link"),
        ('[[link]]\nname = "a"', "link[0]"),
        ("[camera]\nf_px = 1979-05-27", "camera.f_px"),
    ],
)
def test_a_value_of_the_wrong_type_is_named_by_its_path(tmp_path: Path, text: str, path: str) -> None:
    assert refusal(tmp_path, text).startswith((path, f"`{path}`"))


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("camera.f_px", ("0", "-1", "nan", "inf")),
        ("camera.width_px", ("0", "-640")),
        ("camera.height_px", ("0", "nan")),
        ("camera.sigma_px", ("0", "-1", "inf")),
        ("camera.mount_rpy_deg", ("[0, nan, 0]", "[inf, 0, 0]")),
        ("camera.mount_offset_m", ("[0, 0, nan]",)),
        ("delay.local_position_s", ("nan", "inf")),
        ("ownship.max_age_s", ("0", "inf")),
        ("autopilot.system", ("-1", "256")),
        ("autopilot.component", ("-1", "256")),
        ("autopilot.rates_hz.ATTITUDE_QUATERNION", ("-5", "nan", "inf")),
        ("estimator.leader.size_prior_m", ("0", "-2", "nan", "inf")),
        ("estimator.leader.size_prior_sigma_m", ("0", "-1", "nan")),
        ("ownship.errors.yaw_sigma_deg", ("-1", "nan")),
        ("estimator.leader.validity_timeout_s", ("-1", "0.1", "11.0", "nan")),
    ],
)
def test_numbers_that_make_no_sense_are_refused(tmp_path: Path, key: str, values: tuple[str, ...]) -> None:
    for value in values:
        line = refusal(tmp_path, "[estimator.leader]\n", f"{key}={value}")
        assert key.rsplit(".", 1)[-1] in line, line
        assert key.split(".", 1)[0] in line, line


def test_a_rate_changes_the_others_not_and_0_asks_for_none() -> None:
    default = AutopilotConfig().rates_hz
    faster = load_config(None, ("autopilot.rates_hz.ATTITUDE=20",)).autopilot.rates_hz
    assert faster == default | {"ATTITUDE": 20.0}
    fewer = parse_config({"autopilot": {"rates_hz": {"GPS_RAW_INT": 0.0}}}).autopilot.rates_hz
    assert fewer == {name: rate for name, rate in default.items() if name != "GPS_RAW_INT"}
    gimbal = {"gimbal": 154}
    silent = {"camera": gimbal, "autopilot": {"rates_hz": {"GIMBAL_DEVICE_ATTITUDE_STATUS": 0.0}}}
    assert parse_config(silent).autopilot.rates_hz == default


def test_set_reads_values_as_toml() -> None:
    config = load_config(
        None,
        (
            "camera.f_px=600",
            "camera.mount_rpy_deg=[0, 15, 0]",
            "camera.name=nose",
            'zenoh.vehicle="7"',
            "zenoh.enabled=false",
            "estimator.leader.range.sigma_m=.5",  # as people write it
            "estimator.leader.range.sensor=1",
            "camera.sigma_px=2.",
            "recorder.path=flights/a=b.mcap",
            " autopilot.system = 3 ",
        ),
    )
    assert config.camera.f_px == 600.0
    assert config.camera.mount_rpy_deg == (0.0, 15.0, 0.0)
    assert config.camera.sigma_px == 2.0
    assert config.camera.name == "nose"
    assert config.zenoh.vehicle == "7"
    assert config.zenoh.enabled is False
    assert config.estimator["leader"].range.sigma_m == 0.5
    assert config.recorder.path == "flights/a=b.mcap"
    assert config.autopilot.system == 3


@pytest.mark.parametrize("override", ["", "=", "=5", "camera.f_px", "camera..f_px=5", "camera.=5", ".=5"])
def test_a_bad_set_is_refused(override: str) -> None:
    with pytest.raises(ConfigError):
        load_config(None, (override,))


def test_set_cannot_reach_into_a_value(tmp_path: Path) -> None:
    line = refusal(tmp_path, "[camera]\nf_px = 500\n", "camera.f_px.wide=5")
    assert "f_px" in line


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        load_config(tmp_path / "nowhere.toml")
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(tmp_path)


@pytest.mark.parametrize("data", [b"camera = [", b"\xff\xfe\x00", b"a b c"])
def test_what_is_no_toml_is_said(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "onboard.toml"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match="is not TOML"):
        load_config(path)


def test_delays_are_those_of_the_autopilot_unless_configured() -> None:
    delay = load_config(None).delay
    ardupilot, px4 = source_delays_ns(delay, 3), source_delays_ns(delay, 12)
    assert (ardupilot[LocalPosition], ardupilot[GpsFix]) == (22_500_000, 95_000_000)
    assert set(px4.values()) == {0}
    mine = load_config(None, ("delay.local_position_s=0.0", "delay.camera_s=0.04")).delay
    assert source_delays_ns(mine, 3)[LocalPosition] == 0
    assert source_delays_ns(mine, 3)[Exposure] == 40_000_000


def test_the_errors_of_our_own_estimates_are_given_to_every_estimator(tmp_path: Path) -> None:
    text = "[estimator.leader]\n[estimator.own_state]\n[estimator.traffic]\n[ownship.errors]\n"
    config = load(tmp_path, f"{text}yaw_sigma_deg = 2.5\nvelocity_sigma_m_s = 0.3\ntilt_sigma_deg = 0.7\n")
    leader, own, traffic = (config.estimator[name] for name in ("leader", "own_state", "traffic"))
    assert (leader.own_yaw_sigma_deg, own.own_yaw_sigma_deg, traffic.own_yaw_sigma_deg) == (2.5, 2.5, 2.5)
    assert (leader.own_velocity_sigma_m_s, traffic.own_velocity_sigma_m_s) == (0.3, 0.3)
    assert (leader.own_tilt_sigma_deg, own.own_tilt_sigma_deg) == (0.7, 0.7)
    assert traffic.own_tilt_sigma_deg == 0.5, "its own default"


def test_a_table_of_all_values_gives_the_same_configuration(tmp_path: Path) -> None:
    text = "[estimator.leader]\n[ownship.errors]\nyaw_sigma_deg = 2.5\n[target.boat]\nsize_prior_m = 3.0\n"
    config = load(tmp_path, text)
    assert parse_config(config.table()) == config
    older = msgspec.json.decode(msgspec.json.encode(config))  # with the keys that the leader receives
    older["estimator"]["leader"]["edge_px"] = 1.0
    assert parse_config(older) == config


def test_without_shared_errors_the_defaults_are_the_estimators_own(tmp_path: Path) -> None:
    names = ("leader", "own_state", "traffic")
    config = load(tmp_path, "".join(f"[estimator.{name}]\n" for name in names))
    for name in names:
        assert config.estimator[name] == type(config.estimator[name])()
