"""Snapshots beside a result: a GSD file of the particles, and a Parquet table of the contacts.

GSD (schema ``hoomd``, 2D box, floats of 4 bytes) is what OVITO and freud read: positions, radii as
diameters, velocities, masses (1 without inertia), links and bars of shells as bonds, the number of
the cluster that they make as ``body``. Such programs have tolerances for lengths of order one: all
lengths are in ``unit_of_length`` of ``log``, the power of ten nearest to the mean diameter, itself
in metres (of hard discs in λ). ``log`` also has the spin of the particles, strain and stress of the
record under the names and in the units of the result, and walls n·x < position in the frame of the
positions; of soft particles the energy, and the core: its pressure times area [N], shared by the
vertices of a ring. The box of a cell without images has room for all particles; ``cell`` is then
its size.

The contact table has every contact in full precision and the model's own units (SI; hard discs: λ
and path rate/ξ₀), which its field metadata name, with the stress that the contacts add up to. Both
files are written whole; the table holds the checksum of the other.
"""

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import BAR, CONTACT_KINDS, LINK, Snapshot, SnapshotUnits
from shear_sim.tables import TableError, read_summary, read_table, write_table, write_whole

if TYPE_CHECKING:
    import gsd.hoomd

FloatArray = NDArray[np.float64]

KINDS = "link, contact (it holds), sliding, cohesive (link of two shells), bar (of one)"
#: Columns of a result that a frame repeats, as far as there are such.
LOGGED = (
    "time", "strain", "compression", "shear_stress", "pressure", "scaled_shear_stress",
    "scaled_pressure", "stress_xx", "stress_xy", "stress_yx", "stress_yy", "stress_floor",
    "periodic_love_weber_xx", "periodic_love_weber_xy", "periodic_love_weber_yx",
    "periodic_love_weber_yy", "outer_pressure", "force", "deflection",
)  # fmt: skip
BONDS = (LINK, BAR)  # what makes clusters of particles
_TYPES = ["particle", "fixed"]


def beside(result: Path) -> Path:
    """Return the folder with the snapshots of a result file: ``snapshots`` beside its own."""
    return result.absolute().parent.with_name("snapshots")


def paths(folder: Path, job: str) -> tuple[Path, Path]:
    """Return the GSD file and the contact table of a job; ``folder``: ``snapshots``."""
    return folder / f"{job}.gsd", folder / f"{job}.contacts.parquet"


def fields(units: SnapshotUnits) -> tuple[tuple[str, str, str], ...]:
    """Return name, unit and description of the columns of the contact table of a model."""
    sum_rule = (
        "Σ f_a r_b / area over the contacts of a snapshot, f the force on j, r = (x, y) and the "
        f"area that of the cell, compression positive, {units.stress}"
    )
    return (
        ("snapshot", "1", "number of the snapshot, a frame of the GSD file"),
        ("i", "1", "particle"),
        ("j", "1", "particle that it meets; −1 − w: wall w"),
        ("x", units.length, "from i to the image of j that it meets, or its nearest point"),
        ("y", units.length, "the same"),
        ("normal", units.force, f"force on j along (x, y) / distance, on i against it. {sum_rule}"),
        ("tangential", units.force, "force on j along (−y, x) / distance, on i against it"),
        ("kind", "", KINDS),
    )


