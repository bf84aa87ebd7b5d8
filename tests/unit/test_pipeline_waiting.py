"""Images that wait for our own motion have room by their target: others never cost the leader's their place."""

from msgspec.structs import replace

from onboard.messages import TargetPoints
from tests.support.streams import MS, Flight, S, Stream, advance

NEAR = Flight(radius=None, gap=25.0)
LEAD = 300 * MS  # the camera's clock is ahead, so every image waits


def test_a_flood_of_images_that_wait_costs_the_leader_none() -> None:
    calm = [i.message for i in Stream(flight=NEAR, t1=12.0, lead_ns=LEAD).items()]
    flooded = []
    for m in calm:
        if isinstance(m, TargetPoints) and m.t_ns > 8 * S:
            flooded += [replace(m, target="target/1", t_ns=m.t_ns + k) for k in range(100)]
        flooded.append(m)
    verdicts = [
        [e.measurement.verdict for e in advance(messages).estimates if e.is_primary and e.measurement]
        for messages in (calm, flooded)
    ]
    assert verdicts[0] == verdicts[1]
