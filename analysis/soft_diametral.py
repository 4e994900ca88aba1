r"""A ring between two plates against mechanics: elastica, plastic hinges, membrane; and the paper.

shear-sim sweep configs/soft_plastic_ring.yaml
.venv/bin/python analysis/soft_diametral.py results/soft_plastic_ring \
    analysis/figures/soft_diametral.png

Prints tables in Markdown (kept in analysis/soft_diametral.md) and draws a figure. The ring has 100
vertices and h = 0.05 R. The plastic one is that of the study, compressed ever more slowly, by
factors of four, until its force (averaged over Δε = 0.02) changes by less than 0.5 %; the others
are run here (five minutes). Without arguments only coarse and soft ones are (half a minute).
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from shear_sim.figures import style
from shear_sim.models.soft_particle.diametral import Diametral
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.results import read_job
from shear_sim.tables import Table

FloatArray = NDArray[np.float64]

VERTICES, THICKNESS = 100, 0.05
ONSET = 0.2822  # of flat contact of an elastica
THIN = (2 / np.pi - 0.5) / (np.pi / 4 - 2 / np.pi)  # width / way of the plates, at first
ELASTICA = np.array(
    [
        (0.05, 0.6254, 0.9967), (0.10, 1.1743, 0.9875), (0.15, 1.6663, 0.9730),
        (0.20, 2.1153, 0.9540), (0.25, 2.5316, 0.9308), (0.28, 2.7691, 0.9151),
    ]
)  # fmt: skip
YIELD = 0.02  # M^Y/M*
AT = np.array([0.1, 0.2, 0.3, 0.4, 0.49])
SLOWER = 0.005  # change of the force at a quarter of the speed that is small enough
THINNER = (0.1, 0.05, 0.025)  # h/R of rings with a core
COARSE = (16, 24, 32, 48, 64, 100)  # vertices
HALF_GAPS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 12.0)  # segments
SINKING = (0.2, 0.3, 0.4)  # ε of rings with a core
SUNK = (
    (40, 1.0, 10.0), (40, 1.0, 33.0), (40, 1.0, 100.0), (40, 10.0, 10.0), (40, 10.0, 33.0),
    (40, 10.0, 100.0), (40, 100.0, 33.0), (40, 100.0, 100.0), (100, 1.0, 10.0), (100, 100.0, 10.0),
)  # fmt: skip
PRESSED = 0.75  # largest ε of coarse rings


def stadium(eta: float, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return L_c/b₀ and V/V₀ of a membrane around a core, pressed to a stadium."""
    beta = 1 - strain
    length = ((1 - beta) + 0.5 * eta * beta * (1 - beta**2)) / (1 + eta * beta**2)
    return 0.5 * np.pi * length, beta**2 + 2 * beta * length


class Bent(NamedTuple):
    """A ring that stretches and bends, in units of R and E h."""

    force: float
    pressure: float
    contact: float  # L_c/b₀
    area: float  # V/V₀


