"""From the results of a study to tables, with a spring and a dashpot whose moduli are known."""

import io
import json
import re

import kelvin_voigt
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from scipy import stats
from tools import here

from shear_sim import aggregate as module
from shear_sim.aggregate import aggregate, load, make_tables
from shear_sim.aggregate.columns import CURVE_QUANTITIES, MODEL_FLAGS
from shear_sim.aggregate.curves import STEADY_QUANTITIES, means_table
from shear_sim.aggregate.response import MAY_BE_LOGARITHMIC
from shear_sim.aggregate.runs import Waves, runs_table
from shear_sim.models.interface import Column
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.results import Failure, Results, ResultsError
from shear_sim.rheology import LIMITS
from shear_sim.runner import run_job
from shear_sim.statistics import RESAMPLES, holm
from shear_sim.study import load_study
from shear_sim.summary import FLAGGED, _effect, _three_digits, print_summary
from shear_sim.tables import TableError

STUDY = """
model: {kind: kelvin_voigt, noise: 2.0}
shear: {kind: oscillatory, relative_frequency: 0.025}
scenes:
  stiff: {model.modulus: 400}
  soft: {model.modulus: 50}
sweep:
  - name: main
    grid:
      shear.strain_amplitude: [0.1, 0.2, 0.4]
  - name: thick
    scenes: [stiff]
    grid:
      shear.strain_amplitude: [0.2]
      model.viscosity: [2.0, 8.0]
replicates: 11
seed: 5
"""
OMEGA = 2 * np.pi * 0.025


def make(folder, text=STUDY, keep=lambda _: True):
    """Plan a study in ``folder`` and run the jobs that ``keep`` wants; return its results."""
    file = folder / "springs.yaml"
    file.write_text(text)
    study = load_study(file)
    results = Results(folder / "results" / study.name)
    results.prepare(study)
    for job in study.jobs():
        if keep(job):
            run_job(job, results.jobs)
    return results


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def tables(whole):
    return aggregate(whole.folder, figures=False)


def point(points, **keys):
    for key, value in keys.items():
        points = points[points[key.replace("__", ".")] == value]
    assert len(points) == 1
    return points.iloc[0]


def test_one_row_per_run_with_its_moduli(tables, whole):
    runs = tables["runs"]
    assert sorted(runs["job"]) == sorted(whole.finished())
    assert len(runs) == 8 * 11
    row = runs.iloc[0]
    summary = json.loads(pq.read_metadata(whole.job_file(row["job"])).metadata[b"shear_sim"])
    fit = summary["moduli"]["periodic"]
    assert row["storage_modulus"] == fit["storage"]
    assert row["loss_modulus"] == fit["loss"]
    assert row["complex_modulus"] == np.hypot(fit["storage"], fit["loss"])
    assert row["tan_delta"] == fit["loss"] / fit["storage"]
    assert row["total_stress"] == fit["total"]
    assert row["cycle_change"] == summary["quality"]["cycle_change"]
    assert row["drift_ratio"] == summary["quality"]["drift_ratio"]
    assert row["largest_jump"] == summary["quality"]["largest_jump"]
    assert row["model.modulus"] == summary["parameters"]["model"]["modulus"]


def test_one_row_per_point_with_what_a_spring_and_a_dashpot_have(tables):
    curves = tables["curves"]
    assert len(curves) == 8
    assert (curves["replicates"] == 11).all()
    assert (curves["planned"] == 11).all()
    row = point(curves, scene="stiff", model__viscosity=8.0)
    assert row["block"] == "thick"
    assert row["storage_modulus_mean"] == pytest.approx(400, rel=0.02)
    assert row["loss_modulus_mean"] == pytest.approx(8 * OMEGA, abs=4)
    assert row["storage_modulus_ci_low"] < row["storage_modulus_mean"]
    assert row["storage_modulus_ci_high"] > row["storage_modulus_mean"]
    assert row["storage_modulus_ci_method"] == "BCa"
    assert row["ci_level"] == 0.95


