"""Kernels that most tests of microgels use, compiled once."""

import pytest

from shear_sim.compiled import compiling
from shear_sim.models import microgel


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile in the process that comes first; the others wait for it, and find them kept."""
    with compiling("microgel"):
        microgel.compile_for([microgel.POINT()])
