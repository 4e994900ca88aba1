"""Force against compression of contact laws: Fig. S1-3 of part 1 of the manual."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.models.microgel.parameters import (
    ContactLaw,
    DivergentLaw,
    HertzLaw,
    LinearLaw,
    PlateauLaw,
)

if TYPE_CHECKING:
    import pandas as pd

_KINDS: "dict[str, type[LinearLaw | DivergentLaw | PlateauLaw | HertzLaw]]" = {
    "linear": LinearLaw,
    "divergent": DivergentLaw,
    "plateau": PlateauLaw,
    "hertz": HertzLaw,
}
_OTHERS = (LinearLaw(kind="linear"), DivergentLaw(), HertzLaw(kind="hertz"))
_SAMPLES = 201


def force_curve(section: ContactLaw, contact_distance: float, stiffness: float) -> dict[str, Any]:
    """Return the repulsive force of a law from contact to full compression.

    Parameters
    ----------
    section : ContactLaw
        The law.
    contact_distance : float
        D = r_i + r_j [m].
    stiffness : float
        k [N/m²], eq. S1-8.

    Returns
    -------
    dict of (201,) arrays
        ``compression`` D − d [m] and ``force`` per metre of depth [N/m].
    """
    from shear_sim.models.microgel.laws import law_of  # loads Numba

    law, p = law_of(section)
    compression = np.linspace(0.0, contact_distance, _SAMPLES)
    force = [-law(contact_distance - x, contact_distance, stiffness, p) for x in compression]
    return {"compression": compression, "force": np.array(force)}


def contact_laws(runs: "pd.DataFrame") -> "tuple[pd.DataFrame, str]":
    """Return the laws that runs use, and the linear, divergent and Hertz law beside them.

    All of a small and a large disc, with the Young's modulus and radii of most of the runs.

    Parameters
    ----------
    runs : DataFrame
        A row per run (one at least): its parameters and derived quantities by dotted keys.

    Returns
    -------
    table : DataFrame
        ``law``, ``of_study``, ``compression`` [m] and ``force`` per metre of depth [N/m].
    note : str
        Of which discs the forces are, and what is left out.
    """
    import pandas as pd

    size = ["model.young_modulus", "derived.small_radius", "derived.large_radius"]
    modulus, *radii = runs.value_counts(size).index[0]
    used, custom = _used(runs)
    laws = [(section, True) for section in used]
    laws += [(section, False) for section in _OTHERS if section not in used]
    parts = [
        pd.DataFrame(
            {"law": _name(section), "of_study": of_study}
            | force_curve(section, sum(radii), math.pi * modulus / 8)
        )
        for section, of_study in laws
    ]
    small, large = (f"{radius * 1e6:.3g} µm" for radius in radii)
    note = f"E = {modulus:g} Pa; a disc of radius {small} and one of {large}"
    if runs[size].nunique().max() > 1:
        note += ", as in most runs"
    if custom:
        note += "; custom laws are left out"
    return pd.concat(parts, ignore_index=True), note


def _used(runs: "pd.DataFrame") -> tuple[list[ContactLaw], bool]:
    """Return the built-in laws of the runs, each once, and whether there are custom ones."""
    prefix = "model.contact_law."
    parameters = runs.filter(like=prefix).rename(columns=lambda key: key.removeprefix(prefix))
    found: list[ContactLaw] = []
    kinds = set(parameters["kind"])
    for row in parameters.drop_duplicates().to_dict("records"):
        if row["kind"] in _KINDS:
            known = _KINDS[row["kind"]]
            values = {str(k): v for k, v in row.items() if k in known.model_fields and v == v}
            section = known.model_validate(values)
            if section not in found:
                found.append(section)
    return found, "custom" in kinds


def _name(section: ContactLaw) -> str:
    """Return the kind of a law, with what is not the same in all laws of that kind."""
    words: list[str] = [section.kind]
    if isinstance(section, PlateauLaw):
        words.append(f"{section.begin:g} to {section.end:g} D, slope {section.slope:g}")
    if isinstance(section, DivergentLaw | PlateauLaw) and section.repulsion != 1:
        words.append(f"κ = {section.repulsion:g}")
    return ", ".join(words)
