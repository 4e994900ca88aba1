"""Means of resampled replicates, landmarks and contrasts of curves made by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from shear_sim.aggregate.contrasts import Comparison, compare, find_comparisons
from shear_sim.aggregate.ensemble import Ensemble, Replicates
from shear_sim.aggregate.features import Curve, features_table, landmark_intervals
from shear_sim.models.interface import Column
from shear_sim.statistics import RESAMPLES

AMPLITUDES = np.array([0.01, 0.03, 0.1, 0.3, 1.0])


def rng(seed=1):
    return np.random.default_rng(seed)


def curve(scale, yields, seed=None, noise=0.0):
    """Return a curve of replicates with plateaus ``scale`` and yield strains ``yields``."""
    points = []
    for place, amplitude in enumerate(AMPLITUDES):
        x = (amplitude / yields) ** 2
        storage, loss = scale / (1 + x), scale * (0.02 + np.sqrt(x) / (1 + x))
        if noise:
            storage = storage * rng([seed, place]).lognormal(0, noise, len(scale))
        third = 0.1 * x * loss
        values = np.column_stack([storage, loss, third, 0 * loss, third**2])
        points.append(Replicates(np.arange(len(scale)), values))
    return Curve(AMPLITUDES, points, len(scale))


def test_means_of_paired_replicates_leave_out_those_that_are_missing():
    values = rng().normal(size=(4, 2))
    points = [Replicates(np.arange(4), values), Replicates(np.array([1, 3]), values[[1, 3]])]
    ensemble = Ensemble(points, paired=True)
    assert (ensemble.sizes, ensemble.n) == ([4], 2)
    drawn = np.array([[1, 1, 1, 1], [0, 3, 0, 1], [4, 0, 0, 0]], dtype=float)
    means, runs = ensemble.means([drawn])
    assert runs.tolist() == [[4, 4, 4], [2, 4, 0]]
    assert means[0, :, 0] == pytest.approx(values.mean(axis=0))
    assert means[1, :, 0] == pytest.approx(values[[1, 3]].mean(axis=0))
    assert means[1, :, 1] == pytest.approx((3 * values[1] + values[3]) / 4)
    assert np.isnan(means[1, :, 2]).all()  # none of its replicates was drawn


def test_means_of_independent_replicates_are_of_each_point_by_itself():
    one, two = rng(1).normal(size=(3, 2)), rng(2).normal(size=(5, 2))
    points = [Replicates(np.arange(3), one), Replicates(np.arange(5), two)]
    ensemble = Ensemble(points, paired=False)
    assert (ensemble.sizes, ensemble.n) == ([3, 5], 3)
    means, runs = ensemble.means([np.array([[2.0, 0, 1]]), np.array([[1.0, 1, 1, 1, 1]])])
    assert runs.tolist() == [[3], [5]]
    assert means[0, :, 0] == pytest.approx((2 * one[0] + one[2]) / 3)
    assert means[1, :, 0] == pytest.approx(two.mean(axis=0))


def test_landmarks_of_the_mean_curve_have_the_interval_of_a_bootstrap_of_whole_curves():
    """The plateau: the mean of the replicates at the first amplitude, by scipy."""
    scale = rng(3).lognormal(5, 0.3, 12)
    found = curve(scale, np.full(12, 0.2))
    ensemble = Ensemble(found.points, paired=True)
    plateau = landmark_intervals(found, ensemble, seed=4)["low_strain_plateau"]["storage_modulus"]
    values = found.points[0].values[:, 0]
    expected = stats.bootstrap((values,), np.mean, n_resamples=RESAMPLES, rng=rng(4))
    interval = expected.confidence_interval
    assert (plateau.low, plateau.high) == pytest.approx((interval.low, interval.high), rel=1e-10)


def test_what_all_replicates_share_does_not_blur_a_landmark():
    """Plateaus that differ tenfold, and one and the same strain at which they soften."""
    found = curve(rng(3).lognormal(5, 1.0, 12), np.full(12, 0.2))
    widths = [
        strain.high / strain.low
        for paired in (True, False)
        for of in [landmark_intervals(found, Ensemble(found.points, paired=paired), seed=4)]
        for strain in [of["softening"]["strain"]]
    ]
    assert widths[0] == pytest.approx(1, abs=1e-6)
    assert widths[1] > 1.5


def test_a_yield_near_the_end_is_censored_in_some_resamples():
    """Of 12 packings, some yield at 0.3 and some not by 1: the mean curve just does."""
    found = curve(np.ones(12), np.array([0.3] * 9 + [3.0] * 3))
    strain = landmark_intervals(found, Ensemble(found.points, paired=True), seed=4)["yield"][
        "strain"
    ]
    assert np.isfinite(strain.estimate)
    assert 0 < strain.undefined < 0.5
    assert strain.method == "percentile"
    assert strain.high == np.inf
    assert 0.2 < strain.low < strain.estimate


def test_a_curve_without_a_plateau_and_one_that_begins_late_are_flagged():
    """G' loses a tenth before the second amplitude; and at 0.1, of a study from 0.01 on."""
    early, good = curve(np.ones(12), np.full(12, 0.02)), curve(np.ones(12), np.full(12, 0.5))
    late = Curve(AMPLITUDES[2:], good.points[2:], 12)
    names = ["0", "1", "2"]
    rows = plan(*[("s", mu, 8e3, "a", None, "c") for mu in (0.1, 0.2, 0.3)])
    curves = dict(zip(names, (early, good, late), strict=True))
    table = features_table(rows, PARAMETERS, curves, paired=True, seed=1)
    for name in ("low_strain_plateau", "softening", "half_loss"):
        flags = table[table["landmark"] == name].set_index("curve")["storage_modulus_ci_flag"]
        assert "no plateau: G' softens before the 2nd amplitude" in flags["0"]
        assert "plateau" not in flags["1"]
        assert "plateau read at 0.1, others from 0.01 on" in flags["2"]
    others = table[~table["landmark"].isin(["low_strain_plateau", "softening", "half_loss"])]
    assert not others["strain_ci_flag"].str.contains("plateau").any()


