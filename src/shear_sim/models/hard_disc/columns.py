"""The columns of a table of hard discs, what follows from them, and what is averaged."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Column, Columns

COLUMNS = (
    Column("time", "s", "time since the start of the shear"),
    Column("strain", "1", "imposed shear strain γ"),
    Column("strain_rate", "1/s", "imposed shear rate γ̇"),
    Column("stress_xx", "Pa", "contact stress of the cell, compression positive"),
    Column("stress_xy", "Pa", "contact stress of the cell"),
    Column("stress_yy", "Pa", "contact stress of the cell"),
    Column("scaled_shear_stress", "1", "σ ξ₀/γ̇, also where γ̇ passes through 0"),
    Column("scaled_pressure", "1", "p ξ₀/|γ̇|, also where γ̇ passes through 0"),
    Column("contact_number", "1", "contacts per disc, 2 N_c/N, all discs counted"),
    Column("packing_fraction", "1", "φ"),
    Column("compression_ratio", "1", "κ: rate of isotropic compression / |γ̇|"),
    Column("compression", "1", "∫κ d|γ| since the start"),
    Column("nonaffine_speed", "1", "root mean square of u / (γ̇ λ), λ: mean small diameter"),
    Column("events", "1", "collisions and openings since the start"),
    Column("mean_velocity_x", "1", "mean of u_x / (γ̇ λ) over the discs that can move"),
    Column("mean_velocity_y", "1", "mean of u_y / (γ̇ λ) over them"),
)
DERIVED = (
    Column("shear_stress", "Pa", "−stress_xy"),
    Column("pressure", "Pa", "(stress_xx + stress_yy)/2"),
)
MEASURED = (
    (Column("status", "", "flowing (to the end), jammed (certified) or arrested"), "status"),
    *(
        (Column(name, "1", text), f"measured.{name}")
        for name, text in (
            ("scaled_shear_stress", "mean of σ ξ₀/γ̇ after the transient"),
            ("scaled_pressure", "mean of p ξ₀/|γ̇| after the transient"),
            (
                "friction_coefficient",
                "μ = mean shear stress / mean pressure after the transient",
            ),
            ("viscous_number", "J = γ̇/(ξ₀ p), of the mean pressure after the transient"),
            ("contact_number", "mean of 2 N_c/N after the transient"),
            ("mean_packing_fraction", "mean of φ after the transient"),
            ("compression_ratio", "mean of κ after the transient"),
            ("nonaffine_speed", "mean of the root mean square of u after the transient"),
            ("events_per_disc_path", "events per disc and unit strain (τ) after the transient"),
            ("mean_velocity_x", "mean of u_x over discs after the transient"),
            ("mean_velocity_y", "mean of u_y over discs after the transient"),
            ("final_packing_fraction", "φ at the end of a compression or of stages"),
            ("rattler_fraction", "discs that bear no force, of a jammed packing"),
        )
    ),
)


def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the derived columns whose stored columns are there."""
    out: Columns = {}
    if "stress_xy" in columns:
        out["shear_stress"] = -columns["stress_xy"]
    if "stress_xx" in columns and "stress_yy" in columns:
        out["pressure"] = 0.5 * (columns["stress_xx"] + columns["stress_yy"])
    return out
