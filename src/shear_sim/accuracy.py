"""Speed against error: what a job's steps cost and what error they leave.

Every run of a job starts from the same prepared packing. A run with n times the job's steps per
period also cuts them into substeps by limits n times finer (but none is coarser than by default);
the reference is `REFERENCE` times finer in both. Errors shrink with the step only where
neighbouring trajectories stay together. A job is

``convergent``  if the error of the stress falls when every step is halved (or is negligible), and
                twins that start a little apart end about as near to each other;
``chaotic``     if twins drift apart: with any step, however small, the run is one of many
                equally good ones;
``uneven``      if the error does not fall although twins stay together: an event (a particle that
                snaps into the next valley) that happens with one step and not with the other.

Single runs of the last two cannot be judged; the mean of the moduli over many packings can.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim import models
from shear_sim.aggregate import describe_parameter
from shear_sim.models.interface import Column, Prepared, Simulation, SimulationError
from shear_sim.results import ResultsError, flatten
from shear_sim.rheology import Moduli, moduli
from shear_sim.statistics import LEVEL, interval
from shear_sim.variation import AMPLITUDE, FRICTION, short_name

if TYPE_CHECKING:
    import pandas as pd

    from shear_sim.study import Job, Study

LADDER = tuple(Fraction(2) ** n for n in range(-1, 4))  # steps, relative to the job's own
REFERENCE = 32  # times the job's own steps
PAIRED = 4  # times the job's own steps: the finer member of each pair of packings
TWIN = 1e-10  # initial distance of the first twins [mean radii]
TWINS_PART = 10.0  # final / initial distance of twins; found: below 2 or above 100
FALLING = 0.6  # error of the halved step / error; 0.5 is first order, 0.25 second
NEGLIGIBLE = 1e-5  # stress errors, relative to the amplitude, that need not fall with the step
EARLY = 0.05  # of a period: when the error of the step is read that the second twins start with
TIMED, REPEATS = 0.2, 5  # CPU seconds up to which runs are repeated; the fastest counts
RECORDS = 20  # per period, at least: moduli are fitted with nine harmonics

FloatArray = NDArray[np.float64]
Say = Callable[[str], None]

_IDENTITY = (
    Column("job", "", "id of the job; the runs of the report are not its result"),
    Column("scene", "", "scene(s) of the study"),
    Column("replicate", "1", "number of the packing"),
)
_RUN = (
    Column("scheme", "", "integrator"),
    Column("steps_per_period", "1", "whole steps per period T"),
    Column("factor", "1", "steps per period / those of the job; the limits of substeps go with it"),
    Column("own", "", "the job's own integrator and steps"),
    Column("substeps_per_step", "1", "mean number of pieces that a whole step is cut into"),
    Column("cpu_per_step", "µs", "CPU time of a substep, records included"),
    Column("cpu_per_period", "s", "CPU time of a period T, records included"),
    Column("magnitude_error", "1", "| |G*| / reference - 1 |"),
    Column("storage_error", "1", "|G' / reference - 1|"),
    Column("loss_error", "1", "|G'' / reference - 1|"),
    Column("stress_error", "1", "RMS error of the stress over the fitted periods / amplitude"),
    Column("position_error", "1", "RMS error of the final positions, in mean radii"),
    Column("energy_residual", "1", "largest error of the energy balance / energy lost"),
    Column("failed", "", "why the run has no result"),
)
_VERDICT = (
    Column("verdict", "", "convergent, chaotic or uneven; see shear_sim.accuracy"),
    Column("halved_error", "1", "stress error with all steps halved / stress error"),
    Column("step_error", "1", "error of the positions early in the shear, in mean radii"),
    Column("twins_round_off", "1", f"final / initial distance of twins {TWIN:g} radii apart"),
    Column("twins_step_error", "1", "final / initial distance of twins step_error apart"),
)
_PAIRS = (
    Column("verdict", "", "why the point is judged by its mean"),
    Column("packings", "1", "pairs of runs that have a result"),
    Column("failed", "1", "pairs that have none"),
    *(
        column
        for name, symbol in (("magnitude", "|G*|"), ("loss", "G''"))
        for column in (
            Column(
                f"{name}_difference_mean",
                "1",
                f"mean of {symbol} minus that of its pair with finer steps / mean of the latter",
            ),
            Column(f"{name}_difference_ci_low", "1", f"{LEVEL:.0%} interval of it"),
            Column(f"{name}_difference_ci_high", "1", f"{LEVEL:.0%} interval of it"),
        )
    ),
    Column("ci_method", "", "how the intervals were made"),
)


@dataclass(frozen=True)
class Verdict:
    """Whether the result of a job converges with the step, and the numbers that say so."""

    verdict: str
    halved_error: float
    step_error: float
    twins_round_off: float
    twins_step_error: float

    def __str__(self) -> str:
        return (
            f"{self.verdict}: halving every step leaves {self.halved_error:.2g} of the error; "
            f"twins {TWIN:g} and {self.step_error:.1g} radii apart end "
            f"{self.twins_round_off:.2g} and {self.twins_step_error:.2g} times as far apart"
        )


@dataclass(frozen=True)
class Measured:
    """The runs of one job (one dict for each, under the names of the table) and its verdict.

    ``failure`` says why there is neither.
    """

    job: "Job"
    runs: list[dict[str, Any]] = field(default_factory=list)
    verdict: Verdict | None = None
    failure: str | None = None


def choose(study: "Study", points: int, replicates: int) -> "list[Job]":
    """Return representative jobs: points far from each other, the first replicates of each.

    Greedy: beginning at the lowest values, each next point is the one farthest from those chosen.
    Amplitude, scene and friction count in full, by rank; all else that varies counts a quarter.
    Points without a whole period of oscillation, from which no moduli can be read, are left out.

    Raises
    ------
    ResultsError
        If no point is left.
    """
    groups = [jobs for jobs in study.groups().values() if is_measurable(jobs[0])]
    if not groups:
        msg = f"{study.path}: no job has a whole period of oscillation, and so none has moduli"
        raise ResultsError(msg)
    keys = ("scene", *study.varied)
    values = [{"scene": scene_of(jobs[0]), **_parameters(jobs[0])} for jobs in groups]
    places = np.zeros((len(groups), len(keys)))
    numeric = np.zeros(len(keys), dtype=bool)
    for column, key in enumerate(keys):
        of_key = [value.get(key) for value in values]
        numeric[column] = all(isinstance(value, int | float) for value in of_key)
        ranks: list[Any] = sorted(set(of_key), key=float if numeric[column] else str)
        spread = max(1, len(ranks) - 1) if numeric[column] else 1
        places[:, column] = [ranks.index(value) / spread for value in of_key]
    weights = np.array([1.0 if key in {"scene", AMPLITUDE, FRICTION} else 0.25 for key in keys])

    def apart(one: int) -> FloatArray:
        distance = np.abs(places - places[one])
        distance[:, ~numeric] = distance[:, ~numeric] > 0
        return np.asarray(distance @ weights)

    chosen = [int(np.argmin(places @ weights))]
    nearest = apart(chosen[0])
    while len(chosen) < min(points, len(groups)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, apart(chosen[-1]))
    return [job for one in chosen for job in groups[one][:replicates]]


def is_measurable(job: "Job") -> bool:
    """Tell whether moduli can be read from a job."""
    shear = getattr(job.point, "shear", None)
    return getattr(shear, "kind", None) == "oscillatory" and getattr(shear, "periods", 0) >= 1


def scene_of(job: "Job") -> str:
    """Return the scenes that a job belongs to, as in the other tables."""
    return "; ".join(dict.fromkeys(scene for _, scene in job.labels))


def _parameters(job: "Job") -> dict[str, Any]:
    return flatten(job.parameters)


def describe_point(job: "Job", varied: Sequence[str]) -> str:
    """Return the scene of a job and its parameters that vary in the study."""
    parameters = _parameters(job)
    facts = [scene_of(job)] if scene_of(job) else []
    facts += [
        f"{short_name(key)} {parameters[key]:g}"
        if isinstance(parameters[key], int | float)
        else f"{short_name(key)} {parameters[key]}"
        for key in varied
        if parameters.get(key) is not None
    ]
    return ", ".join(facts) or "the one point of the study"


def prepare(job: "Job") -> Prepared:
    """Return the prepared packing of a job.

    Raises
    ------
    ResultsError
        If its model does not step in time.
    SimulationError
        If the packing cannot be prepared.
    """
    preparing = getattr(models.model(job.point.kind), "prepare", None)
    if preparing is None:
        msg = f"model {job.point.kind} does not step in time: it has no accuracy report"
        raise ResultsError(msg)
    prepared: Prepared = preparing(job.point, job.streams)
    return prepared


def measure(
    job: "Job",
    ladder: Sequence[Fraction] = LADDER,
    schemes: Sequence[str] | None = None,
    *,
    reference: int = REFERENCE,
    energy: bool = True,
) -> Measured:
    """Run one job over a ladder of steps and integrators, against a far finer reference.

    Parameters
    ----------
    job : Job
        With a whole period of oscillation or more.
    ladder : sequence of Fraction
        Steps per period relative to the job's own. Rungs at which the protocol has no whole steps,
        or too few records for its moduli, are left out, and so are those of as many substeps as a
        finer one, which are the same motion with fewer records.
    schemes : sequence of str, optional
        Integrators; default: all of the model.
    reference : int
        Steps per period of the reference, relative to the job's own.
    energy : bool
        Run every rung once more with the energy balance.

    Returns
    -------
    Measured
    """
    try:
        prepared = prepare(job)
        fine = Reference(job, prepared, reference)
        verdict = _judge(prepared, fine)
    except SimulationError as error:
        return Measured(job, failure=str(error))
    own = fine.own_steps
    rungs = [
        (scheme, factor)
        for scheme in schemes or prepared.schemes
        for factor in ladder
        if prepared.allows(factor) and (factor >= 1 or own * factor >= RECORDS)
    ]
    runs = [_rung(prepared, fine, *rung, energy=energy) for rung in rungs]
    return Measured(job, [run for run in runs if not _repeats(run, runs)], verdict)


def _repeats(run: dict[str, Any], runs: Sequence[dict[str, Any]]) -> bool:
    """Tell whether a run makes the same substeps as one with more records."""

    def substeps(of: dict[str, Any]) -> int | None:  # per period
        per_step = of["substeps_per_step"]
        return None if per_step is None else round(per_step * of["steps_per_period"])

    return any(
        other["scheme"] == run["scheme"]
        and other["factor"] > run["factor"]
        and substeps(other) == substeps(run) is not None
        for other in runs
    )


class Reference:
    """The reference run of a job: its moduli, and the errors of other runs against it."""

    def __init__(self, job: "Job", prepared: Prepared, factor: int) -> None:
        self.job, self.prepared = job, prepared
        own = prepared.start()
        self.rows = own.rows
        simulation = prepared.start(factor=Fraction(factor))
        own.advance(1)
        early = _early(own)
        own.advance(early - 1)
        simulation.advance(early)
        self.step_error = prepared.distance(own, simulation)
        simulation.advance(simulation.rows)
        self.own = finish(own)
        self.simulation = simulation
        self.moduli, self.time, self.stress = response(job, simulation)
        self.own_steps: int = own.summary()["protocol"]["steps_per_period"]

    def errors(self, simulation: Simulation) -> dict[str, float]:
        """Return the errors of a run, under the names of the table."""
        found, _, stress = response(self.job, simulation)
        return {
            "magnitude_error": abs(found.magnitude / self.moduli.magnitude - 1),
            "storage_error": abs(found.storage / self.moduli.storage - 1),
            "loss_error": abs(found.loss / self.moduli.loss - 1),
            "stress_error": self.stress_error(simulation, stress),
            "position_error": self.prepared.distance(simulation, self.simulation),
        }

    def stress_error(self, simulation: Simulation, stress: FloatArray | None = None) -> float:
        """Return the RMS error of the shear stress over the fitted periods / its amplitude."""
        if stress is None:
            stress = response(self.job, simulation)[2]
        stride = (self.rows - 1) // (len(stress) - 1)  # coarse runs have fewer records
        protocol = simulation.summary()["protocol"]
        start, period = protocol["shear_start"], protocol["period"]
        whole = math.floor(protocol["periods"] + 1e-6)
        times = (self.time[::stride] - start) / period
        fitted = (times > (1 if whole > 1 else 0) - 1e-6) & (times < whole - 1e-6)
        difference = (stress - self.stress[::stride])[fitted]
        return float(np.sqrt(np.mean(difference**2)) / self.moduli.total)


def finish(simulation: Simulation) -> Simulation:
    """Run a simulation to its end."""
    while simulation.done < simulation.rows:
        simulation.advance(simulation.rows)
    return simulation


def response(job: "Job", simulation: Simulation) -> tuple[Moduli, FloatArray, FloatArray]:
    """Return the moduli of a finished run, and the times [s] and shear stresses [Pa] of them."""
    columns = simulation.columns()
    stress = models.model(job.point.kind).derive(columns)["shear_stress"]
    protocol = simulation.summary()["protocol"]
    keys = ("strain_amplitude", "period", "shear_start", "periods")
    found = moduli(columns["time"], stress, **{key: protocol[key] for key in keys})
    return found, columns["time"], stress


def _early(simulation: Simulation) -> int:
    """Return how many records there are up to `EARLY` in the shear."""
    protocol = simulation.summary()["protocol"]
    share = (protocol["shear_start"] + EARLY * protocol["period"]) / protocol["end"]
    return 1 + max(1, int(share * (simulation.rows - 1)))


def _judge(prepared: Prepared, fine: Reference) -> Verdict:
    """Tell whether a job converges with the step, from a halved step and two twins."""
    own = fine.own
    error = fine.stress_error(own)
    halved = fine.stress_error(finish(prepared.start(factor=Fraction(2))))
    apart = []
    for size in (TWIN, max(fine.step_error, TWIN)):
        twin = finish(prepared.start(displacement=size))
        apart.append(prepared.distance(twin, own) / size)
    if max(apart) > TWINS_PART:
        verdict = "chaotic"
    elif error > NEGLIGIBLE and halved > FALLING * error:
        verdict = "uneven"
    else:
        verdict = "convergent"
    ratio = halved / error if error > 0 else math.nan
    return Verdict(verdict, ratio, fine.step_error, *apart)


def _rung(
    prepared: Prepared,
    fine: Reference,
    scheme: str,
    factor: Fraction,
    *,
    energy: bool,
) -> dict[str, Any]:
    """Measure the cost and the errors of one run of the ladder."""
    own = factor == 1 and scheme == prepared.scheme
    row: dict[str, Any] = dict.fromkeys(column.name for column in _RUN)
    row |= {
        "scheme": scheme,
        "steps_per_period": int(fine.own_steps * factor),
        "factor": float(factor),
        "own": own,
    }
    try:
        simulation, cpu = _timed(lambda: prepared.start(scheme, factor=factor))
        errors = fine.errors(simulation)
        if energy:
            balance = finish(prepared.start(scheme, factor=factor, energy=True))
            errors["energy_residual"] = prepared.energy_residual(balance)
    except SimulationError as error:
        return row | {"failed": str(error)}
    summary = simulation.summary()
    periods = summary["protocol"]["end"] / summary["protocol"]["period"]
    steps, substeps = summary["checks"]["steps"], summary["checks"]["substeps"]
    return row | {
        "substeps_per_step": substeps / steps,
        "cpu_per_step": 1e6 * cpu / substeps,
        "cpu_per_period": cpu / periods,
        **errors,
    }


def _timed(start: Callable[[], Simulation]) -> tuple[Simulation, float]:
    """Return a finished run and the CPU seconds of the fastest of up to `REPEATS`."""
    times: list[float] = []
    while sum(times) < TIMED and len(times) < REPEATS:
        simulation = start()
        began = process_time()
        simulation.advance(simulation.rows)
        times.append(process_time() - began)
    return simulation, min(times)


def paired_differences(job: "Job", packings: int, factor: int = PAIRED) -> tuple[FloatArray, int]:
    """Compare the moduli of a point with those of finer steps, packing by packing.

    Parameters
    ----------
    job : Job
        Of the point; the pairs are its replicates 0 to ``packings`` - 1.
    packings : int
        Number of pairs.
    factor : int
        Steps per period of the finer member, relative to the point's own.

    Returns
    -------
    differences : (n, 2)
        Of |G*| and of G'', own steps minus finer ones, over the mean of the latter.
    failed : int
        Pairs of which one member has no result.
    """
    from shear_sim.study import Job

    pairs: list[FloatArray] = []
    for replicate in range(packings):
        of_packing = Job.create(job.point, job.seed, replicate)
        try:
            prepared = prepare(of_packing)
            found = [
                response(of_packing, finish(prepared.start(factor=Fraction(n))))[0]
                for n in (1, factor)
            ]
        except SimulationError:
            continue
        pairs.append(np.array([(each.magnitude, each.loss) for each in found]))
    values = np.array(pairs).reshape(-1, 2, 2)
    differences = values[:, 0] - values[:, 1]
    if len(pairs):
        differences /= np.abs(values[:, 1].mean(axis=0))
    return differences, packings - len(pairs)


def compare_packings(job: "Job", packings: int) -> dict[str, Any]:
    """Return the mean paired differences of a point and their intervals, as in the table."""
    differences, failed = paired_differences(job, packings)
    return summarise_pairs(differences, failed, seed=int(job.point_id, 16))


def summarise_pairs(differences: FloatArray, failed: int, *, seed: int) -> dict[str, Any]:
    """Return means of `paired_differences` and their intervals, under the names of the table.

    ``seed`` is that of the bootstrap: the same values have the same interval in every report.
    """
    row: dict[str, Any] = {"packings": len(differences), "failed": failed}
    for name, values in zip(("magnitude", "loss"), differences.T, strict=True):
        found = interval(values, seed=seed)
        row |= {
            f"{name}_difference_mean": float(values.mean()) if len(values) else math.nan,
            f"{name}_difference_ci_low": found.low,
            f"{name}_difference_ci_high": found.high,
            "ci_method": found.method,
        }
    return row


def runs_table(measured: Sequence[Measured], varied: Sequence[str]) -> "pd.DataFrame":
    """Return one row per run of the ladders, with what each column is in ``attrs``."""
    rows = [_identity(one.job, varied) | run | _facts(one) for one in measured for run in one.runs]
    return _frame(rows, [*_IDENTITY, *_described(measured, varied), *_RUN, *_VERDICT])


def pairs_table(
    measured: Sequence[Measured], pairs: Sequence[dict[str, Any]], varied: Sequence[str]
) -> "pd.DataFrame":
    """Return one row per point that was judged by its mean; ``pairs`` match ``measured``."""
    rows = [
        _identity(one.job, varied) | _facts(one) | pair
        for one, pair in zip(measured, pairs, strict=True)
    ]
    return _frame(rows, [*_IDENTITY[:2], *_described(measured, varied), *_PAIRS])


def _identity(job: "Job", varied: Sequence[str]) -> dict[str, Any]:
    parameters = _parameters(job)
    return {
        "job": job.id,
        "scene": scene_of(job),
        "replicate": job.replicate,
        **{key: parameters.get(key) for key in varied},
    }


def _facts(measured: Measured) -> dict[str, Any]:
    return {} if measured.verdict is None else vars(measured.verdict)


def _described(measured: Sequence[Measured], varied: Sequence[str]) -> Iterator[Column]:
    points = [type(one.job.point) for one in measured]
    return (describe_parameter(points, key) for key in varied)


def _frame(rows: Sequence[dict[str, Any]], columns: Sequence[Column]) -> "pd.DataFrame":
    import pandas as pd

    names = [column.name for column in columns]
    frame = pd.DataFrame(list(rows), columns=names)
    words = ("job", "scene", "scheme", "verdict", "ci_method")
    frame = frame.astype({name: "str" for name in words if name in frame})
    if frame.get("failed") is not None and frame["failed"].isna().all():
        frame = frame.astype({"failed": "object"})
    frame.attrs = {
        "units": {column.name: column.unit for column in columns},
        "descriptions": {column.name: column.description for column in columns},
    }
    return frame


def representative(measured: Sequence[Measured]) -> list[Measured]:
    """Return one job of each point that does not converge with the step."""
    found: dict[str, Measured] = {}
    for one in measured:
        if one.verdict is not None and one.verdict.verdict != "convergent":
            found.setdefault(one.job.point_id, one)
    return list(found.values())
