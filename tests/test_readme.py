"""What README.md and the pages of analysis/ point at is there, and every old name is mapped."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "analysis").rglob("*.md"))]
TABLE_S2_1 = """
root_folder theAmplitude theMu do_permanent_links cut_lines N packing_fraction density
bimodal_factor Young_modulus_spheres relative_viscosity relative_transversal_link_strength
relative_frequency central_repulsion_coefficient avoid_horizontal_angle_degree
avoid_height_spanning_particles interface_reenforcement_central
interface_reenforcement_tangential keep_viscosity_coefficients_constant cut_top_bottom
saveOutputImages imageFileType remove_link_fraction edge_fuzziness doCutByTriangulation doDrawing
saveData saveStressTensorData plotStress relative_y_scale_force pre_periods periods post_periods
cool_factor
"""


def test_every_old_name_is_mapped():
    """Each name of Table S2-1 stands in a cell of the table, whole."""
    section = (ROOT / "analysis/particleshear.md").read_text().partition("## Names")[2]
    rows = [
        line.split("|") for line in section.partition("## ")[0].splitlines() if line[:2] == "| "
    ]
    cells = [cell for row in rows for cell in (row[1], row[4])]
    named = {word.strip(" ;:,") for cell in cells for word in cell.split()}
    assert set(TABLE_S2_1.split()) - named == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_points_at_is_there(page):
    """Links go to files and headings; programs, studies and tests in backticks exist."""
    text = page.read_text()
    for link in re.findall(r"\]\(([^)]+)\)", text):
        file, _, heading = link.partition("#")
        target = (page.parent / file) if file else page
        assert target.exists(), link
        if heading:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            assert heading in {anchor(each) for each in headings}, link
    for path in re.findall(r"`((?:analysis|configs|tests|slurm|src)/[\w./-]+)", text):
        assert (ROOT / path).exists(), path


def anchor(heading):
    """Return the name that a heading has in links, by GitHub's rule."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
