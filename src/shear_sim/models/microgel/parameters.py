"""The sections of a microgel study: every physical parameter, its unit and its limits."""

import ast
import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from shear_sim.models.interface import Point
from shear_sim.packing import Cell, Packing, check_cell
from shear_sim.protocol import OscillatoryShear, Shear, Snapshots, check_snapshots
from shear_sim.schema import (
    PERCENT,
    Fraction,
    Impossible,
    NonNegative,
    Positive,
    Section,
    default_kind,
)

Repulsion = Annotated[
    Fraction, Field(description="weight of the divergent part: 0 is linear, 1 is S1-5b; S2-1")
]


class LinearLaw(Section):
    """F = k Δx, eq. S1-5a."""

    kind: Literal["linear"]


class DivergentLaw(Section):
    """F = k Δx / (1 − Δx/D), eq. S1-5b, at most 1000 k D (S1-6)."""

    kind: Literal["divergent"] = "divergent"
    repulsion: Repulsion = 1.0


class PlateauLaw(Section):
    """Sponge-like discs: a softer slope between two distances, section 4.3.3 of part 2."""

    kind: Literal["plateau"]
    begin: Annotated[
        float, Field(gt=0, lt=1, description="lower end of the plateau, d/D; section 4.3.3")
    ] = 0.3
    end: Annotated[
        float, Field(gt=0, le=1, description="upper end of the plateau, d/D; section 4.3.3")
    ] = 0.8
    slope: Annotated[
        float, Field(ge=0, le=1, description="slope relative to the linear law; section 4.3.3")
    ] = 0.1
    repulsion: Repulsion = 1.0

    @model_validator(mode="after")
    def _begin_before_the_end(self) -> Self:
        if self.begin > self.end:
            message = f"begin {self.begin:g} is above end {self.end:g}: distances d/D, begin <= end"
            raise Impossible([(("begin", "end"), message)])
        return self


class HertzLaw(Section):
    """F = 1.1 E R^(−1/2) Δx^(3/2), R = (r_i + r_j)/2, eq. S1-13."""

    kind: Literal["hertz"]


class CustomLaw(Section):
    """The user's own law: one Python function in a file beside the study.

    ``def contact_force(distance, contact_distance, stiffness, repulsion)`` returns the force
    (negative is repulsive), as the call-back of section 4.3.2 of part 2.
    """

    kind: Literal["custom"]
    file: Annotated[
        Path | None,
        Field(strict=False, description="Python file beside the study file; section 4.3.2"),
    ] = None
    source: Annotated[
        str | None, Field(description="its text; filled in when the study is read")
    ] = None
    repulsion: Repulsion = 1.0

    @model_validator(mode="after")
    def _define_contact_force(self) -> Self:
        if self.file is None and self.source is None:
            raise Impossible([(("file", "kind"), "kind: custom needs file: the law's Python file")])
        if self.source is not None and (fault := fault_of_law(self.source)):
            raise Impossible([(("file", "source"), fault)])
        return self


def fault_of_law(source: str) -> str | None:
    """Return what is wrong with the text of a user's contact law, without running it."""
    signature = "contact_force(distance, contact_distance, stiffness, repulsion)"
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        at = f"line {line}" if line else "the file"
        return f"{at} is not Python ({getattr(error, 'msg', None) or error})"
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef) and statement.name == "contact_force":
            arguments = statement.args
            if (
                len(arguments.posonlyargs) + len(arguments.args) == 4
                and not arguments.kwonlyargs
                and arguments.vararg is None
                and arguments.kwarg is None
            ):
                return None
            return f"line {statement.lineno}: must be `def {signature}`, four arguments"
    return f"must define `def {signature}` at its top level"


ContactLaw = Annotated[
    LinearLaw | DivergentLaw | PlateauLaw | HertzLaw | CustomLaw,
    Field(discriminator="kind"),
    default_kind("divergent"),
]

# What a way of cutting leaves without effect. Such options must keep their defaults, so that two
# jobs of the same physics have the same id.
_CUTTING = (
    "cuts",
    "edge_fuzziness",
    "avoid_angle",
    "cut_top_bottom",
    "avoid_height_spanning",
    "remove_fraction",
    "join_isolated",
)
_WITHOUT_EFFECT: dict[str, tuple[str, ...]] = {
    "cells": ("avoid_angle",),
    "lines": ("edge_fuzziness",),
    "bulk": ("cuts", "edge_fuzziness", "avoid_angle", "avoid_height_spanning"),
    "file": _CUTTING,
    "none": (
        *_CUTTING,
        "normal_factor",
        "tangential_factor",
        "stretched_tangential_dashpot",
    ),
}


