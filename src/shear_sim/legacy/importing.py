"""Runs of the historical program particleShear as a study of ours: a results folder to aggregate.

An imported run keeps what it is. Its id is the hash of its own header, never that of a job of ours;
its ``run`` block names the program and the files; it has no seed and no physics version, so it
cannot be repeated. Its parameters are those of our model with the historical options, which gives
old and new studies the same columns. G' and G'' are of the internal tensor: the program kept no
periodic one. Its packings were drawn anew for every run, so points are not paired.
"""

import hashlib
import json
import math
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from shear_sim import models
from shear_sim.config import all_complaints
from shear_sim.document import NOTHING, Problem, dotted
from shear_sim.historical import estimate
from shear_sim.legacy.headers import Header, LegacyError, find_runs
from shear_sim.legacy.series import MODEL, FloatArray, derive, read_series
from shear_sim.legacy.study_file import study_sections, study_text
from shear_sim.results import FORMAT, Results, ResultsError, plan_table
from shear_sim.rheology import TENSORS, summarise
from shear_sim.runner import environment
from shear_sim.screen import Screen, duration
from shear_sim.study import Labels, parameters, read_study
from shear_sim.tables import (
    TableError,
    read_summary,
    remove_partial,
    write_arrow,
    write_table,
    write_whole,
)

PROGRAM = "particleShear"
TENSOR = "internal"  # the one that the historical analysis evaluated
HEADER_TOLERANCE = 1e-6  # relative, of the moduli that a header prints


@dataclass(frozen=True)
class Imported:
    """What an import has made: the folder, how many runs of how many points, and what is odd.

    ``differing`` are the ids of the runs whose headers print other moduli than their series give.
    """

    folder: Path
    runs: int
    points: int
    cpu_s: float
    differing: tuple[str, ...]

    def __str__(self) -> str:
        cpu = f"{duration(self.cpu_s)} of CPU, {self.cpu_s / self.runs:.2g} s each"
        lines = [f"imported: {self.runs:,} runs, {self.points:,} points: {self.folder} ({cpu})"]
        if self.differing:
            lines.append(
                f"  {len(self.differing):,} of them print other moduli than their series give "
                f"(checks.header_moduli), the first: {self.differing[0]}"
            )
        lines.append(f"next: shear-sim aggregate {self.folder}")
        return "\n".join(lines)


@dataclass(frozen=True)
class _Run:
    """A run to import: its header, and its place in the study."""

    header: Header
    parameters: dict[str, Any]
    point: str
    replicate: int
    labels: Labels

    @property
    def id(self) -> str:
        return self.header.identity

    @property
    def job(self) -> dict[str, Any]:
        """The block ``job`` of its summary."""
        identity = {"id": self.id, "replicate": self.replicate, "seed": None}
        return {**identity, "model": MODEL, "physics_version": None, "point": self.point}


def import_legacy(files: Iterable[Path], out: Path, screen: Screen | None = None) -> Imported:
    """Turn output files of particleShear into a results folder.

    The folder comes into being whole, at the end. What is read before that waits in
    ``<out>.importing``, and is not read again when the import is repeated.

    Parameters
    ----------
    files : iterable of Path
        See `shear_sim.legacy.headers.find_runs`.
    out : Path
        The results folder; its name becomes that of the study.

    Raises
    ------
    LegacyError
        With everything that is wrong with the files; ``out`` is not made then.
    ResultsError
        If ``out`` exists, or cannot be written.
    """
    cpu = time.process_time()
    if out.exists():
        msg = f"{out}: exists already; delete it, or give --out another name"
        raise ResultsError(msg)
    headers, problems = find_runs(files)
    sections = {header.identity: study_sections(header.values) for header in headers}
    for header in headers:
        problems += _complaints(header, sections[header.identity])
    if problems or not headers:
        raise LegacyError(problems or [Problem(out, None, "", NOTHING, "no files to import")])
    text = study_text(sections.values(), first=headers[0].source.header.name)
    runs, varied = _place(headers, sections, text)
    staging = Results(out.with_name(f"{out.name}.importing"))
    try:
        staging.jobs.mkdir(parents=True, exist_ok=True)
        remove_partial(staging.jobs)
        differing = _import_runs(runs, staging, screen or Screen())
        _finish(runs, varied, text, staging, out)
    except OSError as error:
        msg = f"{out}: cannot be written ({error})"
        raise ResultsError(msg) from error
    points = len({run.point for run in runs})
    return Imported(out, len(runs), points, time.process_time() - cpu, differing)


