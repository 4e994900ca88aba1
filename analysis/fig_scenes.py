"""Draw one's own choice of quantities and scenes against the strain amplitude.

.venv/bin/python analysis/fig_scenes.py results/main crosslinked,uncrosslinked tan_delta scenes
"""

import argparse
from pathlib import Path

from shear_sim.aggregate import load
from shear_sim.figures import curves, style


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of an aggregated study")
    parser.add_argument("scenes", help="scenes, with commas between them")
    parser.add_argument("quantities", help="columns of table curves, with commas between them")
    parser.add_argument("stem", type=Path, help="path of the figure, without its ending")
    given = parser.parse_args()
    table = load(given.results / "tables/curves.parquet")
    chosen = table[table["scene"].isin(given.scenes.split(","))]
    print(*style.save(curves(chosen, given.quantities.split(",")), given.stem))


if __name__ == "__main__":
    main()