def test_mean_median_and_interval_are_of_the_runs(tables):
    runs, curves = tables["runs"], tables["curves"]
    row = point(curves, scene="soft", shear__strain_amplitude=0.1)
    values = runs.loc[runs["point"] == row["point"], "storage_modulus"].to_numpy()
    assert row["storage_modulus_mean"] == pytest.approx(values.mean(), rel=1e-14)
    assert row["storage_modulus_median"] == np.median(values)
    assert row["storage_modulus_sd"] == pytest.approx(values.std(ddof=1), rel=1e-14)
    expected = stats.bootstrap(
        (values,), np.mean, n_resamples=RESAMPLES, rng=np.random.default_rng(row["ci_seed"])
    ).confidence_interval
    assert row["storage_modulus_ci_low"] == pytest.approx(expected.low, rel=1e-12)
    assert row["storage_modulus_ci_high"] == pytest.approx(expected.high, rel=1e-12)


def test_rows_come_in_the_order_of_the_study_file(tables):
    """Not alphabetical: soft would come before stiff."""
    curves = tables["curves"]
    assert list(dict.fromkeys(curves["scene"])) == ["stiff", "soft"]
    soft = curves[curves["scene"] == "soft"]
    assert soft["shear.strain_amplitude"].tolist() == [0.1, 0.2, 0.4]


def test_tables_are_the_same_at_every_aggregation_and_no_series_is_read_again(
    whole, tables, monkeypatch
):
    def unread(*_args, **_keys):
        pytest.fail("a result file was read, though its summary is in the index")

    monkeypatch.setattr(module, "read_job", unread)
    monkeypatch.setattr("shear_sim.results._index_row", unread)
    kept = {path.name: path.read_bytes() for path in whole.tables.iterdir()}
    for name, table in aggregate(whole.folder, figures=False).items():
        pd.testing.assert_frame_equal(table, tables[name])
    assert {path.name: path.read_bytes() for path in whole.tables.iterdir()} == kept


def test_parquet_carries_units_and_reads_back(whole, tables):
    schema = pq.read_schema(whole.tables / "curves.parquet")
    assert schema.field("storage_modulus_mean").metadata[b"unit"] == b"Pa"
    assert schema.field("model.modulus").metadata == {b"unit": b"Pa", b"description": b"G [Pa]"}
    assert schema.field("shear.strain_amplitude").metadata[b"unit"] == b"1"
    for name, table in tables.items():
        again = load(whole.tables / f"{name}.parquet")
        pd.testing.assert_frame_equal(again, table, check_dtype=False)
        assert again.attrs["units"] == table.attrs["units"]


@pytest.mark.parametrize("content", [None, b"PAR1"])
def test_a_damaged_table_says_what_to_do(tmp_path, content):
    if content is not None:
        (tmp_path / "curves.parquet").write_bytes(content)
    with pytest.raises(TableError, match="`shear-sim aggregate RESULTS` makes it again"):
        load(tmp_path / "curves.parquet")


def test_numbers_have_a_unit_and_words_have_none(tables):
    for table in tables.values():
        for name, unit in table.attrs["units"].items():
            assert (unit != "") == (table[name].dtype.kind in "iuf"), name
            assert unit != "-"


def test_parameters_that_are_numbers_have_the_unit_1():
    keys = ("contact_law.begin", "contact_law.kind", "links.cuts", "young_modulus")
    units = [module.describe_parameter([MicrogelPoint], f"model.{key}").unit for key in keys]
    assert units == ["1", "", "1", "Pa"]


def test_csv_names_carry_units(whole, tables):
    read = pd.read_csv(whole.tables / "curves.csv")
    assert "storage_modulus_mean_Pa" in read
    assert "model.modulus_Pa" in read
    assert "tan_delta_mean" in read
    assert "shear.strain_amplitude" in read
    values = tables["curves"]["storage_modulus_mean"]
    assert read["storage_modulus_mean_Pa"].tolist() == values.tolist()
    assert "drift_Pa_per_s" in pd.read_csv(whole.tables / "runs.csv")


