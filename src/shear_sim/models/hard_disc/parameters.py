"""The sections of a study of hard discs: every physical parameter, its unit and its limits."""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from shear_sim.models.interface import Point
from shear_sim.protocol import Snapshots, check_snapshots
from shear_sim.schema import PERCENT, Fraction, Impossible, Positive, Section, default_kind

CLOSEST = math.pi / math.sqrt(12)  # packing fraction of the densest packing of equal discs


class HardDiscWalls(Section):
    """Immobile discs of the mean small size: they go with the flow, whoever pushes them."""

    kind: Annotated[
        Literal["none", "floor", "hopper"],
        Field(description="floor: a row at y = 0. hopper: two rows that leave an orifice; paper I"),
    ] = "none"
    orifice: Annotated[
        float | None, Field(gt=0, description="its width [mean small diameters]; default: 4; ours")
    ] = None
    angle: Annotated[
        float | None,
        Field(
            ge=0,
            le=80,
            description="of the rows against the horizontal [degrees]; default: 45; ours",
        ),
    ] = None

    @model_validator(mode="after")
    def _only_hoppers_have_one(self) -> Self:
        if self.kind != "hopper":
            keys = [key for key in ("orifice", "angle") if getattr(self, key) is not None]
            if keys:
                raise Impossible([((key, "kind"), "only a hopper has one") for key in keys])
        return self


class HardDiscPacking(Section):
    """Which discs there are: large and small ones, half of each, at random without overlap."""

    start: Annotated[
        Literal["random", "file"],
        Field(description="file: the state in `file`; no other key here counts then; ours"),
    ] = "random"
    file: Annotated[
        Path | None,
        Field(
            strict=False, description="JSON beside the study: the block `state` of a summary; ours"
        ),
    ] = None
    file_digest: str | None = None
    discs: Annotated[int, Field(ge=2, le=100_000, description="N; ⌈N/2⌉ are large; paper V A")] = 64
    body: Annotated[
        Literal["disc", "triangle", "chain"],
        Field(
            description="triangle: three touching discs, rigid. chain: a row of touching discs, "
            "which bends. Large and small bodies, half of each; paper V C"
        ),
    ] = "disc"
    beads: Annotated[
        int | None, Field(ge=2, le=100, description="of a chain; default: 3; ours")
    ] = None
    aspect_ratio: Annotated[
        float, Field(ge=0.1, le=10, description="cell height / width; ours")
    ] = 1.0
    walls: HardDiscWalls = HardDiscWalls()
    packing_fraction: Annotated[
        float,
        Field(
            gt=0,
            le=0.907,
            description="φ = Σ π a_i² / cell area [-] at the start, not in percent; paper V A",
        ),
        PERCENT,
    ] = 0.8
    size_ratio: Annotated[
        float, Field(ge=1, le=5, description="large radius / small radius; paper V A")
    ] = 1.4
    polydispersity: Annotated[
        float,
        Field(
            ge=0,
            le=0.5,
            description="radii are uniform within this fraction of their mean; paper V A",
        ),
        PERCENT,
    ] = 0.03
    attempts: Annotated[
        int, Field(ge=1, description="random positions to try for a start without overlap; ours")
    ] = 20

    @property
    def beads_per_body(self) -> int:
        """Discs of one body."""
        return {"disc": 1, "triangle": 3, "chain": self.beads or 3}[self.body]

    @model_validator(mode="after")
    def _whole_bodies(self) -> Self:
        if self.beads is not None and self.body != "chain":
            raise Impossible([(("beads", "body"), "only a chain has a number of beads")])
        if self.discs % self.beads_per_body:
            message = f"{self.discs} discs are no whole bodies of {self.beads_per_body}"
            raise Impossible([(("discs", "body", "beads"), message)])
        if self.body != "disc" and self.walls.kind != "none":
            raise Impossible([(("walls.kind", "body"), "walls are for single discs")])
        return self

    @model_validator(mode="after")
    def _file_or_random(self) -> Self:
        if (self.start == "file") != (self.file is not None):
            message = "start: file needs the name of a file, and only it has one"
            raise Impossible([(("file", "start"), message)])
        return self

    @model_validator(mode="after")
    def _not_touch_twice(self) -> Self:
        if self.start == "file":
            return self
        large = math.ceil(self.discs / 2)
        ratio = self.size_ratio
        area = math.pi * (large * ratio**2 + self.discs - large) / self.packing_fraction
        side = math.sqrt(area * min(self.aspect_ratio, 1 / self.aspect_ratio))
        most = ratio * (1 + self.polydispersity)
        if side < 4 * most:
            fewest = math.ceil(self.discs * (4 * most / side) ** 2)
            message = (
                f"the side of the cell ({side:.3g} small radii) is under four large "
                f"radii ({4 * most:.3g}), so two discs could touch twice: packing.discs at least "
                f"{fewest}, or a lower packing_fraction"
            )
            raise Impossible([(("discs", "packing_fraction", "size_ratio"), message)])
        return self


