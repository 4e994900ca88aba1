"""State of a microgel simulation: the tuples of arrays and constants that the kernels share."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.models.microgel.laws import LawParameters
from shear_sim.threads import Meeting

Unsigned = NDArray[np.uint32]  # an index that cannot be negative costs no test of its sign

# Columns of a record, in the order of ``record``.
ROW = (
    "time", "strain", "strain_rate",
    "periodic_love_weber_xx", "periodic_love_weber_xy",
    "periodic_love_weber_yx", "periodic_love_weber_yy", "periodic_torque_yx",
    "love_weber_xx", "love_weber_xy", "love_weber_yx", "love_weber_yy", "internal_torque_yx",
    "external_xx", "external_xy", "external_yx", "external_yy",
    "torque_yx", "centrifugal_xx", "peculiar_xx", "peculiar_xy", "peculiar_yy",
    "coordination", "sliding_fraction",
)  # fmt: skip
ENERGIES = (
    "kinetic_energy", "elastic_energy", "energy_put_in", "lost_in_normal_dashpots",
    "lost_in_tangential_dashpots", "lost_by_drag", "lost_by_spin_drag", "lost_by_friction",
)  # fmt: skip

OPEN, STICK, SLIDE = 0, 1, 2  # state of a pair
REST, OSCILLATION, STEADY = 0, 1, 2  # segments of a protocol
RUNNING, NOT_FINITE, TOO_STIFF = 0, 1, 2  # status of a run
MOST_PIECES = 4096  # of a step


class Discs(NamedTuple):
    """State of N discs; every array has shape (N,)."""

    x: Floats  # position in the cell [m]
    y: Floats
    cx: Floats  # peculiar velocity [m/s]
    cy: Floats
    spin: Floats  # peculiar spin ω + γ̇/2 [1/s]
    radius: Floats  # [m]
    mass: Floats  # per metre of depth [kg/m]
    inertia: Floats  # [kg m]
    plate: Floats  # 0 free, +1 glued to the top plate, −1 to the bottom plate


class Work(NamedTuple):
    """Forces and predictions of the current instant; arrays of shape (N,) unless said.

    The discs are divided into S strips, see :mod:`strips`. Threads that share a simulation have a
    Work each, for some of the strips.
    """

    thread: int  # number of this one
    threads: int
    meeting: Meeting  # where they wait for each other
    edges: NDArray[np.int64]  # (S + 1,) first disc of each strip, and N
    lower: int  # strips of this thread: lower, lower + 1, ... below upper
    upper: int
    begin: np.uint64  # and their discs, likewise
    end: np.uint64
    extremes: Floats  # (threads, 8) what each has found that is largest or smallest
    pair_sums: Floats  # (S, SUMS) sums over the pairs of each strip
    disc_sums: Floats  # (S, SUMS) and over its discs
    px: Floats  # predicted peculiar velocity and spin: what velocity-dependent forces see
    py: Floats
    pspin: Floats
    fx: Floats  # contact force [N/m] and torque [N]
    fy: Floats
    torque: Floats
    ax: Floats  # acceleration of (cx, cy, spin)
    ay: Floats
    aspin: Floats
    turn: Floats  # rotation of each disc in the step that ends now
    disc_rows: Floats  # (8 N,) what pairs ask of each disc, see ``write_rows``
    force_rows: Floats  # (4 N,) force and torque / r that pairs have added up, and nothing
    x0: Floats  # position when the contact list was made
    y0: Floats
    wx: Ints  # image of the cell that a disc was in when the contact list was made
    wy: Ints
    lx: Floats  # place in the cell from its centre [m], 0 for glued discs (records)
    ly: Floats
    strain0: Floats  # (1,) strain when the contact list was made
    largest: Floats  # (1,) largest radius [m]
    turns: Ints  # (1,) whole widths by which the cell is re-gridded
    block: Floats  # (BLOCK_ROWS · LANES,) what the kernels know of one block of pairs
    closest: Floats  # (4,) smallest d/D, largest of a link, largest |d'|/d; smallest d/D so far
    stopped: Floats  # (2,) time [s] and strain of the positions, if the run had to stop
    tensors: Floats  # (SUMS,) sums of ``contact_forces`` for a record, over all pairs
    totals: Floats  # (SUMS,) sums over all discs
    stored: Floats  # (1,) elastic energy [J/m]
    power: Floats  # (7,) powers of the last instants, see ``tally`` [W/m]
    energy: Floats  # (6,) energy put in, and lost in each way, so far [J/m]
    check: Floats  # (1,) largest relative error of identity S1-19 in any record


class Pairs(NamedTuple):
    """Links, or discs that may touch: P pairs, of each strip those whose first disc lies in it.

    Each strip begins at a row of ``table``: after the last pair of another follow some of disc 0
    with itself, which are no pairs. Of strips that are another thread's there are only pairs
    whose second disc is this thread's.

    What is known of a pair lies in ``table``, LANES pairs a row and one column after the other, so
    that the compiler sees fixed distances and can take several pairs at once. Outside the kernels
    use `column` and `set_column`.
    """

    i: Unsigned  # (P,)
    j: Unsigned
    table: Floats  # (⌈P/LANES⌉, PAIR_ROWS · LANES)
    strips: NDArray[
        np.int64
    ]  # (S, 2 + NEAR) FIRST pair, COUNT to work out, listed to each distance


class PairState(NamedTuple):
    """What is known of P pairs, one array (P,) each: copies, see `listed`."""

    i: Ints
    j: Ints
    nx: Ints  # image of j
    ny: Ints
    ex: Floats  # unit vector from i to j at the last force evaluation
    ey: Floats
    distance: Floats  # [m]
    spring: Floats  # tangential elongation ξ [m]
    state: Ints  # OPEN, STICK or SLIDE


LANES = 128  # pairs in a block
#: Columns of Pairs.table: image of j, D = r_i + r_j [m] and its inverse; unit vector from i to j
#: and distance [m] at the last force evaluation; tangential elongation ξ [m], and the second one
#: of the historical rule; OPEN, STICK or SLIDE.
(
    NX, NY, SUM, PER_SUM, EX, EY, DISTANCE, SPRING, SPRING_BACK, STATE,
) = range(0, 10 * LANES, LANES)  # fmt: skip
PAIR_ROWS = 10
BLOCK_ROWS = 22
#: Where Pairs.table and Work.block begin [bytes]: at multiples of a column, but for half of one. A
#: processor that knows an address by its last 12 bits would else take what is written to one for
#: what is read from the other, and wait: a step then took up to half as long again.
PERIOD, PHASE = 8 * LANES, 4 * LANES
NEAR = 4  # distances by which listed contacts are told apart
SUMS = 16  # made of each strip, at most
#: Columns of Pairs.strips: the first pair, how many may act by now, and how many are listed that
#: are at most so far apart; the last of these is all of them.
FIRST, COUNT, WITHIN, ALL = 0, 1, 2, 1 + NEAR


def places_of(pairs: Pairs, which: int = ALL) -> NDArray[np.int64]:
    """Return where the pairs lie among ``pairs.i``; of COUNT only those that may act by now."""
    strips = [np.arange(row[FIRST], row[FIRST] + row[which]) for row in pairs.strips]
    return np.concatenate(strips)


def listed(pairs: Pairs) -> PairState:
    """Return the state of ``pairs`` as plain arrays."""
    at = places_of(pairs)
    i, j = (ends[at].astype(np.int32) for ends in (pairs.i, pairs.j))
    nx, ny, state = (column(pairs, which)[at].astype(np.int32) for which in (NX, NY, STATE))
    ex, ey, distance, spring = (column(pairs, which)[at] for which in (EX, EY, DISTANCE, SPRING))
    return PairState(i, j, nx, ny, ex, ey, distance, spring, state)


def column(pairs: Pairs, which: int) -> Floats:
    """Return a copy of one column of ``pairs.table``, (P,), by its name above."""
    return pairs.table[:, which : which + LANES].ravel()[: len(pairs.i)].copy()


def set_column(pairs: Pairs, which: int, values: Any) -> None:
    """Set one column of ``pairs.table`` to ``values``, (P,) or a number."""
    full = pairs.table[:, which : which + LANES].ravel()
    full[: len(pairs.i)] = values
    pairs.table[:, which : which + LANES] = full.reshape(-1, LANES)


class Springs(NamedTuple):
    """Springs and dashpots of a kind of pairs: links or contacts (SI, per metre of depth)."""

    k: float  # normal spring [N/m²]
    kt: float  # tangential
    eta: float  # normal dashpot [N s/m²]
    etat: float  # tangential
    far_etat: float  # tangential dashpot beyond contact
    reach: float  # distance to which the pair holds together: 0 or ∞ [m]
    grip: float  # what Coulomb's bound is raised by: 0 or ∞ [N/m]
    pull: float  # largest attraction: ∞, or 0 if dashpots of contacts may not pull [N/m]


class Constants(NamedTuple):
    """Everything that stays the same during a run (SI, per metre of depth)."""

    width: float
    height: float
    periodic: bool
    plates: bool
    k: float  # contacts: normal spring [N/m²]
    kt: float
    eta: float  # and dashpot [N s/m²]
    etat: float
    link_k: float
    link_kt: float
    link_eta: float
    link_etat: float
    friction: float
    law: LawParameters
    may_pull: bool  # the normal dashpot of a contact may attract
    stretched_dashpot: bool  # tangential dashpot of a link with d ≥ D
    contact_arms_in_velocity: bool
    contact_arms_in_torque: bool
    damping: float  # λ [1/s]
    spin_damping: float  # λ or 0
    spin_target: float  # s₀ / γ̇: 0 or 1/2
    affine: bool  # SLLOD, or driven at the edges alone
    skin: float  # [m]
    step_normal: float  # 2/ω of vibrations of six contacts at d = D [s]
    step_energy: float  # longest substep that keeps their energy, where d = D [s]
    step_normal_dashpot: float  # 1/γ of their dashpots [s]
    step_rolling: float  # 2/ω of their rolling [s]
    step_rolling_dashpot: float  # 1/γ of it [s]
    step_approach: float  # largest relative change of the length of a contact in a substep [-]
    step_strain: float  # longest substep in strain [-]


class Clock(NamedTuple):
    """The protocol in whole steps: rest, shear from ``begin`` to ``end``, rest."""

    step: float  # H [s]
    begin: int
    end: int
    kind: int
    per_period: int
    amplitude: float  # strain amplitude, or strain per step
    every: int  # steps between records
