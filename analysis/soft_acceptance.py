"""Every target of soft particles, with what is measured: one command, one table.

.venv/bin/python analysis/soft_acceptance.py results

Prints a table in Markdown (kept in analysis/soft_acceptance.md). Where a target is an invariant,
its test is run, and elastic single rings are run here (a quarter of an hour in all); all others
are read from the results of their studies in `configs/`. What is not there yet is listed as open.
"""

import argparse
import itertools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from soft_beams_and_rings import goals as beam_goals
from soft_beams_and_rings import read
from soft_compaction import KINDS, PREPARATIONS, read_packs, under_the_lid
from soft_compaction import goals as pack_goals
from soft_compaction import measured as measured_of
from soft_diametral import (
    ELASTICA,
    ONSET,
    SLOWER,
    THICKNESS,
    THINNER,
    YIELD,
    Run,
    borne,
    compress,
    crushed,
    elastica_with_core,
    stadium,
    touching_onset,
)
from soft_speed import PACKINGS, STEPS, by_threads, least, packed
from soft_suspension import gates
from soft_tissue import goals, read_tissues

from shear_sim.aggregate import load

TESTS = {
    "forces are slopes of energies; no net force or torque": "test_laws.py -k slope or invarian",
    "notch of 127°: energy kept to second order": "test_contacts.py -k notch",
    "angular momentum with friction, to round-off": "test_contacts.py -k momenta or objective",
    "energy balance falls with the step: ring, collision, pack": "-k improves or missing_falls",
    "links, rigid particles, a share of them in a box": "-k link or rigid",
    "core laws, turgor": "test_cores.py",
    "dashpots and friction of walls: closed forms": "test_dashpots.py",
    "what a study keeps of a run, from tables made by hand": "test_measured.py",
    "a lid under a load": "test_compaction.py -k load",
    "bars that yield: under a pressure, and too far": "-k bars_yield or bars_that_yield",
    "guards: passing through, inside out, folded, crushed": "test_contacts.py -k stops",
    "bad input": "-k impossible or refused or unstable or none_are or test_checks or test_steps",
    "tissue: tessellation, links, energies": "-k tissue or tension or link",
    "oscillatory shear: ∮τ dγ of a cycle = losses, 1e-4": "-k dissipated or what_a_run_measures",
    "oscillatory shear: G′ of a crystal is its Hessian's, 1 %": "test_periodic.py -k hessian",
    "restart to the bit; the same bits on 1, 2, 3 threads": "-k same_bits",
}
FASTER = 1.7  # on two threads, of one


def row(what: str, target: str, measured: str, holds: bool | None) -> None:
    verdict = "open" if holds is None else "holds" if holds else "**misses**"
    print(f"| {what} | {target} | {measured} | {verdict} |", flush=True)


def single_rings(results: Path) -> None:
    run = compress(0.5, 0.005, 200)
    at = ELASTICA[:, 0]
    force = np.abs(run.loading("scaled_force", at) / ELASTICA[:, 1] - 1).max()
    area = np.abs(run.loading("area_ratio", at) - ELASTICA[:, 2]).max()
    e = np.linspace(0.3, 0.49, 20)
    flat = np.abs(run.loading("scaled_force", e) * (1 - e) ** 2 / 1.43554 - 1).max()
    beyond = 2 * (1 - e) - 1.01253 * (1 - e) ** 2
    area = max(area, np.abs(run.loading("area_ratio", e) - beyond).max())
    row("elastic ring: force of the elastica", "1.5 %", f"{100 * max(force, flat):.2f} %",
        max(force, flat) < 0.015)  # fmt: skip
    row("elastic ring: V/V₀", "0.002", f"{area:.4f}", area < 0.002)
    strain, load = run.table["compression"], run.table["load_ratio"]
    use = strain > 0.32
    slope, offset = np.polyfit(strain[use], load[use], 1)
    found = {"distance of the loads": (-offset / slope, slope)}
    for vertices in (100, 200):
        found[f"length that touches, N = {vertices}"] = touching_onset(vertices)
    for what, (onset, slope) in found.items():
        row(f"flat contact: onset, {what}", f"{ONSET} ± 0.01", f"{onset:.4f}",
            abs(onset - ONSET) < 0.01)  # fmt: skip
        row(f"flat contact: slope, {what}", "2.188", f"{slope:.3f}", abs(slope - 2.188) < 0.05)
    energies("elastic ring", run)
    plastic = compress(0.352, 0.01, 176, unload=True, core_ratio=100.0, yield_moment=YIELD)
    energies("plastic ring, core η = 100, there and back", plastic)
    for eta in (1.0, 100.0):
        run = compress(0.352, 0.01, 88, core_ratio=eta)
        energies(f"core η = {eta:g}", run)
        at = np.array([0.25, 0.3, 0.35])
        values = {name: run.loading(name, at) for name in run.table}
        contact, whole = stadium(eta, at)
        bears = values["core_pressure"] * contact * values["diameter"]
        worst = np.abs(values["area_ratio"] - whole).max()
        share = np.abs(values["force"] / bears - 1).max()
        bent = np.array([elastica_with_core(eta, e, THICKNESS).force for e in at])
        bent *= 12 * values["bending"] / (THICKNESS * values["radius"]) ** 2
        law = np.abs(values["force"] / bent - 1).max()
        row(f"core η = {eta:g}: V/V₀ of the stadium", "0.002", f"{worst:.4f}", worst < 0.002)
        row(f"core η = {eta:g}: F = p L_c, ε ≥ 0.25", "2 %", f"{100 * share:.1f} %", share < 0.02)
        row(f"core η = {eta:g}: F of the elastica with this core, ε ≥ 0.25", "1 %",
            f"{100 * law:.1f} %", law < 0.01)  # fmt: skip
    share = abs(borne(1.0, 0.25, THINNER[-1])[0] - 1)
    row(f"core η = 1, half as thick (h = {THINNER[-1]:g} R): F = p L_c, ε = 0.25", "2 %",
        f"{100 * share:.1f} %", share < 0.02)  # fmt: skip
    *_, found = crushed(results)
    error, area = np.abs(found.law - 1).max(), np.abs(found.area).max()
    row("plastic ring: DeRuntz & Hodge", "3 %", f"{100 * error:.1f} %", error < 0.03)
    change = f"{100 * found.change:.2f} %, at ε̇ T₁ = {found.rate:.2g}"
    row("plastic ring: change of F at a quarter of the speed", f"{100 * SLOWER:g} %", change,
        found.change < SLOWER)  # fmt: skip
    row("plastic ring: V/V₀", "0.004", f"{area:.4f}", area < 0.004)


