"""State of soft particles: the tuples of flat arrays that the kernels share.

V vertices, chain after chain, closed chains (rings) counter-clockwise. Segment k goes from vertex k
to ``after[k]``, hinge k is at vertex k; both are stored at k. Everything is per metre of depth.
"""

from typing import NamedTuple

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.threads import Meeting

# Laws of the core: pressure p of the area A, see ``kernels.core_pressure``.
HOLLOW, ELASTIC, DRAINED, GAS, LOGARITHMIC = 0, 1, 2, 3, 4
CORE_LAWS = ("none", "elastic", "drained", "gas", "log")

RUNNING, LISTS_USED_UP, NOT_FINITE, TOO_FAST, TOO_MANY_RUNS = 0, 1, 2, 3, 4  # status of a march

# Work done and energy lost so far, each by its own force [J/m]: places in ``Work.energy``.
STRETCH_YIELD, BEND_YIELD, DAMPING, DRAG, SLIDING, SEPARATION, IMPOSED, BROKEN, SHEARING = range(9)
ENERGIES = 9
LINE = 16  # numbers between what strips write at once: each has cache lines of its own

SLOTS = 4  # separate places where one vertex can touch with friction at once


class Chains(NamedTuple):
    """What N chains of V vertices are made of; the hinges and bars change only by yielding."""

    start: Ints  # (N + 1,) chain p has the vertices start[p]:start[p + 1]
    closed: Ints  # (N,) 1: a ring
    radius: Floats  # (N,) r, half the thickness in contacts [m]
    stretch_yield: Floats  # (N,) force at which a segment yields [N/m]
    bend_yield: Floats  # (N,) moment at which a hinge yields [N]
    stretch_damping: Floats  # (N,) force per rate of length [N s/m²]
    bend_damping: Floats  # (N,) moment per rate of angle [N s]
    inner_damping: Floats  # (N,) force of a vertex per velocity against its particle [N s/m²]
    core_law: Ints  # (N,)
    core_stiffness: Floats  # (N,) K_Ω [Pa]
    core_pressure: Floats  # (N,) p₀, at the area A₀ [Pa]
    core_area: Floats  # (N,) A₀ [m²]
    chain: Ints  # (V,) chain of a vertex
    before: Ints  # (V,) vertex before, −1 at the start of an open chain
    after: Ints  # (V,) vertex after, −1 at its end
    mass: Floats  # (V,) [kg/m]
    stretch_stiffness: Floats  # (V,) k_s of segment k [N/m²]
    bend_stiffness: Floats  # (V,) k_b of hinge k [N]
    rest_length: Floats  # (V,) ℓ₀ + plastic part [m]
    rest_angle: Floats  # (V,) θ₀ + plastic part
    tension: Floats  # (V,) of segment k, now [N/m]
    moment: Floats  # (V,) of hinge k, now [N]


class Motion(NamedTuple):
    """Where the V vertices are and what moves them; arrays of shape (V,) unless said."""

    x: Floats  # [m]
    y: Floats
    vx: Floats  # [m/s]; at the half step within a step
    vy: Floats
    px: Floats  # predicted velocity, which dashpots and friction see
    py: Floats
    fx: Floats  # force without dashpots and drag [N/m]
    fy: Floats
    dx: Floats  # force of the dashpots [N/m]
    dy: Floats
    gx: Floats  # constant imposed force, weight included [N/m]
    gy: Floats
    free_x: Floats  # 1, or 0 where the velocity is imposed
    free_y: Floats


class Lists(NamedTuple):
    """Pairs of a vertex and a segment near it, in the order of vertices, then of segments.

    And room for what is found in a step: which of them touch, and where, see ``friction``.
    """

    vertex: Ints  # (C,)
    segment: Ints  # (C,)
    kind: Ints  # (C,) ONE_SIDED, TWO_SIDED or LAST
    reach: Floats  # (C,) distance of touching, the sum of both radii [m]
    image: tuple[Ints, ...]  # 2 of (C,): widths, heights of the cell that the segment is off by
    shift: tuple[Floats, ...]  # 2 of (C,): that displacement in x and y, now [m]
    strain: Floats  # (1,) of the cell when the lists were made
    span: Floats  # (1,) bound on the distance of a vertex from either end of its segments [m]
    x: Floats  # (V,) where the vertices were when the lists were made [m]
    y: Floats
    touching: Ints  # (C,)
    place: Ints  # (3C, 4)
    found: Floats  # (3C, 7)
    run: Ints  # (3C,)
    first: Ints  # (S + 1,) pair that each strip begins with, and C


# Contact from outside a ring; with an open chain or the own one; with the last segment of one.
ONE_SIDED, TWO_SIDED, LAST = 0, 1, 2


class Cell(NamedTuple):
    """A periodic cell under γ(t) = A sin ωt, or none."""

    size: Floats  # (2,) width and height [m]; 0: there is no cell
    wave: Floats  # (2,) A and ω [1/s]
    steps: Ints  # (1,) made since γ = 0
    strain: Floats  # (3,) γ and γ̇ [1/s] now, and the mean γ̇ of the step before
    #: (S, 2, 4) of each strip, of forces and of dashpots: Σ f_x s_x, Σ f_x s_y, Σ f_y s_x,
    #: Σ f_y s_y, s: displacement of the image that each contact is with [N]
    images: Floats


