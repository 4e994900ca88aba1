"""The accuracy report: orders, chaos, tables, figure, command."""

import contextlib
import math
import re
from fractions import Fraction

import kelvin_voigt
import numpy as np
import pandas as pd
import pytest
from scenes import LOOSE, packing_point
from typer.testing import CliRunner

from shear_sim import accuracy, accuracy_report, cli
from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.prepared import PreparedMicrogel
from shear_sim.protocol import OscillatoryShear
from shear_sim.results import ResultsError
from shear_sim.screen import COMPILING
from shear_sim.streams import Streams
from shear_sim.study import Job, load_study
from shear_sim.tables import read_table

STUDY = """
packing: {discs: 20}
model: {links: {cut: none}}
shear: {pre_periods: 0.2, periods: 1, post_periods: 0.2}
scenes:
  loose: {}
  bulk: {model.links.cut: bulk, model.friction: 1}
sweep: {grid: {shear.strain_amplitude: [0.01, 0.1, 1]}}
replicates: 2
"""


def job_of(amplitude, links=LOOSE, discs=20, relative_frequency=0.025, **model):
    shear = OscillatoryShear(
        strain_amplitude=amplitude, pre_periods=0.2, periods=1, post_periods=0.2,
        relative_frequency=relative_frequency,
    )  # fmt: skip
    return Job.create(packing_point(discs=discs, links=links, shear=shear, **model), 1, 0)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("accuracy") / "small.yaml"
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture(scope="module")
def smooth():
    """A sheared gel in which no contact forms, slips or breaks."""
    return accuracy.measure(job_of(0.01, Links(cut="bulk"), friction=1.0))


@pytest.fixture(scope="module")
def chaotic():
    ladder = (Fraction(1, 2), Fraction(1))
    return accuracy.measure(job_of(1.0, discs=40), ladder, reference=8, energy=False)


def errors(measured, scheme, name):
    return [run[name] for run in measured.runs if run["scheme"] == scheme and run["factor"] >= 1]


@pytest.mark.parametrize("name", ["stress_error", "position_error", "magnitude_error"])
@pytest.mark.parametrize(("scheme", "order"), [("velocity_verlet", 2), ("semi_implicit_euler", 1)])
def test_errors_of_a_smooth_job_fall_at_the_order_of_the_integrator(smooth, scheme, order, name):
    found = errors(smooth, scheme, name)
    assert len(found) == 4
    assert math.log2(found[0] / found[-1]) / 3 == pytest.approx(order, abs=0.25)


def test_energy_balance_closes_at_the_order_of_the_integrator(smooth):
    """For Verlet; the balance of Euler is dominated by where in its step it is read."""
    found = errors(smooth, "velocity_verlet", "energy_residual")
    assert found[0] < 0.01
    assert math.log2(found[0] / found[-1]) / 3 == pytest.approx(2, abs=0.25)


def test_a_smooth_job_converges_and_loose_discs_at_full_strain_are_chaotic(smooth, chaotic):
    assert smooth.verdict.verdict == "convergent"
    assert smooth.verdict.halved_error == pytest.approx(0.25, abs=0.05)
    assert max(smooth.verdict.twins_round_off, smooth.verdict.twins_step_error) < 2
    assert chaotic.verdict.verdict == "chaotic"
    assert chaotic.verdict.twins_step_error > 100
    assert accuracy.representative([smooth, chaotic]) == [chaotic]


def test_an_error_that_does_not_fall_is_uneven(monkeypatch):
    monkeypatch.setattr(accuracy, "FALLING", 0.01)
    monkeypatch.setattr(accuracy, "NEGLIGIBLE", 0.0)
    job = job_of(0.01, Links(cut="bulk"), friction=1.0)
    found = accuracy.measure(job, (Fraction(1),), ["velocity_verlet"], reference=8, energy=False)
    assert found.verdict.verdict == "uneven"


