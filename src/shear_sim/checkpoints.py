"""Checkpoints: a simulation on its way, from which it goes on to the same bits.

A file holds a checksum, the key of the code that wrote it, the job, and the pickled simulation. It
is read for the same job by the same sources and versions on the same type of processor only, which
is what lets a pickle do. Those versions are also pydantic's, whose objects are in it, and scipy's,
which prepares packings.
"""

import hashlib
import pickle
import sys
from dataclasses import dataclass, field
from importlib.metadata import version
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
    """Write a checkpoint whole, for the job that ``path`` names; an older one stays until then.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path.parent.mkdir(exist_ok=True)
    data = _header(path) + pickle.dumps(progress)
    write_whole(path, hashlib.sha256(data).digest() + data)


def read_checkpoint(path: Path) -> Progress | None:
    """Return what `write_checkpoint` kept; None if there is nothing that can go on.

    A damaged file, or one of another job, other code or another type of processor, is said on
    standard error (in a sweep: in its log), and the job begins anew.

    Raises
    ------
    OSError
        If it cannot be read; says what to do where a folder has its name.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except IsADirectoryError as error:
        msg = "a folder in the place of a checkpoint: move it away"
        raise IsADirectoryError(error.errno, msg, str(path)) from error
    digest, data, header = content[:32], content[32:], _header(path)
    if hashlib.sha256(data).digest() != digest:
        problem = "damaged"
    elif not data.startswith(header):
        problem = "of another job, other code or another type of processor"
    else:
        try:
            progress: Progress = pickle.loads(data[len(header) :])  # noqa: S301 - ours, see above
        except Exception as error:  # whatever the objects in it raise
            problem = f"damaged ({type(error).__name__}: {error})"
        else:
            progress.resumed += 1
            return progress
    print(f"{path}: {problem}; the job begins anew", file=sys.stderr, flush=True)
    return None


def _header(path: Path) -> bytes:
    return " ".join([build_key(), *map(version, ("pydantic", "scipy")), path.stem]).encode()
