"""Figures of a study, drawn from its tables alone.

Each function takes tables and returns a figure to save, or to change first; `draw` makes all that
the tables of a study allow. Every figure of a partial study says how much of it is there.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim.figures import style
from shear_sim.figures.curves import branches, curves
from shear_sim.figures.example import example_run
from shear_sim.figures.laws import contact_laws
from shear_sim.variation import variation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["branches", "contact_laws", "curves", "draw", "example_run"]


def draw(
    tables: "Mapping[str, pd.DataFrame]", folder: Path, example: Mapping[str, Any] | None = None
) -> list[Path]:
    """Draw all figures that ``tables`` allow into ``folder``, as PNG and PDF; return their paths.

    Parameters
    ----------
    tables : mapping
        ``moduli`` or ``steady``, as `shear_sim.aggregate.aggregate` returns them.
    folder : Path
        Made where it does not exist.
    example : mapping, optional
        The arguments of `example_run`.
    """
    figures: dict[str, Figure] = {}
    partial = ""
    for name, quantities in (
        ("moduli", ("storage_modulus", "loss_modulus")),
        ("steady", ("shear_stress", "viscosity")),
    ):
        if name not in tables:
            continue
        points = tables[name]
        partial = style.partial_note(points)
        if not points["replicates"].any():
            continue
        plan = variation(points)
        if plan.x is not None:
            figures[name] = curves(points, quantities)
        if plan.branches:
            figures[f"{name}_branches"] = branches(points, quantities)
    if example is not None:
        figures["example"] = example_run(**example, note=partial)
    folder.mkdir(parents=True, exist_ok=True)
    return [path for name, figure in figures.items() for path in style.save(figure, folder / name)]
