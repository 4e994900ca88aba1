"""Pictures of analysis/gallery.py: every scene of every study has one, or is named elsewhere."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from shear_sim.looks import Colour, Contacts
from shear_sim.render import read_kept
from shear_sim.runner import run_job
from shear_sim.study import load_study

ROOT = Path(__file__).parents[1]
CONFIGS, FIGURES = ROOT / "configs", ROOT / "analysis" / "figures"
GALLERY = runpy.run_path(str(ROOT / "analysis" / "gallery.py"))
STUDIES, ELSEWHERE, LOOKS = (GALLERY[name] for name in ("STUDIES", "ELSEWHERE", "LOOKS"))
KEYS = {"point", "colour", "contacts", "last"}


@pytest.fixture(scope="module")
def drawn():
    return GALLERY["jobs_of_scenes"]()


def names_of_scenes():
    """Every scene of a study that is drawn, as its picture is named."""
    return [
        f"{prefix}_{scene}"
        for file, prefix in STUDIES.items()
        for scene in {label for p in load_study(CONFIGS / f"{file}.yaml").points
                      for _, label in p.labels}
    ]  # fmt: skip


def test_every_study_is_drawn_or_named_with_figures_that_are_there():
    found = (path.relative_to(CONFIGS).with_suffix("") for path in CONFIGS.rglob("*.yaml"))
    studies, names = {path.as_posix() for path in found}, set(names_of_scenes())
    assert studies >= STUDIES.keys()
    assert not STUDIES.keys() & ELSEWHERE.keys()
    assert studies - STUDIES.keys() <= ELSEWHERE.keys() <= studies | names
    for figures in ELSEWHERE.values():
        assert figures
        for name in figures:
            assert (FIGURES / f"{name}.png").is_file(), name


def test_every_scene_of_a_drawn_study_has_its_own_picture(drawn):
    names = names_of_scenes()
    assert len(set(names)) == len(names)
    assert drawn.keys() == set(names) - ELSEWHERE.keys()
    for name in drawn:
        path = FIGURES / f"{name}.png"
        assert path.stat().st_size < 200_000, name
        with Image.open(path) as image:
            assert image.width == round(GALLERY["SIDE"] * 300), name


def test_looks_are_of_scenes_that_are_drawn(drawn):
    assert LOOKS.keys() <= drawn.keys()
    for name, look in LOOKS.items():
        assert look.keys() <= KEYS, name
        Colour(look.get("colour", "particle"))
        Contacts(look.get("contacts", "none"))


STUDY = """
packing: {discs: 16, packing_fraction: 0.4, walls: {kind: floor}}
model: {kind: hard_disc}
shear: {kind: body_force, inclination: 30, duration: 1}
record: {snapshots: [0, 1]}
seed: 1
"""


def test_a_picture_says_below_what_colours_and_lines_mean(tmp_path):
    """The same particles with nothing below, with a scale, and with a scale and a line."""
    (tmp_path / "study.yaml").write_text(STUDY)
    (tmp_path / "jobs").mkdir()
    [job] = load_study(tmp_path / "study.yaml").jobs()
    kept = read_kept(run_job(job, tmp_path / "jobs"))
    pictures = []
    for look in (
        {"contacts": "none"},
        {"colour": "speed", "contacts": "none"},
        {"colour": "speed", "contacts": "force"},
    ):
        GALLERY["draw"](kept, tmp_path / "picture.png", look)
        with Image.open(tmp_path / "picture.png") as image:
            pictures.append(np.asarray(image.convert("RGB")))
    plain, scale, both = (len(picture) for picture in pictures)
    assert plain + 40 < scale
    assert scale + 20 < both < plain + 250
