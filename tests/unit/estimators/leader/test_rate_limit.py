"""How many estimates are published: as many as there are images, or as `publish_rate_hz` says without them."""

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader import estimator as leader
from onboard.estimators.leader.tracks.report import RateLimit
from onboard.geometry.camera import make_camera
from onboard.messages import Cause, Estimate, Exposure, Message, Reason, TargetPoints
from onboard.ownship import Ownship
from tests.support.streams import CIRCLE, EPOCH, LATENCY, MS, Item, S, Stream, encode, feed, make_config

RATE = 30.0


def at_30_hz(images: Callable[[float], bool] = lambda _t: True, t1: float = 10.0) -> list[Item]:
    """Own motion at 50 Hz, and images at 30 Hz."""
    rng = np.random.default_rng(1)
    times = [t_ns for t_ns in (round(k * S / RATE) for k in range(150, round(t1 * RATE))) if images(t_ns / S)]
    taken = [Item(EPOCH + t_ns + LATENCY, CIRCLE.image(t_ns, rng)) for t_ns in times]
    return sorted([*Stream(t1=t1, images=lambda _: False).items(), *taken], key=lambda i: i.t_recv_ns)


def published(items: list[Item], begin: float, end: float, *overrides: str) -> list[Estimate]:
    """What is published of the leader between two times, s."""
    estimates = feed(encode(items), make_config(*overrides)).estimates
    return [e for e in estimates if begin * S <= e.t_ns < end * S]


def gaps(estimates: list[Estimate]) -> list[float]:
    """Seconds from each estimate to the next."""
    return [float(dt) / S for dt in np.diff([e.t_ns for e in estimates])]


def test_images_at_the_rate_leave_nothing_to_publish_between_them() -> None:
    found = published(at_30_hz(), 6.0, 9.0)
    assert sum(e.measurement is not None for e in found) == pytest.approx(90, abs=1)
    assert sum(e.measurement is None for e in found) <= 1


def test_predictions_go_on_at_the_rate_once_images_stop() -> None:
    flown = published(at_30_hz(lambda t: t < 7.0), 6.0, 9.2)
    last_image = max(i for i, e in enumerate(flown) if e.measurement is not None)
    assert gaps(flown)[last_image] < 2.0 / RATE + 0.02
    later = [e for e in flown if e.t_ns >= 7.2 * S]
    assert len(later) == pytest.approx(2.0 * RATE, abs=1)
    assert max(gaps(later)) < 0.041


def flown() -> tuple[leader.Estimator, Ownship, list[Message]]:
    """An estimator that has followed a leader for two seconds, its own motion, and the messages that come next."""
    one = leader.Estimator(
        make_config().estimator["leader"], make_camera(f_px=554.256, width_px=640, height_px=480)
    )
    ownship, messages = Ownship(max_extrapolation=0.1), [item.message for item in at_30_hz(t1=7.5)]
    begun = [m for m in messages if m.t_ns < 7 * S]
    for m in begun:
        if isinstance(m, TargetPoints):
            one.observe(Exposure.of(m), ownship)
        elif ownship.receive(m, m.t_ns):
            one.tick(ownship)
    return one, ownship, [m for m in messages if m.t_ns >= 7 * S and not isinstance(m, TargetPoints)]


def receive_sample(messages: list[Message], ownship: Ownship) -> None:
    """Our own motion up to the next navigation sample."""
    while not ownship.receive(message := messages.pop(0), message.t_ns):
        pass


def test_a_reset_is_published_at_the_next_sample() -> None:
    one, ownship, messages = flown()
    (image,) = one.observe(Exposure.of(CIRCLE.image(ownship.now_ns)), ownship)
    assert image.valid
    assert one.tick(ownship) == []
    one.reset(Reason(Cause.OWN_MOTION_DOUBT, "our own motion was in doubt"))
    receive_sample(messages, ownship)
    (estimate,) = one.tick(ownship)
    assert estimate.reason == "our own motion was in doubt"


def test_a_target_that_was_reset_has_its_last_word_at_once() -> None:
    one, ownship, messages = flown()
    for k in range(3):
        t_ns = ownship.now_ns - (2 - k) * 30 * MS
        one.observe(Exposure.of(replace(CIRCLE.image(t_ns), target="target/1")), ownship)
    assert one._tracks["target/1"].is_followed
    one.reset(Reason(Cause.OWN_MOTION_DOUBT, "our own motion was in doubt"))
    receive_sample(messages, ownship)
    assert [e.target for e in one.tick(ownship)] == ["leader", "target/1"]


@pytest.mark.parametrize("back_ms", [100, 10_000])
def test_a_time_in_the_future_does_not_block(back_ms: int) -> None:
    limit = RateLimit(RATE)
    limit.published(20 * S)
    assert not limit.is_due(20 * S)
    assert limit.is_due(20 * S - back_ms * MS)
