r"""Soft particles: elasto-plastic shells of mass points around compressible cores.

Source: Trivino, Richefeu, Radjai, Lampoh & Delenne, "A soft particle dynamics method based on
shape degrees of freedom" (arXiv:2503.22827); "paper (n)" below is its equation n. Everything is per
metre of depth, tension and angles counter-clockwise are positive. Where the paper and mechanics
disagree, mechanics holds; each place is named here, and the tests show it.

**Shell.** Vertices of mass m, bars between them, a hinge at each. Of a material E, ν, h::

    k_s = E h / ℓ (1 − ν²)                                                                 (SP.1)
    k_b = E h³ / 12 ℓ (1 − ν²)                                                             (SP.2)

(paper (10), (11) are those of a depth s = ℓ.) With ℓ_k the length of bar k and θ_k the angle from
bar k − 1 to bar k::

    F_k = k_s (ℓ_k − ℓ₀ − ℓ_p),   |F_k| ≤ F^Y                                              (SP.3)
    M_k = k_b (θ_k − θ₀ − θ_p),   |M_k| ≤ M^Y                                              (SP.4)

The plastic parts ℓ_p, θ_p move so that the bound holds (return mapping); increments that are left
out as in paper (2) would stop short of it. The force of a hinge is −∂(M²/2k_b)/∂x: a couple M on
each bar, M/ℓ at its ends. Paper (8), (9) have half of that.

**Core.** Pressure of the area A (paper (4) is the first), half of p ℓ on each end of a bar::

    p = p₀ − K_Ω (A − A₀)/A₀,  p₀,  p₀ A₀/A  or  p₀ − K_Ω ln(A/A₀)                         (SP.5)

A ring of N bars has K_∂Ω = k_s tan(π/N) by itself (paper (22); not 2π/N as in (23)), and with its
core K_∂Ω + K_Ω: ``core_ratio`` η = K_Ω/K_∂Ω. A ring with p₀ > 0 is at rest in its shape: its bars
have the tension p₀ ℓ/2 tan(π/N).

**Contacts** of vertices with segments, Eqs. (SP.6) of ``contacts``, (SP.7) of ``friction``: a
potential that counts everything once and is once continuously differentiable, friction that keeps
angular momentum. Walls are planes with springs 2 k_n.

**Sheared cell.** All vertices follow γ(t), dx = y dγ; what they move against that flow, w, obeys
m dw_x/dt = F_x − m γ̇ w_y (SLLOD). So the shear does the work V τ γ̇, with τ = −σ_xy and, over all
pairs that act on each other through any image,

    V σ_ab = Σ f_a r_b + Σ m w_a w_b                                                      (SP.12)

Rough plates are vertices that stay at y = 0, and so their images at y = H: forces on them count as
if they acted on that line, and τ is the shear force of a plate per length.

**Motion.** m dv/dt = F, velocity Verlet; Eq. (SP.9) of ``motion`` is its energy balance. The step
is a fraction of 2/ω, with a bound ω on all frequencies, cores and contacts included, and is stable
with its dashpots, Eq. (SP.10) of ``stability``; the paper's √(m/k) forgets the core.

**Diametral compression.** A ring between two plates. F R²/EI and V/V₀ of an elastic ring follow the
elastica, that is a ring with flat contacts bears at their two ends and nowhere in between: paper
(31), (34), F = F* L_c/ℓ, and the plateaus of its figures 16 and 18 do not follow from the model.
A plastic one follows DeRuntz & Hodge.

**Tissues.** Cells that fill a box, the Laguerre–Voronoi tessellation of discs, Eq. (SP.11) of
``tissue``, linked at the ends of their interfaces, Eq. (SP.8) of ``links``, and pulled by grips.
Links pull but never push, which contacts do: where paper (39) lets pressure strengthen a link
against shear, here it breaks at |f_t| = f_t⁰.

**Beams and free rings.** A beam of n segments bends as n hinges do, F L³/3EI (1 + 1/2n²) if the
hinge of its clamp is twice as stiff, and F L³/48EI (1 + 2/n²) supported at both ends; paper (16),
(17) are of a load spread over it. A ring buckles under p = 3 EI/R³ from outside.

Reading order: ``parameters``, ``driving``, ``scenario``, ``diametral``, ``suspension``, ``system``,
``motion``, ``kernels``, ``contacts``, ``friction``; then ``compaction``, ``tension``, ``beam``,
``free_ring``.
"""

from collections.abc import Sequence

from shear_sim.models.interface import Simulation, SnapshotUnits
from shear_sim.models.soft_particle.columns import COLUMNS, DERIVED, MEASURED, derive
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.streams import Streams

POINT = SoftParticlePoint
PHYSICS_VERSION = 5  # raised with any change of numbers; part of every job id
THREADS = "one for each 2,000 vertices: 2, 4, 8 or 16"
SNAPSHOT_UNITS = SnapshotUnits(
    "m",
    "N/m",
    "plus, on the diagonal, the sum of particles/core of the GSD file / area is the stress of "
    "springs and cores: without friction exactly, with it to 1 % of the pressure. The stress of "
    "the result has dashpots and inertia too, of up to 4 % of the pressure at the first record "
    "and 2 % later. Between plates a fixed vertex counts as one at y = 0; of a box the area is "
    "box_area of the result, whose stress is that on the walls. Rigid particles have no part in "
    "the sum",
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


def most_threads(point: SoftParticlePoint) -> int:
    """Return one for each strip of particles.

    A tissue has up to a fifth more vertices than are counted here, and so, rarely, more strips.
    """
    from shear_sim.models.soft_particle.strips import strip_count  # loads Numba

    packing = point.packing
    return strip_count(packing.particles * packing.vertices, packing.particles)


def start(point: SoftParticlePoint, streams: Streams) -> Simulation:
    """Prepare a simulation: a ring that touches two plates, a box of rings, or a tissue."""
    from shear_sim.models.soft_particle.simulation import SoftParticleSimulation  # loads Numba

    return SoftParticleSimulation(point, streams)


def compile_for(points: Sequence[SoftParticlePoint]) -> None:
    """Compile all kernels, or load them from the cache."""
    from shear_sim.models.soft_particle.simulation import compile_kernels

    compile_kernels(points)
