"""Contacts: one smooth potential that counts once, seen from outside, with exact friction."""

import numpy as np
import pytest
from soft_particles import (
    HOUSE,
    angular_momentum,
    forces,
    momentum,
    polygon,
    probe,
    ring,
    slope,
    system,
)

from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle import contacts
from shear_sim.models.soft_particle.state import SEPARATION, SLIDING, TWO_SIDED
from shear_sim.models.soft_particle.walls import Wall


def energy_at(s, v, x, y):
    s.motion.x[v], s.motion.y[v] = x, y
    s._list()
    return s.stored()[3]


@pytest.mark.parametrize(
    ("x", "y", "overlap"),
    [
        (1.0, -0.15, 0.05),  # a flat side
        (2.0, -0.15, 0.05),  # a vertex in a flat side: once
        (2.001, -0.15, 0.05),
        (4.1, -0.1, 0.2 - 0.1 * np.sqrt(2)),  # a convex corner
        (2.0, 1.0, None),  # the concave corner: of both sides, less the vertex
    ],
)
def test_whatever_a_vertex_faces_counts_once(x, y, overlap):
    s, v = probe(HOUSE, (9, 9))
    if overlap is None:
        side = 0.2 * np.cos(np.arctan2(1.2, 2.0))  # distance from either side
        expected = 2 * 0.5 * (0.2 - side) ** 2 - 0.5 * (0.2 - 0.2) ** 2
    else:
        expected = 0.5 * overlap**2
    assert energy_at(s, v, x, y) == pytest.approx(expected, rel=1e-12)


def test_rounding_counts_no_vertex_twice_or_never():
    """Straight over a vertex of a straight chain, but for the last digit, in any direction."""
    rng = np.random.default_rng(5)
    count = []
    for _ in range(2000):
        turn, lengths = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.0, 2)
        along = np.array([np.cos(turn), np.sin(turn)])
        middle = rng.uniform(-9, 9, 2)
        over = middle + 0.1 * np.array([along[1], -along[0]]) + rng.integers(-1, 2) * 1e-16 * along
        x, y = np.array([middle - lengths[0] * along, middle, middle + lengths[1] * along, over]).T
        coefficient, *_ = contacts.corner(x, y, x[3], y[3], 0, 1, 2, 0.2, TWO_SIDED)
        overlaps = [contacts.side(x, y, x[3], y[3], s, s + 1, 0.2, TWO_SIDED)[0] for s in (0, 1)]
        count.append(coefficient + np.count_nonzero(overlaps))
    assert set(count) == {1.0}


@pytest.mark.parametrize("closed", [True, False])
def test_force_is_the_slope_of_the_potential_everywhere(closed):
    """All around a chain with convex and concave corners, on both sides of every boundary."""
    rng = np.random.default_rng(3)
    s, v = probe(HOUSE, (9, 9), closed)
    tried = 0
    while tried < 60:
        x, y = rng.uniform(-0.2, 4.2), rng.uniform(-0.2, 2.2)
        if energy_at(s, v, x, y) == 0.0 or s.stored()[3] > 0.5 * 0.15**2:
            continue
        tried += 1
        assert forces(s)[v] == pytest.approx(slope(s, [v])[v], abs=1e-7)


def test_forces_between_two_rings_are_the_slope_of_their_energy():
    rng = np.random.default_rng(4)
    one, other = polygon(rng, 12), polygon(rng, 12, x=2.75)
    s = system(ring(points=one, thickness=0.3), ring(points=other, thickness=0.3), stiffness=0.5)
    s.motion.x[12:] -= 1.0  # beyond the mid-line, where no ring may start
    s._list()
    assert s.stored()[3] > 1e-4
    assert forces(s) == pytest.approx(slope(s), abs=1e-8)
    f = forces(s)
    assert np.abs(f.sum(axis=0)).max() < 1e-14
    assert abs((s.motion.x * f[:, 1] - s.motion.y * f[:, 0]).sum()) < 1e-14


def test_the_force_has_no_jumps():
    """Along a path through a concave corner and over a convex one, steps of 1e-5."""
    s, v = probe(HOUSE, (9, 9))
    for path in (
        [(x, 0.8 + 0.19 - 0.3 * abs(x - 2.0)) for x in np.arange(1.9, 2.1, 1e-3)],
        [(4 + 0.15 * np.cos(a), 0.15 * np.sin(a)) for a in np.arange(-2.0, 0.5, 1e-3)],
    ):
        found = []
        for x, y in path:
            s.motion.x[v], s.motion.y[v] = x, y
            found.append(forces(s)[v].copy())
        step = np.hypot(*np.diff(path, axis=0).T).max()
        # Stiffness is k_n for each of two segments and a vertex at most.
        assert np.hypot(*np.diff(found, axis=0).T).max() <= 3.0 * step
        assert np.hypot(*np.array(found).T).max() > 0.01


