"""Strips of discs and the threads that share them: the same bits, whatever the number of threads.

A real strip has 1,024 discs or more; the fixture ``small_strips`` makes them small, so that a few
discs have several and most pairs lie across two.
"""

import pickle

import numpy as np
import pytest
from scenes import (
    LOOSE,
    angular_momentum,
    finish,
    linear_momentum,
    packing_point,
    prepared,
    scene,
    steady,
)

from shear_sim import runner
from shear_sim.models import microgel
from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel import strips
from shear_sim.models.microgel.parameters import Integrator, Links, Record
from shear_sim.models.microgel.preparation import MicrogelRun
from shear_sim.models.microgel.prepared import PreparedMicrogel
from shear_sim.models.microgel.simulation import make_pairs, make_work
from shear_sim.models.microgel.state import OPEN, PERIOD, PHASE, places_of
from shear_sim.models.microgel.strips import STRIP, edges_of, in_strips, joined, share, shared_by
from shear_sim.packing import Cell, Equilibration
from shear_sim.protocol import OscillatoryShear
from shear_sim.runner import Stopped, run_job
from shear_sim.single import differences
from shear_sim.streams import Streams
from shear_sim.study import Job
from shear_sim.tables import read_table

CRACKED = Links(cut="cells", normal_factor=0.9)  # so that a packing must come to rest anew
BRIEF = OscillatoryShear(strain_amplitude=0.5, pre_periods=0.025, periods=0.5, post_periods=0.025)
#: 40 discs each. In the second the strain regrids the cell twice.
SCENES = {
    "links": packing_point(links=CRACKED, friction=0.3, shear=BRIEF),
    "steady": packing_point(friction=0.5, shear=steady(2.0)),
    "frictionless": packing_point(friction=0.0, shear=BRIEF),
    "plates": packing_point(
        links=CRACKED, friction=0.3, shear=BRIEF, cell=Cell(boundary="plates")
    ),
    "historical": packing_point(
        links=CRACKED, friction=0.3, shear=BRIEF, sliding="reset", drive="boundary",
        lever_arms="otsuki2017",
    ).model_copy(update={"integrator": Integrator(scheme="semi_implicit_euler")}),
}  # fmt: skip


@pytest.fixture
def small_strips(monkeypatch):
    """Five strips of 40 discs."""
    monkeypatch.setattr(strips, "STRIP", 8)


def large(discs, links):
    rest = Equilibration(force_tolerance=1e-3, energy_tolerance=1e-6)
    packing = {"equilibration": rest}
    return packing_point(
        discs=discs, links=links, shear=BRIEF, friction=0.3, packing=packing, steps_per_period=100
    )


def run(point, *threads):
    """Run a job from its packing on; with several numbers of threads, these in turn."""
    job = MicrogelRun(point, Streams(3, 0))
    turn = 0
    while job.done < job.rows:
        job.threads = threads[turn % len(threads)]
        turn += 1
        job.advance(60)
        job = pickle.loads(pickle.dumps(job))  # noqa: S301 - our own
    return job.simulation


def everything(simulation):
    s = simulation
    columns = [values.tobytes() for values in s.columns().values()]
    state = [a.tobytes() for a in (*s.discs, *s.links, *s.contacts)]
    shots = [getattr(shot, name) for shot in s.snapshots for name in type(shot).__slots__]
    return columns, state, s.summary(), [np.asarray(value).tobytes() for value in shots]


@pytest.mark.parametrize(("discs", "links"), [(2 * STRIP, CRACKED), (3 * STRIP + 5, LOOSE)])
def test_same_bits_of_many_discs(discs, links):
    """From packing to last record, with links, new lists of contacts and slip; and in turns."""
    alone = run(large(discs, links), 1)
    assert alone.columns()["sliding_fraction"].max() > 0.01
    assert alone.substeps > alone.steps
    expected = everything(alone)
    for threads in ((2,), (3,), (1, 3, 2)):
        assert everything(run(large(discs, links), *threads)) == expected


def test_threads_meet_discs_of_each_other():
    """A test of the test above: the list holds pairs of which two threads have a disc each.

    Also without them equal bits would be no surprise.
    """
    simulation = run(large(2 * STRIP, LOOSE), 2)
    i, j = simulation.pairs.i, simulation.pairs.j
    across = np.count_nonzero((i < STRIP) & (j >= STRIP))
    assert 20 < across < len(i) // 4


