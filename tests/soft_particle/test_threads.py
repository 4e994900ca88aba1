"""Strips of chains that threads share: the same bits with any number, the same physics as one."""

import pickle

import numpy as np
import pytest
from soft_particles import angular_momentum, chain, momentum, points, ring, system

from shear_sim.models import soft_particle
from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle import strips
from shear_sim.models.soft_particle.bodies import Core
from shear_sim.models.soft_particle.state import BROKEN, SLIDING
from shear_sim.models.soft_particle.walls import Wall
from shear_sim.streams import Streams

SIDE, VERTICES = 5, 12
SPACING = 2.06
BOX = SIDE * SPACING


@pytest.fixture
def small_strips(monkeypatch):
    """Four strips of six rings."""
    monkeypatch.setattr(strips, "STRIP", 6 * VERTICES)


def rings(**law):
    """Rings in rows, pressed together; the last one is an open chain."""
    law = {"stretch_damping": 0.1, "bend_damping": 0.1, "bend_yield": 2e-5} | law
    row, column = np.divmod(np.arange(SIDE * SIDE), SIDE)
    places = [(SPACING * (c + 0.5), SPACING * (r + 0.5)) for r, c in zip(row, column, strict=True)]
    bodies = [ring(VERTICES, 1.0, *at, core=Core("log", 0.05), **law) for at in places[:-1]]
    x, y = places[-1]
    return [*bodies, chain([(x - 1.0, y), (x - 0.3, y + 0.3), (x + 0.4, y), (x + 1.0, y + 0.4)])]


def stir(s, speed):
    """Let every vertex that may have a velocity of its own, and rings against each other."""
    k = np.arange(len(s.motion.x))
    turn = 2.4 * s.chains.chain
    s.motion.vx[:] += s.motion.free_x * speed * (np.cos(turn) + 0.2 * np.sin(7.0 * k))
    s.motion.vy[:] += s.motion.free_y * speed * (np.sin(turn) + 0.2 * np.cos(5.0 * k))
    s.begin()


def boxed(toughness=0.0):
    """Rings between walls, one of which is loaded, with friction, links, a rigid and a held one."""
    walls = [
        Wall(1, 0, 0.0, slide=0.002), Wall(-1, 0, -BOX), Wall(0, 1, 0.0, velocity=1e-4),
        Wall(0, -1, -BOX, mass=30.0, load=0.02, damping=0.1),
    ]  # fmt: skip
    s = system(*rings(), walls=walls, friction=0.3, contact_damping=0.2, drag=1e-3)
    strength = (4e-4, 4e-4)
    s.glue(0.12, normal=0.01, tangential=0.01, strength=strength, toughness=toughness)
    s.make_rigid(np.array([7, 13]))
    s.hold(np.arange(3 * VERTICES, 4 * VERTICES), vx=1e-3, vy=None)
    stir(s, 0.004)
    return s


def sheared():
    """Rings in a sheared periodic cell, one of them held, with friction."""
    s = system(*rings(), friction=0.3, contact_damping=0.2, drag=1e-3, cell=(BOX, BOX))
    s.hold(np.arange(VERTICES))
    s.shear(0.3, 1e-3)
    stir(s, 0.004)
    return s


def everything(s):
    groups = s.motion, s.chains, s.springs, s.links, s.rigid, s.walls
    arrays = [a for group in groups for a in group]
    arrays += [s.cell.strain, s.cell.images, s.work.energy, s.work.closest, s.work.held]
    return [a.tobytes() for a in arrays], s.steps, s.budget()


SCENES = {
    "boxed": boxed,
    "tough links": lambda: boxed(toughness=8e-6),
    "sheared": sheared,
}


@pytest.mark.usefixtures("small_strips")
@pytest.mark.parametrize("scene", SCENES)
def test_same_bits(scene):
    """With one, two and three threads, and in turns of them with a restart between: the same."""
    outcomes = []
    for threads in ((1,), (2,), (3,), (3, 1, 2)):
        s = SCENES[scene]()
        assert len(s.strips.status) == 4
        lists = s.lists
        for block in range(6):
            s.threads = threads[block % len(threads)]
            s.advance(150)
            if len(threads) > 1:
                s = pickle.loads(pickle.dumps(s))  # noqa: S301 - our own
        outcomes.append(everything(s))
        assert s.lists is not lists
        assert s.mail.sent[:, 0].sum() > 20  # a test of the test: strips do meet
        assert s.work.energy[SLIDING] > 0.0
        if scene != "sheared":
            broken = int((s.links.intact == 0).sum())
            assert 0 < broken < len(s.links.intact)
            assert s.work.energy[BROKEN] == pytest.approx(s.links.lost.sum())
    assert all(outcome == outcomes[0] for outcome in outcomes[1:])


@pytest.mark.parametrize("scene", SCENES)
def test_strips_change_nothing_but_round_off(scene, monkeypatch):
    """Many strips and one: the same positions, forces and energies, but for the order of sums."""
    monkeypatch.setattr(strips, "STRIP", 10_000)
    one = SCENES[scene]()
    monkeypatch.setattr(strips, "STRIP", VERTICES)
    many = SCENES[scene]()
    assert (len(one.strips.status), len(many.strips.status)) == (1, 16)
    for s in (one, many):
        s.advance(200)
    for name in ("x", "vy", "fx", "fy", "dx", "dy"):
        a, b = getattr(one.motion, name), getattr(many.motion, name)
        assert a == pytest.approx(b, rel=1e-9, abs=1e-11 * np.abs(a).max()), name
    assert one.walls.push == pytest.approx(many.walls.push, rel=1e-9)
    assert one.work.energy == pytest.approx(many.work.energy, rel=1e-9, abs=1e-16)
    if len(one.links.vertex):
        assert one.links.intact.sum() == many.links.intact.sum()
    else:
        assert one.stress() == pytest.approx(many.stress(), rel=1e-9, abs=1e-14)


