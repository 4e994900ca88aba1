"""Worker processes: one server compiles the kernels once, then forks workers that inherit them.

The supervisor (``sweep``) starts the server as a fresh interpreter with a single thread and one
core per library, so forking it is safe and cheap (milliseconds, whatever the user's program has
loaded). Each worker runs one job after another; its death loses that job only, and another worker
takes its place. Workers and server die with the supervisor, however it ends: the kernel kills them
(Linux), or their connection breaks (elsewhere, after the running job).
"""

import contextlib
import errno
import faulthandler
import gc
import os
import signal
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from shear_sim import models
from shear_sim.compiled import compiling
from shear_sim.results import Failure

if TYPE_CHECKING:
    from shear_sim.study import Job

# One job per core is all the parallelism: libraries that start threads of their own only get in
# each other's way (Numba does not listen to OMP_NUM_THREADS).
ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "VECLIB", "NUMBA")
}
# The supervisor decides what a signal means; Slurm and terminals send it to every process.
SUPERVISED = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
# Nothing can be written any more: not one job's failure but everybody's.
STORAGE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)
TRACEBACK_LINES = 20
CLOSE_SECONDS = 5.0  # for idle processes to end


class Compiling(NamedTuple):
    """The server has to compile; otherwise it finds the kernels in the cache."""


class Ready(NamedTuple):
    """The kernels are compiled: workers can be added."""


class Unprepared(NamedTuple):
    """The server could not prepare: the error in one line, and its traceback."""

    reason: str
    traceback: str


class Ending(NamedTuple):
    """How a job has ended: all false if its result is written."""

    failure: Failure | None = None
    storage_full: str | None = None
    stopped: bool = False  # a checkpoint is written,
    anew: bool = False  # but an older one was of no use


class Outcome(NamedTuple):
    """A worker has ended a job."""

    worker: int
    job: int
    ending: Ending
    wall_s: float


class Died(NamedTuple):
    """A worker process has ended; ``status`` as of ``os.waitstatus_to_exitcode``."""

    worker: int
    status: int


class ServerDied(NamedTuple):
    """The server has ended, and with it all workers."""

    status: int


Event = Compiling | Ready | Unprepared | Outcome | Died | ServerDied


class Workers:
    """The supervisor's side: hands jobs to workers and tells what has become of them."""

    def __init__(self, jobs: Sequence["Job"], kernels: str, folder: Path, log: IO[bytes]) -> None:
        """Start the server, which compiles for ``jobs`` and writes results to ``folder``.

        Of all servers at once with the same ``kernels`` only one compiles.
        """
        self._socket, theirs = socket.socketpair()
        self._link = Connection(os.dup(self._socket.fileno()))
        self._channels: dict[int, Connection] = {}
        self._added = 0
        code = (
            f"import sys; sys.path[:] = {sys.path!r}; "
            f"from shear_sim.workers import serve; serve({theirs.fileno()})"
        )
        with theirs:
            self._server = subprocess.Popen(  # noqa: S603
                [sys.executable, "-c", code],
                pass_fds=[theirs.fileno()],
                process_group=0,  # Ctrl-C is for the supervisor alone
                env={**os.environ, **ONE_THREAD},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        with contextlib.suppress(BrokenPipeError):  # it has died already: events() will tell
            self._link.send((os.getpid(), list(jobs), kernels, folder))

    def add(self) -> int:
        """Start one more worker and return its number."""
        self._added += 1
        ours, theirs = socket.socketpair()
        with theirs, contextlib.suppress(BrokenPipeError):
            number = self._added.to_bytes(4, "big")
            socket.send_fds(self._socket, [number], [theirs.fileno()])
        self._channels[self._added] = Connection(ours.detach())
        return self._added

    def give(self, worker: int, job: int) -> None:
        """Let a worker that is idle run the job of this number in the list."""
        with contextlib.suppress(OSError):  # it has died: events() will tell
            self._channels[worker].send(job)

    def events(self, timeout: float) -> Iterator[Event]:
        """Yield what has happened, waiting for at most ``timeout`` seconds."""
        channels = {c: worker for worker, c in self._channels.items() if not c.closed}
        ready = wait([*channels, self._link], timeout)
        for channel in channels.keys() & set(ready):
            yield from self._read(channels[channel])
        if self._link in ready:
            try:
                event = self._link.recv()
            except (EOFError, ConnectionResetError):
                event = ServerDied(self._server.wait())
            if isinstance(event, Died):
                yield from self._read(event.worker)  # a result sent before the end counts
                self._channels.pop(event.worker).close()
            yield event

    def _read(self, worker: int) -> Iterator[Event]:
        """Yield the message of a worker, if there is a whole one; its death is told elsewhere."""
        channel = self._channels[worker]
        if channel.closed:
            return
        try:
            if channel.poll():
                yield channel.recv()
        except (EOFError, ConnectionResetError):
            channel.close()

    def close(self) -> None:
        """Let idle workers and the server end, so that their CPU time is counted as ours."""
        for channel in self._channels.values():
            channel.close()
        with contextlib.suppress(OSError):  # the server has died already
            self._socket.shutdown(socket.SHUT_WR)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._server.wait(CLOSE_SECONDS)
        self.kill()

    def stop(self) -> None:
        """Ask workers to end their jobs or keep checkpoints; the server takes no notice."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._server.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End all workers and the server at once, whatever they do."""
        if self._socket.fileno() < 0:
            return  # they have ended, and their process group may be somebody else's by now
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._server.pid, signal.SIGKILL)
        self._server.wait()
        self._socket.close()
        for channel in (self._link, *self._channels.values()):
            channel.close()


