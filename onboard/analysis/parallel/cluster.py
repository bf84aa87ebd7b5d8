"""Parts of work on a Dask cluster, with the results in the order of the parts.

A part is a function with arguments, and draws its randomness from them. It gives the same result on every
computer with the same program, which is checked, and is computed again if its worker is lost. A worker that was
installed from a source tree finds the studies there; no wheel has them. Needs the extra `cluster`.
"""

import hashlib
import pickle
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from onboard import with_extra

SCHEDULER_TIMEOUT_S: Final = 10.0  # of the scheduler
PARTS_PER_CORE_COUNT: Final = 4  # that are with the cluster at a time
MIN_WAITING_COUNT: Final = 16
WORKER_TIMEOUT_S: Final = 120.0
RETRIES: Final = 10  # of a part that failed, or whose worker was lost
SOURCE_TREE: Final = Path(__file__).parents[3]  # the source tree, or where packages are installed
PROGRAM: Final = ("onboard", "simlink")
STUDIES: Final = "studies"


class ClusterError(ValueError):
    """The cluster cannot be used; the message says why in one line."""


def on_cluster(
    address: str, run: Callable[[Any], Any], parts: Sequence[Any], packages: Sequence[str] = PROGRAM
) -> Iterator[Any]:
    """Compute `run(part)` of each part, in order, at the scheduler at `address`.

    The workers' sources of `packages` must be ours. Only some parts for each core are with the cluster at a
    time, so memory does not grow with their number. Raises ClusterError, and what `run` raises."""
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ClusterError(f"a cluster needs Dask: {with_extra('cluster')}") from error
    try:
        connect: Any = distributed.Client
        pack: Any = distributed.protocol.pickle.dumps
        client = connect(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(f"there is no Dask scheduler at {address}: {error}") from error
    with client:
        max_waiting = max(MIN_WAITING_COUNT, PARTS_PER_CORE_COUNT * _cores(client, address))
        _check_program(client, packages)
        waiting: deque[Any] = deque()
        for part in parts:
            waiting.append(client.submit(_run_packed, pack((run, part)), pure=False, retries=RETRIES))
            if len(waiting) >= max_waiting:
                yield _result(client, waiting.popleft(), address)
        while waiting:
            yield _result(client, waiting.popleft(), address)


def fingerprint(packages: Sequence[str] = PROGRAM, root: Path = SOURCE_TREE) -> str:
    """Digest of the sources of packages in `root`. Raises FileNotFoundError."""
    digest = hashlib.sha256()
    for package in packages:
        if not (root / package).is_dir():
            raise FileNotFoundError(f"there is no {package}/ in {root}: it is in the source tree only")
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def find_studies() -> bool:
    """Make the studies of a source tree importable. Returns False without a source tree."""
    if (SOURCE_TREE / STUDIES / "__init__.py").exists() and (SOURCE_TREE / "pyproject.toml").exists():
        if str(SOURCE_TREE) not in sys.path:
            sys.path.append(str(SOURCE_TREE))
        return True
    return False


def _run_packed(packed: bytes) -> Any:
    """Run a packed function on its part, on a worker."""
    find_studies()
    run, part = pickle.loads(packed)  # noqa: S301 - of the client, as all that Dask sends
    return run(part)


def _cores(client: Any, address: str) -> int:
    try:
        client.wait_for_workers(1, timeout=WORKER_TIMEOUT_S)
    except TimeoutError as error:
        wait = f"{WORKER_TIMEOUT_S:.0f} s"
        raise ClusterError(f"the scheduler at {address} has had no worker for {wait}; start one") from error
    return sum(client.nthreads().values())


def _check_program(client: Any, packages: Sequence[str]) -> None:
    """Raise ClusterError if a worker has other sources, since its results would differ."""
    ours = fingerprint(packages)
    for worker, theirs in client.run(fingerprint, packages, on_error="return").items():
        if isinstance(theirs, Exception):
            raise ClusterError(f"worker {worker} cannot load wingline: {theirs}; install the same version there")
        if theirs != ours:
            raise ClusterError(
                f"worker {worker} has other sources of wingline ({theirs}, here {ours}): install the same version"
            )


def _result(client: Any, future: Any, address: str) -> Any:
    """Wait for a part's result. Raises ClusterError when no worker is left."""
    while True:
        try:
            result = future.result(timeout=WORKER_TIMEOUT_S)
        except TimeoutError:
            if not future.done() and not client.nthreads():
                raise ClusterError(f"the scheduler at {address} has lost all its workers; start one") from None
            continue
        future.release()
        return result