def test_one_run_of_the_ladder_is_the_job_itself(smooth):
    [own] = [run for run in smooth.runs if run["own"]]
    simulation = accuracy.finish(prepare(smooth.job.point, Streams(1, 0)))
    moduli, _, _ = accuracy.response(smooth.job, simulation)
    prepared = accuracy.prepare(smooth.job)
    again, _, _ = accuracy.response(smooth.job, accuracy.finish(prepared.start()))
    assert moduli == again
    assert (own["scheme"], own["steps_per_period"]) == ("velocity_verlet", 240)
    assert own["substeps_per_step"] == 1
    assert own["cpu_per_period"] * 1.4 == pytest.approx(own["cpu_per_step"] * 336 / 1e6)


def test_a_rung_with_the_substeps_of_a_finer_one_is_left_out(chaotic, smooth):
    """Half the steps are cut into the same substeps, unless a step is one substep."""
    assert [run["factor"] for run in chaotic.runs] == [1.0, 1.0]
    job = job_of(0.01, Links(cut="bulk"), relative_frequency=1.0)
    ladder, schemes = (Fraction(1, 2), Fraction(1)), ["velocity_verlet"]
    found = accuracy.measure(job, ladder, schemes, reference=4, energy=False)
    assert [run["factor"] for run in found.runs] == [0.5, 1.0]
    assert sorted({run["factor"] for run in smooth.runs}) == [1.0, 2.0, 4.0, 8.0]


@pytest.mark.parametrize(("factor", "steps"), [(Fraction(1, 2), 120), (Fraction(2), 480)])
def test_other_rungs_are_the_job_with_their_steps(factor, steps):
    """Also its substeps: half as long with twice the steps, and never longer than by default."""
    job = job_of(0.01, Links(cut="bulk"))
    rung = accuracy.finish(accuracy.prepare(job).start(factor=factor))
    integrator = job.point.integrator.model_copy(update={"steps_per_period": steps})
    point = job.point.model_copy(update={"integrator": integrator})
    simulation = accuracy.finish(prepare(point, Streams(1, 0)))
    assert rung.substeps == simulation.substeps
    stride = max(1, int(factor))  # the ladder records at the same times on every rung
    for name, values in simulation.columns().items():
        np.testing.assert_allclose(rung.columns()[name], values[::stride], rtol=1e-9, atol=1e-12)


def test_a_prepared_packing_starts_again_from_the_same_state():
    point = job_of(0.5).point
    prepared = PreparedMicrogel(point, Streams(1, 0))
    first, second = (accuracy.finish(prepared.start()).columns() for _ in range(2))
    whole = prepare(point, Streams(1, 0))
    whole.advance(whole.rows)
    for name, values in whole.columns().items():
        assert values.tobytes() == first[name].tobytes() == second[name].tobytes()


@pytest.mark.parametrize("factor", [Fraction(1, 2), Fraction(3)])
def test_runs_with_other_steps_have_the_same_protocol(factor):
    prepared = PreparedMicrogel(job_of(0.5).point, Streams(1, 0))
    own, other = prepared.start(), prepared.start(factor=factor)
    columns, others = (accuracy.finish(run).columns() for run in (own, other))
    stride = 2 if factor < 1 else 1
    np.testing.assert_allclose(others["time"], columns["time"][::stride], rtol=1e-12)
    np.testing.assert_allclose(others["strain"], columns["strain"][::stride], atol=1e-14)
    assert other.summary()["checks"]["steps"] == own.summary()["checks"]["steps"] * factor


def test_a_protocol_without_whole_steps_is_refused():
    prepared = PreparedMicrogel(job_of(0.5).point, Streams(1, 0))
    assert not prepared.allows(Fraction(1, 7))
    with pytest.raises(ValueError, match="1/7 times 240 steps per period are not whole steps"):
        prepared.start(factor=Fraction(1, 7))


def test_twins_start_as_far_apart_as_asked():
    prepared = PreparedMicrogel(job_of(0.5).point, Streams(1, 0))
    one, other = prepared.start(), prepared.start(displacement=1e-3)
    for run in (one, other):
        run.advance(1)
    assert prepared.distance(one, other) == pytest.approx(1e-3, rel=1e-9)


