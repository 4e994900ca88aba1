"""A sweep: the supervisor that has the missing jobs of a study computed.

Nothing here holds a lock or a state of its own: what is done is what lies in ``jobs/``. So a sweep
may be killed at any time and started again, and several may work at one study.
"""

import contextlib
import os
import platform
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import IO

from shear_sim.compiled import cache_folder
from shear_sim.plan import SHOWN_FAILURES, Costs, Plan, failure_lines
from shear_sim.results import Failure
from shear_sim.screen import COMPILING, Screen, duration
from shear_sim.tables import remove_partial
from shear_sim.workers import (
    Compiling,
    Died,
    Event,
    Outcome,
    Ready,
    ServerDied,
    Unprepared,
    Workers,
)

DONE, FAILED, STOPPED, INTERRUPTED = 0, 1, 75, 130  # exit codes
# For running jobs to end or to write a checkpoint, which takes about a second: Slurm kills 30 s
# after SIGTERM, and warns by SIGUSR1 120 s before a time limit (13 s late at most, as measured).
GRACE_SECONDS = {signal.SIGINT: 2.0, signal.SIGUSR1: 60.0}
SHORT_GRACE_SECONDS = 5.0  # after the others
TICK_SECONDS = 0.2
SERVER_RESTARTS = 3  # without one job ended in between


class SweepError(Exception):
    """The sweep cannot go on; says why."""


@dataclass(frozen=True)
class Report:
    """How a sweep ended."""

    done: int  # now
    failed: dict[str, Failure]  # now
    waiting: int  # failed by physics before, and left alone
    stopped: int  # of the jobs left, kept as checkpoints now,
    advanced: int  # and further than before
    left: int  # not run: stopped, limited or storage full
    signal: int | None
    storage_full: str | None
    wall_s: float

    @property
    def progress(self) -> bool:
        """Whether any job is done or has got further; a crash is tried again at every run."""
        return bool(self.done or self.advanced)

    @property
    def exit_code(self) -> int:
        """0 all done, 1 some failed, 75 stopped, 130 interrupted."""
        if self.signal is not None and self.left:
            return INTERRUPTED if self.signal == signal.SIGINT else STOPPED
        return FAILED if self.failed or self.waiting or self.storage_full else DONE


def run_plan(plan: Plan, screen: Screen, received: list[int] | None = None) -> Report:
    """Run the jobs of a plan on its workers, whatever happens to single ones of them.

    ``received`` are signals that came before, and ask to stop at once.

    Raises
    ------
    ResultsError
        If the results cannot be written from the start.
    SweepError
        If no job can run: the kernels do not compile, the server of the workers dies.
    """
    plan.results.prepare(plan.study, keep_plan=plan.shard[0] == 0)
    started = time.monotonic()
    sweep = _Sweep(plan, screen)
    if plan.run:
        cache_folder()  # an unwritable one is told here and replaced for all workers
        with (
            _signals([] if received is None else received) as received,
            _log(plan.results.logs) as log,
        ):
            sweep.run(received, log)
    return Report(
        done=sweep.done,
        failed=sweep.failed,
        waiting=len(plan.waiting),
        stopped=sweep.stopped,
        advanced=sweep.advanced,
        left=len(plan.run) - sweep.done - len(sweep.failed) + plan.left_out,
        signal=sweep.signal,
        storage_full=sweep.storage_full,
        wall_s=time.monotonic() - started,
    )