def _complaints(header: Header, sections: dict[str, Any]) -> list[Problem]:
    """Return what our model objects to in a run; names are those of our study files."""
    point = models.model(MODEL).POINT
    try:
        point.model_validate(sections)
    except ValidationError as error:
        where = header.source.header
        return [
            Problem(where, None, dotted(complaint.keys[0]), NOTHING, complaint.message)
            for complaint in all_complaints(error, point, sections)
        ]
    return []


def _place(
    headers: Sequence[Header], sections: Mapping[str, dict[str, Any]], text: str
) -> tuple[list[_Run], list[str]]:
    """Return the runs with their places in the study, and what varies between its points."""
    study = read_study(text.encode(), Path("study.yaml"))
    known = {json.dumps(json.loads(point.json), sort_keys=True): point for point in study.points}
    taken: Counter[str] = Counter()
    runs = []
    for header in sorted(headers, key=lambda h: (h.source.header.name, h.identity)):
        point = models.model(MODEL).POINT.model_validate(sections[header.identity]).resolved()
        values = parameters(point)
        key = json.dumps(values, sort_keys=True)
        name = hashlib.sha256(f"{PROGRAM} {key}".encode()).hexdigest()[:16]
        steps = round(1 / (header.values["frequency"] * header.values["time_step"]))
        values["integrator"] = {"scheme": "semi_implicit_euler", "steps_per_period": steps}
        runs.append(_Run(header, values, name, taken[name], known[key].labels))
        taken[name] += 1
    return runs, list(study.varied)


def _import_runs(runs: Sequence[_Run], staging: Results, screen: Screen) -> tuple[str, ...]:
    """Write the result files that are missing; return the ids of those with odd headers."""
    differing: list[str] = []
    problems: list[Problem] = []
    version = environment()["version"]
    screen.start(len(runs))
    began = time.monotonic()
    try:
        for done, run in enumerate(runs, 1):
            path = staging.job_file(run.id)
            try:
                summary = read_summary(path)
                if summary["job"] != run.job or summary["run"]["imported_by"]["version"] != version:
                    raise TableError
            except TableError:
                try:
                    summary = _import_run(run, path)
                except LegacyError as error:
                    problems += error.problems
                    continue
            difference = summary["checks"]["header_moduli"]
            if difference is not None and difference > HEADER_TOLERANCE:
                differing.append(run.id)
            left = (time.monotonic() - began) / done * (len(runs) - done)
            screen.update(done, len(problems), len(runs), left)
    finally:
        screen.stop()
    if problems:
        note = ""
        if waiting := len(staging.finished()):
            note = (
                f"{waiting:,} runs are read and wait in {staging.folder}: mend these files or "
                "leave them out, and give the same command again"
            )
        else:
            shutil.rmtree(staging.folder)
        raise LegacyError(problems, note)
    return tuple(differing)


def _import_run(run: _Run, path: Path) -> dict[str, Any]:
    """Read one run, write its result file, and return its summary."""
    cpu = time.process_time()
    values = run.header.values
    stored = read_series(run.header)
    columns = {**stored, **derive(stored)}
    protocol = _protocol(run.header, columns)
    summary = {
        "format": FORMAT,
        "job": run.job,
        "parameters": run.parameters,
        "derived": {
            "spring_constant": math.pi / 8 * values["Young_modulus_spheres"],
            "time_constant": values["relative_frequency"] / values["frequency"],
            "frequency": values["frequency"],
            "large_radius": values["large_radius"] * 1e-6,
            "small_radius": values["large_radius"] / values["bimodal_factor"] * 1e-6,
            "width": values["width"] * 1e-6,
            "height": values["height"] * 1e-6,
        },
        "protocol": protocol,
        "preparation": {"removed_fraction": values.get("removed_fraction")},
        "checks": {
            "asymmetry_internal": _asymmetry(columns),
            "header_moduli": _header_moduli(values, columns, protocol),
            "steps": len(columns["time"]) - 1,
        },
        **summarise(columns, protocol, TENSOR),
        "header": {
            tensor: {
                modulus: _finite(values.get(name, math.nan))
                for modulus, name in zip(("storage", "loss"), names, strict=True)
            }
            for tensor, names in _PRINTED.items()
        },
        "run": {
            "program": PROGRAM,
            "file": run.header.source.header.name,
            "table": run.header.source.table.name,
            "assumed": ", ".join(("contact law", *run.header.assumed)),
            "imported": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "import_cpu_s": round(time.process_time() - cpu, 6),
            "imported_by": environment(),
        },
    }
    write_table(path, stored, models.model(MODEL).COLUMNS, summary)
    return summary


#: What a header prints, by tensor: G' and G'' [Pa].
_PRINTED = {
    "internal": ("G'", "G''"),
    "external": ("G'(by surface force)", "G''(by surface force)"),
}


