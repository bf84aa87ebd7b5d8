"""Radar scans prepared for association.

They are echoes with their noise, and the radar's position and attitude.
"""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.frame import OwnMotion
from onboard.estimators.traffic.batch import Radar
from onboard.estimators.traffic.config import Config
from onboard.filters.association import Places
from onboard.geometry.rotations import matrix_from_euler
from onboard.messages import RadarScan


class Echoes(NamedTuple):
    """Echoes of a scan with their noise.

    Attributes
    ----------
    polar : (k, 3)
        Range (m), azimuth and elevation (rad).
    sigma : (k, 3)
        Standard deviations.
    """

    polar: Array
    sigma: Array

    def at(self, places: Places) -> "Echoes":
        """Return some of the echoes."""
        return Echoes(self.polar[places], self.sigma[places])


def radar_of(scan: RadarScan, own: OwnMotion, config: Config) -> Radar:
    """Return position and attitude of our radar, by our own navigation."""
    R_rb = matrix_from_euler(*np.radians(config.radar_mount_rpy_deg)).T
    R_rn = R_rb @ own.R_nb.T if scan.frame == "body" else own.R_nl.T
    return Radar(own.r + own.R_nb @ np.array(config.radar_offset_m), np.ascontiguousarray(R_rn))


def echoes_of(scan: RadarScan, config: Config, angle_sigma: float | None = None) -> Echoes:
    """Return the scan's echoes, with the radar's noise and glint.

    `angle_sigma`, rad, is added to the noise of both angles.
    """
    polar = np.array([(d.range, d.azimuth, d.elevation) for d in scan.detections]).reshape(-1, 3)
    azimuth, elevation = np.radians([config.radar_azimuth_sigma_deg, config.radar_elevation_sigma_deg]).tolist()
    usual = (config.radar_range_sigma_m, azimuth, elevation)
    sigma = np.array([d.sigma or usual for d in scan.detections]).reshape(-1, 3)
    near = np.maximum(polar[:, 0], 1.0)
    level = np.maximum(near * np.cos(polar[:, 2]), 1.0)
    sigma = np.hypot(sigma, config.radar_glint_m / np.stack([np.ones_like(near), level, near], axis=1))
    if angle_sigma is not None:
        sigma[:, 1:] = np.hypot(sigma[:, 1:], angle_sigma)
    return Echoes(polar, np.asarray(sigma))
