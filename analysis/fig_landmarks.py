"""Draw landmarks against a parameter of one's choice, and change the figure before it is saved.

.venv/bin/python analysis/fig_landmarks.py results/main model.friction landmarks
"""

import argparse
from pathlib import Path

from shear_sim.aggregate import load
from shear_sim.figures import landmarks, style


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of an aggregated study")
    parser.add_argument("parameter", help="key of the study file that the study varies")
    parser.add_argument("stem", type=Path, help="path of the figure, without its ending")
    given = parser.parse_args()
    features = load(given.results / "tables/features.parquet")
    figure = landmarks(features, [given.parameter])
    figure.axes[0].axhspan(0.5, 1.0, color="0.92", zorder=0)  # a range from an experiment, say
    print(*style.save(figure, given.stem))


if __name__ == "__main__":
    main()
