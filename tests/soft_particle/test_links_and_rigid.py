"""Cohesive links and rigid particles."""

import numpy as np
import pytest
from soft_particles import (
    angular_momentum,
    chain,
    forces,
    momentum,
    ring,
    slope,
    squared_frequencies,
    system,
)

from shear_sim.models.soft_particle.links import energy_at_criterion
from shear_sim.models.soft_particle.walls import Wall


def square(x=0.0, y=0.0, cuts=2):
    """A square of side 2 with its corners at even places, counter-clockwise."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    ahead = np.roll(corners, -1, axis=0)
    points = [c + (a - c) * k / cuts for c, a in zip(corners, ahead, strict=True)
              for k in range(cuts)]  # fmt: skip
    return np.array(points) + np.array([x, y])


def glued(gap=0.0, **law):
    """Two squares side by side, just touching, with two links."""
    one = ring(points=square(), thickness=0.1, stretch=5.0, bend=1.0)
    other = ring(points=square(2.1 + gap), thickness=0.1, stretch=5.0, bend=1.0)
    s = system(one, other, stiffness=1.0, contact_damping=0.0)
    s.glue(0.01 + gap, **({"normal": 0.1, "tangential": 0.05, "strength": (9.0, 9.0)} | law))
    s.begin()
    return s


def test_links_are_the_ends_of_the_interface_and_bear_nothing_at_the_start():
    s = glued()
    assert len(s.links.vertex) == 2
    assert list(s.links.brother) == [1, 0]
    assert s.links.length == pytest.approx([2.0, 2.0], abs=0.15)
    assert sorted(np.abs(s.motion.y[s.links.vertex])) == pytest.approx([1.0, 1.0])
    assert s.stored()[5] == 0.0
    assert np.abs(forces(s)).max() < 1e-12


def test_link_force_is_the_slope_of_its_energy():
    s = glued()
    rng = np.random.default_rng(1)
    s.motion.x[:8] -= 0.05
    s.motion.x[:] += rng.normal(0, 0.01, 16)
    s.motion.y[:] += rng.normal(0, 0.01, 16)
    assert s.stored()[5] > 1e-5
    f = forces(s)
    assert f == pytest.approx(slope(s), abs=1e-8)
    assert np.abs(f.sum(axis=0)).max() < 1e-14
    assert abs((s.motion.x * f[:, 1] - s.motion.y * f[:, 0]).sum()) < 1e-13


def test_links_pull_and_never_push():
    s = glued()
    s.motion.x[8:] -= 0.03
    assert s.stored()[5] == 0.0


def pull(s, speed):
    """Pull two held squares apart; return budgets on the way."""
    s.hold(np.arange(8), vx=-speed, vy=0.0)
    s.hold(np.arange(8, 16), vx=speed, vy=0.0)
    s.begin()
    found = []
    for _ in range(20):
        s.advance(1000)
        found.append((s.budget(), s.links.intact.sum()))
    return found


def test_energy_of_a_pulled_link_at_its_break():
    """W₀ = (f_n⁰)²/2k_n of each link; what breaks it is lost, nothing else."""
    s = glued(strength=(0.004, 9.0))
    s.rules = s.rules._replace(step=0.002 * s.stable_step)
    found = pull(s, 0.02)
    last = found[-1][0]
    assert found[0][1] == 2
    assert found[-1][1] == 0
    assert last.broken == pytest.approx(2 * 0.004**2 / (2 * 0.1), rel=1e-3)
    assert last.by_velocities == pytest.approx(last.broken, rel=1e-5)
    assert last.links == 0.0
    # What it can have gone too far by, in one step.
    assert abs(last.missing) < 1e-6 * last.broken


def test_criterion_of_forces_in_shear():
    """f_n/f_n⁰ + (f_t/f_t⁰)² = 1: with no opening at f_t = f_t⁰."""
    s = glued(strength=(0.004, 0.002))
    s.hold(np.arange(16), vx=0.0, vy=0.0)
    s.motion.y[8:] += 0.039
    s.begin()
    assert s.links.intact.sum() == 2
    assert s.stored()[5] == pytest.approx(2 * 0.5 * 0.05 * 0.039**2, rel=1e-9)
    s.motion.y[8:] += 0.002
    s._forces(s.rules)
    assert s.links.intact.sum() == 0


def test_criterion_of_energy_breaks_both_ends_of_an_interface():
    """Σ f_n²/2k_n = G_c L: one end alone opened by u breaks both when ½ k u² = G_c L."""
    s = glued(toughness=1e-4)
    s.hold(np.arange(16), vx=0.0, vy=0.0)
    length = s.links.length[0]
    opening = np.sqrt(2 * 1e-4 * length / 0.1)
    top = int(s.links.vertex[s.motion.y[s.links.vertex].argmax()])
    direction = 1.0 if top >= 8 else -1.0
    s.motion.x[top] += direction * 0.98 * opening
    s._forces(s.rules)
    assert s.links.intact.sum() == 2
    s.motion.x[top] += direction * 0.04 * opening
    s._forces(s.rules)
    assert s.links.intact.sum() == 0
    assert s.budget().broken == pytest.approx(1e-4 * length, rel=0.06)


def test_momenta_and_energy_while_links_break():
    s = glued(strength=(0.01, 0.01))
    s.rules = s.rules._replace(step=0.1 * s.stable_step)
    s.motion.vx[8:], s.motion.vy[12:] = 0.04, 0.03
    s.begin()
    work, p, spin = s.kinetic(), momentum(s), angular_momentum(s)
    s.advance(20_000)
    assert s.links.intact.sum() == 0
    assert s.budget().broken > 1e-3 * work
    assert abs(s.budget().missing) < 1e-4 * work
    assert momentum(s) == pytest.approx(p, abs=1e-12)
    assert angular_momentum(s) == pytest.approx(spin, abs=1e-12)


def test_nothing_to_glue():
    s = system(ring(), ring(x=5.0))
    with pytest.raises(ValueError, match="nothing to glue"):
        s.glue(0.1, normal=1.0, tangential=1.0)


@pytest.mark.parametrize("law", [(50.0, 1e-9), (1e-9, 50.0), (50.0, 50.0)])
def test_bound_on_the_highest_frequency_of_links(law):
    """Over that of stiff links where three squares meet, two at a vertex, and not by half."""
    places = [(0.0, 2.1), (-1.05, 0.0), (1.05, 0.0)]
    soft = {"thickness": 0.1, "stretch": 1e-3, "bend": 1e-6}
    s = system(*(ring(points=square(*at), **soft) for at in places), stiffness=1e-6, step=1e-3)
    s.glue(0.02, normal=law[0], tangential=law[1], strength=(9.0, 9.0))
    s.motion.y[:8] += 1e-3  # as links pull only
    exact = squared_frequencies(s).max()
    assert exact < (2.0 / s.stable_step) ** 2 < 1.5 * exact


def test_links_that_are_too_stiff_for_the_step():
    one, other = (ring(points=square(x), thickness=0.1) for x in (0.0, 2.1))
    s = system(one, other)
    with pytest.raises(ValueError, match=r"^step = .* s is none, or not stable with"):
        s.glue(0.01, normal=100.0, tangential=0.1)
    assert len(s.links.vertex) == 0
    s.glue(0.01, normal=5.0, tangential=0.1)


def test_links_are_not_replaced_by_others():
    s = three_squares(0.0)
    s.glue(0.01, normal=0.1, tangential=0.1, between=[(0, 1)])
    with pytest.raises(ValueError, match="there are links already: glue all at once"):
        s.glue(0.01, normal=0.1, tangential=0.1, between=[(1, 2)])
    assert set(s.chains.chain[s.links.vertex]) <= {0, 1}


def three_squares(gap):
    """The first two just touch, the third is ``gap`` away from the second."""
    places = (0.0, 2.1, 4.2 + gap)
    return system(*(ring(points=square(x), thickness=0.1) for x in places))


def test_links_between_given_particles():
    s = three_squares(0.0)
    s.glue(0.01, normal=0.1, tangential=0.1, between=[(2, 1)])
    assert len(s.links.vertex) == 2
    assert {*s.chains.chain[s.links.vertex], *s.chains.chain[s.links.segment]} == {1, 2}


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ((0, 2), "particles 0 and 2 cannot be linked: there is a gap of 2.15 m between them"),
        ((2, 1), "particles 1 and 2 cannot be linked: there is a gap of 0.05 m between them"),
        ((1, 1), "must be two of the 3"),
        ((1, 3), "must be two of the 3"),
    ],
)
def test_links_between_particles_that_are_no_neighbours(pair, message):
    s = three_squares(0.05)
    with pytest.raises(ValueError, match=message):
        s.glue(1e-6, normal=0.1, tangential=0.1, between=[(0, 1), pair])
    assert len(s.links.vertex) == 0


def test_one_link_where_one_vertex_faces_the_other():
    """The corner of a square turned by 45 degrees at the middle of a side: no brother."""
    turned = square() @ np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    one = ring(points=square(cuts=3), thickness=0.1)
    other = ring(points=turned + np.array([1.0 + np.sqrt(2) + 0.1, 0.0]), thickness=0.1)
    s = system(one, other)
    s.glue(1e-6, normal=0.1, tangential=0.1, toughness=1e-4)
    assert list(s.links.brother) == [0]
    assert s.links.length == pytest.approx([2 / 3])


def test_a_single_link_is_lost_with_the_energy_of_its_strength():
    """W₀ = (f_n⁰)²/2k_n to a millionth: pulled slowly from just under its strength."""
    s = glued(strength=(0.004, 9.0))
    opening = 0.004 / 0.1
    s.motion.x[8:] += opening * (1 - 1e-4)
    s.hold(np.arange(8), vx=0.0, vy=0.0)
    s.hold(np.arange(8, 16), vx=2e-7 * opening / s.rules.step, vy=0.0)
    s.begin()
    s.advance(1000)
    assert list(s.links.intact) == [0, 0]
    assert s.links.lost == pytest.approx(2 * [0.004**2 / (2 * 0.1)], rel=1e-6)
    assert energy_at_criterion(s.links) == pytest.approx(2 * [0.004**2 / (2 * 0.1)], rel=1e-9)


def test_energy_where_a_link_meets_its_criterion():
    """a λ + b² λ² = 1 for α = 2, in closed form; the share of G_c L of each of two brothers."""
    links = glued().links._replace(intact=np.zeros(2, np.int32))
    links.law[2:5] = 0.4, 0.3, 2.0
    links.pull[:], links.shear[:] = [0.2, 0.0], [0.15, -0.2]
    a, b = links.pull / 0.4, links.shear / 0.3
    scale = (np.sqrt(a**2 + 4 * b**2) - a) / (2 * b**2)
    stored = 0.5 * (links.pull**2 / 0.1 + links.shear**2 / 0.05)
    assert energy_at_criterion(links) == pytest.approx(scale**2 * stored, rel=1e-12)
    links.law[5] = 1e-3
    expected = stored / stored.sum() * 1e-3 * links.length
    assert energy_at_criterion(links) == pytest.approx(expected, rel=1e-12)
    whole = links._replace(intact=np.ones(2, np.int32))
    assert list(energy_at_criterion(whole)) == [0.0, 0.0]


def rigid_pair(friction):
    """A rigid and a soft ring that collide off centre."""
    one = ring(16, thickness=0.2)
    other = ring(16, x=2.4, y=0.5, thickness=0.2, stretch=1.0, bend=0.01)
    s = system(one, other, friction=friction)
    s.motion.vx[:16] = 0.04 - 0.01 * s.motion.y[:16]
    s.motion.vy[:16] = 0.01 * s.motion.x[:16]
    s.make_rigid(np.array([0]))
    s.begin()
    return s


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_a_rigid_particle_keeps_its_shape_and_all_momenta(friction):
    s = rigid_pair(friction)
    x, y = s.motion.x[:16].copy(), s.motion.y[:16].copy()
    sides = np.hypot(x[:, None] - x, y[:, None] - y)
    p, spin, work = momentum(s), angular_momentum(s), s.kinetic()
    s.advance(6000)
    x, y = s.motion.x[:16], s.motion.y[:16]
    assert s.work.closest[0] < 0.95
    assert np.hypot(x[:, None] - x, y[:, None] - y) == pytest.approx(sides, abs=1e-12)
    assert momentum(s) == pytest.approx(p, abs=1e-12)
    assert angular_momentum(s) == pytest.approx(spin, abs=1e-5 * abs(spin))
    assert abs(s.budget().missing) < 1e-3 * work


def test_a_rigid_bar_falls_and_turns_as_a_body():
    """A bar of three masses with one load at its end: a = F/M, α = F L/I."""
    s = system(chain([(0, 0), (1, 0), (2, 0)], mass=2.0), walls=[Wall(0, 1, -100.0)])
    s.make_rigid(np.array([0]))
    s.load(np.array([2]), fy=1e-3)
    s.begin()
    s.advance(50)
    t = s.time
    assert s.rigid.vy[0] == pytest.approx(1e-3 / 6.0 * t, rel=1e-3)
    assert s.rigid.spin[0] == pytest.approx(1e-3 / 4.0 * t, rel=1e-3)
    b = s.budget()
    assert b.kinetic == pytest.approx(b.by_forces, rel=1e-3)


def test_more_rigid_particles_later():
    """The first ones stay so, and all keep their momenta."""
    s = system(*(ring(8, x=3.0 * k) for k in range(3)))
    s.motion.vx[:] = 0.01
    s.make_rigid(np.array([2]))
    s.make_rigid(np.array([0, 2]))
    s.begin()
    assert list(s.rigid.chain) == [2, 0]
    x, p = s.motion.x.copy(), momentum(s)
    s.advance(20)
    assert s.motion.x - x == pytest.approx(0.01 * s.time)
    assert momentum(s) == pytest.approx(p, abs=1e-14)


def test_rigid_particles_named_twice():
    s = system(ring(8))
    with pytest.raises(ValueError, match="particles names 0 more than once"):
        s.make_rigid(np.array([0, 0]))
    assert len(s.rigid.chain) == 0


def test_no_vertex_is_held_and_of_a_rigid_particle():
    s = system(ring(8), ring(8, x=3.0))
    s.make_rigid(np.array([1]))
    with pytest.raises(ValueError, match="vertex 9 of particle 1 cannot be held where the parti"):
        s.hold(np.array([2, 9]))
    assert s.motion.free_x[:8].all()
    s.hold(np.array([2]), vx=None)
    with pytest.raises(ValueError, match="vertex 2 of particle 0 cannot be held where the parti"):
        s.make_rigid(np.array([0]))
    assert list(s.rigid.chain) == [1]
    s.hold(np.array([2]), vx=None, vy=None)
    s.make_rigid(np.array([0]))
