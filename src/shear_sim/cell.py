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
def wrap_count(
    x: Floats, y: Floats, width: float, height: float, offset: float, wx: Ints, wy: Ints
) -> bool:
    """Write to ``wx``, ``wy`` (N,) in which image of the cell each disc is.

    Positions (N,) and sizes in m; ``offset`` is the displacement of the upper image in x [m].
    Returns whether any of them has changed.
    """
    changed = 0
    for i in range(x.shape[0]):
        ny = np.floor(y[i] / height)
        nx = np.floor((x[i] - ny * offset) / width)
        changed |= (wx[i] ^ np.int32(nx)) | (wy[i] ^ np.int32(ny))
        wx[i] = np.int32(nx)
        wy[i] = np.int32(ny)
    return changed != 0
