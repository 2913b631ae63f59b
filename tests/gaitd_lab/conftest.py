"""What several files of these tests look at; nothing changes it."""

from pathlib import Path

import pytest
from sessions import changed_configs

from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials


@pytest.fixture(scope="session")
def soon(tmp_path_factory) -> Path:
    """The folder of configurations, with motion that is announced for half a second."""
    files = ("demo.toml", "two_legs.toml")
    announced = [(file, "announce_s = 3.0", "announce_s = 0.5") for file in files]
    return changed_configs(tmp_path_factory.mktemp("soon"), *announced)


@pytest.fixture(scope="session")
def walk(soon) -> Trial:
    """An active patient at 0.5 Hz, by the real loop on the virtual machine."""
    return Trials(soon / "demo.toml").gait(Situation(cadence_hz=0.5, programme="active"), 8.0)
