"""``python -m shear_sim`` is the command ``shear-sim``."""

from shear_sim.cli import main

main()
