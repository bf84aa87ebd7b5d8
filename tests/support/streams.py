"""Synthetic flights as bytes: two aircraft on analytic paths, with MAVLink and images.

They are independent of `simlink` and of `onboard.models`: positions and velocities are closed formulas, image
points are projected explicitly.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.config import Config, load_config
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler
from onboard.messages import (
    Attitude,
    Datagram,
    Encoding,
    Estimate,
    Health,
    Heartbeat,
    Imu,
    LocalPosition,
    MeasurementReport,
    Message,
    Output,
    TargetPoints,
    Verdict,
)
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support import kept
from tests.support.honesty import nees
from tests.support.images import exposed

MS: Final = 1_000_000
S: Final = 1_000_000_000
EPOCH: Final = 1_735_689_600 * S  # host clock at boot: 2025-01-01
SIZE: Final = 2.0
TRUTH_COLUMNS: Final = "time_boot_s,r_north_m,r_east_m,r_down_m,v_north_m_s,v_east_m_s,v_down_m_s,size_m"
FOCAL_LENGTH_PX: Final = 554.256
PX4: Final = 12
LATENCY: Final = 60 * MS
FLIGHT_SYSTEM_ID: Final = 1
CAMERA_COMPONENT_ID: Final = 191


class Kinematics(NamedTuple):
    """Position, velocity, acceleration in n, and roll, pitch, yaw."""

    r: Array
    v: Array
    a: Array
    rpy: tuple[float, float, float]


@dataclass(frozen=True)
class Flight:
    """Follower and leader in line, `gap` metres apart along the path; radius None is straight north."""

    radius: float | None = 100.0
    speed: float = 15.0
    gap: float = 28.0
    size: float = SIZE

    def at(self, t: float, ahead: float = 0.0) -> Kinematics:
        """Return the aircraft `ahead` metres along the path; a slow wave in height distinguishes up and down."""
        along = self.speed * t + ahead
        w = 0.3
        down, climb, bend = -50 + 2 * math.sin(w * t), 2 * w * math.cos(w * t), -2 * w * w * math.sin(w * t)
        if self.radius is None:
            return Kinematics(
                np.array([along, 0.0, down]),
                np.array([self.speed, 0.0, climb]),
                np.array([0.0, 0.0, bend]),
                (0, 0, 0),
            )
        angle, rate = along / self.radius, self.speed / self.radius
        c, s = math.cos(angle), math.sin(angle)
        return Kinematics(
            np.array([self.radius * s, self.radius * (1 - c), down]),
            np.array([self.speed * c, self.speed * s, climb]),
            np.array([-self.speed * rate * s, self.speed * rate * c, bend]),
            (math.atan(self.speed * rate / 9.81), 0.0, math.remainder(angle, 2 * math.pi)),
        )

    def relative(self, t: float) -> tuple[Array, Array]:
        """(r_FL_n, v_FL_n)."""
        follower, leader = self.at(t), self.at(t, self.gap)
        return leader.r - follower.r, leader.v - follower.v

    def points(self, t: float) -> Array:
        """Image points (3, 2), exact: center, left and right wingtip."""
        follower, leader = self.at(t), self.at(t, self.gap)
        R_bn = matrix_from_euler(*follower.rpy).T
        wing = matrix_from_euler(*leader.rpy)[:, 1] * self.size / 2
        r_c = np.array([R_bn @ (leader.r + offset - follower.r) for offset in (0 * wing, -wing, wing)])
        return r_c[:, 1:] / r_c[:, :1]

    def attitude(self, t_ns: int) -> Attitude:
        """The autopilot's attitude message at a boot time."""
        rpy = self.at(t_ns / S).rpy
        rate = 0.0 if self.radius is None else self.speed / self.radius
        omega = matrix_from_euler(*rpy).T @ np.array([0.0, 0.0, rate])
        q = quaternion_from_euler(*rpy)
        return Attitude(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, q_nb=tuple(q.tolist()), omega_b=tuple(omega.tolist()))

    def position(self, t_ns: int) -> LocalPosition:
        """The autopilot's position message at a boot time."""
        k = self.at(t_ns / S)
        return LocalPosition(
            t_ns=t_ns, t_recv_ns=EPOCH + t_ns, r_OF_n=tuple(k.r.tolist()), v_F_n=tuple(k.v.tolist())
        )

    def imu(self, t_ns: int) -> Imu:
        """The accelerometer and gyro at a boot time."""
        k, attitude = self.at(t_ns / S), self.attitude(t_ns)
        f_b = matrix_from_euler(*k.rpy).T @ (k.a - np.array([0.0, 0.0, 9.80665]))
        return Imu(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, f_b=tuple(f_b.tolist()), omega_b=attitude.omega_b)

    def image(self, t_ns: int, rng: np.random.Generator | None = None, latency: int = LATENCY) -> TargetPoints:
        """One image, with 1 px of noise if `rng` is given."""
        points = self.points(t_ns / S)
        if rng is not None:
            points = points + rng.normal(size=(3, 2)) / FOCAL_LENGTH_PX
        center, left, right = (tuple(p) for p in points.tolist())
        return TargetPoints(
            t_ns=t_ns,
            t_recv_ns=EPOCH + t_ns + latency,
            component=CAMERA_COMPONENT_ID,
            camera="landing_target",
            center=center,
            left=left,
            right=right,
        )


