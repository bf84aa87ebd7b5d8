"""Latitude and longitude 0: what a sender without a position reports, whoever it is."""

import pytest
from msgspec.structs import replace

from onboard.estimators.kit.peer_position import ReportedPosition, of_adsb, of_peer
from onboard.estimators.own_state.sources import is_place
from onboard.messages import PeerPosition, Verdict
from tests.support.traffic import Sky

SKY = Sky()
ADSB = SKY.adsb((2000.0, 0.0, -100.0), (-30.0, 0.0, 0.0))


@pytest.mark.parametrize(("lat", "lon", "known"), [(0.0, 0.0, False), (0.0, 8.0, True), (47.0, 0.0, True)])
def test_a_report_of_nowhere_is_no_position(lat: float, lon: float, known: bool) -> None:
    moved = replace(ADSB, lat_deg=lat, lon_deg=lon)
    found = of_adsb(moved, geoid_undulation=0.0, pressure_altitude_offset=0.0, fastest=300.0)
    assert (found is not Verdict.NO_POSITION) == known
    peer = PeerPosition(
        t_ns=0, t_recv_ns=0, lat_deg=lat, lon_deg=lon, alt_msl=500.0, v_n=(0.0, 0.0, 0.0), system=9
    )
    reported = ReportedPosition((lat, lon, 500.0), (0.0, 0.0, 0.0), has_level=True, has_climb=True)
    assert of_peer(peer, fastest=300.0) == (reported if known else Verdict.NO_POSITION)
    assert is_place((lat, lon, 500.0)) == known