class HardDisc(Section):
    """Frictionless rigid discs with drag against the affine flow (Lerner, Düring & Wyart)."""

    kind: Literal["hard_disc"] = "hard_disc"
    mobility: Annotated[
        float, Field(gt=0, description="ξ₀, velocity per force on a disc [1/(Pa s)]; paper (6)")
    ] = 1.0
    mobility_exponent: Annotated[
        float,
        Field(
            ge=0, le=4, description="n: ξ = ξ₀ (mean small radius / radius)ⁿ; 1: Stokes drag; HD.1"
        ),
    ] = 0.0


class HardDiscSteadyShear(Section):
    """Steady shear: at fixed area or pressure, with imposed compression, or at fixed stress."""

    kind: Literal["steady"] = "steady"
    strain: Annotated[float, Field(gt=0, description="total strain |γ| reached [-]; paper V A")] = (
        1.0
    )
    strain_rate: Annotated[
        Positive,
        Field(description="γ̇ [1/s]: sets the units of time and stress, nothing else; paper II D"),
    ] = 1.0
    scaled_pressure: Annotated[
        float | None,
        Field(
            gt=0,
            description="p ξ₀/γ̇ [-], which the area of the cell keeps; none: fixed area; "
            "paper (24)",
        ),
    ] = None
    compression_ratio: Annotated[
        float,
        Field(
            ge=-100, le=100, description="κ: imposed rate of compression of lengths / γ̇; paper (20)"
        ),
    ] = 0.0
    shear_stress: Annotated[
        float | None,
        Field(
            gt=0,
            description="imposed σ [Pa]: the strain rate follows; records are by strain; "
            "paper (30)",
        ),
    ] = None
    highest_rate: Annotated[
        Positive, Field(description="of a flow at fixed stress, largest γ̇ / (σ ξ₀); ours")
    ] = 100.0
    transient: Annotated[
        Fraction, Field(description="part of the strain before means are taken; ours")
    ] = 0.3

    @model_validator(mode="after")
    def _impose_one_of_both(self) -> Self:
        if self.scaled_pressure is not None and self.compression_ratio != 0:
            message = "at a fixed pressure the compression follows: leave one of both out"
            raise Impossible([(("compression_ratio", "scaled_pressure"), message)])
        if self.shear_stress is not None and self.strain_rate != 1:
            message = "at a fixed shear_stress the strain_rate follows: leave one of both out"
            raise Impossible([(("strain_rate", "shear_stress"), message)])
        if self.shear_stress is not None and self.scaled_pressure is not None:
            message = "one of scaled_pressure and shear_stress can be fixed, not both"
            raise Impossible([(("scaled_pressure", "shear_stress"), message)])
        if self.shear_stress is None and self.highest_rate != 100:
            message = "has no effect without shear_stress"
            raise Impossible([(("highest_rate", "shear_stress"), message)])
        return self


def _not_zero(compression: float) -> float:
    if compression == 0:
        msg = "must not be 0: nothing would move"
        raise ValueError(msg)
    return compression


class HardDiscCompression(Section):
    """Isotropic compression (or decompression) without shear; ends where the discs are jammed."""

    kind: Literal["compression"]
    compression: Annotated[
        float,
        AfterValidator(_not_zero),
        Field(
            ge=-2,
            le=2,
            description="ln(length before / after) of the cell; < 0 decompresses; paper IV D",
        ),
    ] = 0.1
    rate: Annotated[
        Positive, Field(description="its rate [1/s]: sets the units of time and stress; paper II D")
    ] = 1.0


