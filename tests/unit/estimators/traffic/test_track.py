"""A track's counts, and when it is believed to be there."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from onboard.estimators.traffic.publication import _intruder
from onboard.estimators.traffic.track import Track
from tests.support.vehicle_records import APPROACH

S = 1_000_000_000
HEARD: Any = SimpleNamespace(t_ns=5 * S, source="adsb", adsb=None)


def test_reports_confirm_a_track_that_a_radar_began_with_the_second() -> None:
    track = Track("radar/1", None, 1, 4 * S, {"radar": 4 * S})
    once = track.reported(HEARD, None)  # its verdict is no matter here
    assert (once.report_count, once.confirmed) == (1, False)
    twice = once.reported(HEARD, None)
    assert (twice.report_count, twice.confirmed) == (2, True)
    assert twice.reported(HEARD, None).report_count == 3


def test_what_no_adsb_says_is_not_made_up() -> None:
    track = Track("system/7", ("system", 7), 1, 4 * S, {})
    who = _intruder(track, [47.0, 8.0, 500.0], list(np.zeros(3)), APPROACH)
    assert (who.icao, who.system, who.callsign, who.squawk, who.emitter) == (None, 7, "", None, 0)
