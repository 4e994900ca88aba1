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
