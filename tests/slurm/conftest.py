"""One cluster for all tests of this folder; where Slurm is not installed they skip and say so."""

import pytest
from slurm.cluster import Cluster, why_not


@pytest.fixture(scope="session")
def cluster():
    if reason := why_not():
        pytest.skip(reason)
    started = Cluster()
    try:
        started.start()
        yield started
    finally:
        started.stop()