def write_truth(path: Path, flight: Flight, times: Iterable[float]) -> None:
    """Write a table of the true relative motion at boot times (s)."""
    rows = [",".join(f"{v:.6f}" for v in (t, *np.ravel(flight.relative(t)), flight.size)) for t in times]
    path.write_text("\n".join([TRUTH_COLUMNS, *rows, ""]), encoding="utf-8")


CIRCLE: Final = Flight()
STRAIGHT: Final = Flight(radius=None)


class Item(NamedTuple):
    """A message and its arrival time, before encoding. Faults act on these."""

    t_recv_ns: int
    message: Message


def heartbeat(t_ns: int, system: int = FLIGHT_SYSTEM_ID, autopilot: int = PX4) -> Heartbeat:
    """An armed multirotor's heartbeat."""
    return Heartbeat(
        t_ns=t_ns, t_recv_ns=EPOCH + t_ns, system=system, vehicle_type=2, autopilot=autopilot, armed=True, status=4
    )


@dataclass
class Stream:
    """A flight as messages in order of arrival, from boot time `t0` to `t1` (s).

    `images(t)`: whether the image at t (s) contains the leader; `lead_ns`: camera clock minus boot clock;
    `sparse`: every second message of each kind only, which costs half and shows most faults as well.
    """

    flight: Flight = CIRCLE
    t0: float = 5.0
    t1: float = 15.0
    seed: int | None = 1
    latency: int = LATENCY
    lead_ns: int = 0
    images: Callable[[float], bool] = field(default=lambda _t: True)
    sparse: bool = False

    def items(self) -> list[Item]:
        """Yield messages with their arrivals: own motion at 50 Hz, 2 ms late; images at 25 Hz.

        Images are `latency` late. `sparse` halves the rates.
        """
        rng = None if self.seed is None else np.random.default_rng(self.seed)
        out = []
        for ms in range(round(self.t0 * 1000), round(self.t1 * 1000), 20):
            t_ns = ms * MS
            if ms % 1000 == 0:
                out.append(Item(EPOCH + t_ns + MS, heartbeat(t_ns)))
            if not self.sparse or ms % 40 == 0:
                out.append(Item(EPOCH + t_ns + 2 * MS, self.flight.attitude(t_ns)))
                out.append(Item(EPOCH + t_ns + 2 * MS, self.flight.position(t_ns)))
            if ms % 40 == 0 and self.images(ms / 1000):
                image = self.flight.image(t_ns, rng, self.latency)
                if self.lead_ns:
                    image = replace(image, t_ns=t_ns + self.lead_ns)
                if not self.sparse or ms % 80 == 0:
                    out.append(Item(EPOCH + t_ns + self.latency, image))
        return sorted(out, key=lambda item: item.t_recv_ns)

    def datagrams(self) -> list[Datagram]:
        """The same as MAVLink in UDP datagrams."""
        return encode(self.items())


def encode(items: Iterable[Item], channel: str = "udp") -> list[Datagram]:
    """Each message as one datagram, in the order given."""
    encoders: dict[tuple[int, int], MavlinkEncoder] = {}
    out = []
    for t_recv_ns, message in items:
        sender = message.system, message.component
        encoder = encoders.setdefault(sender, MavlinkEncoder(*sender))
        data = encoder.encode(message)
        out.append(Datagram(channel=channel, encoding=Encoding.MAVLINK, t_recv_ns=t_recv_ns, data=data))
    return out


