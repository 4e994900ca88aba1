"""Measure what an event of hard discs costs, how that grows with N, and what time steps cost.

.venv/bin/python analysis/hard_disc/speed.py        # 6 minutes of one core

prints CPU times of this process and draws analysis/figures/hard_disc_speed.png: cost of an event
beside that of one factor and one solution of its contact matrix, the least that any method with a
sparse solver must pay.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from shear_sim.figures import style
from shear_sim.models.hard_disc.active_set import Drive, make_factor
from shear_sim.models.hard_disc.factor import solve
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.packing import Start, make_start
from shear_sim.models.hard_disc.parameters import HardDisc, HardDiscPacking
from shear_sim.models.hard_disc.stress import stress
from shear_sim.models.hard_disc.time_stepping import Marching
from shear_sim.streams import Streams

SIZES = (32, 64, 128, 256, 512, 1024)
EVENTS = 400  # timed at each size, after a transient
TRANSIENT = 0.1


@dataclass
class Cost:
    """CPU seconds of a flow over some strain."""

    seconds: float
    strain: float
    events: int


def packed(discs: int, packing_fraction: float, seed: int = 1) -> Start:
    packing = HardDiscPacking(discs=discs, packing_fraction=packing_fraction, attempts=200)
    return make_start(packing, HardDisc(), Streams(seed, 0))


def flow(start: Start, pressure: float = 0.0, kind: type[Flow] = Flow) -> Flow:
    drive = Drive(1.0, 10.0 if pressure else 0.0, pressure, np.zeros((2, len(start.x))))
    return kind(
        start.x.copy(), start.y.copy(), start.radius, start.mobility, start.width, start.height,
        drive,
    )  # fmt: skip


def timed(f: Flow, *, strain: float = np.inf, events: float = np.inf) -> Cost:
    """Go on for so much strain or so many events."""
    begin, path = time.process_time(), f.path
    before = f.counts.collisions + f.counts.openings
    count = 0
    while f.path < path + strain and count < events:
        f.step(path + strain)
        count = f.counts.collisions + f.counts.openings - before
    return Cost(time.process_time() - begin, f.path - path, count)


def factor_time(f: Flow) -> float:
    """Return the CPU time of one factor and one solution of the present contact matrix [s]."""
    contacts = f.instant().contacts(f.set.pairs)
    load = np.ones(len(contacts[0]))
    times = []
    for _ in range(5):
        begin = time.process_time()
        for _ in range(20):
            factor = make_factor(*contacts, f.mobility, True)
            solve(factor, load.copy(), 1.0)
        times.append((time.process_time() - begin) / 20)
    return min(times)


def growth() -> tuple[list[float], list[float]]:
    """Print and return the cost of an event, and of its factor, at p = 10."""
    per_event, per_factor = [], []
    for discs in SIZES:
        f = flow(packed(discs, 0.80), 10.0)
        timed(f, strain=TRANSIENT)
        cost = timed(f, events=EVENTS)
        per_event.append(cost.seconds / cost.events)
        per_factor.append(factor_time(f))
        print(f"N = {discs}: {1e3 * per_event[-1]:.2f} ms per event,", end=" ")
        print(f"{cost.events / cost.strain / discs:.1f} events per disc and strain,", end=" ")
        print(f"{cost.seconds / cost.strain:.2f} s per unit strain;", end=" ")
        print(f"factor and solution {1e3 * per_factor[-1]:.3f} ms", flush=True)
    return per_event, per_factor


def targets() -> None:
    """Print seconds of one core per unit strain of the sizes that the project promises."""
    for discs, phi, pressure, strain, goal in (
        (64, 0.80, 10.0, 1.0, 1), (100, 0.82, 0.0, 0.2, 5), (256, 0.80, 0.0, 0.5, 8),
        (1024, 0.80, 10.0, 0.03, 150),
    ):  # fmt: skip
        f = flow(packed(discs, phi), pressure)
        timed(f, strain=TRANSIENT)
        cost = timed(f, strain=strain)
        state = f"p = {pressure:g}" if pressure else f"φ = {phi}"
        print(f"N = {discs}, {state}: {cost.seconds / cost.strain:.2f} s per unit strain", end=" ")
        print(f"(over {strain}, from {TRANSIENT} on; goal {goal})", flush=True)


def mean_stress(f: Flow, strain: float, step: float) -> float:
    """Return the mean of σ at every ``step`` of strain."""
    values = []
    for _ in range(round(strain / step)):
        f.advance(f.path + step)
        values.append(-stress(f.contacts())[1])
    return float(np.mean(values))


def time_steps() -> None:
    """Print the error of the mean stress against the step, and the cost of many discs."""
    strain, start = 0.3, packed(256, 0.80)
    exact = mean_stress(flow(start), strain, 1e-3)
    for step in (4e-3, 2e-3, 1e-3, 5e-4):
        f = flow(start, kind=Marching)
        assert isinstance(f, Marching)
        f.strain_step = step
        begin, values = time.process_time(), []
        for _ in range(round(strain / step)):
            f.march()
            values.append(-stress(f.contacts())[1])
        error = float(np.mean(values)) / exact - 1
        seconds = (time.process_time() - begin) / strain
        print(f"time steps of {step:g}, N = 256, φ = 0.80: ⟨σ⟩ {error:+.2%} from events", end=" ")
        print(f"over strain {strain}, {seconds:.1f} s per unit strain,", end=" ")
        print(f"overlap {f.counts.largest_overlap:.0e}", flush=True)
    f = flow(packed(4096, 0.80), kind=Marching)
    assert isinstance(f, Marching)
    f.strain_step = 1e-3
    for _ in range(300):
        f.march()
    begin = time.process_time()
    for _ in range(200):
        f.march()
    seconds = (time.process_time() - begin) / 0.2
    print(f"time steps of 0.001, N = 4096, φ = 0.80: {seconds:.0f} s per unit strain", end=" ")
    print(f"(over 0.2, from 0.3 on; goal 600), overlap {f.counts.largest_overlap:.0e}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    timed(flow(packed(32, 0.8), 10.0), strain=0.1)  # compiled
    per_event, per_factor = growth()
    slopes = [np.polyfit(np.log(SIZES[2:]), np.log(y[2:]), 1)[0] for y in (per_event, per_factor)]
    print(f"growth from N = {SIZES[2]} on: N^{slopes[0]:.2f} and N^{slopes[1]:.2f}")
    with style.figure(style.SINGLE, 2.6) as figure:
        axis = figure.subplots()
        for turn, (values, label) in enumerate(
            ((per_event, "an event"), (per_factor, "one factor and one solution"))
        ):
            axis.loglog(
                SIZES, np.array(values) * 1e3, color=style.UNORDERED[turn],
                marker=style.MARKERS[turn], label=f"{label}, $N^{{{slopes[turn]:.1f}}}$",
            )  # fmt: skip
        axis.set(xlabel="discs $N$", ylabel="CPU time [ms]")
        axis.set_xticks(SIZES, [str(n) for n in SIZES])
        axis.minorticks_off()
        axis.set_ylim(0.01, 40)
        axis.legend(loc="upper left")
        print(*style.save(figure, given.folder / "hard_disc_speed")[:1])
    targets()
    time_steps()


if __name__ == "__main__":
    main()
