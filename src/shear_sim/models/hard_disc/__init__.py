r"""Hard discs: overdamped, frictionless, rigid discs in a sheared cell, from event to event.

Source: Lerner, Düring & Wyart, "Simulations of driven overdamped frictionless hard spheres" (2013);
"paper (n)" below is its equation n. Lengths are in mean diameters of the small discs, velocities
per unit of path (the strain, whichever way it goes), forces in units of path rate / ξ₀.

**State.** Positions R_i, the cell, and the set of contacts. Disc i moves with the flow and with
what pushes it::

    dR/dγ = (g y − κ x, −κ y) + u,    u_i = ξ_i (F_i + Σ_c S_ci φ_c)                        (HD.1)

g = ±1 is the direction of the shear, κ the rate of isotropic compression (paper (21), whose sign of
κ is a misprint). Contact c of discs i, j at r = R_j − R_i has force f = φ |r|; S_ci = −r, S_cj = r.
Forces are the unique solution of the linear complementarity problem::

    0 ≤ φ ⊥ w = N φ + q ≥ 0                                                                  (HD.2)
    N = S Ξ Sᵀ,   Ξ = diag ξ                                                                 (HD.3)
    q = g r_x r_y − κ r² + r·(ξ_j F_j − ξ_i F_i)                                             (HD.4)

with w = r·dr/dγ: touching discs push or part (paper (18), appendix A). ``active_set`` solves it
from the contacts of the instant before, ``factor`` holds the sparse LDLᵀ of N.

**Stress** (paper (30), (24)) and the power identity that every record is checked against::

    σ_ab = Σ_c φ r_a r_b / Ω (compression positive),   σ = −σ_xy,   p = (σ_xx + σ_yy)/2      (HD.5)
    Σ_i u_i²/ξ_i = ⟨u|F⟩ + Ω (g σ + 2 κ p)                                                   (HD.6)

**Motion.** While the contacts stay, r·r = D² for each of them, and all equations are polynomials in
R, φ and κ. So power series R = Σ R_k γ^k, φ = Σ φ_k γ^k follow order by order::

    N φ_k = −(k+1)/2 Σ_{m=1..k} r_m·r_{k+1−m} − r_0·(all of (k+1) r_{k+1} but φ_k)           (HD.7)

with one matrix for all orders (``series``). The last terms give the longest step; a record anywhere
on the way is a value of the series, so records never change a step.

**Events.** An opening is the first zero of a φ_c(γ), a collision the first zero of the gap of a
pair without contact; Newton steps that cannot pass a root find both (`series.first_crossing`).
After each step the gaps of contacts, 1e-14 by then, are set to zero (paper (28)).

**Fixed pressure.** κ is unknown too; m = r² of each contact::

    N φ − κ m = −q|_{κ=0},   mᵀφ = 2 p Ω                                                     (HD.8)

N may be singular here although the system is not: the contact that depends most on the others is
kept out of the factor, and stands with κ in the border. Paper (25) would divide by zero.

**Nearly dependent contacts.** Next to a state that bears itself N has an eigenvalue λ, the square
of a singular value of Ξ½ Sᵀ, and forces grow as 1/λ. Under 1e-7 the factor comes from rotations of
Ξ½ Sᵀ itself, which sees singular values down to 1e-11: such discs move on, fast but not jammed.

**Jamming.** Where no forces stop a pair, the direction of (HD.2) that never ends is a state φ₀ > 0
with Sᵀφ₀ = 0 that resists the drive, ⟨φ₀|q⟩ < 0 (``certificate``).

**Composites and walls.** A contact between beads of a body is permanent: it stays, and its force
may have any sign. Immobile discs (ξ = 0) go with the flow, whoever pushes them.

Reading order: ``parameters``, ``packing`` (starts), ``flow`` (one step), ``series``,
``active_set``, ``driving`` (what changes on the way), ``simulation``.
"""

from collections.abc import Sequence

from shear_sim.models.hard_disc.columns import COLUMNS, DERIVED, MEASURED, derive
from shear_sim.models.hard_disc.parameters import HardDiscPoint
from shear_sim.models.interface import Simulation, SnapshotUnits
from shear_sim.streams import Streams

POINT = HardDiscPoint
PHYSICS_VERSION = 3  # raised with any change of numbers; part of every job id
THREADS = "one"
SNAPSHOT_UNITS = SnapshotUnits(
    "λ",
    "λ path rate/ξ₀",
    "is the stress of the result in units of path rate/ξ₀: half its trace is scaled_pressure",
)

__all__ = [
    "COLUMNS",
    "DERIVED",
    "MEASURED",
    "PHYSICS_VERSION",
    "POINT",
    "SNAPSHOT_UNITS",
    "THREADS",
    "compile_for",
    "derive",
    "most_threads",
    "start",
]


def most_threads(point: HardDiscPoint) -> int:  # noqa: ARG001 - of other models it depends on it
    """Return 1: every step solves for the forces of all contacts at once."""
    return 1


def start(point: HardDiscPoint, streams: Streams) -> Simulation:
    """Prepare a simulation: discs without overlap."""
    from shear_sim.models.hard_disc.simulation import HardDiscSimulation  # loads Numba

    return HardDiscSimulation(point, streams)


def compile_for(points: Sequence[HardDiscPoint]) -> None:
    """Compile all kernels, or load them from the cache."""
    from shear_sim.models.hard_disc.simulation import compile_kernels

    compile_kernels(points)
