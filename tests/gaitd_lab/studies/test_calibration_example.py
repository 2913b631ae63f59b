"""The study of calibration: a plant with other friction, and what is made of the draws."""

from types import SimpleNamespace

import pytest
from gaitd_toml import load_toml
from sessions import CONFIGS

from analysis.calibration.fit import NONE, Result
from analysis.calibration.quantities import QUANTITIES, value_of
from analysis.calibration.verdict import Score
from daemon.config.settings import Robot
from gaitd_lab.excitation import EmptyMachine
from gaitd_lab.studies.calibration import FILE, TRUE_FILE, Drawn, machine_files, tables
from gaitd_lab.studies.report import Measured

COULOMB = "friction.hip.coulomb_nm"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return machine_files(tmp_path_factory.mktemp("example"))


def test_the_plant_has_other_friction_than_the_file_of_the_service(config):
    machine = EmptyMachine(config)

    assert machine.frictions[0].coulomb == 8.0
    assert machine.settings.robot.friction.hip.coulomb_nm == 6.0
    assert load_toml(config.with_name(FILE), Robot) == load_toml(CONFIGS / FILE, Robot)
    for one in machine.settings.trainer.excite["friction_hip"].torque:
        assert one.amplitude_si in (pytest.approx(1.4 * 8), pytest.approx(14), pytest.approx(18.2))


def drawn(coulomb_nm, after_nm):
    results = [
        Result(one, 6.0, coulomb_nm, 0.01, "" if one.key == COULOMB else NONE) for one in QUANTITIES
    ]
    scores = {"before": Score(4.0, 2.4, 2.3, 12.5), "after": Score(-9.5, 1.4, after_nm, 1.0)}
    return Drawn(SimpleNamespace(fit=SimpleNamespace(results=results), **scores), (5e-5, 2e-5))


def test_the_table_has_the_error_of_each_draw_as_median_and_range(config):
    truth = load_toml(config.with_name(TRUE_FILE), Robot)
    assert value_of(truth, COULOMB) == 8.0

    quantities, scores, coverage = tables(
        [drawn(8.08, 0.1), drawn(8.0, 0.3), drawn(7.92, 0.2)], truth
    )

    rows = {row[0]: row[1:] for row in quantities.rows}
    *shown, error, inside = rows["hip coulomb"]
    assert shown == ["N·m", "6", "8", "8", "0.01"]
    assert inside == "1 of 3"
    assert error == pytest.approx((0.0, -1.0, 1.0, "%"))
    assert "slide coulomb" not in rows  # a part that the machine does not have
    found = {row[0]: row[1:] for row in scores.rows}["false hip torque, N·m rms while moving"]
    assert found == (Measured(2.3, 2.3, 2.3), Measured(0.2, 0.1, 0.3))
    assert [share for _, share in coverage.rows] == pytest.approx([1 / 3, 1 / 3])
    assert "hip coulomb" in coverage.rows[1][0]
