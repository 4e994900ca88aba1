"""What the runner knows of a physical model, and nothing else."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from shear_sim.schema import Section
from shear_sim.streams import Streams

Columns = dict[str, NDArray[np.float64]]


class Column(NamedTuple):
    """One column of a result table."""

    name: str
    unit: str
    description: str


class Simulation(Protocol):
    """A prepared simulation: asked for its records, a block at a time."""

    @property
    def rows(self) -> int:
        """Number of records of the whole protocol."""

    @property
    def done(self) -> int:
        """Number of records made so far."""

    def advance(self, rows: int) -> None:
        """Make the next ``rows`` records (fewer at the end of the protocol).

        Raises
        ------
        SimulationError
            If the physics cannot go on; says where, when and what to do.
        """

    def columns(self) -> Columns:
        """Return the records made so far, every stored column, each of shape (done,)."""

    def summary(self) -> dict[str, Any]:
        """Return JSON-ready facts: derived, protocol, preparation, checks, flags."""


class Point(Section):
    """Everything that describes one simulation but seed and replicate.

    Each model has its own subclass, whose fields are the sections of its study files.
    """

    @property
    def kind(self) -> str:
        """Name of the model, ``model.kind`` of the study file."""
        raise NotImplementedError(type(self).__name__)

    def resolved(self) -> Self:
        """Return the point with every default that follows from other parameters filled in."""
        return self

    def check_files(self) -> None:
        """Check the contents of the files that the point names.

        Raises
        ------
        Impossible
            If a file cannot be simulated; says what is wrong with it.
        """

    @property
    def recorded(self) -> tuple[str, ...] | None:
        """Stored columns that the result table shall hold; None: all."""
        return None


class Model(Protocol):
    """What a model package exports (``shear_sim.models.<kind>``)."""

    POINT: type[Point]
    PHYSICS_VERSION: int  # raised with any change of numbers: part of every job id
    COLUMNS: Sequence[Column]  # stored
    DERIVED: Sequence[Column]  # computed on reading

    @staticmethod
    def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
        """Return the derived columns that can be computed from the stored ones."""

    @staticmethod
    def start(point: Any, streams: Streams) -> Simulation:
        """Prepare a simulation: packing, equilibration."""

    @staticmethod
    def compile_for(points: Sequence[Any]) -> None:
        """Compile (or load from the cache) all kernels that ``points`` need."""


class SimulationError(Exception):
    """The physics of one job cannot go on: retrying it changes nothing."""