def test_a_vertex_in_a_notch_keeps_its_energy():
    """A frictionless oscillation in a notch of 127 degrees: error of order δt² only.

    The rule of the nearest segment has jumps of force here and errors of 10 to 100 %.
    """
    half = np.radians(127.0 / 2)
    arm = 2.0 * np.array([np.sin(half), np.cos(half)])
    notch = [(-arm[0], arm[1]), (0, 0), (arm[0], arm[1])]
    worst = []
    for fraction in (0.1, 0.025):
        s, v = probe(notch, (0.05, 0.25), closed=False, tail=(0.0, 50.0))
        s.rules = s.rules._replace(step=fraction * s.stable_step)
        s.load(np.array([v]), fy=-0.05)
        s.motion.vx[v] = 0.03
        s.begin()
        scale = s.budget().normal + 0.05 * 0.05
        missing, crossed = [], 0
        for _ in range(round(300 / fraction)):
            before = np.sign(s.motion.x[v])
            s.advance(10)
            crossed += before != np.sign(s.motion.x[v])
            missing.append(s.budget().missing)
        assert crossed > 10
        worst.append(np.abs(missing).max() / scale)
    assert worst[1] < 1e-3
    assert worst[1] < worst[0] / 10


def test_a_ring_is_touched_from_outside_only():
    """Behind the mid-line of a ring the force still grows and points out."""
    s, v = probe(HOUSE, (9, 9))
    found = []
    for y in (-0.19, -0.1, -0.01, 0.02, 0.08):
        s.motion.x[v], s.motion.y[v] = 1.0, y
        s.work.closest[0] = 1.0
        s._list()
        found.append(s.stored()[3])
        assert found[-1] == pytest.approx(0.5 * (0.2 + y) ** 2)
    assert np.all(np.diff(found) > 0)


def test_a_vertex_that_went_through_stops_the_run():
    s, v = probe(HOUSE, (1.0, -0.3), tail=(0, -50.0), stiffness=1e-3)
    s.motion.vy[v] = 1.0
    s.begin()
    with pytest.raises(SimulationError, match="a vertex of particle 1 moves by more than half its"):
        s.advance(1000)
    s.rules = s.rules._replace(step=0.01)
    with pytest.raises(SimulationError, match="a vertex of particle 1 went through a seg"):
        s.advance(1000)


def test_a_vertex_that_went_through_an_open_chain_stops_the_run():
    """Open chains push to either side, so the guard has to see it before the mid-line."""
    s, v = probe([(-1.0, 0.0), (1.0, 0.0)], (0.1, 0.3), closed=False, stiffness=1e-3, step=0.02)
    s.motion.vy[v] = -1.0
    s.begin()
    with pytest.raises(SimulationError, match="a vertex of particle 1 went through a seg"):
        s.advance(1000)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x, y: (x, -y), "has -1 of its area"),  # turned inside out
        (lambda x, y: (0.1 * x, y), "a segment has 0.1"),
        (lambda x, y: (x[[0, 7, 2, 3, 4, 5, 6, 7]], y[[0, 7, 2, 3, 4, 5, 6, 7]]), "is folded by"),
    ],
)
def test_a_particle_that_is_none_stops_the_run(change, message):
    s = system(ring(8), ring(8, x=5.0))
    part = slice(8, 16)
    x, y = change(s.motion.x[part] - 5.0, s.motion.y[part].copy())
    s.motion.x[part], s.motion.y[part] = x + 5.0, y
    s._list()
    with pytest.raises(SimulationError, match=rf"stopped at t = .* s .*: particle 1.* {message}"):
        s._guard(0)


def test_a_ring_touches_itself():
    """Two walls of a flat ring repel each other; neighbours along the chain do not."""
    n = 40
    phi = 2 * np.pi * (np.arange(n) + 0.5) / n
    flat = np.column_stack([3 * np.cos(phi), 0.09 * np.sin(phi)])
    s = system(ring(points=flat, thickness=0.1, stretch=1e-9, bend=0.0))
    f = forces(s)
    upper = (s.motion.y > 0.02) & (np.abs(s.motion.x) > 0.5)
    assert np.all(f[upper, 1] > -1e-12)
    assert s.stored()[3] > 0.0
    assert f == pytest.approx(slope(s), abs=1e-7)
    round_one = system(ring(40))
    assert round_one.stored()[3] == 0.0


