"""A ring between two plates against mechanics: elastica, plastic hinges, membrane; and the paper.

.venv/bin/python analysis/soft_diametral.py analysis/figures/soft_diametral.png

Prints tables in Markdown (kept in analysis/soft_diametral.md) and draws a figure. The ring has 100
vertices and h = 0.05 R. The plastic one is compressed ever more slowly, by factors of four, until
its force (averaged over Δε = 0.02) changes by less than 0.5 %.
"""

import argparse
from typing import NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.diametral import Diametral
from shear_sim.models.soft_particle.parameters import SoftParticlePoint

FloatArray = NDArray[np.float64]

VERTICES, THICKNESS = 100, 0.05
ONSET = 0.2822  # of flat contact of an elastica
ELASTICA = np.array(
    [
        (0.05, 0.6254, 0.9967), (0.10, 1.1743, 0.9875), (0.15, 1.6663, 0.9730),
        (0.20, 2.1153, 0.9540), (0.25, 2.5316, 0.9308), (0.28, 2.7691, 0.9151),
    ]
)  # fmt: skip
YIELD = 0.02  # M^Y/M*
AT = (0.1, 0.2, 0.3, 0.4, 0.5)


class Run(NamedTuple):
    """Records of one run, and the pressures of the vertices on the upper plate."""

    table: dict[str, FloatArray]
    place: list[FloatArray]  # [R], of each record
    pressure: list[FloatArray]  # [E I/R³]

    def loading(self, name: str, strain: FloatArray) -> FloatArray:
        """Values of a column at ``strain`` of loading."""
        top = int(self.table["compression"].argmax()) + 1
        return np.interp(strain, self.table["compression"][:top], self.table[name][:top])


def compress(strain: float, rate: float, rows: int, *, unload: bool = False, **model: float) -> Run:
    point = SoftParticlePoint.model_validate(
        {
            "packing": {"vertices": VERTICES},
            "model": {"thickness": THICKNESS, "core": "elastic"} | model,
            "shear": {"compression": strain, "relative_rate": rate, "unload": unload},
            "record": {"rows": rows},
        }
    )
    run = Diametral(point, point.shear)
    records, place, pressure = [run.record()], [], []
    system, r = run.system, run.radius
    for _ in range(rows):
        run.go_on()
        records.append(run.record())
        overlap = system.motion.y + system.walls.position[1] + system.chains.radius[0]
        touching = np.flatnonzero(overlap > 0)
        ahead, behind = system.chains.after[touching], system.chains.before[touching]
        length = 0.5 * np.hypot(
            system.motion.x[ahead] - system.motion.x[behind],
            system.motion.y[ahead] - system.motion.y[behind],
        )
        order = system.motion.x[touching].argsort()
        force = 2.0 * system.rules.stiffness * overlap[touching]
        place.append(system.motion.x[touching][order] / r)
        pressure.append((force / length)[order] * r**3 / run.unit.bending)
    table = {name: np.array([record[name] for record in records]) for name in records[0]}
    table["height"] = np.full(len(records), float(np.ptp(system.motion.y)) / (2 * run.half))
    scales = {"bending": run.unit.bending, "radius": r, "diameter": 2 * run.half}
    table |= {name: np.full(len(records), value) for name, value in scales.items()}
    return Run(table, place, pressure)


def row(*cells: object) -> None:
    print("| " + " | ".join(f"{c:.4g}" if isinstance(c, float) else str(c) for c in cells) + " |")


def head(*cells: str) -> None:
    print()
    row(*cells)
    print("| " + " | ".join("---" for _ in cells) + " |")