def test_distances_are_to_the_nearest_image():
    prepared = PreparedMicrogel(job_of(0.5).point, Streams(1, 0))
    one, other = (accuracy.finish(prepared.start()) for _ in range(2))
    c, strain = one.constants, one.columns()["strain"][-1]
    other.discs.x[:] += 2 * c.width + strain * c.height
    other.discs.y[:] += c.height
    assert prepared.distance(one, other) < 1e-9


def test_representative_points_are_far_from_each_other(study):
    jobs = accuracy.choose(study, 4, 2)
    assert [job.replicate for job in jobs] == [0, 1] * 4
    found = {(accuracy.scene_of(job), job.point.shear.strain_amplitude) for job in jobs}
    assert found == {(scene, a) for scene in ("loose", "bulk") for a in (0.01, 1)}
    assert len(accuracy.choose(study, 99, 1)) == 6


def test_runs_table_has_units_and_is_read_back(smooth, chaotic, tmp_path):
    table = accuracy.runs_table([smooth, chaotic], ("shear.strain_amplitude",))
    assert len(table) == 8 + 2
    assert (table["shear.strain_amplitude"].unique() == [0.01, 1.0]).all()
    accuracy_report.save(table, tmp_path / "accuracy")
    columns, _ = read_table(tmp_path / "accuracy.parquet")
    assert list(columns) == list(table)
    csv = pd.read_csv(tmp_path / "accuracy.csv")
    assert {"cpu_per_step_µs", "cpu_per_period_s", "loss_error", "verdict"} <= set(csv)
    np.testing.assert_array_equal(csv["position_error"], columns["position_error"])
    assert table.attrs["units"].keys() == table.attrs["descriptions"].keys() == set(table)


def test_paired_differences_over_packings():
    """The difference of a smooth job is its error, far below a tenth of a percent."""
    found = accuracy.compare_packings(job_of(0.01, Links(cut="bulk"), friction=1.0), 3)
    assert (found["packings"], found["failed"], found["ci_method"][0]) == (3, 0, "t")
    for name in ("magnitude", "loss"):
        mean = found[f"{name}_difference_mean"]
        assert abs(mean) < 1e-3
        assert found[f"{name}_difference_ci_low"] < mean < found[f"{name}_difference_ci_high"]


MODULI = np.array([300.0, 40.0])  # G′, G″ [Pa]
AMPLITUDE, PERIOD, STEPS = 0.02, 8.0, 40
BIAS = {1: (0.03, -0.1), 2: (0.01, -0.03), 4: (0.004, 0.02)}  # of G′ and G″, by number of steps
FAR = {1: 0.04, 2: 0.01}  # how far discs end from where they should, in mean radii


class StandIn:
    """A run of known stress: 0.5 periods of rest, 2 of shear, a sine with moduli that err."""

    def __init__(self, factor, moduli, displacement=0.0, cost=lambda: None):
        self.factor, self.displacement, self.cost = factor, displacement, cost
        self.moduli = moduli * (1 + np.array(BIAS.get(factor, (0.0, 0.0))))
        self.rows, self.done = round(2.5 * STEPS) + 1, 0

    def advance(self, rows):
        self.done = min(self.rows, self.done + rows)
        self.cost()

    def columns(self):
        time = np.arange(self.rows) * PERIOD / STEPS
        phase = 2 * np.pi * (time / PERIOD - 0.5)
        strain = AMPLITUDE * np.where(phase >= 0, np.sin(phase), 0)
        quarter = AMPLITUDE * np.where(phase >= 0, np.cos(phase), 0)
        stress = self.moduli[0] * strain + self.moduli[1] * quarter
        return {"time": time, "strain": strain, "periodic_overall_xy": -stress}

    def summary(self):
        protocol = {
            "strain_amplitude": AMPLITUDE, "period": PERIOD, "shear_start": 0.5 * PERIOD,
            "periods": 2, "end": 2.5 * PERIOD, "steps_per_period": round(STEPS * self.factor),
        }  # fmt: skip
        return {"protocol": protocol, "checks": {"steps": 100, "substeps": 300}}


