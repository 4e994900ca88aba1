"""Disc packings: the sections of a study file, and the random or crystalline starts they describe.

A start is geometry only: positions, radii and cell. Bringing it to rest is each model's affair.
"""

import hashlib
import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from shear_sim.schema import MICROMETRES, PERCENT, Impossible, Positive, Section
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

MAX_DISCS = 100_000


class Cell(Section):
    """The simulated cell and what happens at its edges."""

    width: Annotated[float, Field(ge=1e-12, le=100, description="L_x [m]; S2-1"), MICROMETRES] = (
        500e-6
    )
    height: Annotated[
        float | None,
        Field(
            ge=1e-12, le=100, description="L_y [m]; default: the width (hexagonal: derived); ours"
        ),
        MICROMETRES,
    ] = None
    boundary: Annotated[
        Literal["lees_edwards", "plates", "open"],
        Field(
            description="lees_edwards: sheared periodic cell. plates: discs that touch top or "
            "bottom when the shear starts are glued to rigid rough plates. open: no images at all "
            "(section 4.1)"
        ),
    ] = "lees_edwards"


class Equilibration(Section):
    """When a packing counts as at rest, in units of k ⟨D⟩ and k ⟨D⟩² per metre of depth."""

    force_tolerance: Annotated[
        Positive, Field(description="largest net force on a disc / (k⟨D⟩); ours")
    ] = 1e-9
    energy_tolerance: Annotated[
        Positive, Field(description="kinetic energy per disc / (k⟨D⟩²); ours")
    ] = 1e-18
    max_steps: Annotated[
        int,
        Field(ge=0, description="limit of each of the two equilibrations; 0: start as it is; ours"),
    ] = 100_000


DECIDED_BY_FILE = ("discs", "packing_fraction", "size_ratio")


