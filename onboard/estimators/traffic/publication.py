"""Tracks as estimates: relative to us, in NED where we are, with who they are and how near they come."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.approach import closest_in_turns
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.frame import Frame, Own
from onboard.estimators.traffic.track import Track
from onboard.filters.belief import Belief
from onboard.messages import ClosestApproach, Estimate, Intruder, Lifecycle, ThreatLevel
from onboard.models import intruder

NAME: Final = "traffic"
SURE: Final = 2.0  # sigmas


def tell(
    tracks: Sequence[Track], belief: Belief, own: Own, frame: Frame, t_ns: int, config: Config
) -> list[Estimate]:
    """An estimate of each track, beliefs (k, 15) and (k, 15, 15) at `t_ns`; ourselves at the same time."""
    if not tracks:
        return []
    turn = own.R_nl.T  # the frame -> NED where we are
    r, v, a = belief.mean[:, intruder.R], belief.mean[:, intruder.V], belief.mean[:, intruder.A]
    mean = np.concatenate([(r - own.r) @ turn.T, (v - own.v) @ turn.T], axis=1)
    each = np.kron(np.eye(3), turn)
    covariance = each @ belief.covariance[:, :9, :9] @ each.T
    covariance[:, intruder.V, intruder.V] += config.own_velocity_sigma_m_s**2 * np.eye(3)
    covariance[:, :3, :3] += curvature(mean[:, :3], covariance[:, :3, :3])
    approach = closest_in_turns(mean[:, :3], mean[:, 3:], a @ turn.T, covariance, turn @ own.v)
    places, over_ground = frame.geodetic(r).tolist(), (v @ turn.T).tolist()
    near = [
        ClosestApproach(
            time=time,
            time_sigma=time_sigma,
            distance=distance,
            distance_sigma=sigma,
            horizontal=float(np.hypot(north, east)),
            vertical=-down,
            threat=_threat(time, distance, sigma, config),
            turn_rate=rate,
        )
        for time, time_sigma, distance, sigma, (north, east, down), rate in zip(
            *(a.tolist() for a in approach), strict=True
        )
    ]
    return [
        _estimate(track, m, c, _who(track, place, ground, closest_), t_ns, config)
        for track, m, c, place, ground, closest_ in zip(
            tracks, mean.tolist(), covariance[:, :6, :6].tolist(), places, over_ground, near, strict=True
        )
    ]


def curvature(r: Array, P: Array) -> Array:
    """What the covariances P (k, 3, 3) of places r (k, 3) lack, where a radar has measured the distance well and
    the direction badly: the truth is on a sphere, not on its tangent plane. E[(x^2 + y^2)^2] / 4 r^2, along r."""
    distance = np.maximum(np.linalg.norm(r, axis=1), 1.0)
    u = r / distance[:, None]
    Pu = np.einsum("kij,kj->ki", P, u)
    along = np.einsum("ki,ki->k", u, Pu)
    across = np.trace(P, axis1=1, axis2=2) - along
    squared = np.einsum("kij,kij->k", P, P) - 2.0 * np.einsum("ki,ki->k", Pu, Pu) + along**2
    sag2 = np.minimum(
        (across**2 + 2.0 * squared) / (4.0 * distance**2), across
    )  # nearer than it is unsure: no more
    return np.asarray(sag2[:, None, None] * u[:, :, None] * u[:, None, :])


def farewell(track: Track, t_ns: int, reason: str) -> Estimate:
    """The last word on a track: it is there no more."""
    return Estimate(
        name=NAME,
        target=track.target,
        sequence=track.sequence + 1,
        t_ns=t_ns,
        state=Lifecycle.SEARCHING,
        valid=False,
        reason=reason,
        frame=intruder.FRAME,
        components=intruder.COMPONENTS,
        units=intruder.UNITS,
        mean=None,
        covariance=None,
        age=track.age(t_ns),
        reset_count=track.resets,
    )


def _estimate(
    track: Track, mean: list[float], covariance: list[list[float]], who: Intruder, t_ns: int, config: Config
) -> Estimate:
    state, reason = track.life(t_ns, config)
    track.sequence += 1
    said, track.said = track.said, None
    return Estimate(
        name=NAME,
        target=track.target,
        sequence=track.sequence,
        t_ns=t_ns,
        state=state,
        valid=state in (Lifecycle.TRACKING, Lifecycle.COASTING),
        reason=reason,
        frame=intruder.FRAME,
        components=intruder.COMPONENTS,
        units=intruder.UNITS,
        mean=tuple(mean),
        covariance=tuple(map(tuple, covariance)),
        age=track.age(t_ns),
        reset_count=track.resets,
        measurement=said,
        intruder=who,
    )


def _who(track: Track, place: list[float], v_n: list[float], approach: ClosestApproach) -> Intruder:
    kind, value = track.key or ("", 0)
    heard = track.heard
    lat_deg, lon_deg, height = place
    north, east, down = v_n
    return Intruder(
        icao=value if kind == "icao" else None,
        system=value if kind == "system" else None,
        callsign=heard.callsign if heard else "",
        squawk=heard.squawk if heard else None,
        emitter=heard.emitter if heard else 0,
        sources=tuple(track.sources),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_msl=height,
        v_n=(north, east, down),
        approach=approach,
    )


def _threat(time: float, distance: float, sigma: float, config: Config) -> ThreatLevel:
    if time > config.threat_time_s:
        return ThreatLevel.NONE
    if distance < config.threat_distance_m:
        return ThreatLevel.HIGH
    return ThreatLevel.LOW if distance - SURE * sigma < config.threat_distance_m else ThreatLevel.NONE
