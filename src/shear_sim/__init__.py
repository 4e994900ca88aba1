"""Parameter studies of sheared soft and granular matter in two dimensions.

The three calls of the command line, for Python::

    import shear_sim

    study = shear_sim.load_study("configs/quick.yaml")
    runs = shear_sim.run_study(study, results="results")  # one row a job
    tables = shear_sim.aggregate_study("results/quick")  # one row a point, with intervals
"""

from pathlib import Path
from typing import TYPE_CHECKING

# Everything heavy loads inside the functions: `shear-sim --help` imports this package.
if TYPE_CHECKING:
    import pandas as pd

    from shear_sim.study import Study


def load_study(path: Path | str) -> "Study":
    """Read, validate and expand a study file.

    Raises
    ------
    StudyError
        With everything that is wrong, by line.
    """
    from shear_sim import study

    return study.load_study(path)


def run_study(
    study: "Study | Path | str",
    results: Path | str = "results",
    *,
    jobs: int | None = None,
    retry_failed: bool = False,
) -> "pd.DataFrame":
    """Run the jobs of a study that have no result yet; return one row per finished job.

    Parameters
    ----------
    study : Study or path
        A study, or its file.
    results : path
        Results go to ``results/<study>/``; what is there already is not run again.
    jobs : int, optional
        Number of worker processes, at least 1; default: what Slurm gave, else all cores.
    retry_failed : bool
        Also try again what failed by physics.

    Returns
    -------
    pandas.DataFrame
        Indexed by job id: parameters under their names in the study file, and the numbers of each
        summary with dotted names (``moduli.periodic.storage`` [Pa], ``run.cpu_s``). Jobs that
        failed are missing; they are reported on the screen and kept in ``failed/``.

    Raises
    ------
    StudyError, PlanError, ResultsError, SweepError
        If nothing can run; each says why and what to do.
    KeyboardInterrupt, SystemExit
        If a signal stopped the sweep; what is finished is kept.
    """
    from signal import SIGINT

    from shear_sim.plan import make_plan
    from shear_sim.results import Results
    from shear_sim.screen import Screen
    from shear_sim.sweep import describe_report, run_plan

    loaded = load_study(study) if isinstance(study, Path | str) else study
    folder = Results(Path(results) / loaded.name)
    plan = make_plan(loaded, folder, jobs=jobs, retry_failed=retry_failed)
    screen = Screen()
    screen.say(str(plan))
    report = run_plan(plan, screen)
    screen.say(describe_report(plan, report))
    if report.signal is not None:
        raise KeyboardInterrupt if report.signal == SIGINT else SystemExit(report.exit_code)
    table: pd.DataFrame = folder.index().to_pandas().set_index("job")
    return table[table.index.isin(plan.points)]


def aggregate_study(folder: Path | str, *, figures: bool = False) -> "dict[str, pd.DataFrame]":
    """Make the tables (and figures) of a study from its results, also from partial ones.

    Parameters
    ----------
    folder : path
        ``results/<study>``.
    figures : bool
        Also draw into ``results/<study>/figures``.

    Returns
    -------
    dict of pandas.DataFrame
        By name; the same as in ``results/<study>/tables``.
    """
    from shear_sim.aggregate import aggregate

    return aggregate(folder, figures=figures)
