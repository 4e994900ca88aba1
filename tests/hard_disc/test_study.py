"""A small study of hard discs as a user runs it, and the programs that draw such studies."""

import runpy
import sys
from pathlib import Path

import pytest

import shear_sim
from shear_sim.aggregate import make_tables
from shear_sim.summary import in_short, notes

ANALYSIS = Path(__file__).parents[2] / "analysis" / "hard_disc"
STUDY = """
packing: {discs: 24, packing_fraction: 0.78}
model: {kind: hard_disc}
record: {rows: 60}
scenes:
  fixed_area:     {shear: {kind: steady, strain: 0.1}}
  fixed_pressure: {shear: {kind: steady, strain: 0.1}}
sweep:
  - {name: area, scenes: [fixed_area], grid: {packing.packing_fraction: [0.76, 0.78]}}
  - {name: pressure, scenes: [fixed_pressure], grid: {shear.scaled_pressure: [3, 10]}}
replicates: 1
seed: 1
"""
OTHERS = """
packing: {discs: 24, packing_fraction: 0.78}
model: {kind: hard_disc}
record: {rows: 40}
scenes:
  compression: {shear: {kind: compression, compression: 0.1}}
  stages:      {shear: {kind: stages, stages: [{shear: 1, length: 0.05}, {length: 0.05}]}}
  oscillatory: {shear: {kind: oscillatory, strain_amplitude: 0.05, periods: 2}}
  plane:
    shear: {kind: body_force, inclination: 25, duration: 2}
    packing: {packing_fraction: 0.4, aspect_ratio: 1.5, walls: {kind: floor}}
sweep: [{name: all, scenes: [compression, stages, oscillatory, plane]}]
replicates: 2
seed: 1
"""


def run(folder, text):
    (folder / "study.yaml").write_text(text)
    shear_sim.run_study(folder / "study.yaml", folder, jobs=1)
    return folder / "study"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return run(tmp_path_factory.mktemp("study"), STUDY)


def start(monkeypatch, program, *arguments):
    monkeypatch.setattr(sys, "argv", [program, *map(str, arguments)])
    monkeypatch.syspath_prepend(str(ANALYSIS))
    return runpy.run_path(str(ANALYSIS / program))["main"]()


def test_the_signals_of_a_study(study, tmp_path, monkeypatch, capsys):
    start(monkeypatch, "stress_signals.py", study, "--folder", tmp_path)
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert {f"hard_disc_signal_fixed_{what}.png" for what in ("area", "pressure")} <= drawn
    assert "fixed_area: flowing" in capsys.readouterr().out


def test_the_table_of_flow_laws(study, tmp_path, monkeypatch):
    table = tmp_path / "rheology.md"
    start(monkeypatch, "rheology.py", study, "--folder", tmp_path, "--table", table)
    rows = table.read_text().splitlines()
    assert sum(row.startswith("| 24 |") for row in rows) == 4
    assert any("| p = 10 | 1 of 1 |" in row for row in rows)
    assert (tmp_path / "hard_disc_rheology.png").is_file()


def test_clusters_of_self_propelled_discs(tmp_path, monkeypatch, capsys):
    start(monkeypatch, "clusters.py", "--discs", 20, "--duration", 2, "--folder", tmp_path)
    assert capsys.readouterr().out.count("of discs alone") == 3
    assert (tmp_path / "hard_disc_clusters.png").is_file()


def test_every_kind_of_drive_is_in_the_summary(tmp_path, monkeypatch, capsys):
    """Runs under a weight and in stages count, and have a line, as all others."""
    results = run(tmp_path, OTHERS)
    tables = make_tables(results)
    assert notes(tables)[0] == "8 of 8 runs"
    headings = {heading for _, names, _ in in_short(tables) for heading in names}
    assert {"u_x [1]", "φ [1]", "G″ [Pa]"} <= headings
    assert len(in_short(tables)) == 4
    capsys.readouterr()
    assert start(monkeypatch, "jamming.py", results) == 0
    found = "kind compression, packing_fraction 0.78: {'jammed': 2}, 2 certificates hold"
    assert found in capsys.readouterr().out
