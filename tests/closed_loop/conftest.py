"""Lock-step sessions that many tests begin with; see `tests/support/forked.py`.

Each is made once for a worker. A test that needs another configuration makes a module's fixture of
its own in the same way, with a name that begins with `warm_`.
"""

import pytest
from sessions import Session


@pytest.fixture(scope="session")
def warm_ready():
    """The service with the demonstration's configuration, in mode ready."""
    return Session().until_ready()


@pytest.fixture(scope="session")
def warm_hold():
    """The same, enabled: both axes hold."""
    return Session().enabled()


@pytest.fixture(scope="session")
def warm_gait():
    """The same in the middle of a gait at 0.25 Hz, its ramps behind it."""
    return Session().walking()
