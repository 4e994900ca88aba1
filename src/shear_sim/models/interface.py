"""What the runner knows of a physical model, and nothing else."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from fractions import Fraction
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


#: What holds two particles apart or together: ``Snapshot.kind`` counts through them. Shells are
#: made of bars, from each vertex to the next; a cohesive link is between two shells.
CONTACT_KINDS = ("link", "contact", "sliding", "cohesive", "bar")
LINK, CONTACT, SLIDING, COHESIVE, BAR = range(5)


class SnapshotUnits(NamedTuple):
    """What the numbers of a model's snapshots are measured in, and what its contacts add up to."""

    length: str
    force: str
    #: Which stress Σ f_a r_b / area over the contacts of a snapshot is: a sentence without subject.
    stress: str


class Snapshot(NamedTuple):
    """N particles and C contacts at one record, in the units of the model (SI where it has them).

    Contact c pushes particle j along n = separation/|separation| with the force ``normal``, and
    along (−n_y, n_x) with ``tangential``, and i the other way. So Σ f_a r_b / area over contacts,
    f on j and r the separation, is the stress of the model's Love–Weber sum, compression positive,
    of discs the recorded one to round-off.

    Of soft particles (Σ f_a r_b + δ_ab Σ core) / area is that of springs and cores: exact without
    friction, and with it to 1 % of the pressure, as friction acts at one of the segments that a
    vertex touches. The recorded one has dashpots and inertia too, of up to 4 % of the pressure at
    the first record of a shear, which begins at once, and 2 % later. Between plates it has the
    forces on fixed vertices at the line y = 0: their y is to be taken as 0, so that their cores add
    nothing to yy. Of a box or a tissue the recorded one is that on walls or grips, and its area is
    not that of the picture: in a box without friction the sum over ``box_area`` is the mean of
    floor and lid to 1 %, and that of the sides to 2 %; rigid particles have no springs inside, and
    their part is missing.
    """

    row: int  # of the result table
    width: float  # of the cell
    height: float
    offset: float  # displacement of its upper image in x
    periodic: bool  # else the cell is only what a picture shows
    position: NDArray[np.float64]  # (N, 2), in the cell or any image of it
    velocity: NDArray[np.float64]  # (N, 2), of the flow and relative to it
    spin: NDArray[np.float64]  # (N,) angular velocity, counter-clockwise
    radius: NDArray[np.float64]  # (N,)
    fixed: NDArray[np.bool_]  # (N,) does not move by itself
    i: NDArray[np.int32]  # (C,)
    j: NDArray[np.int32]  # −1 − w is wall w
    #: (C, 2) from i to the image of j that it meets; of shells to the nearest point of a segment
    #: that ends at j
    separation: NDArray[np.float64]
    normal: NDArray[np.float64]
    tangential: NDArray[np.float64]
    kind: NDArray[np.int8]  # of CONTACT_KINDS; a contact pulls by its dashpot only
    walls: NDArray[np.float64]  # (W, 3) n_x, n_y, position: the half-plane n·x < position
    energy: NDArray[np.float64] | None = None  # (N,) stored in the particle that it is a vertex of
    core: NDArray[np.float64] | None = None  # (N,) its share of pressure times area of a core
    mass: NDArray[np.float64] | None = None  # (N,) per metre of depth; 1 where there is no inertia


class Simulation(Protocol):
    """One simulation: asked for its records, a block at a time.

    It may be pickled between two blocks: a copy goes on to the same bits.
    """

    threads: int  # cores that it may use, 1 at first; the bits are the same with any

    @property
    def snapshots(self) -> Sequence[Snapshot]:
        """What ``record.snapshots`` of the point asked for, so far; never changes the motion.

        Of a run that ends early also its last record.
        """

    @property
    def rows(self) -> int:
        """Number of records of the whole protocol."""

    @property
    def done(self) -> int:
        """Number of records made so far."""

    def advance(self, rows: int) -> None:
        """Make the next ``rows`` records (fewer at the end of the protocol).

        Before the first one, a part of a long preparation may come instead, as costly as they are.

        Raises
        ------
        SimulationError
            If the physics cannot go on; says where, when and what to do.
        """

    def columns(self) -> Columns:
        """Return the records made so far, every stored column, each of shape (done,)."""

    def summary(self) -> dict[str, Any]:
        """Return JSON-ready facts: derived, protocol, preparation, checks, flags."""