@pytest.mark.usefixtures("small_strips")
def test_momenta_hold_across_strips():
    """What a strip does to vertices of others comes back to it, couples of friction included."""
    s = system(*rings(), friction=0.5, contact_damping=0.2)
    s.glue(0.12, normal=0.01, tangential=0.01)
    stir(s, 0.004)
    before, angular = momentum(s), angular_momentum(s)
    s.threads = 2
    s.advance(400)
    assert s.work.energy[SLIDING] > 0.0
    assert momentum(s) == pytest.approx(before, abs=1e-13)
    assert angular_momentum(s) == pytest.approx(angular, abs=1e-11)


@pytest.mark.usefixtures("small_strips")
@pytest.mark.parametrize("speed", [50.0, np.nan])
def test_all_threads_stop_at_a_guard(speed):
    """Where one strip goes too fast all stop at the same step, and say the same."""
    said = []
    for threads in (1, 2):
        s = boxed()
        s.advance(10)
        s.motion.vx[-1] = speed
        s.threads = threads
        with pytest.raises(SimulationError, match="stopped at t") as caught:
            s.advance(10)
        said.append(str(caught.value))
    assert said[0] == said[1]


@pytest.mark.usefixtures("small_strips")
def test_a_job_hands_its_threads_on():
    """The records of a whole run are the same, and rings of a large pack are numbered in rows."""
    packing = {"particles": 12, "vertices": 12, "spread": 0.1}
    shear = {"kind": "compaction", "strain": 0.1, "relative_rate": 0.03}
    point = points(packing=packing, model={"thickness": 0.2, "friction": 0.2}, shear=shear)
    tables = []
    for threads in (1, 2):
        simulation = soft_particle.start(point(record={"rows": 10}), Streams(1, 0))
        simulation.threads = threads
        pack = simulation.run.system
        assert pack.threads == threads
        heights = np.add.reduceat(pack.motion.y, pack.chains.start[:-1])
        assert (np.diff(heights) > 0.0).all()
        while simulation.done < simulation.rows:
            simulation.advance(100)
        tables.append({name: values.tobytes() for name, values in simulation.columns().items()})
    assert tables[0] == tables[1]


def test_strips_are_of_whole_chains(monkeypatch):
    """Every chain is in one strip, whose vertices are about as many; few vertices are one strip."""
    chains = system(*rings()).chains
    assert len(strips.divide(chains, 0).status) == 1
    monkeypatch.setattr(strips, "STRIP", 3 * VERTICES)
    divided = strips.divide(chains, 0)
    assert divided.vertex.tolist() == chains.start[divided.chain].tolist()
    sizes = np.diff(divided.vertex)
    assert sizes.sum() == len(chains.chain)
    assert sizes.max() - sizes.min() <= 2 * VERTICES
    for s in range(len(sizes)):
        p, q = divided.chain[s : s + 2]
        own = divided.start[p + s : q + s + 1] + divided.vertex[s]
        assert own.tolist() == chains.start[p : q + 1].tolist()


@pytest.mark.parametrize(
    ("packing", "shear"),
    [
        ({"particles": 25, "vertices": 12}, {"kind": "compaction"}),
        ({"particles": 25, "vertices": 12}, {"kind": "oscillatory"}),
        ({"vertices": 100}, {"kind": "diametral_compression"}),
        ({"vertices": 48}, {"kind": "bending"}),
    ],
)
@pytest.mark.parametrize("strip", [30, 70, 100, 1000])
def test_there_is_a_strip_for_every_thread(packing, shear, strip, monkeypatch):
    """`most_threads` tells from the study alone how many strips the system has once made."""
    monkeypatch.setattr(strips, "STRIP", strip)
    point = soft_particle.POINT.model_validate(
        {"model": {"kind": "soft_particle"}, "packing": packing, "shear": shear}
    )
    made = soft_particle.start(point, Streams(0, 0)).run.system
    assert soft_particle.most_threads(point) == len(made.strips.status)


@pytest.mark.parametrize("strip", [100, 300, 650])
def test_a_tissue_has_as_many_strips_or_more(strip, monkeypatch):
    """So many vertices has no study: they are as many as the sides of its cells are long."""
    monkeypatch.setattr(strips, "STRIP", strip)
    point = soft_particle.POINT.model_validate(
        {
            "model": {"kind": "soft_particle", "links": {}},
            "packing": {"particles": 50, "vertices": 24, "preparation": "tissue"},
            "shear": {"kind": "tension"},
        }
    )
    made = soft_particle.start(point, Streams(0, 0)).run.system
    assert 1.0 < len(made.motion.x) / (50 * 24) < 1.15
    counted = soft_particle.most_threads(point)
    assert len(made.strips.status) in (counted, 2 * counted)


def test_the_rule_in_words_is_that_of_the_strips():
    assert f"one for each {strips.STRIP:,} vertices" in soft_particle.THREADS
    assert f"or {strips.MOST}" in soft_particle.THREADS
