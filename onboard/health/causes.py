"""Every cause of a missing or poor estimate that the health record can show: the table that `advice` goes
through.

Each is a function of the moment that yields advice. To add one, write the function, and a test that reads what
it advises (tests/unit/health/test_advice.py)."""

from collections.abc import Callable, Iterator
from typing import Final

from onboard.health import causes_camera, causes_host, causes_own
from onboard.health.needs import Moment
from onboard.messages import Advice

Causes = tuple[Callable[[Moment], Iterator[Advice]], ...]

OF_MESSAGES: Final[Causes] = (
    causes_own.silent_autopilot,
    causes_own.other_vehicles,
    causes_own.missing_streams,
    causes_own.no_origin,
    causes_own.clock,
    causes_own.own_transponder,
    causes_own.own_misfit,
    causes_camera.silent_camera,
    causes_camera.stamps,
    causes_camera.names,
    causes_camera.noise,
    causes_camera.lens,
    causes_host.refused,
)
OF_THIS_COMPUTER: Final[Causes] = (
    causes_host.links,
    causes_host.sinks,
    causes_host.slow,
    causes_host.storage,
)
