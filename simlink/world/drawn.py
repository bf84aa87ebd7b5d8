"""Parameters drawn for each run by seed: the errors of our vehicle and sensors.

Runs on the wire and through a pipeline are drawn (`simlink.simulation`); the flights that studies compute as
arrays, to reproduce a paper, are not. No user of a daemon knows these numbers, and no estimator may be judged at
its own settings.
"""

from typing import Final, TypeVar

import numpy as np
from msgspec.structs import replace

from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.rangefinder import Rangefinder
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import Aircraft, Reports, TrafficScene
from simlink.scenarios.vehicle import BarometerErrors, Gps, Nav
from simlink.world.noise import stream

Range = tuple[float, float]
R = TypeVar("R", bound=Reports)

# An ArduPilot's yaw is steadily 0.6 degrees off, and steps by 1.5 to 2 at take-off (../shared/data/README.md).
# Roll and pitch are known better, the mount of the camera included.
TILT_ERROR_DEG: Final[Range] = (0.15, 0.5)  # standard deviations
YAW_ERROR_DEG: Final[Range] = (0.5, 1.6)
ATTITUDE_ERROR_S: Final[Range] = (25.0, 200.0)
# GPS receivers' data sheets give 0.05 to 0.1 m/s (68 %, good sky); Oh & Johnson's variant h has 0.1 m/s.
VELOCITY_ERROR: Final[Range] = (0.05, 0.16)  # m/s, standard deviation per axis
VELOCITY_ERROR_S: Final[Range] = (5.0, 60.0)


def draw_scenario(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario as the run `seed` flies it."""
    if scenario.own_errors:
        scenario = replace(scenario, nav=_own_errors(scenario.nav, stream(seed, "drawn.nav")), own_errors=False)
    if scenario.spread == 1.0:
        return scenario
    factor = _Factor(scenario.spread, stream(seed, "drawn.spread"))
    nav, gps, barometer = factor.nav(scenario.nav), factor.gps(scenario.gps), factor.barometer(scenario.barometer)
    craft, leader = scenario.quadrotor, scenario.leader
    return replace(
        scenario,
        spread=1.0,
        leader=replace(
            leader,
            bank_wobble_deg=factor.process(leader.bank_wobble_deg),
            heading_wobble_deg=factor.process(leader.heading_wobble_deg),
        ),
        nav=nav,
        gps=gps,
        barometer=barometer,
        imu=replace(
            scenario.imu,
            accel_white=factor.scale(scenario.imu.accel_white),
            accel_bias=factor.scale(scenario.imu.accel_bias),
        ),
        camera=replace(scenario.camera, sigma_px=factor.scale(scenario.camera.sigma_px)),
        quadrotor=None if craft is None else factor.craft(craft),
        traffic=factor.traffic(scenario.traffic),
        broadcast=None if scenario.broadcast is None else factor.reports(scenario.broadcast),
        rangefinder=None if scenario.rangefinder is None else factor.rangefinder(scenario.rangefinder),
    )


def _own_errors(nav: Nav, rng: np.random.Generator) -> Nav:
    time = float(rng.uniform(*ATTITUDE_ERROR_S))
    return replace(
        nav,
        attitude_deg=GaussMarkov(sigma=float(rng.uniform(*TILT_ERROR_DEG)), time=time),
        yaw_deg=GaussMarkov(sigma=float(rng.uniform(*YAW_ERROR_DEG)), time=time),
        velocity=GaussMarkov(
            sigma=float(rng.uniform(*VELOCITY_ERROR)), time=float(rng.uniform(*VELOCITY_ERROR_S))
        ),
    )


class _Factor:
    """Multiplies numbers by random factors between 1 / spread and spread, log-uniform."""

    def __init__(self, spread: float, rng: np.random.Generator) -> None:
        self._spread, self._rng = spread, rng

    def scale(self, value: float) -> float:
        return value * float(self._spread ** self._rng.uniform(-1.0, 1.0))

    def scale_vector(self, values: tuple[float, float, float]) -> tuple[float, float, float]:
        by = self.scale(1.0)
        return values[0] * by, values[1] * by, values[2] * by

    def process(self, process: GaussMarkov) -> GaussMarkov:
        return GaussMarkov(sigma=self.scale(process.sigma), time=self.scale(process.time))

    def nav(self, nav: Nav) -> Nav:
        return replace(
            nav,
            attitude_deg=self.process(nav.attitude_deg),
            velocity=self.process(nav.velocity),
            position=self.process(nav.position),
            attitude_white=self.scale_vector(nav.attitude_white),
            rates_white=self.scale(nav.rates_white),
        )

    def gps(self, gps: Gps) -> Gps:
        return replace(
            gps,
            position=self.process(gps.position),
            position_white=self.scale_vector(gps.position_white),
            velocity_white=self.scale(gps.velocity_white),
            vertical_velocity_white=self.scale(gps.vertical_velocity_white),
        )

    def barometer(self, barometer: BarometerErrors) -> BarometerErrors:
        return replace(
            barometer,
            white=self.scale(barometer.white),
            drift=self.process(barometer.drift),
            stretch=self.scale(barometer.stretch),
        )

    def craft(self, craft: Quadrotor) -> Quadrotor:
        return replace(craft, motor_time=self.scale(craft.motor_time), turbulence=self.process(craft.turbulence))

    def traffic(self, scene: TrafficScene) -> TrafficScene:
        receiver = scene.receiver
        return replace(
            scene,
            aircraft=tuple(self.aircraft(a) for a in scene.aircraft),
            adsb=self.reports(scene.adsb),
            peer=self.reports(scene.peer),
            receiver=replace(
                receiver, sigma=self.scale(receiver.sigma), rate_sigma=self.scale(receiver.rate_sigma)
            ),
            radar=replace(scene.radar, glint=self.scale(scene.radar.glint)),
        )

    def aircraft(self, aircraft: Aircraft) -> Aircraft:
        return replace(aircraft, turbulence=self.process(aircraft.turbulence))

    def rangefinder(self, rangefinder: Rangefinder) -> Rangefinder:
        return replace(rangefinder, white=self.scale(rangefinder.white), bias=self.scale(rangefinder.bias))

    def reports(self, reports: R) -> R:
        by, (earliest, latest) = self.scale(1.0), reports.latency
        return replace(
            reports,
            latency=(by * earliest, by * latest),
            position=self.process(reports.position),
            position_white=self.scale(reports.position_white),
            velocity_white=self.scale(reports.velocity_white),
        )