def elastic(run: Run) -> None:
    print("\n## Elastic ring\n\nF R²/EI and V/V₀ against the elastica:")
    head("ε", "F R²/EI", "elastica", "error", "V/V₀", "elastica", "error")
    beyond = np.array([0.3, 0.35, 0.4, 0.45, 0.49])
    beta = 1 - beyond
    flat = np.column_stack([beyond, 1.43554 / beta**2, 2 * beta - 1.01253 * beta**2])
    for e, force, area in np.vstack([ELASTICA, flat]):
        f = float(run.loading("scaled_force", np.array([e]))[0])
        v = float(run.loading("area_ratio", np.array([e]))[0])
        row(f"{e:g}", f, force, f"{100 * (f / force - 1):+.2f} %", v, area, f"{v - area:+.4f}")
    top = int(run.table["compression"].argmax()) + 1
    e, ratio = run.table["compression"][:top], run.table["contact_ratio"][:top]
    use = ratio > 4.5 * np.sin(np.pi / VERTICES)
    slope, offset = np.polyfit(e[use], ratio[use], 1)
    end = run.table["compression"][-1]
    missing = np.abs(run.table["energy_missing"]).max() / run.table["work"].max()
    back = 1 - run.table["work"][-1] / run.table["work"].max()
    share = run.table["energy_stretch"][top - 1] / run.table["energy_bend"][top - 1]
    print(
        f"\nContact length, a line: onset ε = {-offset / slope:.4f} (elastica {ONSET}), slope "
        f"{slope:.3f} (elastica 2.188; π/2 is the stadium's). Energy missing: {missing:.1e} of the "
        f"work; given back in unloading to ε = {end:.1e}: {100 * back:.1f} % of it. "
        f"W_s/W_b = {share:.1e} at the top."
    )
    ends, flat, strain = [], [], []
    for k in range(top - 1):
        x, p = run.place[k], run.pressure[k]
        e = float(run.table["compression"][k + 1])
        if e < 0.32 or len(p) < 2:
            continue
        strain.append(e)
        flat.append(2 * float((p * np.abs(x)).sum() / p.sum()) / 2)  # L_c/b₀ of its two loads
        ends.append(
            float(p[np.abs(x) > np.abs(x).max() - 2.5 * np.pi * 2 / VERTICES].sum() / p.sum())
        )
    slope, offset = np.polyfit(strain, flat, 1)
    print(
        f"Distance between the loads at the two ends, a line: onset {-offset / slope:.4f}, slope "
        f"{slope:.3f}. The outermost three vertices of each end bear "
        f"{100 * min(ends):.1f} % or more of the force for ε > 0.32: the contact is flat and "
        "unloaded in between. The paper's figure 16 has a plateau there."
    )


def averaged(run: Run, strain: float) -> float:
    """F R/4 M^Y averaged over Δε = 0.02 about ``strain``."""
    table, top = run.table, int(run.table["compression"].argmax())
    way = (table["compression"] > strain - 0.01) & (table["compression"] <= strain + 0.01)
    way[top + 1 :] = False
    return float(table["mean_force"][way].mean() / table["force_unit"][0])


def plastic() -> Run:
    print(f"\n## Plastic ring, M^Y = {YIELD} M*\n\nF R/4M^Y × √(1 − ε²), 1 by DeRuntz & Hodge:")
    head("ε̇ T₁", *(f"ε = {e - 0.01 if e == 0.5 else e:g}" for e in AT), "V/V₀ at 0.49: error",
         "residual")  # fmt: skip
    before, rate = np.zeros(len(AT)), 0.01
    while True:
        run = compress(0.505, rate, 101, yield_moment=YIELD, unload=True)
        unit = 4 * YIELD * run.table["bending"][0] / run.table["radius"][0] ** 2
        run.table["force_unit"] = np.full(len(run.table["time"]), unit)
        strains = np.array([e - 0.01 if e == 0.5 else e for e in AT])
        law = np.array([averaged(run, e) for e in strains])
        ratio = law * np.sqrt(1 - strains**2)
        phi = np.arcsin(0.49)
        area = 4 / np.pi * (phi * 0.51 + 0.5 * (np.pi / 2 - phi) - 0.245 * np.sqrt(1 - 0.49**2))
        error = float(run.loading("area_ratio", np.array([0.49]))[0]) - area
        last = 1 - run.table["height"][-1]
        row(f"{rate:g}", *map(float, ratio), f"{error:+.4f}", f"{last / 0.505:.3f} ε_max")
        if np.abs(law / np.where(before > 0, before, np.inf) - 1).max() < 0.005 or rate < 1e-4:
            return run
        before, rate = law, rate / 4


def core(eta: float) -> Run:
    run = compress(0.352, 0.0025, 88, core_ratio=eta)
    print(f"\n## Core, η = {eta:g}\n\nAgainst the membrane stadium:")
    head("ε", "V/V₀", "stadium", "error", "F/(p L_c)", "L_c/b₀ (nodes)", "stadium")
    for e in (0.1, 0.15, 0.2, 0.25, 0.3, 0.35):
        at = {n: float(run.loading(n, np.array([e]))[0]) for n in run.table}
        beta = 1 - e
        length = ((1 - beta) + 0.5 * eta * beta * (1 - beta**2)) / (1 + eta * beta**2)
        area = beta**2 + 2 * beta * length
        contact = 0.5 * np.pi * length
        row(
            f"{e:g}", at["area_ratio"], area, f"{at['area_ratio'] - area:+.4f}",
            at["force"] / (at["core_pressure"] * contact * at["diameter"]),
            at["contact_ratio"], contact,
        )  # fmt: skip
    return run


def _last_two(axis: plt.Axes) -> tuple[list[object], list[str]]:
    handles, labels = axis.get_legend_handles_labels()
    chosen = [k for k, label in enumerate(labels) if label.startswith(("its", "stadium"))]
    return [handles[k] for k in chosen], [labels[k] for k in chosen]


