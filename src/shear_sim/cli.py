"""The command line: parse, call one function, report. Heavy libraries load inside the commands."""

import errno
import json
import signal
import sys
import time
import warnings
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from shear_sim.looks import Colour, Contacts

if TYPE_CHECKING:
    from shear_sim.plan import Plan
    from shear_sim.results import Results
    from shear_sim.study import Study

BAD_INPUT, STOPPED, INTERRUPTED = 2, 75, 130  # exit codes

app = typer.Typer(
    name="shear-sim",
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help: twice as fast, and it can be searched
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="Study file.")]
ResultsFolder = Annotated[
    Path, typer.Argument(metavar="RESULTS", help="Results of one study: results/<study>.")
]
Root = Annotated[
    Path, typer.Option("--results", metavar="R", help="Results go to R/<study>/, read from there.")
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        "-j",
        min=1,
        help="Worker processes. Default: as many as fit on the cores Slurm gave, else on all.",
    ),
]
Shard = Annotated[
    str, typer.Option(metavar="i/n", help="Only every n-th job, from the i-th (i from 0).")
]
LIMIT = "Run at most so many jobs; exit code 0 then does not mean that all jobs are done."
Limit = Annotated[int | None, typer.Option(min=0, help=LIMIT)]
RetryFailed = Annotated[
    bool, typer.Option("--retry-failed", help="Also try again what failed by physics.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
RESULTS = Path("results")


def _known_jobs(context: typer.Context, incomplete: str) -> list[str]:
    """Return the finished jobs whose id begins so, for a shell that completes words."""
    return _stems(context, f"*/jobs/{incomplete}*.parquet")


def _jobs_with_snapshots(context: typer.Context, incomplete: str) -> list[str]:
    return _stems(context, f"*/snapshots/{incomplete}*.gsd")


def _stems(context: typer.Context, pattern: str) -> list[str]:
    found = Path(context.params.get("results") or RESULTS).glob(pattern)
    return sorted(path.stem for path in found)


def _models(incomplete: str) -> list[str]:
    from shear_sim.models import KINDS

    return [kind for kind in KINDS if kind.startswith(incomplete)]


class Tensor(StrEnum):
    """Stress tensors whose moduli can be tabulated."""

    periodic = "periodic"
    internal = "internal"
    external = "external"


OfTensor = Annotated[
    Tensor | None,
    typer.Option("--tensor", help="Whose moduli the tables are of; default: all contacts."),
]


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"shear-sim {version('shear-sim')}")
        raise typer.Exit


@app.callback()
def common(
    debug: Annotated[bool, typer.Option(help="Show tracebacks of errors.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Parameter studies of sheared soft and granular matter: from a YAML file to moduli.

    Exit codes: 0 all jobs done, 1 some failed, 2 bad input, 75 stopped early by a signal,
    130 interrupted.
    """


@app.command()
def sweep(
    study: StudyFile,
    results: Root = RESULTS,
    shard: Shard = "0/1",
    jobs: Jobs = None,
    limit: Limit = None,
    retry_failed: RetryFailed = False,
    division: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Jobs of the n shards, a line each, as submit writes."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show the plan.")] = False,
) -> None:
    """Run all jobs of a study that have no result yet.

    On all cores. It may be stopped at any time, also killed: the same command again goes on, with
    the same results to the bit. Failed jobs are reported and the others go on.

    Example: shear-sim sweep configs/main.yaml
    """
    # Slurm's warning is kept for the supervisor: a task that ended now would not be requeued. This
    # line is reached after 0.2 s of CPU, and no warning comes in the first two minutes of a task.
    received: list[int] = []
    signal.signal(signal.SIGUSR1, lambda number, _frame: received.append(number))
    planned = _plan(
        study, results, shard, jobs, limit, retry_failed, division=division, measure=dry_run
    )
    typer.echo(planned)
    if not dry_run:
        from shear_sim.screen import Screen
        from shear_sim.sweep import describe_report, run_plan

        report = run_plan(planned, Screen(), received)
        typer.echo(describe_report(planned, report))
        if report.signal == signal.SIGUSR1 and report.left:
            _requeue(planned, progress=report.progress)
        raise typer.Exit(report.exit_code)


def _requeue(planned: "Plan", *, progress: bool) -> None:
    """Where Slurm has warned of the end of this task: let it be run again."""
    from shear_sim import slurm

    if (task := slurm.this_task()) is None:
        return
    typer.echo(f"task {task} asks to be requeued")
    sys.stdout.flush()  # Slurm ends it at once
    why_not = slurm.requeue(task, planned.results.logs, progress=progress)
    if why_not is not None:
        typer.echo(f"task {task} is not requeued: {why_not}; `shear-sim submit` runs what is left")
        return
    time.sleep(60)  # until Slurm ends it: a task that ends by itself may not be run again


@app.command()
def plan(
    study: StudyFile,
    results: Root = RESULTS,
    shard: Shard = "0/1",
    jobs: Jobs = None,
    limit: Limit = None,
    retry_failed: RetryFailed = False,
    as_json: Json = False,
) -> None:
    """Show what a sweep would do and cost, and do nothing.

    As sweep --dry-run. The cost is known once some of its jobs are done.

    Example: shear-sim plan configs/main.yaml --json
    """
    planned = _plan(study, results, shard, jobs, limit, retry_failed, quiet=as_json)
    typer.echo(_json(planned.to_json()) if as_json else planned)


@app.command()
def submit(
    study: StudyFile,
    results: Root = RESULTS,
    minutes: Annotated[
        int | None,
        typer.Option(
            "--time", metavar="MINUTES", min=1, help="Longest limit of a task; 5 or more."
        ),
    ] = None,
    max_tasks: Annotated[int | None, typer.Option(min=1, help="Most tasks, of all arrays.")] = None,
    memory: Annotated[
        int | None, typer.Option("--mem", metavar="MB", min=1, help="Memory of a task.")
    ] = None,
    partition: Annotated[str | None, typer.Option(help="Partition of the cluster.")] = None,
    account: Annotated[str | None, typer.Option(help="Account to be charged.")] = None,
    retry_failed: RetryFailed = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show the scripts.")] = False,
) -> None:
    """Submit a study to Slurm, as an array of tasks.

    What is missing is run, and the report made after it. Tasks and their time limit follow from
    what finished jobs have cost. The same command again submits what is missing and neither waits
    nor runs.

    Example: shear-sim submit configs/main.yaml --partition standard --time 240
    """
    planned = _plan(study, results, "0/1", None, None, retry_failed)
    typer.echo(planned)
    from shear_sim import submit as submission

    limits = submission.Limits(minutes, max_tasks, memory, partition, account)
    if submission.submit(planned, limits, typer.echo, dry_run=dry_run):
        typer.echo(f"next: shear-sim status {planned.results.folder} --watch")


@app.command()
def compile(study: StudyFile) -> None:  # noqa: A001 - the name of the command
    """Compile the kernels of a study, and do nothing more.

    No sweep on this type of processor has to then.

    Example: shear-sim compile configs/main.yaml
    """
    loaded = _load(study)
    from shear_sim.compiled import cache_folder, compiling
    from shear_sim.workers import compile_for

    with compiling(loaded.kernels):
        compile_for(loaded.jobs(), _tell)
    typer.echo(f"compiled code is in {cache_folder()}")


@app.command()
def run(
    target: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml|FILE", help="Study file, or a result to repeat.")
    ],
    job: Annotated[
        str | None, typer.Option("--job", metavar="ID", help="Job of the study: id or its begin.")
    ] = None,
    results: Root = RESULTS,
) -> None:
    """Run one job, here and now.

    Given a result file, the job is computed again into R/repeated/ and compared with the file:
    exit code 1 if they differ.

    Examples: shear-sim run configs/main.yaml --job 3f9c21;
    shear-sim run results/main/jobs/3f9c21d07be4a815.parquet
    """
    from shear_sim import single

    if target.suffix == ".parquet":
        if job is not None:
            msg = "--job goes with a study file; a result file is one job already"
            raise typer.BadParameter(msg)
        path, differences = single.repeat(target, results, _tell)
        typer.echo(f"computed again: {path}")
        for difference in differences:
            typer.echo(f"  differs: {difference}")
        typer.echo("not the same bits" if differences else f"the same bits as {target}")
        raise typer.Exit(1 if differences else 0)
    loaded = _load(target)
    if job is None:
        msg = f"--job ID is missing: one of the {len(loaded.jobs())} jobs of {target}"
        raise typer.BadParameter(msg)
    path, failure = single.run_one(loaded, job, _results(loaded, results), _tell)
    if failure is not None:
        typer.echo(f"failed: job {failure.job} ({failure.kind}): {failure.reason}")
        raise typer.Exit(1)
    typer.echo(f"done: {path}\nnext: shear-sim show {path}")


@app.command()
def status(
    target: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml|RESULTS", help="Study file or results/<study>.")
    ],
    results: Root = RESULTS,
    as_json: Json = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Show it again every 10 s, until nothing is missing.")
    ] = False,
) -> None:
    """Show how far a study is: done, failed, missing; time.

    Why jobs failed, and the disk that results take. On a cluster also the tasks that wait and run,
    and when the rest may be expected.

    Example: shear-sim status results/main --watch
    """
    from shear_sim import status as module
    from shear_sim.results import Results

    of = Results.existing(target) if target.is_dir() else _results(_load(target), results)
    if watch:
        if as_json:
            msg = "--watch is for people and --json for scripts: give one of them"
            raise typer.BadParameter(msg)
        module.watch(of, _show)
        return
    found = module.read_status(of)
    typer.echo(_json(found) if as_json else module.describe_status(found))


@app.command()
def show(
    job: Annotated[
        str,
        typer.Argument(
            metavar="JOB|RESULTS",
            help="Result file, or begin of a job id; a results folder: all of its jobs.",
            autocompletion=_known_jobs,
        ),
    ],
    results: Root = RESULTS,
    as_json: Json = False,
) -> None:
    """Show one job, or list the jobs of a study with their ids.

    Of a job: its parameters, constants, moduli and checks, or why it failed.

    Examples: shear-sim show results/main; shear-sim show 3f9c21
    """
    from shear_sim.results import Results, find_job, read_failure, read_job_summary
    from shear_sim.status import describe_job, describe_jobs, read_jobs

    if Path(job).is_dir():
        jobs = read_jobs(Results.existing(Path(job)))
        typer.echo(_json(jobs) if as_json else describe_jobs(jobs))
        return
    path = find_job(job, results)
    if path.suffix == ".json":
        summary: dict[str, Any] = {"failure": asdict(read_failure(path))}
    else:
        summary = read_job_summary(path)
    typer.echo(_json(summary) if as_json else f"{path}\n{describe_job(summary)}")


@app.command()
def render(
    job: Annotated[
        str,
        typer.Argument(
            metavar="JOB",
            help="Result file, or begin of a job id.",
            autocompletion=_jobs_with_snapshots,
        ),
    ],
    results: Root = RESULTS,
    snapshot: Annotated[
        int | None, typer.Option(metavar="I", help="Which one, from 0; -1, the last, by default.")
    ] = None,
    time: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="The one made nearest to this time; it is named."),
    ] = None,
    film: Annotated[bool, typer.Option("--film", help="All of them, as an animated GIF.")] = False,
    colour: Annotated[
        Colour, typer.Option(help="Of particles: their cluster of links, or a number.")
    ] = Colour.particle,
    contacts: Annotated[
        Contacts | None,
        typer.Option(help="Lines: links and what holds or slides, or forces. Default: what fits."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A .png, .pdf or .gif. Default: JOB.png, JOB.gif here."),
    ] = None,
) -> None:
    """Draw the snapshots of a job: a picture, or a film.

    Particles and contacts, with strain and stress beside them, of jobs whose study says `record:
    {snapshots: N}`. Links are blue with an orange interface, interfaces that hold are red, those
    that slide green. Lines of forces are as wide as they are strong, of pushes red (black over a
    colour scale), of pulls blue; where they are too many to be told apart, as they are above the
    mean. Images of the cell are dimmed, and held particles grey. Speeds are whole, with the flow;
    displacements beside the affine flow, since the first snapshot. A colour scale is pointed at an
    end beyond which there are values. Colours and widths of a film mean the same in all of its
    frames (widths up to twice the usual load; no frame is drawn as more), those of a picture are
    scaled by its snapshot alone. Films of small discs are drawn larger.

    Examples: shear-sim render 3f9c21; shear-sim render 3f9c21 --film --colour pressure;
    shear-sim render 3f9c21 --time 0.002 --contacts force --out forces.pdf
    """
    from shear_sim import render as module
    from shear_sim.results import find_job

    suffixes = (".gif",) if film else (".png", ".pdf")
    if out is not None and out.is_dir():
        msg = f"--out {out}: this is a folder: give the name of a file in it"
        raise typer.BadParameter(msg)
    if out is not None and out.suffix not in suffixes:
        msg = f"--out {out}: the name must end with {' or '.join(suffixes)}"
        msg += " with --film, and with .png or .pdf without" if film else ", or .gif with --film"
        raise typer.BadParameter(msg)
    if out is not None and not out.parent.is_dir():
        msg = f"--out {out}: there is no folder {out.parent}: make it first"
        raise typer.BadParameter(msg)
    if (snapshot is not None) + (time is not None) + film > 1:
        msg = "--snapshot, --time and --film say different things: give one of them"
        raise typer.BadParameter(msg)
    kept = module.read_kept(find_job(job, results))
    path = out or Path(f"{kept.path.stem}{suffixes[0]}")
    look = (colour, contacts)
    if film:
        shown = module.write_film(kept, path, *look)
    else:
        number = -1 if snapshot is None else snapshot
        number = number if time is None else module.nearest(kept, time)
        shown = module.write_picture(kept, path, number, *look)
    typer.echo(f"written: {path} ({shown})")


@app.command()
def verify(
    results: ResultsFolder,
    remove: Annotated[
        bool, typer.Option("--remove", help="Move damaged results aside: the sweep replaces them.")
    ] = False,
) -> None:
    """Read every result and compare it with its checksum.

    Exit code 1 if any is damaged. Damaged results stay where they are, and are left out by
    aggregate, until --remove moves them to damaged/ and the next sweep computes them again.

    Example: shear-sim verify results/main
    """
    from shear_sim.results import Results

    of = Results.existing(results)
    damaged = of.damaged()
    for job, problem in damaged.items():
        moved = f"; moved to {of.set_aside(job)}" if remove else ""
        typer.echo(f"damaged: {problem}{moved}")
    typer.echo(f"{len(of.finished()) + len(damaged) * remove} results, {len(damaged)} damaged")
    if damaged:
        typer.echo(f"next: {of.command() if remove else 'the same with --remove'}")
    raise typer.Exit(1 if damaged else 0)


@app.command()
def aggregate(
    results: ResultsFolder,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Also draw.")] = True,
    tensor: OfTensor = None,
    historical: Annotated[
        bool,
        typer.Option(
            "--historical", help="Also the moduli as particleShear and its R scripts did."
        ),
    ] = False,
) -> None:
    """Make the tables and figures of a study.

    Also of one that is not complete: everything says how many runs of how many it is from.

    Example: shear-sim aggregate results/main
    """
    from shear_sim import aggregate as aggregation
    from shear_sim.summary import print_summary

    tables = aggregation.make_tables(results, tensor=tensor, historical=historical)
    print_summary(tables)  # first: the results may be somebody else's, and read-only
    written = aggregation.write(results, tables, figures=figures)
    typer.echo(f"written: {', '.join(map(str, written))}")


@app.command()
def import_legacy(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES", help="Output files (.txt, .txt.gz; split: .txt, .rda), or folders."
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Results folder to make.")],
) -> None:
    """Read output files of particleShear.

    They become a results folder, which is aggregated as any other.

    Example: shear-sim import-legacy old_runs/*.txt --out results/old
    """
    from shear_sim.legacy import importing

    typer.echo(importing.import_legacy(files, out))


@app.command()
def report(results: ResultsFolder, tensor: OfTensor = None) -> None:
    """Aggregate a study and write one page with all of it.

    It is RESULTS/report.html, refers to nothing outside itself, and can be mailed.

    Example: shear-sim report results/main
    """
    from shear_sim.report import write_report

    typer.echo(f"written: {write_report(results, tensor=tensor)}")


@app.command()
def accuracy(
    study: StudyFile,
    job: Annotated[
        str | None, typer.Option("--job", metavar="ID", help="Only this job: id or its begin.")
    ] = None,
    points: Annotated[int, typer.Option(min=1, help="Representative points to measure.")] = 8,
    replicates: Annotated[int, typer.Option(min=1, help="Packings of each point.")] = 1,
    packings: Annotated[
        int, typer.Option(min=0, help="Packings that judge a point whose runs are chaotic.")
    ] = 96,
    results: Root = RESULTS,
) -> None:
    """Show what error the steps of a study leave.

    And at what cost. Representative jobs run from one prepared packing each, with every integrator
    over a ladder of steps per period, against far finer steps. Jobs whose runs do not converge with
    the step are found, and judged by the mean over many packings. Tables and a figure are kept.

    Twice the steps leave a quarter of the error (semi_implicit_euler: half), but about half where
    contacts with dashpots open and close. Steps that are too long for contacts, dashpots or the
    flow are cut on every rung.

    Examples: shear-sim accuracy configs/quick.yaml;
    shear-sim accuracy configs/main.yaml --job 3f9c21
    """
    loaded = _load(study)
    from shear_sim import accuracy_report

    failed = accuracy_report.report(
        loaded,
        _results(loaded, results),
        job=job,
        points=points,
        replicates=replicates,
        packings=packings,
        say=typer.echo,
        tell=_tell,
    )
    raise typer.Exit(1 if failed else 0)


@app.command()
def schema(
    model: Annotated[
        str | None,
        typer.Argument(
            metavar="MODEL",
            help="microgel (by default), hard_disc or soft_particle; --json: by default any of "
            "them, whichever model.kind says.",
            autocompletion=_models,
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Schema, for editors that complete and check.")
    ] = False,
) -> None:
    """Print every key of a study file.

    With its default, unit, limits and source. The reference is itself a study file, one job with
    all defaults, to be copied from.

    Editors that know JSON Schema complete and check a study file whose first line is
    `# yaml-language-server: $schema=study.schema.json`.

    Examples: shear-sim schema hard_disc; shear-sim schema --json > study.schema.json
    """
    from shear_sim import models

    if model is not None and model not in models.KINDS:
        msg = f"no model {model!r}: one of {', '.join(models.KINDS)}"
        raise typer.BadParameter(msg)
    if as_json:
        from shear_sim.json_schema import json_schema

        typer.echo(_json(json_schema(model)))
    else:
        from shear_sim.reference import study_reference

        typer.echo(study_reference(model or models.DEFAULT_KIND), nl=False)


def _show(text: str) -> None:
    clear = "\x1b[H\x1b[2J" if sys.stdout.isatty() else ""
    typer.echo(f"{clear}{text}")


def _tell() -> None:
    from shear_sim.screen import COMPILING

    typer.echo(COMPILING)


def _stop(number: int, _frame: object) -> NoReturn:
    sys.exit(INTERRUPTED if number == signal.SIGINT else STOPPED)


def _plan(
    study: Path,
    results: Path,
    shard: str,
    jobs: int | None,
    limit: int | None,
    retry_failed: bool,
    *,
    division: Path | None = None,
    quiet: bool = False,
    measure: bool = True,
) -> "Plan":
    if not quiet:
        typer.echo(f"reading {study}")
    part = _shard(shard)
    loaded = _load(study)
    from shear_sim.plan import make_plan

    return make_plan(
        loaded,
        _results(loaded, results),
        shard=part,
        division=division,
        jobs=jobs,
        limit=limit,
        retry_failed=retry_failed,
        measure=measure or part == (0, 1),
    )


def _shard(text: str) -> tuple[int, int]:
    """Return (i, n) of ``i/n``."""
    index, slash, count = text.partition("/")
    if slash and index.isdecimal() and count.isdecimal() and int(index) < int(count):
        return int(index), int(count)
    msg = (
        f"--shard {text}: should be i/n with i from 0 to n - 1, such as 0/4; an array of Slurm "
        "starts from 0 too: --array=0-3, not 1-4"
    )
    raise typer.BadParameter(msg)


def _load(study: Path) -> "Study":
    from shear_sim.study import load_study

    return load_study(study)


def _results(study: "Study", root: Path) -> "Results":
    from shear_sim.results import Results

    results = Results(root / study.name)
    results.refuse_newer()
    return results


def _json(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False)


def _plain_warning(message: Warning | str, *_: Any, **__: Any) -> str:
    return f"warning: {message}\n"


def main() -> NoReturn:
    """Run the command line; no traceback reaches a user who has not asked for it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup: stay when the terminal closes
            signal.signal(number, _stop)  # until the supervisor of a sweep takes them over
    warnings.formatwarning = _plain_warning
    try:
        app(prog_name="shear-sim")
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        sys.exit(_explain(error))
    sys.exit(0)


def _explain(error: Exception) -> int:
    """Say what went wrong; return the exit code."""
    from shear_sim.document import StudyError
    from shear_sim.legacy.headers import LegacyError
    from shear_sim.plan import PlanError
    from shear_sim.results import ResultsError
    from shear_sim.slurm import SlurmError
    from shear_sim.sweep import FAILED, SweepError
    from shear_sim.tables import TableError

    if isinstance(error, StudyError | LegacyError | PlanError | ResultsError | TableError):
        typer.echo(f"shear-sim: {error}", err=True)
        return BAD_INPUT
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        typer.echo(f"shear-sim: {error.filename}: {error.strerror}: give a shorter one", err=True)
        return BAD_INPUT
    typer.echo(f"shear-sim: {str(error) or type(error).__name__}", err=True)
    if not isinstance(error, SweepError | SlurmError | OSError):
        typer.echo(
            "This is an error of the program; `shear-sim --debug ...` shows where.", err=True
        )
    return FAILED


if __name__ == "__main__":  # python -m shear_sim.cli
    main()
