"""Faults tried for real: what a study loses by them.

.venv/bin/python analysis/faults.py --kills 100

Sweeps of a study are killed, stopped and starved at random moments, and started again until the
study is complete. Lost is every byte of a finished result that is gone or changed afterwards; a
fault is survived if nothing is lost and the study ends with the results and tables of one that was
left alone, to the bit. What Slurm adds (dead nodes, orphans, requeues) is in tests/slurm.
"""

import argparse
import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from shear_sim.aggregate import make_tables
from shear_sim.results import Results
from shear_sim.single import differences
from shear_sim.tables import read_table

ROOT = Path(__file__).parents[1]
COMMAND = (sys.executable, "-m", "shear_sim")
STUDY = """
packing: {discs: 200, packing_fraction: 1.5}
model: {friction: 0.01}
sweep: {grid: {shear.strain_amplitude: [0.01, 0.1, 1]}}
replicates: 8
seed: 1
"""
EDITED = STUDY.replace("[0.01, 0.1, 1]", "[0.01, 0.3, 1]")


class CannotMountError(Exception):
    """There is no small disk to be filled."""


class Row(NamedTuple):
    """One row of the table."""

    fault: str
    tried: int
    survived: int
    bytes_lost: int


class Study:
    """A study, its undisturbed results, and the folder where it is disturbed."""

    def __init__(self, folder: Path, text: str = STUDY, command: tuple[str, ...] = COMMAND) -> None:
        self.folder, self.command = folder, command
        self.file = folder / "study.yaml"
        self.file.write_text(text)
        self.root = folder / "disturbed"
        self.undisturbed = Results(folder / "undisturbed/study")
        self.sweep(folder / "undisturbed")  # with the compilation
        shutil.rmtree(folder / "undisturbed")
        began = time.monotonic()
        assert self.sweep(folder / "undisturbed")[0] == 0
        self.seconds = time.monotonic() - began
        self.tables = tables_of(self.undisturbed)

    @property
    def results(self) -> Results:
        """Results that are disturbed."""
        return Results(self.root / "study")

    def start(self, *more: str, root: Path | None = None) -> "subprocess.Popen[str]":
        """Start a sweep."""
        given = ("sweep", str(self.file), "--results", str(root or self.root), *more)
        return subprocess.Popen(
            [*self.command, *given],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def sweep(self, root: Path | None = None) -> tuple[int, str]:
        """Run a sweep to its end; return its exit code and what it said."""
        process = self.start(root=root)
        output, _ = process.communicate()
        return process.returncode, output

    def shear_sim(self, *arguments: object) -> tuple[int, str]:
        """Run any command."""
        done = subprocess.run(
            [*self.command, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout + done.stderr

    def anew(self) -> None:
        """Begin the disturbed study again."""
        if self.root.exists():
            shutil.rmtree(self.root)

    def finished(self) -> dict[str, bytes]:
        """Return all finished results as they are now."""
        return {path.name: path.read_bytes() for path in self.results.jobs.glob("*.parquet")}

    def lost(self, before: dict[str, bytes]) -> int:
        """Return how many bytes of finished results are gone or hold something else by now."""
        total = 0
        for name, content in before.items():
            path = self.results.jobs / name
            if not path.exists() or (path.read_bytes() != content and self.differs(name)):
                total += len(content)
        return total

    def differs(self, name: str) -> bool:
        """Tell whether a result is not that of the undisturbed study, timings apart."""
        pair = (results.jobs / name for results in (self.undisturbed, self.results))
        return bool(differences(*map(read_table, pair)))

    def same(self) -> bool:
        """Complete the disturbed study and compare it with the undisturbed one, to the bit."""
        code, _ = self.sweep()
        mine, theirs = self.results.finished(), self.undisturbed.finished()
        return (
            code == 0
            and mine == theirs
            and not any(self.differs(f"{job}.parquet") for job in mine)
            and all(map(pd.DataFrame.equals, tables_of(self.results), self.tables))
            and [path for path in self.results.jobs.iterdir() if path.suffix != ".parquet"] == []
            and list(self.results.checkpoints.iterdir()) == []
        )


def tables_of(results: Results) -> list[pd.DataFrame]:
    """Return the tables of a study but for what jobs cost."""
    tables = make_tables(results.folder)
    return [
        table[[name for name in table.columns if not name.startswith("run.")]]
        for _, table in sorted(tables.items())
    ]


def children(pid: int) -> list[int]:
    with contextlib.suppress(OSError):
        return list(map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))
    return []


def kill_a_worker(sweep: int, rng: random.Random) -> None:
    workers = [worker for server in children(sweep) for worker in children(server)]
    if workers:
        with contextlib.suppress(ProcessLookupError):
            os.kill(rng.choice(workers), signal.SIGKILL)


def kill_the_server(sweep: int, rng: random.Random) -> None:  # noqa: ARG001 - one of many
    for server in children(sweep):
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGKILL)


def send(number: signal.Signals) -> Callable[[int, random.Random], None]:
    def act(sweep: int, rng: random.Random) -> None:  # noqa: ARG001 - one of many
        with contextlib.suppress(ProcessLookupError):
            os.kill(sweep, number)

    return act


BLOWS: dict[str, Callable[[int, random.Random], None]] = {
    "kill -9 of the sweep": send(signal.SIGKILL),
    "kill -9 of a worker": kill_a_worker,
    "kill -9 of the server of workers": kill_the_server,
    "SIGTERM": send(signal.SIGTERM),
    "Ctrl-C": send(signal.SIGINT),
    "Slurm's warning (SIGUSR1)": send(signal.SIGUSR1),
}


def blows(study: Study, faults: Sequence[str], count: int, rng: random.Random) -> Row:
    """Strike sweeps at random moments, in turn, each going on with what the last has left."""
    lost = survived = since = 0
    study.anew()
    for blow in range(count):
        before = study.finished()
        process = study.start()
        time.sleep(rng.uniform(0, study.seconds))
        BLOWS[faults[blow % len(faults)]](process.pid, rng)
        process.communicate()
        now_lost = study.lost(before)
        lost += now_lost
        since += not now_lost
        complete = study.results.finished() == study.undisturbed.finished()
        if complete or blow == count - 1:
            survived += since if study.same() else 0
            since = 0
            study.anew()
    return Row(" or ".join(faults), count, survived, lost)


def damage(study: Study, fault: str, count: int, rng: random.Random) -> Row:
    """Damage finished results: each is found by its checksum, and left until somebody says so."""
    study.anew()
    study.sweep()
    survived = lost = 0
    jobs = sorted(study.results.finished())
    for _ in range(count):
        job = rng.choice(jobs)
        path = study.results.job_file(job)
        content = bytearray(path.read_bytes())
        if fault == "truncated result":
            del content[rng.randrange(len(content)) :]
        else:
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(content)
        before = study.finished()
        code, output = study.shear_sim("verify", study.results.folder)
        found = code == 1 and f"{job}.parquet" in output
        untouched = study.sweep()[0] == 0 and study.finished() == before
        code, _ = study.shear_sim("verify", study.results.folder, "--remove")
        kept = (study.results.folder / "damaged" / path.name).read_bytes() == content
        survived += found and untouched and kept and study.same()
        lost += study.lost({name: data for name, data in before.items() if name != path.name})
    return Row(fault, count, survived, lost)


@contextlib.contextmanager
def small_disk(folder: Path, size: str) -> Iterator[None]:
    """Mount a file system in memory; only root may."""
    folder.mkdir(parents=True, exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder]
    if subprocess.run(mount, check=False).returncode:
        msg = "file systems cannot be mounted here"
        raise CannotMountError(msg)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def remount(folder: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)


def full_disk(study: Study) -> Row:
    """Fill the disk while jobs are written, and make room again."""
    study.anew()
    half = sum(path.stat().st_size for path in study.undisturbed.jobs.iterdir()) // 2
    with small_disk(study.root, str(half)):
        code, output = study.sweep()
        before = study.finished()
        said = code == 1 and "No space left on device" in output and not study.results.failures()
        remount(study.root, "size=1g")
        survived = said and 0 < len(before) < len(study.undisturbed.finished()) and study.same()
        return Row("disk full", 1, int(survived), study.lost(before))


def read_only(study: Study) -> Row:
    """Results that cannot be written can be read; what is missing is told."""
    study.anew()
    with small_disk(study.root, "1g"):
        study.start("--limit", "5").communicate()
        before = study.finished()
        remount(study.root, "ro")
        refused = study.sweep()
        shown = study.shear_sim("status", study.results.folder)
        remount(study.root, "rw")
        survived = (
            refused[0] == 2
            and "results cannot be written" in refused[1]
            and shown[0] == 0
            and study.same()
        )
        return Row("read-only results", 1, int(survived), study.lost(before))


def two_sweeps(study: Study, count: int, rng: random.Random) -> Row:
    """Two sweeps work at one study at once, and one of them is killed."""
    survived = lost = 0
    for _ in range(count):
        study.anew()
        pair = [study.start() for _ in range(2)]
        time.sleep(rng.uniform(0, study.seconds))
        before = study.finished()
        pair[0].kill()
        for process in pair:
            process.communicate()
        lost += study.lost(before)
        survived += study.same()
    return Row("two sweeps at once, one killed", count, survived, lost)


def edited(study: Study, text: str) -> Row:
    """Edit the study between runs: only new points run, old results stay, as orphans."""
    study.anew()
    study.sweep()
    before = study.finished()
    original = study.file.read_text()
    study.file.write_text(text)
    plan = study.shear_sim("plan", study.file, "--results", study.root)[1]
    code, _ = study.sweep()
    lost = study.lost(before)
    new = len(study.results.finished()) - len(before)
    reported = f"{new} results are not of this study file" in plan and f"{new} new" in plan
    study.file.write_text(original)
    for path in study.results.jobs.iterdir():
        if path.name not in before:
            path.unlink()  # what the edited study added
    return Row("study edited between runs", 1, int(code == 0 and reported and study.same()), lost)


def show(rows: list[Row]) -> None:
    print("| fault | tried | survived | bytes lost |\n| --- | --- | --- | --- |")
    for row in rows:
        print(f"| {row.fault} | {row.tried} | {row.survived} | {row.bytes_lost} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--damages", type=int, default=10)
    chosen = parser.parse_args()
    rng = random.Random(1)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder))
        for n, fault in enumerate(BLOWS):
            count = (chosen.kills + n) // len(BLOWS)
            rows.append(blows(study, [fault], count, rng))
            print(rows[-1], flush=True)
        for fault in ("truncated result", "flipped bit in a result"):
            rows.append(damage(study, fault, chosen.damages, rng))
            print(rows[-1], flush=True)
        rows += [full_disk(study), read_only(study)]
        rows += [two_sweeps(study, 3, rng), edited(study, EDITED)]
    show(rows)


if __name__ == "__main__":
    main()
