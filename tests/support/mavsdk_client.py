"""Start of MAVSDK in a separate process, since its core is native code."""

import importlib.util

import pytest

NEEDS_MAVSDK = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None, reason="MAVSDK's Python package (mavsdk) is not installed"
)
# The beginning of a client's program, which listens at the address in its first argument. `until` looks again and
# again, since MAVSDK has no event for what it waits for.
LISTEN = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk

mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(sys.argv[1])


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)


"""
# The same, with `system`, the autopilot that was found.
CONNECT = f"""{LISTEN}
system = mavsdk.first_autopilot(30.0)
assert system is not None, "no autopilot"
"""
