"""The report of `shear-sim accuracy`: what is measured, on the screen, as tables, as a figure."""

from collections.abc import Callable, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim import accuracy
from shear_sim.accuracy import Measured, Say
from shear_sim.aggregate import save
from shear_sim.figures import style
from shear_sim.results import ResultsError
from shear_sim.workers import compile_for, telling

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from shear_sim.results import Results
    from shear_sim.study import Job, Study

FloatArray = NDArray[np.float64]

LABELS_APART = np.array([0.1, 0.5])  # decades of cost and error that a label needs
TARGET = 0.005  # relative error of |G*| and G'' that the default steps are meant to keep

_ERRORS = {
    "magnitude_error": "|G*|",
    "loss_error": "G″",
    "stress_error": "stress",
    "position_error": "positions",
    "energy_residual": "energy",
}
_PANELS = {
    "magnitude_error": "relative error of $|G^*|$",
    "loss_error": "relative error of $G''$",
    "stress_error": "RMS stress error / amplitude",
    "position_error": r"final position error / $\langle r \rangle$",
}


def report(
    study: "Study",
    results: "Results",
    *,
    job: str | None = None,
    points: int,
    replicates: int,
    packings: int,
    say: Say,
    tell: Callable[[], None],
) -> int:
    """Measure speed against error of a study's jobs; print, write tables and draw the figure.

    Parameters
    ----------
    study : Study
        What the jobs are of.
    results : Results
        Gets ``tables/accuracy.*``, ``tables/accuracy_pairs.*`` (of points that do not converge
        with the step, if there are any) and ``figures/accuracy.png``.
    job : str, optional
        Begin of the id of the one job to measure; default: representative ones.
    points, replicates : int
        How many representative points, and how many packings of each.
    packings : int
        Pairs of packings at points that do not converge with the step; with 0 there are none.
    say, tell : callable
        Get the lines of the report; called if kernels have to be compiled.

    Returns
    -------
    int
        Number of jobs without a result.

    Raises
    ------
    ResultsError
        If no job or more than one begins with ``job``, if none has moduli, or if the results
        cannot be written.
    """
    jobs = accuracy.choose(study, points, replicates) if job is None else [_named(study, job)]
    results.prepare(study)
    tell = _once(tell)
    compile_for(jobs, tell)
    measured, pairs = [], {}
    say(f"{len(jobs)} of {len(study.jobs())} jobs, against {accuracy.REFERENCE} times finer steps")
    with telling(tell):
        began = monotonic()
        for number, each in enumerate(jobs):
            what = accuracy.describe_point(each, study.varied)
            to_go = _to_go(began, number, len(jobs))
            say(f"\n{number + 1} of {len(jobs)}{to_go}: job {each.id}, replicate {each.replicate}")
            say(f"  {what}")
            found = accuracy.measure(each)
            measured.append(found)
            for line in _lines(found):
                say(line)
        undecided = accuracy.representative(measured) if packings else []
        if undecided:
            say(
                f"\nmean paired differences over {packings} packings, own steps against "
                f"{accuracy.PAIRED} times finer ones (one interval in twenty leaves zero out by "
                "chance; more --packings tell):"
            )
        began = monotonic()
        for number, found in enumerate(undecided):
            what = accuracy.describe_point(found.job, study.varied)
            say(
                f"  {number + 1} of {len(undecided)}{_to_go(began, number, len(undecided))}: {what}"
            )
            pairs[found.job.id] = accuracy.compare_packings(found.job, packings)
            say(f"    {describe_pairs(pairs[found.job.id])}")
    runs = accuracy.runs_table(measured, study.varied)
    for line in _summary(measured, runs):
        say(line)
    written = _write(results, runs, undecided, list(pairs.values()), study.varied)
    say(f"written: {', '.join(written)}")
    return sum(found.failure is not None for found in measured)


def _once(tell: Callable[[], None]) -> Callable[[], None]:
    """Return a function that calls ``tell`` the first time only."""
    told: list[bool] = []

    def first() -> None:
        if not told:
            told.append(True)
            tell()

    return first


