"""What the equations conserve, and the tensor identities, over long runs."""

import numpy as np
import pytest
from scenes import (
    UNDAMPED,
    angular_momentum,
    evaluate,
    finish,
    linear_momentum,
    packing_point,
    prepared,
    scene,
    steady,
)

from shear_sim.models.microgel.parameters import Links
from shear_sim.protocol import OscillatoryShear

STRONG_SHEAR = OscillatoryShear(
    strain_amplitude=0.5, relative_frequency=0.025, pre_periods=0, periods=6, post_periods=0
)


def frictional(links, **more):
    """40 discs, μ = 0.5, 600 steps of shear with A = 0.5, damping as by default."""
    return packing_point(
        links=Links(cut=links), friction=0.5, shear=more.pop("shear", STRONG_SHEAR), **more
    )


@pytest.fixture(scope="module", params=["none", "cells"])
def long_run(request):
    simulation = prepared(frictional(request.param))
    return simulation, finish(simulation)


def test_the_long_run_is_long_and_slides(long_run):
    simulation, columns = long_run
    assert simulation.steps >= 600
    assert columns["sliding_fraction"].max() > 0.05


@pytest.mark.parametrize("prefix", ["", "periodic_"])
def test_overall_stress_stays_symmetric(long_run, prefix):
    """−T/2 with the arms r d/(r_i + r_j) cancels the asymmetry of Love–Weber contact by contact.

    Nominal arms miss it by the overlap, of the order of 1e-1, and a torque tensor of net instead
    of internal torques by edge contacts.
    """
    _, c = long_run
    love_weber = np.abs(c[f"{prefix}love_weber_xy"] - c[f"{prefix}love_weber_yx"])
    scale = np.abs(c[f"{prefix}overall_xx"]) + np.abs(c[f"{prefix}overall_yy"])
    assert (love_weber / scale).max() > 1e-5  # there is something to mend
    error = np.abs(c[f"{prefix}overall_xy"] - c[f"{prefix}overall_yx"]) / scale
    assert error.max() < 1e-15


def test_self_check_of_the_summary_sees_the_same(long_run):
    simulation, _ = long_run
    checks = simulation.summary()["checks"]
    assert checks["asymmetry_periodic"] < 1e-15
    assert checks["asymmetry_internal"] < 1e-15
    assert checks["momentum"] < 1e-12


def test_love_weber_is_external_plus_unbalanced(long_run):
    """S1-19 in all four entries, the unbalanced part from net forces and positions themselves.

    A branch of the wrong image, or an edge contact counted as internal, breaks it at once.
    """
    simulation, _ = long_run
    assert 0 < simulation.summary()["checks"]["love_weber_identity"] < 1e-13


def test_identity_s1_19_independently(long_run):
    """The same from the outside: forces on discs times their place in the cell."""
    simulation, columns = long_run
    d, w, c = simulation.discs, simulation.work, simulation.constants
    offset = columns["strain"][-1] * c.height - w.turns[0] * c.width
    y = d.y % c.height
    x = (d.x - np.floor(d.y / c.height) * offset) % c.width
    place = np.column_stack([x - c.width / 2, y - c.height / 2])
    force = np.column_stack([w.fx, w.fy])
    unbalanced = (force[:, :, None] * place[:, None, :]).sum(0) / (c.width * c.height)
    ours = np.array([[columns[f"unbalanced_force_{a}{b}"][-1] for b in "xy"] for a in "xy"])
    scale = abs(columns["love_weber_xx"][-1]) + abs(columns["external_xx"][-1])
    assert np.abs(ours - unbalanced).max() < 1e-12 * scale


def test_identity_s1_24(long_run):
    """overall = Love–Weber + internal torque + spin, in every entry, as the columns say."""
    _, c = long_run
    for ab in ("xx", "xy", "yx", "yy"):
        total = c[f"love_weber_{ab}"] + c[f"internal_torque_{ab}"] + c[f"centrifugal_{ab}"]
        assert np.array_equal(c[f"overall_{ab}"], total)
    assert np.array_equal(c["internal_torque_xy"], -c["internal_torque_yx"])
    assert (c["centrifugal_xx"] <= 0).all()
    assert (c["centrifugal_xx"] < 0).any()


