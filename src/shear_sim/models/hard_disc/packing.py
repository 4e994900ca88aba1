"""Starts without overlap: single discs, bodies of several, walls, or a state from a file.

Lengths are in mean diameters of the small discs.
"""

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Arrested, Drive, Jammed
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.overlap_free import INFLATION, push_apart
from shear_sim.models.hard_disc.parameters import HardDisc, HardDiscPacking, HardDiscWalls
from shear_sim.models.interface import SimulationError
from shear_sim.packing import content_digest
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

MOST_START_STEPS = 20_000  # of one attempt at a start without overlap
DILUTE = 0.3  # packing fraction at which bodies are put at random places
MOST_PLACES = 2000  # tried for one body
ROOM = 1e-3  # least gap between bodies there
OVERLAP = 1e-12  # of a start from a file, at most [mean diameter]


@dataclass
class Start:
    """Discs without overlap in a cell, and how they were found."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray
    mobility: FloatArray  # relative to ξ₀; 0 for walls
    width: float
    height: float
    offset: float = 0.0
    bonds: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    facts: dict[str, Any] = field(default_factory=dict)


def make_start(packing: HardDiscPacking, model: HardDisc, streams: Streams) -> Start:
    """Return the start of a run.

    Raises
    ------
    SimulationError
        If no start without overlap is found.
    """
    if packing.start == "file":
        return read_start(packing)
    n = packing.discs
    beads = packing.beads_per_body
    large = np.repeat(np.arange(n // beads) < math.ceil(n / beads / 2), beads)
    mean = np.where(large, 0.5 * packing.size_ratio, 0.5)
    spread = packing.polydispersity * streams.generator("radii").uniform(-1, 1, n)
    radius: FloatArray = mean * (1 + spread)
    area = math.pi * float((radius**2).sum()) / packing.packing_fraction
    width = math.sqrt(area / packing.aspect_ratio)
    height = area / width
    mobility = (0.5 / radius) ** model.mobility_exponent
    rng = streams.generator("positions")
    for attempt in range(packing.attempts):
        if beads == 1:
            start = _discs(radius, mobility, width, height, packing.walls, rng)
        else:
            start = _bodies(radius, mobility, width, height, packing, rng)
        if start is not None:
            start.facts["attempts"] = attempt + 1
            return start
    msg = (
        f"no overlap-free start after {packing.attempts} attempts at packing_fraction = "
        f"{packing.packing_fraction:g} with {n} discs: lower it, or raise packing.attempts"
    )
    raise SimulationError(msg)


def _discs(
    radius: FloatArray,
    mobility: FloatArray,
    width: float,
    height: float,
    walls: HardDiscWalls,
    rng: np.random.Generator,
) -> Start | None:
    """Push single discs apart from random places; None where overlaps stay."""
    fixed_x, fixed_y = wall_places(walls, width, height)
    n, fixed = len(radius), len(fixed_x)
    x, y = rng.random((2, n)) * np.array([[width], [height]])
    x, y = np.concatenate([x, fixed_x]), np.concatenate([y, fixed_y])
    radius = np.concatenate([radius, np.full(fixed, 0.5)])
    mobility = np.concatenate([mobility, np.zeros(fixed)])
    free = (mobility > 0).astype(np.int32)
    steps, overlap = push_apart(x, y, radius, free, width, height, MOST_START_STEPS)
    if overlap >= 0.4 * INFLATION:
        return None
    return Start(x, y, radius, mobility, width, height, facts={"start_steps": steps})


def wall_places(walls: HardDiscWalls, width: float, height: float) -> tuple[FloatArray, FloatArray]:
    """Return the places of the immobile discs, which touch or overlap their neighbours.

    Raises
    ------
    SimulationError
        If a hopper does not fit into the cell.
    """
    if walls.kind == "none":
        return np.zeros(0), np.zeros(0)
    if walls.kind == "floor":
        x = width * np.arange(math.ceil(width)) / math.ceil(width)
        return x, np.zeros(len(x))
    orifice = 4.0 if walls.orifice is None else walls.orifice
    slope = math.tan(math.radians(45.0 if walls.angle is None else walls.angle))
    run = 0.5 * (width - orifice - 1.0)  # the last discs reach half a diameter into the opening
    if run <= 0 or run * slope > 0.7 * height:
        msg = (
            f"a hopper with packing.walls.orifice = {orifice:g} does not fit into a cell of "
            f"{width:.3g} × {height:.3g} mean small diameters: more discs, a smaller orifice or "
            f"angle, or a larger packing.aspect_ratio"
        )
        raise SimulationError(msg)
    pieces = math.ceil(run * math.hypot(1.0, slope))
    across = run * np.arange(pieces + 1) / pieces
    up = 0.15 * height + slope * (run - across)
    # Both rows meet at x = 0, which is also the right edge of the cell.
    return np.concatenate([across, width - across[1:]]), np.concatenate([up, up[1:]])


def template(radius: FloatArray, body: str) -> tuple[FloatArray, IntArray]:
    """Return the places (n, 2) of the beads of one body about its centre, and its bonds."""
    n = len(radius)
    place = np.zeros((n, 2))
    if body == "triangle":
        a, b, c = radius
        place[1, 0] = a + b
        place[2, 0] = ((a + b) ** 2 + (a + c) ** 2 - (b + c) ** 2) / (2 * (a + b))
        place[2, 1] = math.sqrt((a + c) ** 2 - place[2, 0] ** 2)
        bonds = np.array([[0, 1], [1, 2], [0, 2]], np.int32)
    else:
        place[1:, 0] = np.cumsum(radius[:-1] + radius[1:])
        bonds = np.column_stack([np.arange(n - 1), np.arange(1, n)]).astype(np.int32)
    return place - place.mean(axis=0), bonds


def _bodies(
    radius: FloatArray,
    mobility: FloatArray,
    width: float,
    height: float,
    packing: HardDiscPacking,
    rng: np.random.Generator,
) -> Start | None:
    """Put bodies at random places of a larger cell and compress it; None where that fails."""
    beads = packing.beads_per_body
    larger = max(1.0, math.sqrt(packing.packing_fraction / DILUTE))
    box = np.array([width, height]) * larger
    place, bonds = np.zeros((0, 2)), []
    for first in range(0, len(radius), beads):
        own, pairs = template(radius[first : first + beads], packing.body)
        reach = radius[first : first + beads, None] + radius[:first] + ROOM
        for _ in range(MOST_PLACES):
            angle = rng.uniform(0, 2 * math.pi)
            turn = np.array(
                [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
            )
            new = own @ turn + rng.random(2) * box
            apart = new[:, None] - place
            apart -= box * np.rint(apart / box)
            if (np.hypot(apart[..., 0], apart[..., 1]) > reach).all():
                break
        else:
            return None
        place = np.vstack([place, new])
        bonds.append(pairs + first)
    rest = Drive(0.0, 1.0, 0.0, np.zeros((2, len(radius))))
    x, y = place.T.copy()
    flow = Flow(
        x, y, radius, mobility, float(box[0]), float(box[1]), rest, bonds=np.concatenate(bonds)
    )
    try:
        flow.advance(math.log(larger))
    except (Jammed, Arrested):
        return None
    return Start(
        flow.x, flow.y, radius, mobility, flow.width, flow.height, flow.offset, flow.bonds,
        {"compressed_from": DILUTE},
    )  # fmt: skip


def read_start(packing: HardDiscPacking) -> Start:
    """Return the state that ``packing.file`` holds.

    JSON with numbers ``width``, ``height`` and, if wanted, ``offset`` (of the upper image), and
    lists ``x``, ``y``, ``radius`` and, if wanted, ``mobility`` (relative to ξ₀; 0: immobile) and
    ``bonds`` (pairs of touching discs, counted from 0). Lengths are in mean diameters of the small
    discs. Other keys are not looked at.

    Raises
    ------
    ValueError
        If the file cannot be read, has changed, or holds no state, or its discs overlap.
    """
    path = packing.file
    if path is None:
        msg = "start: file needs the name of the file"
        raise ValueError(msg)
    content = path.read_bytes()
    if packing.file_digest is not None and content_digest(path, content) != packing.file_digest:
        msg = "has changed since the study was read: run the study anew"
        raise ValueError(msg)
    try:
        data = json.loads(content)
        data = {"mobility": [1.0] * len(data["x"]), "bonds": [], "offset": 0.0} | data
        x, y, radius, mobility = (
            np.array(data[name], np.float64).reshape(-1)
            for name in ("x", "y", "radius", "mobility")
        )
        bonds = np.array(data["bonds"], np.int32).reshape(-1, 2)
        width, height = float(data["width"]), float(data["height"])
        offset = float(data["offset"])
    except (KeyError, TypeError, ValueError) as error:
        msg = f"is no state of hard discs: {error!r}"
        raise ValueError(msg) from None
    if not len(x) == len(y) == len(radius) == len(mobility) >= 2:
        msg = "x, y, radius and mobility must be lists of one length, of two discs or more"
        raise ValueError(msg)
    numbers = np.concatenate([x, y, radius, mobility, [width, height, offset]])
    if not (np.isfinite(numbers).all() and (radius > 0).all() and (mobility >= 0).all()):
        msg = "all numbers must be finite, radii positive and mobilities not negative"
        raise ValueError(msg)
    diameter = 2.0 * float(radius.mean())
    if not 0.1 < diameter < 10.0:  # tolerances are those of lengths near 1
        msg = (
            f"its mean diameter is {diameter:.3g}, but lengths are in mean diameters of the small "
            "discs: divide them all by it"
        )
        raise ValueError(msg)
    if not (mobility > 0).any():
        msg = "mobility is zero everywhere: nothing could move"
        raise ValueError(msg)
    if min(width, height) < 4 * radius.max():
        msg = f"the cell, {width:g} × {height:g}, is smaller than four of its largest radii"
        raise ValueError(msg)
    if len(bonds) and not 0 <= bonds.min() <= bonds.max() < len(x):
        msg = f"bonds name discs beyond the {len(x)} that there are"
        raise ValueError(msg)
    if len({frozenset(bond) for bond in bonds.tolist()}) < len(bonds):
        msg = "bonds name a pair of discs twice"
        raise ValueError(msg)
    if (bonds[:, 0] == bonds[:, 1]).any():
        msg = "a bond joins a disc with itself"
        raise ValueError(msg)
    start = Start(x, y, radius, mobility, width, height, offset, bonds)
    overlap, i, j = largest_overlap(start)
    if overlap > OVERLAP:
        msg = (
            f"discs {i} and {j} overlap by {overlap:.3g} mean diameters: move them apart, or make "
            "them smaller"
        )
        raise ValueError(msg)
    return start


def largest_overlap(start: Start) -> tuple[float, int, int]:
    """Return the largest overlap [mean diameters], and of which discs; those that move count.

    By the nearest of all images of all discs: no neighbour list, which Numba would compile first.
    """
    from scipy.spatial import KDTree

    n, reach = len(start.x), 2.0 * float(start.radius.max())
    offset = start.offset - start.width * round(start.offset / start.width)
    up = np.floor(start.y / start.height)
    y = start.y - up * start.height
    x = (start.x - up * offset) % start.width
    shift = np.array(
        [(a * start.width + b * offset, b * start.height) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    )
    place = np.column_stack([x, y])
    images = (place + shift[:, None]).reshape(-1, 2)
    near = KDTree(place).query_ball_tree(KDTree(images), reach)
    i = np.repeat(np.arange(n), [len(one) for one in near])
    image = np.fromiter((one for row in near for one in row), np.int64)
    j = image % n
    apart = np.hypot(*(images[image] - place[i]).T)
    overlap = start.radius[i] + start.radius[j] - apart
    itself = image == i + 4 * n  # the middle one of nine shifts is none
    counts = ~itself & ((start.mobility[i] > 0) | (start.mobility[j] > 0))
    overlap = np.where(counts, overlap, -np.inf) / (2.0 * float(start.radius.mean()))
    worst = int(overlap.argmax())
    return float(overlap[worst]), int(i[worst]), int(j[worst])
