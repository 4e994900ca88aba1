"""Start configurations from a file: discs, and in a state file their links and springs too.

A table (.csv, .parquet) has one row a disc: x, y, radius [m] and, if wanted, vx, vy (peculiar
velocity [m/s]), spin (ω + γ̇/2 [1/s]), mass [kg/m], inertia [kg m]. A state (.npz) holds the same
names as arrays and, if wanted, link_i, link_j, link_nx, link_ny, link_spring and contact_… of the
same kind: two discs, the image of j, the tangential elongation [m]; …_spring_back is the second
elongation of ``sliding: reset``, by default the same.
"""

import io
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.packing import Cell, Packing, cell_height, content_digest

FloatArray = NDArray[np.float64]
NEEDED = ("x", "y", "radius")
OPTIONAL = ("vx", "vy", "spin", "mass", "inertia")
PAIR_FIELDS = ("i", "j", "nx", "ny", "spring", "spring_back")


class GivenPairs(NamedTuple):
    """Links or contacts of a state file; arrays of shape (P,)."""

    i: NDArray[np.int32]
    j: NDArray[np.int32]
    nx: NDArray[np.int32]
    ny: NDArray[np.int32]
    spring: FloatArray  # [m]
    spring_back: FloatArray  # the second elongation of sliding: reset [m]


class StartState(NamedTuple):
    """What a start file holds; N discs."""

    position: FloatArray  # (N, 2) [m]
    radius: FloatArray  # (N,) [m]
    velocity: FloatArray  # (N, 2), peculiar [m/s]
    spin: FloatArray  # (N,), peculiar [1/s]
    mass: FloatArray | None  # (N,) [kg/m]
    inertia: FloatArray | None  # (N,) [kg m]
    links: GivenPairs
    contacts: GivenPairs


def read_start(packing: Packing, cell: Cell) -> StartState:
    """Return the checked contents of the start file that ``packing`` names.

    Raises
    ------
    ValueError
        If the file cannot be read, is not the one that the study was read with, or cannot be
        simulated in this cell; says what is wrong with it.
    """
    if packing.file is None:
        msg = "start: file needs the name of the file"
        raise ValueError(msg)
    state = _read(packing.file, packing.file_digest)
    width, height = cell.width, cell_height(packing, cell)
    large, side = float(state.radius.max()), min(width, height)
    if side < 4 * large:
        unit = " (are they in metres, not micrometres?)" if large > 1e-2 * width / 1e-6 else ""
        msg = (
            f"its largest radius is {large:.4g} m{unit}: the shorter side of the cell, "
            f"{side:.4g} m, must be at least four of them"
        )
        raise ValueError(msg)
    if np.abs(state.position).max() > 1000 * max(width, height):
        msg = f"a disc lies more than 1000 cells away: the cell is {width:.4g} m × {height:.4g} m"
        raise ValueError(msg)
    moving = state.velocity.any() or state.spin.any()
    strained = state.links.spring.any() or len(state.contacts.i) > 0
    if (moving or strained) and packing.equilibration.max_steps > 0:
        msg = (
            "gives velocities or springs, which an equilibration would lose: start it as it is, "
            "packing.equilibration.max_steps: 0"
        )
        raise ValueError(msg)
    _refuse_coincident(state, None if cell.boundary == "open" else np.array([width, height]))
    return state


def _refuse_coincident(state: StartState, box: FloatArray | None) -> None:
    from scipy.spatial import KDTree

    position = state.position if box is None else state.position % box % box  # −1e-20 % 1 is 1
    tree = KDTree(position, boxsize=box)
    close = tree.query_pairs(1e-9 * state.radius.min(), output_type="ndarray")
    if len(close):
        first, second = sorted(int(disc) for disc in close[0])
        image = "" if box is None else ", maybe through an edge of the cell"
        msg = f"discs {first} and {second} (counted from 0) are in one place{image}"
        raise ValueError(msg)


