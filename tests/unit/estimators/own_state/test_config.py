"""The section [estimator.own_state]: bad values are refused, and reading it loads no numerics."""

import subprocess
import sys
from typing import Any

import pytest

from onboard.config import ConfigError, parse_config


@pytest.mark.parametrize(
    ("section", "text"),
    [
        ({"filter": "kalmann"}, "there is none named 'kalmann'; there are: augmented"),
        ({"airframe": "custom"}, "custom"),
        ({"airframe": "boat"}, "estimator.own_state.airframe"),
        ({"custom": {"mass_kg": -1.0}}, "estimator.own_state.custom"),
    ],
)
def test_a_bad_configuration_is_refused_in_one_line(section: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=r"^estimator\.own_state") as caught:
        parse_config({"estimator": {"own_state": section}})
    assert text in str(caught.value)


def test_reading_a_config_loads_no_numerics() -> None:
    code = "import onboard.estimators.own_state.config, sys; assert not {'numpy', 'numba'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
