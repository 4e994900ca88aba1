"""Imposed shear: the sections of a study file, and the strain they impose.

A protocol is a rest, a shear and a rest, counted in periods T = τ / relative_frequency.
Time starts at 0 with the first rest.
"""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from shear_sim.schema import PERCENT, NonNegative, Positive, Section, default_kind


class OscillatoryShear(Section):
    """Oscillatory shear γ(t) = A sin(2π (t − t₀) / T) between two rests (Table S2-1)."""

    kind: Literal["oscillatory"] = "oscillatory"
    strain_amplitude: Annotated[
        float, Field(gt=0, le=5, description="A [-], not in percent"), PERCENT
    ] = 0.2
    relative_frequency: Annotated[float, Field(gt=0, description="f τ [-]; T = τ / (f τ)")] = 0.025
    pre_periods: Annotated[NonNegative, Field(description="rest before, in periods T")] = 2
    periods: Annotated[Positive, Field(description="shear, in periods T")] = 3
    post_periods: Annotated[NonNegative, Field(description="rest after, in periods T")] = 1


def _not_zero(rate: float) -> float:
    if rate == 0:
        msg = "must not be 0: the strain is never reached"
        raise ValueError(msg)
    return rate


class SteadyShear(Section):
    """Steady shear at a constant rate, started and stopped at once, between two rests."""

    kind: Literal["steady"]
    relative_rate: Annotated[
        float, AfterValidator(_not_zero), Field(description="strain rate × τ [-], either sign")
    ]
    strain: Annotated[float, Field(gt=0, description="total strain |γ| reached [-]")]
    relative_frequency: Annotated[
        float, Field(gt=0, description="sets the unit of time T = τ / relative_frequency")
    ] = 0.025
    pre_periods: Annotated[NonNegative, Field(description="rest before, in T")] = 2
    post_periods: Annotated[NonNegative, Field(description="rest after, in T")] = 1

    @property
    def periods(self) -> float:
        """Duration of the shear in units of T."""
        return self.strain / abs(self.relative_rate) * self.relative_frequency


Shear = Annotated[
    OscillatoryShear | SteadyShear, Field(discriminator="kind"), default_kind("oscillatory")
]
