"""The state file of a run, from which the next one continues after a restart in flight.

It is read once, at the start, and used only if it is at most MOST_AGE_S old and of the same configuration.
Otherwise it is ignored with a reason, and the daemon starts as without a file.
"""

import errno
import hashlib
import os
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from onboard.config.reading import ConfigError
from onboard.config.sections import Config
from onboard.config.storing import Storing, replace_file
from onboard.messages import Datagram, Encoding, WarmState
from onboard.messages.causes import Cause, Reason
from onboard.units import S_PER_NS
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.warm_state import decode_warm_state

MAX_AGE_S: Final = 10.0  # after that, a manoeuvring leader may be anywhere
WARM_STATE_CHANNEL: Final = "warm_state"
MAX_FILE_BYTES: Final = 65_536
FILE_MODE: Final = 0o600  # positions are private
FOLDER_MODE: Final = 0o700
# Sections that affect the meaning and the target of an estimate.
DIGEST_SECTIONS: Final = (
    "link",
    "autopilot",
    "camera",
    "cameras",
    "target",
    "delay",
    "ownship",
    "estimator",
    "guidance",
)


def digest(config: Config) -> str:
    """Return a hash of the part of a configuration that must be equal to continue a run."""
    decisive = {name: getattr(config, name) for name in DIGEST_SECTIONS}
    return hashlib.sha256(msgspec.json.encode(decisive, order="deterministic")).hexdigest()[:16]


class WarmFile:
    """The state file of a configuration.

    `report` receives lines for a person; `refuse` receives source, reason and time of an ignored state. Raises
    ConfigError if a configured path cannot be written.
    """

    def __init__(
        self,
        config: Config,
        report: Callable[[str], None],
        refuse: Callable[[str, Reason, int], None],
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        self.digest = digest(config)
        self._report, self._refuse = report, refuse
        self._storing: Storing | None = None
        wanted = config.warm_start.path
        self._path = state_folder(environment) / f"leader-{self.digest}.json" if wanted is None else Path(wanted)
        if not config.warm_start.enabled or "leader" not in config.estimator:
            return
        if (reason := _not_writable(self._path, make=wanted is None)) and wanted is not None:
            raise ConfigError(f"warm_start.path: {reason}")
        if reason:
            report(f"warm start is off: {reason}; set warm_start.path")
            return
        self._storing = Storing(self._path, store_state, what="the state for a warm start")

    def read(self, wall_ns: int) -> Datagram | None:
        """Return the state of an earlier run, if it may be used at this wall-clock time."""
        if self._storing is None:
            return None
        try:
            check_own(self._path)
            with self._path.open("rb") as file:
                data = file.read(MAX_FILE_BYTES + 1)
            age = self._checked(data, wall_ns)
        except FileNotFoundError:
            return None
        except (OSError, BadDocumentError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            self._report(f"{self._path} is ignored: {reason}")
            self._refuse(WARM_STATE_CHANNEL, Reason(Cause.WARM_STATE, str(reason)), wall_ns)
            return None
        self._report(f"warm start: read the leader's state of {age:.1f} s ago from {self._path}")
        return _datagram(data, wall_ns)

    def keep(self, state: WarmState | None) -> None:
        """Queue a state for storage. Never waits for the disk."""
        if self._storing is None or state is None:
            return
        self._storing.put(msgspec.structs.replace(state, configuration=self.digest))
        if error := self._storing.take_error():
            self._report(error)

    def close(self) -> None:
        """Wait until the last state is stored."""
        if self._storing is not None:
            self._storing.close()

    def _checked(self, data: bytes, wall_ns: int) -> float:
        """Return the age of a state, s. Raises BadDocumentError for an unusable one."""
        state = decode_warm_state(data, wall_ns)
        if state.configuration != self.digest:
            raise BadDocumentError("it belongs to another configuration")
        age = (wall_ns - state.wall_ns) * S_PER_NS
        if age < 0.0:
            raise BadDocumentError(f"it is {-age:.1f} s in the future: the wall clock was set back")
        if age > MAX_AGE_S:
            raise BadDocumentError(f"it is {age:.0f} s old; expected at most {MAX_AGE_S:.0f} s")
        return age


def warm_datagram(state: WarmState, t_recv_ns: int) -> Datagram:
    """Return a state as a message to the next run's pipeline."""
    return _datagram(msgspec.json.encode(state), t_recv_ns)


def _datagram(data: bytes, t_recv_ns: int) -> Datagram:
    return Datagram(channel=WARM_STATE_CHANNEL, encoding=Encoding.WARM_STATE, t_recv_ns=t_recv_ns, data=data)


def state_folder(environment: Mapping[str, str]) -> Path:
    """Return the state folder: systemd's StateDirectory, otherwise XDG's."""
    if given := environment.get("STATE_DIRECTORY"):
        return Path(given.partition(":")[0])
    state = environment.get("XDG_STATE_HOME", "")
    home = Path(environment.get("HOME", ""))
    home = home if home.is_absolute() else Path("/nonexistent")  # not below the working directory
    return (Path(state) if Path(state).is_absolute() else home / ".local" / "state") / "onboard"


def check_own(path: Path) -> None:
    """Raise OSError for a link, a pipe or another user's file: no run of ours wrote it."""
    status = path.lstat()
    if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid():
        raise OSError(errno.EINVAL, "is not our file: it is a link, a pipe, or another user's")


def store_state(path: Path, state: WarmState) -> None:
    """Write a state atomically: a killed process leaves the old or the new file.

    It need not survive a power cut, after which it would be too old. Raises OSError.
    """
    replace_file(path, msgspec.json.encode(state), FILE_MODE, sync=False)


def _not_writable(path: Path, *, make: bool) -> str:
    """Return why a file cannot be written, "" if it can; `make` creates its folder."""
    try:
        if make:
            path.parent.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        return f"the folder {path.parent} cannot be created ({error.strerror})"
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK | os.X_OK):
        return f"the folder {path.parent} does not exist or is not writable"
    return ""