def test_few_replicates_do_not_bound_strains_beyond_the_amplitudes():
    """Two packings that yield at 0.05 and 0.9: Student's t would run from 1e-7 to 1e6."""
    curves = {"0": curve(np.ones(2), np.array([0.05, 0.9]))}
    rows = plan(("s", 0.1, 8e3, "a", None, "c"))
    table = features_table(rows, PARAMETERS, curves, paired=True, seed=1).set_index("landmark")
    found = table.loc["yield"]
    assert (found["strain_ci_low"], found["strain_ci_high"]) == (0.01, 1.0)
    assert "cut at the smallest or largest amplitude" in found["strain_ci_flag"]
    assert "fewer than 4 replicates" in found["strain_ci_flag"]


RATIO = Comparison("scene", "a", ("1", "2"), {}, "b", "a; b", "ratio", np.array([1.0, -1.0]))


def row(rows, quantity, landmark="", amplitude=None):
    found = [
        r
        for r in rows
        if (r["quantity"], r["landmark"]) == (quantity, landmark)
        and amplitude in {None, r["shear.strain_amplitude"]}
    ]
    assert len(found) == 1
    return found[0]


@pytest.mark.parametrize("n", [6, 12])
def test_paired_curves_are_compared_as_sharply_as_they_differ(n):
    """The same packings, 1.5 times as stiff, yielding at twice the strain: no doubt at all."""
    scale, yields = rng(3).lognormal(5, 0.5, n), rng(4).lognormal(-2, 0.3, n)
    curves = [curve(1.5 * scale, 2 * yields), curve(scale, yields)]
    rows = compare(RATIO, curves, paired=True, seed=1)
    plateau = row(rows, "storage_modulus", "low_strain_plateau")
    assert plateau["estimate"] == pytest.approx(1.5, rel=2e-2)
    assert plateau["ci_high"] / plateau["ci_low"] < 1.02
    strain = row(rows, "strain", "yield")
    assert strain["ci_low"] < 2.0 < strain["ci_high"] < 2.6
    independent = compare(RATIO, curves, paired=False, seed=1)
    wide = row(independent, "storage_modulus", "low_strain_plateau")
    assert wide["ci_high"] / wide["ci_low"] > 1.3
    assert plateau["p"] < 1e-6 < wide["p"]
    assert plateau["ci_method"] == ("BCa" if n == 12 else "t_log")


