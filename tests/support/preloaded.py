"""A process that has loaded what `onboard` and `simlink` load, and forks for each program that a test starts: a
new interpreter would load the same again. `Preloaded` is a Popen of such a program: with the arguments, the
environment, the folder, the files and the session that it was asked for, and a child of the process that asked.

It has one thread. It loads nothing of which a fork would be another program: where a variable of `LOADED` differs,
or the system is not Linux, `Preloaded` starts a new interpreter.

`python -m tests.support.preloaded FD` is that process: it listens on the socket of this number.
"""

import ctypes
import gc
import importlib
import json
import os
import runpy
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
LOADED: Final = ("LD_", "MAV", "NUMBA_", "OMP_", "OPENBLAS_", "PYTHON", "WINGLINE_")  # read while modules load
MODULES: Final = ("onboard.commands.run", "onboard.commands.demo", "onboard.daemon", "simlink.cli")
LARGEST: Final = 1 << 17  # bytes of a request
PR_SET_CHILD_SUBREAPER: Final = 36


class Request(NamedTuple):
    """A program to become: `module` is run as by `python -m`."""

    module: str
    arguments: list[str]
    cwd: str
    environment: dict[str, str]
    new_session: bool


class Preloaded(subprocess.Popen[Any]):
    """A program of ours, from `[sys.executable, "-m", module, *arguments]`."""

    def _execute_child(self, args: list[str], *rest: Any) -> None:
        cwd, env, p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite = (*rest[4:6], *rest[9:15])
        server = None if sys.platform != "linux" else _server(_variables(env))
        if server is None or server.variables != _variables(env):
            super()._execute_child(args, *rest)  # private
            return
        _, _, module, *arguments = args
        request = Request(module, arguments, str(Path(cwd or ".").absolute()), env, bool(rest[-2]))
        files = [number if fd == -1 else fd for number, fd in enumerate((p2cread, c2pwrite, errwrite))]
        self.pid = server.fork(request, files)
        self._child_created = True
        self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)  # type: ignore[attr-defined]


class Server:
    """The process that forks, as the one that asks sees it."""

    def __init__(self, variables: dict[str, str]) -> None:
        kept = {k: v for k, v in os.environ.items() if not k.startswith(LOADED)}
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its:
            self._popen = subprocess.Popen(
                [sys.executable, "-m", __name__, str(its.fileno())],
                env={**kept, **variables, "OPENBLAS_NUM_THREADS": "1"},
                cwd=ROOT,
                pass_fds=[its.fileno()],
                stdin=subprocess.DEVNULL,
            )
        self._socket = ours
        self.variables = variables

    def fork(self, request: Request, files: list[int]) -> int:
        """Start a program, with these files as standard input, output and error; its number. It becomes a child of
        this process."""
        _adopt(orphans=True)
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], files)
            answer = self._socket.recv(64)
        finally:
            _adopt(orphans=False)
        assert answer, f"the preloaded process ended with {self._popen.wait()}"
        return int(answer)


def _variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Those that are read while modules load."""
    return {k: v for k, v in environment.items() if k.startswith(LOADED)}


def _server(variables: dict[str, str], servers: list[Server] = []) -> Server:  # noqa: B006 - the only one
    """The one for the variables of the first that asked; it ends with this process."""
    if not servers:
        servers.append(Server(variables))
    return servers[0]


def _adopt(*, orphans: bool) -> None:
    """Whether a process becomes a child of this one when its own parent, a descendant of this one, ends."""
    assert ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(orphans), 0, 0, 0) == 0


def main(number: int) -> None:
    """Load, then fork for each request until the other end closes."""
    with socket.socket(fileno=number) as requests:
        try:
            _load()
            request = _serve(requests)
        except KeyboardInterrupt:  # for the tests
            return
    if request is not None:
        _become(request)


def _load() -> None:
    for name in MODULES:
        importlib.import_module(name)
    from onboard.config import estimator_modules  # noqa: PLC0415 - as all that is loaded here

    for name in estimator_modules():
        importlib.import_module(name)
    gc.collect()
    gc.freeze()


def _serve(requests: socket.socket) -> Request | None:
    """The request of which this process is the fork; None at the end."""
    while True:
        message, files, *_ = socket.recv_fds(requests, LARGEST, 3)
        if not message:
            return None
        assert len([*Path("/proc/self/task").iterdir()]) == 1, "a process with threads cannot fork"
        read, write = os.pipe()
        between = os.fork()
        if not between:  # ends, so that its child is adopted
            if child := os.fork():
                os.write(write, str(child).encode())
                os._exit(0)
            for fd, file in enumerate(files):
                os.dup2(file, fd)
            for other in (*files, read, write):
                os.close(other)
            return Request(*json.loads(message))
        for other in (*files, write):
            os.close(other)
        os.waitpid(between, 0)
        requests.send(os.read(read, 64))
        os.close(read)


def _become(request: Request) -> None:
    """Run the program; what it raises ends this process as it would end its own."""
    if request.new_session:
        os.setsid()
    os.chdir(request.cwd)
    os.environ.clear()
    os.environ.update(request.environment)
    sys.path[0] = request.cwd
    sys.argv = [request.module, *request.arguments]
    runpy.run_module(request.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