class HardDiscOscillatoryShear(Section):
    """Oscillatory shear γ(t) = A sin(2π t / T) at fixed volume."""

    kind: Literal["oscillatory"] = "oscillatory"
    strain_amplitude: Annotated[
        float, Field(gt=0, le=5, description="A [-], not in percent; ours"), PERCENT
    ] = 0.2
    period: Annotated[
        Positive,
        Field(description="T [s]: sets the units of time and stress, nothing else; paper II D"),
    ] = 1.0
    periods: Annotated[int, Field(ge=1, description="whole periods; ours")] = 3


TimeUnit = Annotated[
    Positive,
    Field(description="τ [s]: sets the units of time and stress, nothing else; paper II D"),
]
Duration = Annotated[Positive, Field(description="of the run [τ]; paper V B")]
Transient = Annotated[
    Fraction, Field(description="part of the duration before means are taken; ours")
]


class HardDiscSelfPropulsion(Section):
    """Discs that push themselves: a force on each, of mean square 1, in units of τ = λ/(f ξ₀)."""

    kind: Literal["self_propelled"]
    duration: Duration = 50.0
    persistence: Annotated[
        Positive,
        Field(description="a force lasts a time uniform between 0 and this [τ]; paper V B"),
    ] = 10.0
    force: Annotated[
        Literal["uniform", "fixed"],
        Field(description="magnitude: uniform from 0 (paper, section V B), or the same for all"),
    ] = "uniform"
    time_unit: TimeUnit = 1.0
    transient: Transient = 0.3


class HardDiscBodyForce(Section):
    """A force on every disc, as its weight, in units of τ = λ/(f ξ₀), f: of a mean small disc."""

    kind: Literal["body_force"]
    duration: Duration = 50.0
    inclination: Annotated[
        float,
        Field(ge=-180, le=180, description="of the floor [degrees]; 0: straight down, −y; paper I"),
    ] = 0.0
    time_unit: TimeUnit = 1.0
    transient: Transient = 0.3


class HardDiscStage(Section):
    """One drive and how long it lasts."""

    shear: Annotated[
        int, Field(ge=-1, le=1, description="direction of the shear; 0: none; HD.1")
    ] = 0
    compression: Annotated[
        float, Field(ge=-10, le=10, description="rate of compression of lengths, per path; HD.1")
    ] = 0.0
    length: Annotated[Positive, Field(description="of path: strain |γ|, or time where none; ours")]


class HardDiscStages(Section):
    """Drives one after another: start and stop, reversal, compression and then shear.

    Discs that jam rest until the next stage begins; where there is none the run ends.
    """

    kind: Literal["stages"]
    stages: Annotated[tuple[HardDiscStage, ...], Field(min_length=1, strict=False)]
    rate: Annotated[
        Positive,
        Field(description="path per time [1/s]: sets the units of time and stress; paper II D"),
    ] = 1.0

    @property
    def length(self) -> float:
        """Length of path of all stages."""
        return math.fsum(stage.length for stage in self.stages)


HardDiscShear = (
    HardDiscSteadyShear
    | HardDiscOscillatoryShear
    | HardDiscCompression
    | HardDiscSelfPropulsion
    | HardDiscBodyForce
    | HardDiscStages
)


class HardDiscIntegrator(Section):
    """How the discs are moved."""

    scheme: Annotated[
        Literal["events", "time_steps"],
        Field(
            description="events: exact. time_steps: one problem per step, first order, no overlap; "
            "HD.7"
        ),
    ] = "events"
    strain_step: Annotated[
        float | None,
        Field(
            gt=0, le=0.01, description="of time_steps, at most; whole steps between records; ours"
        ),
    ] = None

    @model_validator(mode="after")
    def _step_or_not(self) -> Self:
        if (self.scheme == "time_steps") != (self.strain_step is not None):
            message = "scheme: time_steps needs strain_step (0.001?), and only it has one"
            raise Impossible([(("strain_step", "scheme"), message)])
        return self


class HardDiscRecord(Section):
    """How often a record is made. Records never change the motion."""

    rows: Annotated[
        int | None,
        Field(
            ge=20,
            description="records after the first, evenly in time; default: 1,000 per unit strain, "
            "1,000 per unit compression, 400 per period, 10 per τ; ours",
        ),
    ] = None
    state: Annotated[
        bool, Field(description="keep where discs and contacts are at the end in the summary; ours")
    ] = False
    snapshots: Snapshots = None