class StandInPacking:
    """Runs that start from one packing, whose moduli are ``MODULI`` times ``size``."""

    schemes, scheme = ("only",), "only"

    def __init__(self, size=1.0, cost=lambda: None):
        self.size, self.cost = size, cost

    def allows(self, factor):
        return factor >= 1

    def start(self, scheme=None, *, factor=Fraction(1), displacement=0.0, energy=False):  # noqa: ARG002
        assert scheme in {None, "only"}
        return StandIn(factor, self.size * MODULI, displacement, self.cost)

    def distance(self, one, other):
        place = [
            3 * run.displacement + FAR.get(run.factor, 0) * (1 if run.done == run.rows else 0.5)
            for run in (one, other)
        ]
        return abs(place[0] - place[1])

    def energy_residual(self, simulation):
        return 0.125 / simulation.factor


def stand_in_job():
    point = kelvin_voigt.KelvinVoigtPoint(model={"kind": "kelvin_voigt"})
    return Job.create(point, 1, 0)


def test_every_number_of_the_report(monkeypatch):
    """Against a stand-in whose moduli, places, energies and times are known."""
    before = [0.0] * 8  # reference, own run and verdict
    now, costs = [0.0], iter([*before, 0.05, 0.04, 0.06, 0.07, 0.0])

    def cost():
        now[0] += next(costs)

    monkeypatch.setattr(accuracy, "process_time", lambda: now[0])
    monkeypatch.setattr(accuracy, "prepare", lambda _: StandInPacking(cost=cost))
    found = accuracy.measure(stand_in_job(), (Fraction(1),), reference=8)
    [run] = found.runs
    storage, loss = MODULI
    magnitude = math.hypot(storage, loss)
    assert run == {
        "scheme": "only",
        "steps_per_period": STEPS,
        "factor": 1.0,
        "own": True,
        "substeps_per_step": 3.0,
        "cpu_per_step": pytest.approx(1e6 * 0.04 / 300),  # the fastest of four: 0.22 s are enough
        "cpu_per_period": pytest.approx(0.04 / 2.5),
        "magnitude_error": pytest.approx(math.hypot(1.03 * storage, 0.9 * loss) / magnitude - 1),
        "storage_error": pytest.approx(0.03),
        "loss_error": pytest.approx(0.1),
        "stress_error": pytest.approx(
            math.hypot(0.03 * storage, 0.1 * loss) / math.sqrt(2) / magnitude
        ),
        "position_error": pytest.approx(0.04),
        "energy_residual": 0.125,
        "failed": None,
    }
    halved = math.hypot(0.01 * storage, 0.03 * loss) / math.hypot(0.03 * storage, 0.1 * loss)
    assert found.verdict.verdict == "convergent"
    assert found.verdict.halved_error == pytest.approx(halved)
    assert found.verdict.step_error == pytest.approx(0.02)  # early, at half of its way
    assert found.verdict.twins_round_off == pytest.approx(3.0, rel=1e-5)
    assert found.verdict.twins_step_error == pytest.approx(3.0)


def test_paired_differences_have_the_size_and_sign_of_the_bias(monkeypatch):
    """Own steps minus finer ones, over the mean of the latter: packings of different moduli."""
    sizes = np.array([1.0, 2.0, 0.5, 1.5])
    monkeypatch.setattr(accuracy, "prepare", lambda job: StandInPacking(sizes[job.replicate]))
    differences, failed = accuracy.paired_differences(stand_in_job(), len(sizes))
    own, finer = (MODULI * (1 + np.array(BIAS[n])) for n in (1, 4))
    expected = [math.hypot(*own) / math.hypot(*finer) - 1, own[1] / finer[1] - 1]
    assert expected[0] > 0.02
    assert expected[1] < -0.1
    assert failed == 0
    np.testing.assert_allclose(differences, np.outer(sizes / sizes.mean(), expected), rtol=1e-9)
    found = accuracy.compare_packings(stand_in_job(), len(sizes))
    for name, mean in zip(("magnitude", "loss"), expected, strict=True):
        assert found[f"{name}_difference_mean"] == pytest.approx(mean)
        low, high = (found[f"{name}_difference_ci_{end}"] for end in ("low", "high"))
        assert low < mean < high