def printed(tables, **keys):
    file = io.StringIO()
    print_summary(tables, Console(file=file, **keys))
    return file.getvalue()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (999.4, "999"), (999.6, "1000"), (1969.6, "1970"), (-999.9, "-1000"), (999_400.0, "999000"),
        (999_600.0, "1e+06"), (0.0009996, "0.001"), (816.4, "816"), (np.inf, "inf"),
    ],
)  # fmt: skip
def test_numbers_are_rounded_before_their_format_is_chosen(value, text):
    assert _three_digits(value) == text


def test_a_partial_study_says_so_everywhere(tmp_path):
    """Replicates 0 to 3 only, one failed; nothing at all of the largest amplitude."""
    results = make(
        tmp_path, keep=lambda job: job.replicate < 4 and job.point.shear.strain_amplitude < 0.3
    )
    (lost,) = (j for j in load_study(tmp_path / "springs.yaml").jobs()[:1])
    results.job_file(lost.id).unlink(missing_ok=True)
    results.record_failure(Failure(lost.id, "physics", "the spring broke"))
    done = len(results.finished())
    tables = aggregate(results.folder, figures=False)
    curves = tables["curves"]
    assert len(curves) == 8
    assert curves["replicates"].sum() == done == len(tables["runs"])
    assert curves["planned"].sum() == 88
    assert curves["failed"].sum() == 1
    nothing = point(curves, scene="soft", shear__strain_amplitude=0.4)
    assert (nothing["replicates"], nothing["storage_modulus_ci_method"]) == (0, "none")
    assert np.isnan(nothing["storage_modulus_mean"])
    some = point(curves, scene="soft", shear__strain_amplitude=0.1)
    assert some["storage_modulus_ci_method"] == "t_log"
    assert some["storage_modulus_ci_flag"] == "fewer than 10 replicates"
    text = printed(tables)
    assert f"PARTIAL STUDY: {done} of 88 runs (1 failed, {87 - done} not yet run)" in text
    assert re.search(r"soft +0\.4 +0 of 11 +- +-\n", text)


def test_nothing_finished_yet(tmp_path):
    results = make(tmp_path, keep=lambda _: False)
    tables = aggregate(results.folder)
    assert len(tables["runs"]) == 0
    assert tables["curves"]["replicates"].tolist() == [0] * 8
    assert "PARTIAL STUDY: 0 of 88 runs (0 failed, 88 not yet run)" in printed(tables)
    assert not list(results.figures.iterdir())


def test_only_folders_with_something_in_them_are_called_written(tmp_path, whole):
    empty = make(tmp_path, keep=lambda _: False)
    for results, folders in ((empty, [empty.tables]), (whole, [whole.tables, whole.figures])):
        code, output = here("aggregate", results.folder)
        written = ", ".join(map(str, folders))
        assert (code, output.splitlines()[-1]) == (0, f"written: {written}")


def test_damaged_results_are_named_and_not_called_missing(tmp_path):
    results = make(tmp_path, STUDY.replace("replicates: 11", "replicates: 2"))
    bad = sorted(results.finished())[3:5]
    for job in bad:
        results.job_file(job).write_bytes(b"PAR1 and no more")
    with pytest.warns(RuntimeWarning, match=bad[0]):
        tables = aggregate(results.folder, figures=False)
    assert tables["runs"].attrs["damaged"] == bad
    text = printed(tables)
    assert "PARTIAL STUDY: 14 of 16 runs (0 failed, 0 not yet run)" in text
    assert f"2 results are damaged and left out ({bad[0]}, {bad[1]})" in text


def test_results_outside_the_plan_are_counted_but_not_counted_in(tmp_path):
    """The study file loses an amplitude; its results stay on the disk."""
    fewer = STUDY.replace("replicates: 11", "replicates: 2")
    make(tmp_path, fewer)
    results = make(tmp_path, fewer.replace("[0.1, 0.2, 0.4]", "[0.1, 0.2]"))
    assert len(results.finished()) == 16
    tables = aggregate(results.folder, figures=False)
    assert len(tables["runs"]) == 12
    assert 0.4 not in set(tables["runs"]["shear.strain_amplitude"])
    assert tables["runs"].attrs["orphans"] == 4
    assert "4 results are of jobs outside the plan; they are not counted" in printed(tables)


