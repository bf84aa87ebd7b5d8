"""Images that wait: for our own motion, with room by their target, and for their camera's gimbal."""

from msgspec.structs import replace

from onboard.config import OwnshipConfig
from onboard.messages import Attitude, GimbalAttitude, LocalPosition, MountAttitude, TargetPoints
from onboard.ownship import Ownship
from onboard.pipeline.waiting import Waiting
from tests.support.streams import MS, Flight, S, Stream, advance

NEAR = Flight(radius=None, gap=25.0)
LEAD = 140 * MS  # the camera's clock is ahead, so every image waits


def test_a_flood_of_images_that_wait_costs_the_leader_none() -> None:
    calm = [i.message for i in Stream(flight=NEAR, t1=8.0, lead_ns=LEAD).items()]
    flooded = []
    for m in calm:
        if isinstance(m, TargetPoints) and m.t_ns > 7 * S:
            flooded += [replace(m, target="target/1", t_ns=m.t_ns + k) for k in range(50)]
        flooded.append(m)
    verdicts = [
        [e.measurement.verdict for e in advance(messages).estimates if e.is_primary and e.measurement]
        for messages in (calm, flooded)
    ]
    assert len(verdicts[0]) > 40
    assert verdicts[0] == verdicts[1]


def flying(until: int) -> Ownship:
    ownship = Ownship(max_extrapolation=0.1)
    for t_ns in range(5 * S, until + 1, 20 * MS):
        item = NEAR.attitude(t_ns), NEAR.position(t_ns)
        assert all(isinstance(m, Attitude | LocalPosition) for m in item)
        for m in item:
            ownship.receive(m, t_ns)
    return ownship


def test_an_image_waits_for_its_camera_s_gimbal_but_not_for_ever() -> None:
    """The gimbal was heard 60 ms before the exposure, and then no more."""
    ownship, image = flying(6 * S), NEAR.image(6 * S)
    mount = MountAttitude(q=(1.0, 0.0, 0.0, 0.0), frame="earth")
    heard = GimbalAttitude(t_ns=6 * S - 60 * MS, t_recv_ns=0, device=154, mount=mount)
    ownship.receive(heard, heard.t_ns)
    fixed, waiting = (Waiting(OwnshipConfig(), lambda _, k=gimbal: k) for gimbal in (None, 154))
    assert not fixed.takes(image, ownship)
    assert not waiting.takes(replace(image, mount=mount), ownship)
    assert waiting.takes(image, ownship)
    assert waiting.ready(ownship) == []
    again = flying(6 * S + 360 * MS)
    again.receive(heard, heard.t_ns)
    assert waiting.ready(again) == [image]
    ownship.receive(replace(heard, t_ns=6 * S + MS), 6 * S + MS)
    assert not waiting.takes(image, ownship)