class _Sweep:
    """The supervisor's loop."""

    def __init__(self, plan: Plan, screen: Screen) -> None:
        self.plan, self.screen = plan, screen
        # New jobs before those that failed, of many threads before those of few, which fit in
        # beside them: a queue for each (failed, −threads).
        self.todo: dict[tuple[bool, int], deque[int]] = {}
        kinds = [(job.id in plan.again, -job.threads) for job in plan.run]
        for kind in sorted(set(kinds)):
            self.todo[kind] = deque(n for n, each in enumerate(kinds) if each == kind)
        self.remaining = Counter(plan.points[job.id] for job in plan.run)
        self.wall_s = plan.wall_s if plan.wall_s.measured else Costs()
        self.busy: dict[int, int] = {}  # worker -> number of its job in plan.run
        self.idle: list[int] = []
        self.done = self.stopped = self.advanced = 0
        self.failed: dict[str, Failure] = {}
        self.ready = self.started = False
        self.next_look = 0.0
        self.restarts = 0
        self.received: list[int] = []
        self.signal: int | None = None
        self.storage_full: str | None = None

    def run(self, received: list[int], log: IO[bytes]) -> None:
        """Keep the workers busy until nothing is left or somebody says stop."""
        self.received, self.log = received, log
        self.workers = self._new_workers()
        give_up = float("inf")
        try:
            while not self.ready or self.busy:
                for event in self.workers.events(TICK_SECONDS):
                    self._take(event)
                if self.ready:
                    self._fill()
                if received and self.signal is None:
                    self.signal = received[0]
                    self.todo.clear()
                    grace = GRACE_SECONDS.get(signal.Signals(self.signal), SHORT_GRACE_SECONDS)
                    give_up = time.monotonic() + grace
                if self.signal is not None:
                    self.workers.stop()  # again and again: one may just have been forked
                    if not self.ready or len(received) > 1 or time.monotonic() >= give_up:
                        break
                if time.monotonic() >= self.next_look:
                    self._show()
            else:
                self.workers.close()
        finally:
            self._show()
            self.workers.kill()
            remove_partial(self.plan.results.jobs)
            self.screen.stop()

    def _show(self) -> None:
        self.next_look = time.monotonic() + TICK_SECONDS
        if not self.ready:
            self.screen.prepare("preparing the kernels")
            return
        left = self.plan.time(self.wall_s, self.remaining)
        ended, total = self.done + len(self.failed), len(self.plan.run)
        self.screen.update(ended, len(self.failed), total, left)

    def _new_workers(self) -> Workers:
        return Workers(self.plan.run, self.plan.study.kernels, self.plan.results.jobs, self.log)

    def _take(self, event: Event) -> None:
        match event:
            case Compiling():
                self.screen.say(COMPILING)
            case Ready():
                if not self.started:
                    self.started = True
                    self.screen.start(len(self.plan.run))
                self.ready = True
            case Unprepared():
                msg = f"the kernels cannot be prepared: {event.reason}"
                error = SweepError(msg)
                error.add_note(event.traceback)  # shown with a traceback only, by --debug
                raise error
            case Outcome():
                self.restarts = 0
                self._end(event)
                self.idle.append(event.worker)
            case Died():
                self._lose(event.worker, event.status)
            case ServerDied():
                self._restart(event.status)

    def _fill(self) -> None:
        """Start the first jobs that there are cores for; one that asks for more runs alone."""
        free = self.plan.cores - sum(self.plan.run[job].threads for job in self.busy.values())
        while len(self.busy) < self.plan.workers:
            fitting = (kind for kind in self.todo if -kind[1] <= free or not self.busy)
            if (kind := next(fitting, None)) is None:
                return
            job = self.todo[kind].popleft()
            if not self.todo[kind]:
                del self.todo[kind]
            worker = self.idle.pop() if self.idle else self.workers.add()
            self.busy[worker] = job
            self.workers.give(worker, job)
            free += kind[1]

    def _end(self, outcome: Outcome) -> None:
        """Count a job that has ended, well or not."""
        job = self.plan.run[self.busy.pop(outcome.worker)]
        self.remaining[self.plan.points[job.id]] -= 1
        if outcome.ending.storage_full is not None:
            self.storage_full = outcome.ending.storage_full
            self.todo.clear()
        elif outcome.ending.stopped:
            if not self.received:  # somebody has stopped a worker, and means the sweep
                self.received.append(signal.SIGTERM)
            self.todo.clear()
            self.stopped += 1
            # On another type of processor each time, a job would begin anew for ever.
            self.advanced += not outcome.ending.anew
        elif outcome.ending.failure is not None:
            self._fail(outcome.ending.failure)
        else:
            self.done += 1
            self.wall_s.add(self.plan.points[job.id], outcome.wall_s)
            if job.id in self.plan.again:
                self.plan.results.forget_failure(job.id)

    def _lose(self, worker: int, status: int) -> None:
        """Record the job that a dead worker was at."""
        if worker not in self.busy:
            self.idle = [each for each in self.idle if each != worker]
            return
        job = self.plan.run[self.busy.pop(worker)]
        self.remaining[self.plan.points[job.id]] -= 1
        if self.plan.results.job_file(job.id).exists():
            self.done += 1  # it died between its last deed and telling of it
            return
        reason = f"its process ended with exit code {status}"
        name = None
        if status < 0:
            name = signal.Signals(-status).name
            why = ": out of memory, or killed by somebody" if -status == signal.SIGKILL else ""
            reason = f"its process was killed by {name}{why}"
        reason += f"; what it said last is in {self.log.name}"
        code = status if status >= 0 else None
        self._fail(Failure(job.id, "crash", reason, exit_code=code, signal=name))

    def _fail(self, failure: Failure) -> None:
        failure = self.plan.results.record_failure(failure)
        self.failed[failure.job] = failure
        if len(self.failed) <= SHOWN_FAILURES:
            self.screen.say(f"failed: job {failure.job} ({failure.kind}): {failure.reason}")
        elif len(self.failed) == SHOWN_FAILURES + 1:
            self.screen.say("more jobs fail; they are counted below and listed at the end")

    def _restart(self, status: int) -> None:
        """Go on after the death of the server, which took all workers along."""
        for worker in list(self.busy):
            self._lose(worker, -signal.SIGKILL)
        self.workers.kill()
        self.restarts += 1
        if self.restarts > SERVER_RESTARTS or not self.ready:
            msg = f"the process that starts the workers died ({status}); see {self.log.name}"
            raise SweepError(msg)
        if self.todo:
            self.ready, self.idle = False, []
            self.workers = self._new_workers()