def elastica_with_core(eta: float, strain: float, thickness: float) -> Bent:
    """Solve the boundary value problem of a quarter of a ring around a core, between plates.

    Along the unstretched arc s, from the end of the flat contact s_c to the equator πR/2, with the
    angle φ downwards, T = H cos φ − V sin φ and λ = 1 + T/E h::

        x′ = λ cos φ,  y′ = −λ sin φ,  φ′ = 1/R + M/EI,  M′ = λ (H sin φ + V cos φ)
        H = p y,  V = P − p (x − x_c),  p = K_Ω (1 − A/A₀)

    P is the force of the plate at either end of the contact, where M = −EI/R; within it the plate
    bears p. No part of it is from the model.
    """
    bending, modulus, top, end = thickness**2 / 12, 0.5 * eta, 1 - strain, 0.5 * np.pi

    def slopes(_: FloatArray, z: FloatArray, given: FloatArray) -> FloatArray:
        push, start, pressure = given
        x, y, phi, moment, _ = z
        across, up = pressure * y, push - pressure * (x - (1 + pressure * top) * start)
        stretch = 1 + across * np.cos(phi) - up * np.sin(phi)
        turn = 1 + moment / bending
        shear = stretch * (across * np.sin(phi) + up * np.cos(phi))
        way = stretch * np.cos(phi)
        return (end - start) * np.array([way, -stretch * np.sin(phi), turn, shear, y * way])

    def ends(low: FloatArray, high: FloatArray, given: FloatArray) -> FloatArray:
        _, start, pressure = given
        half = (1 + pressure * top) * start
        return np.array([
            low[0] - half, low[1] - top, low[2], low[3] / bending + 1, low[4] - half * top,
            high[1], high[2] - end, high[4] / (0.5 * end) - 1 + pressure / modulus,
        ])  # fmt: skip

    contact, area = stadium(eta, np.array(strain))
    pressure = modulus * (1 - float(area))
    t = np.linspace(0, 1, 200)
    start = min(float(contact), 0.8 * end)
    guess = np.array([
        start + top * np.sin(end * t), top * np.cos(end * t), end * t,
        bending * (1 / top - 1) + 0 * t, top * start + 0.5 * top**2 * end * t,
    ])  # fmt: skip
    found = solve_bvp(slopes, ends, t, guess, p=[bending, start, pressure], tol=1e-8,
                      max_nodes=100_000)  # fmt: skip
    assert found.success, found.message
    push, start, pressure = found.p
    half = (1 + pressure * top) * start
    return Bent(2 * (pressure * half + push), pressure, half, 1 - pressure / modulus)


class Run(NamedTuple):
    """Records of one run, and of all but the first pressures on the upper plate, and the shape."""

    table: dict[str, FloatArray]
    place: list[FloatArray]  # [R], of each record
    pressure: list[FloatArray]  # [E I/R³]
    outline: list[FloatArray]  # (N, 2) of all vertices [R]

    def loading(self, name: str, strain: FloatArray) -> FloatArray:
        """Values of a column at ``strain`` of loading."""
        top = int(self.table["compression"].argmax()) + 1
        return np.interp(strain, self.table["compression"][:top], self.table[name][:top])


def touching_onset(vertices: int) -> tuple[float, float]:
    """Return ε where the length that touches begins, a line, and its slope.

    A segment or two more touch than lie between the loads, so the onset is early by 1.7/N.
    """
    run = compress(0.45, 0.02, 90, vertices=vertices)
    e, ratio = run.table["compression"], run.table["contact_ratio"]
    use = ratio > 4.5 * np.sin(np.pi / vertices)
    slope, offset = np.polyfit(e[use], ratio[use], 1)
    return -offset / slope, slope


def compress(
    strain: float, rate: float, rows: int, *, unload: bool = False, vertices: int = VERTICES,
    **model: float,
) -> Run:  # fmt: skip
    """Press a ring; ``model`` may say its thickness [R], else `THICKNESS`."""
    point = SoftParticlePoint.model_validate(
        {
            "packing": {"vertices": vertices},
            "model": {"thickness": THICKNESS, "core": "elastic"} | model,
            "shear": {"relative_rate": rate, "unload": unload},
            "record": {"rows": rows},
        }
    )
    # Unchecked: a study may not press a ring so far that its folds are coarser than a segment.
    shear = point.shear.model_copy(update={"compression": strain})
    run = Diametral(point.model_copy(update={"shear": shear}), shear)
    records, place, pressure, outline = [run.record()], [], [], []
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
        outline.append(np.column_stack([system.motion.x, system.motion.y]) / r)
    table = {name: np.array([record[name] for record in records]) for name in records[0]}
    table["height"] = np.full(len(records), float(np.ptp(system.motion.y)) / (2 * run.half))
    scales = {"bending": run.unit.bending, "radius": r, "diameter": 2 * run.half}
    table |= {name: np.full(len(records), value) for name, value in scales.items()}
    return Run(table, place, pressure, outline)