def serve(descriptor: int) -> None:
    """Prepare the kernels, then fork a worker whenever the supervisor asks for one."""
    for number in SUPERVISED:
        signal.signal(number, signal.SIG_IGN)
    control = socket.socket(fileno=descriptor)
    link = Connection(os.dup(descriptor))
    supervisor, jobs, kernels, folder = link.recv()
    _die_with(supervisor)
    faulthandler.enable()  # a crash in compiled code leaves its Python traceback in the log
    try:
        _prepare(jobs, kernels, link)
    except Exception as error:  # whatever it is, the supervisor tells the user
        link.send(Unprepared(f"{type(error).__name__}: {error}", traceback.format_exc()))
        return
    link.send(Ready())
    workers: dict[int, int] = {}

    def report_deaths(_signal: int, _frame: FrameType | None) -> None:
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                link.send(Died(workers.pop(found[0]), os.waitstatus_to_exitcode(found[1])))

    signal.signal(signal.SIGCHLD, report_deaths)
    gc.freeze()  # what is here now is shared by all workers: the collector need not touch it
    server = os.getpid()
    while True:
        request, descriptors, _, _ = socket.recv_fds(control, 4, 1)
        if not request:
            break
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # until the worker is known
        if (pid := os.fork()) == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
            control.close()
            link.close()
            _die_with(server)
            _work(int.from_bytes(request, "big"), Connection(descriptors[0]), jobs, folder)
            os._exit(0)  # not back into the server's loop, and without its exit handlers
        workers[pid] = int.from_bytes(request, "big")
        os.close(descriptors[0])
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()


def _die_with(parent: int) -> None:
    """Let the kernel kill this process when its parent ends."""
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the line above
        os._exit(1)


def _prepare(jobs: Sequence["Job"], kernels: str, link: Connection) -> None:
    """Import what a job needs and compile what its kernels need, once for all workers."""
    import pyarrow as pa
    from pyarrow import parquet  # noqa: F401 - imported here, workers inherit it

    from shear_sim import runner

    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    runner.environment()
    with compiling(kernels):
        compile_for(jobs, lambda: link.send(Compiling()))


def compile_for(jobs: Sequence["Job"], tell: Callable[[], None]) -> None:
    """Load the kernels of all ``jobs`` from the cache, or compile them.

    ``tell`` is called once, before the first function that is not in the cache.
    """
    points: dict[str, dict[int, Any]] = {}
    for job in jobs:  # replicates share their point
        points.setdefault(job.point.kind, {})[id(job.point)] = job.point
    with telling(tell):
        for kind, of_kind in points.items():
            models.model(kind).compile_for(list(of_kind.values()))


@contextlib.contextmanager
def telling(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` once, before the first function that is compiled in this context."""
    from numba.core import event

    class Teller(event.Listener):
        told = False

        def on_start(self, event: Any) -> None:  # noqa: ARG002
            if not self.told:
                self.told = True
                tell()

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Teller()):
        yield


def _work(number: int, channel: Connection, jobs: Sequence["Job"], folder: Path) -> None:
    """Run the jobs that come over ``channel`` until it closes; SIGTERM ends them early."""
    asked: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: asked.append(number))
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            index = channel.recv()
            began = time.perf_counter()
            ending = attempt(jobs[index], folder, lambda: bool(asked))
            channel.send(Outcome(number, index, ending, time.perf_counter() - began))


def attempt(job: "Job", folder: Path, stop: Callable[[], bool] = lambda: False) -> Ending:
    """Run one job, until ``stop`` is true; return how it ended."""
    from shear_sim.models.interface import SimulationError
    from shear_sim.runner import Stopped, run_job

    try:
        run_job(job, folder, stop)
    except Stopped as stopped:
        return Ending(stopped=True, anew=stopped.anew)
    except SimulationError as error:
        return Ending(Failure(job.id, "physics", str(error)))
    except OSError as error:
        if error.errno in STORAGE_ERRORS:
            return Ending(storage_full=str(error))
        return Ending(_error(job, error))
    except Exception as error:  # one job's bug must not stop the others
        return Ending(_error(job, error))
    return Ending()


def _error(job: "Job", error: Exception) -> Failure:
    lines = traceback.format_exc().splitlines()[-TRACEBACK_LINES:]
    where = traceback.extract_tb(error.__traceback__)[-1]
    at = f"{Path(where.filename).name}, line {where.lineno}"
    reason = f"{type(error).__name__}: {error} ({at})"
    return Failure(job.id, "error", reason, traceback=tuple(lines))
