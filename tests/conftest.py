"""What several test files use."""

import signal

import pytest
from hypothesis import HealthCheck, settings
from tools import new_environment

# Tests that are started in the background, or under nohup, inherit signals that are ignored, and so
# would the programs that they send signals to.
for number, handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGTERM, signal.SIG_DFL),
):
    if signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, handler)

# A busy machine is no reason to fail.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")


@pytest.fixture
def environment():
    return new_environment()


# Files of a minute and more, mostly waits: a process that began one of them last would be alone.
# Then those that compile most of what others need: two at once would both compile, or one wait.
FIRST = (
    "test_cluster.py",
    "test_sweep.py",
    "test_faults.py",
    "test_cli.py",
    "test_beam_and_free_ring.py",
    "test_hard_cases.py",
)


def pytest_collection_modifyitems(items):
    """Run the files first that others would wait for."""
    places = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path.name, len(FIRST)))
