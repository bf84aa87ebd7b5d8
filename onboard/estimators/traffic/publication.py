"""Tracks as estimates, with their identity and closest approach.

Estimates are relative to us, in NED where we are.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.frame import Frame, OwnMotion
from onboard.estimators.kit.reports import belief_fields, update_fields
from onboard.estimators.traffic.approach import closest_in_turns
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.track import Track
from onboard.filters.belief import Belief, Update
from onboard.filters.gating import chi_square_threshold
from onboard.messages import (
    ClosestApproach,
    Estimate,
    Intruder,
    Lifecycle,
    MeasurementReport,
    Message,
    ThreatLevel,
    Verdict,
)
from onboard.messages.causes import Reason
from onboard.models.intruder.measurement import ECHO_SIZE, POLAR, POLAR_UNITS
from onboard.models.intruder.motion import ACCELERATION, COMPONENTS, FRAME, POSITION, UNITS, VELOCITY

NAME: Final = "traffic"
MAX_PUBLISHED_TRACKS: Final = 100  # At a time; a thousand estimates a second do not delay the leader's.
LOW_THREAT_SIGMAS: Final = 2.0  # of the distance


def estimates(
    tracks: Sequence[Track], belief: Belief, own: OwnMotion, frame: Frame, t_ns: int, config: Config
) -> list[Estimate]:
    """Return an estimate of each track, from beliefs and our own motion at `t_ns`.

    The beliefs are (k, 15) and (k, 15, 15).
    """
    if not tracks:
        return []
    R_ln = own.R_nl.T
    r, v, a = belief.mean[:, POSITION], belief.mean[:, VELOCITY], belief.mean[:, ACCELERATION]
    mean = np.concatenate([(r - own.r) @ R_ln.T, (v - own.v) @ R_ln.T], axis=1)
    each = np.kron(np.eye(3), R_ln)
    covariance = each @ belief.covariance[:, :9, :9] @ each.T
    covariance[:, VELOCITY, VELOCITY] += config.own_velocity_sigma_m_s**2 * np.eye(3)
    covariance[:, :3, :3] += curvature(mean[:, :3], covariance[:, :3, :3])
    approach = closest_in_turns(mean[:, :3], mean[:, 3:], a @ R_ln.T, covariance, R_ln @ own.v)
    geodetic, over_ground = frame.geodetic(r).tolist(), (v @ R_ln.T).tolist()
    approaches = [
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
        _estimate(track, t_ns, track.life(t_ns, config), Belief(m, c), _intruder(track, place, ground, closest))
        for track, m, c, place, ground, closest in zip(
            tracks, mean, covariance[:, :6, :6], geodetic, over_ground, approaches, strict=True
        )
    ]


def in_turn(rows: list[int], r: Array, turn: int) -> list[int]:
    """Return which of the tracks in `rows`, at r (k, 3) from us, are published this time.

    Up to `MAX_PUBLISHED_TRACKS`, all are. Otherwise the nearest fill half of the limit every time, and the others
    take turns, which `turn` counts.
    """
    if len(rows) <= MAX_PUBLISHED_TRACKS:
        return rows
    nearest = np.argsort(np.linalg.norm(r, axis=1), kind="stable")
    half = MAX_PUBLISHED_TRACKS // 2
    always, others = nearest[:half], np.sort(nearest[half:])
    start = turn * half % len(others)
    turns = np.roll(others, -start)[:half]
    return [rows[i] for i in sorted([*always.tolist(), *turns.tolist()])]


def curvature(r: Array, P: Array) -> Array:
    """Return the covariance that P (k, 3, 3) of positions r (k, 3) lacks.

    If range is better known than direction, the true positions are on a sphere, not on its tangent plane:
    E[(x^2 + y^2)^2] / 4 r^2, along r.
    """
    distance = np.maximum(np.linalg.norm(r, axis=1), 1.0)
    u = r / distance[:, None]
    Pu = np.einsum("kij,kj->ki", P, u)
    along = np.einsum("ki,ki->k", u, Pu)
    across = np.trace(P, axis1=1, axis2=2) - along
    squared = np.einsum("kij,kij->k", P, P) - 2.0 * np.einsum("ki,ki->k", Pu, Pu) + along**2
    # The divisor is at least the uncertainty of the distance.
    sag2 = np.minimum((across**2 + 2.0 * squared) / (4.0 * distance**2), across)
    return np.asarray(sag2[:, None, None] * u[:, :, None] * u[:, None, :])


def last_estimate(track: Track, t_ns: int, why: Reason) -> Estimate:
    """Return the last estimate of a track that is removed or renamed."""
    last = track._replace(sequence=track.sequence + 1, measurement=None)
    return _estimate(last, t_ns, (Lifecycle.SEARCHING, why), None)


def measurement_report(
    message: Message,
    source: str,
    t_ns: int,
    verdict: Verdict,
    updates: Update,
    place: int,
    config: Config,
    *,
    polar: bool,
) -> MeasurementReport:
    """Return the report of measurement `place` of those evaluated.

    `polar`: echoes were evaluated as such.
    """
    update = Update(None, *(array[place] for array in updates[1:5]))
    count = len(update.predicted)
    is_polar = polar and count == ECHO_SIZE
    return MeasurementReport(
        source=source,
        t_ns=t_ns,
        t_recv_ns=message.t_recv_ns,
        verdict=verdict,
        components=POLAR if is_polar else COMPONENTS[:count],
        units=POLAR_UNITS if is_polar else UNITS[:count],
        measured=tuple((update.predicted + update.innovation).tolist()),
        gate=chi_square_threshold(config.gate_probability, count),
        **update_fields(update),
    )


def _estimate(
    track: Track,
    t_ns: int,
    life: tuple[Lifecycle, Reason],
    belief: Belief | None,
    intruder: Intruder | None = None,
) -> Estimate:
    state, (cause, reason) = life
    return Estimate(
        name=NAME,
        target=track.target,
        sequence=track.sequence,
        t_ns=t_ns,
        state=state,
        valid=state.is_valid,
        cause=cause,
        reason=reason,
        frame=FRAME,
        components=COMPONENTS,
        units=UNITS,
        age=track.age(t_ns),
        reset_count=track.resets,
        measurement=track.measurement,
        intruder=intruder,
        **belief_fields(belief),
    )


def _intruder(track: Track, place: list[float], v_n: list[float], approach: ClosestApproach) -> Intruder:
    kind, value = track.key or ("", 0)
    adsb = track.adsb
    lat_deg, lon_deg, height = place
    north, east, down = v_n
    return Intruder(
        icao=value if kind == "icao" else None,
        system=value if kind == "system" else None,
        callsign=adsb.callsign if adsb else "",
        squawk=adsb.squawk if adsb else None,
        emitter=adsb.emitter if adsb else 0,
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
    return ThreatLevel.LOW if distance - LOW_THREAT_SIGMAS * sigma < config.threat_distance_m else ThreatLevel.NONE