@lru_cache(maxsize=4)
def _read(path: Path, file_digest: str | None) -> StartState:
    try:
        content = path.read_bytes()
    except OSError as error:
        msg = f"cannot be read ({error.strerror})"
        raise ValueError(msg) from None
    if file_digest is not None and content_digest(path, content) != file_digest:
        msg = "has changed since the study was read: run the study anew"
        raise ValueError(msg)
    arrays = _arrays(path, content)
    if missing := [name for name in NEEDED if name not in arrays]:
        msg = f"has no column {', '.join(missing)}; it needs {', '.join(NEEDED)}"
        raise ValueError(msg)
    n = len(arrays["x"])
    if n == 0:
        msg = "holds no disc"
        raise ValueError(msg)
    for name in (*NEEDED, *OPTIONAL):
        if name in arrays and len(arrays[name]) != n:
            msg = f"has {n} values of x and {len(arrays[name])} of {name}"
            raise ValueError(msg)
    for name in ("radius", "mass", "inertia"):
        if name in arrays and (arrays[name] <= 0).any():
            msg = f"column {name}: every value must be positive, not {arrays[name].min():g}"
            raise ValueError(msg)
    zero = np.zeros(n)
    links, contacts = _pairs(arrays, "link", n), _pairs(arrays, "contact", n)
    _refuse_doubles(links, contacts)
    return StartState(
        position=np.column_stack([arrays["x"], arrays["y"]]),
        radius=arrays["radius"],
        velocity=np.column_stack([arrays.get("vx", zero), arrays.get("vy", zero)]),
        spin=arrays.get("spin", zero),
        mass=arrays.get("mass"),
        inertia=arrays.get("inertia"),
        links=links,
        contacts=contacts,
    )


def _arrays(path: Path, content: bytes) -> dict[str, FloatArray]:
    """Return the named columns that mean something here, as one-dimensional finite numbers."""
    known = (*NEEDED, *OPTIONAL, *(f"{k}_{f}" for k in ("link", "contact") for f in PAIR_FIELDS))
    raw: dict[str, Any]
    try:
        if path.suffix == ".npz":
            with np.load(io.BytesIO(content), allow_pickle=False) as data:
                raw = {name: data[name] for name in known if name in data.files}
        else:
            import pandas as pd

            read = pd.read_parquet if path.suffix == ".parquet" else pd.read_csv
            table = read(io.BytesIO(content))
            raw = {name: table[name].to_numpy() for name in known if name in table}
    except Exception as error:  # the readers raise whatever they like on bytes that are not theirs
        kind = {".npz": "NumPy archive", ".parquet": "Parquet table"}.get(path.suffix, "CSV table")
        msg = f"is no {kind} ({str(error).splitlines()[0] if str(error) else type(error).__name__})"
        raise ValueError(msg) from None
    arrays = {}
    for name, values in raw.items():
        try:
            array = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            msg = f"column {name} holds something that is no number"
            raise ValueError(msg) from None
        if array.ndim != 1:
            msg = f"{name} has {array.ndim} dimensions instead of one"
            raise ValueError(msg)
        if not np.isfinite(array).all():
            msg = f"column {name} holds values that are not finite"
            raise ValueError(msg)
        arrays[name] = array
    return arrays


def _pairs(arrays: dict[str, FloatArray], kind: str, n: int) -> GivenPairs:
    """Return the links (``kind`` "link") or contacts of a state file."""
    fields = {name: arrays.get(f"{kind}_{name}") for name in PAIR_FIELDS}
    if all(values is None for values in fields.values()):
        count = 0
    elif fields["i"] is None or fields["j"] is None:
        msg = f"has {kind}s without {kind}_i and {kind}_j"
        raise ValueError(msg)
    else:
        count = len(fields["i"])
    columns = []
    for name, values in fields.items():
        column = np.zeros(count) if values is None else values
        if len(column) != count:
            msg = f"has {count} values of {kind}_i and {len(column)} of {kind}_{name}"
            raise ValueError(msg)
        if not name.startswith("spring") and (column != np.rint(column)).any():
            msg = f"{kind}_{name} must hold whole numbers"
            raise ValueError(msg)
        columns.append(column)
    i, j, nx, ny = (column.astype(np.int32) for column in columns[:4])
    for disc in (*i, *j):
        if not 0 <= disc < n:
            msg = f"a {kind} names disc {disc} of discs 0 to {n - 1}"
            raise ValueError(msg)
    if (i == j).any():
        msg = f"a {kind} joins disc {i[i == j][0]} to itself"
        raise ValueError(msg)
    spring = columns[4]
    back = spring if fields["spring_back"] is None else columns[5]
    return GivenPairs(i, j, nx, ny, spring, back)


def _refuse_doubles(links: GivenPairs, contacts: GivenPairs) -> None:
    seen = set()
    for pairs in (links, contacts):
        for a, b, nx, ny in zip(*pairs[:4], strict=True):
            i, j, image = (a, b, (nx, ny)) if a < b else (b, a, (-nx, -ny))
            if (i, j, image) in seen:
                msg = f"lists discs {i} and {j} twice, through the same image"
                raise ValueError(msg)
            seen.add((i, j, image))
