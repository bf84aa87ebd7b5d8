"""Images that wait: for our own motion, with room by their target, and for their camera's gimbal."""

import pytest
from msgspec.structs import replace

from onboard.config import OwnshipConfig
from onboard.messages import (
    Attitude,
    Exposure,
    GimbalAttitude,
    LocalPosition,
    Message,
    MountAttitude,
    TargetPoints,
    Verdict,
)
from onboard.ownship import Ownship
from onboard.pipeline.waiting import Waiting
from tests.support.streams import MS, Flight, S, Stream, advance

NEAR = Flight(radius=None, gap=25.0)
LEAD = 140 * MS  # the camera's clock is ahead, so every image waits


def test_a_flood_of_images_that_wait_costs_the_leader_none() -> None:
    calm = [i.message for i in Stream(flight=NEAR, t1=7.5, lead_ns=LEAD).items()]
    flooded = []
    for m in calm:
        if isinstance(m, TargetPoints) and m.t_ns > 7.2 * S:
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
    exposure = Exposure.of(image)
    mount = MountAttitude(q=(1.0, 0.0, 0.0, 0.0), frame="earth")
    heard = GimbalAttitude(t_ns=6 * S - 60 * MS, t_recv_ns=0, device=154, mount=mount)
    ownship.receive(heard, heard.t_ns)
    fixed, waiting = (Waiting(OwnshipConfig(), {"front": gimbal}) for gimbal in (None, 154))
    assert not fixed.takes(exposure, ownship)
    assert not waiting.takes(Exposure.of(replace(image, mount=mount)), ownship)
    assert waiting.takes(exposure, ownship)
    assert waiting.ready(ownship) == []
    again = flying(6 * S + 360 * MS)
    again.receive(heard, heard.t_ns)
    assert waiting.ready(again) == [exposure]
    ownship.receive(replace(heard, t_ns=6 * S + MS), 6 * S + MS)
    assert not waiting.takes(exposure, ownship)


USED = {Verdict.INITIALISING, Verdict.FUSED, Verdict.FUSED_LATE}
OUTLIER = 0.05  # rad


def thinned(attitude: int, position: int, gap: tuple[float, float] = (0.0, 0.0), t1: float = 9.0) -> list[Message]:
    """A flight with own motion at these periods in ms, positions in between attitudes and none within a `gap` in
    s. Images arrive 20 ms after their stamps, which are 50 ms ahead."""
    messages = []
    for item in Stream(flight=NEAR, t1=t1, latency=20 * MS, lead_ns=50 * MS).items():
        m, ms = item.message, item.message.t_ns // MS
        if isinstance(m, Attitude) and ms % attitude:
            continue
        if isinstance(m, LocalPosition) and (
            (ms - position // 40 * 20) % position or gap[0] < m.t_ns / S < gap[1]
        ):
            continue
        messages.append(m)
    return messages


@pytest.mark.parametrize(
    ("attitude", "position", "gap"),
    [
        (100, 100, (0.0, 0.0)),
        (260, 260, (0.0, 0.0)),
        (260, 20, (0.0, 0.0)),
        (20, 260, (0.0, 0.0)),
        (20, 20, (7.0, 7.95)),
    ],
    ids=["10 Hz", "4 Hz", "slow attitudes", "slow positions", "a gap of 0.95 s"],
)
def test_no_image_is_refused_for_own_motion_that_comes_within_a_second_seed_1(
    attitude: int, position: int, gap: tuple[float, float]
) -> None:
    run = advance(thinned(attitude, position, gap))
    reports = [r for r in run.reports if 6 * S < r.t_ns < 8.7 * S]  # once both streams have begun
    assert len(reports) == 68
    assert {r.verdict for r in reports} <= USED


def test_an_image_waits_no_longer_than_for_the_attitude_that_was_missing() -> None:
    """The position of its time is there; attitudes come each 260 ms, and 0.3 s late."""
    messages = thinned(260, 20)
    waited = [m for m in messages if isinstance(m, TargetPoints) and 7 * S < m.t_ns < 8 * S]
    attitudes = [m for m in messages if isinstance(m, Attitude)]
    late = sorted(
        messages,
        key=lambda m: m.t_recv_ns + 300 * MS * isinstance(m, Attitude) + (m.t_ns > 8 * S) * 10 * S,
    )
    last = max(late.index(m) for m in attitudes if m.t_ns < 8 * S)
    fused = [r.t_ns for r in advance(late[: last + 1]).reports if r.verdict in USED]
    newest = max(m.t_ns for m in attitudes if m.t_ns < 8 * S)
    assert max(fused) == max(m.t_ns for m in waited if m.t_ns <= newest)


def test_an_outlier_among_images_that_waited_begins_no_track_seed_1() -> None:
    """When positions come again, the images before it are half a second old, and so is the track."""
    messages = [
        replace(m, target="") if isinstance(m, TargetPoints) else m for m in thinned(20, 20, (7.0, 7.5), 8.0)
    ]
    k, image = next((k, m) for k, m in enumerate(messages) if isinstance(m, TargetPoints) and m.t_ns > 7.2 * S)
    center, left, right = ((u + OUTLIER, v) for u, v in (image.center, image.left, image.right))
    messages[k] = replace(image, center=center, left=left, right=right)
    assert {e.target for e in advance(messages).estimates} == {"leader"}
