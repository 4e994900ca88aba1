"""Draw the contact laws as in Fig. S1-3 of the manual: r = 10 µm, E = 8 kPa, force per depth.

.venv/bin/python analysis/fig_contact_laws.py contact_laws.png
"""

import math
import sys

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from shear_sim.models.microgel.laws import law_of
from shear_sim.models.microgel.parameters import DivergentLaw, HertzLaw, LinearLaw, PlateauLaw

RADIUS, YOUNG_MODULUS = 10e-6, 8000.0
LAWS = {
    "linear (S1-5a)": LinearLaw(kind="linear"),
    "divergent (S1-5b)": DivergentLaw(),
    "Hertz-like, 3D (S1-13)": HertzLaw(kind="hertz"),
    "plateau (4.3.3)": PlateauLaw(kind="plateau"),
}


def main(path: str) -> None:
    """Write the figure to ``path``."""
    compression = np.linspace(0, 2 * RADIUS, 400)
    fig, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
    for (name, section), style in zip(LAWS.items(), ("-", "--", "-.", ":"), strict=True):
        law, p = law_of(section)
        k = math.pi * YOUNG_MODULUS / 8
        force = [-law(2 * RADIUS - x, 2 * RADIUS, k, p) for x in compression]
        axes.plot(compression * 1e6, np.array(force) * 1e3, style, label=name)
    axes.set(
        xlabel="compression Δx [µm]",
        ylabel="force per depth F/L [mN/m]",
        xlim=(0, 20),
        ylim=(0, 300),
    )
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    fig.savefig(path, dpi=200)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "contact_laws.png")
