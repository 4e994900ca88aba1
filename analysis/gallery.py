"""Draw a picture of each scene of the studies in configs/ that differ by their scenes.

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
from shear_sim.render import Kept, read_kept, show_weight, unit
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
    "hard_disc/crystals": "hard_disc_crystal",
    "soft_particle_ring": "soft_particle",
    "soft_free_ring": "soft_free_ring",
    "soft_particle_compaction": "soft_particle_box",
    "soft_suspension": "soft_suspension",
    "soft_tissue": "soft_tissue",
}
#: Figures that show all other studies and scenes, or scenes that those vary in numbers only.
ELSEWHERE = {
    "quick": ("microgel_crosslinked", "microgel_uncrosslinked"),
    "film": ("microgel_crosslinked", "microgel_uncrosslinked"),
    "full": ("microgel_crosslinked", "microgel_uncrosslinked", "microgel_bulk"),
    "particleshear": ("microgel_crosslinked",),
    "three_methods": ("three_methods",),
    "hard_disc/jamming": ("hard_disc_jammed", "hard_disc_shear"),
    "hard_disc/rheology_64": ("hard_disc_fixed_area", "hard_disc_fixed_pressure"),
    "hard_disc/rheology_256": ("hard_disc_fixed_pressure",),
    "hard_disc/rheology_1024": ("hard_disc_fixed_pressure",),
    "hard_disc/rheology_1024_dense": ("hard_disc_fixed_pressure",),
    "hard_disc/signals": ("hard_disc_signal_fixed_area", "hard_disc_signal_fixed_pressure"),
    "soft_beam": ("soft_beams_and_rings",),
    "soft_pack_speed": ("soft_particle_box_plastic", "soft_particle_box_hollow"),
    "soft_plastic_ring": ("soft_particle_plastic",),
    "soft_free_ring_pressed": ("soft_beams_and_rings",),  # all three are but circles to the eye
    "soft_free_ring_vibrating": ("soft_beams_and_rings",),
    "soft_free_ring_long": ("soft_beams_and_rings",),
}
SIDE = 1.75  # inches
LINE, BAR, FOOT = 0.12, 0.06, 1.0  # inches: a line of letters, a scale of colours, room for both
PAPER, MARGIN = 250, 6  # what is darker is used; pixels below that
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
#: What else is known of some scenes: colours, lines, the point of the study that is taken, and
#: whether the last snapshot is drawn where another one would be.
LOOKS: dict[str, dict[str, Any]] = {
    "microgel_crosslinked": {"point": {"shear.strain_amplitude": 0.5, "model.friction": 0.01}},
    "microgel_bulk": {
        "point": {"shear.strain_amplitude": 0.5, "model.friction": 0.01}, "colour": "pressure",
        "contacts": "force",
    },
    "microgel_uncrosslinked": {
        "point": {"shear.strain_amplitude": 0.5, "model.friction": 0.1},
    },
    "hard_disc_fixed_area": {
        "point": {"packing.packing_fraction": 0.8}, "colour": "displacement", "contacts": "none",
    },
    "hard_disc_fixed_pressure": {
        "point": {"shear.scaled_pressure": 30.0}, "colour": "pressure", "contacts": "force",
    },
    "hard_disc_crystal_shear": {"point": {"shear.scaled_pressure": 100.0}},
    "soft_particle_plastic": {"last": True},
    "soft_particle_plastic_core": {"last": True},
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


def draw(kept: Kept, path: Path, look: dict[str, Any]) -> None:
    """Draw particles, small, and below them what their colours and lines mean."""
    number = len(kept.snapshots) - 1 if look.get("last") else shown(kept)
    colour = look.get("colour", "particle")
    *_, width, height = view(kept.snapshots[number : number + 1])
    high = SIDE * height / width
    tall = high + FOOT
    with style.figure(SIDE, tall) as figure:
        figure.set_layout_engine("none")
        axis = figure.add_axes((0.0, FOOT / tall, 1.0, high / tall))
        lines = look.get("contacts")
        scene = Scene(axis, kept.snapshots, kept.gradient, colour, lines, only=number)
        show_weight(kept, scene)
        scene.show(number)
        below = FOOT - LINE / 2
        if scene.colours.scaled:
            axis = figure.add_axes((0.08, (below - BAR) / tall, 0.84, BAR / tall))
            scene.colours.bar(axis, unit(kept, colour))
            axis.tick_params(labelsize=style.SMALL, length=2, pad=1)
            axis.set_xlabel(axis.get_xlabel(), size=style.SMALL, labelpad=1, loc="left")
            below -= BAR + LINE * (2.6 + axis.get_xlabel().count("\n"))
        axis = figure.add_axes((0.02, below / tall, 0.96, 0.0))
        axis.set_axis_off()
        if (legend := scene.legend(axis, columns=2)) is not None:
            legend.set_loc("upper left")
            for text in legend.get_texts():
                text.set_fontsize(style.SMALL)
        style.save_as(figure, path)
    with Image.open(path) as drawn:
        picture = drawn.convert("RGB")
    used = np.flatnonzero((np.asarray(picture) < PAPER).any(axis=(1, 2)))[-1] + MARGIN
    picture = picture.crop((0, 0, picture.width, min(used, picture.height)))
    small = picture.quantize(palette=style.palette([picture]), dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB, of {kept.path}")


def jobs_of_scenes() -> dict[str, Job]:
    """Return the job that is drawn of each scene, by the name of its picture."""
    jobs = {}
    for file, prefix in STUDIES.items():
        study = load_study(CONFIGS / f"{file}.yaml")
        for scene in dict.fromkeys(label for p in study.points for _, label in p.labels):
            points = [p for p in study.points if scene in {label for _, label in p.labels}]
            if (name := f"{prefix}_{scene}") in ELSEWHERE:
                continue
            jobs[name] = job_of(points, LOOKS.get(name, {}).get("point", {}), study.seed)
    return jobs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=Path("results"), help="of the runs")
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of pictures")
    given = parser.parse_args()
    jobs = jobs_of_scenes()
    compile_for(list(jobs.values()), lambda: print("compiling the kernels"))
    results = Results(given.results / "gallery")
    results.jobs.mkdir(parents=True, exist_ok=True)
    for name, job in jobs.items():
        kept = read_kept(run_job(job, results.jobs))
        draw(kept, given.folder / f"{name}.png", LOOKS.get(name, {}))


if __name__ == "__main__":
    main()
