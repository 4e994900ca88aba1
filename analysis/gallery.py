"""Draw a picture of each scene of the seven studies in configs/ that differ by their scenes.

.venv/bin/python analysis/gallery.py

runs one job of each scene with snapshots (results/gallery) and draws it into analysis/figures.
Boxes and tissues of soft particles are smaller than in their studies, which take minutes of each.
Every job can be drawn larger, with its curves, or as a film, by `shear-sim render`.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from shear_sim.figures import style
from shear_sim.figures.scene import Scene, view
from shear_sim.render import Kept, read_kept
from shear_sim.results import Results
from shear_sim.runner import run_job
from shear_sim.study import Job, StudyPoint, load_study
from shear_sim.workers import compile_for

CONFIGS = Path(__file__).parents[1] / "configs"
#: What the names of pictures begin with, by study.
STUDIES = {
    "main": "microgel",
    "hard_disc": "hard_disc",
    "hard_disc/snapshots": "hard_disc",
    "soft_particle_ring": "soft_particle",
    "soft_particle_compaction": "soft_particle_box",
    "soft_suspension": "soft_suspension",
    "soft_tissue": "soft_tissue",
}
SIDE = 1.75  # inches
MOST = 120  # soft particles, of 400 or 500
#: Snapshots in a unit of the protocol, where a study says nothing.
OFTEN = {
    "oscillatory": 20,
    "steady": 100,
    "compression": 1000,
    "diametral_compression": 40,
    "compaction": 100,
}
SHEARED = {"shear.strain_amplitude": 0.2, "model.core_ratio": 1.0}  # suspensions
#: What else is known of some scenes: colours, lines, and the point of the study that is taken.
LOOKS: dict[str, dict[str, Any]] = {
    "microgel_crosslinked": {"point": {"shear.strain_amplitude": 0.5, "model.friction": 0.01}},
    "microgel_bulk": {
        "point": {"shear.strain_amplitude": 0.5, "model.friction": 0.01}, "colour": "pressure",
        "contacts": "force",
    },
    "microgel_uncrosslinked": {
        "point": {"shear.strain_amplitude": 0.5, "model.friction": 0.1},
    },
    "hard_disc_fixed_area": {"point": {"packing.packing_fraction": 0.8}},
    "hard_disc_fixed_pressure": {"point": {"shear.scaled_pressure": 30.0}},
    "soft_particle_box_hollow": {"contacts": "none"},
    "soft_particle_box_plastic": {"contacts": "none"},
    "soft_particle_box_soft_core": {"colour": "pressure"},
    "soft_particle_box_hard_core": {"colour": "pressure"},
    "soft_suspension_elastic": {"point": SHEARED},
    "soft_suspension_plastic": {"point": SHEARED, "colour": "pressure"},
    "soft_suspension_elastic_plates": {"point": SHEARED},
    "soft_suspension_plastic_plates": {"point": SHEARED, "colour": "pressure"},
    "soft_tissue_elastic": {"colour": "energy"},
    "soft_tissue_plastic": {"colour": "energy"},
    "hard_disc_self_propelled": {"colour": "speed", "contacts": "none"},
    "hard_disc_inclined_plane": {"colour": "speed", "contacts": "force"},
    "hard_disc_hopper": {"colour": "speed", "contacts": "force"},
}  # fmt: skip


def value(point: StudyPoint, key: str) -> Any:
    """Return a parameter by its dotted key."""
    found: Any = point.point
    for name in key.split("."):
        found = getattr(found, name)
    return found


def job_of(points: list[StudyPoint], wanted: dict[str, Any], seed: int) -> Job:
    """Return the job of the point that is wanted, or of the first one, with snapshots."""
    fitting = [p for p in points if all(value(p, key) == v for key, v in wanted.items())]
    point: Any = fitting[0].point
    often = point.record.snapshots or OFTEN[point.shear.kind]
    changed = {"record": point.record.model_copy(update={"snapshots": often})}
    if point.shear.kind in {"compaction", "tension"}:
        fewer = {"particles": min(MOST, point.packing.particles)}
        changed["packing"] = point.packing.model_copy(update=fewer)
    return Job.create(point.model_copy(update=changed), seed, 0)


def shown(kept: Kept) -> int:
    """Return which snapshot is drawn: of largest load where it comes and goes, else the last.

    Of a tissue the one in which half of what breaks is broken.
    """
    columns = kept.table.columns
    kind = kept.table.summary["protocol"]["kind"]
    rows = [snapshot.row for snapshot in kept.snapshots]
    if kind in {"oscillatory", "compaction"}:
        return int(np.abs(columns["strain"][rows]).argmax())
    if kind == "diametral_compression":
        return int(columns["compression"][rows].argmax())
    if kind == "tension":
        broken = columns["links_broken"][rows]
        return int(np.searchsorted(broken, 0.5 * broken[-1]))
    return len(rows) - 1


def draw(kept: Kept, path: Path, colour: str, contacts: str | None) -> None:
    """Draw particles alone, small."""
    number = shown(kept)
    snapshots = kept.snapshots[number : number + 1]
    *_, width, height = view(snapshots)
    with style.figure(SIDE, SIDE * height / width) as figure:
        figure.set_layout_engine("none")
        axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        scene = Scene(axis, snapshots, kept.gradient[number : number + 1], colour, contacts)
        scene.show(0)
        style.save_as(figure, path)
    with Image.open(path) as drawn:
        picture = drawn.convert("RGB")
    small = picture.quantize(palette=style.palette([picture], 128), dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB, of {kept.path}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=Path("results"), help="of the runs")
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of pictures")
    given = parser.parse_args()
    jobs = {}
    for file, prefix in STUDIES.items():
        study = load_study(CONFIGS / f"{file}.yaml")
        for scene in dict.fromkeys(label for p in study.points for _, label in p.labels):
            points = [p for p in study.points if scene in {label for _, label in p.labels}]
            name = f"{prefix}_{scene}"
            jobs[name] = job_of(points, LOOKS.get(name, {}).get("point", {}), study.seed)
    compile_for(list(jobs.values()), lambda: print("compiling the kernels"))
    results = Results(given.results / "gallery")
    results.jobs.mkdir(parents=True, exist_ok=True)
    for name, job in jobs.items():
        look = LOOKS.get(name, {})
        kept = read_kept(run_job(job, results.jobs))
        path = given.folder / f"{name}.png"
        draw(kept, path, look.get("colour", "particle"), look.get("contacts"))


if __name__ == "__main__":
    main()
