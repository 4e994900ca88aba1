"""Microgel: bidisperse visco-elastic discs, with friction and permanent crosslinks.

Source: Braschler's particleShear manual, parts 1 to 4 (equations S1-…, tables S2-…, S4-…).

Reading order: ``parameters`` (what there is), ``kernels`` (its equations), ``simulation``,
``preparation``.
"""

from collections.abc import Sequence

from shear_sim.models.interface import Prepared, Simulation, SnapshotUnits
from shear_sim.models.microgel.law_curves import contact_laws
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.models.microgel.tensors import COLUMNS, DERIVED, derive
from shear_sim.streams import Streams

POINT = MicrogelPoint
PHYSICS_VERSION = 6  # raised with any change of numbers; part of every job id
THREADS = "one for each 1,024 discs, and a single one with record.energy"
MEASURED = ()
SNAPSHOT_UNITS = SnapshotUnits(
    "m",
    "N/m",
    "is the tensor periodic_love_weber of the result (periodic_overall, from which shear_stress "
    "and pressure are read, has torques and spins too)",
)

__all__ = [
    "COLUMNS",
    "DERIVED",
    "MEASURED",
    "PHYSICS_VERSION",
    "POINT",
    "SNAPSHOT_UNITS",
    "THREADS",
    "compile_for",
    "contact_laws",
    "derive",
    "most_threads",
    "prepare",
    "start",
]


def most_threads(point: MicrogelPoint) -> int:
    """Return one for each strip of discs; the energy balance is summed pair by pair, by one."""
    if point.record.energy:
        return 1
    from shear_sim.models.microgel.startfile import read_start
    from shear_sim.models.microgel.strips import edges_of  # loads Numba

    packing = point.packing
    given = packing.start == "file"
    discs = len(read_start(packing, point.cell).radius) if given else packing.discs
    return len(edges_of(discs)) - 1


def start(point: MicrogelPoint, streams: Streams) -> Simulation:
    """Return a run that begins with its preparation: packing, rest, links, rest."""
    from shear_sim.models.microgel.preparation import MicrogelRun  # loads Numba

    return MicrogelRun(point, streams)


def compile_for(points: Sequence[MicrogelPoint]) -> None:
    """Compile all kernels that ``points`` need, or load them from the cache."""
    from shear_sim.models.microgel.preparation import compile_kernels

    compile_kernels(points)


def prepare(point: MicrogelPoint, streams: Streams) -> Prepared:
    """Prepare a packing from which simulations start that are stepped in different ways."""
    from shear_sim.models.microgel.prepared import PreparedMicrogel

    return PreparedMicrogel(point, streams)
