"""When an object that took the target's place is in question, and when no more."""

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.image.prepare import Image
from onboard.estimators.leader.tracks.doubts import Checks

FORGOTTEN_S = 5.0


class BriefConfig(Config, frozen=True, kw_only=True):
    """A track that is forgotten sooner."""

    reset_timeout_s: ClassVar[float] = FORGOTTEN_S


CONFIG = BriefConfig()


def image(t: float, degrees: float = 0.0, span: float = 0.1) -> Image:
    """At t seconds, in this direction, with a wing of this apparent size."""
    angle = np.radians(degrees)
    shown = {"has_wing": True, "rows": SimpleNamespace(is_wing=True), "span": span, "span_sigma": 1e-3 * span}
    measurement: Any = SimpleNamespace(axes=np.array([[np.cos(angle), np.sin(angle), 0.0]]), **shown)
    message: Any = SimpleNamespace(t_ns=round(t * 1e9))
    pose: Any = SimpleNamespace(R_cn=np.eye(3), r_FC_n=np.zeros(3))
    unused: Any = None
    return Image(message, True, measurement, pose, True, unused, 1.0, 1.0)


def ended_after(fused: Image | None, gated: Image) -> Checks:
    exchange = Checks(CONFIG)
    if fused is not None:
        exchange.fused(fused)
    exchange.ended(gated)
    return exchange


def asked_at(exchange: Checks, t: float) -> bool:
    return round(t * 1e9) < exchange.leapt_until_ns


def test_what_leapt_is_in_question_until_the_old_one_would_be_forgotten() -> None:
    for leapt in (image(1.05, degrees=9.0), image(1.05, span=0.15)):
        exchange = ended_after(image(1.0), leapt)
        assert asked_at(exchange, 1.0 + FORGOTTEN_S - 1e-6)
        assert not asked_at(exchange, 1.0 + FORGOTTEN_S)


def test_what_moves_on_is_not_in_question() -> None:
    """As far as an aircraft comes in 0.05 s, or after a gap."""
    for moved in (image(1.05, degrees=4.0), image(1.05, span=0.12), image(1.4, degrees=60.0)):
        assert not asked_at(ended_after(image(1.0), moved), 1.5)


def test_a_third_object_prolongs_the_question() -> None:
    exchange = ended_after(image(1.0), image(1.05, span=0.2))
    exchange.fused(image(2.0, span=0.2))
    exchange.ended(image(2.05, span=0.4))
    assert asked_at(exchange, 2.0 + FORGOTTEN_S - 1e-6)