def make_config(*overrides: str) -> Config:
    """The defaults, with the leader's size as flown here."""
    return load_config(None, (f"estimator.leader.size_prior_m={SIZE}", *overrides))


class Run:
    """A pipeline and all its outputs.

    One whose outputs and health were kept is flown again if it is asked for.
    """

    def __init__(
        self, pipeline: Pipeline | Callable[[], Pipeline], outputs: list[Output], kept: Health | None = None
    ) -> None:
        self._pipeline, self.outputs, self._kept = pipeline, outputs, kept

    @property
    def pipeline(self) -> Pipeline:
        """The pipeline after all outputs, or what has been done to it since."""
        if not isinstance(self._pipeline, Pipeline):
            self._pipeline, self._kept = self._pipeline(), None
        return self._pipeline

    @property
    def health(self) -> Health:
        """The pipeline's health, its counts above all."""
        return self.pipeline.health(0) if self._kept is None else self._kept

    @property
    def estimates(self) -> list[Estimate]:
        """Estimates in order."""
        return [o for o in self.outputs if isinstance(o, Estimate)]

    @property
    def reports(self) -> list[MeasurementReport]:
        """The report of each image."""
        return [e.measurement for e in self.estimates if e.measurement is not None]

    def verdicts(self) -> dict[Verdict, int]:
        """Number of images by verdict."""
        found: dict[Verdict, int] = {}
        for report in self.reports:
            found[report.verdict] = found.get(report.verdict, 0) + 1
        return found

    @property
    def rejected(self) -> dict[str, int]:
        """The pipeline's counts of rejected messages."""
        return self.health.rejected


def feed(datagrams: Iterable[Datagram], config: Config | None = None, *, errors: bool = False) -> Run:
    """Run all datagrams through a new pipeline. It must count no exception, unless `errors`."""
    pipeline = Pipeline(config or make_config())
    outputs: list[Output] = []
    for datagram in datagrams:
        outputs.extend(pipeline.feed(datagram))
    assert errors or not pipeline.errors, pipeline.errors
    return Run(pipeline, outputs)


def feed_once(datagrams: Iterable[Datagram], config: Config | None = None) -> Run:
    """Run `feed` with the result kept on disk, for flights without patches.

    Only outputs and health are available.
    """
    return _once(feed, [*datagrams], config or make_config())


def advance_once(messages: Iterable[Message], config: Config | None = None) -> Run:
    """Run `advance` with the result kept on disk, as by `feed_once`."""
    return _once(advance, [*messages], config or make_config())


def _once(fly: Callable[..., Run], sent: list[Any], config: Config) -> Run:
    flown: list[Run] = []

    def outputs_and_health() -> tuple[list[Output], Health]:
        flown.append(fly(sent, config))
        return flown[0].outputs, flown[0].health

    outputs, health = kept.flown((fly.__name__, sent, config), outputs_and_health)
    return flown[0] if flown else Run(lambda: fly(sent, config).pipeline, outputs, health)


def advance(messages: Iterable[Message], config: Config | None = None) -> Run:
    """Run all messages through a new pipeline, without encoding."""
    pipeline = Pipeline(config or make_config())
    outputs: list[Output] = []
    for message in exposed(messages):
        outputs.extend(pipeline.advance([message]))
    assert not pipeline.errors, pipeline.errors
    return Run(pipeline, outputs)


def position_error(estimate: Estimate, flight: Flight = CIRCLE) -> float:
    """Distance (m) between the estimated and the true relative position."""
    assert estimate.mean is not None
    return float(np.linalg.norm(np.array(estimate.mean[:3]) - flight.relative(estimate.t_ns / S)[0]))


def position_nees(estimate: Estimate, flight: Flight = CIRCLE) -> float:
    """The normalised square of the position's error."""
    off = np.array(estimate.mean)[:3] - flight.relative(estimate.t_ns / S)[0]
    return nees(off, np.array(estimate.covariance)[:3, :3])


def assert_sane(estimates: Iterable[Estimate]) -> None:
    """Assert the properties of every estimate, for any input."""
    for e in estimates:
        if e.mean is None:
            assert not e.valid
            assert e.covariance is None
            continue
        mean, covariance = np.array(e.mean), np.array(e.covariance)
        if e.valid:
            assert np.isfinite(mean).all()
            assert np.isfinite(covariance).all()
            assert (covariance == covariance.T).all()
            np.linalg.cholesky(covariance)  # raises unless positive definite
            assert e.age is not None
            assert e.age <= 2.0
