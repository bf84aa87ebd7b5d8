"""Registration: the rotation by which our own attitude is off, and with it all that our radar sees, from aircraft
that it sees and that also say where they are (anchors).

One Kalman filter has the rotation, the error of our own position, and for each anchor by how much its reports are
steadily off and its newest one beside: states [rotation (3), own (3), then bias (3) and noise (3) of each], where
an anchor is seen less where it says to be = rotation x r_RT_n + own - bias - noise + the radar's noise.

It stands apart from the tracks. The radar is turned back by the rotation, and each track's filter is left with
what remains (`residual`), as if that were its own. Tracks that shared one belief in the rotation would learn from
each other what they had in common from the start, and drift away together, surer with every scan.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.reports import Report
from onboard.estimators.traffic.track import NS
from onboard.filters import kalman
from onboard.filters.association import Places
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_vector
from onboard.models import intruder

MOST: Final = 12  # anchors at a time: twice as many would tell a third more, and take eight times as long
ROTATION, OWN = slice(0, 3), slice(3, 6)
FIRST: Final = 6  # states before the anchors'
EACH: Final = 6
BETTER: Final = 2.0  # times smaller a variance, in any direction: worth telling the tracks at once
EXACT: Final = 1e-8  # rad: what is known better has no inverse
MEMORY_S: Final = 2.0  # for about as long do tracks average
STEEP: Final = 0.01  # cosine of an elevation, above which azimuth means nothing


class Sight(NamedTuple):
    """An anchor in a scan: its track's `number`; where it was seen, r_OT_n (3,); where it should be, by its last
    `report` and its track's motion since, (3,); and the noise (3, 3) of their difference, less the report's."""

    number: int
    seen: Array
    said: Array
    noise: Array
    report: Report


class Anchor(NamedTuple):
    """Its newest report, when it was last seen, and when where it should be."""

    report: Report
    seen_ns: int
    fitted_ns: int | None


class Registration:
    """The `rotation`, and what remains of it: `residual`, which lasts, and `jitter`, another in each scan.

    What the noise of reports does to the rotation lasts for a second or two: for as long as they are the newest,
    and after that by what was learnt from them. Tracks do not know of it and average scans, so as jitter it counts
    for as much as is left of it on average. Its covariance is kept beside (`_noise`, part of the belief's), and
    that with the rotation's errors in the last scans, summed (`_past`).
    """

    def __init__(self, config: Config) -> None:
        c = config
        known = np.radians([c.own_tilt_sigma_deg, c.own_tilt_sigma_deg, c.own_yaw_sigma_deg])
        attitude = np.maximum(known, EXACT)
        self._unknown = intruder.Turning(np.diag(attitude), np.ones(3), np.full(3, c.own_attitude_time_s))
        self._sigma = np.concatenate([attitude, np.full(3, c.own_position_sigma_m)])
        self._time = np.repeat([c.own_attitude_time_s, c.own_position_time_s], 3)
        self._bias_time, self._forget_ns = c.report_bias_time_s, round(c.coast_after_s * NS)
        self._gate = chi_square_threshold(c.gate_probability, 3)
        self.clear()

    def clear(self) -> None:
        """Nothing has been seen."""
        self._t_ns: int | None = None
        self._anchors: dict[int, Anchor] = {}  # by track numbers, in the order of their states
        self._belief = Belief(np.zeros(FIRST), np.diag(self._sigma**2))
        self._noise, self._past = np.zeros((FIRST, FIRST)), np.zeros((FIRST, 3))
        self._bias = np.zeros(0)
        self.residual = self._unknown
        self._jitter = np.zeros((3, 3))
        self._told = self._before = self._moved = self.residual.covariance

    @property
    def rotation(self) -> Array:
        """By how much all is seen turned (3,), rad about n's axes."""
        mean: Array = self._belief.mean
        return mean[ROTATION]

    def jitter(self, polar: Array, R_rn: Array) -> Array:
        """By how much a radar with attitude R_rn (3, 3) sees aircraft in these directions (k, 3) off in a scan:
        standard deviations of range (none), azimuth and elevation, (k, 3)."""
        toward = intruder.position(polar * [0.0, 1.0, 1.0] + [1.0, 0.0, 0.0], np.zeros(3), R_rn)
        level = np.maximum(np.cos(polar[:, 2]), STEEP)[:, None]
        # a rotation w moves the direction by w x toward: along `aside` what is azimuth, across it elevation
        aside = np.cross(R_rn[2], toward) / level
        sigma = np.zeros_like(polar)
        for at, axes in ((1, np.cross(toward, aside) / level), (2, aside)):
            sigma[:, at] = np.sqrt(np.maximum(np.sum((axes @ self._jitter) * axes, axis=1), 0.0))
        return sigma

    def shared(self, numbers: Sequence[int], bias: Array) -> Array:
        """`intruder.Reports.shared` of tracks with these numbers, whose reports are off by about `bias` (k, 3)."""
        shared = np.zeros((len(numbers), 3, 3))
        if self.residual is not self._unknown:
            P, rows = self._belief.covariance, {number: row for row, number in enumerate(numbers)}
            for at, number in enumerate(self._anchors):
                if number in rows:
                    first = FIRST + EACH * at
                    off = P[ROTATION, first : first + 3] - P[ROTATION, OWN]  # against our own position
                    shared[rows[number]] = off / bias[rows[number]]
        return shared

    def turned_back(self, R_rn: Array) -> Array:
        """The attitude R_rn (3, 3) of a radar, without the rotation."""
        return np.ascontiguousarray(R_rn @ matrix_from_quaternion(quaternion_from_vector(self.rotation)))

    def scan(self, t_ns: int, sights: Sequence[Sight], r_OR_n: Array) -> Belief | None:
        """Take in the anchors of a scan, at the time of `advance`, by a radar at r_OR_n (3,). If the rotation is
        now so much better known that the tracks should be told: what they have called so, (3,) and (3, 3)."""
        before, predicted = self.rotation, self._belief.covariance[ROTATION, ROTATION]
        self._meet(t_ns, sights)
        self._fuse(t_ns, [s for s in sights if s.number in self._anchors], r_OR_n)
        self._past += self._noise[:, ROTATION]
        since_ns = t_ns - self._forget_ns
        if not any(a.fitted_ns is not None and a.fitted_ns >= since_ns for a in self._anchors.values()):
            self.residual, self._jitter = self._unknown, np.zeros((3, 3))
            self._told = self._belief.covariance[ROTATION, ROTATION]
            return None
        lasting, self._jitter = self._parts()
        self.residual = self._remaining(lasting)
        if np.linalg.eigvals(np.linalg.solve(lasting, self._told)).real.max() < BETTER:
            return None
        self._told = lasting
        # of what is new, the share that was so before: the rest is how it has moved since the last scan
        share = self._before @ np.linalg.inv(predicted)
        return Belief(share @ (self.rotation - before), lasting)

    def advance(self, t_ns: int) -> None:
        """Predict to a time, never back."""
        dt = 0.0 if self._t_ns is None else max((t_ns - self._t_ns) / NS, 0.0)
        self._t_ns = t_ns if self._t_ns is None else max(t_ns, self._t_ns)
        times = np.tile(np.repeat([self._bias_time, np.inf], 3), len(self._anchors))
        fade = np.exp(-dt / np.concatenate([self._time, times]))
        sigma = np.concatenate([self._sigma, self._bias])
        mean, P = self._belief
        self._before = P[ROTATION, ROTATION]
        more = np.diag(sigma**2 * (1.0 - fade**2))
        self._moved = more[ROTATION, ROTATION]
        self._belief = Belief(fade * mean, P * np.outer(fade, fade) + more)
        self._noise = self._noise * np.outer(fade, fade)
        self._past = np.exp(-dt / MEMORY_S) * fade[:, None] * self._past

    def _meet(self, t_ns: int, sights: Sequence[Sight]) -> None:
        """Forget anchors not seen for long, begin with new ones as long as there is room, and take new reports."""
        last = {s.number: s.report for s in sights}
        since_ns = t_ns - self._forget_ns
        for number in [k for k, a in self._anchors.items() if a.seen_ns < since_ns and k not in last]:
            self._drop(list(self._anchors).index(number))
            del self._anchors[number]
        mean, P = (array.copy() for array in self._belief)
        for at, (number, anchor) in enumerate(self._anchors.items()):
            report = last.get(number)
            if report is None:
                continue
            if report is not anchor.report:
                noise = slice(FIRST + EACH * at + 3, FIRST + EACH * (at + 1))
                mean[noise], P[noise, :], P[:, noise] = 0.0, 0.0, 0.0
                P[noise, noise] = report.R[:3, :3]
                self._noise[noise, :], self._noise[:, noise], self._past[noise] = 0.0, 0.0, 0.0
                self._noise[noise, noise] = report.R[:3, :3]
            self._anchors[number] = Anchor(report, t_ns, anchor.fitted_ns)
        self._belief = Belief(mean, P)
        for sight in sorted(sights, key=lambda s: float(np.linalg.norm(s.report.bias))):
            if sight.number not in self._anchors and len(self._anchors) < MOST:
                self._anchors[sight.number] = Anchor(sight.report, t_ns, None)
                self._append(sight.report)

    def _append(self, report: Report) -> None:
        mean, P = self._belief
        n = len(mean)
        wider, noise = np.pad(P, (0, EACH)), np.pad(self._noise, (0, EACH))
        # how far reports are off is said against our own position: of that, its own error is a state already
        bias = np.sqrt(np.maximum(report.bias**2 - self._sigma[OWN] ** 2, (0.5 * report.bias) ** 2))
        wider[n : n + 3, n : n + 3] = np.diag(bias**2)
        wider[n + 3 :, n + 3 :] = noise[n + 3 :, n + 3 :] = report.R[:3, :3]
        self._belief, self._noise = Belief(np.pad(mean, (0, EACH)), wider), noise
        self._past = np.pad(self._past, ((0, EACH), (0, 0)))
        self._bias = np.concatenate([self._bias, bias, np.zeros(3)])

    def _drop(self, at: int) -> None:
        kept = np.delete(np.arange(len(self._belief.mean)), np.arange(FIRST + EACH * at, FIRST + EACH * (at + 1)))
        square = np.ix_(kept, kept)
        self._belief = Belief(self._belief.mean[kept], self._belief.covariance[square])
        self._noise, self._past = self._noise[square], self._past[kept]
        self._bias = self._bias[kept[FIRST:] - FIRST]

    def _fuse(self, t_ns: int, sights: Sequence[Sight], r_OR_n: Array) -> None:
        """Take in where known anchors are seen."""
        if not sights:
            return
        places = {number: at for at, number in enumerate(self._anchors)}
        size, count = len(self._belief.mean), len(sights)
        H, y, R = np.zeros((count, 3, size)), np.zeros((count, 3)), np.zeros((count, 3, 3))
        for k, sight in enumerate(sights):
            at = FIRST + EACH * places[sight.number]
            y[k] = sight.seen - sight.said
            H[k, :, ROTATION] = -intruder.crossing(sight.said - r_OR_n)
            H[k, :, OWN] = np.eye(3)
            H[k, :, at : at + 3] = H[k, :, at + 3 : at + 6] = -np.eye(3)
            R[k] = sight.noise
        fits = self._consistent(y, H, R)
        if not len(fits):
            return
        try:
            wide = H[fits].reshape(-1, size)
            update = kalman.update(self._belief, y[fits].ravel(), wide, _blocks(R[fits]))
        except FilterError:
            self.clear()
            return
        gain = np.linalg.solve(update.innovation_covariance, wide @ self._belief.covariance).T
        left = np.eye(size) - gain @ wide
        self._noise, self._past = left @ self._noise @ left.T, left @ self._past
        self._belief = update.belief
        for number in (sights[k].number for k in fits.tolist()):
            self._anchors[number] = self._anchors[number]._replace(fitted_ns=t_ns)

    def _consistent(self, y: Array, H: Array, R: Array) -> Places:
        """Which of k sights agree with all that is known and with each other. By itself an anchor that lies seems
        possible as long as the rotation is unknown; next to others it does not. The worst is left out first."""
        fits = np.arange(len(y))
        while len(fits):
            wide = H[fits].reshape(-1, H.shape[2])
            S = wide @ self._belief.covariance @ wide.T + _blocks(R[fits])
            inverse = np.linalg.inv(S)
            pulls = (inverse @ (y[fits].ravel() - wide @ self._belief.mean)).reshape(-1, 3)
            own = inverse.reshape(len(fits), 3, len(fits), 3)[range(len(fits)), :, range(len(fits))]
            beside = normalised_squared(pulls, own)  # of each one's innovation, given the others'
            if beside.max() <= self._gate:
                break
            fits = np.delete(fits, int(np.argmax(beside)))
        return fits

    def _remaining(self, lasting: Array) -> intruder.Turning:
        """How a residual of that covariance (3, 3) goes on: as slowly as what the anchors err by, but as fast as
        our own attitude in directions of which they tell nothing; between, by the ratio of standard deviations."""
        scale = np.diag(self._unknown.axes)
        share, turns = np.linalg.eigh(lasting / np.outer(scale, scale))
        share = np.clip(share, 0.0, 1.0)
        left = np.sqrt(share)
        rate = (1.0 - left) / self._bias_time + left / self._unknown.times
        return intruder.Turning(scale[:, None] * turns, share, 1.0 / rate)

    def _parts(self) -> tuple[Array, Array]:
        """The covariances (3, 3) of what lasts of the rotation's error, and of the rest, as if it were another in
        each scan."""
        P, noise = self._belief.covariance, self._noise[ROTATION, ROTATION]
        sizes = np.concatenate([self._sigma[OWN], self._bias])
        slow = np.flatnonzero(sizes)  # our own position, and what reports are steadily off
        by_slow = P[ROTATION, 3 + slow] / sizes[slow]
        by_them = by_slow @ by_slow.T
        # neither is what the radar's noise does and how the rotation moves; a scan that takes away as much as has
        # come since the last leaves little of that in directions of which it tells, and all in others
        other = P[ROTATION, ROTATION] - by_them - noise
        kept = P[ROTATION, ROTATION] @ np.linalg.inv(P[ROTATION, ROTATION] + self._moved)
        old = kept @ other @ kept.T
        jitter = other - old + self._past[ROTATION] + self._past[ROTATION].T - noise
        return by_them + old + EXACT**2 * np.eye(3), jitter


def _blocks(matrices: Array) -> Array:
    """The matrix (3k, 3k) with these (k, 3, 3) on its diagonal."""
    count = len(matrices)
    wide = np.zeros((count, 3, count, 3))
    wide[range(count), :, range(count)] = matrices
    return wide.reshape(3 * count, 3 * count)
