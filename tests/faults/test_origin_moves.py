"""GPS_GLOBAL_ORIGIN: the autopilot moves its origin in flight."""

from functools import cache
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.config import load_config
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Clock,
    Datagram,
    Encoding,
    GlobalPosition,
    GpsFix,
    Imu,
    NavState,
)
from tests.support.faulty_flight import ITEMS, T0, T1
from tests.support.streams import EPOCH, MS, Item, Run, S, Stream, encode, feed


def origin(t_s: int, lat_deg: float, alt: float, *, component: int = 1) -> Datagram:
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=component)
    frame = dialect.MAVLink_gps_global_origin_message(round(lat_deg * 1e7), 80_000_000, round(alt * 1000))
    t_recv_ns = EPOCH + t_s * S + 5 * MS
    return Datagram(channel="origin", encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=frame.pack(sender))


def flight(origins: list[Datagram]) -> Run:
    config = load_config(None, ("estimator={own_state={}}",))
    return feed(sorted([*own_and_traffic(), *origins], key=lambda d: d.t_recv_ns), config)


@cache
def unmoved() -> Run:
    """The flight without a word about the origin."""
    return flight([])


def states(run: Run) -> list[NavState]:
    return [e for e in run.estimates if isinstance(e, NavState)]


@pytest.mark.parametrize(("lat_deg", "alt"), [(47.001, 500.0), (46.9, 500.0), (47.0, 520.0)])
def test_our_own_state_begins_anew_at_an_origin_that_has_moved(lat_deg: float, alt: float) -> None:
    origins = [origin(t, *((47.0, 500.0) if t < 47 else (lat_deg, alt))) for t in range(44, 52)]
    run = flight(origins)
    before, after = [s for s in states(run) if s.t_ns < 47 * S][-1], states(run)[-1]
    assert before.valid
    assert after.valid
    assert after.reset_count == before.reset_count + 1
    assert after.origin == pytest.approx((lat_deg, 8.0, alt), abs=1e-6)
    assert before.mean is not None
    assert after.mean is not None
    assert any(not s.valid and s.reason == "the autopilot has moved its origin" for s in states(run))


@pytest.mark.parametrize("component", [1, 154])
def test_an_origin_that_stays_or_is_of_another_component_changes_nothing(component: int) -> None:
    by = 1e-7 if component == 1 else 1.0
    origins = [origin(t, 47.0 + t % 2 * by, 500.0, component=component) for t in range(44, 52)]
    assert [s.mean for s in states(flight(origins))] == [s.mean for s in states(unmoved())]


@cache
def own_and_traffic() -> list[Any]:
    """The flight with an IMU, fixes, and another aircraft's transponder."""
    more: list[Item] = []
    for ms in range(round(T0 * 1000), round(T1 * 1000), 20):
        t_ns = ms * MS
        k = Stream().flight.at(ms / 1000)
        lat, lon = 47.0 + k.r[0] / 111_320, 8.0 + k.r[1] / 75_900
        imu = Imu(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, f_b=(0.0, 0.0, -9.81), omega_b=(0.0, 0.0, 0.15))
        more.append(Item(EPOCH + t_ns + 2 * MS, imu))
        if ms % 200 == 0:
            fix = GpsFix(
                t_ns=t_ns,
                t_recv_ns=EPOCH + t_ns,
                fix_type=3,
                satellites=12,
                lat_deg=lat,
                lon_deg=lon,
                alt_msl=500.0 - k.r[2],
                ground_speed=15.0,
                course_rad=k.rpy[2] % 6.28,
                h_acc=1.0,
                v_acc=1.0,
            )
            more.append(Item(EPOCH + t_ns + 3 * MS, fix))
        if ms % 100 == 0:
            where = GlobalPosition(
                t_ns=t_ns,
                t_recv_ns=EPOCH + t_ns,
                lat_deg=lat,
                lon_deg=lon,
                alt_msl=500.0 - k.r[2],
                height=-k.r[2],
                v_F_n=tuple(k.v.tolist()),
                heading_rad=None,
            )
            more.append(Item(EPOCH + t_ns + 3 * MS, where))
        if ms % 1000 == 0:
            more.append(Item(EPOCH + t_ns + 4 * MS, adsb(t_ns)))
    return encode(sorted([*ITEMS, *more], key=lambda item: item.t_recv_ns))


def adsb(t_ns: int) -> AdsbVehicle:
    return AdsbVehicle(
        t_ns=t_ns,
        t_recv_ns=EPOCH + t_ns,
        clock=Clock.NONE,
        icao=0x4B1A2C,
        lat_deg=47.02,
        lon_deg=8.0,
        altitude=600.0,
        altitude_type=AltitudeType.GEOMETRIC,
        course=0.0,
        ground_speed=0.0,
        climb=0.0,
        callsign="HBABC",
        emitter=1,
        tslc=0.0,
        squawk=7000,
    )