def test_old_points_keep_their_intervals_when_a_study_grows(tmp_path, tables, whole):
    """Also where a new key varies, which old points then show with its default."""
    text = STUDY.replace("[0.1, 0.2, 0.4]", "[0.1, 0.2, 0.4, 0.8]").replace(
        "model.viscosity: [2.0, 8.0]", "model.viscosity: [2.0, 8.0]\n      model.seconds: [0, 1e-9]"
    )
    old = whole.finished()
    grown = make(tmp_path, text, keep=lambda job: job.id in old)
    new = aggregate(grown.folder, figures=False)["curves"].set_index("point")
    for _, row in tables["curves"].iterrows():
        for name in ("storage_modulus_ci_low", "loss_modulus_ci_high", "ci_seed"):
            assert new.loc[row["point"], name] == row[name]


def test_an_example_is_drawn_even_where_every_run_is_flagged(tmp_path):
    results = make(tmp_path, "model: {kind: kelvin_voigt, noise: 5.0}\nreplicates: 3\n")
    assert aggregate(results.folder)["runs"]["flagged"].all()
    assert (results.figures / "example.png").exists()


def test_the_example_is_the_run_at_the_middle_of_all_parameters(whole, tables):
    """Of the amplitudes first; viscosity varies at 0.2 alone, by 2 and 8 beside the model's 5."""
    runs = tables["runs"].sort_values("model.viscosity").copy()
    runs["flagged"] = False
    title = module._example(whole, {"runs": runs})["title"]
    job, _, words = title.removeprefix("job ").partition(": ")
    assert words == "stiff, modulus 400 Pa, viscosity 5 Pa s, strain amplitude 0.2"
    point = runs.set_index("job").loc[job]
    assert (point["model.viscosity"], point["shear.strain_amplitude"]) == (5.0, 0.2)


def test_flagged_runs_are_counted_in_and_counted(tmp_path):
    """Noise of 2 Pa at rest is more than a tenth of a stress amplitude of 4 Pa."""
    text = STUDY.replace("[0.1, 0.2, 0.4]", "[0.01, 0.4]").replace("11", "3")
    tables = aggregate(make(tmp_path, text).folder, figures=False)
    loud = point(tables["curves"], scene="stiff", shear__strain_amplitude=0.01)
    quiet = point(tables["curves"], scene="stiff", shear__strain_amplitude=0.4)
    assert (loud["flagged"], loud["replicates"]) == (3, 3)
    assert quiet["flagged"] == 0
    runs = tables["runs"]
    assert runs.loc[runs["point"] == loud["point"], "flags"].str.contains("baseline_noise").all()
    assert (runs.loc[runs["point"] == quiet["point"], "flags"] == "").all()
    said = " whose stress at rest is over 10% of its amplitude (baseline_noise)"
    assert re.search(rf"runs are flagged, .*: .*\d{re.escape(said)}", printed(tables))
    assert set(FLAGGED) == {*LIMITS, *MODEL_FLAGS}  # each is said in words


def test_runs_without_a_whole_period_have_no_moduli_and_are_flagged(tmp_path):
    text = STUDY.replace("relative_frequency: 0.025", "relative_frequency: 0.025, periods: 0.5")
    tables = aggregate(make(tmp_path, text.replace("11", "2")).folder, figures=False)
    assert tables["runs"]["flagged"].all()
    assert tables["runs"]["no_moduli"].str.contains("at least one whole period").all()
    assert (tables["curves"]["replicates"] == 2).all()


def test_one_point(tmp_path):
    """Nothing varies: no axis, no panels, still tables."""
    text = "model: {kind: kelvin_voigt, noise: 0.1}\nreplicates: 3\n"
    results = make(tmp_path, text)
    tables = aggregate(results.folder, figures=False)
    assert len(tables["curves"]) == 1
    assert "3 of 3 runs" in printed(tables)
    assert len(tables["features"]) == len(tables["contrasts"]) == 0