@contextlib.contextmanager
def _signals(received: list[int]) -> Iterator[list[int]]:
    """Collect the signals that ask to stop, instead of dying of them."""
    if threading.current_thread() is not threading.main_thread():
        yield received  # a thread of the user's program: signals are that program's affair
        return

    def note(number: int, _frame: FrameType | None) -> None:
        received.append(number)

    asked = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in asked}
    try:
        for number in asked:
            if before[number] != signal.SIG_IGN:  # nohup: stay when the terminal closes
                signal.signal(number, note)
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _log(folder: Path) -> Iterator[IO[bytes]]:
    """Open the file for what workers print; it is removed if they print nothing."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    path = folder / f"sweep-{stamp}-{platform.node()}-{os.getpid()}.log"
    with path.open("ab") as log:
        yield log
    if path.stat().st_size == 0:
        path.unlink()


def describe_report(plan: Plan, report: Report) -> str:
    """Return the last lines of a sweep: what was done, what was not and where to look next."""
    folder = plan.results.folder
    lines = []
    if report.signal is not None:
        lines.append(f"stopped by {signal.Signals(report.signal).name}")
    if report.storage_full is not None:
        lines.append(
            f"stopped: results cannot be written ({report.storage_full}); make room or give "
            "another folder with --results; finished jobs are safe"
        )
    lines.append(
        f"{plan.study.name}: {plan.done + report.done} of {plan.total} jobs done "
        f"({report.done} now, in {duration(report.wall_s)}), "
        f"{len(report.failed) + report.waiting} failed, {report.left} left"
    )
    lines += failure_lines(report.failed, "see failed/")
    kinds = Counter(failure.kind for failure in report.failed.values())
    if kinds["crash"] + kinds["error"]:
        lines.append("  crashes and errors are tried again by the next sweep")
    if report.waiting or kinds["physics"]:
        lines.append("  failures by physics are tried again only with --retry-failed")
    if report.stopped:
        lines.append(f"  {report.stopped} job(s) will go on from checkpoints")
    if report.left or report.signal is not None:
        lines.append(f"next: the same command again does what is left, {report.left} job(s)")
    if plan.done + report.done:
        lines.append(f"next: shear-sim aggregate {folder}    (or: shear-sim status {folder})")
    return "\n".join(lines)
