"""The sections of a study of soft particles: every physical parameter, its unit and its limits."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from shear_sim.models.interface import Point
from shear_sim.models.soft_particle.driving import (
    Bending,
    Compaction,
    DiametralCompression,
    OuterPressure,
    SoftParticleOscillatoryShear,
    SoftParticleShear,
    Tension,
    Vibration,
)
from shear_sim.models.soft_particle.stability import at_most, longest_share
from shear_sim.protocol import Snapshots, check_snapshots
from shear_sim.schema import PERCENT, Impossible, Positive, Section

PACKING_FRACTION = 0.95  # of a suspension
LARGEST_SPREAD = 2.5  # standard deviations at which radii are cut
#: ℓ / half the gap between plates. A coarser fold has errors of 20 to 40 % of the force; under
#: ``FINE`` they are below 4 %: analysis/soft_diametral.md.
COARSEST, FINE = 1.0, 0.4
#: Keys of the model that a scenario does not use: nothing touches, or without friction and losses.
_CONTACTS = ("friction", "tangential_ratio", "contact_damping")
_WITHOUT_EFFECT = {"bending": _CONTACTS, "pressure": _CONTACTS, "vibration": _CONTACTS}


class SoftParticleCell(Section):
    """What happens at the edges of the cell of a suspension."""

    boundary: Annotated[
        Literal["lees_edwards", "plates"],
        Field(
            description="lees_edwards: sheared periodic cell. plates: rings that cross its lower "
            "edge are glued to a rigid rough plate there, whose image is the other one; ours"
        ),
    ] = "lees_edwards"


class SoftParticlePacking(Section):
    """Which particles there are: one ring, a box of them, a suspension, or a tissue."""

    particles: Annotated[
        int,
        Field(
            ge=1,
            le=100_000,
            description="rings; more than one: in a box or a cell, or of a tissue; section 5",
        ),
    ] = 1
    packing_fraction: Annotated[
        float | None,
        Field(
            gt=0.7,
            le=1.5,
            exclude_if=lambda value: value is None,
            description="φ of a suspension: Σ (A + P r + π r²) of its rings at rest, A and P of "
            "mid-lines / area of the cell [-], not in percent. Default: 0.95; ours",
        ),
        PERCENT,
    ] = None
    spread: Annotated[
        float,
        Field(
            ge=0,
            le=0.3,
            description="ΔR/R: standard deviation of radii, normal, cut at 2.5; section 5",
        ),
        PERCENT,
    ] = 0.0
    preparation: Annotated[
        Literal["discs", "gravity", "tissue"],
        Field(
            description="of a box. discs: the densest random packing of discs without friction. "
            "gravity: rings that fell into it, and yielded nowhere; section 5. tissue: the cells "
            "of these discs, which fill it; section 6"
        ),
    ] = "discs"
    rigid_share: Annotated[
        float,
        Field(
            ge=0,
            lt=1,
            exclude_if=lambda value: value == 0,
            description="of the particles of a box, picked at random, that keep their shape; "
            "section 2.4",
        ),
        PERCENT,
    ] = 0.0
    vertices: Annotated[
        int,
        Field(
            ge=8,
            le=2000,
            multiple_of=4,
            description="N of a ring, mass points: a multiple of 4 has a segment at each of two "
            "plates; cells have segments as long; section 2.1",
        ),
    ] = 100
    radius: Annotated[
        float,
        Field(gt=0, le=10, description="R of the mid-line of the shell, the mean [m]; paper (19)"),
    ] = 1e-3

    @model_validator(mode="after")
    def _one_ring_is_of_one_size(self) -> Self:
        if self.particles == 1:
            keys = {
                "spread": self.spread > 0,
                "preparation": self.preparation != "discs",
                "rigid_share": self.rigid_share > 0,
            }
            message = "has no effect on a single ring"
            if any(keys.values()):
                raise Impossible([((key, "particles"), message) for key in keys if keys[key]])
        return self


class SoftLinks(Section):
    """Cohesive links at the two ends of every interface of a tissue, which break for good."""

    strength: Annotated[
        float | None,
        Field(
            gt=0,
            description="f_n⁰ R²/EI: breaks where f_n/f_n⁰ + |f_t/f_t⁰|^α = 1; null: by toughness; "
            "paper (39)",
        ),
    ] = 1.0
    shear_strength: Annotated[Positive, Field(description="f_t⁰ / f_n⁰; paper (39)")] = 1.0
    exponent: Annotated[float, Field(ge=1, le=10, description="α; paper (39)")] = 2.0
    toughness: Annotated[
        float | None,
        Field(
            gt=0,
            description="G_c R²/EI instead: both links of an interface break where the sum of "
            "their energies is G_c times its length; ours",
        ),
    ] = None
    stiffness: Annotated[
        float, Field(gt=0, le=10, description="k_n of links / of contacts; section 6")
    ] = 0.1
    tangential_stiffness: Annotated[
        float, Field(gt=0, le=10, description="k_t of links / k_n of contacts; section 6")
    ] = 0.1

    @model_validator(mode="after")
    def _break_by_one_criterion(self) -> Self:
        if (self.strength is None) == (self.toughness is None):
            message = (
                "links break by their strength or by their toughness: give one, and null for the "
                "other"
            )
            raise Impossible([(("toughness", "strength"), message)])
        return self

    @model_validator(mode="after")
    def _have_an_effect(self) -> Self:
        fields = type(self).model_fields
        problems = [
            ((name, "toughness"), f"{name} has no effect on links that break by their toughness")
            for name in ("shear_strength", "exponent")
            if self.toughness is not None and getattr(self, name) != fields[name].default
        ]
        if problems:
            raise Impossible(problems)
        return self


class SoftParticle(Section):
    """Elasto-plastic shells around cores (Trivino et al.)."""

    kind: Literal["soft_particle"] = "soft_particle"
    young_modulus: Annotated[Positive, Field(description="E of the shell [Pa]; SP.1")] = 1e6
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5, description="ν of the shell; SP.1")] = 0.0
    thickness: Annotated[float, Field(gt=0, le=0.5, description="h / R; SP.1")] = 0.05
    density: Annotated[
        Positive, Field(description="mass of a particle / its area π R² [kg/m³]; section 2.4")
    ] = 1000.0
    core: Annotated[
        Literal["none", "elastic", "drained", "gas", "log"],
        Field(
            description="pressure of the core: elastic p₀ − K ΔA/A₀, drained p₀, gas p₀ A₀/A, "
            "log p₀ − K ln(A/A₀); SP.5"
        ),
    ] = "log"
    core_ratio: Annotated[
        float,
        Field(
            ge=0, le=1e4, description="η = K_Ω / (k_s tan(π/N)); 100 is incompressible; paper (24)"
        ),
    ] = 0.0
    core_pressure: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            exclude_if=lambda value: value == 0,
            description="p₀ / (k_s tan(π/N)), with the bars of the ring tense by as much: turgor "
            "of a particle at rest; K_Ω of a gas; ours",
        ),
    ] = 0.0
    yield_moment: Annotated[
        float | None,
        Field(
            ge=1e-5, description="M^Y / M*, M* = E h³/12 (1 − ν²) R; none: hinges never yield; SP.4"
        ),
    ] = None
    yield_force: Annotated[
        float | None,
        Field(
            gt=0,
            description="F_s^Y (1 − ν²)/E h, which is σ^Y (1 − ν²)/E by paper (12); none: bars "
            "never yield; SP.3",
        ),
    ] = None
    friction: Annotated[float, Field(ge=0, le=10, description="Coulomb μ of contacts; SP.7")] = 0.0
    contact_stiffness: Annotated[
        float, Field(gt=0, le=1000, description="k_n / (k_b/ℓ²) of the shell; SP.6")
    ] = 10.0
    tangential_ratio: Annotated[
        float,
        Field(
            gt=0,
            le=1,
            exclude_if=lambda value: value == 1,
            description="k_t / k_n of contacts, k_t also at walls; SP.7",
        ),
    ] = 1.0
    damping: Annotated[
        float,
        Field(ge=0, le=1, description="of bars and hinges, fraction of critical; ours"),
        PERCENT,
    ] = 0.2
    contact_damping: Annotated[
        float, Field(ge=0, le=1, description="of contacts, fraction of critical; ours"), PERCENT
    ] = 0.0
    inner_damping: Annotated[
        float,
        Field(ge=0, le=2, description="drag of a vertex against its own particle / (m ω₁); ours"),
    ] = 0.0
    drag: Annotated[
        float,
        Field(
            ge=0, le=2, description="of a vertex / (m ω₁), ω₁ the slowest vibration of a ring; ours"
        ),
    ] = 0.1
    links: Annotated[
        SoftLinks | None,
        Field(
            exclude_if=lambda value: value is None,
            description="cohesive, between the cells of a tissue; section 6",
        ),
    ] = None


class SoftParticleIntegrator(Section):
    """Steps in time."""

    step: Annotated[
        float,
        Field(gt=0, le=0.9, description="δt / the longest stable one, from all stiffnesses; SP.10"),
    ] = 0.2


class SoftParticleRecord(Section):
    """How often a record is made."""

    rows: Annotated[
        int | None,
        Field(
            ge=10,
            le=100_000,
            description="records; default 200 in diametral compression, 100 in compaction; twice "
            "that if unloaded; 400 in tension, 200 per period in oscillatory shear, 20 in a "
            "vibration, 50 in bending; ours",
        ),
    ] = None
    snapshots: Snapshots = None


class SoftParticlePoint(Point):
    """One simulation of soft particles."""

    cell: Annotated[SoftParticleCell, Field(exclude_if=lambda cell: cell == SoftParticleCell())] = (
        SoftParticleCell()
    )
    packing: SoftParticlePacking = SoftParticlePacking()
    model: SoftParticle = SoftParticle()
    shear: SoftParticleShear = DiametralCompression()
    integrator: SoftParticleIntegrator = SoftParticleIntegrator()
    record: SoftParticleRecord = SoftParticleRecord()

    @property
    def kind(self) -> str:
        """Name of the model."""
        return self.model.kind

    @property
    def random(self) -> bool:
        """Single rings and beams are not."""
        return self.packing.particles > 1

    def resolved(self) -> Self:
        """Return the point with its number of records and packing fraction filled in."""
        packing, shear = self.packing, self.shear
        if isinstance(shear, SoftParticleOscillatoryShear):
            fraction = packing.packing_fraction or PACKING_FRACTION
            packing = packing.model_copy(update={"packing_fraction": fraction})
        per_unit = {"compaction": 100, "tension": 400, "vibration": 20, "bending": 50}.get(
            shear.kind, 200
        )
        rows = self.record.rows or per_unit * self._units
        record = self.record.model_copy(update={"rows": rows})
        return self.model_copy(update={"record": record, "packing": packing})

    @property
    def _units(self) -> int:
        """Periods, or strokes."""
        shear = self.shear
        if isinstance(shear, SoftParticleOscillatoryShear | Vibration):
            return shear.periods
        if isinstance(shear, DiametralCompression | Compaction):
            return shear.strokes
        return 1

    @model_validator(mode="after")
    def _keep_snapshots_within_the_run(self) -> Self:
        rows = self.resolved().record.rows or 0
        check_snapshots(self.record.snapshots, 0.0, self._units, rows / self._units)
        return self

    @model_validator(mode="after")
    def _one_ring_a_box_or_a_cell(self) -> Self:
        sheared = isinstance(self.shear, SoftParticleOscillatoryShear)
        needed = {
            "compaction": "a compaction needs a box of rings",
            "oscillatory": "a suspension needs rings",
            "tension": "a tension needs the cells of a tissue",
        }
        if (self.shear.kind in needed) != (self.packing.particles > 1):
            message = (
                f"{needed[self.shear.kind]}, and only it: packing.particles = 500, say"
                if self.shear.kind in needed
                else "a box of rings needs shear.kind: compaction (a suspension oscillatory, a "
                "tissue tension)"
            )
            raise Impossible([(("packing.particles", "shear.kind"), message)])
        keys = {
            "packing.packing_fraction": self.packing.packing_fraction is not None and not sheared,
            "cell.boundary": self.cell.boundary != "lees_edwards" and not sheared,
            "packing.preparation": self.packing.preparation == "gravity" and sheared,
        }
        if any(keys.values()):
            only = "a suspension (shear.kind: oscillatory)"
            message = f"has no effect on {only}" if sheared else f"is for {only} only"
            raise Impossible([((key, "shear.kind"), message) for key in keys if keys[key]])
        if self.packing.rigid_share > 0 and self.shear.kind != "compaction":
            message = "rigid particles are for a box under a lid (shear.kind: compaction) only"
            raise Impossible([(("packing.rigid_share", "shear.kind"), message)])
        return self

    @model_validator(mode="after")
    def _have_an_effect(self) -> Self:
        kind, fields = self.shear.kind, SoftParticle.model_fields
        problems = []
        for name in _WITHOUT_EFFECT.get(kind, ()):
            value = getattr(self.model, name)
            if value != fields[name].default:
                message = (
                    f"{name}: {value:g} has no effect with shear.kind: {kind}: set it only in the "
                    "scenes that need it"
                )
                problems.append(((f"model.{name}", "shear.kind"), message))
        if problems:
            raise Impossible(problems)
        return self

    @model_validator(mode="after")
    def _touch_no_image(self) -> Self:
        if not isinstance(self.shear, SoftParticleOscillatoryShear):
            return self
        packing = self.resolved().packing
        largest = 1.0 + min(LARGEST_SPREAD * packing.spread, 1.0)
        # Mean radii; a ring may be drawn out to twice its width.
        fewest = math.ceil((packing.packing_fraction or 0.0) * (4.0 * largest) ** 2 / math.pi)
        if packing.particles < fewest:
            message = (
                f"in a cell of {packing.particles} rings one could touch its own image: at least "
                f"{fewest}"
            )
            raise Impossible([(("packing.particles",), message)])
        return self

    @model_validator(mode="after")
    def _resolve_every_period(self) -> Self:
        shear, rows = self.shear, self.record.rows
        if not isinstance(shear, SoftParticleOscillatoryShear) or rows is None:
            return self
        if rows < 20 * shear.periods or rows % shear.periods:
            message = (
                f"{rows} records of {shear.periods} periods: G′ and G″ are read with nine "
                f"harmonics and need 20 or more in each, as many in all: {20 * shear.periods}, say"
            )
            raise Impossible([(("record.rows", "shear.periods"), message)])
        return self

    @model_validator(mode="after")
    def _pull_linked_tissues(self) -> Self:
        pulled = isinstance(self.shear, Tension)
        tissue = self.packing.preparation == "tissue"
        if pulled != tissue:
            message = (
                "only a tissue can be pulled: packing.preparation = tissue"
                if pulled
                else "a tissue needs shear.kind: tension"
            )
            raise Impossible([(("packing.preparation", "shear.kind"), message)])
        if pulled != (self.model.links is not None):
            message = (
                "a tissue without links falls apart: model.links = {strength: 1}, say"
                if pulled
                else "only a tissue has links: leave them out, or shear.kind = tension"
            )
            raise Impossible([(("model.links", "shear.kind"), message)])
        return self

    @model_validator(mode="after")
    def _have_a_core(self) -> Self:
        model, keys = self.model, ("model.core_ratio", "model.core_pressure")
        given = [key for key in keys if getattr(model, key.removeprefix("model.")) > 0]
        if isinstance(self.shear, Bending) and given:
            message = "a beam is open and has no core: leave it out"
            raise Impossible([((key, "shear.kind"), message) for key in given])
        if model.core == "none" and given:
            message = "a particle without a core has no {}: leave one of both out"
            raise Impossible(
                [((key, "model.core"), message.format(key.removeprefix("model."))) for key in given]
            )
        if model.core in ("drained", "gas"):
            if model.core_ratio > 0:
                message = (
                    "a drained core has no stiffness, and that of a gas is its pressure: leave "
                    "core_ratio out, or core: log"
                )
                raise Impossible([(("model.core_ratio", "model.core"), message)])
            if model.core_pressure == 0:
                message = (
                    f"a {model.core} core is nothing without its pressure: core_pressure = 0.01, "
                    "say"
                )
                raise Impossible([(("model.core", "model.core_pressure"), message)])
        elif model.core_pressure > 0 and model.core_ratio == 0:
            message = "a pressure that does not change is core: drained; or give a core_ratio"
            raise Impossible([(("model.core_pressure", "model.core"), message)])
        return self

    @model_validator(mode="after")
    def _be_at_rest_under_the_pressure(self) -> Self:
        pressure = self.model.core_pressure
        if pressure == 0:
            return self
        if isinstance(self.shear, OuterPressure | Tension):
            message = (
                "only what is inside less what is outside counts: leave core_pressure out"
                if isinstance(self.shear, OuterPressure)
                else "cells with corners are not at rest under a pressure, rings are: leave "
                "core_pressure out"
            )
            raise Impossible([(("model.core_pressure", "shear.kind"), message)])
        limit = self.model.yield_force
        if limit is not None and limit <= 0.5 * pressure:
            message = (
                f"the bars bear half of core_pressure at rest, and yield: yield_force over "
                f"{0.5 * pressure:g}"
            )
            raise Impossible([(("model.yield_force", "model.core_pressure"), message)])
        return self

    @model_validator(mode="after")
    def _keep_segments_apart(self) -> Self:
        segment = 2 * math.sin(math.pi / self.packing.vertices)
        if self.model.thickness > 3 * segment:
            message = (
                f"the shell (h = {self.model.thickness:g} R) is more than three times as thick as "
                f"a segment is long ({segment:.3g} R), which no bar is: fewer vertices, or a "
                "thinner shell"
            )
            raise Impossible([(("model.thickness", "packing.vertices"), message)])
        return self

    @model_validator(mode="after")
    def _resolve_the_folds(self) -> Self:
        shear, vertices = self.shear, self.packing.vertices
        if not isinstance(shear, DiametralCompression):
            return self
        ratio = shear.fold_ratio(vertices)
        if ratio > COARSEST:
            message = (
                f"a ring of {vertices} vertices, pressed by {shear.compression:g}, folds around "
                f"half a gap of {1.0 / ratio:.2g} segments, and its force may be wrong by over "
                f"20 %: packing.vertices = {_enough(shear, COARSEST)} at least "
                f"({_enough(shear, FINE)} for 4 %), or less compression"
            )
            raise Impossible([(("packing.vertices", "shear.compression"), message)])
        return self

    @model_validator(mode="after")
    def _have_a_stable_step(self) -> Self:
        step, longest = self.integrator.step, longest_share(self.model, self.packing.vertices)
        if step > longest:
            keys = ("integrator.step", "model.damping", "model.inner_damping", "model.drag")
            message = (
                f"steps of {step:g} of the longest one that is stable without dashpots are not "
                f"stable with these: integrator.step = {at_most(longest)} at most, or less damping"
            )
            raise Impossible([(keys, message)])
        return self


def _enough(shear: DiametralCompression, ratio: float) -> int:
    """Return the fewest vertices, a multiple of 4, whose ``fold_ratio`` is ``ratio`` at most."""
    least = math.pi / math.atan(0.5 * ratio * (1.0 - shear.compression))
    return 4 * math.ceil(least / 4 * (1.0 - 1e-9))
