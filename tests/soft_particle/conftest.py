"""Kernels of soft particles, compiled once."""

import pytest

from shear_sim.compiled import compiling
from shear_sim.models import soft_particle


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile in the process that comes first; the others wait for it, and find them kept."""
    with compiling("soft_particle"):
        soft_particle.compile_for([])
