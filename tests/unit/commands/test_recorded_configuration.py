"""A recording holds the configuration that it was made with, and a replay flies with that."""

import json
from pathlib import Path

import msgspec
import pytest

from onboard.analysis.flights.replay import flight_of
from onboard.commands.recover import recover
from onboard.config import Config, ConfigError, flight_metadata, load_config, parse_config
from onboard.wire.logs.recording import CONFIGURATION, JSON, read_configuration
from tests.support.records import record
from tests.support.streams import Stream, encode
from tests.unit.commands.test_replay import replayed_numbers

SETS = ("camera.mount_rpy_deg=[0.0, 15.0, 0.0]", "estimator.leader.size_prior_m=2.4", "delay.camera_s=0.03")
FILES = sorted(Path("configs").glob("*.toml"))


def record_flight(file: Path, config: Config, *, cut: bool = False) -> None:
    record(file, encode(Stream(t1=8.0, sparse=True).items()), metadata=flight_metadata(config))
    if cut:
        file.write_bytes(file.read_bytes()[:-300])  # its end and part of the index


@pytest.mark.parametrize("file", [None, *FILES], ids=lambda file: file.name if file else "defaults")
def test_all_of_a_configuration_is_kept_that_estimates_depend_on(tmp_path: Path, file: Path | None) -> None:
    flown = load_config(file)
    record_flight(tmp_path / "flight.mcap", flown)
    again = load_config(tmp_path / "flight.mcap")
    here = {"zenoh", "router", "recorder", "parameters", "warm_start"}
    for name in Config.__struct_fields__:
        assert name in here or getattr(again, name) == getattr(flown, name), name


@pytest.mark.parametrize("cut", [False, True])
def test_a_replay_without_a_configuration_is_as_the_flight_was(tmp_path: Path, cut: bool) -> None:
    log, flown = tmp_path / "flight.mcap", load_config(None, SETS)
    record_flight(log, flown, cut=cut)
    found = flight_of(log).config
    assert found == log
    assert replayed_numbers(log, load_config(found)) == replayed_numbers(log, flown)
    assert load_config(found, ("camera.f_px=600",)).camera == msgspec.structs.replace(flown.camera, f_px=600.0)


def test_a_recovered_recording_has_it_too_and_one_without_flies_as_by_default(tmp_path: Path) -> None:
    log, recovered, old = tmp_path / "flight.mcap", tmp_path / "recovered.mcap", tmp_path / "old.mcap"
    record_flight(log, load_config(None, SETS), cut=True)
    recover(log, recovered)
    assert read_configuration(recovered) == read_configuration(log)
    record(old, [])
    assert flight_of(old).config is None
    assert flight_of(tmp_path / "absent.mcap").config is None


def test_each_file_of_a_flight_has_it_and_a_folder_s_own_file_comes_first(tmp_path: Path) -> None:
    record_flight(tmp_path / "flight.mcap", parse_config({}))
    assert flight_of(tmp_path).config == tmp_path / "flight.mcap"
    (tmp_path / "config.toml").write_text("[camera]\nf_px = 500.0\n")
    assert flight_of(tmp_path).config == tmp_path / "config.toml"


def test_one_of_another_version_is_named(tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    record(log, [], metadata={CONFIGURATION: {JSON: '{"camera": {"zoom": 2}}'}})
    with pytest.raises(ConfigError, match=r"recorded in .*flight\.mcap is invalid: .*zoom.*--config"):
        load_config(log)
    with pytest.raises(ConfigError, match="the configuration recorded in"):
        load_config(log, ("camera.f_px=500",))


def test_withdrawn_keys_of_an_older_recording_are_accepted_with_their_values(tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    leader = {"process_noise": {}, "filter": "belief", "own_position_time_s": 60.0, "own_attitude_time_s": 60.0}
    leader |= {"broadcast": {"altitude_sigma_m": None, "latency_sigma_s": 0.1}, "range": {"bias_m": 0.3}}
    errors = {"attitude_time_s": 60.0, "position_time_s": 60.0}
    delay = {"attitude_s": None, "imu_s": None, "global_position_s": None}
    table = {"estimator": {"leader": leader}, "ownship": {"errors": errors}, "delay": delay}
    record(log, [], metadata={CONFIGURATION: {JSON: json.dumps(table)}})
    assert load_config(log) == parse_config({"estimator": {"leader": {}}})
    leader["own_position_time_s"], other = 61.0, tmp_path / "other.mcap"
    record(other, [], metadata={CONFIGURATION: {JSON: json.dumps(table)}})
    with pytest.raises(ConfigError, match=r"own_position_time_s: it was withdrawn, and is always 60\.0"):
        load_config(other)


def test_a_wrong_override_is_not_the_recording_s(tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    record_flight(log, parse_config({}))
    with pytest.raises(ConfigError, match=r"^camera\.f_px") as caught:
        load_config(log, ("camera.f_px=wide",))
    assert "the configuration recorded in" not in str(caught.value)