def write_snapshots(
    folder: Path,
    job: str,
    snapshots: Sequence[Snapshot],
    columns: Mapping[str, FloatArray],
    units: SnapshotUnits,
) -> None:
    """Write the snapshots of a job, whole; the same snapshots give the same bytes.

    Parameters
    ----------
    folder : Path
        ``snapshots`` of the study's results; made if need be.
    job : str
        Its id.
    snapshots : sequence of Snapshot
        In the order of their records.
    columns : mapping of (rows,) arrays
        The result.
    units : SnapshotUnits
        Of the model.

    Raises
    ------
    OSError
        If they cannot be written.
    """
    import gsd.hoomd

    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as place:  # the library writes to a path
        path = Path(place) / "frames.gsd"
        unit = unit_of_length(snapshots[0])
        with gsd.hoomd.open(path, "w") as file:
            for snapshot in snapshots:
                log = {name: columns[name][snapshot.row] for name in LOGGED if name in columns}
                file.append(frame(snapshot, log, unit))
        content = path.read_bytes()
    gsd_file, table = paths(folder, job)
    write_whole(gsd_file, content)
    counts = [len(snapshot.i) for snapshot in snapshots]
    kinds = np.array(CONTACT_KINDS)
    values = {
        "snapshot": np.repeat(np.arange(len(snapshots), dtype=np.int32), counts),
        "i": np.concatenate([s.i for s in snapshots]),
        "j": np.concatenate([s.j for s in snapshots]),
        "x": np.concatenate([s.separation[:, 0] for s in snapshots]),
        "y": np.concatenate([s.separation[:, 1] for s in snapshots]),
        "normal": np.concatenate([s.normal for s in snapshots]),
        "tangential": np.concatenate([s.tangential for s in snapshots]),
        "kind": kinds[np.concatenate([s.kind for s in snapshots])].tolist(),
    }
    checksum = hashlib.sha256(content).hexdigest()
    write_table(table, values, fields(units), {"job": job, "gsd_sha256": checksum})


def unit_of_length(snapshot: Snapshot) -> float:
    """Return the power of ten that is nearest to the mean diameter, in the unit of the model."""
    return float(f"1e{round(math.log10(2 * snapshot.radius.mean()))}")


def frame(snapshot: Snapshot, log: Mapping[str, Any], unit: float) -> "gsd.hoomd.Frame":
    """Return a snapshot as a frame of GSD, lengths in ``unit``; ``log``: numbers beside it."""
    import gsd.hoomd

    made = gsd.hoomd.Frame()
    size = np.array([snapshot.width, snapshot.height])
    offset = snapshot.offset - snapshot.width * np.rint(snapshot.offset / snapshot.width)
    offset = offset if snapshot.periodic else 0.0
    made.configuration.step = snapshot.row
    made.configuration.dimensions = 2
    count = len(snapshot.radius)
    place = np.zeros((count, 3))
    middle = 0.5 * (size + np.array([offset, 0.0]))  # where a box of GSD has its origin
    place[:, :2] = in_cell(snapshot) - middle
    room = size
    if not snapshot.periodic:  # positions outside of its box are an error to who reads it
        most = np.abs(place[:, :2]) + snapshot.radius[:, None]
        room = np.maximum(size, 2 * most.max(axis=0))
    tilt = offset / snapshot.height
    made.configuration.box = np.array([*room / unit, 0.0, tilt, 0.0, 0.0], np.float32)
    velocity = np.zeros((count, 3), np.float32)
    velocity[:, :2] = snapshot.velocity / unit
    particles = made.particles
    particles.N = count
    particles.types = _TYPES
    particles.typeid = snapshot.fixed.astype(np.uint32)
    particles.position = (place / unit).astype(np.float32)
    particles.velocity = velocity
    particles.diameter = (2 * snapshot.radius / unit).astype(np.float32)
    if snapshot.mass is not None:
        particles.mass = snapshot.mass.astype(np.float32)
    particles.body = clusters(snapshot).astype(np.int32)
    links = np.isin(snapshot.kind, BONDS)
    made.bonds.N = int(links.sum())
    made.bonds.types = [CONTACT_KINDS[kind] for kind in BONDS]
    made.bonds.typeid = (snapshot.kind[links] == BAR).astype(np.uint32)
    made.bonds.group = np.column_stack([snapshot.i[links], snapshot.j[links]]).astype(np.uint32)
    made.log = {name: np.array([value], np.float64) for name, value in log.items()}
    made.log["unit_of_length"] = np.array([unit])
    made.log["particles/spin"] = snapshot.spin
    if snapshot.energy is not None:
        made.log["particles/energy"] = snapshot.energy
    if snapshot.core is not None:
        made.log["particles/core"] = snapshot.core
    made.log["periodic"] = np.array([snapshot.periodic], np.uint8)
    if not snapshot.periodic:  # of every frame: GSD takes what one lacks from the first
        made.log["cell"] = size / unit
    if len(snapshot.walls):
        made.log["walls"] = _displaced(snapshot.walls, -middle) / [1.0, 1.0, unit]
    return made


