"""A delay makes a message older than its stamp, whichever source it comes from: through the pipeline."""

from typing import Any

import pytest

from onboard.config import parse_config
from onboard.messages import (
    Attitude,
    Barometer,
    Clock,
    Estimate,
    Exposure,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LocalPosition,
    Message,
    Reason,
    TargetPoints,
)
from onboard.ownship import Ownship
from onboard.pipeline import Pipeline
from tests.support import own_vehicle as own

MS = 1_000_000
ARDUPILOT, PX4 = 3, 12
ZERO = (0.0, 0.0, 0.0)
AT = {"t_ns": 5000 * MS, "t_recv_ns": 5001 * MS}
PLACE: dict[str, Any] = {"lat_deg": 47.0, "lon_deg": 8.0, "alt_msl": 500.0, "height": 3.0, "heading_rad": None}
FIX: dict[str, Any] = {"fix_type": 3, "satellites": 9, "lat_deg": 47.0, "lon_deg": 8.0, "alt_msl": 500.0}
SPEED: dict[str, Any] = {"ground_speed": 1.0, "course_rad": 0.0, "h_acc": 1.0, "v_acc": 1.0}
POINTS: dict[str, Any] = {"camera": "c", "center": (0.0, 0.0), "left": (-0.1, 0.0), "right": (0.1, 0.0)}
SOURCES: dict[str, Message] = {
    "local_position_s": LocalPosition(**AT, r_OF_n=ZERO, v_F_n=ZERO),
    "gps_s": GpsFix(**AT, **FIX, **SPEED),
    "camera_s": Exposure.of(TargetPoints(**AT, **POINTS)),
}


class Listener:
    """An estimator that keeps what it is shown."""

    def __init__(self) -> None:
        self.heard: list[Message] = []

    def observe(self, message: Message, _ownship: Ownship) -> list[Estimate]:
        self.heard.append(message)
        return []

    def tick(self, _ownship: Ownship) -> list[Estimate]:
        return []

    def reset(self, why: Reason) -> None:  # noqa: ARG002 - as it is called
        return None


def shown(message: Message, delay: dict[str, float], autopilot: int = PX4) -> tuple[Message, Pipeline]:
    """What an estimator is shown of a message, when the pipeline knows these delays."""
    pipeline, listener = Pipeline(parse_config({"delay": delay})), Listener()
    pipeline.estimators = {"listener": listener}
    for kind in (*map(type, SOURCES.values()), Attitude, Barometer, GlobalPosition, Imu):
        pipeline._listeners[kind] = ["listener"]
    beat = Heartbeat(
        t_ns=0, t_recv_ns=0, clock=Clock.NONE, vehicle_type=2, autopilot=autopilot, armed=True, status=4
    )
    pipeline.advance([beat, own.attitude(4990)])
    listener.heard.clear()
    pipeline.advance([message])
    (heard,) = listener.heard
    return heard, pipeline


@pytest.mark.parametrize("source", SOURCES)
def test_what_is_shown_is_older_than_its_stamp_by_the_delay_of_its_source(source: str) -> None:
    heard, _ = shown(SOURCES[source], {source: 0.25})
    assert heard.t_ns == (5000 - 250) * MS
    others = {name: 0.05 for name in SOURCES if name != source}
    heard, _ = shown(SOURCES[source], others)
    assert heard.t_ns == 5000 * MS


@pytest.mark.parametrize(
    ("message", "delay"),
    [
        (Attitude(**AT, q_nb=(1.0, 0.0, 0.0, 0.0), omega_b=ZERO), 0),
        (Imu(**AT, f_b=(0.0, 0.0, -own.GRAVITY), omega_b=ZERO), 0),
        (Barometer(**AT, pressure_altitude=500.0), 0),
        (GlobalPosition(**AT, **PLACE, v_F_n=ZERO), 250),
    ],
    ids=["attitude", "imu", "barometer", "global position"],
)
def test_only_the_other_position_is_as_late_as_the_local_one(message: Message, delay: int) -> None:
    heard, _ = shown(message, dict.fromkeys(SOURCES, 0.25))
    assert heard.t_ns == (5000 - delay) * MS


def test_the_present_is_the_stamp_and_not_what_was_true_a_delay_before() -> None:
    _, pipeline = shown(SOURCES["local_position_s"], {"local_position_s": 0.25})
    assert pipeline.ownship.now_ns == 5000 * MS


@pytest.mark.parametrize(("source", "known_ms"), [("local_position_s", 22.5), ("gps_s", 95.0)])
def test_what_is_known_of_ardupilot_holds_for_it_alone_and_until_it_is_configured(
    source: str, known_ms: float
) -> None:
    assert shown(SOURCES[source], {}, ARDUPILOT)[0].t_ns == round((5000 - known_ms) * MS)
    assert shown(SOURCES[source], {}, PX4)[0].t_ns == 5000 * MS
    assert shown(SOURCES[source], {source: 0.0}, ARDUPILOT)[0].t_ns == 5000 * MS
