"""Filters over many simulated formation flights at once, on arrays without the pipeline.

Filters predict to each navigation sample, with the follower's velocity and acceleration assumed known (eq 8 ff. of
Oh & Johnson). Then the flights with a registered image are updated. A flight whose filter fails is removed; the
others continue.
"""

from collections.abc import Callable
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.models.relative_motion import FollowerMotion
from simlink.scenarios.camera import Camera
from simlink.scenarios.vehicle import Nav
from studies.relative_motion.flights import Flights
from studies.relative_motion.stacked_states import Indices, concatenated, put, taken

M_PER_FT: Final = 0.3048
ASSUMED_SIZE_M: Final = 8.75 * M_PER_FT  # by the filter; each run's true size differs by 2 % (1 sigma)
SIZE_SIGMA: Final = 0.02 * ASSUMED_SIZE_M

Mask = NDArray[np.bool_]


class Setting(NamedTuple):
    """The prior knowledge of a filter; `nav` holds the sizes of the errors of our own state."""

    camera: Camera
    size: float = ASSUMED_SIZE_M
    size_sigma: float = SIZE_SIGMA
    leader_class: Literal["fixed_wing", "multirotor"] = "fixed_wing"
    nav: Nav = Nav()


class Step(NamedTuple):
    """From one navigation sample of B flights to a later one, `dt` s on."""

    dt: float
    follower: FollowerMotion  # (B, 3) each


class Images(NamedTuple):
    """Images of B flights, and our own motion at the time of their stamps."""

    t: float
    points: Array  # (B, 3, 2) of center, left and right point, in focal lengths
    sigma: float  # of each coordinate, focal lengths
    R_cn: Array  # (B, 3, 3)
    r_FC_n: Array  # (B, 3)
    v_F_n: Array  # (B, 3)
    omega_b: Array  # (B, 3) rad/s
    R_bc: Array  # (3, 3) the mount


class ImageUpdate(NamedTuple):
    """B filters after their images: states, NIS (B,), and whether each image was fused (B,)."""

    state: Any
    nis: Array
    fused: Mask


class Filter(NamedTuple):
    """Functions over the states of B filters: a NamedTuple of arrays with a leading axis B, or nested.

    `nine_states` gives the belief over [r, v, b, a_lat, a_long] of `onboard.models.relative_motion`, which is
    scored; NaN without an estimate. `degrees` are the degrees of freedom of the NIS. Each function may raise
    FilterError; a flight that alone makes it do so is removed.
    """

    start: Callable[[Images], Any]
    predict: Callable[[Any, Step], Any]
    update: Callable[[Any, Images], ImageUpdate]
    nine_states: Callable[[Any], Belief]
    degrees: int = 3


class Method(NamedTuple):
    """A named way to make a filter from what it knows before the flight."""

    name: str
    label: str
    make: Callable[[Setting], Filter]


class Track(NamedTuple):
    """A filter's estimates over B flights at N navigation samples and M images, NaN without any.

    The axis B is absent for `one`. `mean` and `covariance` are posterior at times with an image. `failed_at` is
    the time, s, at which the covariance lost its Cholesky factor or a number overflowed, where the filter stops;
    NaN if never.
    """

    t: Array  # (N,)
    mean: Array  # (B, N, 9)
    covariance: Array  # (B, N, 9, 9)
    nis: Array  # (B, M)
    fused: Mask  # (B, M)
    failed_at: Any  # (B,)
    degrees: int = 3

    def one(self, b: int) -> "Track":
        """The track of flight `b` alone."""
        arrays = (self.mean[b], self.covariance[b], self.nis[b], self.fused[b], self.failed_at[b])
        return Track(self.t, *arrays, self.degrees)


class Lateness(NamedTuple):
    """The delays of images, in navigation samples."""

    stamp: int = 0  # from exposure to stamp, unknown to the filters
    # From a right stamp to the image's arrival; the estimate at arrival is a prediction from the stamp.
    delivery: int = 0


ON_TIME: Final = Lateness()


def track(flights: Flights, setting: Setting, method: Method, late: Lateness = ON_TIME) -> Track:
    """Fly `method` over `flights`, seen by the setting's camera."""
    count, samples, images = len(flights.seeds), len(flights.nav_t), len(flights.image_t)
    filter_ = method.make(setting)
    out = Track(
        flights.nav_t,
        np.full((count, samples, 9), np.nan),
        np.full((count, samples, 9, 9), np.nan),
        np.full((count, images), np.nan),
        np.zeros((count, images), dtype=bool),
        np.full(count, np.nan),
        filter_.degrees,
    )
    registered: Mask = np.asarray(np.isfinite(flights.image_points).all(axis=(2, 3)))
    image_at = {int(k) + late.stamp: image for image, k in enumerate(flights.image_at)}
    pool = _Pool(filter_, _OwnMotion(flights, setting.camera), out)
    # with the printed settings a diverging filter also overflows: it is caught as a failure
    with np.errstate(all="ignore"):
        for k in range(samples):
            if k:
                pool.predict(k)
            image = image_at.get(k)
            if image is not None:
                pool.update(k, image, flights.image_points[:, image], registered[:, image])
            if k + late.delivery < samples:
                pool.record(k, k + late.delivery)
    return out


