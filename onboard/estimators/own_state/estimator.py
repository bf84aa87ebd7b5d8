"""Our own state from the autopilot's messages, by any of the filters.

It has position, velocity, attitude and rates. The specific force drives the model of `models.own_motion`. Attitude
with body rates, GPS fixes and a barometer correct it, each at its own rate and at its own time, however late it
arrives. Unexplained innovations are counted, and their cause is identified if possible (`faults`, `innovations`).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.life_cycle import life_by_age
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.faults import FaultMonitor
from onboard.estimators.own_state.filters import SensorFilter
from onboard.estimators.own_state.innovations import Innovation, OutlierMonitor
from onboard.estimators.own_state.inputs import Inputs
from onboard.estimators.own_state.measurements import ATTITUDE_SENSOR, BAROMETER, GPS, Measurement, reason_unusable
from onboard.estimators.own_state.noise import SensorNoise
from onboard.estimators.own_state.report import nav_state, own_motion, report
from onboard.estimators.own_state.sources import Sources, next_due_ns
from onboard.estimators.own_state.track import Track
from onboard.filters.belief import FilterError
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import (
    NOT_LIFTED,
    ActuatorOutputs,
    Attitude,
    Barometer,
    Battery,
    Estimate,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    Lifecycle,
    Message,
    Verdict,
)
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship, StatedMotion
from onboard.units import NS_PER_S

__all__ = ["LISTENS", "Config", "Estimator"]

LISTENS: Final = (
    Heartbeat,
    Attitude,
    Imu,
    Barometer,
    GpsFix,
    GlobalOrigin,
    GlobalPosition,
    ActuatorOutputs,
    Battery,
)


MOTORS: Final = "motors"
CONTRADICTS: Final = (
    "fixes and accelerometer say different velocities, and {:.2f} m/s of it lasts from fix to fix: they are later "
    "than [delay] gps_s says, or it does not fly as this estimator supposes"
)


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`."""

    def __init__(self, config: Config, _camera: Camera) -> None:
        self._config = config
        self._filter = SensorFilter(config.filter)
        self._resets = self._sequence = 0
        self._track: Track | None = None
        self._why = Reason(Cause.NO_MEASUREMENT, "no GPS fix yet")  # why there is no track
        self._unsuitable: Reason | None = None  # why the model does not fit the vehicle
        self._reset_inputs()

    def _reset_inputs(self) -> None:
        """Reset everything that depends on the autopilot's time base and origin."""
        noise = SensorNoise(self._config)
        self._sources, self._inputs = Sources(self._config, noise), Inputs(noise)
        self._vehicle = FaultMonitor(self._config.known_airframe())
        self._outliers = OutlierMonitor()
        self._velocity_b: Array | None = None  # as last published
        self._next_due_ns = 0  # time of the next published attitude
        self._is_silent = self._is_armed = False

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse one message.

        Returns an estimate for each attitude due for publication, and for each fix.
        """
        match message:
            case Heartbeat():
                self._check_vehicle_type(message.vehicle_type)
                self._is_armed = message.armed
            case Imu():
                self._receive_imu(message)
                if message.pressure_altitude is not None:
                    return self._receive_pressure(message, message.pressure_altitude)
            case Barometer():
                return self._receive_pressure(message, message.pressure_altitude)
            case ActuatorOutputs():
                if self._vehicle.receive_outputs(message, armed=self._is_armed):
                    return self._report(message, MOTORS, Verdict.UNASSOCIATED)
            case Battery():
                self._vehicle.receive_voltage(message.voltage_v)
            case GlobalOrigin():
                if self._sources.move_origin(message):
                    self._drop_track(Reason(Cause.ORIGIN_MOVED, "the autopilot has moved its origin"))
            case GlobalPosition():
                self._sources.learn_origin(message, ownship)
            case Attitude():
                return self._receive_attitude(message, ownship.attitude_noise)
            case GpsFix():
                return self._receive_fix(message, ownship)
        return []

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Return one estimate when the attitude has stopped arriving.

        Otherwise our own messages drive this estimator.
        """
        newest_ns = self._sources.newest_ns
        is_silent = newest_ns != 0 and ownship.now_ns - newest_ns > self._config.silence_s * NS_PER_S
        if is_silent and not self._is_silent:
            self._is_silent = True
            return self._report(None)
        return []

    def own_motion_at(self, t_ns: int) -> StatedMotion | None:
        """See `onboard.estimators.StatesOwnMotion`."""
        if self._track is None or not self._life(t_ns)[0].is_valid:
            return None
        try:
            posterior = self._track.posterior_before(t_ns)
        except FilterError as error:
            self._drop_track(Reason(Cause.FILTER_FAILED, f"numerical: {error}"))
            return None
        return None if posterior is None else own_motion(posterior)

    def reset(self, why: Reason) -> None:
        """Forget everything: the time base or the origin has changed."""
        self._drop_track(why)
        self._reset_inputs()

    # ---------------------------------------------------------------------------------------- messages

    def _receive_imu(self, message: Imu) -> None:
        f_b, omega = np.array(message.f_b), np.array(message.omega_b)
        if not (np.isfinite(f_b).all() and np.isfinite(omega).all()):
            return
        if self._config.force == "thrust":
            f_b = np.array([0.0, 0.0, f_b[2]])
        if self._inputs.force.add(message.t_ns, f_b):
            acceleration = self._vehicle.receive_imu(message, self._velocity_b)
            if acceleration is not None:
                self._inputs.angular_acceleration.add(message.t_ns, acceleration)

    def _receive_pressure(self, message: Imu | Barometer, altitude: float) -> list[Estimate]:
        measurement = self._sources.pressure(message, altitude)
        if isinstance(measurement, Verdict):
            return self._report(message, BAROMETER, measurement)
        if measurement is not None:
            self._fuse(measurement)
        return []

    def _receive_attitude(self, message: Attitude, white: Sequence[float] | None) -> list[Estimate]:
        newest_ns = self._sources.newest_ns
        measurement = self._sources.attitude(message, white)
        if isinstance(measurement, Verdict):
            return self._report(message, ATTITUDE_SENSOR, measurement)
        if measurement is None:
            return []
        by_motors = self._inputs.angular_acceleration.mean(newest_ns, measurement.t_ns)
        self._inputs.noise.add_rates(measurement.t_ns, measurement.y[3:], by_motors)
        self._inputs.manoeuvres.add_attitude(measurement.t_ns, measurement.R_nb)
        self._is_silent = False
        found = self._fuse(measurement)
        if message.t_ns < self._next_due_ns:
            return []
        self._next_due_ns = next_due_ns(message.t_ns, self._config.publish_rate_hz)
        return self._report(message, ATTITUDE_SENSOR, found)

    def _receive_fix(self, message: GpsFix, ownship: Ownship) -> list[Estimate]:
        measurement = self._sources.fix(message, ownship)
        if isinstance(measurement, Verdict):
            if self._track is None:
                self._why = Reason(Cause.FIX_UNUSABLE, f"GPS fixes cannot be used: {reason_unusable(message)}")
            return self._report(message, GPS, measurement)
        if measurement is None:
            return []
        self._inputs.noise.add_fix(measurement.t_ns, measurement.y[3:])
        self._inputs.manoeuvres.add_fix(measurement.t_ns, measurement.y[3:], np.sqrt(np.diag(measurement.R)[3:]))
        self._drop_old_track(measurement.t_ns)
        if self._track is None:
            self._start(measurement)
            return self._report(message, GPS, Verdict.INITIALISING)
        if message.t_ns > self._sources.newest_ns + self._config.rewind_horizon_s * NS_PER_S:
            return self._report(message, GPS, Verdict.TOO_NEW)
        if not self._track.reaches(message.t_ns):
            return self._report(message, GPS, Verdict.TOO_OLD)
        return self._report(message, GPS, self._fuse(measurement))

    # ------------------------------------------------------------------------------ life of the track

    def _start(self, fix: Measurement) -> None:
        """Start a track at a fix with the nearest attitude, and fuse the attitudes since then."""
        if self._unsuitable is not None:
            self._why = self._unsuitable
            return
        near = self._sources.attitude_near(fix.t_ns)
        if near is None:
            self._why = Reason(Cause.NO_ATTITUDE, "no attitude at the time of the fix")
            return
        self._track = Track(self._config, self._filter, self._inputs, fix, near)
        for attitude in self._sources.attitudes:
            if attitude.t_ns > fix.t_ns:
                self._fuse(attitude)

    def _fuse(self, measurement: Measurement) -> Innovation | Verdict:
        """Insert a measurement at its own time and evaluate its innovation.

        Returns a verdict without a track, or if the measurement is older than the track's history.
        """
        self._drop_old_track(measurement.t_ns)
        if self._track is None or not self._track.reaches(measurement.t_ns):
            return Verdict.INITIALISING
        try:
            innovation = self._track.insert(measurement)
        except FilterError as error:
            self._drop_track(Reason(Cause.FILTER_FAILED, f"numerical: {error}"))
            return Verdict.INITIALISING
        self._outliers.add(innovation, [fault.t_onset_ns for fault in self._vehicle.faults()])
        return innovation

    def _drop_track(self, why: Reason) -> None:
        if self._track is not None:
            self._resets += 1
        self._track = None
        self._why = why

    def _check_vehicle_type(self, vehicle_type: int) -> None:
        """Check the MAV_TYPE of the vehicle, whose model must fit.

        The model is that of a vehicle that flies on its own lift.
        """
        kind, self._unsuitable = NOT_LIFTED.get(vehicle_type), None
        if kind is not None:
            self._unsuitable = Reason(
                Cause.OTHER_VEHICLE, f"the autopilot drives a {kind}, and this supposes what flies"
            )
            self._drop_track(self._unsuitable)

    def _drop_old_track(self, t_ns: int) -> None:
        """End the track before it is predicted too far beyond its last fix.

        The prediction is cut into short steps, and an hour has many.
        """
        if self._track is not None and self._track.age(t_ns) > self._config.reset_timeout_s:
            self._drop_track(Reason(Cause.FORGOTTEN, "no fix for longer than the reset timeout"))

    def _life(self, t_ns: int) -> tuple[Lifecycle, Reason]:
        """Return the state of the life cycle at a time, and its reason."""
        if self._track is None:
            has_fix = self._sources.first_fix_ns is not None
            return Lifecycle.INITIALISING if has_fix else Lifecycle.SEARCHING, self._why
        if self._is_silent:
            return Lifecycle.LOST, Reason(Cause.NO_ATTITUDE, "no attitude from the autopilot")
        if (size := self._track.contradiction.size) is not None:
            return Lifecycle.LOST, Reason(Cause.FIXES_CONTRADICT, CONTRADICTS.format(size))
        return life_by_age(self._track.age(t_ns), self._config, one="fix", many="fixes")

    def _report(
        self, message: Message | None, sensor: str = "", found: Innovation | Verdict = Verdict.INITIALISING
    ) -> list[Estimate]:
        """Return the estimate with the report of a message, if there is one."""
        newest_ns = self._sources.newest_ns
        self._drop_old_track(newest_ns)
        self._sequence += 1
        estimate = nav_state(
            self._track,
            None if message is None else report(message, sensor, found),
            config=self._config,
            sequence=self._sequence,
            t_ns=newest_ns,
            life=self._life(newest_ns),
            resets=self._resets,
            origin=self._sources.origin,
            faults=self._vehicle.faults() + self._outliers.faults(),
        )
        if estimate.mean is not None and estimate.q_nb is not None:
            self._velocity_b = matrix_from_quaternion(estimate.q_nb).T @ np.array(estimate.mean[3:6])
        return [estimate]
