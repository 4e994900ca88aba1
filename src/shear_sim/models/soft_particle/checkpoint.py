"""The whole state of a system as plain arrays, from which it goes on to the same bits."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.state import Lists, Rules
from shear_sim.models.soft_particle.system import System

Arrays = dict[str, NDArray[Any]]

_FILLED = (  # tuples of arrays whose sizes the bodies, walls and links give
    "chains", "motion", "springs", "walls", "work", "links", "rigid",
)  # fmt: skip
_NUMBERS = ("steps", "_at_start")
_ARRAYS = ("_x0", "_y0")


def freeze(system: System) -> Arrays:
    """Return everything that the motion of ``system`` depends on, ready for ``numpy.savez``."""
    kept: dict[str, Any] = {}
    for part in (*_FILLED, "lists", "rules"):
        values = getattr(system, part)._asdict()
        kept |= {f"{part}.{name}": np.array(value) for name, value in values.items()}
    return kept | {name: np.array(getattr(system, name)) for name in (*_NUMBERS, *_ARRAYS)}


def thaw(arrays: Mapping[str, NDArray[Any]], system: System) -> None:
    """Give ``system``, made of the same bodies and walls, the state that `freeze` kept."""
    for part in _FILLED:
        for name, values in getattr(system, part)._asdict().items():
            values[...] = arrays[f"{part}.{name}"]
    system.lists = Lists(*(arrays[f"lists.{name}"].copy() for name in Lists._fields))
    system.rules = Rules(*(float(arrays[f"rules.{name}"]) for name in Rules._fields))
    for name in _NUMBERS:
        setattr(system, name, arrays[name][()].item())
    for name in _ARRAYS:
        setattr(system, name, arrays[name].copy())
