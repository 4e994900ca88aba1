"""LAMMPS on the start of one of our simulations: the same discs, contact, shear and time step.

Units there: mean diameter, mean mass, contact spring k. `gran/hooke/history` is its fast style,
`granular` the one whose torques conserve angular momentum. Dashpots scale with the effective mass
there (gamma_n, gamma_t below are those of a pair of mean mass), all else is the same.
"""

import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np

from shear_sim.models.microgel.simulation import MicrogelSimulation
from shear_sim.models.microgel.state import OSCILLATION

STYLES = {  # pair_style, pair_coeff
    "hooke": ("gran/hooke/history 1.0 {kt!r} {gamma!r} {gammat!r} {mu!r} 1", "* *"),
    "granular": (
        "granular",
        "* * hooke 1 {gamma!r} tangential linear_history {kt!r} {ratio!r} {mu!r} damping {scaled}",
    ),
}
SCRIPT = """
units lj
dimension 2
atom_style sphere
newton on
comm_modify mode single vel yes
boundary p p p
read_data discs.data
pair_style {pair_style}
pair_coeff {pair_coeff}
neighbor 0.3 bin
neigh_modify delay 0 every 1 check yes
variable amplitude equal {amplitude!r}*ly
fix deform all deform 1 xy wiggle ${{amplitude}} {period!r} remap v flip yes
fix motion all nve/sphere disc
fix plane all enforce2d
timestep {step!r}
{output}
thermo 1000000
run {steps}
"""
OUTPUT = """compute p all pressure NULL virial
fix p all ave/time 1 1 1 c_p[1] c_p[2] c_p[4] file stress.out"""


def program() -> str:
    """Return the LAMMPS program, or end with what to do."""
    found = shutil.which("lmp")
    if found is None:
        msg = "no program lmp: install Debian's package lammps"
        raise SystemExit(msg)
    return found


def version() -> str:
    """Return the version that the program names."""
    done = subprocess.run([program(), "-h"], capture_output=True, text=True, check=True)
    found = re.search(r"Simulator - (.*)", done.stdout)
    return found.group(1).strip() if found else "unknown"


def write(folder: Path, simulation: MicrogelSimulation) -> None:
    """Write ``discs.data``: the discs of a simulation that has not begun."""
    d, c = simulation.discs, simulation.constants
    size, mass = 2 * float(d.radius.mean()), float(d.mass.mean())
    width, height = c.width / size, c.height / size
    ny = np.floor(d.y / c.height)
    x = (d.x - np.floor(d.x / c.width) * c.width) / size
    y = (d.y - ny * c.height) / size
    radius = d.radius / size
    density = d.mass / mass / (4 * math.pi / 3 * radius**3)  # of spheres
    lines = [
        f"discs\n\n{len(x)} atoms\n1 atom types\n\n0 {width:.17g} xlo xhi",
        f"0 {height:.17g} ylo yhi\n-0.7 0.7 zlo zhi\n0 0 0 xy xz yz\n\nAtoms # sphere\n",
    ]
    lines += [
        f"{a + 1} 1 {2 * radius[a]:.17g} {density[a]:.17g} {x[a]:.17g} {y[a]:.17g} 0"
        for a in range(len(x))
    ]
    # fix deform gives nobody the velocity of the flow: that of the first instant, in our terms.
    rate = _peak_rate(simulation)
    lines.append("\nVelocities\n")
    lines += [f"{a + 1} {rate * (y[a] - height / 2):.17g} 0 0 0 0 0" for a in range(len(x))]
    (folder / "discs.data").write_text("\n".join(lines) + "\n")


def run(
    folder: Path, simulation: MicrogelSimulation, style: str, steps: int, *, written: bool = True
) -> float:
    """Run ``steps`` steps from ``discs.data``; the stress is ``written`` at every one, as text.

    Returns the CPU time of the process [s].
    """
    d, c, clock = simulation.discs, simulation.constants, simulation.clock
    assert clock.kind == OSCILLATION
    unit = _time_unit(simulation)
    mass = float(d.mass.mean())
    gamma, gammat = (2 * eta / (mass / unit) for eta in (c.eta, c.etat))
    pair_style, pair_coeff = (
        line.format(
            kt=c.kt / c.k, gamma=gamma, gammat=gammat, ratio=gammat / gamma, mu=c.friction,
            scaled="mass_velocity",
        )
        for line in STYLES[style]
    )  # fmt: skip
    script = SCRIPT.format(
        pair_style=pair_style, pair_coeff=pair_coeff, amplitude=clock.amplitude,
        period=clock.per_period * clock.step / unit, step=clock.step / unit, steps=steps,
        output=OUTPUT if written else "",
    )  # fmt: skip
    (folder / "in.lmp").write_text(script)
    quiet = [program(), "-in", "in.lmp", "-screen", "none"]
    process = subprocess.Popen(quiet, cwd=folder, env={**os.environ, "OMP_NUM_THREADS": "1"})
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        msg = f"LAMMPS failed:\n{(folder / 'log.lammps').read_text()[-2000:]}"
        raise SystemExit(msg)
    return usage.ru_utime + usage.ru_stime


def stresses(folder: Path) -> np.ndarray:
    """Return what the last run has written: step, xx, yy, xy in units of k."""
    return np.loadtxt(folder / "stress.out")


def _time_unit(simulation: MicrogelSimulation) -> float:
    return math.sqrt(float(simulation.discs.mass.mean()) / simulation.constants.k)


def _peak_rate(simulation: MicrogelSimulation) -> float:
    clock = simulation.clock
    period = clock.per_period * clock.step / _time_unit(simulation)
    return clock.amplitude * 2 * math.pi / period
