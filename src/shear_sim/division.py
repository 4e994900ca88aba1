"""A study divided among the tasks of Slurm: shares of like cost, and the file that says which.

The file is written once and never changed, so that a task has the same jobs at every run, also when
the study file was edited meanwhile, and that the next submission knows which jobs are taken.
"""

import hashlib
import heapq
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from pathlib import Path

from shear_sim.tables import write_whole

SLACK = 1.25  # by which the longest share may be longer than aimed at

Shares = Sequence[Sequence[str]]


def divide(cost: Mapping[str, float], most: int, seconds: float) -> list[list[str]]:
    """Divide jobs into as few shares as make none much longer than ``seconds``.

    A share is at most a quarter longer than ``seconds``, or than its longest job if that alone
    takes more, unless ``most`` forbids it. Fewer shares would not do, so none is very short either.

    Parameters
    ----------
    cost : mapping
        Expected time of each job [s], by job id.
    most : int
        Most shares.
    seconds : float
        Aimed at.
    """
    if not cost:
        return []

    def fits(shares: int) -> bool:
        return all(
            sum(cost[job] for job in share) <= SLACK * max(seconds, cost[share[0]])
            for share in deal(cost, shares)
        )

    most = min(most, len(cost))
    least = min(most, max(1, int(sum(min(each / seconds, 1.0) for each in cost.values()))))
    return deal(cost, least + bisect_left(range(least, most), x=True, key=fits))


def deal(cost: Mapping[str, float], shares: int) -> list[list[str]]:
    """Give each job, the longest first, to the share that has the least so far."""
    dealt: list[list[str]] = [[] for _ in range(shares)]
    loads = [(0.0, share) for share in range(shares)]  # a heap
    for job in sorted(cost, key=lambda job: (-cost[job], job)):
        load, share = loads[0]
        dealt[share].append(job)
        heapq.heapreplace(loads, (load + cost[job], share))
    return dealt


def file_name(shares: Shares) -> str:
    """Return the name of the file of these shares: from its content."""
    return f"{hashlib.sha256(_text(shares)).hexdigest()[:16]}.txt"


def write_division(folder: Path, shares: Shares) -> None:
    """Write which jobs are of which share: one line each, of job ids."""
    write_whole(folder / file_name(shares), _text(shares))


def read_division(path: Path) -> list[list[str]]:
    """Return what `write_division` wrote.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or is not what was written: its name is that of its content.
    """
    shares = [line.split() for line in path.read_text("utf-8").splitlines()]
    if file_name(shares) != path.name:
        msg = "damaged, or not of this program"
        raise ValueError(msg)
    return shares


def _text(shares: Shares) -> bytes:
    return "".join(f"{' '.join(share)}\n" for share in shares).encode()
