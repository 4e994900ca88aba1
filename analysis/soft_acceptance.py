"""Every target of soft particles, with what is measured: one command, one table.

.venv/bin/python analysis/soft_acceptance.py results/soft_particle_compaction

Prints a table in Markdown (kept in analysis/soft_acceptance.md). Single rings are run here (some
minutes); packs are read from the results of `configs/soft_particle_compaction.yaml`; where a target
is an invariant, its test is run. What is not there yet is listed as open.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from soft_compaction import ELASTIC_INDEX, GOALS, KINDS, kind
from soft_diametral import AT, ELASTICA, ONSET, YIELD, averaged, compress
from soft_speed import STEPS, least, packed

from shear_sim.results import read_job

TESTS = {
    "beams: exact discrete results, 1e-3": "test_beams_and_rings.py -k cantilever or supported",
    "ring: bulk modulus to 1e-3": "test_beams_and_rings.py -k bulk",
    "ring: buckling pressure 3EI/R³, slowest vibration, 1 %": "test_beams_and_rings.py "
    "-k buckles or slowest",
    "drift of the energy in 1,000 periods under 1e-6": "test_beams_and_rings.py -k drift",
    "forces are slopes of energies; no net force or torque": "test_laws.py -k slope or invarian",
    "notch of 127°: energy kept to second order": "test_contacts.py -k notch",
    "angular momentum with friction, to round-off": "test_contacts.py -k momenta or objective",
    "energy balance falls with the step: ring, collision, pack": "-k improves or missing_falls",
    "links, rigid particles": "test_links_and_rigid.py",
    "guards: passing through, inside out, folded, crushed": "test_contacts.py -k stops",
    "bad input": "-k impossible or refused or unstable or none_are or bodies",
    "oscillatory shear: ∮τ dγ of a cycle = losses, 1e-4": "-k dissipated or what_a_run_measures",
    "oscillatory shear: G′ of a crystal is its Hessian's, 1 %": "test_periodic.py -k hessian",
    "restart to the bit": "-k same_bits",
}
OPEN = (
    "tensile fracture of a tissue of 400 cells",
    "1.7 times on two threads",
)


def row(what: str, target: str, measured: str, holds: bool | None) -> None:
    verdict = "open" if holds is None else "holds" if holds else "**misses**"
    print(f"| {what} | {target} | {measured} | {verdict} |", flush=True)


def single_rings() -> None:
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
    row("flat contact: onset", f"{ONSET} ± 0.01", f"{-offset / slope:.4f}",
        abs(-offset / slope - ONSET) < 0.01)  # fmt: skip
    row("flat contact: slope", "2.188", f"{slope:.3f}", abs(slope - 2.188) < 0.05)
    missing = np.abs(run.table["energy_missing"]).max() / run.table["work"].max()
    row("energy missing, single ring", "1e-6", f"{missing:.1e}", missing < 1e-6)
    for eta in (1.0, 100.0):
        run = compress(0.352, 0.01, 88, core_ratio=eta)
        worst = share = 0.0
        for strain_at in (0.25, 0.3, 0.35):
            beta = 1 - strain_at
            length = ((1 - beta) + 0.5 * eta * beta * (1 - beta**2)) / (1 + eta * beta**2)
            values = {n: float(run.loading(n, np.array([strain_at]))[0]) for n in run.table}
            bears = values["core_pressure"] * 0.5 * np.pi * length * values["diameter"]
            worst = max(worst, abs(values["area_ratio"] - beta**2 - 2 * beta * length))
            share = max(share, abs(values["force"] / bears - 1))
        row(f"core η = {eta:g}: V/V₀ of the stadium", "0.002", f"{worst:.4f}", worst < 0.002)
        row(f"core η = {eta:g}: F = p L_c, ε ≥ 0.25", "2 %", f"{100 * share:.1f} %", share < 0.02)
    run = compress(0.505, 0.0025, 101, yield_moment=YIELD)
    unit = 4 * YIELD * run.table["bending"][0] / run.table["radius"][0] ** 2
    run.table["force_unit"] = np.full(len(run.table["time"]), unit)
    strains = np.array([min(e, 0.49) for e in AT])
    law = np.array([averaged(run, e) for e in strains]) * np.sqrt(1 - strains**2)
    error = np.abs(law - 1).max()
    row("plastic ring: DeRuntz & Hodge", "3 %", f"{100 * error:.1f} %", error < 0.03)
    phi = np.arcsin(strains)
    half = 0.5 * (np.pi / 2 - phi) - 0.5 * strains * np.sqrt(1 - strains**2)
    area = np.abs(run.loading("area_ratio", strains)
                  - 4 / np.pi * (phi * (1 - strains) + half)).max()  # fmt: skip
    row("plastic ring: V/V₀", "0.004", f"{area:.4f}", area < 0.004)


def packs(results: Path) -> None:
    jobs = [read_job(path) for path in sorted((results / "jobs").glob("*.parquet"))]
    found = {kind(job.summary): job.summary for job in jobs}
    for name in KINDS:
        if name not in found:
            row(f"compaction, {name}", "", "no result", None)
            continue
        measured, run = found[name]["measured"], found[name]["run"]
        goals = GOALS[name]
        if name != "plastic":
            goals = goals | {"compressibility_index": ELASTIC_INDEX}
        for key, (low, high) in goals.items():
            value = measured[key]
            row(f"compaction, {name}: {key}", f"{low:g} to {high:g}", f"{value:.3g}",
                low <= value <= high)  # fmt: skip
        back = measured["start_void_ratio"] - measured["unloaded_void_ratio"]
        if name != "plastic":
            row(f"compaction, {name}: e comes back to 0.02", "0.02", f"{back:.4f}", back < 0.02)
        missing = measured["energy_missing_ratio"]
        row(f"compaction, {name}: energy missing", "1e-4", f"{missing:.1e}", missing < 1e-4)
        row(f"compaction, {name}: CPU time", "10 min", f"{run['cpu_s'] / 60:.1f} min",
            run["cpu_s"] < 600)  # fmt: skip


def speed() -> None:
    for name, friction, linked, damped, goal in (
        ("elastic", 0.0, False, False, 60), ("with dashpots", 0.0, False, True, 60),
        ("with friction and links", 0.3, True, True, 90),
    ):  # fmt: skip
        system = packed(friction, linked, damped)
        vertices = len(system.motion.x)
        system.advance(STEPS)
        cost = least(lambda s=system: s.advance(STEPS), vertices, STEPS)
        row(f"speed, {name}", f"{goal} ns", f"{cost:.0f} ns per vertex and step", cost < goal)


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
    parser.add_argument("results", type=Path, help="results of the compaction study")
    results = parser.parse_args().results
    print("# What soft particles must do, and do\n")
    print("| what | target | measured | |")
    print("| --- | --- | --- | --- |")
    for what, passed, last in invariants():
        row(what, "tests pass", last.strip("= "), passed)
    single_rings()
    packs(results)
    speed()
    for what in OPEN:
        row(what, "", "not made yet", None)


if __name__ == "__main__":
    main()