def sliding(friction, speed=0.02, load=-0.05, **given):
    """A vertex pressed onto a long flat bar and pushed along it."""
    s, v = probe([(0, 0), (1, 0), (2, 0), (3, 0)], (0.4, 0.15), closed=False, friction=friction,
                 tail=(0.0, 500.0), **given)  # fmt: skip
    s.load(np.array([v]), fy=load)
    s.motion.y[v] = 0.2 + load / s.rules.stiffness
    s.motion.vx[v] = speed
    s.begin()
    return s, v


def test_coulomb_friction_along_a_chain():
    """Sliding over two joints of the bar: μ f_n all the way, no loss of history at a joint."""
    s, v = sliding(0.3, speed=0.5, tangential=2.0)
    s.rules = s.rules._replace(step=0.02 * s.stable_step)
    friction = 0.3 * 0.05
    while s.motion.x[v] < 2.6 and s.steps < 100_000:
        s.advance(1)
        if s.motion.x[v] > 0.5:
            assert s.springs.force[v, 0] == pytest.approx(friction, rel=1e-3)
    way = s.motion.x[v] - 0.4
    b = s.budget()
    # The spring takes its part of the way before it slides.
    assert b.sliding == pytest.approx(friction * (way - friction / 2.0), rel=1e-3)
    assert 0.5 * (0.5**2 - s.motion.vx[v] ** 2) == pytest.approx(friction * way, rel=2e-3)
    assert abs(b.missing) < 1e-5 * b.sliding


def test_a_contact_sticks():
    """Below the limit the vertex swings on its tangential spring: ω² = k_t/m."""
    s, v = sliding(0.9, speed=1e-3, tangential=0.5)
    period = 2 * np.pi / np.sqrt(0.5)
    steps = round(period / 4 / s.rules.step)
    s.advance(steps)
    assert s.motion.x[v] - 0.4 == pytest.approx(1e-3 / np.sqrt(0.5), rel=1e-2)
    s.advance(steps)
    assert s.motion.x[v] - 0.4 == pytest.approx(0.0, abs=1e-4)
    assert s.work.energy[SLIDING] == 0.0


def test_a_spring_lost_at_separation_is_counted():
    s, v = sliding(0.5, speed=0.0, tangential=1.0)
    s.load(np.array([v]), fx=0.01)
    s.begin()
    s.advance(200)
    s.load(np.array([v]), fy=0.06)  # lifts it off
    start = s.budget()
    s.advance(60)
    b = s.budget()
    assert s.springs.segment[v].max() == -1
    lost = b.separation + b.sliding - start.separation - start.sliding
    assert lost > 0
    assert abs(b.tangential) == 0.0
    assert s.work.energy[SEPARATION] >= 0


def colliding(friction, strict=True, **given):
    """Two wobbly rings that meet off centre, spinning."""
    rng = np.random.default_rng(8)
    one = ring(points=polygon(rng, 14), thickness=0.2, stretch=1.0, bend=0.01)
    other = ring(points=polygon(rng, 14, x=2.6, y=0.4), thickness=0.2, stretch=1.0, bend=0.01)
    s = system(one, other, stiffness=1.0, friction=friction, **given)
    s.motion.vx[:14], s.motion.vx[14:] = 0.05, -0.05
    s.motion.vy[:14] = 0.03 * s.motion.x[:14]
    s.motion.vx[:14] -= 0.03 * s.motion.y[:14]
    s.begin()
    return s


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_momenta_in_a_collision(friction):
    """Momentum and angular momentum to round-off, friction and dashpots included."""
    s = colliding(friction, contact_damping=0.3)
    p, spin = momentum(s), angular_momentum(s)
    s.advance(8000)
    assert s.work.closest[0] < 0.9  # they met
    assert (s.work.energy[SLIDING] > 1e-6) == (friction > 0)
    assert momentum(s) == pytest.approx(p, abs=1e-13)
    assert angular_momentum(s) == pytest.approx(spin, abs=1e-13)


def test_energy_balance_of_a_frictional_collision_improves_with_the_step():
    missing = []
    for fraction in (0.2, 0.1, 0.05):
        s = colliding(0.8, contact_damping=0.3)
        s.rules = s.rules._replace(step=fraction * s.stable_step)
        s.begin()
        work = s.kinetic()
        s.advance(round(1600 / fraction))
        assert s.budget().sliding > 1e-3 * work
        missing.append(abs(s.budget().missing) / work)
    assert missing[0] < 1e-3
    assert missing[2] < missing[0] / 3


