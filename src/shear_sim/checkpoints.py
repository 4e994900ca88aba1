"""Checkpoints: a simulation on its way, from which it goes on to the same bits.

A file holds a checksum, the key of the code that wrote it, and the pickled simulation. It is read
by the same sources and versions on the same type of processor only, which is what lets a pickle do.
"""

import hashlib
import pickle
import sys
from dataclasses import dataclass, field
from pathlib import Path

from shear_sim.compiled import build_key
from shear_sim.models.interface import Simulation
from shear_sim.tables import write_whole


@dataclass
class Progress:
    """A simulation and what it has cost so far."""

    simulation: Simulation = field(repr=False)
    wall_s: float = 0.0
    cpu_s: float = 0.0
    resumed: int = 0  # times


def write_checkpoint(path: Path, progress: Progress) -> None:
    """Write a checkpoint whole; an older one stays until then.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path.parent.mkdir(exist_ok=True)
    data = build_key().encode() + pickle.dumps(progress)
    write_whole(path, hashlib.sha256(data).digest() + data)


def read_checkpoint(path: Path) -> Progress | None:
    """Return what `write_checkpoint` kept; None if there is nothing that can go on.

    A damaged file, or one of other code or another type of processor, is said on standard error
    (in a sweep: in its log), and the job begins anew.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    digest, data, key = content[:32], content[32:], build_key().encode()
    if hashlib.sha256(data).digest() != digest:
        print(f"{path}: damaged; the job begins anew", file=sys.stderr, flush=True)
        return None
    if not data.startswith(key):
        print(
            f"{path}: of other code or another type of processor; the job begins anew",
            file=sys.stderr,
            flush=True,
        )
        return None
    progress: Progress = pickle.loads(data[len(key) :])  # noqa: S301 - ours, see above
    progress.resumed += 1
    return progress
