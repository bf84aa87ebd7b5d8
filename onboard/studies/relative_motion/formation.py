"""Filters over simulated formation flights, many flights at once: on the arrays of `simlink.flights`, without the
pipeline.

The clock is the navigation system's: a prediction to each of its samples with the follower's velocity and
acceleration taken as known (eq 8 ff. of Oh & Johnson), and an update of those flights for which an image is
registered then. A flight whose filter fails is taken out; the others go on.
"""

from collections.abc import Callable
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.models.relative_motion import FollowerMotion
from onboard.studies.relative_motion.rows import concatenated, put, taken
from simlink.flights import Flights
from simlink.scenarios.camera import Camera
from simlink.scenarios.vehicle import Nav

FT: Final = 0.3048
B0: Final = 8.75 * FT  # the size the filter believes; the true one of each run differs by 2 % (1 sigma)
SIZE_SIGMA: Final = 0.02 * B0

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


class Setting(NamedTuple):
    """What a filter is told before the flight. `nav`: how wrong our own state may be (the sizes of its errors)."""

    camera: Camera
    size: float = B0
    size_sigma: float = SIZE_SIGMA
    leader_class: Literal["fixed_wing", "multirotor"] = "fixed_wing"
    nav: Nav = Nav()


class Step(NamedTuple):
    """From one navigation sample of B flights to a later one, `dt` s on; `R_nb` (B, 3, 3) is our attitude then."""

    t: float
    dt: float
    follower: FollowerMotion  # (B, 3) each
    R_nb: Array


class View(NamedTuple):
    """Images of B flights and our own motion when, by their stamps, they were taken."""

    t: float
    points: Array  # (B, 3, 2) of center, left and right point, in focal lengths
    sigma: float  # of each coordinate, focal lengths
    R_cn: Array  # (B, 3, 3)
    r_FC_n: Array  # (B, 3)
    v_F_n: Array  # (B, 3)
    a_F_n: Array  # (B, 3)
    omega_b: Array  # (B, 3) rad/s
    R_bc: Array  # (3, 3) the mount


class Seen(NamedTuple):
    """What filters made of their images: their states after it, the NIS (B,), and which were fused (B,)."""

    state: Any
    nis: Array
    fused: Mask


class Filter(NamedTuple):
    """Functions over the states of B filters: a NamedTuple of arrays with a leading axis B, or several nested.

    `to_nine` gives the belief over [r, v, b, a_lat, a_long] of `onboard.models.relative_motion`, which is what is
    scored, NaN where there is none. `delay`: estimate (B,) and sigma (B,) of how much later than the exposure
    the stamps are, s. `degrees` are those of the NIS. Any of them may raise FilterError; what it raises for a
    single flight takes that flight out.
    """

    start: Callable[[View], Any]
    predict: Callable[[Any, Step], Any]
    see: Callable[[Any, View], Seen]
    to_nine: Callable[[Any], Belief]
    degrees: int = 3
    delay: Callable[[Any], tuple[Array, Array]] | None = None


class Method(NamedTuple):
    """A named way to make a filter, given what is known before the flight."""

    name: str
    label: str
    make: Callable[[Setting], Filter]


class Track(NamedTuple):
    """A filter's account of one flight at its N navigation samples and M images; NaN where there is none.

    `mean` and `covariance` are posterior at times with an image. `failed_at`: s, when the covariance lost its
    Cholesky factor or a number overflowed; the filter stops there. `delay` (N, 2): estimate and sigma.
    """

    t: Array  # (N,)
    mean: Array  # (N, 9)
    covariance: Array  # (N, 9, 9)
    nis: Array  # (M,)
    fused: Mask  # (M,)
    failed_at: float | None
    degrees: int = 3
    delay: Array | None = None


class Tracks(NamedTuple):
    """As `Track`, with an axis B of flights before the others; `failed_at` (B,) is NaN for those that did not."""

    t: Array
    mean: Array
    covariance: Array
    nis: Array
    fused: Mask
    failed_at: Array
    degrees: int
    delay: Array | None

    def one(self, b: int) -> Track:
        """The track of flight `b` alone."""
        failed_at = None if np.isnan(self.failed_at[b]) else float(self.failed_at[b])
        delay = None if self.delay is None else self.delay[b]
        arrays = (self.mean[b], self.covariance[b], self.nis[b], self.fused[b])
        return Track(self.t, *arrays, failed_at, self.degrees, delay)


class Lateness(NamedTuple):
    """In navigation samples: by how many images are stamped later than exposed, which no filter is told; and
    how many after its (right) stamp an image is there to be fused, so that what is told is predicted from then."""

    stamp: int = 0
    delivery: int = 0


ON_TIME: Final = Lateness()


def track(flights: Flights, setting: Setting, method: Method, late: Lateness = ON_TIME) -> Tracks:
    """Fly `method` over `flights`, seen by the setting's camera."""
    count, samples, images = len(flights.seeds), len(flights.nav_t), len(flights.image_t)
    filter_ = method.make(setting)
    delay = None if filter_.delay is None else np.full((count, samples, 2), np.nan)
    out = Tracks(
        flights.nav_t,
        np.full((count, samples, 9), np.nan),
        np.full((count, samples, 9, 9), np.nan),
        np.full((count, images), np.nan),
        np.zeros((count, images), dtype=bool),
        np.full(count, np.nan),
        filter_.degrees,
        delay,
    )
    registered: Mask = np.asarray(np.isfinite(flights.image_points).all(axis=(2, 3)))
    image_at = {int(k) + late.stamp: image for image, k in enumerate(flights.image_at)}
    pool = _Pool(filter_, _OwnMotion(flights, setting.camera), out)
    # where the printed settings diverge they also overflow: that is caught as a failure, not a warning
    with np.errstate(all="ignore"):
        for k in range(samples):
            if k:
                pool.predict(k)
            image = image_at.get(k)
            if image is not None:
                pool.see(k, image, flights.image_points[:, image], registered[:, image])
            if k + late.delivery < samples:
                pool.tell(k, k + late.delivery)
    return out


