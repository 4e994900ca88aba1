"""The energy balance of a system, and the columns that it fills."""

from typing import NamedTuple


class Budget(NamedTuple):
    """Energies now, and work and losses since the start [J/m]; ``missing`` is what they leave."""

    kinetic: float
    stretch: float
    bend: float
    core: float
    normal: float
    tangential: float
    links: float
    by_walls: float
    by_forces: float
    by_velocities: float
    by_shear: float
    by_pressure: float
    stretch_yield: float
    bend_yield: float
    sliding: float
    separation: float
    damping: float
    drag: float
    broken: float
    missing: float


def ledger(budget: Budget) -> dict[str, float]:
    """Return the energy columns of a record."""
    return {
        "energy_stretch": budget.stretch,
        "energy_bend": budget.bend,
        "energy_core": budget.core,
        "energy_contact": budget.normal + budget.tangential,
        "energy_kinetic": budget.kinetic,
        "work": budget.by_walls + budget.by_shear,
        "lost_by_yield": budget.stretch_yield + budget.bend_yield,
        "lost_by_friction": budget.sliding + budget.separation,
        "lost_by_damping": budget.damping,
        "lost_by_drag": budget.drag,
        "energy_missing": budget.missing,
    }
