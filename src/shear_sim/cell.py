"""The sheared periodic cell: where images are, and how discs are brought back into it.

Image (n_x, n_y) of a disc is displaced by n_x (L_x, 0) + n_y (γ L_y − turns L_x, L_y): the cell is
re-gridded by whole widths, so any number of strain units is one and the same lattice.
"""

import numpy as np
from numpy.typing import NDArray

from shear_sim.compiled import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@jit
def turns_of(strain: float, width: float, height: float) -> int:
    """Return the whole widths by which the upper image is re-gridded at this strain."""
    return int(np.rint(strain * height / width))


@jit
def image_of(
    x: float, y: float, width: float, height: float, offset: float
) -> tuple[np.int32, np.int32]:
    """Return in which image (n_x, n_y) of the cell a place is, see `wrap_count`."""
    ny = np.floor(y / height)
    return np.int32(np.floor((x - ny * offset) / width)), np.int32(ny)


@jit
def wrap_count(
    x: Floats, y: Floats, width: float, height: float, offset: float, wx: Ints, wy: Ints
) -> bool:
    """Write to ``wx``, ``wy`` (N,) in which image of the cell each disc is.

    Positions (N,) and sizes in m; ``offset`` is the displacement of the upper image in x [m].
    Returns whether any of them has changed.
    """
    changed = 0
    for i in range(x.shape[0]):
        nx, ny = image_of(x[i], y[i], width, height, offset)
        changed |= (wx[i] ^ nx) | (wy[i] ^ ny)
        wx[i] = nx
        wy[i] = ny
    return changed != 0
