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
    Column("strain", "1", "|ln(H/H₀)|, H the height of a box or tissue; of a sheared cell: γ"),
    Column("stress_yy", "Pa", "force / b₀, of a lid or upper grip / width; compression positive"),
    Column("stress_xx", "Pa", "of a box: mean force of its sides / height; of a cell: its stress"),
    Column("stress_xy", "Pa", "of a sheared cell; between plates: their shear force / width"),
    Column("stress_yx", "Pa", "of a sheared cell; means nothing between plates"),
    Column("stress_floor", "Pa", "of a box: force of its floor (or lower grip) / width"),
    Column("imposed_stress", "Pa", "of a lid under a load: that load / width"),
    Column("scaled_force", "1", "F R²/(E I)"),
    Column("stress_yy_per_modulus", "1", "stress_yy / E"),
    Column("stress_yy_per_bending", "1", "stress_yy / (k_b/R²)"),
    Column("stress_xx_per_modulus", "1", "stress_xx / E"),
    Column("stress_xx_per_bending", "1", "stress_xx / (k_b/R²)"),
    Column("stress_xy_per_modulus", "1", "stress_xy / E"),
    Column("stress_xy_per_bending", "1", "stress_xy / (k_b/R²)"),
    Column("stress_yx_per_modulus", "1", "stress_yx / E"),
    Column("stress_yx_per_bending", "1", "stress_yx / (k_b/R²)"),
    Column("stress_floor_per_modulus", "1", "stress_floor / E"),
    Column("stress_floor_per_bending", "1", "stress_floor / (k_b/R²)"),
    Column("imposed_stress_per_modulus", "1", "imposed_stress / E"),
    Column("imposed_stress_per_bending", "1", "imposed_stress / (k_b/R²)"),
    Column("core_pressure", "Pa", "pressure of the core above that at rest"),
    Column("core_pressure_per_modulus", "1", "core_pressure / E"),
    Column("core_pressure_per_bending", "1", "core_pressure / (k_b/R²)"),
    Column("area_ratio", "1", "V/V₀, area inside the mid-line"),
    Column("width_ratio", "1", "a/b₀, width of the mid-line"),
    Column("contact_ratio", "1", "L_c/b₀, from the first to the last vertex that touches a plate"),
    Column("load_ratio", "1", "2⟨|x|⟩/b₀ of the load: how far the two loads of a ring are apart"),
    Column("outer_pressure", "Pa", "pressure on a ring from outside"),
    Column("outer_pressure_per_modulus", "1", "outer_pressure / E"),
    Column("outer_pressure_per_bending", "1", "outer_pressure / (k_b/R²)"),
    Column("outer_pressure_ratio", "1", "p R³/(E I)"),
    Column("ovality", "1", "a of a ring of R (1 + a cos 2φ), φ of the vertices at rest"),
    Column("deflection", "m", "of a beam, where the force is"),
    Column("deflection_ratio", "1", "the same / F L³/3EI, or F L³/48EI if supported at both ends"),
    Column("box_area", "m^2", "of a box or cell: width times height"),
    Column("solid_area", "m^2", "of all particles: Σ A + P r + π r², A, P: of the mid-line"),
    Column("circularity", "1", "mean of 4π A/P²"),
    Column("links_broken", "1", "number of links broken so far"),
    Column("mean_cell_energy", "1", "W/W₀, W stored in bars, hinges and core, W₀ of a link"),
    Column("largest_cell_energy", "1", "the largest W/W₀ of all cells"),
    Column("energy_stretch", "J/m", "stored in bars"),
    Column("energy_bend", "J/m", "stored in hinges"),
    Column("energy_core", "J/m", "stored in the core"),
    Column("energy_contact", "J/m", "stored in normal and tangential springs"),
    Column("energy_links", "J/m", "stored in cohesive links"),
    Column("energy_kinetic", "J/m", "kinetic energy"),
    Column("work", "J/m", "of plates, grips, forces, or of shear: V ∫τ dγ, summed in every step"),
    Column("lost_by_yield", "J/m", "in bars and hinges"),
    Column("lost_by_friction", "J/m", "by sliding, and springs lost at separation"),
    Column("lost_by_damping", "J/m", "in dashpots of bars and hinges"),
    Column("lost_by_drag", "J/m", "by drag of the vertices"),
    Column("lost_by_breaking", "J/m", "with links, when they broke"),
    Column("criterion_energy", "J/m", "of the broken links, each where it meets its criterion"),
    Column("energy_missing", "J/m", "work less everything that it went into"),
)
DERIVED = (
    Column("shear_stress", "Pa", "−stress_xy"),
    Column("pressure", "Pa", "(stress_xx + stress_yy)/2, of a sheared cell"),
    Column("shear_stress_per_modulus", "1", "shear_stress / E"),
    Column("shear_stress_per_bending", "1", "shear_stress / (k_b/R²)"),
    Column("pressure_per_modulus", "1", "pressure / E"),
    Column("pressure_per_bending", "1", "pressure / (k_b/R²)"),
    Column("stretch_share", "1", "energy of bars / energy of hinges"),
    Column("void_ratio", "1", "e = box_area / solid_area − 1"),
    Column("solid_share", "1", "ΔV_s/ΔV: change of solid_area / that of box_area, since the start"),
)
MEASURED = tuple(
    (Column(name, unit, text), f"measured.{name}")
    for name, unit, text in (
        ("final_compression", "1", "ε of loading, before the plates brake"),
        ("final_force", "N/m", "force of a plate at final_compression"),
        ("final_scaled_force", "1", "F R²/(E I) there"),
        ("final_area_ratio", "1", "V/V₀ there"),
        ("final_contact_ratio", "1", "L_c/b₀ there"),
        ("contact_onset", "1", "ε of no contact length, by a line; hollow, never yields"),
        ("contact_slope", "1", "slope of that line through load_ratio"),
        ("residual_compression", "1", "1 − height of the free ring / b₀, after unloading"),
        ("recovered_work", "1", "work given back in unloading / work of loading"),
        ("energy_missing_ratio", "1", "largest |energy_missing| / largest work"),
        ("drag_ratio", "1", "lost by drag / work of loading: slow enough where it is small"),
        ("fold_ratio", "1", "ℓ / half the gap between plates at the largest ε; 0 up to 0.2822"),
        ("sink_ratio", "1", "overlap with plates / half their gap at final_compression; by load"),
        ("final_deflection_ratio", "1", "deflection_ratio of a beam at rest"),
        ("bulk_modulus_ratio", "1", "slope of p in 1 − V/V₀, for p R³/EI up to 1 / (K_Ω + K_∂Ω)"),
        ("buckling_pressure_ratio", "1", "p R³/EI at which a ring buckles, by Southwell's plot"),
        ("frequency_ratio", "1", "frequency of a vibrating ring / ω₁, ω₁² = 36 EI/5 ρ_l R⁴"),
        ("energy_drift", "1", "of energy_missing / energy in 1,000 periods, by a line"),
        ("start_void_ratio", "1", "e at the start of a compaction"),
        ("final_strain", "1", "ln(H₀/H) where the lid turned"),
        ("final_stress_per_bending", "1", "σ R²/k_b there; σ/σ* is twice that"),
        ("final_void_ratio", "1", "e there"),
        ("final_solid_share", "1", "ΔV_s/ΔV there"),
        ("final_circularity", "1", "mean of 4π A/P² there"),
        ("void_ratio_at_unit", "1", "e of loading at σ = σ* = k_b/2R²"),
        ("solid_share_at_unit", "1", "ΔV_s/ΔV of loading at σ = σ*"),
        ("compressibility_index", "1", "C = −de/dlog₁₀σ of loading, by a line through σ/σ* > 0.03"),
        ("unloaded_void_ratio", "1", "e when the lid is free again"),
        ("start_stress_per_bending", "1", "σ_yy R²/k_b of a suspension before it is sheared"),
        ("cycle_missing_ratio", "1", "|∮τ dγ − losses − change of what is stored| / losses, last"),
        ("yield_loss_share", "1", "lost in bars and hinges that yield / all losses, last period"),
        ("friction_loss_share", "1", "by friction / all losses, last period"),
        ("damping_loss_share", "1", "in dashpots / all losses, last period"),
        ("drag_loss_share", "1", "by drag / all losses, last period"),
        (
            "kinetic_ratio",
            "1",
            "kinetic energy / work, at final_strain, peak_strain; of a stroke",
        ),
        ("peak_stress_per_bending", "1", "largest tensile σ R²/k_b, mean of both grips"),
        ("peak_strain", "1", "ε there"),
        ("rupture_strain", "1", "ε from where on less than a fifth of that stress is left"),
        ("links_broken", "1", "at the end of a tension"),
        ("crack_share", "1", "of broken links, those of the largest crack: at neighbouring cells"),
        ("crack_span", "1", "width of the cells at it / width of the tissue"),
        ("breaking_error", "1", "|lost_by_breaking / criterion_energy − 1| at the end"),
    )
)


def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the derived columns whose stored columns are there."""
    out: Columns = {}
    for unit in ("", "_per_modulus", "_per_bending"):
        if f"stress_xy{unit}" in columns:
            out[f"shear_stress{unit}"] = -columns[f"stress_xy{unit}"]
            if f"stress_xx{unit}" in columns and f"stress_yy{unit}" in columns:
                both = columns[f"stress_xx{unit}"] + columns[f"stress_yy{unit}"]
                out[f"pressure{unit}"] = 0.5 * both
    if "energy_stretch" in columns and "energy_bend" in columns:
        bend = columns["energy_bend"]
        out["stretch_share"] = columns["energy_stretch"] / np.where(bend > 0.0, bend, np.nan)
    if "box_area" in columns and "solid_area" in columns:
        box, solid = columns["box_area"], columns["solid_area"]
        out["void_ratio"] = box / solid - 1.0
        change = box[0] - box
        out["solid_share"] = (solid[0] - solid) / np.where(change > 0.0, change, np.nan)
    return out
