"""Every parameter of a study reaches the constant that it names, and no other.

Unequal numbers everywhere: factors that are swapped, forgotten or inverted show.
"""

import math

import numpy as np
import pytest

from shear_sim.models.microgel.parameters import Contacts, Damping, Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.simulation import make_constants, make_discs, time_scale
from shear_sim.packing import Cell

DISCS = make_discs(
    np.array([[0.0, 0.0], [1e-4, 0.0], [2e-4, 0.0]]),
    np.array([1e-5, 2e-5, 2e-5]),
    mass=np.array([1.0, 4.0, 7.0]) * 1e-6,
)
K = math.pi * 1000 / 8  # S1-8
ETA = 0.3 * math.sqrt(4e-6 * K)  # S1-9, with the mean mass
BASE = {
    "young_modulus": 1000.0,
    "relative_viscosity": 0.3,
    "tangential_ratio": 0.5,
    "friction": 0.2,
    "contacts": Contacts(normal_factor=2.0, tangential_factor=3.0),
    "links": Links(normal_factor=5.0, tangential_factor=7.0),
}


def constants(**model):
    point = MicrogelPoint(model=Microgel(**(BASE | model)))
    return make_constants(point, DISCS, 5e-4, 4e-4, 0.01)


def test_time_scale():
    """τ = √(⟨m⟩/k), with the mean (not the median, not the smallest) mass."""
    k, tau = time_scale(Microgel(young_modulus=1000.0), DISCS.mass)
    assert k == pytest.approx(K, rel=1e-15)
    assert tau == pytest.approx(math.sqrt(4e-6 / K), rel=1e-15)


@pytest.mark.parametrize("scaled", [True, False])
def test_springs_and_dashpots(scaled):
    """k_T = ratio k and η_T = ratio η, each times its factor; dashpots only if they scale."""
    c = constants(scale_viscosity=scaled)
    one = (lambda factor: factor) if scaled else (lambda _: 1)
    assert c.k == pytest.approx(2 * K)
    assert c.kt == pytest.approx(3 * 0.5 * K)
    assert c.eta == pytest.approx(one(2) * ETA)
    assert c.etat == pytest.approx(one(3) * 0.5 * ETA)
    assert c.link_k == pytest.approx(5 * K)
    assert c.link_kt == pytest.approx(7 * 0.5 * K)
    assert c.link_eta == pytest.approx(one(5) * ETA)
    assert c.link_etat == pytest.approx(one(7) * 0.5 * ETA)
    assert (c.width, c.height, c.friction) == (5e-4, 4e-4, 0.2)


@pytest.mark.parametrize(
    ("spin", "rate", "target"), [("flow", 1, 0.0), ("zero", 1, 0.5), ("none", 0, 0.0)]
)
def test_damping(spin, rate, target):
    """Decay by C per period is λ = −ln C/T; a peculiar spin of γ̇/2 is no rotation (ω = 0)."""
    c = constants(damping=Damping(decay=0.25, spin=spin))
    assert c.damping == pytest.approx(math.log(4) / 0.01)
    assert c.spin_damping == pytest.approx(rate * math.log(4) / 0.01)
    assert c.spin_target == target or spin == "none"


def test_choices_by_name():
    assert constants().may_pull
    assert not constants(dashpot="no_attraction").may_pull
    assert constants().affine
    assert not constants(drive="boundary").affine
    assert constants().stretched_dashpot
    assert not constants(links=Links(stretched_tangential_dashpot=False)).stretched_dashpot
    arms = {
        name: (c.contact_arms_in_velocity, c.contact_arms_in_torque)
        for name in ("conjugate", "particleshear", "otsuki2017")
        for c in [constants(lever_arms=name)]
    }
    expected = {"conjugate": (True, True), "particleshear": (False, True)}
    assert arms == expected | {"otsuki2017": (False, False)}


def test_an_open_boundary_has_no_images():
    point = MicrogelPoint(cell=Cell(boundary="open"))
    assert not make_constants(point, DISCS, 5e-4, 5e-4, 0.01).periodic
    for boundary in ("lees_edwards", "plates"):
        point = MicrogelPoint(cell=Cell(boundary=boundary))
        assert make_constants(point, DISCS, 5e-4, 5e-4, 0.01).periodic
