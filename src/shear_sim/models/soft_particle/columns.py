"""The columns of a table of soft particles, what follows from them, and what is kept of a run."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Column, Columns

COLUMNS = (
    Column("time", "s", "time since the start"),
    Column("compression", "1", "ε = 1 − b/b₀, b: distance of the mid-lines at the two plates"),
    Column("force", "N/m", "normal force on a plate, mean of both"),
    Column("mean_force", "N/m", "work of the plates since the record before / their way"),
    Column("stress_yy", "Pa", "force / b₀, compression positive"),
    Column("scaled_force", "1", "F R²/(E I)"),
    Column("stress_yy_per_modulus", "1", "stress_yy / E"),
    Column("stress_yy_per_bending", "1", "stress_yy / (k_b/R²)"),
    Column("core_pressure", "Pa", "pressure of the core above that at rest"),
    Column("area_ratio", "1", "V/V₀, area inside the mid-line"),
    Column("width_ratio", "1", "a/b₀, width of the mid-line"),
    Column("contact_ratio", "1", "L_c/b₀, from the first to the last vertex that touches a plate"),
    Column("load_ratio", "1", "2⟨|x|⟩/b₀ of the load: how far the two loads of a ring are apart"),
    Column("energy_stretch", "J/m", "stored in bars"),
    Column("energy_bend", "J/m", "stored in hinges"),
    Column("energy_core", "J/m", "stored in the core"),
    Column("energy_contact", "J/m", "stored in normal and tangential springs"),
    Column("energy_kinetic", "J/m", "kinetic energy"),
    Column("work", "J/m", "done by the plates"),
    Column("lost_by_yield", "J/m", "in bars and hinges"),
    Column("lost_by_friction", "J/m", "by sliding, and springs lost at separation"),
    Column("lost_by_damping", "J/m", "in dashpots of bars and hinges"),
    Column("lost_by_drag", "J/m", "by drag of the vertices"),
    Column("energy_missing", "J/m", "work less everything that it went into"),
)
DERIVED = (Column("stretch_share", "1", "energy of bars / energy of hinges"),)
MEASURED = tuple(
    (Column(name, unit, text), f"measured.{name}")
    for name, unit, text in (
        ("final_force", "N/m", "force of a plate at the largest compression"),
        ("final_scaled_force", "1", "F R²/(E I) at the largest compression"),
        ("final_area_ratio", "1", "V/V₀ at the largest compression"),
        ("final_contact_ratio", "1", "L_c/b₀ at the largest compression"),
        ("contact_onset", "1", "ε of zero contact length, of a line through load_ratio (no core)"),
        ("contact_slope", "1", "slope of that line"),
        ("residual_compression", "1", "1 − height of the free ring / b₀, after unloading"),
        ("recovered_work", "1", "work given back in unloading / work of loading"),
        ("energy_missing_ratio", "1", "largest |energy_missing| / work of loading"),
        ("drag_ratio", "1", "lost by drag / work of loading: slow enough where it is small"),
    )
)


def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the derived columns whose stored columns are there."""
    out: Columns = {}
    if "energy_stretch" in columns and "energy_bend" in columns:
        bend = columns["energy_bend"]
        out["stretch_share"] = columns["energy_stretch"] / np.where(bend > 0.0, bend, np.nan)
    return out
