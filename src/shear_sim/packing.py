"""Disc packings: the sections of a study file, and the random or crystalline starts they describe.

A start is geometry only: positions, radii and cell. Bringing it to rest is each model's affair.
"""

import math
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shear_sim.schema import Positive, Section
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]


class Cell(Section):
    """The simulated cell and what happens at its edges."""

    width: Annotated[float, Field(gt=0, description="L_x [m]")] = 500e-6
    height: Annotated[
        float | None, Field(gt=0, description="L_y [m]; default: the width (hexagonal: derived)")
    ] = None
    boundary: Annotated[
        Literal["lees_edwards", "plates", "open"],
        Field(
            description="lees_edwards: sheared periodic cell. plates: discs that touch top or "
            "bottom when the shear starts are glued to rigid rough plates. open: no images."
        ),
    ] = "lees_edwards"


class Equilibration(Section):
    """When a packing counts as at rest, in units of k ⟨D⟩ and k ⟨D⟩² per metre of depth."""

    force_tolerance: Annotated[
        Positive, Field(description="largest net force on a disc / (k⟨D⟩)")
    ] = 1e-9
    energy_tolerance: Annotated[
        Positive, Field(description="kinetic energy per disc / (k⟨D⟩²)")
    ] = 1e-18
    max_steps: Annotated[
        int, Field(ge=0, description="limit of each of the two equilibrations; 0: start as it is")
    ] = 100_000


class Packing(Section):
    """Which discs there are and where they start."""

    start: Annotated[
        Literal["random", "hexagonal", "file"],
        Field(description="uniform random positions, a hexagonal crystal, or a start file"),
    ] = "random"
    discs: Annotated[int, Field(ge=1, description="N; ⌈N/2⌉ are large")] = 150
    packing_fraction: Annotated[
        float, Field(gt=0, le=2.5, description="φ = Σ π r_i² / cell area [-], not in percent")
    ] = 1.5
    size_ratio: Annotated[float, Field(ge=1, le=5, description="large radius / small radius")] = 1.4
    density: Annotated[float, Field(gt=0, description="ρ of a disc [kg/m³]")] = 1000.0
    columns: Annotated[
        int | None,
        Field(ge=1, description="hexagonal start: discs per row (rows = discs / columns)"),
    ] = None
    file: Annotated[
        Path | None,
        Field(description="start: file. Table (.csv, .parquet) or state (.npz), beside the study"),
    ] = None
    file_digest: Annotated[
        str | None, Field(description="SHA-256 of the start file; filled in when the study is read")
    ] = None
    equilibration: Equilibration = Equilibration()


class Start(NamedTuple):
    """N discs before they are brought to rest, in a cell whose height is known now."""

    position: FloatArray  # (N, 2) [m]
    radius: FloatArray  # (N,) [m]
    width: float  # [m]
    height: float  # [m]


def cell_height(packing: Packing, cell: Cell) -> float:
    """Return the height of the cell [m]: as given, a crystal's own, else the width."""
    if packing.start == "hexagonal" and packing.columns is not None:
        rows = packing.discs // packing.columns
        return cell.width / packing.columns * rows * math.sqrt(3) / 2
    return cell.width if cell.height is None else cell.height


def radii(packing: Packing, area: float) -> FloatArray:
    """Return the radii (N,) [m], ⌈N/2⌉ large ones first, with φ exact for these counts (S1-14)."""
    large = math.ceil(packing.discs / 2)
    relative = np.ones(packing.discs)
    relative[:large] = packing.size_ratio
    return relative * math.sqrt(packing.packing_fraction * area / (math.pi * (relative**2).sum()))


def start_discs(packing: Packing, cell: Cell, streams: Streams) -> Start:
    """Return the discs of a random or hexagonal start.

    Random positions are uniform in the cell, and no two closer than a millionth of a radius.
    """
    width, height = cell.width, cell_height(packing, cell)
    radius = radii(packing, width * height)
    if packing.start == "hexagonal":
        columns = packing.columns or 1
        rows = packing.discs // columns
        spacing = width / columns
        row, column = np.divmod(np.arange(packing.discs), columns)
        x = (column + 0.5 * (row % 2) + 0.25) * spacing
        y = (row + 0.5) * height / rows
        return Start(np.column_stack([x, y]), radius, width, height)
    from scipy.spatial import KDTree

    rng = streams.generator("positions")
    position = rng.random((packing.discs, 2)) * (width, height)
    while len(close := KDTree(position).query_pairs(1e-6 * radius.min(), output_type="ndarray")):
        position[close[:, 0]] = rng.random((len(close), 2)) * (width, height)
    return Start(position, radius, width, height)
