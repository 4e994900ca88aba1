"""Packings brought to rest, and contact laws of the user's own."""

import os
import subprocess
import sys

import pytest

CUSTOM = """
from shear_sim.models.microgel import laws
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.models.microgel.simulation import (
    kernels_for, make_constants, make_discs, make_work,
)
import numpy as np
law = laws.custom("def contact_force(d, D, k, repulsion):\\n    return -4 * k * (D - d)\\n")
discs = make_discs(np.zeros((2, 2)), np.ones(2), density=1.0)
constants = make_constants(MicrogelPoint(), discs, 9.0, 9.0, 1.0)._replace(step_dashpot=1e9)
work = make_work(2)
work.closest[:] = 1.0, 4.0
print(kernels_for(law, True).substep(constants, work, 0.0) / constants.step_stiffness)
"""


@pytest.mark.parametrize("cached", [False, True])
def test_a_users_law_can_be_loaded_from_the_cache(tmp_path_factory, cached):
    """Compiled kernels name the module of the user's function, which the next process must know.

    The stiffness of 4 k halves the longest substep.
    """
    folder = tmp_path_factory.getbasetemp() / "law_cache"
    for _ in range(2 if cached else 1):
        done = subprocess.run(
            [sys.executable, "-c", CUSTOM], capture_output=True, text=True, check=False,
            env={**os.environ, "SHEAR_SIM_CACHE": str(folder)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-500:]
        assert float(done.stdout) == pytest.approx(0.5, rel=1e-3)
