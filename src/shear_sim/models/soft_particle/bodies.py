"""Bodies: rings and open chains as they are described, and the flat arrays made of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.kernels import ring_area
from shear_sim.models.soft_particle.state import CORE_LAWS, Chains, Motion

FloatArray = NDArray[np.float64]

FEWEST = 6  # vertices of a ring


class BodyError(ValueError):
    """A body that cannot be simulated; says which and why."""


@dataclass(frozen=True)
class Shell:
    """What the wall of a chain is made of; the chain's own lengths make k_s and k_b of it."""

    stretch: float  # k_s ℓ = E h / (1 − ν²) [N/m]
    bend: float  # k_b ℓ = E h³ / 12 (1 − ν²) [N m]
    stretch_yield: float = math.inf  # [N/m]
    bend_yield: float = math.inf  # [N]
    stretch_damping: float = 0.0  # fraction of critical, of one segment
    bend_damping: float = 0.0  # of one hinge
    inner_damping: float = 0.0  # force per velocity of a vertex against the particle [N s/m²]

    @classmethod
    def of_material(cls, young_modulus: float, thickness: float, poisson: float = 0.0) -> Self:
        """Return the elastic shell of a material, Eqs. (SP.1), (SP.2)."""
        plate = young_modulus * thickness / (1.0 - poisson**2)
        return cls(plate, plate * thickness**2 / 12.0)


@dataclass(frozen=True)
class Core:
    """What is inside a ring."""

    law: str = "none"  # of CORE_LAWS
    stiffness: float = 0.0  # K_Ω [Pa]
    pressure: float = 0.0  # p₀ at the area of the start [Pa]


@dataclass(frozen=True)
class Body:
    """One chain at the start, by default at rest in this very shape.

    Parameters
    ----------
    points : (n, 2)
        Vertices [m], in order, counter-clockwise if ``closed``.
    radius : float
        Half the thickness in contacts [m].
    mass : float
        Of every vertex [kg/m].
    rest_length, rest_angle : (n,), optional
        Of segment k [m] and of hinge k.
    bend_weight : (n,), optional
        Factors on k_b of each hinge: 2 at a clamped end whose hinge has only half a segment's
        length to give way over.
    """

    points: FloatArray
    closed: bool
    radius: float
    mass: float
    shell: Shell
    core: Core = Core()
    rest_length: FloatArray | None = None
    rest_angle: FloatArray | None = None
    bend_weight: FloatArray | None = None
    velocity: FloatArray | None = field(default=None)


def ring_points(vertices: int, radius: float, x: float = 0.0, y: float = 0.0) -> FloatArray:
    """Return the corners (n, 2) of a regular polygon with its vertices at ``radius``.

    The first one is at an angle of half a segment, so that a ring between walls has a segment at
    both if the number is a multiple of four.
    """
    angle = 2 * np.pi * (np.arange(vertices) + 0.5) / vertices
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def turning_angles(points: FloatArray, closed: bool) -> FloatArray:
    """Return the angle (n,) between the segments before and after each vertex; 0 at open ends."""
    ahead = np.roll(points, -1, axis=0) - points
    behind = np.roll(ahead, 1, axis=0)
    angle = np.arctan2(
        behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], (behind * ahead).sum(axis=1)
    )
    if not closed:
        angle[[0, -1]] = 0.0
    return np.asarray(angle)


def _check(body: Body, number: int) -> None:
    """Refuse what is no ring or chain."""
    points = body.points
    n = len(points)
    where = f"particle {number}"
    if body.closed and n < FEWEST:
        msg = f"{where} is a ring of {n} vertices: at least {FEWEST} are needed"
        raise BodyError(msg)
    if n < 2:
        msg = f"{where} is a chain of {n} vertices: at least 2 are needed"
        raise BodyError(msg)
    ahead = np.roll(points, -1, axis=0) - points
    length = np.hypot(*ahead.T)[: n if body.closed else n - 1]
    if not length.min() > 0.0:
        msg = f"{where}: vertices {int(length.argmin())} and the next one are at the same place"
        raise BodyError(msg)
    if not body.closed:
        if body.core.law != "none":
            msg = f"{where} is open and has a core: close it, or core law none"
            raise BodyError(msg)
        return
    if _crosses(points):
        msg = f"{where}: the ring crosses itself"
        raise BodyError(msg)
    if ring_area(points[:, 0].copy(), points[:, 1].copy(), 0, n) <= 0.0:
        msg = f"{where}: the vertices of a ring must be counter-clockwise"
        raise BodyError(msg)


