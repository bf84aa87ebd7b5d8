"""Requirements of a configuration, which the health's advice compares with reality."""

import math
from collections.abc import Mapping
from typing import Final

from onboard.config import Config
from onboard.geometry.lens import Lens
from onboard.health import LinkNeed, Needs

MIN_IMU_RATE_HZ: Final = 17.0  # below it, a yaw that is wrong is not noticed (docs/fly-it.md)
MIN_GPS_RATE_HZ: Final = 1.0
MIN_RATE_HZ: Final = 5.0
USES_IMAGES: Final = ("leader", "oh_johnson")
MIN_WIDE_ANGLE: Final = math.radians(40.0)  # from the axis to a corner of the image
PLACES: Final = ("FOLLOW_TARGET", "GLOBAL_POSITION_INT", "ADSB_VEHICLE", "CAMERA_TRACKING_GEO_STATUS")


def needs(config: Config) -> Needs:
    """Return the requirements of a configuration."""
    cameras = config.camera_inputs()
    return Needs(
        prefix=config.zenoh.prefix if config.zenoh.enabled else "",
        system=config.autopilot.system,
        links=tuple(LinkNeed(k.name, k.url, k.is_autopilot, k.key_file) for k in config.link),
        cameras=tuple(cameras),
        rates=_rates(config),
        asked=config.autopilot.rates_hz,
        images=any(name in config.estimator for name in USES_IMAGES),
        classes=tuple(config.target),
        undistorted=tuple(name for name, camera in cameras.items() if _is_wide_pinhole(camera.lens)),
        ros=tuple(name for name, camera in cameras.items() if camera.ros.seen),
        transponder=any(getattr(each, "own_icao", "") for each in config.estimator.values()),
        sends_places=tuple(out.link for out in config.leader_out if any(n in PLACES for n in out.rates_hz)),
    )


def _is_wide_pinhole(lens: Lens) -> bool:
    """Whether a lens has no distortion although its image ends far from the axis."""
    corner = math.hypot(lens.width_px / lens.fx_px, lens.height_px / lens.fy_px) / 2.0
    return lens.is_pinhole and corner > math.tan(MIN_WIDE_ANGLE)


def _rates(config: Config) -> Mapping[str, float]:
    """Hz of each stream. Beyond its newest sample our own pose is carried on for `max_extrapolation_s` only."""
    if not config.estimator:
        return {}
    pose = max(1.0 / max(config.ownship.max_extrapolation_s, 1e-3), MIN_RATE_HZ)
    rates = {"Attitude": min(pose, 50.0), "LocalPosition": min(pose, 50.0)}
    if "own_state" in config.estimator:
        rates |= {"Imu": MIN_IMU_RATE_HZ, "GpsFix": MIN_GPS_RATE_HZ}
    return rates
