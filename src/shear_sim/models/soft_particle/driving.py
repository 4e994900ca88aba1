"""What is done to soft particles: the section ``shear`` of a study."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from shear_sim.schema import PERCENT, Impossible, Section, default_kind

FLAT = 0.2822  # ε from where on an elastic ring is flat at its plates, and folds between them


class DiametralCompression(Section):
    """A ring between two plates that approach each other, and part again."""

    kind: Literal["diametral_compression"] = "diametral_compression"
    compression: Annotated[
        float,
        Field(
            gt=0, le=0.8, description="ε = 1 − b/b₀ reached, b: mid-line to mid-line; section 4.1"
        ),
        PERCENT,
    ] = 0.4
    relative_rate: Annotated[
        float,
        Field(
            gt=0, le=0.05, description="ε̇ T₁: compression in one period of the slowest mode; ours"
        ),
    ] = 0.005
    unload: Annotated[bool, Field(description="let the plates part again; section 4.1")] = True

    @property
    def strokes(self) -> int:
        """One, or there and back."""
        return 2 if self.unload else 1

    def fold_ratio(self, vertices: int) -> float:
        """Return ℓ / half the gap between the plates at the largest ε, 2 tan(π/N)/(1 − ε).

        Half the gap is about the radius of the two folds of a ring. 0, if it does not fold.
        """
        if self.compression <= FLAT:
            return 0.0
        return 2.0 * math.tan(math.pi / vertices) / (1.0 - self.compression)


class Bending(Section):
    """A beam under a force: the shell of a ring, cut open and straight, of as many segments."""

    kind: Literal["bending"]
    support: Annotated[
        Literal["clamped", "half_clamped", "ends"],
        Field(
            description="clamped: at one end, by a hinge as all others; half_clamped: by one of "
            "2 k_b, as half a segment's length gives way there; the force is at the other end. "
            "ends: supported at both, the force in the middle; section 3.2"
        ),
    ] = "half_clamped"
    force: Annotated[
        float, Field(gt=0, le=0.1, description="F L²/EI, L the length of the beam; section 3.2")
    ] = 1e-3


class OuterPressure(Section):
    """A ring in a pressure from outside that grows at a constant rate."""

    kind: Literal["pressure"]
    pressure: Annotated[
        float,
        Field(gt=0, le=5, description="p R³/EI reached; a hollow ring buckles at 3; section 4.1"),
    ] = 3.5
    relative_rate: Annotated[
        float,
        Field(gt=0, le=1, description="growth of p R³/EI in one period of the slowest mode; ours"),
    ] = 0.02
    imperfection: Annotated[
        float,
        Field(
            ge=1e-6,
            le=0.01,
            description="a of its shape at rest, R (1 + a cos 2φ); ours",
        ),
    ] = 1e-4


class Vibration(Section):
    """A free ring in its slowest vibration."""

    kind: Literal["vibration"]
    amplitude: Annotated[
        float, Field(gt=0, le=0.1, description="a of u = a R cos 2φ; ours"), PERCENT
    ] = 0.01
    periods: Annotated[
        int, Field(ge=2, le=100_000, description="2π/ω₁, ω₁² = 36 EI/5 ρ_l R⁴; ours")
    ] = 10


class SoftParticleOscillatoryShear(Section):
    """Oscillatory shear γ(t) = A sin(2π t/T) of a dense suspension, T = T₁ / relative_frequency."""

    kind: Literal["oscillatory"]
    strain_amplitude: Annotated[
        float, Field(gt=0, le=5, description="A [-], not in percent; ours"), PERCENT
    ] = 0.2
    relative_frequency: Annotated[
        float,
        Field(
            gt=0, le=1, description="f T₁ [-], T₁: period of the slowest vibration of a ring; ours"
        ),
    ] = 0.05
    periods: Annotated[int, Field(ge=1, description="whole periods; ours")] = 3


class Compaction(Section):
    """A box of rings whose lid comes down, and goes up again."""

    kind: Literal["compaction"]
    control: Annotated[
        Literal["speed", "load"],
        Field(
            exclude_if=lambda value: value == "speed",
            description="speed: the lid has a constant one. load: it is as heavy as a row of "
            "particles, and moves by itself under a stress that grows to largest_stress at a "
            "constant rate; ours",
        ),
    ] = "speed"
    strain: Annotated[
        float, Field(gt=0, le=1, description="ε = ln(H₀/H) reached, at most; section 5"), PERCENT
    ] = 0.3
    largest_stress: Annotated[
        float | None,
        Field(
            gt=0,
            description="σ R²/k_b at which the lid turns before, looked at in every record and "
            "passed by what one adds, see record.rows; σ/σ* is twice that; paper (37)",
        ),
    ] = None
    relative_rate: Annotated[
        float,
        Field(
            gt=0,
            le=0.05,
            description="ε̇ T₁: strain in one period of the slowest mode; or, with control: load, "
            "stress in one period / largest_stress; ours",
        ),
    ] = 0.003
    unload: Annotated[bool, Field(description="let the lid go up to where it was; section 5")] = (
        True
    )

    @model_validator(mode="after")
    def _load_up_to_a_stress(self) -> Self:
        if self.control == "load" and self.largest_stress is None:
            message = "a lid under a load needs the stress it grows to: largest_stress = 0.5, say"
            raise Impossible([(("largest_stress", "control"), message)])
        return self

    @property
    def strokes(self) -> int:
        """One, or there and back."""
        return 2 if self.unload else 1


class Tension(Section):
    """A tissue between two grips, of which the upper one goes up at a constant speed."""

    kind: Literal["tension"]
    strain: Annotated[
        float,
        Field(gt=0, le=3, description="ε = ln(H/H₀) reached, H: between the grips; section 6"),
        PERCENT,
    ] = 0.3
    relative_rate: Annotated[
        float,
        Field(
            gt=0,
            le=0.05,
            description="ε̇ T₁ at the start: strain in one period of the slowest mode; ours",
        ),
    ] = 0.002


SoftParticleShear = Annotated[
    DiametralCompression
    | Compaction
    | Tension
    | SoftParticleOscillatoryShear
    | Bending
    | OuterPressure
    | Vibration,
    Field(discriminator="kind"),
    default_kind("diametral_compression"),
]
