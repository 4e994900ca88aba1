"""Imposed shear: the sections of a study file, the strain they impose, and when to keep snapshots.

A protocol is a rest, a shear and a rest, counted in periods T = τ / relative_frequency.
Time starts at 0 with the first rest.
"""

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from shear_sim.schema import PERCENT, Impossible, NonNegative, Positive, Section, default_kind


class OscillatoryShear(Section):
    """Oscillatory shear γ(t) = A sin(2π (t − t₀) / T) between two rests (Table S2-1)."""

    kind: Literal["oscillatory"] = "oscillatory"
    strain_amplitude: Annotated[
        float, Field(gt=0, le=5, description="A [-], not in percent; S2-1"), PERCENT
    ] = 0.2
    relative_frequency: Annotated[
        float, Field(gt=0, description="f τ [-]; T = τ / (f τ); S2-1")
    ] = 0.025
    pre_periods: Annotated[NonNegative, Field(description="rest before, in periods T; S2-1")] = 2
    periods: Annotated[Positive, Field(description="shear, in periods T; S2-1")] = 3
    post_periods: Annotated[NonNegative, Field(description="rest after, in periods T; S2-1")] = 1


def _not_zero(rate: float) -> float:
    if rate == 0:
        msg = "must not be 0: the strain is never reached"
        raise ValueError(msg)
    return rate


class SteadyShear(Section):
    """Steady shear at a constant rate, started and stopped at once, between two rests."""

    kind: Literal["steady"]
    relative_rate: Annotated[
        float,
        AfterValidator(_not_zero),
        Field(
            description="strain rate × τ [-], either sign, not 0; ours",
            json_schema_extra={"not": {"const": 0}},
        ),
    ]
    strain: Annotated[float, Field(gt=0, description="total strain |γ| reached [-]; ours")]
    relative_frequency: Annotated[
        float, Field(gt=0, description="sets the unit of time T = τ / relative_frequency; ours")
    ] = 0.025
    pre_periods: Annotated[NonNegative, Field(description="rest before, in T; ours")] = 2
    post_periods: Annotated[NonNegative, Field(description="rest after, in T; ours")] = 1

    @property
    def periods(self) -> float:
        """Duration of the shear in units of T."""
        return self.strain / abs(self.relative_rate) * self.relative_frequency


Shear = Annotated[
    OscillatoryShear | SteadyShear, Field(discriminator="kind"), default_kind("oscillatory")
]


def _number_or_moments(value: object) -> object:
    moments = value if isinstance(value, list | tuple) else (value,)
    numbers = [each for each in moments if isinstance(each, int | float) and each is not True]
    counts = moments is value or (isinstance(value, int) and value >= 1)
    if value is None or (counts and moments and len(numbers) == len(moments)):
        return value
    msg = "must be a number of snapshots, a whole one from 1 on, or a list of moments"
    raise ValueError(msg)


#: ``record.snapshots`` of all models. Whoever keeps none has the job ids of a program without them.
Snapshots = Annotated[
    int | Annotated[tuple[float, ...], Field(strict=False)] | None,
    BeforeValidator(_number_or_moments),
    Field(
        exclude_if=lambda value: value is None,
        description="also keep particles and contacts: so many times per unit, or at these moments "
        "[units]. The unit is a period, if the shear oscillates, else a strain of 1, a compression "
        "of 1, a duration as its section has it, or a stroke. A number counts from the begin of "
        "the shear, and its end is kept too; so is the last record of a run that ends early; ours",
    ),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "integer", "minimum": 1},
                {"type": "array", "items": {"type": "number"}, "minItems": 1},
                {"type": "null"},
            ]
        }
    ),
]


def check_snapshots(
    wanted: int | tuple[float, ...] | None,
    first: float,
    last: float,
    records: float,
    keys: tuple[str, ...] = ("record.rows",),
) -> None:
    """Refuse snapshots outside of the run, and more of them than records.

    Parameters
    ----------
    wanted : int or tuple of float or None
        ``record.snapshots``.
    first, last : float
        When the run begins and ends, in units of the protocol.
    records : float
        Records per unit.
    keys : tuple of str
        What says how many there are.

    Raises
    ------
    Impossible
        If there are such.
    """
    if isinstance(wanted, int) and wanted > records * (1 + 1e-9):
        message = (
            f"{wanted} snapshots (record.snapshots) in a unit of the protocol (a period, a stroke, "
            f"a strain of 1), in which there are {records:.4g} records: at most that many, or more "
            f"records by {' or '.join(keys)}"
        )
        raise Impossible([(("record.snapshots", *keys, "shear.kind"), message)])
    if isinstance(wanted, tuple):
        margin = 1e-9 * (last - first)
        outside = [t for t in wanted if not first - margin <= t <= last + margin]
        if outside:
            message = f"{outside[0]:g} is not within the run, from {first:g} to {last:g}"
            raise Impossible([(("record.snapshots",), message)])


def snapshot_rows(
    wanted: int | tuple[float, ...] | None, clock: NDArray[np.float64], end: float
) -> tuple[int, ...]:
    """Return the records nearest to the moments at which snapshots are wanted, in order.

    Parameters
    ----------
    wanted : int or tuple of float or None
        ``record.snapshots``: n is at every n-th of a unit, from 0, and at ``end``.
    clock : (rows,)
        When each record is made, in units of the protocol; increases.
    end : float
        When the shear ends.
    """
    if wanted is None:
        return ()
    if isinstance(wanted, int):
        moments = np.arange(math.floor(end * wanted * (1 + 1e-12)) + 1) / wanted
        moments = np.append(moments, end)  # what a short shear has come to
    else:
        moments = np.array(wanted)
    after = np.searchsorted(clock, moments).clip(1, len(clock) - 1)
    before_is_nearer = moments - clock[after - 1] < clock[after] - moments
    return tuple(np.unique(after - before_is_nearer).tolist())