def test_equal_curves_do_not_differ():
    scale = rng(3).lognormal(5, 0.5, 12)
    rows = compare(RATIO, [curve(scale, np.full(12, 0.2))] * 2, paired=True, seed=1)
    assert {r["estimate"] for r in rows} == {1.0}
    assert {r["p"] for r in rows} == {1.0}
    assert {r["ci_method"] for r in rows} == {"equal"}


def test_slopes_are_those_of_a_line_through_the_logarithms():
    x = np.array([1.0, 10.0, 100.0])
    aside = np.log(x) - np.log(x).mean()
    slope = Comparison(
        "k", "", ("1", "2", "3"), {}, "", "1; 10; 100", "exponent", aside / (aside**2).sum()
    )
    scale = rng(3).lognormal(5, 0.2, 12)
    curves = [
        curve(scale * v**0.7, np.full(12, 0.2) * v**-0.1, place, 0.05) for place, v in enumerate(x)
    ]
    rows = compare(slope, curves, paired=True, seed=1)
    found = row(rows, "storage_modulus", amplitude=0.01)
    means = [c.points[0].values[:, 0].mean() for c in curves]
    assert found["estimate"] == pytest.approx(np.polyfit(np.log(x), np.log(means), 1)[0], rel=1e-9)
    assert found["ci_low"] < 0.7 < found["ci_high"]
    strain = row(rows, "strain", "yield")
    assert strain["ci_low"] - 0.02 < -0.1 < strain["ci_high"] + 0.02


def test_what_is_beyond_the_amplitudes_is_not_compared_and_says_where():
    rows = compare(
        RATIO,
        [curve(np.ones(12), np.full(12, 9.0)), curve(np.ones(12), np.full(12, 0.1))],
        paired=True,
        seed=1,
    )
    found = row(rows, "strain", "yield")
    assert np.isnan(found["estimate"])
    assert np.isnan(found["p"])
    assert found["ci_flag"] == "beyond the amplitudes, absent or not positive at a"
    assert not [r for r in rows if r["landmark"] == "soft_plateau"]  # none of the two has one


def test_curves_are_compared_where_both_were_measured():
    """Landmarks are found anew on the common amplitudes."""
    scale = np.ones(12)
    whole, part = curve(scale, 0.2 * scale), curve(2 * scale, 0.2 * scale)
    part = Curve(AMPLITUDES[::2], part.points[::2], 12)
    rows = compare(RATIO, [whole, part], paired=True, seed=1)
    assert {r["shear.strain_amplitude"] for r in rows if not r["landmark"]} == {0.01, 0.1, 1.0}
    assert row(rows, "strain", "yield")["estimate"] == 1.0
    few = compare(RATIO, [whole, Curve(AMPLITUDES[3:], whole.points[3:], 12)], paired=True, seed=1)
    assert {r["landmark"] for r in few} == {""}


PARAMETERS = (
    Column("shear.strain_amplitude", "1", ""),
    Column("model.friction", "1", ""),
    Column("model.young_modulus", "Pa", ""),
    Column("model.law.kind", "", ""),
    Column("model.law.slope", "1", ""),
    Column("model.cut", "", ""),
)