class Prepared(Protocol):
    """The start of one job, from which it runs as often as wanted, stepped in different ways.

    What the accuracy report asks of a model that steps in time, beside :class:`Model`: a function
    ``prepare(point, streams)`` of the package returns it.
    """

    schemes: tuple[str, ...]  # integrators by name
    scheme: str  # the one of the point

    def allows(self, factor: Fraction) -> bool:
        """Tell whether the protocol has whole steps when it has ``factor`` times as many."""

    def start(
        self,
        scheme: str | None = None,
        *,
        factor: Fraction = Fraction(1),
        displacement: float = 0.0,
        energy: bool = False,
    ) -> Simulation:
        """Return a simulation that starts from the prepared state.

        Parameters
        ----------
        scheme : str, optional
            Integrator; default: the point's own.
        factor : Fraction
            Steps per period, relative to the point's own. Where the model shortens steps by itself,
            its limits are divided by it too, but are never longer than by default. Records stay at
            the same times; where there are fewer steps than records, every step is recorded.
        displacement : float
            Particles start so far from the prepared state, each in its own (always the same)
            direction [mean radii].
        energy : bool
            Keep the energy balance too.

        Raises
        ------
        ValueError
            If the protocol would not have whole steps.
        """

    def distance(self, one: Any, other: Any) -> float:
        """Root mean square distance of the particles of two runs at their last records.

        In mean radii; every particle to the nearest image of its twin.
        """

    def energy_residual(self, simulation: Any) -> float:
        """Largest error of the energy balance of a run (``energy=True``) / energy lost in it."""


class Point(Section):
    """Everything that describes one simulation but seed and replicate.

    Each model has its own subclass, whose fields are the sections of its study files.
    """

    @property
    @abstractmethod
    def kind(self) -> str:
        """Name of the model, ``model.kind`` of the study file."""

    def resolved(self) -> Self:
        """Return the point with every default that follows from other parameters filled in."""
        return self

    @property
    def random(self) -> bool:
        """Whether anything is drawn at random, so that replicates differ."""
        return True

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
    """What a model package exports (``shear_sim.models.<kind>``).

    Where it applies also ``prepare``, see :class:`Prepared`, and ``contact_laws``: a function that
    takes the index of finished runs and returns a frame of ``law``, ``of_study``, ``compression``
    [m] and ``force`` [N/m] with a note on it.
    """

    POINT: type[Point]
    SNAPSHOT_UNITS: SnapshotUnits
    PHYSICS_VERSION: int  # raised with any change of numbers: part of every job id
    THREADS: str  # how many can share one job, for people: see `most_threads`
    COLUMNS: Sequence[Column]  # stored
    DERIVED: Sequence[Column]  # computed on reading
    #: What the summary of a run holds beside the rheology: for the tables, each with its dotted key
    #: there. Those with a unit are averaged over replicates, but in oscillatory shear.
    MEASURED: Sequence[tuple[Column, str]]

    @staticmethod
    def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
        """Return the derived columns that can be computed from the stored ones."""

    @staticmethod
    def most_threads(point: Any) -> int:
        """Return how many threads can share one job of ``point``; more would have nothing to do."""

    @staticmethod
    def start(point: Any, streams: Streams) -> Simulation:
        """Return a simulation; what takes long of its preparation is left to its ``advance``."""

    @staticmethod
    def compile_for(points: Sequence[Any]) -> None:
        """Compile (or load from the cache) all kernels that ``points`` need."""


class SimulationError(Exception):
    """The physics of one job cannot go on: retrying it changes nothing."""