def _to_go(began: float, done: int, of: int) -> str:
    """Return how long the rest takes if it is as long as what is done; nothing before the first."""
    if not done:
        return ""
    seconds = (monotonic() - began) / done * (of - done)
    return f" (about {seconds:.0f} s to go)" if seconds < 90 else f" (about {seconds / 60:.0f} min)"


def _named(study: "Study", reference: str) -> "Job":
    found = [job for job in study.jobs() if job.id.startswith(reference)]
    if len(found) != 1:
        msg = f"--job {reference}: {len(found)} jobs of {study.path} have an id that begins so"
        raise ResultsError(msg)
    if not accuracy.is_measurable(found[0]):
        msg = f"--job {reference}: it has no whole period of oscillation, and so no moduli"
        raise ResultsError(msg)
    return found[0]


def _write(
    results: "Results",
    runs: "pd.DataFrame",
    undecided: Sequence[Measured],
    pairs: Sequence[dict[str, Any]],
    varied: Sequence[str],
) -> list[str]:
    stem = results.tables / "accuracy"
    written = [f"{stem}.parquet", f"{stem}.csv"]
    save(runs, stem)
    if pairs:
        save(accuracy.pairs_table(undecided, pairs, varied), results.tables / "accuracy_pairs")
        written.append(f"{stem}_pairs.*")
    if runs["failed"].isna().any():
        written += map(str, style.save(draw(runs), results.figures / "accuracy"))
    return written


def _lines(measured: Measured) -> list[str]:
    """Return what the screen shows of the runs of one job."""
    if measured.failure is not None:
        return [f"  failed: {measured.failure}"]
    lines = [f"  {measured.verdict}", "", _HEADING]
    for run in measured.runs:
        name = f"  {run['scheme']:<19}{run['steps_per_period']:>8}"
        if run["failed"] is not None:
            lines.append(f"{name}  failed: {run['failed']}")
            continue
        costs = f"{run['cpu_per_step']:>9.1f}{run['cpu_per_period']:>10.4f}"
        errors = "".join(
            f"{'' if run[key] is None else format(run[key], '.1e'):>11}" for key in _ERRORS
        )
        lines.append(f"{name}{costs}{errors}{'  own' if run['own'] else ''}")
    return lines


_HEADING = f"  {'integrator':<19}{'steps/T':>8}{'µs/step':>9}{'CPU s/T':>10}" + "".join(
    f"{name:>11}" for name in _ERRORS.values()
)


def describe_pairs(pairs: dict[str, Any]) -> str:
    """Return the mean paired differences in words."""
    words = []
    for name, symbol in (("magnitude", "|G*|"), ("loss", "G″")):
        mean, low, high = (
            100 * pairs[f"{name}_difference_{what}"] for what in ("mean", "ci_low", "ci_high")
        )
        zero = "zero inside" if low <= 0 <= high else "zero outside"
        words.append(f"{symbol} {mean:+.2g} % [{low:+.2g}, {high:+.2g}], {zero}")
    failed = f", {pairs['failed']} failed" if pairs["failed"] else ""
    return f"{'; '.join(words)} ({pairs['packings']} pairs{failed})"


def _summary(measured: Sequence[Measured], runs: "pd.DataFrame") -> list[str]:
    verdicts = [found.verdict.verdict for found in measured if found.verdict is not None]
    counts = [
        f"{verdicts.count(name)} {name}"
        for name in ("convergent", "chaotic", "uneven")
        if name in verdicts
    ]
    failed = sum(found.failure is not None for found in measured)
    counts += [f"{failed} failed"] if failed else []
    lines = ["", f"{len(measured)} jobs: {', '.join(counts)}"]
    own = runs[runs["own"].astype(bool) & (runs["verdict"] == "convergent")]
    own = own[own["failed"].isna()]
    if len(own):
        worst = ", ".join(
            f"{symbol} {own[key].median():.1e} (worst {own[key].max():.1e})"
            for key, symbol in _ERRORS.items()
        )
        lines.append(f"own steps of the convergent jobs, median error: {worst}")
    return lines


