"""The contact laws of Fig. S1-3: r = 10 µm, E = 8 kPa, force per metre of depth."""

import math
from itertools import pairwise

import pytest

from shear_sim.models.microgel.laws import custom, law_of
from shear_sim.models.microgel.parameters import (
    CustomLaw,
    DivergentLaw,
    HertzLaw,
    LinearLaw,
    PlateauLaw,
)

E, R = 8000.0, 10e-6
D = 2 * R
K = math.pi * E / 8  # S1-8
LAWS = [
    LinearLaw(kind="linear"),
    DivergentLaw(),
    DivergentLaw(repulsion=0.3),
    PlateauLaw(kind="plateau"),
    HertzLaw(kind="hertz"),
]


def force(section, compression):
    law, p = law_of(section)
    return -law(D - compression, D, K, p)


def test_linear_law_reaches_its_maximum_when_discs_merge():
    """S1-4: |F| = k (d_i + d_j)/2 = 62.8 mN/m, the end of the straight line in the figure."""
    assert force(LAWS[0], D) == pytest.approx(math.pi * 1000 * 20e-6)
    assert force(LAWS[0], 5e-6) == pytest.approx(K * 5e-6, rel=1e-15)


def test_divergent_law():
    """S1-5b: twice the linear force at half compression; S1-6: at most 1000 k D."""
    assert force(LAWS[1], R) == pytest.approx(2 * K * R)
    assert force(LAWS[1], 1e-3 * R) == pytest.approx(K * 1e-3 * R, rel=1e-3)
    assert force(LAWS[1], D) == 1000 * K * D
    assert force(LAWS[1], D * (1 - 1e-5)) == 1000 * K * D


def test_repulsion_weighs_the_divergent_part():
    linear, divergent = force(LAWS[0], R), force(LAWS[1], R)
    assert force(LAWS[2], R) == pytest.approx(0.7 * linear + 0.3 * divergent)


def test_hertz_law():
    """S1-13: F/L = 1.1 E R^(−1/2) Δx^(3/2): 1.1 E R = 88 mN/m at Δx = R.

    In the figure it crosses the linear law (where 1.1 E √(Δx/R) = k, at 1.27 µm), stays below
    the divergent one at strong compression and ends at 1.1 E R 2^(3/2) = 249 mN/m.
    """
    assert force(LAWS[4], R) == pytest.approx(1.1 * E * R)
    crossing = (K / (1.1 * E)) ** 2 * R
    assert crossing == pytest.approx(1.274e-6, rel=1e-3)
    assert force(LAWS[4], crossing) == pytest.approx(K * crossing)
    assert force(LAWS[4], 0.5 * crossing) < 0.5 * K * crossing
    assert force(LAWS[4], 1.9 * R) < force(LAWS[1], 1.9 * R)
    assert force(LAWS[4], D) == pytest.approx(1.1 * E * R * 2**1.5)


def test_plateau_law():
    """The law of the mapped distance: slope 1 above 0.8 D, 0.1 between, 2.5 below 0.3 D."""
    plateau, divergent = LAWS[3], LAWS[1]
    assert force(plateau, 0.1 * D) == force(divergent, 0.1 * D)
    assert force(plateau, 0.5 * D) == pytest.approx(force(divergent, (0.2 + 0.03) * D))
    mapped = 0.8 - 0.1 * 0.5
    assert force(plateau, 0.85 * D) == pytest.approx(force(divergent, D - 0.5 * mapped * D))
    assert force(PlateauLaw(kind="plateau", slope=1.0), 0.6 * D) == pytest.approx(
        force(divergent, 0.6 * D)
    )


@pytest.mark.parametrize("section", LAWS, ids=lambda s: s.kind)
def test_laws_are_repulsive_continuous_and_vanish_at_contact(section):
    forces = [force(section, x * D / 2000) for x in range(1900)]
    assert forces[0] == 0
    steps = [b - a for a, b in pairwise(forces)]
    assert min(steps) > 0
    assert max(steps) < 0.3 * K * D


def test_own_law():
    """The call-back of section 4.3.2: four arguments, negative is repulsive."""
    source = "def contact_force(d, d0, k, c):\n    return -k * (d0 - d) * (1 + c)\n"
    assert force(CustomLaw(kind="custom", source=source, repulsion=0.5), R) == 1.5 * K * R
    with pytest.raises(ValueError, match=r"must define .*contact_force"):
        CustomLaw(kind="custom", source="x = 1\n")


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (
            "import sys\nsys.exit(3)\ndef contact_force(a, b, c, d): return 0.0",
            "line 2: SystemExit",
        ),
        ("x = 1 / 0\ndef contact_force(a, b, c, d): return 0.0", "line 1: ZeroDivisionError"),
        ("def contact_force(a, b, c, d):\n    return open('x')", "cannot be compiled"),
        ("def contact_force(a, b, c, d):\n    return nowhere(a)", "cannot be compiled.*nowhere"),
        ("def contact_force(a, b, c, d):\n    return a / 0.0", "is inf at"),
        (
            "def contact_force(d, d0, k, c):\n    return k * (d0 - d)",
            r"must be negative \(repulsive\), but it is positive at every distance",
        ),
    ],
)
def test_a_law_that_does_not_work_says_so_in_a_line(source, said):
    with pytest.raises(ValueError, match=said) as caught:
        custom(source)
    assert "\n" not in str(caught.value)


def test_own_law_may_attract_somewhere():
    """Discs that stick together at first contact, and repel deeper down."""
    source = "def contact_force(d, D, k, c):\n    return k * (D - d) * (0.8 * D - d) * -5 / D\n"
    assert custom(source)(0.9, 1.0, 1.0, (1.0, 1.0, 1.0, 1.0)) == pytest.approx(0.05)


def test_own_law_may_call_its_own_functions():
    source = (
        "def g(x):\n    return 2 * x\ndef contact_force(d, D, k, c):\n    return -k * g(D - d)\n"
    )
    assert custom(source)(0.9, 1.0, 1.0, (1.0, 1.0, 1.0, 1.0)) == pytest.approx(-0.2)