def test_figures_are_drawn_from_the_tables(whole):
    aggregate(whole.folder)
    names = {path.stem for path in whole.figures.iterdir()}
    assert names >= {"moduli", "moduli_branches", "example"}


def test_the_screen_is_plain_where_it_is_no_terminal(tables):
    text = printed(tables)
    assert set(re.findall(r"[^\x00-\x7f]", text)) <= {"′", "″"}
    assert "\x1b" not in text
    assert "\n88 of 88 runs\n" in text
    on_terminal = printed(tables, force_terminal=True, width=100)
    assert "\x1b" in on_terminal


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(ResultsError, match="not a results folder"):
        aggregate(tmp_path)


def test_steady_shear_has_its_own_table():
    """The index of two steady runs, as their summaries would fill it."""
    planned = pd.DataFrame(
        {
            "job": ["a", "b"],
            "point": ["1" * 16] * 2,
            "curve": ["2" * 16] * 2,
            "replicate": [0, 1],
            "scene": pd.Categorical(["", ""]),
            "block": ["", ""],
        }
    )
    index = pa.table(
        {
            "job": ["a", "b"],
            "steady.shear_stress": [10.0, 14.0],
            "steady.viscosity": [5.0, 7.0],
            "steady.stress_ratio": [0.2, 0.3],
            "flags.no_steady": pa.array([None, None], pa.string()),
        }
    )
    runs = runs_table(planned, index.to_pandas(), [], Waves(index, "periodic"))
    assert runs["viscosity"].tolist() == [5.0, 7.0]
    assert not runs["flagged"].any()
    points = means_table(planned, runs, [], STEADY_QUANTITIES, seed=1)
    assert points.loc[0, "viscosity_mean"] == 6.0
    assert points.attrs["units"]["viscosity_mean"] == "Pa s"


def test_what_a_model_measures_is_averaged_over_the_runs_that_have_it():
    """Three compressions, one of which was arrested: it has a density, but no rattlers."""
    planned = pd.DataFrame(
        {
            "job": ["a", "b", "c"],
            "point": ["1" * 16] * 3,
            "curve": ["2" * 16] * 3,
            "replicate": [0, 1, 2],
            "scene": pd.Categorical([""] * 3),
            "block": [""] * 3,
        }
    )
    index = pa.table(
        {
            "job": ["a", "b", "c"],
            "status": ["jammed", "arrested", "jammed"],
            "measured.density": [0.82, 0.83, 0.84],
            "measured.rattlers": [0.01, None, 0.04],
            "flags.stopped_early": [False, True, False],
        }
    )
    density, rattlers = Column("density", "1", "of discs"), Column("rattlers", "1", "of them")
    measured = [
        (Column("status", "", "how it ended"), "status"),
        (density, "measured.density"),
        (rattlers, "measured.rattlers"),
    ]
    waves = Waves(index, "periodic")
    runs = runs_table(planned, index.to_pandas(), [], waves, measured=measured)
    assert runs["status"].tolist() == ["jammed", "arrested", "jammed"]
    assert runs["flags"].tolist() == ["", "stopped_early", ""]
    assert runs["flagged"].tolist() == [False, True, False]
    row = means_table(planned, runs, [], [density, rattlers], seed=1).loc[0]
    assert (row["replicates"], row["n"], row["flagged"]) == (3, 3, 1)
    assert row["density_mean"] == pytest.approx(0.83, rel=1e-14)
    assert row["density_ci_flag"] == "fewer than 4 replicates: no more than a guess"
    alone = means_table(planned, runs[runs["job"] != "b"], [], [rattlers], seed=1).loc[0]
    assert row["rattlers_mean"] == pytest.approx(0.025, rel=1e-14)
    for bound in ("low", "high"):
        assert row[f"rattlers_ci_{bound}"] == alone[f"rattlers_ci_{bound}"]
    flag = "only 2 of 3 runs have a value; fewer than 4 replicates: no more than a guess"
    assert row["rattlers_ci_flag"] == flag


