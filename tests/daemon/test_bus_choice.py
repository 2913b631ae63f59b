"""Simulated time is found by one fixed name, or the error says what to install."""

import sys

import pytest
from gaitd_toml import ConfigError

from daemon.config.trainer import SIMULATED
from daemon.system import bus_choice
from daemon.system.bus_choice import BusPlace, choose_bus, simulation

PLACE = BusPlace(SIMULATED, "/run/bus", 1_000_000, "trainer.toml", "bus.channel")


@pytest.mark.parametrize(
    "lacks",
    [
        lambda patch: patch.setattr(bus_choice, "LABORATORY", "not-installed-here"),
        lambda patch: patch.setitem(sys.modules, bus_choice.MODULE, None),
        lambda patch: patch.setattr(bus_choice, "MODULE", "simtime.not_there"),
    ],
)
def test_without_simulated_time_the_error_names_what_to_install(monkeypatch, lacks):
    lacks(monkeypatch)

    with pytest.raises(ConfigError) as refused:
        choose_bus(PLACE, name="core", is_core=True)

    text = str(refused.value)
    assert text.startswith(f'trainer.toml: bus.interface = "{SIMULATED}": ')
    assert f"simulated time is in {bus_choice.LABORATORY}, which is not installed: pip" in text
    assert refused.value.following == ""


def test_an_error_inside_simulated_time_is_not_taken_for_its_absence(monkeypatch, tmp_path):
    (tmp_path / "broken_one.py").write_text("import a_package_that_is_not_there")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(bus_choice, "MODULE", "broken_one")

    with pytest.raises(ModuleNotFoundError, match="a_package_that_is_not_there"):
        simulation("trainer.toml")