def _displaced(walls: FloatArray, by: FloatArray) -> FloatArray:
    """Return walls (W, 3), n_x, n_y and position, displaced ``by`` (2,)."""
    return walls + np.outer(walls[:, :2] @ by, [0.0, 0.0, 1.0])


def in_cell(snapshot: Snapshot) -> FloatArray:
    """Return the positions (N, 2) brought into the cell whose upper edge is displaced least."""
    x, y = snapshot.position.T
    if not snapshot.periodic:
        return np.column_stack([x, y])
    width, height = snapshot.width, snapshot.height
    offset = snapshot.offset - width * np.rint(snapshot.offset / width)
    up = np.floor(y / height)
    x, y = x - up * offset, y - up * height
    return np.column_stack([x - np.floor((x - y * offset / height) / width) * width, y])


def clusters(snapshot: Snapshot) -> NDArray[np.int64]:
    """Return the number of the cluster of linked particles that each (N,) is of; −1: alone."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = np.isin(snapshot.kind, BONDS)
    i, j, count = snapshot.i[links], snapshot.j[links], len(snapshot.radius)
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(count, count))
    body: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    body[np.bincount(body)[body] == 1] = -1
    return body


def read_snapshots(folder: Path, job: str) -> list[Snapshot]:
    """Read what `write_snapshots` wrote.

    Raises
    ------
    TableError
        If a file is missing or damaged.
    """
    import gsd.hoomd

    gsd_file, table = paths(folder, job)
    if problem := damage(folder, job):
        raise TableError(problem)
    values = read_table(table).columns
    numbers = np.unique(values["kind"], return_inverse=True)
    codes = np.array([CONTACT_KINDS.index(name) for name in numbers[0]], np.int8)
    kind = codes[numbers[1]]
    found = []
    with gsd.hoomd.open(gsd_file, "r") as file:
        ends = np.searchsorted(values["snapshot"], np.arange(len(file) + 1))
        for each, first, end in zip(file, ends[:-1], ends[1:], strict=True):
            unit = float(each.log.get("unit_of_length", [1.0])[0])  # metres in older files
            box = each.configuration.box.astype(np.float64)
            width, height = unit * np.asarray(each.log.get("cell", box[:2]))
            offset = float(box[3] * unit * box[1])
            centre = 0.5 * np.array([width + offset, height])
            walls = each.log.get("walls", np.zeros((0, 3))) * [1.0, 1.0, unit]
            part = {name: column[first:end] for name, column in values.items()}
            snapshot = Snapshot(
                row=int(each.configuration.step),
                width=float(width), height=float(height), offset=offset,
                periodic=bool(each.log["periodic"][0]),
                position=unit * each.particles.position[:, :2].astype(np.float64) + centre,
                velocity=unit * each.particles.velocity[:, :2].astype(np.float64),
                spin=each.log["particles/spin"],
                radius=0.5 * unit * each.particles.diameter.astype(np.float64),
                fixed=each.particles.typeid == 1,
                i=part["i"], j=part["j"], separation=np.column_stack([part["x"], part["y"]]),
                normal=part["normal"], tangential=part["tangential"], kind=kind[first:end],
                walls=_displaced(walls, centre),
                energy=each.log.get("particles/energy"), core=each.log.get("particles/core"),
                mass=each.particles.mass.astype(np.float64),
            )  # fmt: skip
            found.append(snapshot)
    return found


def damage(folder: Path, job: str) -> str | None:
    """Return what is wrong with the files of a job's snapshots; None: nothing."""
    gsd_file, table = paths(folder, job)
    try:
        written = read_summary(table)
        content = gsd_file.read_bytes()
    except TableError as error:
        return str(error)
    except OSError as error:
        return f"{gsd_file}: cannot be read ({error.strerror or error})"
    if written["job"] != job:
        return f"{table}: snapshots of another job, {written['job']}: copied over those of {job}?"
    if hashlib.sha256(content).hexdigest() != written["gsd_sha256"]:
        return f"{gsd_file}: damaged: its checksum is wrong"
    return None