class Packing(Section):
    """Which discs there are and where they start."""

    start: Annotated[
        Literal["random", "hexagonal", "file"],
        Field(
            description="uniform random positions, a hexagonal crystal, or a start file (section 6)"
        ),
    ] = "random"
    discs: Annotated[int, Field(ge=1, le=MAX_DISCS, description="N; ⌈N/2⌉ are large; S2-1")] = 150
    packing_fraction: Annotated[
        float,
        Field(gt=0, le=2.5, description="φ = Σ π r_i² / cell area [-], not in percent; S1-14"),
        PERCENT,
    ] = 1.5
    size_ratio: Annotated[
        float, Field(ge=1, le=5, description="large radius / small radius; S2-1")
    ] = 1.4
    density: Annotated[float, Field(gt=0, description="ρ of a disc [kg/m³]; S2-1")] = 1000.0
    columns: Annotated[
        int | None,
        Field(ge=1, description="hexagonal start: discs per row (rows = discs / columns); ours"),
    ] = None
    file: Annotated[
        Path | None,
        Field(
            strict=False,
            description="start: file. Table (.csv, .parquet) or state (.npz), beside the study; "
            "ours",
        ),
    ] = None
    file_digest: Annotated[
        str | None, Field(description="SHA-256 of the start file; filled in when the study is read")
    ] = None
    equilibration: Equilibration = Equilibration()

    @model_serializer(mode="wrap")
    def _what_counts(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what a start file decides: no table or id shall hold a default in its place."""
        values: dict[str, Any] = dump(self)
        if self.start == "file":
            values = {name: v for name, v in values.items() if name not in DECIDED_BY_FILE}
        return values

    @model_validator(mode="after")
    def _agree_with_the_start(self) -> Self:
        problems = []
        if self.start == "hexagonal":
            if self.size_ratio != 1:
                problems.append(
                    (
                        ("size_ratio", "start"),
                        "a hexagonal crystal has discs of one size: write packing.size_ratio: 1",
                    )
                )
            if self.columns is None:
                problems.append(
                    (("columns", "start"), "start: hexagonal needs packing.columns, discs per row")
                )
            elif self.discs % self.columns:
                full = self.columns * (self.discs // self.columns + 1)
                message = f"{self.discs} discs do not fill rows of {self.columns}: "
                problems.append((("columns", "discs"), f"{message}packing.discs: {full}?"))
        elif self.columns is not None:
            problems.append(
                (
                    ("columns", "start"),
                    f"only a hexagonal start has columns, not start: {self.start}",
                )
            )
        if self.start == "file":
            if self.file is None and self.file_digest is None:
                problems.append((("file", "start"), "start: file needs packing.file"))
            fields = type(self).model_fields
            problems.extend(
                ((name, "start"), f"start: file takes {name} from the file: leave {name} out")
                for name in ("discs", "packing_fraction", "size_ratio")
                if getattr(self, name) != fields[name].default
            )
        elif self.file is not None or self.file_digest is not None:
            problems.append(
                (("file", "start"), f"is read with start: file only, not start: {self.start}")
            )
        if problems:
            raise Impossible(problems)
        return self


class Start(NamedTuple):
    """N discs before they are brought to rest, in a cell whose height is known now."""

    position: FloatArray  # (N, 2) [m]
    radius: FloatArray  # (N,) [m]
    width: float  # [m]
    height: float  # [m]


def content_digest(path: Path, content: bytes) -> str:
    """Return the SHA-256 of a start file: of its kind, which its suffix tells, and its bytes."""
    return hashlib.sha256(path.suffix.encode() + b"\0" + content).hexdigest()


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


def check_cell(cell: Cell, packing: Packing) -> None:
    """Refuse a cell whose images do not fit the discs.

    Raises
    ------
    Impossible
        If the shorter side is under four large radii (a disc could touch a neighbour and one of
        its images at once), or a crystal has an odd number of rows or another height than
        theirs. A start file is checked when it is read.
    """
    if cell.boundary == "open" or packing.start == "file":
        return
    if packing.start == "hexagonal" and cell.height is not None:
        message = "leave cell.height out: a hexagonal start has the height of its rows"
        raise Impossible([(("cell.height", "packing.start"), message)])
    if packing.columns is not None and (rows := packing.discs // packing.columns) % 2:
        message = (
            f"{packing.discs} discs make {rows} rows; every second row is shifted, so the images "
            f"fit an even number only: packing.discs: {packing.discs + packing.columns}?"
        )
        raise Impossible([(("packing.columns", "packing.discs", "packing.start"), message)])
    height = cell_height(packing, cell)
    side = min(cell.width, height)
    area = cell.width * height
    large = float(radii(packing, area)[0])
    if side >= 4 * large:
        return
    # R_large² is proportional to φ and, but for the odd disc, to 1/N.
    excess = (4 * large / side) ** 2
    fraction = math.floor(1000 * packing.packing_fraction / excess) / 1000
    advice = f"packing.packing_fraction at most {fraction:g}"
    discs = math.ceil(packing.discs * excess)
    if packing.start == "random" and discs < MAX_DISCS:
        while radii(packing.model_copy(update={"discs": discs}), area)[0] > side / 4:
            discs += 1
        advice = f"packing.discs at least {discs}, or {advice}"
    name = "width" if cell.width <= height else "height"
    message = (
        f"the shorter side of the cell (its {name}, {side:.4g} m) is under four large radii "
        f"({4 * large:.4g} m), so two discs could touch twice: {advice}, or a less narrow cell"
    )
    keys = ("discs", "packing_fraction", "size_ratio", "columns", "start")
    sides = (f"cell.{name}", "cell.width", "cell.height", "cell.boundary")
    raise Impossible([((*(f"packing.{key}" for key in keys), *sides), message)])


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
    closest = 1e-6 * radius.min()
    while len(
        close := KDTree(position, boxsize=np.array([width, height])).query_pairs(
            closest, output_type="ndarray"
        )
    ):
        position[close[:, 0]] = rng.random((len(close), 2)) * (width, height)
    return Start(position, radius, width, height)