def draw(runs: "pd.DataFrame") -> "Figure":
    """Draw errors against CPU time: a line per integrator, the Pareto front, the own steps.

    Lines are medians over the jobs that converge with the step (over all, where none does), with
    the 95 % quantile dashed above. Errors of 0 are not drawn.

    Parameters
    ----------
    runs : DataFrame
        As `shear_sim.accuracy.runs_table` returns it.
    """
    made = runs[runs["failed"].isna()]
    convergent = made[made["verdict"] == "convergent"]
    used = made if convergent.empty else convergent
    with style.figure(style.DOUBLE, 5.4) as figure:
        axes = figure.subplots(2, 2, sharex=True)
        for axis, (key, label) in zip(axes.flat, _PANELS.items(), strict=True):
            _panel(axis, used, key)
            axis.set_ylabel(label)
            if key in {"magnitude_error", "loss_error"}:
                axis.axhline(TARGET, color="0.4", linewidth=0.8, linestyle=":", label="0.5 %")
        for axis in axes[1]:
            axis.set_xlabel("CPU time per period $T$ [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        style.note(figure, _title(made, used, none_converges=convergent.empty))
    return figure


def _title(made: "pd.DataFrame", used: "pd.DataFrame", *, none_converges: bool) -> str:
    jobs, all_jobs = used["job"].nunique(), made["job"].nunique()
    if none_converges:
        return f"{jobs} job(s), none of which converges with the step: errors of single runs"
    left = f"; {all_jobs - jobs} more do not" if all_jobs > jobs else ""
    median = "median and (dashed) 95 % quantile of " if jobs > 1 else ""
    return f"{median}{jobs} job(s) that converge with the step{left}; numbers: steps per period"


def _panel(axis: "Axes", used: "pd.DataFrame", key: str) -> None:
    """Draw one error against the cost."""
    points: list[tuple[float, float]] = []
    positive = used[used[key] > 0]
    if positive.empty:
        return
    schemes = positive.groupby("scheme", sort=False)
    for colour, (scheme, of_scheme) in zip(style.UNORDERED, schemes, strict=False):
        rungs = of_scheme.groupby("factor")
        x, y = rungs["cpu_per_period"].median(), rungs[key].median()
        name = str(scheme).replace("_", " ")
        axis.loglog(x, y, "o-", color=colour, label=name, zorder=3)
        if used["job"].nunique() > 1:
            high = rungs[key].quantile(0.95)
            axis.loglog(x, high, "--", color=colour, linewidth=0.8)
            axis.fill_between(x, y, high, color=colour, alpha=0.1, linewidth=0)
        steps = rungs["steps_per_period"]
        labelled: list[FloatArray] = []
        for factor in sorted(x.index, key=lambda factor: abs(np.log2(factor))):
            place = np.log10([x[factor], y[factor]]) / LABELS_APART
            if any(np.hypot(*(place - other)) < 1 for other in labelled):
                continue
            labelled.append(place)
            few, many = steps.min()[factor], steps.max()[factor]
            text = f"{few}" if few == many else f"×{factor:g}"
            axis.annotate(
                text, (x[factor], y[factor]), xytext=(4, 3), textcoords="offset points",
                fontsize=6, color=colour,
            )  # fmt: skip
        points += list(zip(x, y, strict=True))
    front = np.array(pareto(points)).T
    axis.plot(*front, color="0.75", linewidth=6, zorder=1, alpha=0.7, label="Pareto front",
              solid_capstyle="round")  # fmt: skip
    own = positive[positive["own"].astype(bool)]
    if len(own):
        axis.plot(
            own["cpu_per_period"].median(), own[key].median(), "*", color="black", markersize=11,
            markerfacecolor="#F0E442", linestyle="none", label="as in the study", zorder=5,
        )  # fmt: skip
    cost = positive["cpu_per_period"]
    style.log_ticks(axis.xaxis, float(cost.min()), float(cost.max()))


def pareto(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (cost, error) that no other point beats in both, by cost."""
    front: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((cost, error))
    return front