def _protocol(header: Header, columns: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return the protocol of a run; its phase is that of the strain in the table.

    The program adds the rate of each step to the strain after the stress is measured: its strain,
    and the discs with it, lag A sin θ by half a step. The start of the shear is where the sine that
    is fitted to the strain begins; ``frequency``, ``pre_periods`` and ``post_periods`` are those of
    the header, from which the historical estimators take their windows.

    Raises
    ------
    LegacyError
        If the strain is not that of the header: amplitude off by a percent, or phase by a hundredth
        of a turn (and a step).
    """
    values = header.values
    frequency, pre, periods = (values[name] for name in ("frequency", "pre_periods", "periods"))
    amplitude, time_step, time = values["amplitude"], values["time_step"], columns["time"]
    lag = 0.0
    if (whole := math.floor(periods)) >= 1:
        turns = time * frequency - pre
        moving = (turns >= 0) & (turns < whole)
        angle = 2 * np.pi * turns[moving]
        waves = np.column_stack([np.ones_like(angle), np.sin(angle), np.cos(angle)])
        strain = np.nan_to_num(columns["strain"][moving])
        _, sine, cosine = np.linalg.lstsq(waves, strain, rcond=None)[0]
        found, lag = math.hypot(sine, cosine), -math.atan2(cosine, sine) / (2 * math.pi)
        if abs(found / amplitude - 1) > 0.01 or abs(lag) > 0.01 + frequency * time_step:
            message = (
                f"the strain has amplitude {found:.6g} and lags by {lag:.2g} periods, where the "
                f"header has amplitude {amplitude:g}: not the table of this header"
            )
            raise LegacyError([Problem(header.source.table, None, "", NOTHING, message)])
    return {
        "kind": "oscillatory",
        "period": 1 / frequency,
        "steps_per_period": round(1 / (frequency * time_step)),
        "time_step": time_step,
        "shear_start": (pre + lag) / frequency,
        "shear_end": (pre + periods + lag) / frequency,
        "end": float(time[-1]),
        "periods": periods,
        "strain_amplitude": amplitude,
        "frequency": frequency,
        "pre_periods": pre,
        "post_periods": values["post_periods"],
    }


def _finite(value: float) -> float | None:
    """Return a number that JSON has: a run that blew up has others."""
    return value if math.isfinite(value) else None


def _asymmetry(columns: Mapping[str, FloatArray]) -> float | None:
    """Return the largest |σ_xy − σ_yx| of the internal tensor / its largest trace."""
    with np.errstate(invalid="ignore"):
        difference = np.abs(columns["overall_xy"] - columns["overall_yx"]).max()
    trace = np.abs(columns["overall_xx"] + columns["overall_yy"]).max()
    return _finite(float(difference / trace)) if trace != 0 else 0.0


def _header_moduli(
    values: Mapping[str, Any], columns: Mapping[str, FloatArray], protocol: Mapping[str, Any]
) -> float | None:
    """Return by how much the moduli, read as the program did, miss those that the header prints.

    The largest difference of G* / |G*| of the tensors that it prints; None where they are no
    numbers, here or there.
    """
    differences = []
    for tensor, (storage, loss) in _PRINTED.items():
        if storage not in values or loss not in values:
            continue
        printed = complex(values[storage], values[loss])
        try:
            found = estimate("header-compat", columns["time"], columns[TENSORS[tensor]], protocol)
        except ValueError:
            return None
        difference = abs(complex(found.storage, found.loss) - printed)
        differences.append(difference / (abs(printed) or 1.0))
    return _finite(max(differences))


def _finish(
    runs: Sequence[_Run], varied: Sequence[str], text: str, staging: Results, out: Path
) -> None:
    """Add study and plan to the result files, take away what is not of them, and give the name."""
    wanted = {run.id for run in runs}
    for job in staging.finished() - wanted:  # of an import of other files that was given up
        staging.job_file(job).unlink()
    for folder in (staging.failed, staging.tables, staging.figures, staging.logs):
        folder.mkdir(exist_ok=True)
    write_whole(staging.study_file, text.encode())
    points = {run.point: run.parameters for run in runs}
    rows = sorted((run.id, run.point, run.replicate, run.labels) for run in runs)
    summary = {
        "format": FORMAT,
        "study": out.name,
        "seed": 0,  # of the bootstrap: that of the study file
        "replicates": max(run.replicate for run in runs) + 1,
        "varied": list(varied),
        "models": [MODEL],
        "program": PROGRAM,
        "tensor": TENSOR,
        "paired": False,
    }
    write_arrow(staging.plan_file, plan_table(rows, points, varied), summary)
    staging.folder.rename(out)