def test_tables_of_very_many_columns_are_made_without_a_warning():
    """Pandas complains of frames that grow column by column, from a hundred on."""
    many = [Column(f"quantity_{number}", "1", "a number") for number in range(120)]
    labels = {"point": ["1" * 16], "curve": ["2" * 16], "block": [""], "replicate": [0]}
    planned = pd.DataFrame({"job": ["a"], "scene": pd.Categorical([""])} | labels)
    index = pa.table({"job": ["a"]} | {f"measured.{c.name}": [1.5] for c in many})
    measured = [(c, f"measured.{c.name}") for c in many]
    runs = runs_table(planned, index.to_pandas(), [], Waves(index, "periodic"), measured=measured)
    assert runs["quantity_119"].tolist() == [1.5]
    points = means_table(planned, runs, [], many, seed=1)
    assert points["quantity_119_mean"].tolist() == [1.5]


def test_cycles_and_harmonics_have_a_row_each(tables, whole):
    runs, cycles, harmonics = (tables[name] for name in ("runs", "cycles", "harmonics"))
    assert len(cycles) == 3 * len(runs)
    assert len(harmonics) == 9 * len(runs)
    job = runs["job"].iloc[17]
    summary = json.loads(pq.read_metadata(whole.job_file(job)).metadata[b"shear_sim"])
    fit = summary["moduli"]["periodic"]
    of_run = cycles[cycles["job"] == job]
    assert of_run["cycle"].tolist() == [1, 2, 3]
    assert of_run["fitted"].tolist() == [False, True, True]
    assert of_run["storage_modulus"].tolist() == fit["storage_cycles"]
    assert of_run["loss_modulus"].tolist() == fit["loss_cycles"]
    of_run = harmonics[harmonics["job"] == job]
    assert of_run["harmonic"].tolist() == list(range(1, 10))
    assert of_run["storage_modulus"].tolist() == fit["storage_n"]
    assert of_run["loss_modulus"].tolist() == fit["loss_n"]
    third = np.hypot(fit["storage_n"][2], fit["loss_n"][2]) / np.hypot(fit["storage"], fit["loss"])
    assert of_run["relative_intensity"].iloc[2] == pytest.approx(third, rel=1e-14)
    row = runs[runs["job"] == job].iloc[0]
    assert row["third_harmonic_ratio"] == pytest.approx(third, rel=1e-14)
    assert row["dissipated_energy"] == pytest.approx(
        np.pi * row["shear.strain_amplitude"] ** 2 * fit["loss"], rel=1e-14
    )


def test_curves_are_of_the_mean_response_and_not_of_noise(tables):
    """A spring and a dashpot have no third harmonic; that of each noisy run has a size.

    Its square: the mean product of the harmonics of two different runs, over all pairs.
    """
    runs, harmonics, cells = tables["runs"], tables["harmonics"], 0
    for _, row in tables["curves"].iterrows():
        of_point = harmonics[harmonics["point"] == row["point"]].set_index("harmonic")
        third = of_point.loc[3, ["storage_modulus", "loss_modulus"]].to_numpy()
        pairs = [a @ b for i, a in enumerate(third) for j, b in enumerate(third) if i != j]
        first = np.hypot(*of_point.loc[1, ["storage_modulus", "loss_modulus"]].mean())
        expected = np.sqrt(max(np.mean(pairs), 0)) / first
        assert row["third_harmonic_ratio_mean"] == pytest.approx(expected, rel=1e-9)
        assert row["complex_modulus_mean"] == pytest.approx(first, rel=1e-12)
        own = runs.loc[runs["point"] == row["point"], "third_harmonic_ratio"]
        assert row["third_harmonic_ratio_median"] == own.median()
        assert row["third_harmonic_ratio_mean"] < 0.7 * own.mean()
        cells += 1
    assert cells == 8


