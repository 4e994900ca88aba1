"""The folder of one study's results: what lies where, what is done, what failed, and the index.

::

    results/<study>/
      study.yaml            the study file as given
      plan.parquet          the jobs of the study as last planned: id, labels, varied keys
      jobs/<job id>.parquet one per finished job: series and summary
      snapshots/<job id>.gsd, .contacts.parquet   particles and contacts, where they are recorded
      failed/<job id>.json  one per failed job: why
      submissions/          one file per job number of Slurm, and which jobs its tasks have
      checkpoints/          jobs that were stopped, or take long: they go on from there
      damaged/              results that `shear-sim verify --remove` found and set aside
      index.parquet         summaries of all finished jobs; a cache, rebuilt at any time
      tables/ figures/ logs/

A job is done if and only if its file in ``jobs/`` exists. There are no locks: two processes that
run the same job write the same bytes.
"""

import contextlib
import hashlib
import itertools
import json
import os
import tempfile
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from shear_sim import models, snapshots
from shear_sim.tables import (
    Table,
    TableError,
    read_arrow,
    read_summary,
    read_table,
    remove_partial,
    to_json,
    write_arrow,
    write_whole,
)

if TYPE_CHECKING:
    import pyarrow

    from shear_sim.study import Labels, Study

FORMAT = 1  # of result files, plan and index; raised when an older program cannot read them
INDEX_FORMAT = 3
STAMPED = ("job", "bytes", "mtime_ns")  # columns by which the index knows a result file again
_ROWS_AT_ONCE = 2000  # of the index

FailureKind = Literal["physics", "crash", "error"]


class ResultsError(Exception):
    """A results folder or a job in it is not what was asked for; says which and what to do."""


@dataclass(frozen=True)
class Failure:
    """Why a job has no result.

    ``kind`` is ``physics`` (the simulation says that it cannot go on: the same again at every
    try), ``crash`` (its process died) or ``error`` (an exception: a bug or the machine).
    """

    job: str
    kind: FailureKind
    reason: str
    tries: int = 1
    exit_code: int | None = None
    signal: str | None = None
    traceback: tuple[str, ...] = ()


