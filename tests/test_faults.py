"""A small part of analysis/faults.py: kills, damage and disks that take no more lose nothing."""

import os
import random
import runpy
import shutil
import sys
from pathlib import Path

import pytest
from tools import COMMAND, STUDY

FAULTS = runpy.run_path(str(Path(__file__).parents[1] / "analysis" / "faults.py"))
TEXT = STUDY.format(seconds=0.3, faults="[none]", replicates=2)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """6 jobs of 0.3 s of the stand-in model."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        yield FAULTS["Study"](
            tmp_path_factory.mktemp("faults"), TEXT, (sys.executable, "-c", COMMAND)
        )


def survived(row):
    return (row.survived, row.bytes_lost) == (row.tried, 0)


def test_ten_kills_and_signals_at_random_moments_lose_nothing(study):
    assert survived(FAULTS["blows"](study, list(FAULTS["BLOWS"]), 10, random.Random(1)))


def test_a_flipped_bit_is_found_and_mended_when_told(study):
    assert survived(FAULTS["damage"](study, "flipped bit in a result", 1, random.Random(2)))


@pytest.mark.parametrize("fault", ["full_disk", "read_only"])
def test_a_disk_that_takes_no_more(study, fault):
    if shutil.which("mount") is None or os.getuid() != 0:
        pytest.skip("only root can mount a small disk")
    try:
        row = FAULTS[fault](study)
    except FAULTS["CannotMountError"] as error:
        pytest.skip(str(error))
    assert survived(row)
