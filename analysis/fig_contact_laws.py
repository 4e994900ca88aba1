"""Draw the contact laws as in Fig. S1-3 of the manual: r = 10 µm, E = 8 kPa, force per depth.

.venv/bin/python analysis/fig_contact_laws.py contact_laws
"""

import argparse
import math
from pathlib import Path

import pandas as pd

from shear_sim.figures import contact_laws, style
from shear_sim.models.microgel.law_curves import force_curve
from shear_sim.models.microgel.parameters import DivergentLaw, HertzLaw, LinearLaw, PlateauLaw

RADIUS, YOUNG_MODULUS = 10e-6, 8000.0
LAWS = {
    "linear (S1-5a)": LinearLaw(kind="linear"),
    "divergent (S1-5b)": DivergentLaw(),
    "Hertz, 3D (S1-13)": HertzLaw(kind="hertz"),
    "plateau (4.3.3)": PlateauLaw(kind="plateau"),
}


def table() -> pd.DataFrame:
    """Return the force of each law at each compression."""
    k = math.pi * YOUNG_MODULUS / 8
    return pd.concat(
        pd.DataFrame({"law": name, "of_study": True} | force_curve(section, 2 * RADIUS, k))
        for name, section in LAWS.items()
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stem", type=Path, help="path of the figure, without its ending")
    print(*style.save(contact_laws(table()), parser.parse_args().stem))


if __name__ == "__main__":
    main()
