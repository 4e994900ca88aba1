"""Threads share a simulation: the same bits, whatever their number."""

import pickle

import numpy as np
import pytest
from scenes import LOOSE, packing_point

from shear_sim.models.microgel.parameters import Links
from shear_sim.models.microgel.preparation import MicrogelRun
from shear_sim.models.microgel.state import PART
from shear_sim.packing import Equilibration
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

CRACKED = Links(cut="cells")
BRIEF = OscillatoryShear(strain_amplitude=0.5, pre_periods=0.02, periods=0.5, post_periods=0.02)


def point(discs, links, **more):
    rest = Equilibration(force_tolerance=1e-3, energy_tolerance=1e-6)
    packing = {"equilibration": rest}
    return packing_point(
        discs=discs, links=links, shear=BRIEF, friction=0.3, packing=packing, **more
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
    return columns, state, s.summary()


@pytest.mark.parametrize(
    ("discs", "links"), [(1024, CRACKED), (1100, LOOSE), (PART + 500, CRACKED)]
)
def test_same_bits(discs, links):
    """From the packing to the last record, with links, new lists of contacts, slip; and in turns.

    More discs than are summed in one part too.
    """
    alone = run(point(discs, links), 1)
    assert alone.columns()["sliding_fraction"].max() > 0.01
    assert alone.substeps > alone.steps
    expected = everything(alone)
    for threads in ((2,), (3,), (1, 3, 2)):
        assert everything(run(point(discs, links), *threads)) == expected


def test_threads_meet_discs_of_each_other():
    """A test of the test: the list of contacts holds pairs of which two threads have a disc each.

    Also without them equal bits would be no surprise.
    """
    simulation = run(point(1024, LOOSE), 2)
    i, j = simulation.pairs.i, simulation.pairs.j
    across = np.count_nonzero((i < 512) & (j >= 512))
    assert 20 < across < len(i) // 4
