"""Hard cases of the microgel model: what must hold, what was found, and at what cost.

.venv/bin/python analysis/hard_cases.py [NAME ...]
.venv/bin/python analysis/hard_cases.py --passing 4

Prints one row of a markdown table for each case, or for those named; analysis/hard_cases.md is what
it printed. CPU s is the time of the whole run, without its preparation, on one core. What must hold
in each: the run is refused or stopped with a reason, or

- every record is finite;
- the energy put in is stored or lost, to 1 % of what was put in, lost or exchanged with motion,
  whichever is most. There are two exceptions. Where free discs collide, all energy passes through
  single contacts and chains of them, and velocity Verlet keeps the energy of a vibration to
  (h ω)²/4: here with ω² = 4 k/m, the fastest of a chain of the lightest discs, and h the substep
  at first touch. And where two discs are shot at each other, the force grows as 1/d: the
  trapezoidal rule over a fifth of d errs by 0.85 % of the work on the way in and, at most, as much
  on the way out; through the centre one substep (they are never shorter than a step / 4096) sees
  the force of the clamp from the wrong side, another 0.55 %;
- both stress tensors are symmetric to 1e-13 of Σ|σ_ab| of the periodic one (at most 2 Σ|F||l|/V);
- momentum is conserved to 1e-12 (the sum of 1e5 rounded impulses);
- nobody passes through anybody, looked at four times in every whole step (in a run of its own, with
  substeps by the same limits): a touching pair has passed if, since it was last seen touching and
  farther apart than D/10, it has turned by more than a right angle and its way (a straight line)
  led closer than D/10. Nobody who touches may move by D, relative to the other, between two looks,
  or it could not be told;
- a run that is advanced record by record, as one that is resumed, with or without its energy
  balance, has the same bits as one in one go.

Through the centre of each other, discs pass with more than 6 k D², the height of the clamped law.
Past it, within D/10, they need less: k D² (ln(D/d) − 1 + d/D), which is 1.4 k D² at d = D/10, and
neighbours may push. --passing looks where that happens: at an amplitude of 2, for ways of linking,
packing fractions, viscosities and frequencies at the ends of the range, in several packings each;
where discs pass, also with four times the steps and limits of substeps four times finer, which
tells a property of the law from an error of the step.
"""

