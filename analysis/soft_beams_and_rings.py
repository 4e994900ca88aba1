r"""Beams under a force, rings under pressure and vibrating rings against closed forms; a figure.

shear-sim sweep configs/soft_beam.yaml
shear-sim sweep configs/soft_free_ring.yaml
.venv/bin/python analysis/soft_beams_and_rings.py results analysis/figures/soft_beams_and_rings.png

Prints tables in Markdown (kept in analysis/soft_beams_and_rings.md). The figure is beside figures 7
to 9 of the paper.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from shear_sim.render import Kept, read_kept

FloatArray = NDArray[np.float64]
Line = tuple[str, str, str, bool]

EXACT = {
    "clamped": lambda n: (1 + 1 / n) * (1 + 0.5 / n),
    "half_clamped": lambda n: 1 + 0.5 / n**2,
    "ends": lambda n: 1 + 2 / n**2,
}
NAMES = {"clamped": "cantilever", "half_clamped": "cantilever, half a hinge", "ends": "supported"}
SEGMENTS = 8  # of the beams whose shapes are drawn, as in figure 7
FINEST = 100  # vertices, from which on a ring is to vibrate as a continuous one


def read(results: Path) -> list[Kept]:
    return [read_kept(path) for path in sorted((results / "jobs").glob("*.parquet"))]


def asked(job: Kept) -> dict[str, Any]:
    """Return what varies in these studies."""
    given = job.table.summary["parameters"]
    return given["shear"] | {"n": given["packing"]["vertices"], "eta": given["model"]["core_ratio"]}


def of_kind(jobs: list[Kept], **wanted: object) -> list[Kept]:
    """Jobs of these parameters, by their number of segments."""
    found = (job for job in jobs if wanted.items() <= asked(job).items())
    return sorted(found, key=lambda job: (asked(job)["n"], asked(job)["eta"]))


def measured(job: Kept) -> dict[str, float]:
    return dict(job.table.summary["measured"])


def order(jobs: list[Kept]) -> tuple[float, float]:
    """Exponent and factor of δ/δ_th − 1 against 1/n, of the two finest beams."""
    n = np.array([asked(job)["n"] for job in jobs[-2:]])
    error = np.array([measured(job)["final_deflection_ratio"] for job in jobs[-2:]]) - 1
    slope = np.log(error[1] / error[0]) / np.log(n[0] / n[1])
    return float(slope), float(error[1] * n[1] ** round(slope))


def goals(beams: list[Kept], rings: list[Kept]) -> Iterator[Line]:
    """Yield what is asked for, the goal, what is measured, and whether that holds."""
    for support, name in NAMES.items():
        jobs = of_kind(beams, support=support)
        exact = EXACT[support]
        worst = max(abs(measured(j)["final_deflection_ratio"] - exact(asked(j)["n"])) for j in jobs)
        yield (f"{name}: deflection of discrete hinges", "1e-3", f"{worst:.1e}", worst < 1e-3)
        power, factor = order(jobs)
        aim = {"clamped": (1, 1.5), "half_clamped": (2, 0.5), "ends": (2, 2.0)}[support]
        yield (f"{name}: δ/δ_th − 1", f"{aim[1]:g}/n{'²' if aim[0] == 2 else ''}",
               f"{factor:.3g}/n^{power:.2f}",
               abs(power - aim[0]) < 0.05 and abs(factor / aim[1] - 1) < 0.05)  # fmt: skip
    pressed = of_kind(rings, kind="pressure", pressure=1.0)
    worst = max(abs(measured(job)["bulk_modulus_ratio"] - 1) for job in pressed)
    yield ("ring: bulk modulus, N = 12 to 200, η = 0 and 3", "1e-3", f"{worst:.1e}", worst < 1e-3)
    (buckling,) = of_kind(rings, kind="pressure", pressure=3.5)
    found = measured(buckling)["buckling_pressure_ratio"]
    yield "ring: buckling pressure R³/EI", "3 ± 1 %", f"{found:.3f}", abs(found / 3 - 1) < 0.01
    free = of_kind(rings, kind="vibration", periods=10)
    worst = max(abs(measured(j)["frequency_ratio"] - 1) for j in free if asked(j)["n"] >= FINEST)
    yield ("ring: slowest vibration, N = 100 and 200", "1 %", f"{100 * worst:.2f} %", worst < 0.01)
    (long,) = of_kind(rings, kind="vibration", periods=1000)
    drift = abs(measured(long)["energy_drift"])
    yield "ring: drift of the energy in 1,000 periods", "1e-6", f"{drift:.1e}", drift < 1e-6
    worst = max(measured(job)["energy_missing_ratio"] for job in beams + rings)
    yield "beams and rings: energy missing / work", "1e-6", f"{worst:.1e}", worst < 1e-6


def buckled(height: float) -> tuple[float, float]:
    """Return p R³/EI and the ovality of an inextensible ring whose half height is ``height`` R.

    A quarter of it, from the top, φ downwards: its moment grows by p r²/2 (statics), so

        x′ = cos φ,  y′ = −sin φ,  φ′ = c + (p/2)(x² + y²)
    """

    def slopes(_: FloatArray, z: FloatArray, given: FloatArray) -> FloatArray:
        x, y, phi = z
        return np.array([np.cos(phi), -np.sin(phi), given[0] + 0.5 * given[1] * (x * x + y * y)])

    def ends(low: FloatArray, high: FloatArray, given: FloatArray) -> FloatArray:  # noqa: ARG001
        return np.array([low[0], low[1] - height, low[2], high[1], high[2] - 0.5 * np.pi])

    s = np.linspace(0, 0.5 * np.pi, 200)
    wide = 2.0 - height
    guess = np.array([wide * np.sin(s), height * np.cos(s), s])
    found = solve_bvp(slopes, ends, s, guess, p=[-0.5, 3.0], tol=1e-8, max_nodes=50_000)
    assert found.success, found.message
    at = np.linspace(0, 0.5 * np.pi, 401)
    x, y, _ = found.sol(at)
    # As the ovality of a run: of what is farther out along the radius at rest.
    out = x * np.sin(at) + y * np.cos(at)
    oval = -2.0 * np.trapezoid(out * np.cos(2.0 * at), at) / (0.5 * np.pi)
    return float(found.p[1]), float(oval)


def table(jobs: list[Kept], column: str, title: str) -> None:
    supports = {asked(job)["n"] for job in jobs}
    print(f"| {title} | " + " | ".join(f"n = {n}" for n in sorted(supports)) + " |")
    print("| --- " * (len(supports) + 1) + "|")
    for support, name in NAMES.items():
        mine = of_kind(jobs, support=support)
        for what, values in (
            (name, [measured(job)[column] for job in mine]),
            ("exact", [EXACT[support](asked(job)["n"]) for job in mine]),
        ):
            print(f"| {what} | " + " | ".join(f"{value:.5f}" for value in values) + " |")


def shape(axis: Axes, job: Kept, look: str, label: str) -> None:
    """Draw the deflection along a beam over that where the force is."""
    x, y = job.snapshots[0].position.T
    if asked(job)["support"] != "ends":
        x, y = x[1:], y[1:]  # the first one is of the clamp
    x = (x - x[0]) / np.ptp(x)
    axis.plot(x, (y - y[0]) / np.abs(y - y[0]).max(), look, ms=4, mfc="none", label=label)


def draw(path: str, beams: list[Kept], rings: list[Kept]) -> None:
    figure, axes = plt.subplots(2, 3, figsize=(9.5, 5.6), layout="constrained")
    x = np.linspace(0, 1, 101)
    axes[0, 0].plot(x, 0.5 * x**2 * (3 - x), "C0-", lw=1)
    half = np.minimum(x, 1 - x)
    axes[0, 0].plot(x, 3 * half - 4 * half**3, "C2-", lw=1, label="force in the middle")
    uniform = 3.2 * x * (1 - 2 * x**2 + x**3)
    axes[0, 0].plot(x, uniform, "k:", lw=1, label="paper (16): spread load")
    for support, look in (("half_clamped", "C0o"), ("ends", "C2s")):
        shape(axes[0, 0], of_kind(beams, support=support, n=SEGMENTS)[0], look, NAMES[support])
    axes[0, 0].set(xlabel="$x/L$", ylabel="$δ/δ_{max}$", ylim=(0, 1.45))
    for number, (support, name) in enumerate(NAMES.items()):
        jobs = of_kind(beams, support=support)
        n = np.array([asked(job)["n"] for job in jobs])
        ratio = np.array([measured(job)["final_deflection_ratio"] for job in jobs])
        color = f"C{(1, 0, 2)[number]}"
        axes[0, 1].plot(1 / n, ratio - 1, "o", color=color, ms=4, mfc="none", label=name)
        fine = np.geomspace(n.min(), n.max(), 50)
        axes[0, 1].plot(1 / fine, EXACT[support](fine) - 1, color=color, lw=0.8)
    axes[0, 1].set(xscale="log", yscale="log", xlabel="$1/n$", ylabel="$δ/δ_{th} - 1$")
    axes[0, 1].set_xticks([1 / 48, 1 / 20, 1 / 8], ["1/48", "1/20", "1/8"])
    for eta, look in ((0.0, "C0o"), (3.0, "C1s")):
        jobs = of_kind(rings, kind="pressure", pressure=1.0, eta=eta)
        n = [asked(job)["n"] for job in jobs]
        away = [1e3 * (measured(job)["bulk_modulus_ratio"] - 1) for job in jobs]
        axes[0, 2].plot(n, away, look, ms=4, mfc="none", label=f"η = {eta:g}")
    axes[0, 2].axhspan(-1, 1, color="0.93")
    axes[0, 2].set(xscale="log", xlabel="$N$", ylim=(-1.5, 1.5),
                   ylabel="$1000\\,[K/(K_Ω + k_s \\tan π/N) - 1]$")  # fmt: skip
    axes[0, 2].set_xticks([12, 24, 48, 100, 200], ["12", "24", "48", "100", "200"])
    (job,) = of_kind(rings, kind="pressure", pressure=3.5)
    columns = job.table.columns
    axes[1, 0].plot(columns["ovality"], columns["outer_pressure_ratio"], lw=1.2, label="ring")
    law = np.array([buckled(height) for height in np.linspace(0.97, 0.55, 15)])
    use = law[:, 1] < columns["ovality"].max()
    axes[1, 0].plot(law[use, 1], law[use, 0], "ko", ms=3, mfc="none", label="elastica")
    axes[1, 0].axhline(3, color="k", ls=":", lw=0.8)
    axes[1, 0].set(xlabel="ovality $a/R$", ylabel="$pR^3/EI$")
    job = of_kind(rings, kind="vibration", periods=10)[-1]
    columns = job.table.columns
    period = job.table.summary["derived"]["slowest_period"]
    time = columns["time"] / period
    axes[1, 1].plot(time, 100 * columns["ovality"], lw=1.2, label=f"ring, N = {asked(job)['n']}")
    fine = np.linspace(0, time[-1], 500)
    amplitude = 100 * asked(job)["amplitude"]
    axes[1, 1].plot(fine, amplitude * np.sin(2 * np.pi * fine), "k:", lw=1, label="$\\sin ω_1t$")
    axes[1, 1].set(xlabel="$t/T_1$", ylabel="$100\\,a/R$", xlim=(0, 5), ylim=(-1.1, 1.6))
    (job,) = of_kind(rings, kind="vibration", periods=1000)
    columns = job.table.columns
    time = columns["time"] / job.table.summary["derived"]["slowest_period"]
    missing = columns["energy_missing"] / columns["energy_kinetic"][0]
    axes[1, 2].plot(time[::7], 1e7 * missing[::7], ".", ms=1)
    axes[1, 2].set(xlabel="$t/T_1$", ylabel="$10^7$ energy missing / energy")
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
        axis.minorticks_off()
        axis.tick_params(labelsize=7)
    for axis in (*axes[0], *axes[1, :2]):
        axis.legend(frameon=False, fontsize=7)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder with the results of both studies")
    parser.add_argument("figure", help="path of the figure")
    given = parser.parse_args()
    beams, rings = read(given.results / "soft_beam"), read(given.results / "soft_free_ring")
    print("# Beams and free rings\n")
    table(beams, "final_deflection_ratio", "δ/δ_th")
    print("\n| what | goal | measured | |")
    print("| --- | --- | --- | --- |")
    for what, goal, found, holds in goals(beams, rings):
        print(f"| {what} | {goal} | {found} | {'holds' if holds else '**misses**'} |")
    draw(given.figure, beams, rings)


if __name__ == "__main__":
    main()
