"""Bodies, walls and numbers that mean nothing are refused, by the name of what is wrong."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from soft_particles import chain, polygon, ring, system

from shear_sim.models.soft_particle.bodies import Body, BodyError, Core, Shell, ring_points
from shear_sim.models.soft_particle.checks import crosses_itself, tangled
from shear_sim.models.soft_particle.walls import Wall

NAN, INF = math.nan, math.inf
EIGHT = ring_points(8, 1.0)


def shell(**law):
    return replace(ring(8), shell=replace(ring(8).shell, **law))


def given(**what):
    return replace(ring(8), **what)


def with_one(value, shape, at):
    array = np.ones(shape)
    array[at] = value
    return array


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (ring(5), "a ring of 5 vertices: at least 6"),
        (chain([(0, 0)]), "a chain of 1 vertices: at least 2"),
        (ring(points=np.ones((8, 3))), "points has the shape (8, 3): (8, 2) is needed"),
        (ring(points=EIGHT[::-1]), "must be counter-clockwise"),
        (ring(points=EIGHT[[0, 1, 4, 3, 2, 5, 6, 7]]), "crosses itself"),
        (chain([(0, 0), (2, 0), (2, 1), (1, -1)]), "crosses itself"),
        (ring(points=EIGHT[[0, 1, 1, 3, 4, 5, 6, 7]]), "points 1 and 2 are at the same place"),
        (ring(points=EIGHT[[0, 1, 2, 3, 4, 5, 6, 7, 0]]), "leave the last one out"),
        (ring(points=EIGHT * with_one(NAN, (8, 1), 3)), "points[3, 0] = nan must be finite"),
        (chain([(0, 0), (1, 0)], core=Core("gas", 0, 1.0)), "it is open and has a core"),
        (given(radius=0.0), "radius = 0 must be finite and over 0"),
        (given(radius=-0.1), "radius = -0.1 must be finite and over 0"),
        (given(mass=0.0), "mass = 0 must be finite and over 0"),
        (given(mass=INF), "mass = inf must be finite and over 0"),
        (given(rest_length=np.ones(7)), "rest_length has the shape (7,): (8,) is needed"),
        (given(rest_length=with_one(-1.0, 8, 2)), "rest_length[2] = -1 must be finite and over 0"),
        (given(rest_length=with_one(0.0, 8, 2)), "rest_length[2] = 0 must be finite and over 0"),
        (given(rest_angle=np.ones((8, 1))), "rest_angle has the shape (8, 1): (8,) is needed"),
        (given(rest_angle=with_one(NAN, 8, 7)), "rest_angle[7] = nan must be finite"),
        (given(bend_weight=np.ones(9)), "bend_weight has the shape (9,): (8,) is needed"),
        (given(bend_weight=with_one(-1.0, 8, 0)), "bend_weight[0] = -1 must be finite and not"),
        (given(velocity=np.ones(8)), "velocity has the shape (8,): (8, 2) is needed"),
        (given(velocity=with_one(INF, (8, 2), (1, 1))), "velocity[1, 1] = inf must be finite"),
        (shell(stretch=-1.0), "stretch = -1 must be finite and not below 0"),
        (shell(bend=NAN), "bend = nan must be finite and not below 0"),
        (shell(stretch_yield=0.0), "stretch_yield = 0 must be over 0"),
        (shell(bend_yield=NAN), "bend_yield = nan must be over 0"),
        (shell(stretch_damping=-1.0), "stretch_damping = -1 must be finite and not below 0"),
        (shell(bend_damping=-1.0), "bend_damping = -1 must be finite and not below 0"),
        (shell(inner_damping=INF), "inner_damping = inf must be finite and not below 0"),
        (ring(8, core=Core("elastc", 1.0)), "core law 'elastc' is none: known are none, elastic,"),
        (ring(8, core=Core("log", -1.0)), "core_stiffness = -1 must be finite and not below 0"),
        (ring(8, core=Core("log", 1.0, NAN)), "core_pressure = nan must be finite"),
        (ring(8, core=Core("gas", 0.0, 0.0)), "core_pressure = 0 must be finite and over 0"),
        (ring(8, core=Core("none", 0.0, 1.0)), "of law none has no stiffness or pressure"),
        (ring(8, core=Core("none", 1.0)), "of law none has no stiffness or pressure"),
        (ring(8, core=Core("drained", 1.0, 1.0)), "of law drained has no stiffness"),
    ],
)
def test_no_bodies(body, message):
    with pytest.raises(BodyError, match=f"^particle 1: .*{re.escape(message)}"):
        system(ring(x=5.0), body)


def test_bodies_that_are_some():
    """What the checks are to let pass: no yield, no stiffness, a pressure from outside."""
    law = Shell(0.0, 0.0, math.inf, math.inf)
    system(replace(ring(6), shell=law, core=Core("drained", 0.0, -1.0)), chain([(5, 0), (6, 0)]))


def test_no_particles_at_all():
    with pytest.raises(BodyError, match="bodies is empty"):
        system()


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"young_modulus": 0.0}, "young_modulus = 0 must be finite and over 0"),
        ({"thickness": NAN}, "thickness = nan must be finite and over 0"),
        ({"poisson": 1.0}, "poisson = 1 must be between -1 and 1"),
        ({"poisson": NAN}, "poisson = nan must be between -1 and 1"),
    ],
)
def test_no_material(numbers, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Shell.of_material(**({"young_modulus": 1.0, "thickness": 0.1} | numbers))


@pytest.mark.parametrize(
    ("wall", "message"),
    [
        (Wall(0.0, 2.0, -5.0), "wall 1: (nx, ny) = (0, 2) has the length 2: 1 is needed"),
        (Wall(0.0, 1.0 + 1e-6, -5.0), "has the length 1: 1 is needed"),
        (Wall(0.0, 1.0, NAN), "wall 1: position = nan must be finite"),
        (Wall(NAN, 1.0, -5.0), "nx = nan must be finite"),
        (Wall(0.0, 1.0, -5.0, velocity=INF), "velocity = inf must be finite"),
        (Wall(0.0, 1.0, -5.0, mass=-1.0), "mass = -1 must be finite and not below 0"),
        (Wall(0.0, 1.0, -5.0, mass=1.0, damping=-1.0), "damping = -1 must be finite and not below"),
        (Wall(0.0, 1.0, -5.0, load=1.0), "load and damping have no effect on a wall"),
        (Wall(0.0, 1.0, -5.0, damping=1.0), "load and damping have no effect on a wall"),
        (
            Wall(0.0, 1.0, -0.5),
            "a vertex of particle 0 is 0.42388 m behind wall 1, which is",
        ),
    ],
)
def test_no_walls(wall, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        system(ring(8), walls=[Wall(0.0, 1.0, -5.0), wall])


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"stiffness": 0.0}, "stiffness = 0 must be finite and over 0"),
        ({"stiffness": NAN}, "stiffness = nan must be finite and over 0"),
        ({"tangential": -1.0}, "tangential = -1 must be finite and over 0"),
        ({"friction": -0.1}, "friction = -0.1 must be finite and not below 0"),
        ({"contact_damping": NAN}, "contact_damping = nan must be finite and not below 0"),
        ({"drag": -1.0}, "drag = -1 must be finite and not below 0"),
        ({"step": NAN}, "step = nan s is none"),
        ({"step": 0.0}, "step = 0 s is none"),
        ({"cell": (9.0, 0.0)}, "cell[1] = 0 must be finite and over 0"),
        ({"cell": (9.0, 9.0), "walls": [Wall(0.0, 1.0, -5.0)]}, "a cell has no walls"),
    ],
)
def test_numbers_of_a_system(numbers, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        system(ring(8), **numbers)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.press(0, 1.0), "particle 0 has no core to be pressed"),
        (lambda s: s.press(1, NAN), "pressure = nan must be finite"),
        (lambda s: s.press(3, -1.0), "pressure = -1 must be finite and over 0"),
        (lambda s: s.press(2, 1.0), "particle 2 is open: only a ring has an inside"),
        (lambda s: s.press(4, 1.0), "p = 4 must be 0 to 3"),
        (lambda s: s.area(2), "particle 2 is open: only a ring has an inside"),
        (lambda s: s.area(-1), "p = -1 must be 0 to 3"),
        (lambda s: s.hold(np.array([0, 26])), "vertices[1] = 26 must be 0 to 25"),
        (lambda s: s.hold(np.array([-1])), "vertices[0] = -1 must be 0 to 25"),
        (lambda s: s.hold(np.array([0.5])), "vertices must be whole numbers, from 0 to 25"),
        (lambda s: s.hold(np.array([0]), vy=NAN), "vy = nan must be finite"),
        (lambda s: s.load(np.array([26]), fx=1.0), "vertices[0] = 26 must be 0 to 25"),
        (lambda s: s.load(np.array([0]), fy=INF), "fy = inf must be finite"),
        (lambda s: s.make_rigid(np.array([4])), "particles[0] = 4 must be 0 to 3"),
        (lambda s: s.advance(2.5), "steps = 2.5 must be a whole number, 0 or more"),
        (lambda s: s.advance(-5), "steps = -5 must be a whole number, 0 or more"),
        (lambda s: s.shrink(0.0), "factor = 0 must be finite and over 0"),
        (lambda s: s.shear(0.1, 1.0), "there is no cell to be sheared"),
        (lambda s: s.shear(NAN, 1.0), "amplitude = nan must be finite"),
        (lambda s: s.shear(0.1, 0.0), "frequency = 0 must be finite and over 0"),
        (lambda s: s.glue(NAN, normal=1.0, tangential=1.0), "reach = nan must be finite and not"),
        (lambda s: s.glue(0.1, normal=0.0, tangential=1.0), "normal = 0 must be finite and over 0"),
        (lambda s: s.glue(0.1, normal=1.0, tangential=-1.0), "tangential = -1 must be finite"),
        (lambda s: s.glue(0.1, normal=1.0, tangential=1.0, strength=(1.0, 0.0)), "strength[1] = 0"),
        (lambda s: s.glue(0.1, normal=1.0, tangential=1.0, toughness=-1.0), "toughness = -1 must"),
        (lambda s: s.glue(0.1, normal=1.0, tangential=1.0, exponent=0.5), "exponent = 0.5 must be"),
    ],
)
def test_numbers_of_what_is_done_to_a_system(call, message):
    """And nothing of it is done then."""
    s = system(
        ring(8), ring(8, x=4.0, core=Core("log", 1.0)), chain([(9, 0), (10, 0)]),
        ring(8, x=-4.0, core=Core("gas", 0.0, 0.1)),
    )  # fmt: skip
    with pytest.raises(ValueError, match=re.escape(message)):
        call(s)
    assert s.steps == 0
    assert s.motion.free_x.all()
    assert not s.motion.gx.any()
    assert not len(s.links.vertex)
    assert list(s.chains.core_pressure) == [0.0, 0.0, 0.0, 0.1]


def test_arrays_of_a_body_may_be_lists():
    corners = [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2), (-1, 1)]
    given = {"rest_length": [2] * 6, "rest_angle": [1] * 6, "bend_weight": [1] * 6,
             "velocity": [[0, 1e-3]] * 6}  # fmt: skip
    lists = Body(corners, True, 0.05, 1.0, Shell(0.1, 1e-4), **given)
    arrays = {name: np.array(value, float) for name, value in given.items()}
    same = Body(np.array(corners, float), True, 0.05, 1.0, Shell(0.1, 1e-4), **arrays)
    one, other = system(lists), system(same)
    for s in (one, other):
        s.advance(np.int64(3))
    assert np.array_equal(one.motion.x, other.motion.x)
    assert np.array_equal(one.motion.vy, other.motion.vy)


@pytest.mark.parametrize("points", ["ring", [(0, 0), (1,)]])
def test_points_that_are_no_array(points):
    with pytest.raises(BodyError, match="points must be an array of numbers"):
        Body(points, True, 0.05, 1.0, Shell(0.1, 1e-4))


@pytest.mark.parametrize("points", [None, 1.0, []])
def test_points_that_are_not_there(points):
    with pytest.raises(BodyError, match="at least 6 are needed"):
        system(Body(points, True, 0.05, 1.0, Shell(0.1, 1e-4)))


CROSS = "the mid-lines of particles 0 and 1 cross"
BAR = chain([(-1.0, 0.0), (1.0, 0.0)])
LONG = ring(points=np.array([(-3, -0.2), (0, -0.2), (3, -0.2), (3, 0.2), (0, 0.2), (-3, 0.2)]))
TALL = ring(points=np.array([(0.2, -3), (0.2, 0), (0.2, 3), (-0.2, 3), (-0.2, 0), (-0.2, -3)]))


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ([ring(24), ring(24, x=1.9)], CROSS),
        ([ring(24, x=1.9), ring(24)], CROSS),
        ([ring(24), ring(24)], CROSS),  # the same one
        ([LONG, TALL], CROSS),  # no vertex of one is inside the other
        ([ring(24, x=9), LONG, TALL], "particles 1 and 2 cross"),
        ([ring(24), ring(24, 0.3, x=0.2)], "particle 1 is inside particle 0"),
        ([ring(24, 0.3, x=0.2), ring(24)], "particle 0 is inside particle 1"),
        ([ring(24), chain([(0.1, 0), (0.3, 0)])], "particle 1 is inside particle 0"),
        ([ring(24), chain([(0.1, 0), (1.3, 0)])], CROSS),
        ([BAR, chain([(0.3, -1), (0.3, 1)])], CROSS),
        ([BAR, chain([(1, 0), (2, 1)])], CROSS),  # they have a point in common
    ],
)
def test_chains_that_nothing_can_part(bodies, message):
    with pytest.raises(BodyError, match=message):
        system(*bodies)


@pytest.mark.parametrize(
    "bodies",
    [
        [ring(24, thickness=0.2), ring(24, x=2.01, thickness=0.2)],  # shells deep in each other
        [LONG, ring(24, y=1.25)],
        [BAR, chain([(0.3, 0.01), (0.3, 1)])],
        # In the notch of a ring whose box it is in.
        [
            ring(points=np.array([(0, 0), (4, 0), (4, 4), (3, 4), (3, 1), (1, 1), (1, 4), (0, 4)])),
            ring(8, 0.5, x=2.0, y=3.0),
        ],
    ],
)
def test_shells_may_overlap(bodies):
    assert tangled([(body.points, body.closed) for body in bodies], None) == ""


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((0.4, 3.0), (0.6, 3.0)),
        ((0.4, 3.0), (5.5, 3.0)),
        ((3.0, 0.3), (3.0, 5.6)),
        ((0.4, 0.4), (5.5, 5.5)),
        ((0.4, 5.5), (5.5, 0.4)),
    ],
)
@pytest.mark.parametrize("turns", [0, 3])
def test_images_count_too(one, other, turns):
    """Rings that meet over an edge or a corner of the cell, wherever their copies are."""
    (ax, ay), (bx, by) = one, np.array(other) + 6.0 * turns
    rings = [ring(16, x=ax, y=ay), ring(16, x=bx, y=by)]
    for each in (rings, rings[::-1]):
        with pytest.raises(BodyError, match="particles 0 and 1 cross"):
            system(*each, cell=(6.0, 6.0))
    system(ring(16, x=ax, y=ay), ring(16, x=ax + 3.0, y=ay + 3.0), cell=(6.0, 6.0))


@pytest.mark.parametrize("inner", [(5.9, 3.0), (0.2, 3.0)])
def test_a_ring_inside_an_image(inner):
    outer = ring(16, x=6.1 - inner[0], y=3.0)
    small = ring(8, 0.3, x=inner[0], y=inner[1])
    for bodies, message in (
        ([outer, small], "particle 1 is inside particle 0"),
        ([small, outer], "particle 0 is inside particle 1"),
    ):
        with pytest.raises(BodyError, match=message):
            system(*bodies, cell=(6.0, 6.0))


def test_a_ring_that_is_larger_than_its_cell():
    with pytest.raises(BodyError, match="particles 0 and 0 cross"):
        system(ring(16), cell=(1.9, 9.0))


def test_the_search_finds_what_all_pairs_find():
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(60):
        places = rng.uniform(0, 9, (5, 2))
        chains = [(polygon(rng, 9, 0.8, *place), True) for place in places]
        alone = any(
            tangled([one, other], None) for k, one in enumerate(chains) for other in chains[k + 1 :]
        )
        assert bool(tangled(chains, None)) == alone
        found += alone
    assert 10 < found < 50


def test_a_chain_that_crosses_itself():
    """Ends that are near each other are no crossing; of a ring the last segment counts too."""
    hook = np.array([(0, 0), (2, 0), (2, 1), (1, 0.1)], float)
    assert not crosses_itself(hook, closed=False)
    assert crosses_itself(np.array([(0, 0), (2, 0), (2, 1), (1, -0.1)], float), closed=False)
    assert crosses_itself(np.array([(0, 0), (2, 0), (0, 1), (2, 1)], float), closed=True)
    assert not crosses_itself(np.array([(0, 0), (2, 0), (0, 1), (2, 1)], float), closed=False)