def _crosses(points: FloatArray) -> bool:
    """Whether any two segments of a ring that do not follow each other intersect."""
    a, b = points, np.roll(points, -1, axis=0)
    n = len(points)

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        return np.asarray(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    one, other = np.triu_indices(n, 2)
    apart = (one != 0) | (other != n - 1)
    one, other = one[apart], other[apart]
    low, high = np.minimum(a, b), np.maximum(a, b)
    return bool(
        np.any(
            (side(a[one], b[one], a[other]) * side(a[one], b[one], b[other]) <= 0)
            & (side(a[other], b[other], a[one]) * side(a[other], b[other], b[one]) <= 0)
            # Of segments on one line, which are on no side of each other.
            & (low[one] <= high[other]).all(axis=1)
            & (low[other] <= high[one]).all(axis=1)
        )
    )


def assemble(bodies: Sequence[Body]) -> tuple[Chains, Motion]:
    """Return the arrays of bodies at the start, all vertices free.

    Raises
    ------
    BodyError
        If a ring is open, crosses itself, is clockwise or has too few vertices.
    """
    for number, body in enumerate(bodies):
        _check(body, number)
    counts = np.array([len(body.points) for body in bodies])
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    vertices = int(start[-1])
    before, after = (
        np.arange(-1, vertices - 1, dtype=np.int32),
        np.arange(1, vertices + 1, dtype=np.int32),
    )
    per_vertex = {
        name: np.zeros(vertices)
        for name in ("stretch_stiffness", "bend_stiffness", "rest_length", "rest_angle", "mass")
    }
    per_chain = {
        name: np.zeros(len(bodies))
        for name in (
            "radius", "stretch_yield", "bend_yield", "stretch_damping", "bend_damping",
            "inner_damping",
            "core_stiffness", "core_pressure", "core_area",
        )
    }  # fmt: skip
    for p, body in enumerate(bodies):
        first, end = start[p], start[p + 1]
        if body.closed:
            before[first], after[end - 1] = end - 1, first
        else:
            before[first] = after[end - 1] = -1
        part = slice(first, end)
        length = np.hypot(*(np.roll(body.points, -1, axis=0) - body.points).T)
        if not body.closed:
            length[-1] = length[-2]  # of no segment; only its neighbours' mean uses it
        rest = length if body.rest_length is None else body.rest_length
        shared = 0.5 * (rest + np.roll(rest, 1))
        if not body.closed:
            shared[0] = shared[1]
        shell = body.shell
        weight = np.ones(len(rest)) if body.bend_weight is None else body.bend_weight
        angle = turning_angles(body.points, body.closed)
        per_vertex["stretch_stiffness"][part] = shell.stretch / rest
        per_vertex["bend_stiffness"][part] = shell.bend / shared * weight
        per_vertex["rest_length"][part] = rest
        per_vertex["rest_angle"][part] = angle if body.rest_angle is None else body.rest_angle
        per_vertex["mass"][part] = body.mass
        if not body.closed:  # no bar after the last vertex, no hinges at the ends
            per_vertex["stretch_stiffness"][end - 1] = 0.0
            per_vertex["bend_stiffness"][[first, end - 1]] = 0.0
        mean = float(rest.mean())
        per_chain["radius"][p] = body.radius
        per_chain["stretch_yield"][p] = shell.stretch_yield
        per_chain["bend_yield"][p] = shell.bend_yield
        # Two masses on a segment; a bar of ℓ and m turned by a hinge has m ℓ²/3.
        per_chain["stretch_damping"][p] = (
            2.0 * shell.stretch_damping * math.sqrt(0.5 * body.mass * shell.stretch / mean)
        )
        per_chain["bend_damping"][p] = (
            2.0 * shell.bend_damping * math.sqrt(body.mass * mean**2 / 3.0 * shell.bend / mean)
        )
        per_chain["inner_damping"][p] = shell.inner_damping
        per_chain["core_stiffness"][p] = body.core.stiffness
        per_chain["core_pressure"][p] = body.core.pressure
        if body.closed:
            x, y = body.points.T.copy()
            per_chain["core_area"][p] = ring_area(x, y, 0, len(x))
    chains = Chains(
        start=start,
        closed=np.array([body.closed for body in bodies], np.int32),
        core_law=np.array([CORE_LAWS.index(body.core.law) for body in bodies], np.int32),
        chain=np.repeat(np.arange(len(bodies), dtype=np.int32), counts).astype(np.int32),
        before=before,
        after=after,
        tension=np.zeros(vertices),
        moment=np.zeros(vertices),
        **per_vertex,
        **per_chain,
    )
    points = np.concatenate([body.points for body in bodies]).astype(float)
    speed = np.concatenate(
        [np.zeros_like(b.points) if b.velocity is None else b.velocity for b in bodies]
    ).astype(float)
    x, y = points.T.copy()
    vx, vy = speed.T.copy()
    none = np.zeros((6, vertices))
    free = np.ones((2, vertices))
    return chains, Motion(x, y, vx, vy, vx.copy(), vy.copy(), *none, *free)
