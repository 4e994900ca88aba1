"""Slurm: what was submitted, what waits and runs, and how a task asks to be run again.

Result files alone say what is done; Slurm's states only explain what is not. An answer that is
empty, late or missing never means that a job has failed.
"""

import contextlib
import json
import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from shear_sim.results import Results
from shear_sim.tables import write_whole

ANSWER_SECONDS = 60.0  # a busy controller may take long
MAX_ARRAY_SIZE = 1001  # Slurm's default, where the cluster's cannot be asked
MOST_IDLE_RUNS = 3  # of a task in a row without any progress
# Variables for sbatch outrank the lines of a script. These say what every script of ours says, or
# have sbatch wait; others, such as SBATCH_QOS, are the user's own defaults.
OUTRANKING = (
    *("ARRAY_INX", "TIMELIMIT", "MEM_PER_NODE", "MEM_PER_CPU", "MEM_PER_GPU", "SIGNAL", "OUTPUT"),
    *("ERROR", "OPEN_MODE", "JOB_NAME", "REQUEUE", "NO_REQUEUE", "WAIT"),
)


class SlurmError(Exception):
    """Slurm has refused something; says what, why and what is queued already."""


@dataclass(frozen=True)
class Task:
    """A task that waits or runs."""

    job: int  # number of the array, or of a job that is none
    index: int | None
    state: str
    reason: str


@dataclass(frozen=True)
class Submission:
    """One job number of Slurm that was given to this study."""

    job: int
    kind: Literal["array", "aggregation"]
    submitted: str
    division: str = ""  # file beside the record: the shares into which jobs were divided,
    tasks: tuple[int, ...] = ()  # those that this array runs,
    offset: int = 0  # and the share of its index 0


def record(results: Results, submission: Submission) -> None:
    """Keep a job number, in ``submissions/<number>.json``.

    Raises
    ------
    SlurmError
        If it cannot be written.
    """
    path = results.submissions / f"{submission.job}.json"
    try:
        results.submissions.mkdir(exist_ok=True)
        write_whole(path, f"{json.dumps(asdict(submission))}\n".encode())
    except OSError as error:
        msg = (
            f"{path}: not recorded ({error}): make room and `scancel {submission.job}`, or the "
            "same jobs are submitted again"
        )
        raise SlurmError(msg) from error


def submissions(results: Results) -> tuple[list[Submission], list[str]]:
    """Return what was submitted, the oldest first, and what is wrong with damaged records."""
    found, problems = [], []
    for path in sorted(results.submissions.glob("*.json")):
        try:
            content = json.loads(path.read_bytes())
            submission = Submission(**{**content, "tasks": tuple(content["tasks"])})
            if path.name != f"{submission.job}.json":
                msg = "of another job number"
                raise ValueError(msg)
            found.append(submission)
        except (OSError, ValueError, TypeError, KeyError) as error:
            problems.append(f"{path}: cannot be read ({error}): delete it once its job has ended")
    return sorted(found, key=lambda submission: submission.job), problems


def queue() -> list[Task] | None:
    """Return this user's tasks that wait or run; None where Slurm does not answer.

    Lines of another form are no tasks: warnings, or the names of clusters.
    """
    answer = _ask("squeue", "--me", "-h", "-r", "-o", "%F|%K|%T|%r")
    if answer is None:
        return None
    tasks = []
    lines = [line for line in answer.splitlines() if line and not line.startswith("CLUSTER: ")]
    for line in lines:
        job, *rest = line.split("|", 3)
        if job.isdecimal() and len(rest) == 3:
            index, state, reason = rest
            number = int(index) if index.isdecimal() else None  # N/A
            tasks.append(Task(int(job), number, state, reason))
    # Nothing but warnings is no empty queue: what waits in it would be submitted again.
    return tasks if tasks or not lines else None


def ended(jobs: Iterable[int]) -> dict[int, Counter[str]]:
    """Return how tasks of these jobs have ended, where Slurm keeps accounts and answers."""
    numbers = ",".join(map(str, jobs))
    found: dict[int, Counter[str]] = {}
    answer = _ask("sacct", "-n", "-X", "--parsable2", "-o", "JobID,State", "-j", numbers)
    for line in (answer or "").splitlines():
        task, _, state = line.partition("|")
        job, word = task.split("_")[0], state.partition(" ")[0]  # CANCELLED by 1000
        if job.isdecimal() and word not in {"", "PENDING", "RUNNING", "REQUEUED"}:
            found.setdefault(int(job), Counter())[word] += 1
    return found


