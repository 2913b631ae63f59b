"""A session that several files of these tests begin with; see `tests/support/forked.py`."""

import pytest


@pytest.fixture(scope="session")
def warm_gym():
    """A passive patient in a gait after its ramps, under full guidance."""
    from assisted import Gym

    return Gym()
