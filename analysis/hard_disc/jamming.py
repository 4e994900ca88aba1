"""Check the certificate of every jammed run of a study, and count how its runs end.

.venv/bin/shear-sim sweep configs/hard_disc/jamming.yaml
.venv/bin/python analysis/hard_disc/jamming.py results/jamming

Exits with 1 if a run neither flows to its end nor has a certificate that holds in every point.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from shear_sim.results import Results, read_job


def holds(certificate: dict[str, Any], checks: dict[str, float]) -> bool:
    """Tell whether a certificate proves an isostatic packing without overlap."""
    return (
        certificate["contacts"] == 2 * certificate["discs"] - 1
        and certificate["least_force"] > 0
        and certificate["unbalanced_force"] < 1e-12
        and certificate["second_singular_value"] > 1e-3
        and certificate["load"] < 0
        and checks["largest_overlap"] < 1e-12
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    given = parser.parse_args()
    kept = Results.existing(given.results)
    plan, _ = kept.plan()
    points: dict[str, list[dict[str, Any]]] = {}
    names = ("shear.kind", "packing.discs", "packing.packing_fraction")
    for row in plan.to_pylist():
        key = ", ".join(f"{name.split('.')[-1]} {row[name]}" for name in names if name in row)
        points.setdefault(key, []).append(read_job(kept.job_file(row["job"])).summary)
    wrong = 0
    for key, summaries in points.items():
        ends = Counter(s["status"] for s in summaries)
        jammed = [s for s in summaries if s["status"] == "jammed"]
        proved = [holds(s["certificate"], s["checks"]) for s in jammed]
        wrong += len(proved) - sum(proved) + len(summaries) - ends["jammed"] - ends["flowing"]
        print(f"{key}: {dict(ends)}, {sum(proved)} certificates hold in every point")
        if not jammed:
            continue
        for name, least in (
            ("least_force", True),
            ("second_singular_value", True),
            ("unbalanced_force", False),
        ):
            values = [s["certificate"][name] for s in jammed]
            print(
                f"  {name}: {'least' if least else 'largest'} {(min if least else max)(values):.2g}"
            )
        phi = np.array([s["derived"]["packing_fraction"] for s in jammed])
        path = [s["certificate"]["path"] for s in jammed]
        rattlers = [len(s["certificate"]["rattlers"]) for s in jammed]
        starts = [s["preparation"]["attempts"] for s in jammed]
        print(f"  φ {phi.min():.4f} to {phi.max():.4f}, mean {phi.mean():.4f}")
        print(f"  path up to {max(path):.3f}; rattlers {min(rattlers)} to {max(rattlers)}")
        print(f"  start attempts up to {max(starts)}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
