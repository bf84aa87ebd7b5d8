"""The page on security says what the code does: every limit, and who may read a recording."""

import importlib
import re
import stat
import tomllib
from pathlib import Path

import pytest

from onboard.commands import recover
from onboard.messages import Clock, Command
from onboard.sinks import recorder
from onboard.sinks.recorder import Recorder
from tests.support import documents
from tests.support.programs import ROOT
from tests.support.streams import EPOCH, Item, Stream, advance

WHO, LIMITS = documents.tables(documents.text("security"))
NUMBERED = [(documents.names(what)[0], int(limit.split()[0])) for what, limit, _ in LIMITS]


LARGE = ("peers",)  # of the extras: not installed with the others
S = "tests/faults/test_strangers.py::test_"
LISTEN, SURPLUS = "tests/unit/sinks/test_zenoh_listen.py::test_", "tests/unit/links/test_udp_surplus.py::test_"
FLOODS, BEYOND = "tests/faults/test_floods.py::test_", "tests/faults/test_limits.py::test_"
RANGES, STREAMS = "tests/unit/test_config_bounds.py::test_", "tests/unit/links/test_streams.py::test_"
SIGNING, LATCHING = "tests/unit/wire/test_signing.py::test_", "tests/faults/test_latching.py::test_"
BROADCAST = "tests/unit/estimators/leader/test_broadcast.py::test_"
FLEET, REFUSED = "tests/peers/test_fleet.py::test_", "tests/unit/health/test_refusals.py::test_"
RECORDER = "tests/unit/sinks/test_recorder_flood.py::test_"
MEASURED = "tests/unit/benchmarks/test_flooded.py::test_"
TEXT = "tests/unit/messages/test_text.py::test_"
CRAFTED = "tests/faults/test_strangers_files.py::test_"
NOTICES = "tests/unit/autopilot/test_notices.py::test_"
OWN = "tests/unit/documents/test_security.py::test_"
TESTS = {  # of each line of the table of who reaches what, by its first words
    "anyone on the network": (
        f"{LISTEN}by_default_the_loopback_interface_is_listened_on",
        "tests/peers/test_zenoh_session.py::test_the_default_listens_on_loopback_only_and_does_not_scout",
        "tests/unit/view/test_view.py::test_the_server_listens_on_loopback_only",
    ),
    "a stranger who sends": (
        f"{S}a_stranger_does_not_take_the_stream",
        f"{S}a_signed_frame_that_is_repeated_on_any_link_is_no_news",
        f"{S}what_we_send_is_refused_and_named_when_it_comes_back",
        f"{S}a_signed_frame_from_far_ahead_does_not_shut_the_owner_out",
        f"{STREAMS}tcpin_keeps_a_peer_that_gives_messages_and_names_who_else_knocks",
    ),
    "whoever sets a parameter": (
        f"{RANGES}a_parameter_that_cannot_fly_is_refused_with_the_reason_and_not_stored",
        f"{RANGES}every_parameter_has_a_range",
        "tests/unit/autopilot/test_parameters.py::test_without_a_file_parameters_are_read_only",
    ),
    "whoever asks us": (
        f"{S}answers_are_rationed_by_source_and_counted",
        f"{S}a_parameter_is_stored_beside_the_event_loop_and_of_several_the_newest",
        f"{S}strangers_without_number_share_one_ration",
        f"{NOTICES}the_words_of_others_never_push_out_what_concerns_our_own_state",
    ),
    "whoever writes the file": (f"{RANGES}the_file_of_stored_parameters_sets_nothing_else",),
    "a system that is not in": (
        f"{S}a_stranger_does_not_change_what_flies_the_vehicle",
        f"{S}a_refused_request_is_in_the_health",
    ),
    "anyone the autopilot routes": (
        f"{SIGNING}what_pymavlink_signs_enters_and_nothing_else_does",
        f"{LATCHING}another_autopilot_is_not_latched_while_ours_talks",
        "tests/faults/test_faulty_links.py::test_traffic_of_other_systems_mixed_in_changes_nothing",
        f"{OWN}no_command_ends_the_daemon_or_changes_an_estimate",
    ),
    "whoever sends a broadcast": (
        f"{BROADCAST}out_of_view_a_false_report_leads_an_estimate_no_farther_than_2_s",
        f"{BROADCAST}a_broadcast_that_led_elsewhere_is_counted_and_named",
        f"{BROADCAST}a_false_report_teaches_no_size_beyond_what_was_configured",
        f"{BROADCAST}another_systems_broadcast_is_not_used",
    ),
    "another program on this computer": (
        f"{LISTEN}with_tls_there_is_no_plain_listener",
        "tests/unit/wire/test_points.py::test_a_target_that_cannot_be_part_of_a_key_is_refused",
        f"{TEXT}no_text_from_outside_reaches_a_person_as_it_came",
    ),
    "a client of the Zenoh router": (
        f"{FLEET}nobody_enters_without_certificate_and_password",
        f"{FLEET}each_vehicle_has_its_own_keys_and_a_watcher_reads_all",
    ),
    "whoever floods a port": (
        f"{FLOODS}a_flood_of_one_sender_costs_that_sender_alone",
        f"{SURPLUS}in_a_flood_of_the_imu_all_else_arrives_and_the_newest_samples",
        f"{MEASURED}a_leader_in_all_floods_is_measured_and_what_is_left_out_is_counted",
    ),
    "whoever crafts a log": (
        "tests/faults/test_fuzz_bytes.py::test_mutated_bytes_raise_nothing_with_seed_17",
        f"{CRAFTED}formats_of_a_ulog_without_end_are_refused",
        f"{CRAFTED}no_link_in_a_flight_s_folder_is_followed",
        "tests/unit/commands/test_recover.py::test_damage_in_the_middle_is_said_and_the_rest_is_kept",
        "tests/unit/commands/test_replay_signed.py::test_with_the_key_a_replay_makes_what_the_flight_made",
        f"{RANGES}a_file_that_is_nested_ten_thousand_deep_is_refused_in_words",
    ),
    "whoever reads the disk": (f"{OWN}a_recording_and_its_folder_are_their_owner_s_alone",),
    "a supplier of a package": (f"{OWN}every_package_that_is_needed_is_pinned",),
}
DETECTED = "tests/unit/wire/test_detections.py::test_"
OF_LIMITS = {  # what lies beyond each limit
    "udp.MAX_SENDER_RATE": f"{FLOODS}a_flood_of_one_sender_costs_that_sender_alone",
    "udp.BURST_SIZE": f"{SURPLUS}the_later_we_are_the_fewer_are_delivered_so_that_we_are_late_no_longer",
    "udp.MIN_SURPLUS_COUNT": f"{SURPLUS}in_a_flood_of_the_imu_all_else_arrives_and_the_newest_samples",
    "udp.GROUP_SIZE": f"{SURPLUS}nothing_else_is_ever_left_out",
    "udp.MAX_SENDER_COUNT": f"{FLOODS}any_number_of_senders_shares_one_budget",
    "udp.RECEIVE_BUFFER_BYTES": (
        "tests/unit/links/test_udp_drops.py::test_the_buffer_that_the_kernel_grants_is_known"
    ),
    "tcp.READ_BYTES": f"{FLOODS}a_tcp_peer_that_floods_leaves_turns_to_other_links",
    "tcp.SEND_LIMIT": f"{STREAMS}a_tcp_client_drops_when_its_peer_does_not_read",
    "serial.SEND_LIMIT": f"{STREAMS}serial_reads_writes_and_drops_when_full",
    "zenoh.MAX_WAITING_COUNT": (
        "tests/unit/links/test_zenoh_flood.py::test_other_cameras_never_take_our_camera_s_room"
    ),
    "rations.MAX_BYTES": f"{S}answers_are_rationed_by_source_and_counted",
    "rations.BYTES_PER_S": f"{S}a_ration_is_whole_again_after_two_seconds_and_not_by_a_clock_that_goes_back",
    "rations.STORAGE_BYTES": f"{S}a_parameter_is_stored_beside_the_event_loop_and_of_several_the_newest",
    "rations.MAX_SOURCE_COUNT": f"{S}strangers_without_number_share_one_ration",
    "document.MAX_DOCUMENT_BYTES": f"{REFUSED}what_is_refused_is_named_within_a_second",
    "text.MAX_NAME_LENGTH": f"{TEXT}a_class_is_64_plain_letters_from_the_door_on",
    "text.MAX_LINE_LENGTH": f"{TEXT}no_text_from_outside_reaches_a_person_as_it_came",
    **dict.fromkeys(
        ("detections.MAX_UNNAMED", "detections.MAX_NAMED"),
        f"{DETECTED}of_too_many_detections_the_most_confident_ones_are_used_and_the_rest_named",
    ),
    "radar.MAX_ECHO_COUNT": f"{BEYOND}a_scan_that_a_document_could_hold_is_refused_beyond_the_limit",
    "pseudoranges.MAX_SATELLITE_COUNT": f"{BEYOND}a_scan_or_an_epoch_with_more_than_any_sensor_has_is_refused",
    "landing_target.MAX_PENDING_IMAGES": f"{BEYOND}images_that_stay_incomplete_cost_their_sender_its_oldest",
    "landing_target.MAX_SENDER_COUNT": (
        f"{BEYOND}any_number_of_senders_that_complete_nothing_costs_one_that_does_no_image"
    ),
    "recording.MAX_RECORD_BYTES": f"{BEYOND}a_record_whose_length_is_absurd_is_damage",
    "waiting.MAX_WAITING_COUNT": f"{BEYOND}images_beyond_the_room_do_not_wait",
    "monitor.MAX_ERROR_COUNT": f"{BEYOND}of_many_kinds_of_exceptions_all_are_counted_and_a_hundred_described",
    "refusals.MAX_REFUSAL_COUNT": f"{REFUSED}reasons_of_every_kind_have_room_for_the_latest",
    "refusals.MAX_SIMILAR_COUNT": f"{REFUSED}names_without_end_cost_no_other_refusal_its_count",
    "refusals.MAX_TEXT_LENGTH": f"{REFUSED}a_flood_of_kinds_gets_few_lines_and_little_room",
    "waiting.MAX_WAITING_REPORTS": f"{BEYOND}reports_beyond_the_room_are_full",
    "track.MAX_SOURCES_PER_TRACK": f"{BEYOND}of_the_sources_of_a_track_the_oldest_is_forgotten",
    "publication.MAX_PUBLISHED_TRACKS": "tests/unit/estimators/traffic/test_floods.py::"
    "test_publications_are_bounded_and_the_nearest_is_in_all_of_them",
    "recorder.RECORDER_CAPACITY": f"{RECORDER}datagrams_beyond_the_room_are_counted_apart",
    "recorder.MAX_CHANNEL_COUNT": f"{RECORDER}"
    "more_names_than_a_file_has_channels_for_cost_estimates_but_no_datagram",
    "recorder.MAX_TARGETS": f"{RECORDER}more_names_than_a_file_has_channels_for_cost_estimates_but_no_datagram",
    "sinks.zenoh.PUBLISHER_CAPACITY": f"{BEYOND}"
    "records_beyond_the_room_before_zenoh_cost_the_oldest_and_are_counted",
}