@pytest.mark.parametrize("links", ["none", "cells"])
@pytest.mark.parametrize("shear", [STRONG_SHEAR, steady(2.0)], ids=["oscillatory", "steady"])
def test_momentum_in_the_sheared_cell(links, shear):
    """Σ m c = 0 stays 0: pair forces cancel and −γ̇ c_y sums to 0 with Σ m c_y.

    Lab velocities that jump at the edges, or a kick of the rate that is not affine, would drift.
    """
    simulation = prepared(frictional(links, shear=shear, damping=UNDAMPED))
    finish(simulation)
    d = simulation.discs
    scale = (d.mass * np.hypot(d.cx, d.cy)).sum()
    assert scale > 0
    assert np.abs(linear_momentum(simulation)).max() < 1e-12 * scale


@pytest.mark.parametrize("arms", ["conjugate", "particleshear", "otsuki2017"])
def test_angular_momentum_of_every_contact(arms):
    """T_i + T_j = d F_T for contact arms (S1-3); nominal arms leave (D − d) F_T, and it shows.

    Summed over all contacts: Σ T_i + Σ (F_x Δy − F_y Δx) = 0, from the torques on discs and the
    antisymmetric part of the full periodic Love–Weber sum.
    """
    simulation = prepared(frictional("cells", lever_arms=arms))
    c = finish(simulation)
    area = simulation.constants.width * simulation.constants.height
    torques = simulation.work.torque.sum()
    # −Σ F_a Δ_b: its antisymmetric part is the moment of the force pairs, −Σ d F_T.
    moment = (c["periodic_love_weber_xy"][-1] - c["periodic_love_weber_yx"][-1]) * area
    residue = abs(torques - moment)
    scale = np.abs(simulation.work.torque).sum()
    assert abs(moment) > 1e-4 * scale
    if arms == "otsuki2017":
        assert residue > 1e-2 * abs(moment)
    else:
        assert residue < 1e-12 * scale


@pytest.mark.parametrize("arms", ["conjugate", "particleshear", "otsuki2017"])
def test_angular_momentum_of_an_isolated_cluster(arms):
    """A linked, frictional cluster that tumbles and rings keeps L over 5,000 steps.

    With nominal radii in the torque (`otsuki2017`) it does not: the overlap times the tangential
    force is lost at every contact.
    """
    rng = np.random.default_rng(3)
    position = np.array([(0, 0), (1.7, 0.1), (0.9, 1.5), (2.5, 1.6), (1.8, 3.1), (5.0, 1.6)])
    n = len(position)
    simulation = scene(
        position, 1.0, velocity=rng.normal(size=(n, 2)), spin=rng.normal(size=n),
        mass=rng.uniform(0.5, 2, n), links=[(0, 1), (0, 2), (1, 2), (1, 3), (2, 4), (3, 4)],
        k=20.0, kt=8.0, eta=0.2, etat=0.1, friction=0.5, step=0.02, steps=5000, skin=0.4,
        contact_arms_in_velocity=arms == "conjugate", contact_arms_in_torque=arms != "otsuki2017",
    )  # fmt: skip
    before, momentum = angular_momentum(simulation), linear_momentum(simulation)
    c = finish(simulation)
    assert np.abs(linear_momentum(simulation) / momentum - 1).max() < 1e-12
    change = abs(angular_momentum(simulation) / before - 1)
    if arms == "otsuki2017":
        assert change > 1e-3
    else:
        assert change < 1e-12
    # An isolated cluster has no outside.
    assert (c["external_xx"] == 0).all()
    assert np.array_equal(c["love_weber_xy"], c["periodic_love_weber_xy"])


def test_a_pair_that_turns_as_one_feels_no_friction():
    """Rigid rotation of a stretched pair is no motion in the pair: `conjugate` arms see none.

    With nominal radii in the velocity (`particleshear`) it rolls at (d − D) Ω, a spurious twist.
    """
    turning = 0.3
    position = np.array([(0.0, 0.0), (2.4, 0.0)])
    velocity = turning * np.column_stack([-position[:, 1], position[:, 0]])
    for conjugate in (True, False):
        simulation = scene(
            position, 1.0, velocity=velocity, spin=np.full(2, turning), links=[(0, 1)],
            kt=1.0, etat=1.0, step=1e-3, steps=1, contact_arms_in_velocity=conjugate,
        )  # fmt: skip
        simulation.advance(1)
        forces = evaluate(simulation)
        along = forces.force[0, 1]
        expected = 0.0 if conjugate else (2.4 - 2.0) * turning
        assert along == pytest.approx(expected, abs=1e-15)
