"""`onboard view --wait`: for a daemon that starts later, and not for one that never will."""

from pathlib import Path

import pytest

from onboard.commands import cli
from onboard.messages.causes import Cause
from onboard.sinks import zenoh_session
from onboard.sinks.zenoh_session import RouterAbsentError

NOBODY = RouterAbsentError("nobody answers", Cause.UNREACHABLE)
WRONG_CERTIFICATE = RouterAbsentError("wrong certificate", Cause.TLS)


class Daemon:
    """Somebody who answers after so many tries; the view of it is ended at once."""

    def __init__(self, *refusals: RouterAbsentError) -> None:
        self.refusals = [*refusals]
        self.tries = 0

    def __call__(self, *_: object) -> object:
        self.tries += 1
        if self.refusals:
            raise self.refusals.pop(0)
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("refusals", "wait", "code", "tries"),
    [
        ([NOBODY, NOBODY], ["--wait", "60"], 130, 3),
        ([NOBODY, NOBODY], [], 2, 1),
        ([NOBODY, WRONG_CERTIFICATE], ["--wait", "60"], 2, 2),
    ],
    ids=["answers at last", "is not waited for", "will not let us in"],
)
def test_it_waits_as_long_as_asked_for_a_daemon_that_is_not_there(
    refusals: list[RouterAbsentError],
    wait: list[str],
    code: int,
    tries: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    daemon = Daemon(*refusals)
    monkeypatch.setattr(zenoh_session, "open_session", daemon)
    monkeypatch.setattr(zenoh_session, "ROUTER_RETRY_PERIOD_S", 0.0)
    assert cli.main(["view", "--rrd", str(tmp_path / "view.rrd"), *wait]) == code
    assert daemon.tries == tries
