"""The columns of a microgel table, and the stress tensors that follow from the stored ones.

Compression is positive; element ab is force component a, lever component b (Table S2-3). V is
the cell's area. Only independent components are stored; :func:`derive` gives all the others.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Column, Columns

COMPONENTS = ("xx", "xy", "yx", "yy")


def _tensor(name: str, description: str, components: tuple[str, ...] = COMPONENTS) -> list[Column]:
    return [Column(f"{name}_{ab}", "Pa", f"{description}, component {ab}") for ab in components]


COLUMNS = (
    Column("time", "s", "time since the start of the rest before the shear"),
    Column("strain", "1", "imposed shear strain γ"),
    Column("strain_rate", "1/s", "imposed shear rate; at a jump, its value before"),
    *_tensor("periodic_love_weber", "Love–Weber sum over all contacts, each with its own image"),
    Column("periodic_torque_yx", "Pa", "torques of all contacts, ΣT/2V; −xy component"),
    *_tensor("love_weber", "Love–Weber sum over internal contacts, eq. S1-19"),
    Column("internal_torque_yx", "Pa", "torques of internal contacts, ΣT/2V, eq. S1-24; −xy"),
    *_tensor("external", "stress from external forces, eq. S1-16"),
    Column("torque_yx", "Pa", "net torques of the discs, ΣT/2V, eq. S1-23; −xy component"),
    Column("centrifugal_xx", "Pa", "minus the spin energy density, eq. S1-21; also yy"),
    *_tensor("peculiar", "dynamic stress of peculiar momenta (Otsuki et al.)", ("xx", "xy", "yy")),
    Column("coordination", "1", "touching neighbours per disc"),
    Column("sliding_fraction", "1", "fraction of touching pairs that slide"),
    # Only with record.energy, per metre of depth:
    Column("kinetic_energy", "J/m", "of peculiar velocities and spins"),
    Column("elastic_energy", "J/m", "of contacts and links, normal and tangential"),
    Column("energy_put_in", "J/m", "work of the imposed flow since the start"),
    Column("lost_in_normal_dashpots", "J/m", "since the start"),
    Column("lost_in_tangential_dashpots", "J/m", "since the start"),
    Column("lost_by_drag", "J/m", "background damping of velocities, since the start"),
    Column("lost_by_spin_drag", "J/m", "background damping of spins, since the start"),
    Column("lost_by_friction", "J/m", "sliding contacts, since the start"),
)

TENSORS = {
    "peculiar": "dynamic stress of peculiar momenta (Otsuki et al.)",
    "linear_acceleration": "linear acceleration of the discs, eq. S1-17; gravity is not considered",
    "unbalanced_force": "unbalanced contact forces; equal to linear_acceleration",
    "torque": "net torques of the discs, eq. S1-23 with K = 0",
    "internal_torque": "torques of internal contacts, eq. S1-24 with K = 0",
    "centrifugal": "spin, eq. S1-21",
    "overall": "symmetric internal stress, eq. S1-24",
    "periodic_overall": "symmetric stress of the periodic cell, every contact counted once",
}

DERIVED = (
    Column(
        "shear_stress", "Pa", "shear stress of the periodic tensor: what G′ and G″ are read from"
    ),
    Column("shear_stress_internal", "Pa", "shear stress of the internal tensor, eqs. S1-24, S1-25"),
    Column("shear_stress_external", "Pa", "shear stress at the surface, eqs. S1-16 and S1-25"),
    Column("pressure", "Pa", "half the trace of the periodic tensor"),
    *(column for name, text in TENSORS.items() for column in _tensor(name, text)),
)


def derive(columns: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return every derived column whose stored columns are there.

    The definitions are those of the manual (part 1, eqs. S1-15 to S1-25; part 2, Table S2-3)::

        linear_acceleration = unbalanced_force = love_weber − external          (S1-19)
        overall = love_weber + internal_torque + centrifugal                    (S1-24)
        periodic_overall = periodic_love_weber + periodic_torque + centrifugal
        shear_stress = −periodic_overall_xy                                     (S1-25)
    """
    stored = dict(columns)
    out: Columns = {}

    def antisymmetric(name: str, source: str) -> None:
        if source in stored:
            yx = stored[source]
            out.update(
                {f"{name}_xx": 0 * yx, f"{name}_xy": -yx, f"{name}_yx": yx, f"{name}_yy": 0 * yx}
            )

    def combine(name: str, plus: tuple[str, ...], minus: tuple[str, ...] = ()) -> None:
        known = out | stored
        for ab in COMPONENTS:
            if all(f"{term}_{ab}" in known for term in plus + minus):
                total = sum((known[f"{term}_{ab}"] for term in plus[1:]), known[f"{plus[0]}_{ab}"])
                out[f"{name}_{ab}"] = sum((-known[f"{term}_{ab}"] for term in minus), total)

    antisymmetric("torque", "torque_yx")
    antisymmetric("internal_torque", "internal_torque_yx")
    antisymmetric("periodic_torque", "periodic_torque_yx")
    if "centrifugal_xx" in stored:
        xx = stored["centrifugal_xx"]
        out |= {
            "centrifugal_xx": xx,
            "centrifugal_xy": 0 * xx,
            "centrifugal_yx": 0 * xx,
            "centrifugal_yy": xx,
        }
    for ab in ("xx", "xy", "yy"):
        if f"peculiar_{ab}" in stored:
            out[f"peculiar_{ab}"] = stored[f"peculiar_{ab}"]
    if "peculiar_xy" in stored:
        out["peculiar_yx"] = stored["peculiar_xy"]
    combine("linear_acceleration", ("love_weber",), ("external",))
    combine("unbalanced_force", ("love_weber",), ("external",))
    combine("overall", ("love_weber", "internal_torque", "centrifugal"))
    combine("periodic_overall", ("periodic_love_weber", "periodic_torque", "centrifugal"))
    for name, source in (
        ("shear_stress", "periodic_overall_xy"),
        ("shear_stress_internal", "overall_xy"),
        ("shear_stress_external", "external_xy"),
    ):
        if (series := {**stored, **out}.get(source)) is not None:
            out[name] = -series
    if "periodic_overall_xx" in out:
        out["pressure"] = 0.5 * (out["periodic_overall_xx"] + out["periodic_overall_yy"])
    return {column.name: out[column.name] for column in DERIVED if column.name in out}
