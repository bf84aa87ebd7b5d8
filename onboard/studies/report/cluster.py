"""Parts of work on a Dask cluster: the results in the order of the parts, whatever the number of workers, and
again where a worker was lost. Needs the extra `cluster`.

A part is a function and its arguments and draws its own randomness from them, so it gives the same result on every
computer with the same program; that they have it is checked.
"""

import hashlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

WAITING: Final = 4  # parts for each core that are handed out at once
LEAST_WAITING: Final = 16
PATIENCE_S: Final = 120.0  # without any worker
RETRIES: Final = 10  # of a part whose worker was lost, or that failed on it
PACKAGE: Final = Path(__file__).parents[2]


class ClusterError(ValueError):
    """The cluster cannot be used; the message says why in one line."""


def on_cluster(address: str, run: Callable[[Any], Any], parts: Sequence[Any]) -> Iterator[Any]:
    """`run(part)` of each part, in their order, computed by the workers of the scheduler at `address`. Only
    some parts for each core are with the cluster at a time, so memory does not grow with their number.

    Raises ClusterError, and what `run` raises.
    """
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ClusterError("a cluster needs Dask: pip install 'wingline[cluster]'") from error
    try:
        connect: Any = distributed.Client
        client = connect(address, timeout=10, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(f"there is no Dask scheduler at {address}: {error}") from error
    with client:
        most = max(LEAST_WAITING, WAITING * _cores(client, address))
        _check_program(client)
        waiting: deque[Any] = deque()
        for part in parts:
            waiting.append(client.submit(run, part, pure=False, retries=RETRIES))
            if len(waiting) >= most:
                yield _result(client, waiting.popleft(), address)
        while waiting:
            yield _result(client, waiting.popleft(), address)


def fingerprint(package: Path = PACKAGE) -> str:
    """A digest of the program's sources."""
    digest = hashlib.sha256()
    for folder in (package, package.parent / "simlink"):
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(package.parent)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cores(client: Any, address: str) -> int:
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError as error:
        raise ClusterError(f"the scheduler at {address} has had no worker for {PATIENCE_S:.0f} s") from error
    return sum(client.nthreads().values())


def _check_program(client: Any) -> None:
    """Raises ClusterError where a worker has another version of the program: its results would differ."""
    ours = fingerprint()
    for worker, theirs in client.run(fingerprint, on_error="return").items():
        if isinstance(theirs, Exception):
            raise ClusterError(f"worker {worker} cannot load wingline: {theirs}; install the same version there")
        if theirs != ours:
            raise ClusterError(
                f"worker {worker} has other sources of wingline ({theirs}, here {ours}): install the same"
            )


def _result(client: Any, future: Any, address: str) -> Any:
    """A part's result. Raises ClusterError when no worker is left."""
    while True:
        try:
            result = future.result(timeout=PATIENCE_S)
        except TimeoutError:
            if not future.done() and not client.nthreads():
                raise ClusterError(f"the scheduler at {address} has lost all its workers") from None
            continue
        future.release()
        return result
