"""A real ArduCopter in GUIDED follows another one on what `onboard run` sends, as docs/ardupilot.md says.

It takes seven minutes, and a computer that keeps up with two simulators. Set ARDUCOPTER to the binary that
`./waf copter` of ArduPilot's SITL builds (build/sitl/bin/arducopter). `tests.peers.fly` flies whole plans.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.peers.fly import Options, fly
from tests.support.arducopter import BINARY, Copter
from tests.support.courses import Kind, draw

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path(BINARY).is_file(), reason="ARDUCOPTER names no binary of ArduCopter's SITL"),
]


@pytest.mark.parametrize(
    ("kind", "side"), [(Kind.CORNER, "S"), (Kind.SLOW_S, "E"), (Kind.HEAD_ON, "N"), (Kind.KILLED, "W")]
)
def test_a_real_arducopter_follows(tmp_path: Path, kind: Kind, side: str) -> None:
    verdict = fly(draw(kind, side, np.random.default_rng(1)), tmp_path / "flight", Options(Copter, tmp_path))
    if verdict.misses and verdict.is_void:
        pytest.skip(f"{verdict}: the computer did not keep up")
    assert not verdict.misses, verdict
