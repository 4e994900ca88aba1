"""Uniaxial compaction and decompaction of soft particles in a box: four kinds of particles.

.venv/bin/python analysis/soft_compaction.py 500 analysis/figures/soft_compaction.png

Prints a table in Markdown (kept in analysis/soft_compaction.md) and draws a figure. Discs (ΔR/R =
0.15) are packed at random until they jam, each is replaced by a ring of 24 vertices (h = 0.1 R),
and the top wall comes down at a constant speed, 100 periods of the slowest vibration of a ring
long, and goes up again twice as fast. Void ratios are with V_s = A + P r + π r², and stresses in
units of σ* = k_b/2R² (paper (37)).
"""

import argparse
import time
from typing import NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray
from scipy.spatial import KDTree

from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.kernels import shell_energy
from shear_sim.models.soft_particle.system import System, Wall

FloatArray = NDArray[np.float64]

VERTICES, THICKNESS, SPREAD = 24, 0.1, 0.15
STRAIN, PERIODS = 0.30, 100.0
ROWS = 60  # of loading
SETS = {
    "η = 0": {},
    "η = 1": {"eta": 1.0},
    "η = 100": {"eta": 100.0},
    "η = 0, plastic": {"yield_moment": 0.02},
}


class Packed(NamedTuple):
    """Discs in a box."""

    place: FloatArray  # (N, 2)
    radius: FloatArray  # (N,)
    width: float
    height: float


def packed_discs(count: int, seed: int) -> Packed:
    """Discs in a box whose lid comes down on random ones until they cannot give way any more."""
    rng = np.random.default_rng(seed)
    radius = np.clip(rng.normal(1.0, SPREAD, count), 1 - 2.5 * SPREAD, 1 + 2.5 * SPREAD)
    radius /= radius.mean()
    width = 2.0 * np.sqrt(count)
    height = np.pi * (radius**2).sum() / width / 0.6
    place = rng.random((count, 2)) * (width, height)

    def relax(place: FloatArray, height: float) -> tuple[FloatArray, float]:
        velocity = np.zeros_like(place)
        pairs = np.zeros((0, 2), int)
        at = place + np.inf
        for _ in range(20_000):
            if np.abs(place - at).max() > 0.1:
                at = place.copy()
                pairs = KDTree(place).query_pairs(2 * radius.max() + 0.4, output_type="ndarray")
            i, j = pairs.T
            apart = place[i] - place[j]
            distance = np.maximum(np.hypot(*apart.T), 1e-9)
            overlap = np.maximum(0.0, radius[i] + radius[j] - distance)
            push = (overlap / distance)[:, None] * apart
            force = np.zeros_like(place)
            for axis, size in ((0, width), (1, height)):
                force[:, axis] += np.bincount(i, push[:, axis], count)
                force[:, axis] -= np.bincount(j, push[:, axis], count)
                force[:, axis] += np.maximum(0.0, radius - place[:, axis])
                force[:, axis] -= np.maximum(0.0, place[:, axis] + radius - size)
            velocity = 0.95 * velocity + 0.2 * force
            velocity[(velocity * force).sum(axis=1) < 0] *= 0.5
            place = place + 0.2 * velocity
            worst = float(overlap.max(initial=0.0))
            if worst < 1e-4 or np.abs(force).max() < 1e-7:
                break
        return place, worst

    step = 0.02 * height
    place, _ = relax(place, height)
    while step > 2e-4 * height:
        tried, worst = relax(place * (1, (height - step) / height), height - step)
        if worst < 1e-3:
            place, height = tried, height - step
        else:
            step /= 2
    return Packed(place, radius, width, height)


class Result(NamedTuple):
    """One compaction."""

    table: dict[str, FloatArray]
    polygons: list[FloatArray]  # at the largest load
    energy: FloatArray  # of each particle there
    problem: str
    seconds: float
    cost: float  # ns of CPU per vertex and step