def test_a_spring_and_a_dashpot_never_yield(tables):
    features = tables["features"]
    assert set(features["scene"]) == {"stiff", "soft"}
    assert len(features) == 2 * 8  # the curves of one amplitude have no landmarks
    for _, row in features[features["landmark"] == "yield"].iterrows():
        assert (row["censored"], row["strain_limit"], row["censored_resamples"]) == (
            "above",
            0.4,
            1,
        )
        assert np.isnan(row["strain"])
        assert (row["strain_ci_low"], row["strain_ci_high"]) == (0.4, np.inf)
    plateau = features[features["landmark"] == "low_strain_plateau"].set_index("scene")
    assert plateau.loc["stiff", "storage_modulus"] == pytest.approx(400, rel=0.05)
    assert plateau.loc["stiff", "strain"] == 0.1
    assert (plateau["replicates"] == 11).all()
    assert "> 0.4" in printed(tables)


def test_contrasts_find_what_was_put_in(tables):
    """Stiff against soft is 8 to 1; G'' of 2, 5 and 8 Pa s is proportional to the viscosity."""
    contrasts = tables["contrasts"]
    scenes = contrasts[(contrasts["parameter"] == "scene") & (contrasts["landmark"] == "")]
    storage = scenes[scenes["quantity"] == "storage_modulus"]
    assert storage["shear.strain_amplitude"].tolist() == [0.1, 0.2, 0.4]
    assert storage["estimate"].to_numpy() == pytest.approx(8, rel=0.1)
    assert (storage["p_holm"] < 1e-6).all()
    assert set(storage["against"]) == {"soft"}
    loss = scenes[scenes["quantity"] == "loss_modulus"]
    assert (loss["ci_low"] < 1.3).all()
    assert (loss["ci_high"] > 0.7).all()
    slopes = contrasts[contrasts["parameter"] == "model.viscosity"].set_index("quantity")
    assert slopes["effect"].tolist() == ["exponent", "exponent"]  # its unit is no number
    assert slopes.loc["loss_modulus", "ci_low"] < 1 < slopes.loc["loss_modulus", "ci_high"]
    # The noise of a replicate is the same at both: in pairs, the spring does not differ at all.
    assert slopes.loc["storage_modulus", ["estimate", "ci_low", "ci_high"]].tolist() == [0, 0, 0]
    assert slopes.loc["storage_modulus", "p"] == 1
    assert slopes.loc["storage_modulus", "values"] == "2; 5; 8"
    assert np.isnan(slopes["model.viscosity"]).all()
    assert (slopes["model.modulus"] == 400).all()
    known = contrasts[contrasts["p"].notna()]
    assert (known["p_holm"] >= known["p"]).all()


def test_p_values_are_corrected_within_their_family_alone(tables):
    contrasts = tables["contrasts"]
    assert contrasts["family"].nunique() > 2
    for _, of_family in contrasts.groupby("family"):
        assert of_family["p_holm"].to_numpy() == pytest.approx(holm(of_family["p"]), nan_ok=True)
    assert (contrasts["p_holm"] > 1.5 * contrasts["p"]).any()
    together = holm(contrasts["p"])
    assert not np.allclose(contrasts["p_holm"], together, atol=0, equal_nan=True)


def test_only_the_corrected_p_value_earns_a_star():
    row = {"estimate": 2.0, "ci_low": 1.5, "ci_high": 3.0, "p": 0.01, "p_holm": 0.2}
    assert _effect(row) == "2 [1.5, 3] "
    assert _effect(row | {"p_holm": 0.049}) == "2 [1.5, 3]*"


def test_intervals_are_of_two_thousand_resamples_or_more(tables):
    assert RESAMPLES >= 2000
    for name in ("curves", "features", "contrasts"):
        assert (tables[name]["ci_resamples"] == RESAMPLES).all()


def test_sizes_that_may_be_zero_are_never_taken_by_their_logarithm():
    names = [quantity.name for quantity in CURVE_QUANTITIES]
    plain = {n for n, may in zip(names, MAY_BE_LOGARITHMIC, strict=True) if not may}
    assert plain == {"third_harmonic_ratio", "even_harmonic_ratio"}


STATED = {  # in the README and by the reference: allowed, and just beyond
    "baseline_noise": (0.0999, 0.1001),
    "surface_internal_ratio": (1.299, 1.301),
    "cycle_change": (0.0999, 0.1001),
    "drift_ratio": (0.0999, 0.1001),
    "jumps": (0, 1),
    "asymmetry": (0.999e-9, 1.001e-9),
}


