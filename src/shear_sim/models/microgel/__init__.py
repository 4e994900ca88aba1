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
PHYSICS_VERSION = 5  # raised with any change of numbers; part of every job id
THREADS = True
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
    "prepare",
    "start",
]


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
