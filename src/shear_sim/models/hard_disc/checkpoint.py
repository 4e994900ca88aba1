"""The whole state of a flow as plain arrays, from which it goes on to the same bits."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import ActiveSet, Drive
from shear_sim.models.hard_disc.factor import Factor
from shear_sim.models.hard_disc.flow import Counts, Flow
from shear_sim.models.hard_disc.pairs import Pairs

Arrays = dict[str, NDArray[Any]]

_FLOW = (
    "x", "y", "radius", "mobility", "width", "height", "offset", "accuracy", "longest_step", "path",
    "squeezed", "unit", "disc_area", "touch", "skin", "bonds", "permanent", "moved", "_spent",
    "_strained", "_range", "_stalled",
)  # fmt: skip
_SET = ("pairs", "phi", "open_pairs", "kappa", "factorisations", "dependent")


def freeze(flow: Flow) -> Arrays:
    """Return everything that the motion of ``flow`` depends on, ready for ``numpy.savez``.

    The factor of the contact matrix is kept too: made again from the corrected positions, it would
    differ in its last bits.
    """
    kept: dict[str, Any] = {name: getattr(flow, name) for name in _FLOW}
    kept |= {f"set.{name}": getattr(flow.set, name) for name in _SET}
    for part, values in (("drive", flow.drive), ("pairs", flow.pairs), ("factor", flow.set.factor)):
        kept |= {f"{part}.{name}": value for name, value in values._asdict().items()}
    kept |= {f"counts.{item.name}": getattr(flow.counts, item.name) for item in fields(Counts)}
    return {name: np.array(value) for name, value in kept.items()}


def thaw(arrays: Mapping[str, NDArray[Any]]) -> Flow:
    """Return the flow that `freeze` kept."""
    # Zero-dimensional arrays were numbers.
    kept = {k: a[()].item() if a.ndim == 0 else a.copy() for k, a in arrays.items()}

    def part(name: str) -> dict[str, Any]:
        return {k.partition(".")[2]: v for k, v in kept.items() if k.startswith(f"{name}.")}

    flow = object.__new__(Flow)
    for name in _FLOW:
        setattr(flow, name, kept[name])
    flow.drive = Drive(**part("drive"))
    flow.pairs = Pairs(**part("pairs"))
    flow.counts = Counts(**part("counts"))
    flow.set = ActiveSet(len(flow.pairs.i))
    for name in _SET:
        setattr(flow.set, name, kept[f"set.{name}"])
    flow.set.factor = Factor(**part("factor"))
    flow.rx, flow.ry, flow.gap = np.empty((3, len(flow.pairs.i)))
    flow.separate()
    return flow