class Results:
    """The results of one study."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.jobs = folder / "jobs"
        self.snapshots = folder / "snapshots"
        self.failed = folder / "failed"
        self.checkpoints = folder / "checkpoints"
        self.submissions = folder / "submissions"
        self.tables = folder / "tables"
        self.figures = folder / "figures"
        self.logs = folder / "logs"
        self.study_file = folder / "study.yaml"
        self.plan_file = folder / "plan.parquet"
        self.index_file = folder / "index.parquet"
        self.report_file = folder / "report.html"

    @classmethod
    def existing(cls, folder: Path) -> "Results":
        """Return the results in ``folder``, which must be there.

        Raises
        ------
        ResultsError
            If it is not a results folder.
        """
        results = cls(folder)
        if not results.jobs.is_dir():
            hint = "give results/<study>, as made by `shear-sim sweep STUDY.yaml`"
            msg = f"{folder}: not a results folder (no jobs/ in it); {hint}"
            raise ResultsError(msg)
        results.refuse_newer()
        return results

    def prepare(self, study: "Study", *, keep_plan: bool = True) -> None:
        """Make the folders, keep the study file and its plan, and clean up after killed writers.

        Only one task of an array keeps them (``keep_plan``), where they are there: no file is
        written again and again by all.

        Raises
        ------
        ResultsError
            If the folder cannot be written, or holds runs that were imported.
        """
        self.refuse_others()
        try:
            for name in ("jobs", "failed", "checkpoints", "tables", "figures", "logs"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
                remove_partial(self.folder / name)
            with tempfile.TemporaryFile(dir=self.jobs):
                pass  # or nothing of this would have been written
            for path in self.checkpoints.glob("*.pickle"):
                if self.job_file(path.stem).exists():  # by another run of the same job
                    with contextlib.suppress(OSError):  # a folder of that name does no harm
                        path.unlink()
            remove_partial(self.snapshots)
            remove_partial(self.folder)
            if not keep_plan and self.study_file.exists() and self.plan_file.exists():
                return
            text = study.text.encode()
            if not self.study_file.exists() or self.study_file.read_bytes() != text:
                write_whole(self.study_file, text)
            self._keep_plan(study)
        except OSError as error:
            msg = f"{self.folder}: results cannot be written ({error})"
            raise ResultsError(msg) from error

    def _keep_plan(self, study: "Study") -> None:
        """Write ``plan.parquet`` unless it is there: every shard has the same one."""
        jobs = sorted(
            (job.id, point, job.replicate, job.labels)
            for point, of in study.groups().items()
            for job in of
        )
        summary = {
            "format": FORMAT,
            "study": study.name,
            "seed": study.seed,
            "replicates": study.replicates,
            "varied": list(study.varied),
            "models": sorted({point.point.kind for point in study.points}),
        }
        points = {point.id: json.loads(point.json) for point in study.points}
        table = plan_table(jobs, points, study.varied)
        with contextlib.suppress(TableError):  # none yet, or a damaged one
            if self.plan()[1] == summary and self.plan()[0].equals(table):
                return
        write_arrow(self.plan_file, table, summary)

    def plan(self) -> "tuple[pyarrow.Table, dict[str, Any]]":
        """Return the study as last planned: one row a job, and what the study says of itself.

        Columns: ``job``, ``point`` (the id that its replicates share), ``replicate``, ``labels``
        (JSON: the [block, scene] pairs that the job belongs to) and every key that varies, under
        its name in the study file.

        Raises
        ------
        TableError
            If there is no plan or it is damaged.
        """
        try:
            return read_arrow(self.plan_file), read_summary(self.plan_file)
        except TableError as error:
            msg = f"{error}: `{self.command()}` makes it"
            raise TableError(msg) from error

    def command(self) -> str:
        """Return the command that makes what is missing in this folder."""
        if self.program():
            return "shear-sim import-legacy FILES --out ANOTHER"
        return "shear-sim sweep STUDY.yaml"

    def study_text(self) -> str:
        """Return the study file as last given.

        Raises
        ------
        ResultsError
            If it is missing or damaged.
        """
        try:
            return self.study_file.read_text("utf-8")
        except (OSError, UnicodeError) as error:
            msg = f"{self.study_file}: cannot be read ({error}): `{self.command()}` writes it again"
            raise ResultsError(msg) from error

    def program(self) -> str | None:
        """Return the program whose runs were imported into this folder; None: they are ours."""
        return _program(self._about())

    def refuse_newer(self) -> None:
        """Refuse to touch what this version does not know.

        Raises
        ------
        ResultsError
            If a newer version of the program has made these results.
        """
        self._about()

    def refuse_others(self) -> None:
        """Refuse to add runs of ours to imported ones, or to those of a newer version.

        Raises
        ------
        ResultsError
            If the folder holds such runs, or nothing in it says whether it does.
        """
        about = self._about()
        if program := _program(about):
            msg = (
                f"{self.folder}: holds runs imported from {program}, to which none of ours are "
                "added: give --results another folder"
            )
            raise ResultsError(msg)
        if not about and self.finished():
            msg = (
                f"{self.folder}: neither the plan nor any result can be read, so whose runs these "
                f"are is not known: `shear-sim verify {self.folder} --remove` sets them aside, or "
                "give --results another folder"
            )
            raise ResultsError(msg)

    def _about(self) -> dict[str, Any]:
        """Return what the plan says of these results, or else any result; {} if none can be read.

        Raises
        ------
        ResultsError
            If a newer version of the program has made them.
        """
        for path in itertools.chain([self.plan_file], _listing(self.jobs, ".parquet")):
            with contextlib.suppress(TableError):
                summary = read_summary(path)
                _refuse_newer(path, summary)
                return summary
        return {}

    def job_file(self, job: str) -> Path:
        """Return where the result of the job with this id lies, or will lie."""
        return self.jobs / f"{job}.parquet"

    def finished(self) -> set[str]:
        """Return the ids of all jobs that have a result, from one listing."""
        return {path.stem for path in _listing(self.jobs, ".parquet")}

    def stamps(self) -> dict[str, list[int]]:
        """Return size and time of change [ns] of all results, by job id, from one listing."""
        return _stamps(self.jobs, ".parquet")

    def fingerprint(self) -> str:
        """Return what changes whenever a result is added, replaced or removed."""
        listing = json.dumps(self.stamps(), sort_keys=True)
        return f"of results {hashlib.sha256(listing.encode()).hexdigest()}"

    def snapshot_bytes(self) -> int:
        """Return the size of all snapshots, from one listing."""
        return sum(count for count, _ in _stamps(self.snapshots, "").values())

    def failures(self, finished: Collection[str] | None = None) -> dict[str, Failure]:
        """Return the failed jobs that have no result, by id; ``finished``, if it is known."""
        paths = {path.stem: path for path in _listing(self.failed, ".json")}
        if finished is None:
            finished = self.finished() if paths else set()
        found = {}
        for job, path in sorted(paths.items()):
            if job not in finished:  # otherwise a later try has succeeded
                found[job] = read_failure(path)
        return found

    def record_failure(self, failure: Failure) -> Failure:
        """Keep why a job failed, in ``failed/<job id>.json``; return it with all tries counted."""
        path = self.failed / f"{failure.job}.json"
        if path.exists():
            failure = replace(failure, tries=failure.tries + read_failure(path).tries)
        text = json.dumps(asdict(failure), indent=2, ensure_ascii=False)
        write_whole(path, f"{text}\n".encode())
        return failure

    def forget_failure(self, job: str) -> None:
        """Remove the record of a failure: a later try has succeeded."""
        (self.failed / f"{job}.json").unlink(missing_ok=True)

    def index(self) -> "pyarrow.Table":
        """Return one row per finished job: the numbers, words and flags of its summary.

        Columns are ``job``, ``point``, ``replicate``, ``seed``, every parameter under its name in
        the study file (``shear.strain_amplitude``), and the rest of the summary with dotted names
        (``moduli.periodic.storage``, ``run.cpu_s``). Lists are left to the job's own file, but for
        those of the moduli (harmonics and periods).
        ``bytes`` is the size of that file. Rows are sorted by job id.

        Only files that are new, or have another size or time of change than in the kept index, are
        read; rows of deleted ones go. The result is kept for the next call where the folder can be
        written. Damaged files are left out with a warning that names them.
        """
        import pyarrow as pa

        stamps = self.stamps()
        known = self._kept_index()
        stamped = zip(*(known.column(name).to_pylist() for name in STAMPED), strict=True)
        unchanged = [stamps.get(job) == stamp for job, *stamp in stamped]
        kept = known.filter(pa.array(unchanged, pa.bool_()))
        changed = kept.num_rows != known.num_rows
        new = sorted(stamps.keys() - set(kept.column("job").to_pylist()))
        damaged: dict[str, str] = {}
        # Rows of words and numbers take far more memory than the columns that they become.
        for start in range(0, len(new), _ROWS_AT_ONCE):
            rows = []
            for job in new[start : start + _ROWS_AT_ONCE]:
                try:
                    rows.append(_index_row(self.job_file(job), stamps[job]))
                except TableError as error:
                    damaged[job] = str(error)
            names = dict.fromkeys(name for row in rows for name in row)
            found = pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})
            if rows:
                kept = pa.concat_tables([kept, found], promote_options="permissive")
                changed = True
        if changed:
            kept = kept.sort_by("job")
        if changed:
            # Somebody else's results may be read-only: then it is read again at the next call.
            with contextlib.suppress(OSError):
                write_arrow(self.index_file, kept, {"format": INDEX_FORMAT})
        self._warn(damaged)
        return kept.drop_columns(["mtime_ns"])

    def damaged(self) -> dict[str, str]:
        """Return what is wrong with each damaged result, by job id; all are read whole."""
        found = {}
        for job in sorted(self.finished()):
            path = self.job_file(job)
            try:
                summary = read_table(path).summary
                _index_row(path, (0, 0))
            except TableError as error:
                found[job] = str(error)
            else:
                kept = "snapshots" in summary
                if kept and (problem := snapshots.damage(self.snapshots, job)):
                    found[job] = problem
        return found

    def set_aside(self, job: str) -> Path:
        """Move a damaged result to ``damaged/``, so that its job runs again; return where it is."""
        folder = self.folder / "damaged"
        folder.mkdir(exist_ok=True)
        for path in snapshots.paths(self.snapshots, job):
            if path.exists():
                path.replace(folder / path.name)
        return self.job_file(job).replace(folder / f"{job}.parquet")

    def summaries(self, jobs: Iterable[str]) -> list[dict[str, Any]]:
        """Return the summaries of these jobs; damaged ones are left out with a warning."""
        found, damaged = [], {}
        for job in jobs:
            try:
                found.append(_summary_of_job(self.job_file(job)))
            except TableError as error:
                damaged[job] = str(error)
        self._warn(damaged)
        return found

    def _warn(self, damaged: Mapping[str, str]) -> None:
        """Warn of damaged results, given by job id with what is wrong."""
        if damaged:
            warnings.warn(
                f"{len(damaged)} damaged result file(s) left out, the first: "
                f"{next(iter(damaged.values()))}; `shear-sim verify {self.folder} --remove` sets "
                f"them aside, then `{self.command()}` makes them again",
                RuntimeWarning,
                stacklevel=3,
            )

    def _kept_index(self) -> "pyarrow.Table":
        """Return the index file, or an empty one where it is missing, damaged or of old format."""
        import pyarrow as pa

        with contextlib.suppress(TableError):
            if read_summary(self.index_file) == {"format": INDEX_FORMAT}:
                return read_arrow(self.index_file)
        types = (pa.string(), pa.int64(), pa.int64())
        return pa.table({n: pa.array([], t) for n, t in zip(STAMPED, types, strict=True)})


def _refuse_newer(path: Path, summary: Mapping[str, Any]) -> None:
    found = summary.get("format")
    if not isinstance(found, int):
        msg = f"{path}: does not say of what format it is"
        raise TableError(msg)
    if found > FORMAT:
        msg = (
            f"{path}: made by a newer version of shear-sim (format {found}; this one reads "
            f"{FORMAT}): use that version"
        )
        raise ResultsError(msg)


def _program(about: Mapping[str, Any]) -> str | None:
    """Return the program that a plan or a result says to be imported from."""
    program: str | None = about.get("program") or about.get("run", {}).get("program")
    return program


def remove(folder: Path, names: Iterable[str], suffixes: Iterable[str]) -> None:
    """Remove the files of these names, with each of the suffixes, that ``folder`` holds."""
    for name in names:
        for suffix in suffixes:
            (folder / f"{name}{suffix}").unlink(missing_ok=True)


def plan_table(
    jobs: "Iterable[tuple[str, str, int, Labels]]",
    points: Mapping[str, Mapping[str, Any]],
    varied: Iterable[str],
) -> "pyarrow.Table":
    """Return the table of `Results.plan`.

    Parameters
    ----------
    jobs : iterable of (id, point, replicate, labels)
        In the order of the rows.
    points : mapping
        The parameters of each point, nested.
    varied : iterable of str
        Dotted keys of the parameters that become columns.
    """
    import pyarrow as pa

    rows = list(jobs)
    values = {point: flatten(parameters) for point, parameters in points.items()}
    columns: dict[str, list[Any]] = {
        "job": [job for job, _, _, _ in rows],
        "point": [point for _, point, _, _ in rows],
        "replicate": [replicate for _, _, replicate, _ in rows],
        "labels": [to_json(labels) for _, _, _, labels in rows],
    }
    for name in varied:
        columns[name] = [values[point].get(name) for point in columns["point"]]
    return pa.table(columns)


def _listing(folder: Path, suffix: str) -> Iterator[Path]:
    """Yield the files of ``folder`` with this suffix; partial files have another one."""
    if folder.is_dir():
        yield from (path for path in folder.iterdir() if path.suffix == suffix)


def _stamps(folder: Path, suffix: str) -> dict[str, list[int]]:
    """Return size and time of change [ns] of the files with this suffix, by their stems."""
    found = {}
    if folder.is_dir():
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.endswith(suffix):
                    with contextlib.suppress(FileNotFoundError):  # deleted at this moment
                        what = entry.stat()
                        found[entry.name.removesuffix(suffix)] = [what.st_size, what.st_mtime_ns]
    return found


def read_failure(path: Path) -> Failure:
    """Read one file of ``failed/``; a damaged one is an error, so that its job runs again."""
    try:
        record = json.loads(path.read_bytes())
        return Failure(**{**record, "traceback": tuple(record["traceback"])})
    except (ValueError, TypeError, KeyError) as error:
        return Failure(path.stem, "error", f"{path} cannot be read ({error})")


@contextlib.contextmanager
def advising(path: Path) -> Iterator[None]:
    """Say what to do where this result, or what belongs to it, turns out to be damaged."""
    try:
        yield
    except TableError as error:
        if path.parent.name != "jobs":
            raise
        results = Results(path.parents[1])
        msg = (
            f"{error}: `shear-sim verify {results.folder} --remove` sets it aside, then "
            f"`{results.command()}` makes it again"
        )
        raise TableError(msg) from error


def read_job_summary(path: Path) -> dict[str, Any]:
    """Read the summary of a result file.

    Raises
    ------
    TableError
        If the file is damaged, or another table of shear-sim: an index, say.
    ResultsError
        If a newer version of the program has made it.
    """
    with advising(path):
        return _summary_of_job(path)


def _summary_of_job(path: Path) -> dict[str, Any]:
    summary = read_summary(path)
    if not isinstance(summary.get("job"), dict):
        msg = f"{path}: not a result file of a job: those lie in results/<study>/jobs/"
        raise TableError(msg)
    _refuse_newer(path, summary)
    return summary


def _index_row(path: Path, stamp: Sequence[int]) -> dict[str, Any]:
    """Return the row of one result file; ``stamp`` is its size and time of change."""
    summary = _summary_of_job(path)
    job = summary["job"]
    if job["id"] != path.stem:
        msg = f"{path}: the result of another job, {job['id']}"
        raise TableError(msg)
    row = {"job": job["id"], "point": job["point"], "replicate": job["replicate"]}
    row |= {"seed": job["seed"], "physics_version": job["physics_version"]}
    row |= zip(STAMPED[1:], stamp, strict=True)
    row |= flatten(summary["parameters"])
    known = {"format", "job", "parameters", "moduli"}
    rest = {key: summary[key] for key in sorted(summary.keys() - known)}
    return row | flatten(rest) | flatten({"moduli": summary.get("moduli", {})}, lists=True)


def flatten(tree: Mapping[str, Any], prefix: str = "", *, lists: bool = False) -> dict[str, Any]:
    """Return the leaves of nested mappings under dotted keys; lists only if asked for."""
    leaves: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            leaves |= flatten(value, f"{prefix}{key}.", lists=lists)
        elif lists or not isinstance(value, list | tuple):
            leaves[f"{prefix}{key}"] = value
    return leaves


def read_job(path: Path) -> Table:
    """Read a result file: its stored columns, those that follow from them, and its summary.

    The dependent columns are computed by the ``derive`` function of the job's model, whose
    ``COLUMNS`` and ``DERIVED`` say what every column is, with its unit.

    Raises
    ------
    TableError
        If the file is damaged or is not a result of shear-sim.
    """
    with advising(path):
        table = Table(read_table(path).columns, _summary_of_job(path))
    model = models.model(table.summary["job"]["model"])
    return Table({**table.columns, **model.derive(table.columns)}, table.summary)


def find_job(reference: str, root: Path) -> Path:
    """Return the file that a JOB argument means: a result file, or a prefix of one job's id.

    Parameters
    ----------
    reference : str
        Path of a result or failure file, or the first letters of a job id.
    root : Path
        Folder that holds the results folders of studies; a prefix is looked for in all of them.

    Raises
    ------
    ResultsError
        If nothing, or more than one job, fits.
    """
    if (path := Path(reference)).is_file():
        return path
    if reference and path.is_dir():
        msg = (
            f"{reference}: a folder, not a job: `shear-sim show {reference}` lists those of a study"
        )
        raise ResultsError(msg)
    found = []
    if reference and all(letter in "0123456789abcdef" for letter in reference):
        found = sorted(root.glob(f"*/jobs/{reference}*.parquet"))
        failed = sorted(root.glob(f"*/failed/{reference}*.json"))
        finished = {path.stem for path in found}
        found += [path for path in failed if path.stem not in finished]
    if len(names := sorted({path.stem for path in found})) > 1:
        first = ", ".join(names[:4]) + ", ..." * (len(names) > 4)
        msg = f"{reference}: {len(names)} jobs in {root} begin so ({first}); give more letters"
        raise ResultsError(msg)
    if not found:
        msg = (
            f"{reference}: no such file, and no job in {root}/*/ whose id begins so; "
            "`shear-sim show results/<study>` lists the jobs of a study"
        )
        raise ResultsError(msg)
    return found[0]
