"""Bounds of configuration values, shared by the file, `--set` and MAVLink parameters.

A value may be positive and still leave no estimate valid after the next start. The bounds are wide: they reject
values that no vehicle has, and values in another unit.
"""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from onboard.config.cameras import lens_of
from onboard.config.sections import Config


class Bounds(NamedTuple):
    """The smallest and the largest value, and the reason for them."""

    low: float
    high: float
    why: str


ANGLE_DEG: Final = Bounds(-360.0, 360.0, "it is an angle in degrees")
OFFSET_M: Final = Bounds(-50.0, 50.0, "it is a distance on our own vehicle in metres")
DELAY_BOUNDS: Final = Bounds(-10.0, 10.0, "it is a delay in seconds; older images are not fused")
RANGES: Final = {
    "estimator.leader.size_prior_m": Bounds(0.02, 200.0, "it is an aircraft's wingspan in metres"),
    "estimator.leader.size_prior_sigma_m": Bounds(1e-6, 100.0, "it is the error of a wingspan in metres"),
    "ownship.errors.tilt_sigma_deg": Bounds(0.0, 45.0, "a larger error leaves the vertical unknown"),
    "ownship.errors.yaw_sigma_deg": Bounds(0.0, 90.0, "a larger error leaves north unknown"),
    "ownship.errors.velocity_sigma_m_s": Bounds(0.0, 100.0, "it is the error of a velocity in m/s"),
    "estimator.leader.delay_sigma_s": Bounds(0.0, 1.0, "it is the error of a delay in seconds"),
    "estimator.leader.validity_timeout_s": Bounds(0.02, 3600.0, "it is a time without images in seconds"),
    "delay.camera_s": DELAY_BOUNDS,
}
CAMERA_RANGES: Final = {
    "mount_rpy_deg": ANGLE_DEG,
    "mount_offset_m": OFFSET_M,
    "delay_s": DELAY_BOUNDS,
    "mount_sigma_deg": Bounds(0.0, 45.0, "a larger error leaves the camera's direction unknown"),
    "mount_yaw_sigma_deg": Bounds(0.0, 90.0, "a larger error leaves the camera's direction unknown"),
}
# Keys that the file of stored parameters may set: a parameter cannot open a link or name a file.
TUNABLE: Final = frozenset(RANGES) | {
    f"camera.{key}" for key in ("f_px", "sigma_px", "mount_rpy_deg", "mount_offset_m")
}
FOCAL_LENGTH_RANGE: Final = Bounds(
    0.01, 100.0, "the field of view is then between 0.6 and 179 degrees"
)  # image widths
SIGMA_RANGE: Final = Bounds(1e-5, 0.02, "a larger error hides a wing, and no detector has a smaller one")  # widths


def out_of_range(config: Config) -> Iterator[str]:
    """Yield a line for each value out of bounds: key, value, bounds and reason."""
    for key, bounds in RANGES.items():
        yield from _check(key, _find(config, key), bounds)
    cameras = {"camera": config.camera} | {f"cameras.{name}": c for name, c in config.cameras.items()}
    for name, camera in cameras.items():
        for key, bounds in CAMERA_RANGES.items():
            yield from _check(f"{name}.{key}", getattr(camera, key), bounds)
        width = lens_of(camera).width_px
        yield from _check(f"{name}.sigma_px", camera.sigma_px, _scale(SIGMA_RANGE, width))
        for key in ("f_px", "fy_px"):
            yield from _check(f"{name}.{key}", getattr(camera, key), _scale(FOCAL_LENGTH_RANGE, width))


def not_tunable(table: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield the keys of a table that no parameter may set."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        if isinstance(value, dict) and key not in TUNABLE:
            yield from not_tunable(value, f"{key}.")
        elif key not in TUNABLE:
            yield key


def _scale(bounds: Bounds, by: float) -> Bounds:
    return bounds._replace(low=bounds.low * by, high=bounds.high * by)


def _find(config: Config, key: str) -> Any:
    """Return the value of a key, or None if it does not exist."""
    found: Any = config
    for part in key.split("."):
        found = found.get(part) if isinstance(found, dict) else getattr(found, part, None)
    return found


def _check(key: str, value: Any, bounds: Bounds) -> Iterator[str]:
    if value is None:
        return
    if isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _check(f"{key}[{i}]", item, bounds)
    elif not bounds.low <= value <= bounds.high:
        wanted = f"expected {bounds.low:.6g} to {bounds.high:.6g}"
        yield f"{key}: {value:.6g} is out of range; {wanted}, since {bounds.why}"
