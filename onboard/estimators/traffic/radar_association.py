"""Association of echoes with tracks.

It is for update, registration, and continuation of older tracks. It decides; the tracker executes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from onboard.estimators.traffic.batch import NO_ROWS, Radar
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.echoes import Echoes
from onboard.estimators.traffic.registration import AnchorEcho
from onboard.estimators.traffic.track import Track
from onboard.filters.association import Places, assign, candidates
from onboard.filters.belief import Belief
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.models.intruder.measurement import ECHO_SIZE, REPORT_SIZE, expected_echo, position, position_noise
from onboard.models.intruder.motion import displacement
from onboard.units import NS_PER_S


class RadarAssociation(NamedTuple):
    """The tracks in `rows` with the echoes at `places` of a scan, one each."""

    rows: Places
    places: Places


class Continuation(NamedTuple):
    """The new track in row `found` continues the coasting track in row `row`."""

    found: int
    row: int


def candidate_rows(tracks: Sequence[Track], t_ns: int, config: Config, *, established: bool) -> Places:
    """Return the rows of tracks that echoes may belong to.

    A track that has coasted for long is excluded: its gate is wide, and the first false alarm in it would be
    fused.
    """
    since_ns = t_ns - round(config.relock_after_s * NS_PER_S)
    rows = [i for i, t in enumerate(tracks) if t.established is established and t.fused_ns >= since_ns]
    return np.array(rows, np.int64)


def associate_echoes(
    rows: Places, echoes: Echoes, belief: Belief, lag: float, radar: Radar, config: Config
) -> RadarAssociation:
    """Associate tracks in these rows of `belief` with their best echoes.

    The echoes are `lag` seconds old.
    """
    if not len(rows) or not len(echoes.polar):
        return RadarAssociation(NO_ROWS, NO_ROWS)
    polar, spread = expected_echo(belief.mean[rows], belief.covariance[rows], lag, *radar)
    gate = chi_square_threshold(config.gate_probability, ECHO_SIZE)
    which, places = assign(*candidates(polar, spread, echoes.polar, echoes.sigma**2, gate))
    return RadarAssociation(rows[which], places)


def anchor_echoes(
    rows: Places,
    echoes: Echoes,
    tracks: Sequence[Track],
    belief: Belief,
    t_ns: int,
    radar: Radar,
    config: Config,
) -> list[AnchorEcho]:
    """Return the echoes of aircraft that also report their positions.

    The scan has one echo for the track in each row.
    """
    fresh_ns = round(config.coast_after_s * NS_PER_S)
    positions = position(echoes.polar, *radar)
    noise = position_noise(echoes.polar, echoes.sigma, radar.R_rn)
    reports = [(k, tracks[row].last_report) for k, row in enumerate(rows)]
    fresh = [(k, report) for k, report in reports if report and t_ns - report.t_ns <= fresh_ns]
    age = np.array([(t_ns - report.t_ns) / NS_PER_S for _, report in fresh])
    of = rows[[k for k, _ in fresh]]
    way, unsure = displacement(belief.mean[of], belief.covariance[of], age)
    return [
        AnchorEcho(tracks[rows[k]].number, positions[k], report.y[:3] + way[j], noise[k] + unsure[j], report)
        for j, (k, report) in enumerate(fresh)
    ]


def continuations(
    found: Sequence[int], tracks: Sequence[Track], belief: Belief, t_ns: int, config: Config
) -> list[Continuation]:
    """Return which of the tracks just confirmed continue a coasting track.

    The new tracks are in rows `found`, at the predicted place of the coasting ones.
    """
    relock_ns = config.relock_after_s * NS_PER_S
    coasting = [i for i, t in enumerate(tracks) if t.established and t_ns - t.fused_ns > relock_ns]
    gate = chi_square_threshold(config.gate_probability, REPORT_SIZE)
    same: list[Continuation] = []
    for i in found:
        if not coasting:
            break
        off = belief.mean[coasting, :6] - belief.mean[i, :6]
        nis = normalised_squared(off, belief.covariance[coasting, :6, :6] + belief.covariance[i, :6, :6])
        best = int(np.argmin(nis))
        if nis[best] <= gate:
            same.append(Continuation(i, coasting.pop(best)))
    return same
