"""Figures of a study, drawn from its tables alone.

Each function takes tables and returns a figure to save, or to change first; `draw` makes all that
the tables of a study allow. Every figure of a partial study says how much of it is there.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim.figures import style
from shear_sim.figures.curves import branches, curves, has_curves
from shear_sim.figures.example import example_run
from shear_sim.figures.flow_laws import flow_laws, has_flow_laws
from shear_sim.figures.landmarks import landmark_parameters, landmarks
from shear_sim.figures.laws import contact_laws
from shear_sim.figures.lissajous import lissajous
from shear_sim.figures.moduli import moduli_with_landmarks
from shear_sim.figures.quality import has_quality, quality
from shear_sim.results import remove
from shear_sim.variation import variation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = [
    "CAPTIONS",
    "branches",
    "contact_laws",
    "curves",
    "draw",
    "example_run",
    "flow_laws",
    "landmark_parameters",
    "landmarks",
    "lissajous",
    "moduli_with_landmarks",
    "quality",
]

#: Every figure that `draw` makes, in the order in which they are read, and what it shows.
CAPTIONS = {
    "moduli": "Storage modulus G′ (filled) and loss modulus G″ (open), scene by scene. Lines are "
    "means over replicates, bands their intervals, thin bars those that reach down to 0.",
    "moduli_with_landmarks": "G′ and G″ of each curve, with its landmarks: where G′ has fallen by "
    "10 % (softening), the first peak of G″, the plateau that may follow, the last crossing of G′ "
    "and G″ (yield), and where I₃/I₁ exceeds 1 %. Bars at the foot are intervals of their "
    "strain, in the colour of the modulus on which they are marked.",
    "moduli_branches": "G′ and G″ against each of the other parameters, all others held.",
    "landmarks": "Strain, storage modulus and stress of the landmarks.",
    "landmarks_branches": "The same against each of the other parameters, all others held.",
    "large_amplitude": "Nonlinearity of the mean response: third harmonic I₃/I₁, strain stiffening "
    "S = (G′_L − G′_M)/G′_L and shear thickening T = (η′_L − η′_M)/η′_L. Thin bars: "
    "intervals of I₃/I₁ that reach down to 0.",
    "lissajous_elastic": "One cycle of the mean response at every point, stress against strain. "
    "The black line is the elastic part of the stress; dashed, the ellipse of G′ and G″ alone.",
    "lissajous_viscous": "The same cycles, stress against strain rate. The black line is the "
    "viscous part of the stress.",
    "steady": "Mean shear stress and viscosity in steady shear.",
    "steady_branches": "The same against each of the other parameters, all others held.",
    "flow_laws": "Flow laws of steady shear of rigid particles: stress ratio μ, packing fraction "
    "and contacts per disc against the viscous number J = γ̇/(ξ₀ p), viscosity and pressure against "
    "packing fraction, viscosity against pressure. Dashed: 4 contacts per disc, where rigid discs "
    "jam if all bear force.",
    "compression": "Packing fraction at which compression ended, and discs that bear no force "
    "there.",
    "compression_branches": "The same against each of the other parameters, all others held.",
    "self_propelled": "Speed beside the flow and contacts per disc of self-propelled discs.",
    "self_propelled_branches": "The same against each of the other parameters, all others held.",
    "example": "One run: strain and shear stress against time, and the loops of its periods.",
    "contact_laws": "Contact laws: repulsive force per metre of depth against the compression of "
    "two discs. Thick: laws of this study; thin: others, to compare.",
    "quality": "Quality of every run. Shaded: beyond the limits; such runs are flagged, and count "
    "in all the same.",
}
#: Tables with a row per point: the name of their figures, and quantities of each figure.
_POINTS: dict[str, dict[str, tuple[str, ...]]] = {
    "curves": {
        "moduli": ("storage_modulus", "loss_modulus"),
        "large_amplitude": ("third_harmonic_ratio", "stiffening_ratio", "thickening_ratio"),
    },
    "steady": {"steady": ("shear_stress", "viscosity")},
    "compression": {"compression": ("final_packing_fraction", "rattler_fraction")},
    "self_propelled": {"self_propelled": ("nonaffine_speed", "contact_number")},
}


def draw(
    tables: "Mapping[str, pd.DataFrame]", folder: Path, example: Mapping[str, Any] | None = None
) -> list[Path]:
    """Draw all figures that ``tables`` allow into ``folder``, as PNG and PDF.

    Figures of `CAPTIONS` that an earlier call has drawn and these tables do not allow are removed.

    Parameters
    ----------
    tables : mapping
        As `shear_sim.aggregate.make_tables` returns them.
    folder : Path
        Made where it does not exist.
    example : mapping, optional
        The arguments of `example_run`.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name, figure in _figures(tables, example):
        paths += style.save(figure, folder / name)
    remove(folder, CAPTIONS.keys() - {path.stem for path in paths}, (".png", ".pdf"))
    return paths


def _figures(
    tables: "Mapping[str, pd.DataFrame]", example: Mapping[str, Any] | None
) -> "Iterator[tuple[str, Figure]]":
    """Make each figure when it is asked for, so that only one is in memory."""
    if example is not None:
        partial = style.partial_note(tables["runs"])
        yield "example", example_run(**example, note=partial)
    for table, figures in _POINTS.items():
        if table not in tables or not tables[table]["replicates"].any():
            continue
        points = tables[table]
        plan = variation(points)
        for name, quantities in figures.items():
            if plan.x is not None:
                yield name, curves(points, quantities)
            if plan.branches and name != "large_amplitude":
                yield f"{name}_branches", branches(points, quantities)
    if "steady" in tables and has_flow_laws(tables["steady"]):
        yield "flow_laws", flow_laws(tables["steady"])
    if "curves" in tables and has_curves(tables["curves"]):
        points, features = tables["curves"], tables["features"]
        yield "moduli_with_landmarks", moduli_with_landmarks(points, features)
        if parameters := landmark_parameters(features):
            yield "landmarks", landmarks(features, parameters[:1])
        if parameters[1:]:
            yield "landmarks_branches", landmarks(features, parameters[1:])
        yield "lissajous_elastic", lissajous(points, tables["harmonics"], "elastic")
        yield "lissajous_viscous", lissajous(points, tables["harmonics"], "viscous")
    if "contact_laws" in tables:
        laws = tables["contact_laws"]
        yield "contact_laws", contact_laws(laws, laws.attrs["note"], style.partial_note(laws))
    if has_quality(tables["runs"]):
        yield "quality", quality(tables["runs"])
