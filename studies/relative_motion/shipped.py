"""Our own estimator in the study: simlink's flights as messages through the default pipeline.

Only the camera and the leader's size and class are configured.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.config import load_config
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import (
    Attitude,
    Clock,
    Estimate,
    Exposure,
    Heartbeat,
    LocalPosition,
    Message,
    TargetPoints,
    Verdict,
)
from onboard.models.relative_motion import STATE_SIZE
from onboard.pipeline import Pipeline
from simlink.autopilot import ACTIVE, AUTOPILOT, VEHICLE_TYPE
from simlink.encounters.encounter import BOOT_NS
from simlink.simulation import CAMERA_COMPONENT_ID, EPOCH_NS
from studies.relative_motion.flight import NAV_RATE, Flight
from studies.relative_motion.formation import ON_TIME, Lateness, Setting, Track

PX4: Final = AUTOPILOT["px4"]  # its stamps are right, as those of these flights are
FUSED: Final = (Verdict.FUSED, Verdict.FUSED_LATE)


class Shipped(NamedTuple):
    """The daemon's estimator with `settings`, overrides in the form of `--set`."""

    name: str
    label: str
    settings: tuple[str, ...] = ()


EVERY_SAMPLE: Final = "estimator.leader.publish_rate_hz=1000"  # scores are of navigation samples
DEFAULT: Final = Shipped("shipped", "the daemon, as shipped")
ON_WING: Final = Shipped(
    "on-wing", "the daemon, `center_on_wing = true`", ("estimator.leader.center_on_wing=true",)
)
DELAY: Final = Shipped("delay", "the daemon, `delay_sigma_s = 0.15`", ("estimator.leader.delay_sigma_s=0.15",))


def boot_ns(t: float) -> int:
    """The boot clock at a time of the flight, s."""
    return BOOT_NS + round(t * 1e9)


def known(setting: Setting) -> tuple[str, ...]:
    """Settings: what is known before the flight."""
    camera = setting.camera
    return (
        f"estimator.leader.size_prior_m={setting.size}",
        f"estimator.leader.leader_class={setting.leader_class}",
        f"camera.f_px={camera.f_px}",
        f"camera.width_px={camera.width_px:.0f}",
        f"camera.height_px={camera.height_px:.0f}",
        f"camera.mount_rpy_deg={list(camera.mount_rpy_deg)}",
        f"camera.mount_offset_m={list(camera.mount_offset)}",
    )


def track(flight: Flight, setting: Setting, method: Shipped, late: Lateness = ON_TIME) -> Track:
    """Fly one flight; estimates that are not valid are NaN."""
    pipeline = Pipeline(load_config(None, (*known(setting), *method.settings, EVERY_SAMPLE)))
    samples, images = len(flight.nav_t), len(flight.image_t)
    mean, covariance = np.full((samples, STATE_SIZE), np.nan), np.full((samples, STATE_SIZE, STATE_SIZE), np.nan)
    nis, fused, degrees = np.full(images, np.nan), np.zeros(images, dtype=bool), 0
    stamps = {ns: i for i, ns in enumerate(_stamps(flight, late))}
    samples_at = {boot_ns(t): k for k, t in enumerate(flight.nav_t.tolist())}
    for message in messages(flight, setting.camera.name, late):
        for output in pipeline.advance((message,)):
            if not isinstance(output, Estimate) or not output.is_primary:
                continue
            k, image = samples_at.get(output.t_ns), output.measurement
            if k is not None:
                mean[k], covariance[k] = _numbers(output)
            if image is not None and image.nis is not None and image.t_ns in stamps:
                at, degrees = stamps[image.t_ns], len(image.components)
                nis[at], fused[at] = image.nis, image.verdict in FUSED
    return Track(flight.nav_t, mean, covariance, nis, fused, float("nan"), degrees)


def messages(flight: Flight, camera: str, late: Lateness = ON_TIME) -> list[Message]:
    """Return the messages that the follower's computer receives, in the order of arrival."""
    every = [*_navigation(flight), *_images(flight, camera, late)]
    return sorted(every, key=lambda m: m.t_recv_ns)


def _numbers(estimate: Estimate) -> tuple[Array, Array]:
    """Mean (9,) and covariance (9, 9); NaN if the estimate is not valid."""
    if not estimate.valid or estimate.mean is None or estimate.covariance is None:
        return np.full(STATE_SIZE, np.nan), np.full((STATE_SIZE, STATE_SIZE), np.nan)
    return np.array(estimate.mean[:STATE_SIZE]), np.array(estimate.covariance)[:STATE_SIZE, :STATE_SIZE]


def _stamps(flight: Flight, late: Lateness) -> list[int]:
    return [boot_ns(t + late.stamp / NAV_RATE) for t in flight.image_t.tolist()]


def _navigation(flight: Flight) -> Iterator[Message]:
    R_nb = matrix_from_quaternion(flight.nav_q_nb)
    # over so short a time the antisymmetric part is the rotation vector
    turn = np.swapaxes(R_nb[:-1], 1, 2) @ R_nb[1:] * (0.5 * NAV_RATE)
    rates = np.stack([turn[:, k, i] - turn[:, i, k] for i, k in ((1, 2), (2, 0), (0, 1))], axis=1)
    rows = zip(
        flight.nav_t.tolist(),
        flight.nav_q_nb.tolist(),
        np.vstack([rates[:1], rates]).tolist(),
        flight.nav_truth.r_OF_n.tolist(),
        flight.nav_v_F_n.tolist(),
        strict=True,
    )
    for k, (t, q, omega, r, v) in enumerate(rows):
        ns = boot_ns(t)
        arrival = EPOCH_NS + ns
        if k % NAV_RATE == 0:
            yield Heartbeat(
                t_ns=ns,
                t_recv_ns=arrival,
                clock=Clock.NONE,
                vehicle_type=VEHICLE_TYPE["quadrotor"],
                autopilot=PX4,
                armed=True,
                status=ACTIVE,
            )
        yield Attitude(
            t_ns=ns,
            t_recv_ns=arrival,
            q_nb=(q[0], q[1], q[2], q[3]),
            omega_b=(omega[0], omega[1], omega[2]),
        )
        yield LocalPosition(t_ns=ns, t_recv_ns=arrival, r_OF_n=(r[0], r[1], r[2]), v_F_n=(v[0], v[1], v[2]))


def _images(flight: Flight, camera: str, late: Lateness) -> Iterator[Message]:
    wait = (late.stamp + late.delivery) / NAV_RATE
    rows = zip(_stamps(flight, late), flight.image_t_delivered.tolist(), flight.image_points, strict=True)
    for ns, delivered, points in rows:
        if np.isfinite(points).all():
            center, left, right = ((float(y), float(z)) for y, z in points)
            image = TargetPoints(
                t_ns=ns,
                t_recv_ns=EPOCH_NS + boot_ns(delivered + wait),
                component=CAMERA_COMPONENT_ID,
                camera=camera,
                center=center,
                left=left,
                right=right,
            )
            yield Exposure.of(image)