def plan(*rows):
    """Return a plan of curves (scene, friction, E, law, slope, cut) of one amplitude each."""
    names = ["scene", *[p.name for p in PARAMETERS[1:]]]
    table = pd.DataFrame(rows, columns=names)
    table[["model.friction", "model.young_modulus", "model.law.slope"]] = table[
        ["model.friction", "model.young_modulus", "model.law.slope"]
    ].astype(float)
    order = list(dict.fromkeys(table["scene"]))
    table["scene"] = pd.Categorical(table["scene"], categories=order, ordered=True)
    ids = [str(place) for place in range(len(rows))]
    return table.assign(**{"shear.strain_amplitude": 0.1, "point": ids, "curve": ids})


def found(planned):
    return [
        (c.parameter, c.scene, c.curves, c.values, c.effect)
        for c in find_comparisons(planned, PARAMETERS)
    ]


def test_scenes_are_compared_with_the_first_where_all_else_is_equal():
    planned = plan(
        ("gel", 0.0, 8e3, "a", None, "cells"),
        ("gel", 0.1, 8e3, "a", None, "cells"),
        ("gel", 0.1, 2e3, "a", None, "cells"),
        ("loose", 0.0, 8e3, "a", None, "none"),
        ("loose", 0.1, 8e3, "a", None, "none"),
        ("bulk", 0.1, 8e3, "a", None, "bulk"),
    )
    scenes = [c[1:4] for c in found(planned) if c[0] == "scene"]
    assert scenes == [
        ("gel", ("0", "3"), "gel; loose"),
        ("gel", ("1", "4"), "gel; loose"),
        ("gel", ("1", "5"), "gel; bulk"),
    ]


def test_a_scene_that_varies_its_own_cut_is_compared_by_its_usual_one():
    planned = plan(
        ("gel", 0.1, 8e3, "a", None, "cells"),
        ("gel", 0.2, 8e3, "a", None, "cells"),
        ("gel", 0.1, 8e3, "a", None, "lines"),
        ("loose", 0.1, 8e3, "a", None, "none"),
    )
    assert [c[2] for c in found(planned) if c[0] == "scene"] == [("0", "3")]
    assert [c[2:] for c in found(planned) if c[0] == "model.cut"] == [
        (("2", "0"), "lines; cells", "ratio")
    ]


def test_numbers_give_exponents_over_a_wide_range_or_with_a_unit_and_else_slopes():
    wide = plan(*[("s", mu, 8e3, "a", None, "c") for mu in (0.0, 0.01, 0.1, 1.0)])
    assert found(wide) == [("model.friction", "s", ("1", "2", "3"), "0.01; 0.1; 1", "exponent")]
    narrow = plan(*[("s", mu, 8e3, "a", None, "c") for mu in (0.0, 0.1, 0.3)])
    assert found(narrow) == [("model.friction", "s", ("0", "1", "2"), "0; 0.1; 0.3", "slope")]
    unit = plan(*[("s", 0.1, e, "a", None, "c") for e in (8e3, 4e3)])
    assert found(unit) == [("model.young_modulus", "s", ("1", "0"), "4000; 8000", "exponent")]
    weights = next(find_comparisons(unit, PARAMETERS)).weights
    assert weights @ np.log([4e3, 8e3]) == pytest.approx(1)
    assert weights.sum() == pytest.approx(0)


def test_words_are_compared_with_the_usual_one_whatever_only_one_of_them_has():
    planned = plan(
        ("s", 0.1, 8e3, "divergent", None, "c"),
        ("s", 0.2, 8e3, "divergent", None, "c"),
        ("s", 0.1, 8e3, "plateau", 0.1, "c"),
        ("s", 0.1, 8e3, "plateau", 0.3, "c"),
    )
    laws = [c[2:] for c in found(planned) if c[0] == "model.law.kind"]
    assert laws == [
        (("2", "0"), "plateau; divergent", "ratio"),
        (("3", "0"), "plateau; divergent", "ratio"),
    ]
    slopes = [c[2:] for c in found(planned) if c[0] == "model.law.slope"]
    assert slopes == [(("2", "3"), "0.1; 0.3", "slope")]


def test_nothing_is_compared_in_a_random_design():
    values = rng(5).uniform(size=(8, 2))
    assert found(plan(*[("s", mu, e, "a", None, "c") for mu, e in values])) == []