class HardDiscPoint(Point):
    """One simulation of hard discs."""

    packing: HardDiscPacking = HardDiscPacking()
    model: HardDisc = HardDisc()
    shear: Annotated[HardDiscShear, Field(discriminator="kind"), default_kind("steady")] = (
        HardDiscSteadyShear()
    )
    integrator: HardDiscIntegrator = HardDiscIntegrator()
    record: HardDiscRecord = HardDiscRecord()

    @property
    def kind(self) -> str:
        """Name of the model."""
        return self.model.kind

    def resolved(self) -> Self:
        """Return the point with its number of records filled in."""
        shear = self.shear
        if isinstance(shear, HardDiscSteadyShear):
            default = max(20, math.ceil(1000 * shear.strain))
        elif isinstance(shear, HardDiscCompression):
            default = max(20, math.ceil(1000 * abs(shear.compression)))
        elif isinstance(shear, HardDiscStages):
            default = max(20, math.ceil(1000 * shear.length * (1 - 1e-12)))
        elif isinstance(shear, HardDiscSelfPropulsion | HardDiscBodyForce):
            default = max(20, math.ceil(10 * shear.duration))
        else:
            default = 400 * shear.periods
        rows = self.record.rows or default
        return self.model_copy(update={"record": self.record.model_copy(update={"rows": rows})})

    @model_validator(mode="after")
    def _keep_snapshots_within_the_run(self) -> Self:
        shear, rows = self.shear, self.resolved().record.rows or 0
        if isinstance(shear, HardDiscSteadyShear):
            last = shear.strain
        elif isinstance(shear, HardDiscCompression):
            last = abs(shear.compression)
        elif isinstance(shear, HardDiscStages):
            last = shear.length
        elif isinstance(shear, HardDiscOscillatoryShear):
            last = float(shear.periods)
        else:
            last = shear.duration
        check_snapshots(self.record.snapshots, 0.0, last, rows / last)
        return self

    def check_files(self) -> None:
        """Check the contents of the start file; see `Point.check_files`."""
        if self.packing.start == "file":
            from shear_sim.models.hard_disc.packing import read_start

            try:
                start = read_start(self.packing)
            except ValueError as error:
                raise Impossible([(("packing.file",), str(error))]) from None
            if len(start.bonds) and self.integrator.scheme == "time_steps":
                message = f"it has {len(start.bonds)} bonds, which time_steps would open"
                raise Impossible([(("packing.file", "integrator.scheme"), message)])

    @model_validator(mode="after")
    def _walls_stand(self) -> Self:
        if self.packing.walls.kind != "none" and not isinstance(
            self.shear, HardDiscBodyForce | HardDiscSelfPropulsion
        ):
            message = "walls stand still: they need kind: body_force or self_propelled"
            raise Impossible([(("packing.walls.kind", "shear.kind"), message)])
        return self

    @model_validator(mode="after")
    def _step_in_steady_shear_only(self) -> Self:
        shear = self.shear
        plain = (
            isinstance(shear, HardDiscSteadyShear)
            and shear.scaled_pressure is None
            and shear.shear_stress is None
            and shear.compression_ratio == 0
        )
        if self.integrator.scheme == "time_steps" and not plain:
            message = "time_steps are for steady shear at fixed area and rate"
            keys = ("shear.kind", "shear.scaled_pressure", "shear.shear_stress")
            raise Impossible([(("integrator.scheme", *keys), message)])
        if self.integrator.scheme == "time_steps" and self.packing.body != "disc":
            message = "time_steps are for single discs: they would pull bodies apart"
            raise Impossible([(("integrator.scheme", "packing.body"), message)])
        return self

    @model_validator(mode="after")
    def _resolve_every_period(self) -> Self:
        shear, rows = self.shear, self.record.rows
        if isinstance(shear, HardDiscOscillatoryShear) and rows and rows < 20 * shear.periods:
            message = (
                f"{rows} records of {shear.periods} periods: G′ and G″ are read with nine "
                f"harmonics and need 20 a period: at least {20 * shear.periods}"
            )
            raise Impossible([(("record.rows", "shear.periods", "shear.kind"), message)])
        return self
