"""A leader that broadcasts its own position, in the flights of `streams`."""

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import FollowTarget, GlobalPosition
from tests.support.streams import CIRCLE, EPOCH, FLIGHT_SYSTEM_ID, MS, Flight, Item

ORIGIN: Final = (47.4, 8.5, 500.0)
LEADER_SYSTEM_ID: Final = 42
LATENCY: Final = 200 * MS
OWN_PERIOD_MS: Final = 200

Error = Callable[[float], Array]


def no_error(_t: float) -> Array:
    """An exact position."""
    return np.zeros(3)


def white(sigma: float, seed: int) -> Error:
    """A position with an error of `sigma` m on each axis that is new in each report."""
    rng = np.random.default_rng(seed)
    return lambda _t: sigma * rng.normal(size=3)


def own_positions(t0: float, t1: float, flight: Flight = CIRCLE) -> list[Item]:
    """Our autopilot's GLOBAL_POSITION_INT, five times a second."""
    items = []
    for ms in range(round(t0 * 1000), round(t1 * 1000), OWN_PERIOD_MS):
        k = flight.at(ms / 1000)
        items.append(_position(ms * MS, 2 * MS, k.r, k.v, FLIGHT_SYSTEM_ID))
    return items


def leader_positions(
    t0: float,
    t1: float,
    flight: Flight = CIRCLE,
    error: Error = no_error,
    system: int = LEADER_SYSTEM_ID,
    period: float = 1.0,
) -> list[Item]:
    """The leader's GLOBAL_POSITION_INT, true `LATENCY` before it arrives."""
    items = []
    for t in np.arange(t0, t1, period).tolist():
        k = flight.at(t, flight.gap)
        items.append(_position(round(t * 1000) * MS, LATENCY, k.r + error(t), k.v, system))
    return items


def follow_target(t: float, flight: Flight = CIRCLE, system: int = LEADER_SYSTEM_ID) -> Item:
    """The leader's FOLLOW_TARGET."""
    k = flight.at(t, flight.gap)
    t_ns = round(t * 1000) * MS
    lat, lon, alt = geodetic_from_ned(k.r.tolist(), ORIGIN)
    message = FollowTarget(
        t_ns=t_ns,
        t_recv_ns=EPOCH + t_ns + LATENCY,
        system=system,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        v_n=tuple(k.v.tolist()),
        q_nL=None,
        position_sigma=(1.0, 1.0, 1.0),
    )
    return Item(message.t_recv_ns, message)


def merged(*streams: Iterable[Item]) -> list[Item]:
    """All messages in the order of their arrival."""
    return sorted((item for items in streams for item in items), key=lambda item: item.t_recv_ns)


def _position(t_ns: int, latency: int, r: Array, v: Array, system: int) -> Item:
    lat, lon, alt = geodetic_from_ned(r.tolist(), ORIGIN)
    message = GlobalPosition(
        t_ns=t_ns,
        t_recv_ns=EPOCH + t_ns + latency,
        system=system,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt,
        height=-float(r[2]),
        v_F_n=tuple(v.tolist()),
        heading_rad=None,
    )
    return Item(EPOCH + t_ns + latency, message)