class _OwnMotion:
    """Our own motion as the navigation system reports it, and the camera's pose."""

    def __init__(self, flights: Flights, camera: Camera) -> None:
        self._t, self._v, self._a = flights.nav_t, flights.nav_v_F_n, flights.nav_a_F_n
        self._R_nb = matrix_from_quaternion(flights.nav_q_nb)
        self._R_bc = matrix_from_euler(*np.radians(camera.mount_rpy_deg))
        self._offset, self._sigma = np.array(camera.mount_offset), camera.sigma_px / camera.f_px

    def step(self, rows: Indices, k0: int, k1: int) -> Step:
        v, a = self._v, self._a
        follower = FollowerMotion(v[rows, k0], v[rows, k1], a[rows, k0], a[rows, k1])
        return Step(float(self._t[k1] - self._t[k0]), follower)

    def images(self, rows: Indices, k: int, points: Array) -> Images:
        R_nb = self._R_nb[rows, k]
        # over so short a time the antisymmetric part is the rotation vector
        turn = np.swapaxes(self._R_nb[rows, max(k - 1, 0)], 1, 2) @ R_nb / float(self._t[1] - self._t[0])
        x, y, z = turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]
        return Images(
            t=float(self._t[k]),
            points=points[rows],
            sigma=self._sigma,
            R_cn=self._R_bc.T @ np.swapaxes(R_nb, 1, 2),
            r_FC_n=R_nb @ self._offset,
            v_F_n=self._v[rows, k],
            omega_b=0.5 * np.stack([x, y, z], axis=1),
            R_bc=self._R_bc,
        )


class _Pool:
    """The filters that run: `rows` are their flights, in the order of their states."""

    def __init__(self, filter_: Filter, own: _OwnMotion, out: Track) -> None:
        self._filter, self._own, self._out = filter_, own, out
        self._rows: Indices = np.empty(0, dtype=np.intp)
        self._state: Any = None

    def predict(self, k: int) -> None:
        """To sample `k` from the one before it."""
        if not self._rows.size:
            return
        state, works = _where_it_works(self._prediction(k - 1, k), self._state, self._rows)
        self._remove(k, ~works)
        self._state = state

    def update(self, k: int, image: int, points: Array, registered: Mask) -> None:
        """Fuse the images of flights that are tracked; start filters on the images of the others."""
        new = registered & np.isnan(self._out.failed_at)
        new[self._rows] = False
        places = np.flatnonzero(registered[self._rows])
        if places.size:
            self._fuse(k, image, points, places)
        if new.any():
            rows = np.flatnonzero(new)
            state, works = _where_it_works(
                lambda _, some: self._filter.start(self._own.images(some, k, points)), rows, rows
            )
            if works.any():  # the others wait for their next image
                self._state = concatenated([self._state, state]) if self._rows.size else state
                self._rows = np.concatenate([self._rows, rows[works]])

    def record(self, k: int, to: int) -> None:
        """Store the beliefs at sample `k`, predicted to sample `to`, as the estimates of sample `to`."""
        state, rows = self._state, self._rows
        if to > k and rows.size:
            state, works = _where_it_works(self._prediction(k, to), state, rows)
            rows = rows[works]
        if rows.size:
            self._out.mean[rows, to], self._out.covariance[rows, to] = self._filter.nine_states(state)

    def _prediction(self, k0: int, k1: int) -> Callable[[Any, Indices], Any]:
        return lambda state, rows: self._filter.predict(state, self._own.step(rows, k0, k1))

    def _fuse(self, k: int, image: int, points: Array, places: Indices) -> None:
        of_all = places.size == self._rows.size
        state, rows = (self._state if of_all else taken(self._state, places)), self._rows[places]
        update, works = _where_it_works(
            lambda part, some: self._filter.update(part, self._own.images(some, k, points)), state, rows
        )
        if update is not None:
            self._out.nis[rows[works], image], self._out.fused[rows[works], image] = update.nis, update.fused
            whole = of_all and bool(works.all())
            self._state = update.state if whole else put(self._state, places[works], update.state)
        if not works.all():
            failed = np.zeros(self._rows.size, dtype=bool)
            failed[places[~works]] = True
            self._state = taken(self._state, np.flatnonzero(~failed))
            self._remove(k, failed)

    def _remove(self, k: int, failed: Mask) -> None:
        self._out.failed_at[self._rows[failed]] = self._out.t[k]
        self._rows = self._rows[~failed]


def _where_it_works(call: Callable[[Any, Indices], Any], state: Any, rows: Indices) -> tuple[Any, Mask]:
    """Return `call(state, rows)` for the flights without a FilterError, and a mask of them.

    The result is None without any such flight.
    """
    try:
        return call(state, rows), np.ones(rows.size, dtype=bool)
    except FilterError:
        if rows.size == 1:
            return None, np.zeros(1, dtype=bool)
    halves = (np.arange(rows.size // 2), np.arange(rows.size // 2, rows.size))
    found = [_where_it_works(call, taken(state, half), rows[half]) for half in halves]
    parts = [part for part, works in found if works.any()]
    return (concatenated(parts) if parts else None), np.concatenate([works for _, works in found])