def test_friction_is_objective():
    """Two stuck rings that turn together: the spring does not notice."""
    one = ring(12, thickness=0.2, stretch=1.0, bend=0.01)
    other = ring(12, x=2.1, thickness=0.2, stretch=1.0, bend=0.01)
    s = system(one, other, friction=0.8)
    s.advance(1)
    s.springs.force[s.springs.segment >= 0] = 0.0
    x, y = s.motion.x.copy(), s.motion.y.copy()
    turn = 1e-3 / s.rules.step
    s.motion.vx[:], s.motion.vy[:] = -turn * y, turn * x
    s._forces(s.rules)
    assert (s.springs.segment >= 0).sum() >= 2
    assert np.abs(s.springs.force).max() < 1e-13


def test_a_wall_is_a_spring_of_twice_the_stiffness():
    s = system(ring(8, thickness=0.2), walls=[Wall(0.0, 1.0, -0.95)], stiffness=0.5)
    low = np.flatnonzero(s.motion.y < -0.85)
    overlap = 0.1 - (s.motion.y[low] + 0.95)
    assert len(low) == 2
    assert s.walls.push[0] == pytest.approx((2 * 0.5 * overlap).sum())
    assert forces(s)[low] == pytest.approx(slope(s)[low], abs=1e-9)


def test_springs_of_a_wall_that_goes_are_counted():
    """½ f²/k_t of each vertex that stuck to it: no spring slid, and nothing else was lost."""
    wall = Wall(0.0, 1.0, -0.95, slide=-0.01)
    s = system(ring(8, thickness=0.2), walls=[wall], stiffness=0.5, tangential=0.7, friction=5.0)
    s.hold(np.arange(8))
    s.begin()
    s.advance(20)
    force = s.springs.wall[0].copy()
    stored = s.budget().tangential
    assert (force != 0.0).sum() == 2
    s.walls.slide[0], s.walls.velocity[0] = 0.0, -1.0
    s.advance(20)
    b = s.budget()
    assert not s.springs.wall.any()
    assert b.tangential == b.sliding == 0.0
    assert b.separation == pytest.approx((force**2).sum() / (2 * 0.7), rel=1e-12)
    assert b.separation == pytest.approx(stored, rel=1e-12)


def test_a_moving_wall_does_the_work_it_says():
    """A ring squeezed between a fixed and a moving wall with friction that slides along."""
    walls = [Wall(0, 1, -1.06), Wall(0, -1, -1.06, velocity=0.002, slide=0.003)]
    body = ring(16, thickness=0.1, bend_damping=0.2, stretch_damping=0.2)
    missing = []
    for fraction in (0.2, 0.05):
        s = system(body, walls=walls, friction=0.4, stiffness=0.2, contact_damping=0.2)
        s.rules = s.rules._replace(step=fraction * s.stable_step)
        s.advance(round(150 / s.rules.step))
        b = s.budget()
        assert s.walls.position[1] == pytest.approx(-1.06 + 0.002 * s.time)
        assert b.by_walls > 1e-5
        assert b.sliding > 0
        missing.append(abs(b.missing) / b.by_walls)
    assert missing[0] < 1e-3
    assert missing[1] < missing[0] / 3


def test_a_wall_under_a_load_comes_to_rest_where_the_ring_bears_it():
    load = 2e-5
    walls = [Wall(0, 1, -1.06), Wall(0, -1, -1.06, mass=16.0, load=load, damping=0.3)]
    body = ring(16, thickness=0.2, bend_damping=0.5, stretch_damping=0.2)
    s = system(body, walls=walls, stiffness=0.2, drag=0.02)
    s.advance(round(6000 / s.rules.step))
    assert s.walls.push[1] == pytest.approx(load, rel=1e-3)
    assert s.walls.push[0] == pytest.approx(load, rel=1e-3)
    assert abs(s.walls.velocity[1]) < 1e-6


@pytest.mark.parametrize("speed", [0.004, 0.02])
def test_no_contact_is_missed_between_two_lists(speed):
    """The same bits as with new lists at every step; they last for hundreds in the slow pack.

    In the fast one they have more and more room, so that they last longer.
    """

    def shaken(every):
        rings = [ring(16, x=1.03 * x, y=1.03 * y) for x in (-1, 1) for y in (-1, 1)]
        walls = [Wall(*n, -2.06) for n in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        s = system(*rings, walls=walls, stiffness=2.0, friction=0.3)
        rng = np.random.default_rng(5)
        s.motion.vx[:], s.motion.vy[:] = rng.normal(0.0, speed, (2, len(s.motion.x)))
        made = 0
        make = s._list

        def counted():
            nonlocal made
            made += 1
            make()

        s._list = counted
        for _ in range(600 // every):
            if every == 1:
                s._list()
            s.advance(every)
        return np.concatenate([s.motion.x, s.motion.y]), made, s.skin

    always, _, least = shaken(1)
    seldom, made, skin = shaken(600)
    assert np.array_equal(always, seldom)
    assert 1 <= made < 30
    assert (skin > least) == (speed > 0.01)
