"""Draw one's own choice of quantities and scenes against the strain amplitude.

.venv/bin/python analysis/fig_scenes.py results/main crosslinked,uncrosslinked tan_delta scenes
"""

import sys
from pathlib import Path

from shear_sim.aggregate import load
from shear_sim.figures import curves, style


def main(results: str, scenes: str, quantities: str, stem: str) -> None:
    table = load(Path(results) / "tables/curves.parquet")
    chosen = table[table["scene"].isin(scenes.split(","))]
    print(*style.save(curves(chosen, quantities.split(",")), Path(stem)))


if __name__ == "__main__":
    main(*sys.argv[1:])
