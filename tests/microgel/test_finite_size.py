"""The program that measures finite size and finite rate, on tables whose limits are known."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import shear_sim
from shear_sim.packing import radii

PATH = Path(__file__).parents[2] / "analysis" / "finite_size.py"
LIMIT, SLOPE, SCATTER = 2000.0, 3000.0, 0.2  # G′ = LIMIT + SLOPE / N; scatter / √N of packings


@pytest.fixture(scope="module")
def program():
    spec = importlib.util.spec_from_file_location("finite_size", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def runs_of(program, discs, rate, values):
    """Return the runs of all scenes and amplitudes, with the same values (replicates, 2)."""
    return pd.DataFrame(
        {
            program.CUT: cut, program.AMPLITUDE: amplitude, program.N: discs, program.F: rate,
            "replicate": replicate, "moduli.periodic.storage": storage,
            "moduli.periodic.loss": loss,
        }
        for cut in program.SCENES.values()
        for amplitude in program.AMPLITUDES
        for replicate, (storage, loss) in enumerate(values)
    )  # fmt: skip


@pytest.fixture(scope="module")
def tables(program):
    """Packings with a known limit; G″ is that of a dashpot but for a resonance at 1,200 discs."""
    rng = np.random.default_rng(0)
    sizes = []
    for n in program.SIZES:
        packing = 1 + SCATTER / math.sqrt(n) * rng.normal(size=(min(400, 60_000 // n), 2))
        loss = 50 * (1.05 if n == 1200 else 1)
        sizes.append(runs_of(program, n, program.RATE, packing * (LIMIT + SLOPE / n, loss)))
    packing = 1 + 0.05 * rng.normal(size=(40, 2))
    rates = [runs_of(program, 150, f, packing * (LIMIT, 2000 * f)) for f in program.RATES]
    return program.tables_of(pd.concat(sizes), pd.concat(rates))


def test_the_fit_finds_the_limit(program):
    """Exactly without noise, whatever the weights; and what 1/N does not describe is not fitted."""
    sizes = np.array([45.0, 150.0, 600.0, 2400.0])
    errors = np.array([3.0, 1.0, 2.0, 0.5])
    exact = np.stack([LIMIT + SLOPE / sizes, LIMIT + 0 * sizes])
    limit, chi_square = program.extrapolate(exact, errors, sizes)
    assert limit == pytest.approx([LIMIT, LIMIT], rel=1e-12)
    assert chi_square == pytest.approx([0, 0], abs=1e-15)
    # Of three evenly spaced values a line leaves b/3, 2b/3, b/3 of a bend b: 2/3 b²/σ².
    bent = np.array([10.0, 11.5, 10.0])
    _, chi_square = program.extrapolate(bent, np.full(3, 0.5), 1 / np.array([1.0, 2.0, 3.0]))
    assert chi_square == pytest.approx(1.5**2 / 0.5**2 * 2 / 3, rel=1e-12)


def test_known_sizes_are_found(program, tables):
    """Limit, deviation and exponent of the scatter, within intervals as narrow as they must be."""
    limits = tables["finite_size_limits"]
    limit = limits[limits["quantity"] == "storage_modulus"].iloc[0]
    assert limit["limit_ci_low"] < LIMIT < limit["limit_ci_high"]
    assert limit["limit_ci_high"] - limit["limit_ci_low"] < 0.003 * LIMIT
    assert limit["misfit"] > 0.01
    assert limit["scatter_exponent_ci_low"] < -0.5 < limit["scatter_exponent_ci_high"]
    assert abs(limit["scatter_exponent"] + 0.5) < 0.05
    assert (limits.loc[limits["quantity"] == "loss_modulus", "misfit"] < 1e-10).all()

    points = tables["finite_size"].set_index(["scene", program.AMPLITUDE, "quantity", program.N])
    point = points.loc["bulk", 0.5, "storage_modulus", 150]
    known = (LIMIT + SLOPE / 150) / (LIMIT + SLOPE / 2400) - 1
    assert point["deviation_ci_low"] < known < point["deviation_ci_high"]
    assert point["deviation_ci_low"] > 0  # 0.9 %: seen
    assert point["scatter"] == pytest.approx(SCATTER / math.sqrt(150), rel=0.15)
    # The width is that of two independent means, to the noise of a bootstrap and of 25 packings.
    error = SCATTER * math.hypot(1 / math.sqrt(150 * 400), 1 / math.sqrt(2400 * 25))
    width = point["deviation_ci_high"] - point["deviation_ci_low"]
    assert width == pytest.approx(2 * 1.96 * error, rel=0.3)
    largest = points.xs(2400, level=program.N)
    assert (largest["deviation"] == 0).all()


def test_packings_are_compared_in_pairs_between_frequencies(program, tables):
    """Packings that differ by a factor give the same ratios: intervals without a width."""
    rates = tables["finite_rate"]
    loss = rates[rates["quantity"] == "loss_modulus"]
    known = loss[program.F] / program.RATES[0] - 1
    for name in ("deviation", "deviation_ci_low", "deviation_ci_high"):
        np.testing.assert_allclose(loss[name], known, rtol=1e-9, atol=1e-9)
    later = loss[loss[program.F] > program.RATES[0]]
    for name in ("exponent", "exponent_ci_low", "exponent_ci_high"):
        np.testing.assert_allclose(later[name], 1, rtol=1e-9)


def test_results_are_printed_written_and_drawn(program, tables, tmp_path):
    text = program.describe(tables)
    assert text.count("| crosslinked | 0.5 | G″ |") == 2
    program.draw(tables, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 50_000
    for name, table in tables.items():
        program.save(table, tmp_path / name)
    assert "mean_Pa" in (tmp_path / "finite_rate.csv").read_text().splitlines()[0]


def test_packings_differ_in_number_only(program):
    """Discs and particles have the same size in all studies; the published one is among them."""
    studies = program.studies()
    found = set()
    for study in studies:
        for point in (entry.point for entry in study.points):
            area = point.cell.width**2
            # An odd number has a large disc more: 1.5 % at 45.
            found.add(round(radii(point.packing, area)[0] * 1e6, 0))
            if point.model.links.cut == "cells":
                assert point.packing.discs / point.model.links.cuts == 30
    assert found == {
        round(radii(program.PUBLISHED.packing, program.PUBLISHED.cell.width**2)[0] * 1e6)
    }
    counts = [study.replicates for study in studies[:-1]]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] >= 20


def test_a_study_of_the_program_runs(program, tmp_path):
    """Its runs have what the reduction takes; waves cross √(N₁/N) of its cells in one period."""
    study = program.study("small", 45, [0.1], 2)
    runs = shear_sim.run_study(study, tmp_path, jobs=1)
    assert len(runs) == 8
    for name in program.QUANTITIES:
        x, samples = program.samples_of(runs, program.N, name)
        assert x == [45]
        assert np.isfinite(samples[0]).all()
    run = runs.iloc[0]
    storage = 1234.5
    speed = math.sqrt(storage / (1000 * 1.5))
    cells = speed * run["protocol.period"] / run["derived.width"]
    assert cells == pytest.approx(math.sqrt(program.resonance(storage) / 0.1**2 / 45), rel=1e-12)
