"""Microgel: bidisperse visco-elastic discs, with friction and permanent crosslinks."""

from shear_sim.models.microgel.parameters import MicrogelPoint

POINT = MicrogelPoint
PHYSICS_VERSION = 1
