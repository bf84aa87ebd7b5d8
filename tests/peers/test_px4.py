"""A real PX4 in OFFBOARD follows another one on what `onboard run` sends, as docs/px4.md says.

It takes seven minutes, and a computer that keeps up with two simulators. Set PX4 to the binary that
`make px4_sitl` of PX4 1.17 builds (build/px4_sitl_default/bin/px4). `tests.peers.fly` flies whole plans.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.peers.fly import Options, fly
from tests.support.courses import Kind, draw
from tests.support.px4 import BINARY, Px4

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path(BINARY).is_file(), reason="PX4 names no binary of PX4's simulation in hardware"),
]


@pytest.mark.parametrize(
    ("kind", "side"), [(Kind.CORNER, "S"), (Kind.SLOW_S, "E"), (Kind.HEAD_ON, "N"), (Kind.KILLED, "W")]
)
def test_a_real_px4_follows(tmp_path: Path, kind: Kind, side: str) -> None:
    verdict = fly(draw(kind, side, np.random.default_rng(1)), tmp_path / "flight", Options(Px4, tmp_path))
    if verdict.misses and verdict.is_void:
        pytest.skip(f"{verdict}: the computer did not keep up")
    assert not verdict.misses, verdict
