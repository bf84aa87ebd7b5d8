"""Registration alone: aircraft around a radar, with errors drawn from the model."""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.registration import AnchorEcho, Registration
from onboard.estimators.traffic.reports import Report
from onboard.messages import PeerPosition
from onboard.units import NS_PER_S

CONFIG: Final = Config(own_yaw_sigma_deg=0.6, own_position_sigma_m=1.0)
PRIOR_SIGMA: Final = np.radians([0.5, 0.5, 0.6])
RADAR: Final = np.array([5.0, -3.0, 2.0])
RADAR_SIGMA, REPORT_SIGMA = 3.0, 2.0  # m: of each echo's position, and of each report's
AHEAD: Final = np.array([[1000.0, 0.3, 0.1]])
MESSAGE: Final = PeerPosition(
    t_ns=0, t_recv_ns=0, system=1, lat_deg=0.0, lon_deg=0.0, alt_msl=0.0, v_n=(0.0, 0.0, 0.0)
)


class World:
    """Aircraft at rest around us, with biases and our own errors drawn from the model.

    The radar scans ten times a second, and each aircraft reports once. With `north` (m) all are on one side.
    `white` is the sigma of a report.
    """

    def __init__(
        self,
        count: int,
        seed: int,
        own_sigma: float = 1.0,
        north: float = 0.0,
        white: float = REPORT_SIGMA,
        bias: float = 3.0,
    ) -> None:
        self.rng, self.white, self.bias = np.random.default_rng(seed), white, bias
        self.places = self.rng.uniform(-1, 1, (count, 3)) * [3000.0, 3000.0, 400.0]
        if north:
            self.places = north * np.array([1.0, 0.0, 0.0]) + 0.1 * self.places
        self.biases = self.rng.normal(0, bias, (count, 3))
        self.own = self.rng.normal(0, own_sigma, 3)
        self.rotation = self.rng.normal(0, PRIOR_SIGMA)
        self.reports = [self.report(k, 0) for k in range(count)]

    def report(self, k: int, t_ns: int) -> Report:
        y = np.concatenate([self.places[k] + self.biases[k] + self.rng.normal(0, self.white, 3), np.zeros(3)])
        R = np.diag([self.white**2] * 3 + [1e-4] * 3)
        return Report(("system", k), t_ns, y, R, np.full(3, self.bias), MESSAGE)

    def scan(self, number: int) -> list[AnchorEcho]:
        """Echoes of scan `number`, a tenth of a second after the one before."""
        t_ns = number * NS_PER_S // 10
        decay = np.exp(-0.1 / 10.0)
        self.rotation = decay * self.rotation + self.rng.normal(0, PRIOR_SIGMA * np.sqrt(1 - decay**2))
        echoes = []
        for k, place in enumerate(self.places):
            if number % 10 == k % 10:
                self.reports[k] = self.report(k, t_ns)
            rotated = place + np.cross(self.rotation, place - RADAR) + self.own
            by_radar, report = rotated + self.rng.normal(0, RADAR_SIGMA, 3), self.reports[k]
            echoes.append(AnchorEcho(k, by_radar, report.y[:3], RADAR_SIGMA**2 * np.eye(3), report))
        return echoes


def after_scans(world: World, scans: int, config: Config = CONFIG) -> Registration:
    registration = Registration(config)
    for number in range(scans):
        registration.advance(number * NS_PER_S // 10)
        registration.update(number * NS_PER_S // 10, world.scan(number), RADAR)
    return registration


def covariance_of(registration: Registration) -> Array:
    return np.asarray(registration._belief.covariance[:3, :3])
