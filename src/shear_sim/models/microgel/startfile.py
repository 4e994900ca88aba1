"""Start configurations from a file: discs, and in a state file their links and springs too."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel import motion
from shear_sim.models.microgel.state import STICK, Discs, Pairs

NEEDED = ("x", "y", "radius")
OPTIONAL = ("vx", "vy", "spin", "mass", "inertia")
PAIR_FIELDS = ("i", "j", "nx", "ny", "spring")


def read_start(path: Path, file_digest: str | None) -> dict[str, NDArray[np.float64]]:
    """Return the arrays of a start file.

    A table (.csv, .parquet) has one row a disc: x, y, radius [m] and, if wanted, vx, vy (peculiar
    velocity [m/s]), spin (ω + γ̇/2 [1/s]), mass [kg/m], inertia [kg m]. A state (.npz) holds the
    same names as arrays and, if wanted, link_i, link_j, link_nx, link_ny, link_spring and
    contact_… of the same kind: discs, image of j, tangential elongation [m].

    Raises
    ------
    SimulationError
        If the file is not the one that the study was read with, lacks a column, holds values
        that are not finite or two discs in one place.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        msg = f"start file {path}: {error.strerror}"
        raise SimulationError(msg) from error
    if file_digest is not None and hashlib.sha256(content).hexdigest() != file_digest:
        msg = f"start file {path} has changed since the study was read: run the study anew"
        raise SimulationError(msg)
    arrays: dict[str, Any]
    if path.suffix == ".npz":
        with np.load(path) as data:
            arrays = {name: np.asarray(data[name], dtype=float) for name in data.files}
    else:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
        arrays = {str(name): table[name].to_numpy(dtype=float) for name in table}
    missing = [name for name in NEEDED if name not in arrays]
    if missing:
        msg = f"start file {path} has no column {', '.join(missing)} (it needs {', '.join(NEEDED)})"
        raise SimulationError(msg)
    for name in (*NEEDED, *OPTIONAL):
        if name in arrays and not np.isfinite(arrays[name]).all():
            msg = f"start file {path}: column {name} holds values that are not finite"
            raise SimulationError(msg)
    if (arrays["radius"] <= 0).any():
        msg = f"start file {path}: every radius must be positive"
        raise SimulationError(msg)
    position = np.column_stack([arrays["x"], arrays["y"]])
    close = KDTree(position).query_pairs(1e-9 * arrays["radius"].min(), output_type="ndarray")
    if len(close):
        msg = f"start file {path}: discs {close[0, 0]} and {close[0, 1]} are in one place"
        raise SimulationError(msg)
    return arrays


def given_pairs(arrays: dict[str, NDArray[np.float64]], kind: str) -> Pairs:
    """Return the links (``kind`` "link") or contacts of a state file with their springs."""
    fields = {name: arrays.get(f"{kind}_{name}") for name in PAIR_FIELDS}
    first = fields["i"]
    pairs = motion.empty_pairs(0 if first is None else len(first))
    for name, values in fields.items():
        target = getattr(pairs, name)
        target[:] = 0 if values is None else values
    # A pair is listed with its disc of lower number first; its spring does not mind.
    swap = pairs.i > pairs.j
    pairs.i[swap], pairs.j[swap] = pairs.j[swap], pairs.i[swap]
    pairs.nx[swap] *= -1
    pairs.ny[swap] *= -1
    return pairs


def join(links: Pairs, contacts: Pairs, discs: Discs) -> Pairs:
    """Return links followed by contacts; contacts with a spring count as touching before."""
    joined = Pairs(*(np.concatenate([a, b]) for a, b in zip(links, contacts, strict=True)))
    joined.state[len(links.i) :] = STICK
    if len(joined.i) and int(max(joined.i.max(), joined.j.max())) >= len(discs.x):
        last = len(discs.x) - 1
        msg = f"a pair of the start file names disc {joined.j.max()}, but the last disc is {last}"
        raise SimulationError(msg)
    return joined