def ellipse(strain: FloatArray) -> FloatArray:
    """Return a/b₀ of an ellipse of the perimeter of the ring: paper (26), solved for a."""
    b = 1.0 - strain
    return (6 - 4 * b + np.sqrt((4 * b - 6) ** 2 - 12 * (3 * b**2 - 6 * b + 2))) / 6


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
    print(
        "\nWidth, between a stadium and an ellipse of the same perimeter (paper (27), (26)); "
        f"at first 1 + {THIN:.3f} ε, as a thin ring under two forces:"
    )
    head("ε", "a/b₀", "stadium", "ellipse", "1 + 0.918 ε")
    for at in (0.02, 0.1, 0.2, 0.3, 0.4, 0.49):
        width = float(run.loading("width_ratio", np.array([at]))[0])
        row(f"{at:g}", width, 1 + (np.pi / 2 - 1) * at, float(ellipse(np.array(at))), 1 + THIN * at)
    print("\nEnergy of bending [EI/R], and the paper's estimates of it from the contact length:")
    head("ε", "L_c/b₀ of the loads", "W_b", "flat contacts L_c/R", "uniform π (L_c/R)²")
    for e in (0.3, 0.35, 0.4, 0.45, 0.49):
        at = {n: float(run.loading(n, np.array([e]))[0]) for n in run.table}
        long = at["load_ratio"] * at["diameter"] / at["radius"]
        stored = at["energy_bend"] * at["radius"] / at["bending"]
        row(f"{e:g}", at["load_ratio"], stored, long, np.pi * long**2)
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
        f"\nDistance between the loads at the two ends, a line: onset {-offset / slope:.4f}, slope "
        f"{slope:.3f}. The outermost three vertices of each end bear "
        f"{100 * min(ends):.1f} % or more of the force for ε > 0.32: the contact is flat and "
        "unloaded in between. The paper's figure 16 has a plateau there."
    )


class Crushed(NamedTuple):
    """A plastic ring against plastic hinges, at the strains `AT`."""

    rate: float  # ε̇ T₁
    run: Run
    law: FloatArray  # F R/4M^Y × √(1 − ε²), F averaged over Δε = 0.02
    area: FloatArray  # V/V₀, less that of the hinges
    change: float  # largest, of the law against the run before, four times as fast


def hinged_area(strain: FloatArray) -> FloatArray:
    """Return V/V₀ of a ring whose four quarters stay round between plastic hinges."""
    phi = np.arcsin(strain)
    half = 0.5 * (np.pi / 2 - phi) - 0.5 * strain * np.sqrt(1 - strain**2)
    return 4 / np.pi * (phi * (1 - strain) + half)


def crushed(results: Path) -> Iterator[Crushed]:
    """Yield the plastic rings of the study, ever slower."""
    jobs = [read_job(path) for path in sorted((results / "jobs").glob("*.parquet"))]
    slower = [job for job in jobs if not asked(job.summary)["unload"]]
    before = np.full(len(AT), np.nan)
    for job in sorted(slower, key=lambda job: -asked(job.summary)["relative_rate"]):
        given, derived = job.summary["parameters"], job.summary["derived"]
        bending = derived["bend_stiffness"] * derived["segment_length"]
        unit = 4 * given["model"]["yield_moment"] * bending / given["packing"]["radius"] ** 2
        table = dict(job.columns) | {"force_unit": np.full(len(job.columns["time"]), unit)}
        run = Run(table, [], [], [])
        strain, force = table["compression"], table["mean_force"] / unit
        near = [(strain > at - 0.01) & (strain <= at + 0.01) for at in AT]
        law = np.array([force[way].mean() for way in near]) * np.sqrt(1 - AT**2)
        change = float(np.abs(law / before - 1).max())
        area = run.loading("area_ratio", AT) - hinged_area(AT)
        yield Crushed(asked(job.summary)["relative_rate"], run, law, area, change)
        before = law


