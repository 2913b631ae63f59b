"""What several files of these tests look at; nothing changes it."""

import pytest
from sessions import CONFIGS

from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials


@pytest.fixture(scope="session")
def walk() -> Trial:
    """An active patient at 0.5 Hz, by the real loop on the virtual machine."""
    return Trials(CONFIGS / "demo.toml").gait(Situation(cadence_hz=0.5, programme="active"), 8.0)
