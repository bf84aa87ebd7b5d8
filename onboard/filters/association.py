"""Data association by global nearest neighbour: gates, and the best assignment where gates overlap.

Measurements are range, azimuth and elevation. Echoes are sorted by range, so that a track is compared only with
the echoes near its range. The assignment is solved for each cluster of tracks and echoes that compete. The work
grows with the number of tracks, not with its square.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from onboard.arrays import Array
from onboard.compiled import CUBE, FLOAT, INDICES, MAKING, ROWS, kernel
from onboard.filters.errors import FilterError

Places = NDArray[np.int64]

FORBIDDEN_PAIR_COST: Final = 1e9  # minimum cost of a pair outside the gate


def candidates(
    polar: Array, spread: Array, measured: Array, variance: Array, gate: float
) -> tuple[Places, Places, Array]:
    """Return all pairs of a track and an echo within the gate, with their costs.

    The cost is minus twice the log-likelihood, up to a constant.

    Parameters
    ----------
    polar : (k, 3)
        Predicted measurements of the tracks: range (m), azimuth and elevation (rad).
    spread : (k, 3, 3)
        Their covariances.
    measured : (m, 3)
        Echoes.
    variance : (m, 3)
        Variances of the echoes.
    gate
        Maximum squared distance, in units of the covariance.

    Returns
    -------
    tuple
        Tracks, echoes and costs, each (pairs,).
    """
    order = np.argsort(measured[:, 0], kind="stable")
    tracks, echoes, costs = _candidates(polar, spread, measured[order], variance[order], gate)
    return tracks, order[echoes], costs


def assign(tracks: Places, echoes: Places, costs: Array) -> tuple[Places, Places]:
    """Return the assignment with the most pairs and, among those, the least cost.

    Each track and each echo is in at most one pair. Costs may have any size, but must be finite.

    Parameters
    ----------
    tracks, echoes, costs : (pairs,)
        Possible pairs, as from `candidates`.

    Returns
    -------
    tuple
        Assigned tracks and echoes.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if not len(tracks):
        return tracks, echoes
    if not np.isfinite(costs).all():
        raise FilterError("costs: not finite; a pair that cannot be is left out")
    alone = (np.bincount(tracks)[tracks] == 1) & (np.bincount(echoes)[echoes] == 1)
    pairs = [(tracks[alone], echoes[alone])]
    contested = np.flatnonzero(~alone)
    if len(contested):
        label = _clusters(tracks[contested], echoes[contested])
        for cluster in np.unique(label):
            at = contested[label == cluster]
            pairs.append(_solve(tracks[at], echoes[at], costs[at]))
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def _solve(tracks: Places, echoes: Places, costs: Array) -> tuple[Places, Places]:
    t, rows = np.unique(tracks, return_inverse=True)
    e, columns = np.unique(echoes, return_inverse=True)
    # More than a further pair can cost, so that no pair is omitted to save cost.
    least, most = float(costs.min()), float(costs.max())
    enough = most + min(len(t), len(e)) * (most - least) + abs(most)
    matrix = np.full((len(t), len(e)), max(FORBIDDEN_PAIR_COST, enough))
    allowed = np.zeros(matrix.shape, bool)
    matrix[rows, columns], allowed[rows, columns] = costs, True
    if matrix.shape[0] <= matrix.shape[1]:
        row, column = np.arange(len(t)), _columns(matrix)
    else:
        row, column = _columns(matrix.T), np.arange(len(e))
    chosen = allowed[row, column]
    return t[row[chosen]], e[column[chosen]]


@kernel(**MAKING)
def _longer(a):
    b = np.empty(2 * a.shape[0], a.dtype)
    b[: a.shape[0]] = a
    return b


