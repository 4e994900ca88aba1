"""What every scenario of soft particles is asked for, and how its particles come to rest."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Columns, SimulationError
from shear_sim.models.soft_particle.rings import Scales
from shear_sim.models.soft_particle.stability import at_most
from shear_sim.models.soft_particle.system import System

FloatArray = NDArray[np.float64]

SYRUP = 0.3  # drag on vertices / (m ω₁) in which rings come to rest
STILL = 1e-9  # kinetic energy of rings at rest / (k_b · rings)
LONGEST_REST = 2000  # T₁


class Scenario(ABC):
    """One run, from its start to its last record."""

    system: System
    unit: Scales
    rows: int  # number of records
    strokes: int  # or periods
    frame: tuple[float, float, float, float]  # of pictures: left, bottom, width, height [m]

    def prepare(self, periods: int) -> bool:  # noqa: ARG002 - not all need any
        """Make ``periods`` T₁ of a long preparation, or less; return whether it is over."""
        return True

    @abstractmethod
    def go_on(self) -> None:
        """Make the steps from one record to the next."""

    @abstractmethod
    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""

    @abstractmethod
    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run."""

    def planes(self) -> FloatArray | None:
        """Return the walls (W, 3) of a picture, n_x, n_y, position; None: those of the system."""
        return None

    def protocol(self) -> dict[str, Any]:
        """Return what is imposed, of a scenario that moduli are read from."""
        return {}

    def preparation(self) -> dict[str, float]:
        """Return what is to be said of the start."""
        return {}

    def checks(self, table: Columns) -> dict[str, float]:  # noqa: ARG002 - not all have any
        """Return what must be small."""
        return {}

    def divide(self, time: float, share: float) -> int:
        """Return in how many steps ``time`` [s] is made, see ``System.divide``."""
        self.refuse_unstable(share)
        return self.system.divide(time, share)

    def refuse_unstable(self, share: float) -> None:
        """Look at the particles as they are: a study is checked by its mean ring, see there.

        Raises
        ------
        SimulationError
            If ``share`` of the longest step without dashpots is not stable with them.
        """
        stable = self.system.stable_step
        longest = self.system.longest_step()
        if share * stable > longest:
            msg = (
                f"integrator.step = {share:g} is not stable with the dashpots of these particles: "
                f"at most {at_most(longest / stable)}, or less damping, inner_damping or drag"
            )
            raise SimulationError(msg)


@contextmanager
def more_drag(system: System, unit: Scales) -> Iterator[None]:
    """Let vertices have ``SYRUP`` · m ω₁ more drag for a while."""
    rules = system.rules
    system.rules = rules._replace(drag=rules.drag + SYRUP * unit.mass * unit.frequency)
    yield
    system.rules = rules


class Rest:
    """Rings that come to rest: until their kinetic energy is below ``STILL`` · k_b each.

    ``quenched``: all velocities are set to zero whenever the kinetic energy has passed a peak, and
    the last peak counts. A pack that swings as a whole, ever more slowly the more rings it has,
    then rests after some quarters of its period, and nothing holds up what falls.
    """

    def __init__(self, *, quenched: bool = False) -> None:
        self.quenched = quenched
        self.before = 0.0
        self.periods = 0

    def go_on(self, system: System, unit: Scales) -> bool:
        """Go on for T₁; return whether the rings are at rest.

        Raises
        ------
        SimulationError
            If they never are.
        """
        system.advance(math.ceil(unit.period / system.rules.step))
        kinetic = system.kinetic()
        still = STILL * unit.hinge * len(system.chains.closed)
        if self.quenched:
            if kinetic < self.before:
                if self.before < still:
                    return True
                system.stop()
                kinetic = 0.0
            self.before = kinetic
        elif kinetic < still:
            return True
        self.periods += 1
        if self.periods == LONGEST_REST:
            msg = (
                f"the rings are not at rest {LONGEST_REST} periods of their slowest vibration "
                "after they fell or were pressed together: more inner_damping or contact_damping, "
                "or a lower packing_fraction"
            )
            raise SimulationError(msg)
        return False