def compact(packed: Packed, eta: float = 0.0, yield_moment: float | None = None) -> Result:
    rng = np.random.default_rng(1)
    r = 0.5 * THICKNESS
    shell = Shell.of_material(1.0, THICKNESS)
    limit = np.inf if yield_moment is None else yield_moment * shell.bend
    shell = Shell(
        shell.stretch, shell.bend, bend_yield=limit, stretch_damping=0.2, bend_damping=0.2
    )
    segment = 2 * np.sin(np.pi / VERTICES)
    hinge = shell.bend / segment
    core = Core("log", eta * shell.stretch / segment * np.tan(np.pi / VERTICES)) if eta else Core()
    bodies = []
    for (x, y), size in zip(packed.place, packed.radius, strict=True):
        turn = rng.uniform(0, 2 * np.pi)
        points = ring_points(VERTICES, size - r) @ np.array(
            [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        )
        bodies.append(Body(points + np.array([x, y]), True, r, 1.0, shell, core))
    slowest = np.sqrt(7.2 * shell.bend / (VERTICES / (2 * np.pi)))
    walls = [Wall(1, 0, 0), Wall(-1, 0, -packed.width), Wall(0, 1, 0), Wall(0, -1, -packed.height)]
    system = System(
        bodies, walls, stiffness=0.4 * shell.stretch / segment, contact_damping=0.3,
        drag=0.1 * slowest,
    )  # fmt: skip
    duration = PERIODS * 2 * np.pi / slowest
    steps = int(np.ceil(duration / ROWS / system.rules.step))
    start = packed.height
    end = start * np.exp(-STRAIN)
    speed = (start - end) / (ROWS * steps * system.rules.step)
    unit = hinge / 2.0  # σ*
    table: dict[str, list[float]] = {
        k: [] for k in ("strain", "stress", "void", "solid", "missing")
    }
    polygons: list[FloatArray] = []
    energy, problem = np.zeros(len(bodies)), ""
    clock = time.process_time()

    def record() -> None:
        height = -float(system.walls.position[3])
        solid = sum(map(volume, range(len(bodies))))
        table["strain"].append(float(np.log(start / height)))
        table["stress"].append(float(system.walls.push[3]) / packed.width / unit)
        table["void"].append(packed.width * height / solid - 1.0)
        table["solid"].append(solid)
        budget = system.budget()
        put = np.abs(budget.by_walls) + budget.bend_yield + budget.damping + 1e-300
        table["missing"].append(abs(budget.missing) / put)

    def outline(p: int) -> FloatArray:
        part = slice(*system.chains.start[p : p + 2])
        return np.column_stack([system.motion.x[part], system.motion.y[part]])

    def volume(p: int) -> float:
        points = outline(p)
        sides = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        return system.area(p) + float(sides.sum()) * r + np.pi * r**2

    record()
    try:
        for row in range(ROWS + ROWS // 2):
            system.walls.velocity[3] = speed if row < ROWS else -2 * speed
            system.advance(steps)
            record()
            if row == ROWS - 1:
                polygons = [outline(p) for p in range(len(bodies))]
                energy = np.array(
                    [
                        sum(shell_energy(system.chains, system.motion.x, system.motion.y, p))
                        for p in range(len(bodies))
                    ]
                )
    except SimulationError as error:
        problem = str(error)
    seconds = time.process_time() - clock
    cost = seconds / max(1, system.steps) / len(system.motion.x) * 1e9
    if not polygons:
        polygons = [outline(p) for p in range(len(bodies))]
    arrays = {name: np.array(values) for name, values in table.items()}
    return Result(arrays, polygons, energy, problem, seconds, cost)


def report(name: str, result: Result) -> None:
    t = result.table
    top = int(t["strain"].argmax())
    load = slice(1, top + 1)
    void = np.interp([0.3, 1.0], t["stress"][load], t["void"][load])
    at = int(np.abs(np.log(np.maximum(t["stress"][load], 1e-9))).argmin()) + 1
    pores = t["void"] * t["solid"] + t["solid"]
    share = (t["solid"][0] - t["solid"][at]) / (pores[0] - pores[at])
    whole = (t["solid"][0] - t["solid"][top]) / (pores[0] - pores[top])
    use = np.flatnonzero((t["stress"][load] > 0.03) & (t["stress"][load] < 20)) + 1
    slope = (
        -np.polyfit(np.log10(t["stress"][use]), t["void"][use], 1)[0] if len(use) > 4 else np.nan
    )
    cells = (
        name, f"{t['strain'][top]:.3f}", f"{t['stress'][top]:.3g}", f"{t['void'][0]:.3f}",
        f"{void[1]:.3f}" if t["stress"][top] > 1 else "-", f"{t['void'][top]:.3f}",
        f"{share:.2f}" if t["stress"][top] > 0.8 else "-", f"{whole:.2f}", f"{slope:.3f}",
        f"{t['void'][-1]:.3f}" if not result.problem else "-", f"{t['missing'][1:].max():.1e}",
        f"{result.seconds:.0f}", f"{result.cost:.0f}", result.problem or "completed",
    )  # fmt: skip
    print("| " + " | ".join(cells) + " |", flush=True)


def draw(path: str, results: dict[str, Result], packed: Packed) -> None:
    figure, axes = plt.subplots(2, 4, figsize=(11, 6), layout="constrained")
    for axis, (name, result) in zip(axes[0], results.items(), strict=True):
        mean = result.energy.mean() or 1.0
        shades = PolyCollection(
            result.polygons, array=np.clip(result.energy / mean, 1.0, 4.0), cmap="Reds",
            edgecolors="black", linewidths=0.4,
        )  # fmt: skip
        shades.set_clim(1.0, 4.0)
        axis.add_collection(shades)
        height = max(float(points[:, 1].max()) for points in result.polygons) + 0.1
        axis.set(xlim=(0, packed.width), ylim=(0, height), aspect="equal", title=name)
        axis.set_axis_off()
    figure.colorbar(shades, ax=axes[0, 3], label="energy / mean", shrink=0.7)
    for name, result in results.items():
        t = result.table
        top = int(t["strain"].argmax()) + 1
        color = f"C{list(results).index(name)}"
        for part, style in ((slice(1, top), "-"), (slice(top - 1, None), "--")):
            label = name if style == "-" else None
            stress = np.where(t["stress"][part] > 1e-3, t["stress"][part], np.nan)
            axes[1, 0].plot(t["strain"][part], stress, style, color=color, label=label)
            axes[1, 1].plot(stress, t["void"][part], style, color=color)
            total = (1 + t["void"]) * t["solid"]
            share = (t["solid"][0] - t["solid"]) / np.maximum(total[0] - total, 1e-9)
            axes[1, 2].plot(stress, share[part], style, color=color)
            axes[1, 3].plot(t["strain"][part], t["solid"][part] / t["solid"][0], style,
                            color=color)  # fmt: skip
    axes[1, 0].set(yscale="log", xlabel="ε = ln(H₀/H)", ylabel="σ/σ*")
    axes[1, 1].set(xscale="log", xlabel="σ/σ*", ylabel="void ratio e")
    axes[1, 2].set(xscale="log", xlabel="σ/σ*", ylabel="ΔV_s/ΔV", ylim=(0, 0.8))
    axes[1, 3].set(xlabel="ε", ylabel="V_s/V_s(0)")
    axes[1, 0].legend(frameon=False, fontsize=7)
    for axis in axes[1]:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=200)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rings", type=int, help="number of particles")
    parser.add_argument("figure", help="path of the figure")
    given = parser.parse_args()
    packed = packed_discs(given.rings, seed=1)
    area = np.pi * (packed.radius**2).sum() / packed.width / packed.height
    print(
        f"# Compaction of {len(packed.radius)} rings, from discs of packing fraction {area:.3f}\n"
    )
    print(
        "| particles | ε | σ/σ* | e₀ | e at σ* | e at the top | ΔV_s/ΔV at σ* | at the top | C "
        "| e unloaded | energy missing | CPU s | ns per vertex and step | |"
    )
    print("| --- " * 14 + "|")
    results = {}
    for name, options in SETS.items():
        results[name] = compact(packed, **options)
        report(name, results[name])
    draw(given.figure, results, packed)


if __name__ == "__main__":
    main()