def energies(what: str, run: Run) -> None:
    missing = np.abs(run.table["energy_missing"]).max() / run.table["work"].max()
    row(f"{what}: energy missing / work", "1e-6", f"{missing:.1e}", missing < 1e-6)


def packs(results: Path) -> None:
    found = read_packs(results)
    for preparation, name in itertools.product(PREPARATIONS, KINDS):
        what = f"compaction, {name} by {preparation}"
        if (preparation, name) not in found:
            row(what, "", "no result", None)
            continue
        kept = found[preparation, name]
        measured, run = measured_of(kept), kept.table.summary["run"]
        for key, (low, high) in pack_goals(name).items():
            value = measured.get(key, np.nan)  # nan: the pack did not bear so much
            row(f"{what}: {key}", f"{low:g} to {high:g}", f"{value:.3g}", low <= value <= high)
        back = measured["start_void_ratio"] - measured["unloaded_void_ratio"]
        if name != "plastic":
            row(f"{what}: e comes back to 0.02", "0.02", f"{back:.4f}", abs(back) < 0.02)
        missing = measured["energy_missing_ratio"]
        row(f"{what}: energy missing", "1e-4", f"{missing:.1e}", missing < 1e-4)
        seconds = run["cpu_s"] * under_the_lid(kept)
        row(f"{what}: CPU time of load and unload (by its share of the steps)", "10 min",
            f"{seconds / 60:.1f} min", seconds < 600)  # fmt: skip


def speed() -> None:
    systems = []
    for name, (friction, linked, damped) in PACKINGS.items():
        goal = 90 if friction else 60
        system = packed(friction, linked, damped)
        vertices = len(system.motion.x)
        system.advance(STEPS)
        cost = least(lambda s=system: s.advance(STEPS), vertices, STEPS)
        systems.append(system)
        row(f"speed, {name}", f"{goal} ns", f"{cost:.0f} ns per vertex and step", cost < goal)
    for name, times in zip(PACKINGS, by_threads(systems), strict=True):
        row(f"speed, {name}: two threads against one", f"{FASTER:g}",
            f"{times[1] / times[2]:.2f} times", times[1] / times[2] > FASTER)  # fmt: skip


def invariants() -> Iterator[tuple[str, bool, str]]:
    folder = Path(__file__).parents[1] / "tests/soft_particle"
    for what, choice in TESTS.items():
        file, _, words = choice.partition("-k")
        command = [sys.executable, "-m", "pytest", "-q", "--no-header", str(folder / file.strip())]
        command += ["-k", words.strip()] if words else []
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = done.stdout.strip().splitlines()[-1]
        yield what, done.returncode == 0, last


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder with the results of the studies")
    results = parser.parse_args().results
    print("# What soft particles must do, and do\n")
    print("| what | target | measured | |")
    print("| --- | --- | --- | --- |")
    for what, passed, last in invariants():
        row(what, "tests pass", last.strip("= "), passed)
    beams, rings = read(results / "soft_beam"), read(results / "soft_free_ring")
    for line in beam_goals(beams, rings):
        row(*line)
    single_rings(results / "soft_plastic_ring")
    packs(results / "soft_particle_compaction")
    for line in goals(read_tissues(results / "soft_tissue")):
        row(*line)
    for study in ("soft_suspension", "three_methods"):
        runs = load(results / study / "tables/runs.parquet")
        for what, *line in gates(runs[runs["cycle_missing_ratio"].notna()]):
            row(f"{study}: {what}", *line)
    speed()


if __name__ == "__main__":
    main()