def test_every_line_of_who_reaches_what_has_its_tests() -> None:
    assert [who for who, *_ in WHO if sum(who.startswith(words) for words in TESTS) != 1] == []
    assert len(TESTS) == len(WHO)


def test_every_limit_has_a_test_of_what_lies_beyond() -> None:
    assert [name for name, _ in NUMBERED if sum(name.endswith(f".{last}") for last in OF_LIMITS) != 1] == []
    assert len(OF_LIMITS) == len(NUMBERED)


@pytest.mark.parametrize("test", sorted({*sum(TESTS.values(), ()), *OF_LIMITS.values()}))
def test_the_tests_are_there(test: str) -> None:
    file, _, name = test.partition("::")
    assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")


def test_no_command_ends_the_daemon_or_changes_an_estimate() -> None:
    """Each number of a MAVLink command, to us and from the autopilot, between the messages of a flight."""
    calm = Stream(t1=7.0).items()
    commands = [
        Item(
            EPOCH + 6 * 10**9 + n,
            Command(
                t_ns=0,
                t_recv_ns=EPOCH + 6 * 10**9,
                clock=Clock.NONE,
                system=1,
                component=1,
                target_system=1,
                target_component=191,
                command=number,
                params=(1.0,) * 7,
            ),
        )
        for n, number in enumerate(range(1, 3000, 7))
    ]
    both = sorted([*calm, *commands], key=lambda item: item.t_recv_ns)
    assert advance(i.message for i in both).estimates == advance(i.message for i in calm).estimates


def test_every_package_that_is_needed_is_pinned() -> None:
    pinned = {
        re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower()
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
        if re.fullmatch(r"[\w.-]+==[\w.!+-]+.*", line)
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = (names for extra, names in project["optional-dependencies"].items() if extra not in LARGE)
    needed = {*project["dependencies"], *(name for names in extras for name in names)}
    names = {re.split(r"[<>=!~\[; ]", name)[0] for name in needed}
    assert {re.sub(r"[-_.]+", "-", name).lower() for name in names} - pinned == set()


@pytest.mark.parametrize(("name", "number"), NUMBERED, ids=[name for name, _ in NUMBERED])
def test_a_limit_is_that_of_the_code(name: str, number: int) -> None:
    module, _, constant = name.rpartition(".")
    assert getattr(importlib.import_module(module), constant) == number


def test_a_recording_and_its_folder_are_their_owner_s_alone(tmp_path: Path) -> None:
    one = Recorder(tmp_path / "new" / "flight.mcap")
    one.open()
    one.close()
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o700
    path, file = recorder.create(tmp_path / "kept.mcap")
    file.close()
    assert stat.S_IMODE(path.stat().st_mode) == recover.FILE_MODE == 0o600
