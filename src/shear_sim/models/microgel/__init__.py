"""Microgel: bidisperse visco-elastic discs, with friction and permanent crosslinks."""
