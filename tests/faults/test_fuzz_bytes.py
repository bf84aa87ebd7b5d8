"""A few thousand mutated inputs of each kind. `make fuzz` runs as many as you like, guided by coverage."""

import pytest

from onboard.wire.mavlink import decode as mavlink_decode
from tests import fuzz_bytes

COUNTS = {"mavlink": 1500, "documents": 2000, "logs": 600, "configuration": 100}


@pytest.mark.parametrize("name", fuzz_bytes.TARGETS)
def test_mutated_bytes_raise_nothing_with_seed_17(name: str) -> None:
    fuzz_bytes.run(name, 17, COUNTS[name])


def test_the_fuzz_would_find_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavlink_decode.MavlinkDecoder, "_record", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        fuzz_bytes.run("mavlink", 17, COUNTS["mavlink"])