class Springs(NamedTuple):
    """Tangential springs of the contacts of every vertex with chains and walls."""

    segment: Ints  # (V, SLOTS) main segment of a contact, −1: slot not in use
    force: Floats  # (V, SLOTS) [N/m]
    wall: Floats  # (W, V) [N/m]


class Walls(NamedTuple):
    """W rigid half-planes n·x < position; arrays of shape (W,)."""

    nx: Floats  # unit normal, from the wall to the particles
    ny: Floats
    position: Floats  # [m]
    velocity: Floats  # along n; at the half step within a step [m/s]
    slide: Floats  # velocity along the tangent (−n_y, n_x) [m/s]
    mass: Floats  # of a wall that moves by itself [kg/m]; 0: it moves at ``velocity``
    load: Floats  # force on such a wall towards the particles [N/m]
    damping: Floats  # force on it per velocity [N s/m²]
    push: Floats  # normal force on the particles, now [N/m]
    drive: Floats  # tangential force on the particles, now [N/m]
    loss: Floats  # part of ``push`` that is of dashpots [N/m]
    work: Floats  # done by the wall so far [J/m]


class Links(NamedTuple):
    """L cohesive links; arrays of shape (L,), see ``links``."""

    vertex: Ints
    segment: Ints
    brother: Ints  # link at the other end of the interface; itself if there is none
    intact: Ints
    share: Floats  # of the segment, where the link is fixed to it
    across: Floats  # n·Δ and t·Δ at the start [m]
    along: Floats
    length: Floats  # of the interface [m]
    pull: Floats  # normal and tangential force of now, or the last ones [N/m]
    shear: Floats
    lost: Floats  # energy lost when it broke [J/m]
    law: Floats  # (6,) k_n, k_t [N/m²], f_n⁰, f_t⁰ [N/m], α, G_c [N/m] or 0


class Rigid(NamedTuple):
    """B rigid bodies; arrays of shape (B,), but for the arms."""

    chain: Ints
    mass: Floats  # [kg/m]
    inertia: Floats  # about the centre [kg m]
    x: Floats  # centre [m]
    y: Floats
    angle: Floats
    vx: Floats  # [m/s]; at the half step within a step
    vy: Floats
    spin: Floats  # [1/s]
    armx: Floats  # (V,) vertex − centre at angle 0 [m]
    army: Floats


class Rules(NamedTuple):
    """Constants of contacts and motion."""

    stiffness: float  # k_n [N/m²]; twice that at walls
    tangential: float  # k_t [N/m²]
    friction: float  # μ
    dashpot: float  # β: f = k_n h (1 − β ḣ⁻) [s/m]
    drag: float  # force of a vertex per velocity [N s/m²]
    step: float  # δt [s]


class Work(NamedTuple):
    """What a march writes down."""

    energy: Floats  # (ENERGIES,) [J/m]
    ledger: Floats  # (S, LINE) of which that is the sum: what each strip has written down [J/m]
    travelled: Floats  # (1,) bound on any displacement since the lists were made [m]
    # Least distance / distance of touching of any contact so far: of those from outside, with a
    # sign, and of two-sided ones.
    closest: Floats  # (2,)
    near: Ints  # (2,) the vertex of each, −1 if there was none
    scratch: tuple[Floats, ...]  # 8 of (V,): room for bars and hinges
    held: Ints  # (V,) features that a vertex touched with friction at the step before


class Strips(NamedTuple):
    """S strips of whole chains, and which of them a thread has, see ``strips``."""

    thread: int
    threads: int
    lower: int  # the first strip of this thread
    upper: int  # one past its last
    meeting: Meeting  # where threads wait for each other
    chain: Ints  # (S + 1,) first chain of each strip, and N
    vertex: Ints  # (S + 1,) its first vertex, and V
    start: Ints  # (N + S,) ``Chains.start`` of each strip, counted from its first vertex
    held: Ints  # (S + 1,) its first of the vertices with an imposed velocity, and H
    link: Ints  # (S + 1,) its first link, and L
    fastest: Floats  # (S,) largest square of a velocity [m²/s²]
    farthest: Floats  # (S,) largest distance from where the lists were made [m]
    status: Ints  # (S,)
    walls: Floats  # (S, 3, W) push, loss and drive of the walls on each strip [N/m]


class Mail(NamedTuple):
    """Forces of each strip on vertices of others, in the order in which they are found."""

    first: Ints  # (S + 1,) where the room of each strip begins
    sent: Ints  # (S, LINE) of which the first is how many there are
    vertex: Ints  # (M,) a vertex; −1 − vertex: of a dashpot
    force: Floats  # (M, 2) [N/m]


def springs(vertices: int, walls: int) -> Springs:
    """Return springs without tension."""
    return Springs(
        np.full((vertices, SLOTS), -1, np.int32),
        np.zeros((vertices, SLOTS)),
        np.zeros((walls, vertices)),
    )


def work(vertices: int, strips: int) -> Work:
    """Return the ledger of a march that begins."""
    return Work(
        np.zeros(ENERGIES),
        np.zeros((strips, LINE)),
        np.zeros(1),
        np.full(2, np.inf),
        np.full(2, -1, np.int32),
        tuple(np.zeros((8, vertices))),
        np.zeros(vertices, np.int32),
    )


def cell(strips: int, width: float = 0.0, height: float = 0.0) -> Cell:
    """Return a cell without shear."""
    return Cell(
        np.array([width, height]), np.zeros(2), np.zeros(1, np.int32), np.zeros(3),
        np.zeros((strips, 2, 4)),
    )  # fmt: skip
