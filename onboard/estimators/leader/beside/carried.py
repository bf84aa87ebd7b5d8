"""The belief of `reference` with the components of the leader's estimate."""

import math
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.beside import reference
from onboard.estimators.leader.beside.reference import A, N
from onboard.filters.belief import Belief
from onboard.messages import Estimate
from onboard.models import relative_motion as relative

SLOW: Final = 1.0  # m/s: of a slower leader the course is not known
NOSE: Final = math.radians(15.0)  # rad, of the nose about the course
ANYWHERE: Final = 2.0  # rad: of a nose of which nothing is known


def as_leader(belief: Belief, template: Estimate, v_F_n: Array) -> Belief:
    """A belief with the components of `template`, an estimate with a belief: what no report shows stays as it is
    there, uncorrelated. We fly with v_F_n (3,) m/s, as far as we know."""
    mean, P = np.array(template.mean), np.array(template.covariance)
    x = belief.mean
    north, east = x[reference.V][:2].tolist()
    speed = math.hypot(north, east)
    c, s = (north / speed, east / speed) if speed > SLOW else (1.0, 0.0)
    rows = {i: np.eye(N)[i] for i in range(6)} | {relative.SIZE: np.eye(N)[reference.SIZE]}
    for i, j in zip(range(6)[relative.V], range(N)[reference.OWN_V], strict=True):
        rows[i] = np.eye(N)[i] - np.eye(N)[j]
    for name, direction in (
        ("a_lat", (-s, c, 0.0)),
        ("a_long", (0.0, 0.0, -1.0)),
        ("a_along", (c, s, 0.0)),
    ):
        if name in template.components:
            rows[template.components.index(name)] = np.zeros(N)
            rows[template.components.index(name)][A] = direction
    at = list(rows)
    J = np.array(list(rows.values()))
    mean[at] = J @ x
    mean[relative.V] -= v_F_n
    P[at, :], P[:, at] = 0.0, 0.0
    P[np.ix_(at, at)] = J @ belief.covariance @ J.T
    if "heading" in template.components:
        i = template.components.index("heading")
        mean[i] = math.atan2(east, north) if speed > SLOW else mean[i]
        P[i, :], P[:, i] = 0.0, 0.0
        P[i, i] = (NOSE if speed > SLOW else ANYWHERE) ** 2
    return Belief(mean, 0.5 * (P + P.T))