@pytest.mark.usefixtures("small_strips")
@pytest.mark.parametrize("name", SCENES)
def test_same_bits(name):
    """Of every kind of scene and its snapshots, also with more threads than strips."""
    point = SCENES[name].model_copy(update={"record": Record(every=2, snapshots=5)})
    alone = run(point, 1)
    assert len(alone.work.edges) == 6
    assert len(alone.snapshots) >= 3
    assert (alone.preparation["settling_steps"] > 0) == (point.model.links.cut == "cells")
    assert abs(alone.work.turns[0]) == (2 if name == "steady" else 0)
    expected = everything(alone)
    for threads in ((2,), (3,), (5, 1), (7,)):
        assert everything(run(point, *threads)) == expected


@pytest.mark.parametrize("name", SCENES)
def test_strips_change_nothing_but_rounding(name, monkeypatch):
    """From one start, for a time too short for rounding to grow: the same motion and records."""
    start = PreparedMicrogel(SCENES[name], Streams(3, 0))
    whole = start.start()
    monkeypatch.setattr(strips, "STRIP", 8)
    divided = start.start()
    assert (len(whole.work.edges), len(divided.work.edges)) == (2, 6)
    divided.threads = 2
    for simulation in (whole, divided):
        simulation.advance(min(30, simulation.rows))
    one, other = whole.columns(), divided.columns()
    assert any((one[name] != other[name]).any() for name in one)  # sums have another order
    for column, values in one.items():
        scale = max(np.abs(values).max(), 1e-12 * np.abs(one["love_weber_xx"]).max())
        assert np.abs(other[column] - values).max() < 1e-10 * scale, column
    assert start.distance(whole, divided) < 1e-11


def test_a_packing_made_in_strips_is_the_same(monkeypatch):
    """The relaxation from random places on is long: places agree as far as its end is sharp."""
    whole = prepared(SCENES["links"])
    monkeypatch.setattr(strips, "STRIP", 8)
    divided = prepared(SCENES["links"])
    assert divided.preparation["at_rest"]
    size = whole.discs.radius.mean()
    for one, other in zip(whole.discs[:2], divided.discs[:2], strict=True):
        assert np.abs(one - other).max() < 1e-6 * size
    touching = [
        sorted(zip(pairs.i[act].tolist(), pairs.j[act].tolist(), strict=True))
        for pairs in (whole.pairs, divided.pairs)
        for act in (pairs.state != OPEN,)
    ]
    assert touching[0] == touching[1]


@pytest.mark.usefixtures("small_strips")
@pytest.mark.parametrize("threads", [1, 3])
def test_momentum_and_symmetry(threads):
    """Both sides of a pair across two strips get the same force; each tensor has every pair once.

    A pair that one thread misses, or that two count, breaks Σ m c = 0 and the identity (S1-19).
    """
    simulation = prepared(SCENES["steady"])
    simulation.threads = threads
    finish(simulation)
    d = simulation.discs
    scale = (d.mass * np.hypot(d.cx, d.cy)).sum()
    assert np.abs(linear_momentum(simulation)).max() < 1e-12 * scale
    checks = simulation.summary()["checks"]
    assert checks["asymmetry_periodic"] < 1e-15
    assert 0 < checks["love_weber_identity"] < 1e-13


def test_angular_momentum(monkeypatch):
    """A linked, frictional cluster that tumbles, two of its six discs in each strip."""
    monkeypatch.setattr(strips, "STRIP", 2)
    rng = np.random.default_rng(3)
    position = np.array([(0, 0), (1.7, 0.1), (0.9, 1.5), (2.5, 1.6), (1.8, 3.1), (5.0, 1.6)])
    simulation = scene(
        position, 1.0, velocity=rng.normal(size=(6, 2)), spin=rng.normal(size=6),
        mass=rng.uniform(0.5, 2, 6), links=[(0, 1), (0, 2), (1, 2), (1, 3), (2, 4), (3, 4)],
        k=20.0, kt=8.0, eta=0.2, etat=0.1, friction=0.5, step=0.02, steps=1000, skin=0.4,
    )  # fmt: skip
    simulation.threads = 3
    before, momentum = angular_momentum(simulation), linear_momentum(simulation)
    finish(simulation)
    assert np.abs(linear_momentum(simulation) / momentum - 1).max() < 1e-12
    assert abs(angular_momentum(simulation) / before - 1) < 1e-12