@kernel((ROWS, CUBE, ROWS, ROWS, FLOAT), **MAKING)
def _candidates(polar, spread, measured, variance, gate):
    count, echoes = polar.shape[0], measured.shape[0]
    size = 4 * count + 16
    track, echo, cost = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)
    found = 0
    widest = 0.0
    for j in range(echoes):
        widest = max(widest, variance[j, 0])
    S = np.empty((3, 3))
    e = np.empty(3)
    for i in range(count):
        reach = np.sqrt(gate * (spread[i, 0, 0] + widest))
        first = np.searchsorted(measured[:, 0], polar[i, 0] - reach)
        for j in range(first, echoes):
            if measured[j, 0] > polar[i, 0] + reach:
                break
            for a in range(3):
                e[a] = measured[j, a] - polar[i, a]
                for b in range(3):
                    S[a, b] = spread[i, a, b]
                S[a, a] += variance[j, a]
            e[1] = (e[1] + np.pi) % (2 * np.pi) - np.pi
            e[2] = (e[2] + np.pi) % (2 * np.pi) - np.pi
            # Cholesky factor and forward substitution in place: d2 = |L^-1 e|^2
            l00 = np.sqrt(S[0, 0])
            l10, l20 = S[1, 0] / l00, S[2, 0] / l00
            l11 = np.sqrt(S[1, 1] - l10 * l10)
            l21 = (S[2, 1] - l20 * l10) / l11
            l22 = np.sqrt(S[2, 2] - l20 * l20 - l21 * l21)
            u0 = e[0] / l00
            u1 = (e[1] - l10 * u0) / l11
            u2 = (e[2] - l20 * u0 - l21 * u1) / l22
            d2 = u0 * u0 + u1 * u1 + u2 * u2
            if not d2 <= gate:  # NaN, from a covariance that is not positive definite, passes no gate
                continue
            if found == size:
                size *= 2
                track, echo, cost = _longer(track), _longer(echo), _longer(cost)
            track[found], echo[found] = i, j
            cost[found] = d2 + 2.0 * np.log(l00 * l11 * l22)
            found += 1
    return track[:found], echo[:found], cost[:found]


@kernel((INDICES, INDICES), **MAKING)
def _clusters(tracks, echoes):
    """Label each pair, with the same label for pairs that compete directly or indirectly.

    By union-find over tracks and echoes.
    """
    tops = tracks.max() + 1
    parent = np.arange(tops + echoes.max() + 1)
    for k in range(tracks.shape[0]):
        a, b = tracks[k], tops + echoes[k]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        parent[b] = a
    label = np.empty(tracks.shape[0], np.int64)
    for k in range(tracks.shape[0]):
        a = tracks[k]
        while parent[a] != a:
            a = parent[a]
        label[k] = a
    return label


@kernel((ROWS,), **MAKING)
def _columns(cost):
    """Return the column of each row of a matrix (n, m), n <= m, at the least cost: shortest augmenting paths.

    D. F. Crouse, On implementing 2D rectangular assignment algorithms, IEEE Transactions on Aerospace and
    Electronic Systems 52, 2016. SciPy's takes half a second to load, at each start or in flight, and twice as
    long.
    """
    n, m = cost.shape
    of_rows, of_columns = np.zeros(n), np.zeros(m)  # the dual variables
    row_of, column_of = np.full(m, -1), np.full(n, -1)
    for first in range(n):
        shortest, before, done = np.full(m, np.inf), np.full(m, -1), np.zeros(m, np.bool_)
        i, length = first, 0.0
        while True:
            nearest = -1
            for j in range(m):
                if done[j]:
                    continue
                to_j = length + cost[i, j] - of_rows[i] - of_columns[j]
                if to_j < shortest[j]:
                    shortest[j], before[j] = to_j, i
                if nearest < 0 or shortest[j] < shortest[nearest]:
                    nearest = j
            length, done[nearest] = shortest[nearest], True
            if row_of[nearest] < 0:
                break
            i = row_of[nearest]
        of_rows[first] += length
        for j in range(m):
            if done[j]:
                of_columns[j] -= length - shortest[j]
                if row_of[j] >= 0:
                    of_rows[row_of[j]] += length - shortest[j]
        j = nearest
        while True:
            i = before[j]
            row_of[j] = i
            column_of[i], j = j, column_of[i]
            if i == first:
                break
    return column_of
