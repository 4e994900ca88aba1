"""Which steps are stable: bounds on vibrations and dashpots.

With bounds ω on all frequencies and Γ on the rates of dashpots, the scheme of ``motion`` is stable
where

    (δt ω)²/4 + δt Γ ≤ 1                                                                  (SP.10)

as dashpots see velocities that are predicted half a step ahead. Nothing here needs Numba, so that a
study is checked when it is read, by the same bounds as the chains that are made of it later.
"""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shear_sim.models.soft_particle.parameters import SoftParticle

CONTACTS = 4.0  # chains that one vertex can be thought to touch at once
LARGEST = 0.9  # δt / (2/ω)


def squared_frequency(
    stretch: float, bend: float, length: float, contact: float, core: float, mass: float
) -> float:
    """Return a bound ω² [1/s²] of a chain: of its bars, hinges, contacts and core.

    ω² m = 4 k_s + 16 k_b/ℓ² + 2·4 k_n + (K_Ω/A₀) Σ|∂A/∂x_k|² + |p₀|, each the largest of the chain;
    the last two are ``core``, and the sum is 2 sin(2π/N) A₀ for a ring of N equal segments.
    """
    return (4.0 * stretch + 16.0 * bend / length**2 + 2.0 * CONTACTS * contact + core) / mass


def squared_wall_frequency(contact: float, touching: int, mass: float) -> float:
    """Return a bound ω² [1/s²] of a wall that moves by itself, with ``touching`` vertices at it.

    ω² M = 3/2 · 2 k_n each. With the displacements u of a vertex and w of the wall,
    2 k_n (u − w)² ≤ 6 k_n u² + 3 k_n w², of which the first is less than the bound of a chain has.
    """
    return 3.0 * contact * touching / mass


def damping_rate(
    stretch: float, bend: float, length: float, contact: float, drag: float, mass: float
) -> float:
    """Return a bound Γ [1/s] of a chain: the same sum, of coefficients of dashpots.

    Of bars and contacts [N s/m²], of hinges [N s]; ``drag`` is that and the inner damping.
    """
    return (4.0 * stretch + 16.0 * bend / length**2 + 2.0 * CONTACTS * contact + drag) / mass


def damped_share(squared: float, rate: float) -> float:
    """Return the longest step of (SP.10) / 2/ω, of bounds ω² and Γ."""
    share = rate / math.sqrt(squared)
    return math.sqrt(1.0 + share * share) - share


def longest_share(model: "SoftParticle", vertices: int) -> float:
    """Return the largest stable ``integrator.step`` of the mean ring of a study.

    Contacts are left out: their dashpots count by how deep they are, and none is at the start.
    """
    # With R, E/(1 − ν²) and the mass of a vertex 1.
    angle, bending = math.pi / vertices, model.thickness**3 / 12.0
    segment = 2.0 * math.sin(angle)
    length = segment / (1.0 + 0.5 * model.core_pressure)  # of bars without tension
    stretch, bend = model.thickness / length, bending / length
    shell = model.thickness / segment * math.tan(angle)
    rest = model.core_pressure * shell
    core = rest if model.core == "gas" else model.core_ratio * shell
    squared = squared_frequency(
        stretch, bend, length, model.contact_stiffness * bending / segment**3,
        2.0 * math.sin(2.0 * angle) * core + rest, 1.0,
    )  # fmt: skip
    slowest = math.sqrt(36.0 / 5.0 * bending * 2.0 * angle)  # ω₁
    rate = damping_rate(
        2.0 * model.damping * math.sqrt(0.5 * stretch),
        2.0 * model.damping * math.sqrt(length**2 / 3.0 * bend),
        length, 0.0, (model.drag + model.inner_damping) * slowest, 1.0,
    )  # fmt: skip
    return min(LARGEST, damped_share(squared, rate))


def at_most(longest: float) -> str:
    """Return a number to be asked for, in two or three digits, that is not over ``longest``."""
    return f"{0.995 * longest:.3g}"