def asked(summary: dict[str, Any]) -> dict[str, Any]:
    return dict(summary["parameters"]["shear"])


def let_go(results: Path) -> Table:
    """Return the plastic ring whose plates part again."""
    jobs = [read_job(path) for path in sorted((results / "jobs").glob("*.parquet"))]
    (found,) = (job for job in jobs if asked(job.summary)["unload"])
    return found


def residual(results: Path) -> float:
    """Return the residual compression of the plastic ring that was let go / the largest."""
    found = let_go(results).summary
    return float(found["measured"]["residual_compression"] / asked(found)["compression"])


def plastic(results: Path) -> Run:
    print(f"\n## Plastic ring, M^Y = {YIELD} M*\n\nF R/4M^Y × √(1 − ε²), 1 by DeRuntz & Hodge:")
    head("ε̇ T₁", *(f"ε = {e:g}" for e in AT), "changed by", "V/V₀: largest error")
    for found in crushed(results):
        change = "–" if np.isnan(found.change) else f"{100 * found.change:.2f} %"
        error = found.area[np.abs(found.area).argmax()]
        row(f"{found.rate:.2g}", *map(float, found.law), change, f"{error:+.4f}")
    print(f"\nLet go after the first of these runs, {residual(results):.3f} ε_max stays.")
    return found.run


def core(eta: float) -> Run:
    run = compress(0.352, 0.0025, 88, core_ratio=eta)
    print(f"\n## Core, η = {eta:g}\n\nAgainst the membrane stadium, and the elastica with a core:")
    head("ε", "V/V₀", "stadium", "error", "L_c/b₀ (nodes)", "stadium", "F/(p L_c)", "elastica",
         "F: error")  # fmt: skip
    for e in (0.1, 0.15, 0.2, 0.25, 0.3, 0.35):
        at = {n: float(run.loading(n, np.array([e]))[0]) for n in run.table}
        contact, area = map(float, stadium(eta, np.array(e)))
        bears = at["core_pressure"] * contact * at["diameter"]
        bent = elastica_with_core(eta, e, THICKNESS)
        force = bent.force * 12 * at["bending"] / THICKNESS**2 / at["radius"] ** 2
        row(
            f"{e:g}", at["area_ratio"], area, f"{at['area_ratio'] - area:+.4f}",
            at["contact_ratio"], contact, at["force"] / bears,
            bent.force / (2 * bent.pressure * contact), f"{100 * (at['force'] / force - 1):+.2f} %",
        )  # fmt: skip
    return run


def borne(eta: float, strain: float, thickness: float) -> tuple[float, float]:
    """Return F/(p L_c), L_c of the stadium, of a ring of this thickness; and of the elastica."""
    # The slowest vibration is of bending: a thinner ring is as slow at a greater part of it.
    rate = 0.01 * THICKNESS / thickness
    run = compress(strain + 0.002, rate, 60, core_ratio=eta, thickness=thickness)
    at = {n: float(run.loading(n, np.array([strain]))[0]) for n in run.table}
    contact = float(stadium(eta, np.array(strain))[0])
    bent = elastica_with_core(eta, strain, thickness)
    share = at["force"] / (at["core_pressure"] * contact * at["diameter"])
    return share, bent.force / (2 * bent.pressure * contact)


def thinner() -> None:
    print("\n## Thinner shells, η = 1, ε = 0.25\n\nF/(p L_c), L_c of the stadium:")
    head("h/R", "ring", "elastica", "(ring − 1) R²/h²")
    for thickness in THINNER:
        share, law = borne(1.0, 0.25, thickness)
        row(f"{thickness:g}", share, law, (share - 1) / thickness**2)


