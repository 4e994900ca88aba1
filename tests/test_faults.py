"""A small part of analysis/faults.py: kills, damage and two sweeps lose nothing."""

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


@pytest.mark.parametrize("fault", FAULTS["BLOWS"])
def test_sweeps_struck_at_random_moments_lose_nothing(study, fault):
    """12 kills and signals in all; a hundred and more in the program."""
    assert survived(FAULTS["blows"](study, fault, 2, random.Random(fault)))


@pytest.mark.parametrize("fault", ["truncated result", "flipped bit in a result"])
def test_damage_is_found_and_mended_when_told(study, fault):
    assert survived(FAULTS["damage"](study, fault, 1, random.Random(2)))


def test_two_sweeps_of_which_one_is_killed(study):
    assert survived(FAULTS["two_sweeps"](study, 1, random.Random(3)))


def test_an_edited_study_runs_what_is_new_and_keeps_what_was(study):
    assert survived(FAULTS["edited"](study, TEXT.replace("0.1,", "0.2,")))


@pytest.mark.parametrize("fault", ["full_disk", "read_only"])
def test_a_disk_that_takes_no_more(study, fault):
    if shutil.which("mount") is None or os.getuid() != 0:
        pytest.skip("only root can mount a small disk")
    try:
        row = FAULTS[fault](study)
    except FAULTS["CannotMountError"] as error:
        pytest.skip(str(error))
    assert survived(row)
