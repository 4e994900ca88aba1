"""Kernels of hard discs, compiled once."""

import pytest

from shear_sim.compiled import compiling
from shear_sim.models import hard_disc


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile in the process that comes first; the others wait for it, and find them kept."""
    with compiling("hard_disc"):
        hard_disc.compile_for([])
