"""How a test starts MAVSDK, in a process of its own since its core is native code."""

import importlib.util

import pytest

NEEDS_MAVSDK = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None, reason="MAVSDK's Python package (mavsdk) is not installed"
)
# The beginning of a client's program: `system` is the autopilot found at the address in its first argument.
CONNECT = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk

mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(sys.argv[1])
system = mavsdk.first_autopilot(30.0)
assert system is not None, "no autopilot"
"""
