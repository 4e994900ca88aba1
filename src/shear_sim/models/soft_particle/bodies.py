"""Bodies: rings and open chains as they are described, and the flat arrays made of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.checks import (
    array_of,
    crosses_itself,
    finite,
    limits,
    not_negative,
    positive,
    shaped,
    tangled,
)
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
        positive(young_modulus=young_modulus, thickness=thickness)
        if not -1.0 < poisson < 1.0:
            msg = f"poisson = {poisson:g} must be between -1 and 1"
            raise ValueError(msg)
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

    Lists and all else that numpy makes arrays of will do for arrays.

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
    velocity : (n, 2), optional
        Of the vertices [m/s].

    Raises
    ------
    BodyError
        If one of the arrays is none of numbers; all else is checked by `assemble`.
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
    velocity: FloatArray | None = None

    def __post_init__(self) -> None:
        """Make arrays of what is given for them."""
        for name in ("points", "rest_length", "rest_angle", "bend_weight", "velocity"):
            given = getattr(self, name)
            if given is not None:
                try:
                    object.__setattr__(self, name, array_of(name, given))
                except ValueError as error:
                    raise BodyError(str(error)) from None


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


def _check(body: Body) -> None:
    """Refuse what is no ring or chain; the error names what is wrong with it, not which it is."""
    points, shell, core = body.points, body.shell, body.core
    n = len(np.atleast_1d(points))
    least = FEWEST if body.closed else 2
    if n < least:
        kind = "ring" if body.closed else "chain"
        msg = f"a {kind} of {n} vertices: at least {least} are needed"
        raise ValueError(msg)
    shaped((n, 2), points=points)
    finite(points=points)
    positive(radius=body.radius, mass=body.mass)
    not_negative(
        stretch=shell.stretch, bend=shell.bend, stretch_damping=shell.stretch_damping,
        bend_damping=shell.bend_damping, inner_damping=shell.inner_damping,
    )  # fmt: skip
    limits(stretch_yield=shell.stretch_yield, bend_yield=shell.bend_yield)
    for name, check in (
        ("rest_length", positive), ("rest_angle", finite), ("bend_weight", not_negative),
    ):  # fmt: skip
        given = getattr(body, name)
        if given is not None:
            shaped((n,), **{name: given})
            check(**{name: given})
    if body.velocity is not None:
        shaped((n, 2), velocity=body.velocity)
        finite(velocity=body.velocity)
    check_core(core)
    ahead = np.roll(points, -1, axis=0) - points
    length = np.hypot(*ahead.T)[: n if body.closed else n - 1]
    if not length.min() > 0.0:
        k = int(length.argmin())
        msg = f"points {k} and {(k + 1) % n} are at the same place"
        if k == n - 1:
            msg += ": leave the last one out, a ring closes by itself"
        raise ValueError(msg)
    if crosses_itself(points, body.closed):
        msg = "the chain crosses itself"
        raise ValueError(msg)
    if not body.closed:
        if core.law != "none":
            msg = "it is open and has a core: closed = True, or core law none"
            raise ValueError(msg)
        return
    if ring_area(points[:, 0].copy(), points[:, 1].copy(), 0, n) <= 0.0:
        msg = "the points of a ring must be counter-clockwise"
        raise ValueError(msg)


def check_core(core: Core) -> None:
    """Refuse what is no core.

    Raises
    ------
    ValueError
        If its law is unknown, or its numbers mean nothing in it.
    """
    if core.law not in CORE_LAWS:
        msg = f"core law {core.law!r} is none: known are {', '.join(CORE_LAWS)}"
        raise ValueError(msg)
    not_negative(core_stiffness=core.stiffness)
    finite(core_pressure=core.pressure)
    if core.law == "gas":
        positive(core_pressure=core.pressure)
    unused = {"none": core.stiffness or core.pressure, "drained": core.stiffness}
    if unused.get(core.law):
        what = "stiffness or pressure" if core.law == "none" else "stiffness"
        msg = f"a core of law {core.law} has no {what}: another law, or 0"
        raise ValueError(msg)


def assemble(
    bodies: Sequence[Body], cell: tuple[float, float] | None = None
) -> tuple[Chains, Motion]:
    """Return the arrays of bodies at the start, in a periodic ``cell`` [m], all vertices free.

    Raises
    ------
    BodyError
        If one is no ring or chain, or two are in each other's way; says which and why.
    """
    for number, body in enumerate(bodies):
        try:
            _check(body)
        except ValueError as error:
            msg = f"particle {number}: {error}"
            raise BodyError(msg) from None
    if not bodies:
        msg = "there are no particles: bodies is empty"
        raise BodyError(msg)
    in_the_way = tangled([(body.points, body.closed) for body in bodies], cell)
    if in_the_way:
        raise BodyError(in_the_way)
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