class Links(Section):
    """Permanent crosslinks between touching discs, and how they are cut into particles."""

    cut: Annotated[
        Literal["cells", "lines", "bulk", "none", "file"],
        Field(
            description="cells of random points, straight lines, bulk (one uncut network), none "
            "(no links: loose discs), file (the links of the start file); S2-1"
        ),
    ] = "cells"
    cuts: Annotated[int, Field(ge=1, description="number of random points or of lines; S2-1")] = 5
    edge_fuzziness: Annotated[
        NonNegative, Field(description="cells: noise on the distances, in large radii; S2-1")
    ] = 0.0
    avoid_angle: Annotated[
        float,
        Field(ge=0, lt=90, description="lines: smallest angle to the horizontal [degrees]; S2-1"),
    ] = 15.0
    cut_top_bottom: Annotated[
        bool, Field(description="also cut along the top and bottom edge; S2-1")
    ] = False
    avoid_height_spanning: Annotated[
        bool, Field(description="draw the cut again while a particle spans the cell's height; S2-1")
    ] = True
    remove_fraction: Annotated[
        Fraction,
        Field(
            description="fraction to remove of the links that no particle needs to stay whole; S2-1"
        ),
    ] = 0.0
    join_isolated: Annotated[
        bool, Field(description="link a disc without links to a neighbour; ours")
    ] = True
    normal_factor: Annotated[Positive, Field(description="k of links / k; ours")] = 1.0
    tangential_factor: Annotated[Positive, Field(description="k_T of links / k_T; ours")] = 1.0
    stretched_tangential_dashpot: Annotated[
        bool, Field(description="tangential dashpot of links longer than r_i + r_j; ours")
    ] = True

    @model_validator(mode="after")
    def _have_an_effect(self) -> Self:
        fields = type(self).model_fields
        without = f"has no effect with cut: {self.cut}: set it only in the scenes that need it"
        problems = [
            ((name, "cut"), f"{name}: {getattr(self, name)} {without}")
            for name in _WITHOUT_EFFECT[self.cut]
            if getattr(self, name) != fields[name].default
        ]
        if problems:
            raise Impossible(problems)
        return self


class Contacts(Section):
    """Reinforcement of the transient contacts against the links."""

    normal_factor: Annotated[Positive, Field(description="k of contacts / k; S2-1")] = 1.0
    tangential_factor: Annotated[Positive, Field(description="k_T of contacts / k_T; S2-1")] = 1.0


class Damping(Section):
    """Drag of the suspending fluid, relative to the affine flow (section 5.3 of part 1)."""

    decay: Annotated[
        float,
        Field(gt=0, le=1, description="factor on the velocity per period T; 1 is none; S2-1"),
        PERCENT,
    ] = 0.5
    spin: Annotated[
        Literal["flow", "zero", "none"],
        Field(description="spins decay towards the flow's rotation −γ̇/2, towards 0, or not; ours"),
    ] = "flow"


class Microgel(Section):
    """Discs with visco-elastic frictional contacts and permanent links (manual, part 1)."""

    kind: Literal["microgel"] = "microgel"
    young_modulus: Annotated[float, Field(gt=0, description="E [Pa]; k = π E / 8, eq. S1-8")] = (
        8000.0
    )
    friction: Annotated[
        float, Field(ge=0, description="Coulomb μ [-], of contacts, not of links; S1-1b")
    ] = 0.01
    relative_viscosity: Annotated[NonNegative, Field(description="η / √(⟨m⟩ k) [-], eq. S1-9")] = (
        0.1
    )
    tangential_ratio: Annotated[
        NonNegative, Field(description="k_T / k = η_T / η [-], section 5.1")
    ] = 1.0
    contact_law: ContactLaw = DivergentLaw()
    sliding: Annotated[
        Literal["coulomb", "reset"],
        Field(
            description="coulomb: a sliding contact keeps its spring on the Coulomb surface. "
            "reset: the historical two-visit rule (S1-1b)"
        ),
    ] = "coulomb"
    lever_arms: Annotated[
        Literal["conjugate", "particleshear", "otsuki2017"],
        Field(
            description="arms in torque and rolling velocity. conjugate: contact arms in both (eq. "
            "S1-3). particleshear: contact arms and nominal radii. otsuki2017: nominal radii in "
            "both, which loses angular momentum (eq. S1-2)"
        ),
    ] = "conjugate"
    dashpot: Annotated[
        Literal["attractive", "no_attraction"],
        Field(description="whether the normal dashpot of a separating contact may pull; ours"),
    ] = "attractive"
    contacts: Contacts = Contacts()
    links: Links = Links()
    scale_viscosity: Annotated[
        bool,
        Field(
            description="dashpots of reinforced contacts and links scale with their springs; S2-1"
        ),
    ] = True
    damping: Damping = Damping()
    drive: Annotated[
        Literal["affine", "boundary"],
        Field(
            description="affine: SLLOD, every disc follows a change of rate. boundary: only the "
            "edges drive (half a shear wave fits in the cell), section 5.3"
        ),
    ] = "affine"


class Integrator(Section):
    """How the equations of motion are stepped."""

    scheme: Annotated[
        Literal["velocity_verlet", "semi_implicit_euler"],
        Field(description="second order, ours; first order, as particleShear"),
    ] = "velocity_verlet"
    steps_per_period: Annotated[
        int | None,
        Field(
            ge=10,
            description="whole steps per T, one record each (record.every). Default: 240, or as "
            "many as make them 0.4 τ; they are halved where contacts, dashpots or the flow need "
            "it. n times as many also make the halves n times finer; fewer do not coarsen them; "
            "ours",
        ),
    ] = None