def coarse() -> None:
    print(
        "\n## Coarse rings\n\nLargest error of F of hollow rings that fold (ε > 0.29), where half "
        "the gap between the plates is so many segments:"
    )
    head("half gap / ℓ", *(f"N = {vertices}" for vertices in COARSE))
    errors = [coarse_errors(vertices) for vertices in COARSE]
    for k, (low, high) in enumerate(pairwise(HALF_GAPS)):
        found = [error[k] for error in errors]
        row(f"{low:g} to {high:g}", *("–" if np.isnan(e) else f"{100 * e:+.1f} %" for e in found))
    print("\nOf rings with a core, which sink into the plates: overlap / half the gap, error of F:")
    head("N, η, contact_stiffness", *(f"ε = {strain:g}" for strain in SINKING))
    for vertices, eta, stiffness in SUNK:
        run = compress(
            0.01 + SINKING[-1], 0.01, 41, vertices=vertices, core_ratio=eta,
            contact_stiffness=stiffness,
        )  # fmt: skip
        row(f"{vertices}, {eta:g}, {stiffness:g}", *(sinking(run, eta, e) for e in SINKING))


def sinking(run: Run, eta: float, strain: float) -> str:
    """Return overlap, weighted by load / half the gap, and the error of F, near ``strain``."""
    row = int(np.abs(run.table["compression"] - strain).argmin())
    at = {name: float(values[row]) for name, values in run.table.items()}
    half_gap = 0.5 * at["diameter"] * (1 - at["compression"])
    overlap = at["energy_contact"] / at["force"] / half_gap
    law = elastica_with_core(eta, at["compression"], THICKNESS).force * 12 / THICKNESS**2
    return f"{100 * overlap:.2f} %, {100 * (at['scaled_force'] / law - 1):+.1f} %"


def coarse_errors(vertices: int) -> list[float]:
    """Return the error of F that is the largest in each interval of `HALF_GAPS`; NaN: none."""
    table = compress(PRESSED, 0.01, 150, vertices=vertices).table
    strain = table["compression"]
    error = table["scaled_force"] * (1 - strain) ** 2 / 1.43554 - 1
    half_gap = (1 - strain) / (2 * np.tan(np.pi / vertices))
    found = []
    for low, high in pairwise(HALF_GAPS):
        there = error[(strain > 0.29) & (strain < PRESSED) & (half_gap >= low) & (half_gap < high)]
        found.append(float(there[np.abs(there).argmax()]) if len(there) else np.nan)
    return found


def profile(run: Run, strain: float) -> tuple[FloatArray, FloatArray]:
    """Return x/R and the pressure [EI/R³] of the plate at ``strain``, zero beside what touches."""
    top = int(run.table["compression"].argmax())
    k = int(np.abs(run.table["compression"][1 : top + 1] - strain).argmin())
    x, p = run.place[k], run.pressure[k]
    segment = 2 * np.sin(np.pi / VERTICES)
    gaps = np.flatnonzero(np.diff(x) > 1.5 * segment)
    free = np.concatenate([[x[0]], x[gaps + 1]]) - segment
    free = np.append(free, np.concatenate([x[gaps], [x[-1]]]) + segment)
    every, bears = np.append(x, free), np.append(p, np.zeros(len(free)))
    order = every.argsort()
    return every[order], bears[order]


def _last_two(axis: Axes) -> tuple[list[object], list[str]]:
    handles, labels = axis.get_legend_handles_labels()
    chosen = [k for k, label in enumerate(labels) if label.startswith(("its", "stadium"))]
    return [handles[k] for k in chosen], [labels[k] for k in chosen]


def draw(path: Path, runs: dict[str, Run]) -> None:
    with style.figure(style.DOUBLE, style.PAGE) as figure:
        curves(figure.subplots(4, 2).reshape(2, 4), runs)
        style.save_as(figure, path, dpi=150)


