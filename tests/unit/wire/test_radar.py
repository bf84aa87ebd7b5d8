"""Radar scans as JSON: good documents and impossible ones."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onboard.messages import Clock, RadarDetection, Reason
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.radar import decode_radar
from tests.support.mavlink_frames import RECEIVE_TIME_NS

ECHO = {"range": 1234.5, "azimuth": -0.25, "elevation": 0.125}


def document(**changes: Any) -> bytes:
    whole = {"t_ns": 41_000_000_000, "clock": "boot", "radar": "nose", "detections": [ECHO]} | changes
    return json.dumps(whole).encode()


def test_a_radar_scan_from_json() -> None:
    scan = decode_radar(document(), RECEIVE_TIME_NS)
    assert (scan.t_ns, scan.t_recv_ns, scan.clock, scan.system) == (41_000_000_000, RECEIVE_TIME_NS, Clock.BOOT, 0)
    assert (scan.radar, scan.frame) == ("nose", "body")
    assert scan.detections == (RadarDetection(range=1234.5, azimuth=-0.25, elevation=0.125),)
    assert decode_radar(document(detections=[]), RECEIVE_TIME_NS).detections == ()
    assert decode_radar(document(frame="ned"), RECEIVE_TIME_NS).frame == "ned"
    (echo,) = decode_radar(document(detections=[ECHO | {"sigma": [5.0, 0.01, 0.02]}]), RECEIVE_TIME_NS).detections
    assert echo.sigma == (5.0, 0.01, 0.02)


@pytest.mark.parametrize(
    "changes",
    [
        {"t_ns": 2**63},
        {"frame": "enu"},
        {"clock": "wall"},
        {"extra": 1},
        {"detections": [ECHO | {"range": 0.0}]},
        {"detections": [ECHO | {"range": 1e8}]},
        {"detections": [ECHO | {"azimuth": 7.0}]},
        {"detections": [ECHO | {"elevation": 1.6}]},
        {"detections": [ECHO | {"sigma": [1.0, 0.0, 1.0]}]},
        {"detections": [ECHO | {"sigma": [1.0, 1.0]}]},
        {"detections": [ECHO | {"range": float("nan")}]},
        {"detections": [ECHO] * 5000},
    ],
    ids=str,
)
def test_an_impossible_scan_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(BadDocumentError):
        decode_radar(document(**changes), RECEIVE_TIME_NS)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.binary(max_size=200))
def test_random_bytes_raise_our_own_error(data: bytes) -> None:
    with pytest.raises(BadDocumentError):
        decode_radar(data, RECEIVE_TIME_NS)


@pytest.mark.parametrize(
    ("odd", "field"),
    [
        ({"range": float("nan")}, "range"),
        ({"azimuth": "left"}, "azimuth"),
        ({"snr_db": "high"}, "snr_db"),
        ({"sigma": [1.0, None, 1.0]}, "sigma[1]"),
        ({"range": 0.0}, ""),
    ],
    ids=str,
)
def test_an_echo_that_cannot_be_used_costs_the_others_nothing(odd: dict[str, Any], field: str) -> None:
    reasons: list[Reason] = []
    scan = decode_radar(document(detections=[ECHO | odd, ECHO]), RECEIVE_TIME_NS, reasons.append)
    assert scan == decode_radar(document(), RECEIVE_TIME_NS)
    (reason,) = reasons
    assert reason.words.endswith(f"at `$.detections[0]{'.' if field else ''}{field}`")


def test_a_scan_of_which_no_echo_can_be_used_is_not_an_empty_one() -> None:
    with pytest.raises(BadDocumentError, match=r"detections\[0\].range"):
        decode_radar(document(detections=[ECHO | {"range": None}]), RECEIVE_TIME_NS, lambda _: None)