class Record(Section):
    """What is written to the result table, and how often."""

    every: Annotated[int, Field(ge=1, description="steps between records; ours")] = 1
    energy: Annotated[
        bool,
        Field(description="also the energy balance, at some cost, and on one core only; ours"),
    ] = False
    columns: Annotated[
        tuple[str, ...] | None,
        Field(strict=False, description="stored columns by name; default: all; ours"),
    ] = None
    snapshots: Snapshots = None


class MicrogelPoint(Point):
    """One microgel simulation."""

    cell: Cell = Cell()
    packing: Packing = Packing()
    model: Microgel = Microgel()
    shear: Shear = OscillatoryShear()
    integrator: Integrator = Integrator()
    record: Record = Record()

    @property
    def kind(self) -> str:
        """Name of the model."""
        return self.model.kind

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        check_cell(self.cell, self.packing)
        if self.model.links.cut == "file" and self.packing.start != "file":
            message = f"cut: file needs start: file, whose links it takes, not {self.packing.start}"
            raise Impossible([(("model.links.cut", "packing.start"), message)])
        if problems := self._unresolved_records() + self._too_few_steps():
            raise Impossible(problems)
        shear = self.shear
        unit = 1.0 if isinstance(shear, OscillatoryShear) else shear.strain / shear.periods
        first, last = -shear.pre_periods, shear.periods + shear.post_periods
        records = self.steps_per_period / self.record.every / unit
        check_snapshots(
            self.record.snapshots, first * unit, last * unit, records,
            ("record.every", "integrator.steps_per_period"),
        )  # fmt: skip
        return self

    @property
    def steps_per_period(self) -> int:
        """Whole steps per period T: as given, else 0.4 τ each and at least 240.

        The substeps keep the error (analysis/default_steps.py); with as many records |G*| and nine
        harmonics of all three tensors are those of the motion (analysis/record_rate.py).
        """
        return self.integrator.steps_per_period or self._default_steps

    @property
    def _default_steps(self) -> int:
        return max(240, math.ceil(2.5 / self.shear.relative_frequency))

    @property
    def refinement(self) -> float:
        """How many times shorter than by default the longest substeps are, at least 1."""
        return max(1.0, self.steps_per_period / self._default_steps)

    def _too_few_steps(self) -> list[tuple[tuple[str, ...], str]]:
        """Return the complaint on a shear that whole steps cannot resolve to a percent."""
        steps = self.shear.periods * self.steps_per_period
        if abs(steps - round(steps)) <= 0.01 * steps:
            return []
        needed = math.ceil(self.steps_per_period * 50 / steps)
        message = f"the shear takes {steps:.3g} steps: at least {needed} steps per period"
        keys = ("shear.strain", "shear.relative_rate", "shear.periods", "shear.relative_frequency")
        return [(("integrator.steps_per_period", *keys), message)]

    def _unresolved_records(self) -> list[tuple[tuple[str, ...], str]]:
        """Return the complaint on records too rare for the nine harmonics of the moduli."""
        steps = self.steps_per_period
        if self.shear.kind != "oscillatory" or steps >= 20 * self.record.every:
            return []
        message = (
            f"one record every {self.record.every} of {steps} steps per period: G′ and G″ are read "
            f"with nine harmonics and need 20 records a period: at most {max(1, steps // 20)}"
        )
        keys = ("integrator.steps_per_period", "shear.relative_frequency", "shear.kind")
        return [(("record.every", *keys), message)]

    def check_files(self) -> None:
        """Check the contents of the start file; see `Point.check_files`."""
        if self.packing.start != "file":
            return
        from shear_sim.models.microgel.startfile import read_start

        try:
            given = read_start(self.packing, self.cell)
        except ValueError as error:
            raise Impossible([(("packing.file",), str(error))]) from None
        links = len(given.links.i)
        if (links > 0) != (self.model.links.cut == "file"):
            message = (
                f"links of a start file are used with cut: file, and only then: "
                f"{self.packing.file} has {links}"
            )
            raise Impossible([(("model.links.cut", "packing.file"), message)])

    def resolved(self) -> Self:
        """Return the point with its number of steps and the height of its cell filled in."""
        steps = self.integrator.model_copy(update={"steps_per_period": self.steps_per_period})
        cell = self.cell
        if cell.height is None and self.packing.start != "hexagonal":  # a crystal has its own
            cell = cell.model_copy(update={"height": cell.width})
        return self.model_copy(update={"integrator": steps, "cell": cell})

    @property
    def recorded(self) -> tuple[str, ...] | None:
        """Stored columns that the result table shall hold, time and strain always; None: all."""
        chosen = self.record.columns
        return None if chosen is None else tuple(dict.fromkeys(("time", "strain", *chosen)))
