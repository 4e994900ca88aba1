"""Walls: rigid half-planes, as they are described."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from shear_sim.cell import Floats, Ints
from shear_sim.models.soft_particle.checks import finite, not_negative

UNIT = 1e-9  # by which the length of a normal may be off 1


class Wall(NamedTuple):
    """A rigid half-plane n·x < position, n = (nx, ny) towards the particles."""

    nx: float
    ny: float
    position: float  # [m]
    velocity: float = 0.0  # along n [m/s]
    slide: float = 0.0  # along (−n_y, n_x) [m/s]
    mass: float = 0.0  # [kg/m] of a wall that moves by itself under ``load``; 0: it does not
    load: float = 0.0  # [N/m] towards the particles
    damping: float = 0.0  # [N s/m²]

    def check(self) -> None:
        """Refuse what is no wall.

        Raises
        ------
        ValueError
            Says which number is wrong.
        """
        finite(**self._asdict())
        not_negative(mass=self.mass, damping=self.damping)
        size = math.hypot(self.nx, self.ny)
        if abs(size - 1.0) > UNIT:
            msg = f"(nx, ny) = ({self.nx:g}, {self.ny:g}) has the length {size:.6g}: 1 is needed"
            raise ValueError(msg)
        if self.mass == 0.0 and (self.load != 0.0 or self.damping != 0.0):
            msg = "load and damping have no effect on a wall that does not move by itself: a mass"
            raise ValueError(msg)


def check_walls(walls: Sequence[Wall], chain: Ints, x: Floats, y: Floats) -> None:
    """Refuse what are no walls, and vertices (V,) of chains (V,) that start behind one.

    Raises
    ------
    ValueError
        Says which wall, or which particle.
    """
    for number, wall in enumerate(walls):
        try:
            wall.check()
        except ValueError as error:
            msg = f"wall {number}: {error}"
            raise ValueError(msg) from None
        height = x * wall.nx + y * wall.ny - wall.position
        if height.min() <= 0.0:
            k = int(height.argmin())
            msg = (
                f"a vertex of particle {chain[k]} is {-height[k]:g} m behind wall {number}, which "
                f"is ({wall.nx:g}, {wall.ny:g})·x < {wall.position:g}"
            )
            raise ValueError(msg)