def draw(path: str, runs: dict[str, Run]) -> None:
    figure, axes = plt.subplots(2, 3, figsize=(9.5, 5.6), layout="constrained")
    for name, run in runs.items():
        top = int(run.table["compression"].argmax()) + 1
        e = run.table["compression"][:top]
        line = {"label": name, "lw": 1.2}
        axes[0, 0].plot(e[2:], run.table["scaled_force"][2:top], **line)
        axes[0, 1].plot(e, run.table["area_ratio"][:top], **line)
        axes[0, 2].plot(e, run.table["contact_ratio"][:top], **line)
        if name == "elastic":
            apart = run.table["load_ratio"][:top]
            axes[0, 2].plot(e[e > ONSET], apart[e > ONSET], "C0--", lw=1, label="its loads")
        share = run.table["energy_stretch"][2:top] / run.table["energy_bend"][2:top]
        axes[1, 2].plot(e[2:], share, **line)
    theory = {"color": "black", "ls": "none", "marker": "o", "ms": 3, "mfc": "none"}
    beyond = np.linspace(0.29, 0.5, 9)
    axes[0, 0].plot(ELASTICA[:, 0], ELASTICA[:, 1], **theory, label="elastica")
    axes[0, 0].plot(beyond, 1.43554 / (1 - beyond) ** 2, **theory)
    axes[0, 0].set(yscale="log", ylabel="$F R^2/EI$")
    axes[0, 1].plot(ELASTICA[:, 0], ELASTICA[:, 2], **theory)
    run = runs["plastic"]
    e = np.linspace(0, 0.5, 9)
    phi = np.arcsin(e)
    area = 2 / np.pi * (2 * phi * (1 - e) + np.pi / 2 - phi - e * np.sqrt(1 - e**2))
    axes[0, 1].plot(e, area, color="C3", ls="none", marker="s", ms=3, mfc="none", label="hinges")
    axes[0, 1].legend(frameon=False, fontsize=7)
    axes[0, 1].plot(beyond, 2 * (1 - beyond) - 1.01253 * (1 - beyond) ** 2, **theory)
    axes[0, 1].set(ylabel="$V/V_0$")
    axes[0, 2].plot(beyond, 2.188 * (beyond - ONSET), **theory)
    for eta in (1, 100):
        beta = 1 - np.linspace(0.05, 0.35, 13)
        length = ((1 - beta) + 0.5 * eta * beta * (1 - beta**2)) / (1 + eta * beta**2)
        axes[0, 2].plot(1 - beta, 0.5 * np.pi * length, color="black", lw=0.6, ls=":")
        axes[0, 1].plot(1 - beta, beta**2 + 2 * beta * length, color="black", lw=0.6, ls=":")
    axes[0, 2].set(ylabel="$L_c/b_0$, of vertices")
    axes[1, 2].set(yscale="log", ylabel="$W_s/W_b$")
    e = np.linspace(0, 0.5)
    run = runs["plastic"]
    half = int(run.table["compression"].argmax()) + 1
    scale = run.table["force_unit"][0]
    axes[1, 0].plot(run.table["compression"][1:half], run.table["mean_force"][1:half] / scale,
                    color="C3", lw=0.8)  # fmt: skip
    axes[1, 0].plot(e, 1 / np.sqrt(1 - e**2), "k:", lw=1, label="DeRuntz & Hodge")
    axes[1, 0].set(ylabel="$F R/4M^Y$ of the plastic ring", ylim=(0, 1.4))
    axes[1, 0].legend(frameon=False)
    for name, strain, color in (("elastic", 0.4, "C0"), ("η = 100", 0.3, "C2")):
        run = runs[name]
        k = int(np.abs(run.table["compression"][1 : len(run.place)] - strain).argmin())
        p = run.pressure[k]
        axes[1, 1].plot(run.place[k], p / p.max(), "o-", color=color, ms=3, lw=0.8,
                        label=f"{name}, ε = {strain:g}")  # fmt: skip
    axes[1, 1].set(xlabel="$x/R$", ylabel="pressure of the plate / largest", ylim=(0, 1.3))
    axes[1, 1].legend(frameon=False, fontsize=7, loc="upper center")
    axes[0, 2].plot([], [], "k:", lw=0.6, label="stadium, η = 1, 100")
    axes[0, 2].legend(*_last_two(axes[0, 2]), frameon=False, fontsize=7, loc="upper left")
    for axis in (*axes[0], axes[1, 0], axes[1, 2]):
        axis.set_xlabel("$ε = 1 - b/b_0$")
    axes[0, 0].legend(frameon=False, fontsize=7)
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=200)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figure", help="path of the figure")
    figure = parser.parse_args().figure
    runs = {"elastic": compress(0.5, 0.0025, 200, unload=True)}
    print("# A ring between two plates")
    elastic(runs["elastic"])
    runs["η = 1"] = core(1.0)
    runs["η = 100"] = core(100.0)
    runs["plastic"] = plastic()
    draw(figure, runs)


if __name__ == "__main__":
    main()
