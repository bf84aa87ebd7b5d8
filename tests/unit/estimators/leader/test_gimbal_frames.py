"""A gimbal's angles against another frame than its flags name: noticed by the images, and named."""

import math
from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from onboard.config import Config, parse_config
from onboard.messages import Attitude, MountAttitude
from onboard.ownship.gimbals import reversed_about
from tests.support.moving_mount import FLAT, GIMBAL, LENS, Mount, flown
from tests.support.streams import SIZE, Flight, Kinematics, Run, S

SECONDS = 12.0
PITCH, W = 0.1, 2.0 * math.pi / 5.0  # rad and rad/s: how the follower pitches


class Pitching(Flight):
    """The follower pitches, as a multirotor in gusts; the leader does not."""

    def at(self, t: float, ahead: float = 0.0) -> Kinematics:
        k = super().at(t, ahead)
        return k if ahead else k._replace(rpy=(k.rpy[0], PITCH * math.sin(W * t), k.rpy[2]))

    def attitude(self, t_ns: int) -> Attitude:
        m, roll, rate = super().attitude(t_ns), self.at(t_ns / S).rpy[0], PITCH * W * math.cos(W * t_ns / S)
        p, q, r = m.omega_b
        return replace(m, omega_b=(p, q + rate * math.cos(roll), r - rate * math.sin(roll)))


class OfServos(Mount):
    """Angles against the body, under flags that name our heading."""

    def attitude(self, t: float, flight: Flight) -> MountAttitude:
        against_body = Mount(*self)._replace(frame="body").attitude(t, flight)
        return replace(against_body, frame=self.frame)


class OtherSign(Mount):
    """A yaw, or a pitch, that counts the other way."""

    def attitude(self, t: float, flight: Flight) -> MountAttitude:
        right = super().attitude(t, flight)
        return replace(right, q=reversed_about(["pitch" if self.yaw < 5.0 else "yaw"], right.q))


def config(frame: str = "as flagged", signs: Sequence[str] = ()) -> Config:
    camera = LENS | {"gimbal": GIMBAL, "gimbal_frame": frame, "gimbal_reversed": list(signs)}
    return parse_config({"camera": camera, "estimator": {"leader": {"size_prior_m": SIZE}}})


def run(mount: Mount, frame: str = "as flagged", signs: Sequence[str] = ()) -> Run:
    pitching = Pitching(radius=300.0)
    return flown(
        config(frame, signs), mount, seed=3, seconds=SECONDS, flight=pitching, distortion=FLAT, sparse=True
    )


def contradicted(found: Run) -> int:
    return found.pipeline.health(0).verdicts.get("leader.gimbal_contradicted", 0)


@pytest.mark.parametrize("flagged", ["heading", "earth"])
def test_angles_against_the_body_under_other_flags_are_named_and_not_valid(flagged: str) -> None:
    found = run(OfServos(frame=flagged))
    assert contradicted(found) == 1
    last = found.estimates[-1]
    assert not last.valid
    assert 'the images fit angles against our body: set `gimbal_frame = "body"`' in last.reason


@pytest.mark.parametrize(
    ("mount", "frame", "axis"),
    [
        (OtherSign(), "as flagged", "yaw"),
        (OtherSign(yaw=4.0), "as flagged", "pitch"),
    ],
)
def test_an_angle_with_the_other_sign_is_named_and_not_valid(mount: Mount, frame: str, axis: str) -> None:
    found = run(mount, frame)
    last = found.estimates[-1]
    assert not last.valid
    assert f'set `gimbal_reversed = ["{axis}"]`' in last.reason


def test_an_angle_that_is_configured_to_have_the_other_sign_is_believed() -> None:
    found = run(OtherSign(), signs=["yaw"])
    assert contradicted(found) == 0
    assert found.estimates[-1].valid
