"""Compare hard discs with soft ones in the limit of hardness, in stress and in cost.

Figure 6 of Lerner, Düring & Wyart (2013): the same start, followed from event to event and with
soft discs. And three ratios of cost: (a) to the paper's steepest descent, equations (31) and (32)
word by word, over a strain of 0.002; (b) to explicit soft discs of two stiffnesses; (c) of hard
discs followed with as large errors: by events of less accuracy, and by steps of strain.

.venv/bin/python analysis/hard_disc/soft.py          # 2 minutes of one core

draws analysis/figures/hard_disc_soft.png and prints all numbers. CPU times are of this process.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from shear_sim.compiled import jit
from shear_sim.figures import style
from shear_sim.models.hard_disc.active_set import Drive
from shear_sim.models.hard_disc.flow import Flow, contacts_at
from shear_sim.models.hard_disc.packing import Start, make_start
from shear_sim.models.hard_disc.parameters import HardDisc, HardDiscPacking
from shear_sim.models.hard_disc.stress import stress
from shear_sim.models.hard_disc.time_stepping import Marching
from shear_sim.neighbours import find_pairs
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

DISCS, PACKING_FRACTION, SEED = 100, 0.82, 1
STRAIN, RECORDS = 0.2, 2000
STIFFNESSES = (1e4, 1e5, 1e6, 1e7)
ACCURACIES = (1e-12, 1e-8, 1e-4)  # with 1e-2 contacts open by over 1e-9, and runs end arrested
STRAIN_STEPS = (1e-2, 4e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
ERRORS = (0.10, 0.02)  # mean |Δσ|/⟨σ⟩ at which costs are compared
SKIN = 0.15
LITERAL_FROM, LITERAL_STRAIN = 0.1, 0.002  # where the paper's method is timed, and over how much
STEP, DELTA_T, STOP = 1e-6, 0.1, 1e-9  # δγ, δt ξ₀ε/λ² and max |∇U| λ/ε of the paper


@jit
def add_forces(x, y, radius, i, j, nx, ny, width, height, offset, stiffness, relative, fx, fy):
    """Repulsion k·overlap, or (relative) −∇U of (32) with ε = k; return Σ f r_x r_y / r."""
    fx[:] = 0.0
    fy[:] = 0.0
    virial = 0.0
    for c in range(i.shape[0]):
        a, b = i[c], j[c]
        dx = x[b] - x[a] + nx[c] * width + ny[c] * offset
        dy = y[b] - y[a] + ny[c] * height
        d = radius[a] + radius[b]
        square = dx * dx + dy * dy
        if square >= d * d:
            continue
        r = np.sqrt(square)
        f = 2.0 * stiffness * (1.0 - r / d) / d if relative else stiffness * (d - r)
        fx[a] -= f * dx / r
        fy[a] -= f * dy / r
        fx[b] += f * dx / r
        fy[b] += f * dy / r
        virial += f * dx * dy / r
    return virial


@jit
def soft_shear(x, y, radius, side, offset, stiffness, strain, records):
    """Shear soft discs by explicit steps of 0.2/k; return −Σ f r_x r_y / (r Ω) of each record."""
    n = x.shape[0]
    out = np.empty(records)
    fx, fy = np.zeros(n), np.zeros(n)
    steps = int(np.ceil(strain * stiffness / 0.2 / records))
    h = strain / (steps * records)
    _, i, j, nx, ny = find_pairs(x, y, radius, SKIN, side, side, offset)
    strained, moved = 0.0, 0.0
    for record in range(records):
        virial = 0.0
        for _ in range(steps):
            virial = add_forces(
                x, y, radius, i, j, nx, ny, side, side, offset, stiffness, False, fx, fy
            )
            fastest = 0.0
            for d in range(n):
                x[d] += h * (y[d] + fx[d])
                y[d] += h * fy[d]
                fastest = max(fastest, fx[d] ** 2 + fy[d] ** 2)
            offset += h * side
            strained += h
            moved += 2.0 * h * np.sqrt(fastest)
            if moved + 1.5 * strained > SKIN:
                for d in range(n):
                    up = np.floor(y[d] / side)
                    y[d] -= up * side
                    x[d] -= up * offset
                    x[d] -= np.floor(x[d] / side) * side
                if offset > 0.5 * side:
                    offset -= side
                _, i, j, nx, ny = find_pairs(x, y, radius, SKIN, side, side, offset)
                strained, moved = 0.0, 0.0
        out[record] = -virial / (side * side)
    return out


@jit
def steepest_descent(x, y, radius, side, offset, increments):
    """Shear by δγ and minimise U of (32) after each; return how many steps that took."""
    n = x.shape[0]
    fx, fy = np.zeros(n), np.zeros(n)
    steps = 0
    _, i, j, nx, ny = find_pairs(x, y, radius, SKIN, side, side, offset)
    for _ in range(increments):
        for d in range(n):
            x[d] += STEP * y[d]
        offset += STEP * side
        while True:
            add_forces(x, y, radius, i, j, nx, ny, side, side, offset, 1.0, True, fx, fy)
            steps += 1
            largest = 0.0
            for d in range(n):
                largest = max(largest, fx[d] ** 2 + fy[d] ** 2)
            if largest < STOP * STOP:
                break
            for d in range(n):
                x[d] += DELTA_T * fx[d]
                y[d] += DELTA_T * fy[d]
    return steps


def hard(start: Start, accuracy: float | None = None, kind: type[Flow] = Flow) -> Flow:
    drive = Drive(1.0, 0.0, 0.0, np.zeros((2, DISCS)))
    x, y = start.x.copy(), start.y.copy()
    flow = kind(x, y, start.radius, start.mobility, start.width, start.height, drive)
    if accuracy is not None:
        flow.accuracy = accuracy
    return flow


def followed(flow: Flow) -> FloatArray:
    """Return the stress at all records, by dense output."""
    found = np.empty(RECORDS)
    at = STRAIN * np.arange(1, RECORDS + 1) / RECORDS
    made = 0

    def look(motion, path, step):
        nonlocal made
        while made < RECORDS and at[made] <= path + step * (1 + 1e-9):
            found[made] = -stress(contacts_at(motion, at[made] - path))[1]
            made += 1

    flow.advance(STRAIN, look)
    return found[:made]


def marched(flow: Marching, strain_step: float) -> FloatArray:
    """Return the stress at all records: within a step it is that of the step."""
    flow.strain_step = strain_step
    found = []
    for _ in range(round(STRAIN / strain_step)):
        flow.march()
        found.append(-stress(flow.contacts())[1])
    return np.repeat(found, RECORDS // len(found))


def cost_at(wanted: float, errors: list[float], costs: list[float]) -> float:
    """Return the cost where the error is as wanted: powers of each other from point to point."""
    order = np.argsort(errors)
    at = np.log(np.array(errors)[order]), np.log(np.array(costs)[order])
    return float(np.exp(np.interp(np.log(wanted), *at)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    packing = HardDiscPacking(discs=DISCS, packing_fraction=PACKING_FRACTION, attempts=200)
    start = make_start(packing, HardDisc(), Streams(SEED, 0))
    hard(start).advance(0.01)  # compiled
    flow = hard(start)
    begin = time.process_time()
    flow.advance(STRAIN)
    seconds = (time.process_time() - begin) / STRAIN
    exact = followed(hard(start))
    made = len(exact)
    at = STRAIN * np.arange(1, RECORDS + 1) / RECORDS
    print(f"N = {DISCS}, φ = {PACKING_FRACTION}, seed {SEED}, strain {STRAIN}")
    print(f"events: {seconds:.2f} s of CPU per unit strain,", end=" ")
    print(f"{flow.counts.collisions} collisions, mean stress {exact.mean():.3f}")
    found: dict[float, FloatArray] = {}
    errors, costs = [], []
    soft_shear(start.x.copy(), start.y.copy(), start.radius, start.width, 0.0, 1e4, 0.001, 10)
    for stiffness in STIFFNESSES:
        x, y = start.x.copy(), start.y.copy()
        begin = time.process_time()
        soft = soft_shear(x, y, start.radius, start.width, 0.0, stiffness, STRAIN, RECORDS)
        cost = (time.process_time() - begin) / STRAIN
        error = np.abs(soft[: len(exact)] - exact).mean() / exact.mean()
        median = np.median(np.abs(soft[: len(exact)] - exact)) / exact.mean()
        found[stiffness] = soft
        errors.append(error)
        costs.append(cost)
        print(
            f"(b) soft, k = {stiffness:.0e}: mean |Δσ|/⟨σ⟩ = {error:.3f}, median {median:.4f},",
            end=" ",
        )
        print(f"{cost:.1f} s per unit strain: {cost / seconds:.1f} times events", flush=True)
    soft_costs = [cost_at(wanted, errors, costs) for wanted in ERRORS]
    for wanted, cost in zip(ERRORS, soft_costs, strict=True):
        print(f"(b) soft at {wanted:.0%}: {cost / seconds:.1f} times events")
    for accuracy in ACCURACIES:
        loose = hard(start, accuracy)
        begin = time.process_time()
        loose.advance(STRAIN)
        cost = (time.process_time() - begin) / STRAIN
        error = np.abs(followed(hard(start, accuracy)) - exact).mean() / exact.mean()
        print(f"(c) events to {accuracy:.0e}: mean |Δσ|/⟨σ⟩ = {error:.1e},", end=" ")
        print(f"{cost:.2f} s per unit strain, {loose.counts.steps} steps,", end=" ")
        print(f"drift {loose.counts.largest_drift:.1e}", flush=True)
    errors, costs = [], []
    for strain_step in STRAIN_STEPS:
        steps_of = hard(start, kind=Marching)
        assert isinstance(steps_of, Marching)
        begin = time.process_time()
        signal = marched(steps_of, strain_step)
        costs.append((time.process_time() - begin) / STRAIN)
        errors.append(float(np.abs(signal[:made] - exact).mean() / exact.mean()))
        print(f"(c) steps of {strain_step:g}: mean |Δσ|/⟨σ⟩ = {errors[-1]:.3f},", end=" ")
        print(f"{costs[-1]:.2f} s per unit strain", flush=True)
    for wanted, soft_cost in zip(ERRORS, soft_costs, strict=True):
        cost = cost_at(wanted, errors, costs)
        print(f"(c) steps at {wanted:.0%}: {cost / seconds:.2f} of events,", end=" ")
        print(f"soft discs {soft_cost / cost:.1f} times that")
    flow = hard(start)
    flow.advance(LITERAL_FROM)
    x, y = flow.x.copy(), flow.y.copy()
    steepest_descent(x.copy(), y.copy(), flow.radius, flow.width, flow.offset, 1)
    begin = time.process_time()
    events_begin = flow.path
    flow.advance(LITERAL_FROM + LITERAL_STRAIN)
    near = (time.process_time() - begin) / (flow.path - events_begin)
    flow = hard(start)
    flow.advance(LITERAL_FROM)
    begin = time.process_time()
    steps = steepest_descent(
        x, y, flow.radius, flow.width, flow.offset, round(LITERAL_STRAIN / STEP)
    )
    cost = (time.process_time() - begin) / LITERAL_STRAIN
    print(f"(a) steepest descent from strain {LITERAL_FROM}, over {LITERAL_STRAIN}:", end=" ")
    print(f"{steps / LITERAL_STRAIN * STEP:.0f} steps per δγ,", end=" ")
    print(f"extrapolated {cost:.0f} s per unit strain:", end=" ")
    print(f"{cost / seconds:.0f} times events ({cost / near:.0f} times over that strain)")
    with style.figure(style.DOUBLE, 2.6) as figure:
        wide, near_axis = figure.subplots(1, 2)
        for axis, shown in ((wide, at[:made] > 0), (near_axis, np.abs(at[:made] - 0.15) < 0.01)):
            colours = style.shades(len(STIFFNESSES))
            for stiffness, colour in zip(STIFFNESSES, colours, strict=True):
                axis.plot(
                    at[:made][shown], found[stiffness][:made][shown], color=colour, linewidth=0.8,
                    label=rf"soft, $k = 10^{{{np.log10(stiffness):.0f}}}$",
                )  # fmt: skip
            axis.plot(
                at[:made][shown], exact[shown], color=style.UNORDERED[1], linewidth=0.8,
                linestyle="--", label="hard, events",
            )  # fmt: skip
            axis.xaxis.set_major_locator(MaxNLocator(5))
            axis.set(xlabel=r"strain $\gamma$", ylabel=r"stress $\sigma\xi_0/\dot\gamma$")
        handles, labels = wide.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        print(*style.save(figure, given.folder / "hard_disc_soft")[:1])


if __name__ == "__main__":
    main()
