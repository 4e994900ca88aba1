"""Draw landmarks against a parameter of one's choice, and change the figure before it is saved.

.venv/bin/python analysis/fig_landmarks.py results/main model.friction landmarks
"""

import sys
from pathlib import Path

from shear_sim.aggregate import load
from shear_sim.figures import landmarks, style


def main(results: str, parameter: str, stem: str) -> None:
    features = load(Path(results) / "tables/features.parquet")
    figure = landmarks(features, [parameter])
    figure.axes[0].axhspan(0.5, 1.0, color="0.92", zorder=0)  # a range from an experiment, say
    print(*style.save(figure, Path(stem)))


if __name__ == "__main__":
    main(*sys.argv[1:])
