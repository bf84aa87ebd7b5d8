"""`[estimator.leader]` finds every mistake by itself, and imports no numerics for that."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from onboard.config import ConfigError, load_config
from onboard.estimators.leader.config import Config

ROOT = Path(__file__).parents[4]


def test_the_configuration_is_read_without_numerics() -> None:
    code = "import onboard.estimators.leader.config, sys; print({'numpy', 'numba'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("timeout_s", [0.1, 11.0])
def test_timeouts_out_of_order_are_refused(timeout_s: float) -> None:
    with pytest.raises(ValueError, match="coast_after_s <= validity_timeout_s <= reset_timeout_s must hold"):
        Config(validity_timeout_s=timeout_s)


@pytest.mark.parametrize("degrees", [1.0, 2.0, 5.0, 10.0, 20.0])
def test_angles_are_numpys_to_the_last_bit(degrees: float) -> None:
    """The settings were NumPy's once; recorded flights depend on them."""
    assert math.radians(degrees) == np.radians(degrees)


@pytest.mark.parametrize(
    ("section", "reason"),
    [
        ('{system = 3, icao = "4b1a00"}', "system and icao: one of them is the leader's, not both"),
        ('{icao = "4b1a0"}', "icao: must be six hexadecimal digits, not '4b1a0'"),
        ("{latency_s = 0.3}", "system or icao must say whose broadcasts are the leader's"),
        ("{system = 256}", "estimator.leader.broadcast.system is 256: expected `int` <= 255"),
        ("{system = 3, latency_s = 2.0}", "estimator.leader.broadcast.latency_s is 2.0: expected `float` <= 1.0"),
        ("{sytem = 3}", "unknown key estimator.leader.broadcast.sytem (did you mean system?); known: system, "),
    ],
)
def test_a_broadcast_that_cannot_be_is_refused(section: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(reason)):
        load_config(None, (f"estimator.leader.broadcast={section}",))


def test_ranges_from_nowhere_are_refused() -> None:
    with pytest.raises(ConfigError, match="sensor or detections must say where the ranges come from"):
        load_config(None, ("estimator.leader.range.sigma_m=0.5",))
    with pytest.raises(ConfigError, match=r"unknown key estimator.leader.range.senor \(did you mean sensor\?\)"):
        load_config(None, ("estimator.leader.range.senor=3",))


def test_a_broadcast_of_what_we_send_or_are_is_refused() -> None:
    ours = ('leader_out=[{link = "autopilot", system = 3}]', "estimator.leader.broadcast.system=3")
    with pytest.raises(ConfigError, match=r"broadcast.system is 3, but \[\[leader_out\]\] sends as this"):
        load_config(None, ours)
    with pytest.raises(ConfigError, match=r"broadcast.system is 3, that of our own vehicle"):
        load_config(None, ("autopilot.system=3", "estimator.leader.broadcast.system=3"))