def test_the_figure_shows_every_integrator_and_the_steps_of_the_study(smooth, chaotic):
    figure = accuracy_report.draw(accuracy.runs_table([smooth, chaotic], ()))
    [legend] = figure.legends
    texts = {text.get_text() for text in legend.get_texts()}
    assert {"velocity verlet", "semi implicit euler", "Pareto front", "as in the study"} <= texts
    [line] = [x for x in figure.axes[2].lines if x.get_label() == "velocity verlet"]
    verlet = [run for run in smooth.runs if run["scheme"] == "velocity_verlet"]
    shown = sorted(run["stress_error"] for run in verlet)
    np.testing.assert_allclose(sorted(line.get_ydata()), shown)
    assert "1 job(s) that converge with the step; 1 more do not" in figure.get_suptitle()
    alone = accuracy_report.draw(accuracy.runs_table([chaotic], ()))
    assert "none of which converges" in alone.get_suptitle()


def test_pareto_front():
    points = [(1.0, 5.0), (2.0, 6.0), (2.0, 4.0), (3.0, 1.0), (4.0, 1.0)]
    assert accuracy_report.pareto(points) == [(1.0, 5.0), (2.0, 4.0), (3.0, 1.0)]


def command(*arguments):
    return CliRunner().invoke(cli.app, ["accuracy", *map(str, arguments)])


def test_command_writes_tables_and_figure(study, tmp_path, monkeypatch):

    def compile_for(jobs, tell):
        tell()  # before the jobs, and once more among them

    @contextlib.contextmanager
    def telling(tell):
        tell()
        yield

    monkeypatch.setattr(accuracy_report, "compile_for", compile_for)
    monkeypatch.setattr(accuracy_report, "telling", telling)
    shown = command(study.path, "--points", 2, "--packings", 2, "--results", tmp_path)
    assert shown.exit_code == 0, shown.output
    assert "2 of 12 jobs, against 32 times finer steps" in shown.output
    assert "1 convergent, 1 chaotic" in shown.output
    assert "(2 pairs)" in shown.output
    assert "\n1 of 2: job " in shown.output
    assert re.search(r"\n2 of 2 \(about \d+ s to go\): job ", shown.output)
    assert shown.output.count(COMPILING) == 1
    folder = tmp_path / "small"
    assert (folder / "figures/accuracy.png").stat().st_size > 10_000
    runs = read_table(folder / "tables/accuracy.parquet").columns
    assert len(runs["job"]) == 16
    pairs = read_table(folder / "tables/accuracy_pairs.parquet").columns
    assert pairs["packings"].tolist() == [2]


def test_command_measures_one_job(study, tmp_path):
    job = study.jobs()[0].id
    shown = command(study.path, "--job", job[:8], "--packings", 0, "--results", tmp_path)
    assert shown.exit_code == 0, shown.output
    assert f"\n1 of 1: job {job}, replicate " in shown.output


def test_command_fails_with_its_jobs(study, tmp_path, monkeypatch):
    def explode(job):
        message = "the packing exploded"
        raise SimulationError(message)

    monkeypatch.setattr(accuracy, "prepare", explode)
    shown = command(study.path, "--points", 1, "--results", tmp_path)
    assert shown.exit_code == 1
    assert "failed: the packing exploded" in shown.output
    assert "1 jobs: 1 failed" in shown.output


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (STUDY, ["--job", "zzz"], "--job zzz: 0 jobs of .* have an id that begins so"),
        ("shear: {periods: 0.5}", [], "no job has a whole period"),
        ("model: {kind: kelvin_voigt}", [], "model kelvin_voigt does not step in time"),
    ],
)
def test_command_refuses_what_it_cannot_measure(text, arguments, message, tmp_path):
    assert "kelvin_voigt" in kelvin_voigt.__name__  # known since its import
    path = tmp_path / "study.yaml"
    path.write_text(text)
    shown = command(path, "--results", tmp_path, *arguments)
    assert isinstance(shown.exception, ResultsError)
    assert cli._explain(shown.exception) == 2
    with pytest.raises(ResultsError, match=message):
        raise shown.exception
