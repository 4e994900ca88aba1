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
VERSION = 2
# By strain amplitude: a row for each of COLUMNS, in its unit, and (G′, G″) [Pa].
STORED = {
    0.5: (
        [
            [1777.67170458, 1721.0107014, 1723.41582589, 1851.85255814, 1853.05482615],
            [-530.364725871, -371.661941979, 629.351904297, 372.307749745, -310.87941703],
            [1.79731144597, -1.17046006679, -2.94582496425, -2.6605967785, -0.733047056704],
            [-375.483976302, -256.536210546, 456.465108618, 289.477060112, -236.734794912],
            [0.527033142082, 0.257232949315, 1.74866320631, 0.573199496654, 0.313881060142],
            [0.224137931034, 0.0, 0.189655172414, 0.0666666666667, 0.0338983050847],
        ],
        (1223.00790512, 527.354727575),
    ),
    2.0: (
        [
            [1021.86324755, 1324.8126563, 814.367057609, 961.985862521, 1669.70151726],
            [-1068.8031365, -95.2809288507, 683.285367975, -333.558636052, -105.356692152],
            [30.4467780058, -2.09634495375, 2.32698828611, 12.9135896883, -16.4013941217],
            [-636.649233635, -93.9324559012, 418.479611277, -356.797576742, -72.4103215726],
            [83.9992387541, 5.47213539558, 89.5720056438, 22.3059429863, 10.022086305],
            [0.294117647059, 0.157894736842, 0.24, 0.241379310345, 0.218181818182],
        ],
        (228.794553616, 400.39020225),
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