def curves(axes: NDArray[np.object_], runs: dict[str, Run]) -> None:
    """Draw the eight panels, two rows of four."""
    for name, run in runs.items():
        if name == "let go":
            continue
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
    axes[0, 1].plot(e, hinged_area(e), color="C3", ls="none", marker="s", ms=3, mfc="none",
                    label="hinges")  # fmt: skip
    axes[0, 1].legend(fontsize=style.SMALL)
    axes[0, 1].plot(beyond, 2 * (1 - beyond) - 1.01253 * (1 - beyond) ** 2, **theory)
    axes[0, 1].set(ylabel="$V/V_0$")
    axes[0, 2].plot(beyond, 2.188 * (beyond - ONSET), **theory)
    for eta in (1, 100):
        e = np.linspace(0.05, 0.35, 13)
        for axis, values in zip((axes[0, 2], axes[0, 1]), stadium(eta, e), strict=True):
            axis.plot(e, values, color="black", lw=0.6, ls=":")
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
    axes[1, 0].legend(fontsize=style.SMALL)
    for name, strain, color in (("elastic", 0.4, "C0"), ("η = 100", 0.3, "C2")):
        x, p = profile(runs[name], strain)
        axes[1, 1].plot(x, p / p.max(), "o-", color=color, ms=3, lw=0.8,
                        label=f"{name}, ε = {strain:g}")  # fmt: skip
    axes[1, 1].set(xlabel="$x/R$", ylabel="pressure of the plate / largest", ylim=(0, 1.3))
    axes[1, 1].legend(fontsize=style.SMALL, loc="upper center")
    axes[0, 2].plot([], [], "k:", lw=0.6, label="stadium, η = 1, 100")
    axes[0, 2].legend(*_last_two(axes[0, 2]), fontsize=style.SMALL, loc="upper left")
    run = runs["elastic"]
    top = int(run.table["compression"].argmax()) + 1
    e = run.table["compression"][:top]
    axes[0, 3].plot(e, run.table["width_ratio"][:top], lw=1.2, label="elastic")
    axes[0, 3].plot(e, ellipse(e), "k--", lw=0.7, label="ellipse")
    axes[0, 3].plot(e, 1 + (np.pi / 2 - 1) * e, "k:", lw=0.7, label="stadium")
    axes[0, 3].set(ylabel="$a/b_0$")
    axes[0, 3].legend(fontsize=style.SMALL)
    for name, color in (("elastic", "C0"), ("let go", "C3")):
        run = runs[name]
        top = int(run.table["compression"].argmax()) + 1
        e, area = run.table["compression"], run.table["area_ratio"]
        label = "plastic" if name == "let go" else name
        axes[1, 3].plot(e[:top], area[:top], color=color, lw=1.2, label=label)
        axes[1, 3].plot(e[top - 1 :], area[top - 1 :], "k--", lw=0.8)
    axes[1, 3].plot([], [], "k--", lw=0.8, label="back")
    axes[1, 3].set(ylabel="$V/V_0$, there and back")
    axes[1, 3].legend(fontsize=style.SMALL)
    for axis in (*axes[0], axes[1, 0], axes[1, 2], axes[1, 3]):
        axis.set_xlabel("$ε = 1 - b/b_0$")
    axes[0, 0].legend(fontsize=style.SMALL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="?", help="results folder of the plastic rings")
    parser.add_argument("figure", type=Path, nargs="?", help="path of the figure")
    given = parser.parse_args()
    if given.results is None:
        coarse()
        return
    if given.figure is None:
        parser.error("a path of the figure is needed, too")
    runs = {"elastic": compress(0.5, 0.0025, 200, unload=True)}
    print("# A ring between two plates")
    elastic(runs["elastic"])
    runs["η = 1"] = core(1.0)
    runs["η = 100"] = core(100.0)
    thinner()
    coarse()
    runs["plastic"] = plastic(given.results)
    runs["let go"] = Run(dict(let_go(given.results).columns), [], [], [])
    draw(given.figure, runs)


if __name__ == "__main__":
    main()
