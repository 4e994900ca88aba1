"""Print what each choice of the historical program changes in G' and G'', from a finished study.

.venv/bin/shear-sim sweep configs/particleshear.yaml && .venv/bin/shear-sim aggregate results/particleshear
.venv/bin/python analysis/particleshear.py results/particleshear

The figures are ratios of means, historical choice over the default, of the same packings, with 95 %
intervals of Student's t from the scatter of the packings' ratios (linearised). The last row is the
internal tensor, which the historical files hold, over that of all contacts, under plates.
"""  # noqa: E501 - one command a line

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

CHOICES = {
    "plates": "plates in place of the sheared periodic cell",
    "reset": "a slipping spring is emptied",
    "arms": "arms of particleShear",
    "otsuki": "arms of Otsuki and Hayakawa",
    "spin": "spins damped towards zero",
    "density": "density 50 kg/m³",
}
MODULI = ("storage_modulus", "loss_modulus")
VARIED = ["scene", "model.links.cut", "shear.strain_amplitude"]


def ratio(new: pd.Series, old: pd.Series) -> str:
    """Return mean(new) / mean(old) and its interval, as text; both have one row a packing."""
    assert new.index.equals(old.index)
    value = new.mean() / old.mean()
    scatter = value * (new / new.mean() - old / old.mean()).std(ddof=1)
    half = stats.t.ppf(0.975, len(new) - 1) * scatter / np.sqrt(len(new))
    return f"{value:.3f} ± {half:.3f}" if half >= 5e-4 else f"{value:.3f}"


def row(name: str, ratios: list[str]) -> str:
    return f"| {name} | {' | '.join(ratios)} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path)
    runs = pd.read_parquet(parser.parse_args().results / "tables/runs.parquet")
    runs = runs.set_index([*VARIED, "replicate"]).sort_index()
    amplitudes = sorted(runs.index.unique("shear.strain_amplitude"))
    for cut, what in (("cells", "particles"), ("none", "loose discs")):
        head = [f"{name} at {a:g}" for a in amplitudes for name in ("G′", "G″")]
        print("\n" + row(what, head) + "\n" + "| --- " * (len(head) + 1) + "|")
        for scene, name in CHOICES.items():
            pairs = [(runs.loc[scene, cut, a], runs.loc["here", cut, a]) for a in amplitudes]
            print(row(name, [ratio(new[m], old[m]) for new, old in pairs for m in MODULI]))
        plates = [runs.loc["plates", cut, a] for a in amplitudes]
        internal = [ratio(p[f"{m}_internal"], p[m]) for p in plates for m in MODULI]
        print(row("internal tensor / that of all contacts", internal))


if __name__ == "__main__":
    main()