import argparse
import itertools
import math
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.motion import segment, strain_at
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.simulation import CORE, MicrogelSimulation, make_work
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]
ENERGY, SYMMETRY, MOMENTUM = 0.01, 1e-13, 1e-12
LOOKS = 4  # per step


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes
    ----------
    sections : dict
        Sections of the point as in a study file; the rest is default.
    energy : float | None
        Limit of the residual of the energy balance; None: that of collisions of free discs.
    passing : int | None
        Most pairs of discs that may pass through each other; None: any number.
    refused : str
        What the reason must say if the case is to be refused or stopped; empty: it must run.
    discs : callable
        Arrays of a start file, if any.
    """

    sections: dict[str, Any]
    energy: float | None = ENERGY
    passing: int | None = 0
    refused: str = ""
    discs: Callable[[], dict[str, Any]] | None = None


@dataclass
class Found:
    """What a case gave: errors relative to their own scales, or the reason why it did not run."""

    reason: str = ""
    finite: bool = False
    energy: float = np.nan
    collisions: float = np.nan  # what single contacts may miss
    asymmetry: float = np.nan
    momentum: float = np.nan
    passing: int = 0
    closest: float = np.nan  # d/D
    farthest: float = np.nan  # way of two touching discs, relative to each other, in a look / D
    same: bool = False
    substeps: float = np.nan
    seconds: float = np.nan


def crosslinked(**sections: Any) -> dict[str, Any]:
    """Return the sections of the default model, crosslinked particles."""
    return sections


def loose(friction: float = 0.01, **sections: Any) -> dict[str, Any]:
    """Return the sections of loose discs."""
    return {"model": {"links": {"cut": "none"}, "friction": friction}, **sections}


def amplitude(value: float, **more: float) -> dict[str, Any]:
    """Return oscillatory shear of this amplitude."""
    return {"strain_amplitude": value, **more}


REST = {"max_steps": 0}
STILL = {
    "strain_amplitude": 1e-9, "pre_periods": 1, "periods": 0.5, "post_periods": 0,
    "relative_frequency": 0.2,
}  # fmt: skip
SHOT, THROUGH = 0.017, 0.0225  # see above


def head_on(energy: float) -> Callable[[], dict[str, Any]]:
    """Return two discs of 20 µm that meet with a kinetic energy of ``energy`` k D² (E = 8 kPa)."""

    def discs() -> dict[str, Any]:
        k, radius, density = np.pi * 8000 / 8, 10e-6, 1000.0
        mass = np.pi * density * radius**2
        speed = np.sqrt(energy * k * (2 * radius) ** 2 / mass)  # Σ m v²/2 of both
        x = 250e-6 + np.array([-1.1, 1.1]) * radius
        y = 250e-6 + np.array([0.0, 1e-4]) * radius
        return {"x": x, "y": y, "radius": [radius] * 2, "vx": [speed, -speed], "vy": [0, 0]}

    return discs


def doubled(distance: float) -> Callable[[], dict[str, Any]]:
    """Return a loose square packing in which every disc has a twin ``distance`` radii away."""

    def discs() -> dict[str, Any]:
        radius = 20e-6
        x, y = (g.ravel() for g in np.meshgrid(*[np.arange(8) * 62.5e-6 + 31e-6] * 2))
        turn = np.arange(64.0)
        twin = distance * radius
        return {
            "x": np.concatenate([x, x + twin * np.cos(turn)]),
            "y": np.concatenate([y, y + twin * np.sin(turn)]),
            "radius": np.full(128, radius),
        }

    return discs


def stretched(cells: float) -> Callable[[], dict[str, Any]]:
    """Return five discs in a closed chain through the cell's edges, links ``cells`` widths long.

    The chain climbs by one cell height, so that shear stretches it; each link is in tension and
    balances its neighbours.
    """

    def discs() -> dict[str, Any]:
        width, n = 500e-6, 5
        x = 50e-6 + cells * width * np.arange(n + 1)
        y = 50e-6 + width / n * np.arange(n + 1)
        image = np.array([np.floor(x / width), np.floor(y / width)])
        return {
            "x": (x - image[0] * width)[:n], "y": (y - image[1] * width)[:n],
            "radius": np.full(n, 20e-6), "link_i": np.arange(n), "link_j": np.arange(1, n + 1) % n,
            "link_nx": np.diff(image[0]), "link_ny": np.diff(image[1]), "link_spring": np.zeros(n),
        }  # fmt: skip

    return discs


def snapping() -> dict[str, Any]:
    """Return two linked discs a whole cell apart, let go: they meet with 60 kD², and pass."""
    return {
        "x": [100e-6, 101e-6], "y": [100e-6, 130e-6], "radius": [20e-6] * 2, "link_i": [0],
        "link_j": [1], "link_nx": [1], "link_ny": [0], "link_spring": [0],
    }  # fmt: skip


def from_file(links: str = "none", **more: Any) -> dict[str, Any]:
    """Return the sections of a start file, run as it is unless ``more`` says otherwise."""
    return {
        "packing": {"start": "file", "equilibration": REST},
        "model": {"links": {"cut": links}, "damping": {"decay": 1.0}},
        "shear": STILL,
    } | more


JAMMING = {
    f"φ = {phi:.2f}, μ = {mu:g}": Case(
        loose(mu, packing={"packing_fraction": phi}, shear=amplitude(0.1)), energy=None
    )
    for phi in (0.80, 0.84, 0.86, 0.90)
    for mu in (0.0, 1.0)
}
CASES = {
    "A = 2, links, φ = 2": Case(
        crosslinked(packing={"packing_fraction": 2.0}, shear=amplitude(2.0))
    ),
    "A = 2, loose, μ = 1": Case(loose(1.0, shear=amplitude(2.0))),
    "A = 2, links, φ = 2, linear law": Case(
        crosslinked(
            packing={"packing_fraction": 2.0},
            shear=amplitude(2.0),
            model={"contact_law": {"kind": "linear"}},
        ),
        passing=None,
    ),
    "head-on, 3 kD²": Case(from_file(), energy=SHOT, discs=head_on(3.0)),
    "head-on, 5.5 kD² (clamp)": Case(from_file(), energy=SHOT, discs=head_on(5.5)),
    "head-on, 20 kD² (through)": Case(
        from_file(), energy=THROUGH, discs=head_on(20.0), passing=None
    ),
    "coincident starts": Case(
        from_file(packing={"start": "file"}), discs=doubled(0.0), refused="in one place"
    ),
    "nearly coincident starts": Case(
        from_file(packing={"start": "file"}, shear=amplitude(0.2)), energy=None, discs=doubled(1e-6)
    ),
    "links of 0.6 cells": Case(from_file(links="file", shear=amplitude(0.2)), discs=stretched(0.6)),
    "links of 1.2 cells": Case(from_file(links="file", shear=amplitude(0.2)), discs=stretched(1.2)),
    "a link of 1 cell, let go": Case(from_file(links="file"), discs=snapping, passing=None),
    **JAMMING,
    "A = 1e-4": Case(crosslinked(shear=amplitude(1e-4))),
    "steady shear to 20": Case(
        loose(0.3, shear={"kind": "steady", "relative_rate": 0.05, "strain": 20.0})
    ),
    "steady shear to 20, links": Case(
        crosslinked(shear={"kind": "steady", "relative_rate": 0.05, "strain": 20.0})
    ),
    "μ = 0": Case(loose(0.0)),
    "μ = 1e-5": Case(loose(1e-5)),
    "μ = 10": Case(loose(10.0)),
    "E = 1 Pa": Case(crosslinked(model={"young_modulus": 1.0})),
    "E = 1 GPa": Case(crosslinked(model={"young_modulus": 1e9})),
    "crystal": Case(
        loose(
            0.3,
            packing={"start": "hexagonal", "size_ratio": 1.0, "discs": 140, "columns": 10,
                     "packing_fraction": 1.2},
        )
    ),
    "size ratio 1": Case(loose(0.3, packing={"size_ratio": 1.0})),
    "size ratio 3": Case(loose(0.3, packing={"size_ratio": 3.0})),
    "N = 4": Case(loose(packing={"discs": 4}), refused="could touch twice"),
    "N = 4, φ = 0.5": Case(loose(packing={"discs": 4, "packing_fraction": 0.5})),
    "relative viscosity 0.001": Case(crosslinked(model={"relative_viscosity": 0.001})),
    "relative viscosity 10": Case(crosslinked(model={"relative_viscosity": 10.0})),
    "relative frequency 0.001": Case(crosslinked(shear=amplitude(0.2, relative_frequency=0.001))),
    "relative frequency 1": Case(crosslinked(shear=amplitude(0.2, relative_frequency=1.0))),
    "cell 10 × longer than high": Case(
        crosslinked(
            packing={"discs": 400}, cell={"width": 1000e-6, "height": 100e-6},
            model={"links": {"cuts": 60}},
        )
    ),
}  # fmt: skip


@contextmanager
def point_of(case: Case) -> Iterator[MicrogelPoint]:
    """Give the validated point of a case; its start file exists meanwhile."""
    sections = {name: dict(section) for name, section in case.sections.items()}
    with tempfile.TemporaryDirectory() as folder:
        if case.discs is not None:
            path = Path(folder) / "start.npz"
            np.savez(path, **{k: np.asarray(v, float) for k, v in case.discs().items()})
            sections["packing"]["file"] = path
        yield MicrogelPoint.model_validate(sections)


class Passing:
    """Counts pairs of discs that pass through each other, step by step."""

    def __init__(self, n: int) -> None:
        self.way = np.zeros((n, n, 2))  # from i to j when last seen outside the core, in D
        self.seen = np.full((n, n), -1)  # when last seen touching
        self.count = 0
        self.closest = np.inf
        self.farthest = 0.0

    def look(self, simulation: MicrogelSimulation) -> None:
        """Compare the places of all touching pairs with those of the last step."""
        pairs, d, c, clock = (
            simulation.pairs, simulation.discs, simulation.constants, simulation.clock,
        )  # fmt: skip
        last = max((simulation.done - 1) * clock.every - 1, 0)
        strain, rate = strain_at(clock, segment(clock, last), last, 1.0)
        offset = strain * c.height - simulation.work.turns[0] * c.width
        i, j = pairs.i, pairs.j
        dx = d.x[j] - d.x[i] + pairs.nx * c.width + pairs.ny * offset
        dy = d.y[j] - d.y[i] + pairs.ny * c.height
        D = d.radius[i] + d.radius[j]
        touching = np.hypot(dx, dy) < D
        if not touching.any():
            return
        i, j, dx, dy, D = (values[touching] for values in (i, j, dx, dy, D))
        now = np.column_stack([dx, dy]) / D[:, None]
        speed = np.hypot(d.cx[j] - d.cx[i] + rate * dy, d.cy[j] - d.cy[i])
        distance = np.hypot(*now.T)
        self.closest = min(self.closest, float(distance.min()))
        self.farthest = max(self.farthest, float((speed / D).max() * clock.step * clock.every))

        before = self.way[i, j]
        known = self.seen[i, j] == simulation.done - 1
        across = np.abs(before[:, 0] * now[:, 1] - before[:, 1] * now[:, 0])
        near = across < CORE * np.hypot(*(now - before).T)  # the line from there to here
        turned = (before * now).sum(axis=1) < 0
        outside = distance >= CORE
        self.count += int((known & near & turned & outside).sum())
        fresh = outside | ~known
        self.way[i[fresh], j[fresh]] = now[fresh]
        self.seen[i, j] = simulation.done


def count_passing(case: Case, seed: int, factor: int) -> Passing:
    """Run a case with ``factor`` times its steps and look who passes through whom."""
    looks = begin(case, energy=False, factor=LOOKS * factor, seed=seed)
    looks.constants = begin(case, energy=False, factor=factor, seed=seed).constants
    passing = Passing(len(looks.discs.x))
    while looks.done < looks.rows:
        looks.advance(1)
        passing.look(looks)
    return passing


def print_passing(packings: int) -> None:
    """Print in how many packings discs pass through each other at an amplitude of 2."""
    titles = (
        "links", "φ", "relative viscosity", "relative frequency", "steps", "packings with passing",
        "pairs that pass", "packings closer than D/10", "closest d/D",
    )  # fmt: skip
    print(f"| {' | '.join(titles)} |\n{'| --- ' * len(titles)}|")
    slow = itertools.product(("cells", "none", "bulk"), (1.0, 1.5, 2.0), (0.01, 0.1), (0.025,))
    fast = itertools.product(("cells", "lines", "bulk", "none"), (1.5, 2.0), (0.1,), (0.14,))
    for cut, fraction, viscosity, frequency in (*slow, *fast):
        case = Case({
            "packing": {"packing_fraction": fraction},
            "shear": amplitude(2.0, relative_frequency=frequency),
            "model": {"links": {"cut": cut}, "relative_viscosity": viscosity},
        })  # fmt: skip
        for factor in (1, 4):
            found = [count_passing(case, seed, factor) for seed in range(packings)]
            passed = [each.count for each in found if each.count]
            near = sum(each.closest < CORE for each in found)
            closest = min(each.closest for each in found)
            print(
                f"| {cut} | {fraction:g} | {viscosity:g} | {frequency:g} | × {factor} "
                f"| {len(passed)} of {packings} | {sum(passed)} | {near} | {closest:.3f} |",
                flush=True,
            )
            if not passed:
                break


def collision_error(simulation: MicrogelSimulation) -> float:
    """Return (h ω)²/4 of a chain of the lightest discs that begin to touch."""
    c, work = simulation.constants, make_work(0)
    size = 2 * float(simulation.discs.radius.mean())
    h = min(simulation.clock.step, simulation.kernels.substep(c, work, size, 0.0))
    h = simulation.clock.step / 2 ** math.ceil(math.log2(simulation.clock.step / h))
    return float(h**2 * c.k / simulation.discs.mass.min())


def begin(case: Case, *, energy: bool, factor: int = 1, seed: int = 0) -> MicrogelSimulation:
    """Prepare a case, with ``factor`` times its steps."""
    with point_of(case) as point:
        update = {"steps_per_period": factor * point.steps_per_period}
        point = point.model_copy(
            update={
                "integrator": point.integrator.model_copy(update=update),
                "record": point.record.model_copy(update={"energy": energy}),
            }
        )
        simulation = prepare(point, Streams(seed, 0))
    assert isinstance(simulation, MicrogelSimulation)
    return simulation


def run(case: Case) -> Found:
    """Run a case and return what was found."""
    found = Found()
    try:
        simulation, whole, watched = (
            begin(case, energy=True), begin(case, energy=False),
            begin(case, energy=False, factor=LOOKS),
        )  # fmt: skip
        watched.constants = simulation.constants
        momentum = np.array([(simulation.discs.mass * c).sum() for c in simulation.discs[2:4]])
        while simulation.done < simulation.rows:
            simulation.advance(1)
        began = time.process_time()
        whole.advance(whole.rows)
        found.seconds = time.process_time() - began
        passing = Passing(len(simulation.discs.x))
        while watched.done < watched.rows:
            watched.advance(1)
            passing.look(watched)
    except pydantic.ValidationError as error:
        found.reason = "; ".join(fault["msg"] for fault in error.errors())
        return found
    except SimulationError as error:
        found.reason = str(error)
        return found
    columns = simulation.columns()
    found.finite = all(np.isfinite(values).all() for values in columns.values())
    found.same = all(
        values.tobytes() == columns[name].tobytes() for name, values in whole.columns().items()
    )
    found.energy = energy_residual(columns)
    found.collisions = collision_error(simulation)
    checks = simulation.summary()["checks"]
    found.asymmetry = max(checks["asymmetry_periodic"], checks["asymmetry_internal"])
    d = simulation.discs
    change = np.hypot((d.mass * d.cx).sum() - momentum[0], (d.mass * d.cy).sum() - momentum[1])
    c = simulation.constants
    peculiar2 = (columns["peculiar_xx"] + columns["peculiar_yy"]).max() * c.width * c.height
    flow = np.abs(columns["strain_rate"]).max() * c.height
    scale = d.mass.sum() * flow + np.sqrt(peculiar2 * d.mass.sum())
    found.momentum = float(change / scale)
    found.passing, found.closest = passing.count, passing.closest
    found.farthest = passing.farthest
    found.substeps = simulation.substeps / simulation.steps
    return found


def energy_residual(columns: dict[str, FloatArray]) -> float:
    """Return the largest residual of the energy balance, relative to the energy that flows.

    That is what was put in, what was lost or the change of the kinetic energy, if it is larger.
    """
    lost = sum(values for name, values in columns.items() if name.startswith("lost"))
    held = columns["kinetic_energy"] + columns["elastic_energy"]
    put_in = columns["energy_put_in"]
    scale = max(np.abs(lost).max(), np.abs(put_in).max(), np.ptp(columns["kinetic_energy"]))
    return float(np.abs(put_in - lost - (held - held[0])).max() / scale)


def faults(case: Case, found: Found) -> list[str]:
    """Return what does not hold."""
    if case.refused:
        return [] if case.refused in found.reason else [f"not refused: {found.reason}"]
    if found.reason:
        return [f"did not run: {found.reason}"]
    wrong = []
    if not found.finite:
        wrong.append("not finite")
    if not found.energy <= energy_limit(case, found):
        wrong.append(f"energy {found.energy:.1e} > {energy_limit(case, found):.2g}")
    if not found.asymmetry <= SYMMETRY:
        wrong.append(f"asymmetry {found.asymmetry:.1e}")
    if not found.momentum <= MOMENTUM:
        wrong.append(f"momentum {found.momentum:.1e}")
    if case.passing is not None and found.passing > case.passing:
        wrong.append(f"{found.passing} passed through")
    if case.passing is not None and not found.farthest < 1:
        wrong.append(f"moved {found.farthest:.2g} D in a look: who passed cannot be told")
    if not found.same:
        wrong.append("other bits in pieces")
    return wrong


def energy_limit(case: Case, found: Found) -> float:
    """Return the limit of the energy residual of a case."""
    return max(ENERGY, found.collisions) if case.energy is None else case.energy


def main() -> None:
    """Print the table of the cases named, or of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases; default: all")
    parser.add_argument("--passing", type=int, metavar="N", help="who passes, in N packings each")
    options = parser.parse_args()
    names = options.names
    if unknown := set(names) - CASES.keys():
        parser.error(f"no case {', '.join(sorted(unknown))}: one of {'; '.join(CASES)}")
    if options.passing:
        print_passing(options.passing)
        return
    titles = (
        "case", "energy residual", "limit", "with 4 × the steps", "asymmetry", "momentum",
        "passed through", "closest d/D", "substeps per step", "CPU s", "verdict",
    )  # fmt: skip
    print("Printed by `analysis/hard_cases.py`; its first lines say what must hold, and why.\n")
    print(f"| {' | '.join(titles)} |\n{'| --- ' * len(titles)}|")
    for name in names or CASES:
        case = CASES[name]
        found = run(case)
        verdict = "; ".join(faults(case, found)) or "holds"
        if found.reason:
            reason = re.sub(r"\S*(start\.npz)|Value error, ", r"\1", found.reason)
            verdict = f"refused: {reason}" if case.refused else f"{verdict}: {reason}"
            print(f"| {name} |" + " |" * (len(titles) - 2) + f" {verdict} |", flush=True)
            continue
        finer = begin(case, energy=True, factor=4)
        finer.advance(finer.rows)
        residual = energy_residual(finer.columns())
        print(
            f"| {name} | {found.energy:.1e} | {energy_limit(case, found):.2g} | {residual:.1e} "
            f"| {found.asymmetry:.1e} | {found.momentum:.1e} | {found.passing} "
            f"| {f'{found.closest:.3f}' if found.closest < 1 else 'apart'} "
            f"| {found.substeps:.3g} | {found.seconds:.2g} | {verdict} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