class _OwnMotion:
    """Our own motion as the navigation system tells it, and where the camera is."""

    def __init__(self, flights: Flights, camera: Camera) -> None:
        self._t, self._v, self._a = flights.nav_t, flights.nav_v_F_n, flights.nav_a_F_n
        self._R_nb = matrix_from_quaternion(flights.nav_q_nb)
        self._R_bc = matrix_from_euler(*np.radians(camera.mount_rpy_deg))
        self._offset, self._sigma = np.array(camera.mount_offset), camera.sigma_px / camera.f_px

    def step(self, rows: Indices, k0: int, k1: int) -> Step:
        v, a = self._v, self._a
        follower = FollowerMotion(v[rows, k0], v[rows, k1], a[rows, k0], a[rows, k1])
        return Step(float(self._t[k1]), float(self._t[k1] - self._t[k0]), follower, self._R_nb[rows, k1])

    def view(self, rows: Indices, k: int, points: Array) -> View:
        R_nb = self._R_nb[rows, k]
        # over so short a time the antisymmetric part is the rotation vector
        turn = np.swapaxes(self._R_nb[rows, max(k - 1, 0)], 1, 2) @ R_nb / float(self._t[1] - self._t[0])
        x, y, z = turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]
        return View(
            t=float(self._t[k]),
            points=points[rows],
            sigma=self._sigma,
            R_cn=self._R_bc.T @ np.swapaxes(R_nb, 1, 2),
            r_FC_n=R_nb @ self._offset,
            v_F_n=self._v[rows, k],
            a_F_n=self._a[rows, k],
            omega_b=0.5 * np.stack([x, y, z], axis=1),
            R_bc=self._R_bc,
        )


class _Pool:
    """The filters that fly: `rows` are the flights they belong to, in the order of their states."""

    def __init__(self, filter_: Filter, own: _OwnMotion, out: Tracks) -> None:
        self._filter, self._own, self._out = filter_, own, out
        self._rows: Indices = np.empty(0, dtype=np.intp)
        self._state: Any = None

    def predict(self, k: int) -> None:
        """To sample `k` from the one before it."""
        if not self._rows.size:
            return
        state, can = _each(self._filter_to(k - 1, k), self._state, self._rows)
        self._lose(k, ~can)
        self._state = state

    def see(self, k: int, image: int, points: Array, registered: Mask) -> None:
        """Fuse the images of flights that are tracked; start filters on the others that have one."""
        new = registered & np.isnan(self._out.failed_at)
        new[self._rows] = False
        places = np.flatnonzero(registered[self._rows])
        if places.size:
            self._fuse(k, image, points, places)
        if new.any():
            rows = np.flatnonzero(new)
            state, can = _each(lambda _, r: self._filter.start(self._own.view(r, k, points)), rows, rows)
            if can.any():  # the others wait for their next image
                self._state = concatenated([self._state, state]) if self._rows.size else state
                self._rows = np.concatenate([self._rows, rows[can]])

    def tell(self, k: int, to: int) -> None:
        """Write the beliefs at sample `k` down as what is known of sample `to`."""
        state, rows = self._state, self._rows
        if to > k and rows.size:
            state, can = _each(self._filter_to(k, to), state, rows)
            rows = rows[can]
        if rows.size:
            self._out.mean[rows, to], self._out.covariance[rows, to] = self._filter.to_nine(state)
            if self._filter.delay is not None and self._out.delay is not None:
                self._out.delay[rows, to] = np.stack(self._filter.delay(state), axis=1)

    def _filter_to(self, k0: int, k1: int) -> Callable[[Any, Indices], Any]:
        return lambda state, rows: self._filter.predict(state, self._own.step(rows, k0, k1))

    def _fuse(self, k: int, image: int, points: Array, places: Indices) -> None:
        all_see = places.size == self._rows.size
        state, rows = (self._state if all_see else taken(self._state, places)), self._rows[places]
        seen, can = _each(lambda s, r: self._filter.see(s, self._own.view(r, k, points)), state, rows)
        if seen is not None:
            self._out.nis[rows[can], image], self._out.fused[rows[can], image] = seen.nis, seen.fused
            whole = all_see and bool(can.all())
            self._state = seen.state if whole else put(self._state, places[can], seen.state)
        if not can.all():
            failed = np.zeros(self._rows.size, dtype=bool)
            failed[places[~can]] = True
            self._state = taken(self._state, np.flatnonzero(~failed))
            self._lose(k, failed)

    def _lose(self, k: int, failed: Mask) -> None:
        self._out.failed_at[self._rows[failed]] = self._out.t[k]
        self._rows = self._rows[~failed]


def _each(call: Callable[[Any, Indices], Any], state: Any, rows: Indices) -> tuple[Any, Mask]:
    """`call(state, rows)` without the flights for which it fails (None if for all), and for which it does not."""
    try:
        return call(state, rows), np.ones(rows.size, dtype=bool)
    except FilterError:
        if rows.size == 1:
            return None, np.zeros(1, dtype=bool)
    halves = (np.arange(rows.size // 2), np.arange(rows.size // 2, rows.size))
    found = [_each(call, taken(state, half), rows[half]) for half in halves]
    parts = [part for part, can in found if can.any()]
    return (concatenated(parts) if parts else None), np.concatenate([can for _, can in found])