@pytest.mark.parametrize("name", STATED)
def test_runs_on_either_side_of_a_limit(name):
    assert STATED.keys() == LIMITS.keys()
    labels = {"point": ["1" * 16] * 2, "curve": ["2" * 16] * 2, "block": [""] * 2}
    planned = pd.DataFrame(
        {"job": ["a", "b"], "replicate": [0, 1], "scene": pd.Categorical(["", ""])} | labels
    )
    key = "checks.asymmetry_periodic" if name == "asymmetry" else f"quality.{name}"
    index = pa.table({"job": ["a", "b"], key: STATED[name], "steady.shear_stress": [1.0, 1.0]})
    runs = runs_table(planned, index.to_pandas(), [], Waves(index, "periodic"))
    assert runs["flags"].tolist() == ["", name]
    assert runs["flagged"].tolist() == [False, True]
    assert LIMITS["surface_internal_ratio"][0] == 0.7


def test_n_of_n_stands_in_the_metadata_of_every_table(tmp_path):
    results = make(tmp_path, STUDY.replace("11", "2"), keep=lambda job: job.replicate == 0)
    aggregate(results.folder, figures=False)
    files = list(results.tables.glob("*.parquet"))
    assert {"runs", "cycles", "harmonics"} < {path.stem for path in files}
    for path in files:
        about = load(path).attrs
        assert (about["done"], about["planned"]) == (8, 16), path


def test_what_an_earlier_call_wrote_and_this_one_does_not_goes(tmp_path):
    """Figures of other tables, the table historical, tables of another kind of shear; no others."""
    results = make(tmp_path, STUDY.replace("11", "2"))
    aggregate(results.folder, figures=False, historical=True)
    results.figures.mkdir(exist_ok=True)
    for path in (results.figures / "moduli.png", results.figures / "my_own.png"):
        path.touch()
    for name in ("steady.csv", "steady.parquet", "my_own.csv"):
        (results.tables / name).touch()
    assert (results.tables / "historical.csv").exists()
    tables = aggregate(results.folder, figures=False)
    assert {path.stem for path in results.tables.iterdir()} == {*tables, "my_own"}
    assert [path.name for path in results.figures.iterdir()] == ["my_own.png"]


def test_a_table_of_another_tensor_says_so_in_every_row_and_on_the_screen(whole, tables):
    other = make_tables(whole.folder, tensor="external")
    for name in ("runs", "curves"):
        assert set(other[name]["tensor"]) == {"external"}
    for name in ("cycles", "harmonics", "features", "contrasts"):
        assert set(tables[name]["tensor"]) == {"periodic"}
    assert "are of the external tensor alone" in printed(other)
    assert "tensor" not in printed(tables)


def test_a_table_of_another_tensor_is_asked_for_by_name(whole):
    """This model has the periodic one alone: then there is nothing in the others."""
    tables = make_tables(whole.folder, tensor="internal")
    assert (tables["curves"]["n"] == 0).all()
    assert len(tables["harmonics"]) == len(tables["features"]) == len(tables["contrasts"]) == 0
    assert tables["runs"]["flagged"].all()
    with pytest.raises(ValueError, match="give one of periodic, internal, external"):
        make_tables(whole.folder, tensor="surface")


assert kelvin_voigt.PHYSICS_VERSION == 1  # its import makes the model known


def test_every_point_of_a_random_design_is_named_on_the_screen(tmp_path):
    results = make(
        tmp_path,
        """
model: {kind: kelvin_voigt}
sweep:
  sobol:
    points: 4
    ranges:
      shear.strain_amplitude: {from: 0.01, to: 1, scale: log}
      model.modulus: {from: 50, to: 500}
""",
    )
    file = io.StringIO()
    print_summary(aggregate(results.folder, figures=False), Console(file=file))
    assert len(re.findall(r"^modulus \d", file.getvalue(), re.MULTILINE)) == 4
