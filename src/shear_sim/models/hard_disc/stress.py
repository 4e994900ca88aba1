"""Stress of a contact network, and the time that a flow at fixed stress takes."""

import numpy as np

from shear_sim.models.hard_disc.flow import Contacts, Dense, contacts_at

# Gauss–Legendre: the stress along a step is nearly a polynomial of low degree.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


def stress(contacts: Contacts) -> tuple[float, float, float]:
    """Return σ_xx, σ_xy, σ_yy, compression positive, in units of path rate / ξ₀ (HD.5)."""
    phi, rx, ry, area = contacts.phi, contacts.rx, contacts.ry, contacts.area
    return (
        float((phi * rx * rx).sum()) / area,
        float((phi * rx * ry).sum()) / area,
        float((phi * ry * ry).sum()) / area,
    )


def slowness(scaled_stress: float, imposed: float, fastest: float) -> float:
    """Return 1/γ̇ of a flow at fixed stress.

    The forces are γ̇/ξ₀ times those of unit rate, so γ̇ = σ Ω / (qᵀN⁻¹q) = (σ ξ₀) / σ₁ with the
    stress σ₁ at unit rate; without contacts nothing resists but the limit.

    Parameters
    ----------
    scaled_stress : float
        σ₁ = σ ξ₀/γ̇.
    imposed : float
        σ ξ₀ [1/s].
    fastest : float
        Largest γ̇ [1/s].
    """
    return max(scaled_stress / imposed, 1.0 / fastest)


def duration(motion: Dense, begin: float, end: float, imposed: float, fastest: float) -> float:
    """Return ∫dγ/γ̇ [s] of a flow at fixed stress between two points of a step."""
    half = 0.5 * (end - begin)
    total = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        _, xy, _ = stress(contacts_at(motion, begin + half * (1.0 + float(node))))
        total += float(weight) * slowness(-motion.shear * xy, imposed, fastest)
    return half * total
