"""Symmetric stress and angular momentum, as exact as numbers are: the claim of the method.

.venv/bin/python analysis/exactness.py exactness.png

Prints a table and draws a figure. In the first half, one default run (150 discs, crosslinked, the
published protocol): |σ_xy − σ_yx| / (|σ_xx| + |σ_yy|) of every record, for the sum over internal
contacts and for that over the whole periodic cell, with four ways to account for torques (manual,
part 1, sections 7.1.5 to 7.2.2). In the second half, an isolated cluster of frictional particles:
its angular momentum under the three lever arms of the model.
"""

import argparse
from collections.abc import Mapping

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from shear_sim.models.microgel import derive
from shear_sim.models.microgel.parameters import Damping, Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.simulation import take_pairs
from shear_sim.models.microgel.state import NX, NY, column
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]
NICOT = 2 / 3  # Nicot et al. (2013), eq. 34: the coefficients of T and K are 2/3 of those of S1-24
ARMS = ("conjugate", "particleshear", "otsuki2017")
WAYS = {  # Love–Weber plus a factor times the torques of: internal contacts, or all
    "Love–Weber alone": (0.0, "internal"),
    "with Nicot's coefficient (2/3)": (NICOT, "internal"),
    "with net torques (S1-23)": (1.0, "net"),
    "with internal torques (S1-24)": (1.0, "internal"),
}


def asymmetry(columns: Mapping[str, FloatArray], tensor: str, way: str) -> FloatArray:
    """Return |σ_xy − σ_yx| / (|σ_xx| + |σ_yy|) of every record.

    Parameters
    ----------
    tensor : str
        ``internal`` or ``periodic``.
    way : str
        A key of ``WAYS``; in the periodic cell all torques are internal.
    """
    factor, torques = WAYS[way]
    sums, torque = {
        ("internal", "internal"): ("love_weber", "internal_torque_yx"),
        ("internal", "net"): ("love_weber", "torque_yx"),
        ("periodic", "internal"): ("periodic_love_weber", "periodic_torque_yx"),
        ("periodic", "net"): ("periodic_love_weber", "torque_yx"),
    }[tensor, torques]
    half = factor * columns[torque]
    spin = factor * columns["centrifugal_xx"]
    difference = (columns[f"{sums}_xy"] - half) - (columns[f"{sums}_yx"] + half)
    trace = np.abs(columns[f"{sums}_xx"] + spin) + np.abs(columns[f"{sums}_yy"] + spin)
    return np.abs(difference) / trace


def run(point: MicrogelPoint, seed: int = 0) -> dict[str, FloatArray]:
    """Return all columns of a run."""
    simulation = prepare(point, Streams(seed, 0))
    simulation.advance(simulation.rows)
    columns = simulation.columns()
    return dict(columns) | derive(columns)


def angular_momentum(arms: str, periods: float = 20, discs: int = 60) -> FloatArray:
    """Return |L / L₀ − 1| at every step of a tumbling, ringing cluster without outer forces.

    A crosslinked, frictional packing loses the links across its edges and is set free: it expands,
    rings and turns, without drag, with friction and dashpots.
    """
    point = MicrogelPoint(
        packing=Packing(discs=discs),
        model=Microgel(
            friction=0.5, links=Links(cut="bulk"), damping=Damping(decay=1.0), lever_arms=arms
        ),
        shear=OscillatoryShear(pre_periods=periods, periods=1),  # only the rest is run
    )
    simulation = prepare(point, Streams(0, 0))
    d, links = simulation.discs, simulation.links
    simulation.links = take_pairs(links, (column(links, NX) == 0) & (column(links, NY) == 0))
    simulation.constants = simulation.constants._replace(periodic=False)
    rng = np.random.default_rng(0)
    turning = 2 * np.pi / (simulation.clock.step * simulation.clock.per_period)
    speed = 0.1 * turning * simulation.constants.width
    x, y = d.x - np.average(d.x, weights=d.mass), d.y - np.average(d.y, weights=d.mass)
    for velocity, rigid in ((d.cx, -turning * y), (d.cy, turning * x)):
        velocity[:] = rigid + speed * rng.normal(size=discs)
        velocity -= np.average(velocity, weights=d.mass)
    d.spin[:] = turning * (1 + rng.normal(size=discs))
    momentum = []
    for _ in range(simulation.clock.begin):
        momentum.append((d.mass * (d.x * d.cy - d.y * d.cx) + d.inertia * d.spin).sum())
        simulation.advance(1)
    drift = np.array(momentum)
    return np.abs(drift / drift[0] - 1)


def measure(point: MicrogelPoint, periods: float) -> tuple[str, dict[str, FloatArray]]:
    """Return the table, and the curves of the figure by name."""
    columns = run(point)
    period = columns["time"][1] / point.record.every * point.steps_per_period
    curves = {"time": columns["time"] / period}
    lines = [
        "| stress of a default run | tensor | median | largest | mean of Love–Weber's |",
        "| --- | --- | --- | --- | --- |",
    ]
    for tensor in ("internal", "periodic"):
        for way in WAYS:
            values = curves[f"{tensor} {way}"] = asymmetry(columns, tensor, way)
            share = values.mean() / curves[f"{tensor} Love–Weber alone"].mean()
            lines.append(
                f"| {way} | {tensor} | {np.median(values):.1e} | {values.max():.1e} | {share:.3g} |"
            )
    lines += ["", "| lever arms | largest change of L | largest asymmetry of S1-24, periodic |"]
    lines.append("| --- | --- | --- |")
    for arms in ARMS:
        drift = curves[arms] = angular_momentum(arms, periods)
        model = point.model.model_copy(update={"lever_arms": arms})
        columns = run(point.model_copy(update={"model": model}))
        left = asymmetry(columns, "periodic", "with internal torques (S1-24)")
        lines.append(f"| {arms} | {drift.max():.1e} | {left.max():.1e} |")
    return "\n".join(lines), curves


def draw(curves: Mapping[str, FloatArray], path: str) -> None:
    """Write the figure."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for way, colour in zip(WAYS, ("0.6", "tab:orange", "tab:green", "tab:blue"), strict=True):
        values = curves[f"internal {way}"]
        left.plot(curves["time"], np.maximum(values, 1e-18), lw=0.8, color=colour, label=way)
    left.set(
        yscale="log",
        ylim=(1e-18, 10),
        xlabel="time / $T$",
        ylabel=r"$|\sigma_{xy} - \sigma_{yx}| \, / \, (|\sigma_{xx}| + |\sigma_{yy}|)$",
        title="internal stress tensor, default run",
    )
    left.legend(frameon=False, fontsize=8, loc="center right", bbox_to_anchor=(1, 0.4))
    for arms in ARMS:
        drift = np.maximum(curves[arms], 1e-18)
        right.plot(np.arange(len(drift)), drift, lw=0.8, label=arms)
    right.set(
        yscale="log",
        ylim=(1e-18, 10),
        xlabel="steps",
        ylabel="$|L / L_0 - 1|$",
        title="angular momentum, isolated cluster",
    )
    right.legend(frameon=False, fontsize=8, loc="center right")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figure", nargs="?", default="exactness.png", help="path of the figure")
    path = parser.parse_args().figure
    table, curves = measure(MicrogelPoint(), periods=40)
    print(table)
    draw(curves, path)


if __name__ == "__main__":
    main()