def max_array_size() -> int:
    """Return the cluster's MaxArraySize: the largest index of an array is one less."""
    for line in (_ask("scontrol", "show", "config") or "").splitlines():
        name, _, value = line.partition("=")
        if name.strip() == "MaxArraySize" and value.strip().isdecimal():
            return int(value)
    return MAX_ARRAY_SIZE


def submit(script: str) -> int:
    """Submit a batch script; return its job number.

    Raises
    ------
    SlurmError
        If Slurm takes no jobs here or refuses this one.
    """
    said = [name for name in ("PARTITION", "ACCOUNT") if f"#SBATCH --{name.lower()}=" in script]
    ours = {f"SBATCH_{name}" for name in (*OUTRANKING, *said)}
    try:
        done = subprocess.run(
            ["sbatch", "--parsable"],  # noqa: S607 - the one of the PATH
            env={name: value for name, value in os.environ.items() if name not in ours},
            input=script,
            capture_output=True,
            text=True,
            errors="surrogateescape",  # as in paths: names of folders may be in any encoding
            check=True,
        )
        return int(done.stdout.split(";")[0])
    except FileNotFoundError:
        msg = "no sbatch on the PATH: run this where jobs are submitted, or use `shear-sim sweep`"
        raise SlurmError(msg) from None
    except subprocess.CalledProcessError as error:
        msg = f"sbatch refused: {' '.join(error.stderr.split())}"
        raise SlurmError(msg) from None
    except ValueError as error:
        msg = f"sbatch did not answer with a job number ({error}): look at `squeue --me`"
        raise SlurmError(msg) from None


def this_task() -> str | None:
    """Return how Slurm calls the task that this process is: ``12_3``, or None outside Slurm."""
    job = os.environ.get("SLURM_ARRAY_JOB_ID")
    index = os.environ.get("SLURM_ARRAY_TASK_ID")
    return f"{job}_{index}" if job and index else os.environ.get("SLURM_JOB_ID")


def requeue(task: str, folder: Path, *, progress: bool) -> str | None:
    """Ask Slurm to run this task again; return why it will not, or None if it will.

    Parameters
    ----------
    task : str
        See `this_task`.
    folder : Path
        A file of this task alone is kept there: how many of its runs in a row got no further.
        Runs that Slurm ends without a warning are not judged.
    progress : bool
        Whether a job has ended or got further in this run. A task without any in three runs
        would only burn time.
    """
    note = folder / f"idle-{task}"
    idle = 0
    if not progress:
        with contextlib.suppress(FileNotFoundError, ValueError):
            idle = int(note.read_bytes())
        idle += 1
    write_whole(note, str(idle).encode())
    if idle >= MOST_IDLE_RUNS:
        return f"no job has got any further in {MOST_IDLE_RUNS} runs: give more --time"
    if _ask("scontrol", "requeue", task) is None:
        return "scontrol requeue did not work"
    return None


def _ask(*command: str) -> str | None:
    """Return what a Slurm command prints; None if it is not there, fails or does not answer."""
    if shutil.which(command[0]) is None:
        return None
    # A user's filters of the queue would hide tasks.
    environment = {name: v for name, v in os.environ.items() if not name.startswith("SQUEUE_")}
    try:
        done = subprocess.run(  # noqa: S603 - our own words
            command,
            env=environment,
            capture_output=True,
            text=True,
            errors="replace",  # names of users and nodes may be in any encoding
            check=True,
            timeout=ANSWER_SECONDS,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout


def index_list(indices: Sequence[int]) -> str:
    """Return sorted indices as ``--array`` takes them: ``0-3,7``."""
    parts: list[list[int]] = []
    for index in indices:
        if parts and index == parts[-1][-1] + 1:
            parts[-1][1:] = [index]
        else:
            parts.append([index])
    return ",".join("-".join(map(str, part)) for part in parts)
