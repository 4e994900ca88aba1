"""The README maps every parameter of the historical program."""

from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
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
    section = README.read_text().partition("## Coming from particleShear")[2]
    rows = [line.split("|") for line in section.splitlines() if line.startswith("| ")]
    cells = [cell for row in rows for cell in (row[1], row[4])]
    named = {word.strip(" ;:,") for cell in cells for word in cell.split()}
    assert set(TABLE_S2_1.split()) - named == set()
