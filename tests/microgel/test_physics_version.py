"""The physics version of a job's id, pinned to numbers: what computes others has another version.

If `test_numbers_of_this_version` fails after a change that was meant: raise PHYSICS_VERSION and
store the printed numbers anew. Otherwise results of the new program would be taken for the old.
"""

import numpy as np
import pytest

from shear_sim.models.microgel import PHYSICS_VERSION
from shear_sim.runner import run_job
from shear_sim.study import load_study
from shear_sim.tables import read_table

STUDY = """
packing: {discs: 20}
model: {friction: 0.3, links: {cut: cells, cuts: 2, avoid_height_spanning: false}}
shear: {pre_periods: 0.1, periods: 1, post_periods: 0.1}
integrator: {steps_per_period: 80}
record: {every: 4}
sweep: {grid: {shear.strain_amplitude: [0.5, 2.0]}}
seed: 1
"""
COLUMNS = (
    "periodic_love_weber_xx",
    "periodic_love_weber_xy",
    "periodic_torque_yx",
    "love_weber_xy",
    "peculiar_yy",
    "sliding_fraction",
)
RECORDS = slice(4, None, 5)  # five of the 25
VERSION = 6
# By strain amplitude: a row for each of COLUMNS, in its unit, and (G′, G″) [Pa].
STORED = {
    0.5: (
        [
            [1777.67170674, 1721.01070266, 1723.41582129, 1851.85255817, 1853.05482185],
            [-530.364724722, -371.661941083, 629.351905162, 372.307744883, -310.879421111],
            [1.79731155145, -1.17046012019, -2.94582514288, -2.6605973931, -0.733046889389],
            [-375.483975373, -256.536209705, 456.465109041, 289.477054491, -236.734798792],
            [0.527033135681, 0.25723294778, 1.74866323553, 0.573199516883, 0.31388103388],
            [0.224137931034, 0.0, 0.189655172414, 0.0666666666667, 0.0338983050847],
        ],
        (1223.00790121, 527.354730828),
    ),
    2.0: (
        [
            [1021.86324398, 1324.81266135, 814.367068692, 961.985855042, 1669.55668088],
            [-1068.80313635, -95.2809462035, 683.285385375, -333.558627602, -105.00789904],
            [30.4467773653, -2.09634744253, 2.32698914602, 12.9135728556, -16.3219239037],
            [-636.64923346, -93.9324680232, 418.479618196, -356.797564247, -72.0487127914],
            [83.999238651, 5.47213558656, 89.5720044182, 22.3059373076, 10.0717830471],
            [0.294117647059, 0.157894736842, 0.24, 0.241379310345, 0.218181818182],
        ],
        (228.794556753, 400.390204373),
    ),
}


def measured(job, folder):
    table = read_table(run_job(job, folder))
    moduli = table.summary["moduli"]["periodic"]
    columns = [table.columns[name] for name in COLUMNS]
    return columns, (moduli["storage"], moduli["loss"])


@pytest.fixture(scope="module")
def jobs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("physics_version")
    (folder / "study.yaml").write_text(STUDY)
    jobs = load_study(folder / "study.yaml").jobs()
    return {job.point.shear.strain_amplitude: measured(job, folder) for job in jobs}


def test_numbers_of_this_version(jobs):
    """To 1e-9 of the largest entry of each column: processors and orders of sums differ by less.

    Between two programs that sum contacts in another order it was 3e-11.
    """
    shown = {
        amplitude: ([[float(f"{v:.12g}") for v in c[RECORDS]] for c in columns], moduli)
        for amplitude, (columns, moduli) in jobs.items()
    }
    assert PHYSICS_VERSION == VERSION, f"store these numbers anew: {shown}"
    assert STORED.keys() == jobs.keys()
    for amplitude, (rows, stored_moduli) in STORED.items():
        columns, moduli = jobs[amplitude]
        for name, row, column in zip(COLUMNS, rows, columns, strict=True):
            error = np.abs(column[RECORDS] - row).max() / np.abs(column).max()
            assert error < 1e-9, f"{name}: {error:.1e}, raise PHYSICS_VERSION and store {shown}"
        assert moduli == pytest.approx(stored_moduli, rel=1e-9)


def test_the_pinned_job_does_what_makes_numbers(jobs):
    """Its contacts slide and its links turn, and the two amplitudes differ."""
    for columns, (storage, loss) in jobs.values():
        values = dict(zip(COLUMNS, columns, strict=True))
        assert values["sliding_fraction"].max() > 0.01
        assert np.abs(values["periodic_torque_yx"]).max() > 0
        assert min(storage, loss) > 0
    assert jobs[0.5][1] != pytest.approx(jobs[2.0][1], rel=0.01)