@pytest.mark.usefixtures("small_strips")
def test_a_stopped_job_goes_on_with_other_threads(tmp_path, monkeypatch):
    """In the midst of its preparation too: the table and the summary are those of one core."""
    monkeypatch.setattr(runner, "BLOCK_SECONDS", 0.0)
    monkeypatch.setattr(runner, "FIRST_BLOCK", 40)

    def job(threads):
        return Job("0" * 16, SCENES["links"], seed=3, replicate=0, threads=threads)

    def folder(name):
        (made := tmp_path / name / "jobs").mkdir(parents=True)
        return made

    whole, jobs = read_table(run_job(job(1), folder("whole"))), folder("pieces")
    for threads in (2, 3, 1, 5):
        with pytest.raises(Stopped):
            run_job(job(threads), jobs, stop=lambda: True)
    pieces = read_table(run_job(job(2), jobs))
    assert pieces.summary["run"]["resumed"] == 4
    assert pieces.summary["run"]["threads"] == 2
    assert differences(whole, pieces) == []


@pytest.mark.usefixtures("small_strips")
def test_threads_fail_together():
    """A run that explodes ends in all threads at once, with the message of one."""
    told = []
    for threads in (1, 2, 4):
        simulation = prepared(SCENES["steady"])
        simulation.threads = threads
        simulation.discs.cx[3] = 1e12
        with pytest.raises(SimulationError) as error:
            finish(simulation)
        told.append(str(error.value))
    assert told[1:] == told[:1] * 2


@pytest.mark.parametrize("n", [1, 40, 2 * STRIP - 1, 2 * STRIP, 16_384, 100_000, 300_000])
def test_strips_are_alike_and_follow_from_the_number_of_discs(n):
    edges = edges_of(n)
    sizes = np.diff(edges)
    assert (edges[0], edges[-1]) == (0, n)
    assert sizes.max() - sizes.min() <= 1
    assert len(sizes) == 1 or sizes.min() >= STRIP
    assert len(sizes) == {1: 1, 40: 1, 2047: 1, 2048: 2, 16_384: 16}.get(n, 64)


@pytest.mark.usefixtures("small_strips")
def test_there_is_a_strip_for_every_thread():
    """`most_threads` tells from the study what the simulation has strips for; see the words."""
    for discs in (20, 2 * STRIP - 1, 2 * STRIP, 16_384, 100_000):
        point = packing_point(discs=discs)
        assert microgel.most_threads(point) == len(make_work(discs).pair_sums)
    balanced = point.model_copy(update={"record": Record(energy=True)})
    assert microgel.most_threads(balanced) == 1
    assert f"one for each {STRIP:,} discs" in microgel.THREADS


@pytest.mark.parametrize("threads", [1, 2, 3, 5])
def test_every_thread_has_the_pairs_of_its_discs(threads):
    """All pairs with a disc of its own, in the order of the one list; together they are it."""
    rng = np.random.default_rng(0)
    ends = np.sort([rng.choice(40, 2, replace=False) for _ in range(500)], axis=1)
    ends = np.unique(ends, axis=0)
    springs = rng.normal(size=len(ends))
    work = make_work(40)
    pairs = in_strips(make_pairs(ends, spring=springs), work.edges)
    at = places_of(pairs)
    assert np.array_equal(np.column_stack([pairs.i[at], pairs.j[at]]), ends)
    works = shared_by(work, threads)
    lists = [share(pairs, own) for own in works]
    for own, own_pairs in zip(works, lists, strict=True):
        mine = ((ends >= own.begin) & (ends < own.end)).any(axis=1)
        at = places_of(own_pairs)
        assert np.array_equal(np.column_stack([own_pairs.i[at], own_pairs.j[at]]), ends[mine])
    for one, other in zip(joined(lists, works), pairs, strict=True):
        assert np.array_equal(one, other)


def test_what_is_written_is_never_taken_for_what_is_read():
    """Columns of the pairs' table and of the block begin apart, in every list that is made."""
    simulation = prepared(SCENES["links"])
    for _ in range(3):
        assert simulation.contacts.table.ctypes.data % PERIOD == 0
        assert simulation.work.block.ctypes.data % PERIOD == PHASE
        simulation.advance(20)
