"""Patients who work, and machines that must stop: cells of `gaitd patients`, played short."""

import numpy as np
import pytest

import gaitd_lab.testing
from gaitd_lab.patients import Gait, Late, Spasm, clonic, of_ability, trembling, weak
from gaitd_lab.studies.working_patients import CONTROLS, HEAD, MODELS, Cell, cells, play, table
from sim_drives.plant.settings import FrictionLaw


def felt(time_s=5.0, phase_ratio=0.5, error=(0.0, 0.0), direction=(1.0, -1.0)):
    return Gait(
        time_s,
        phase_ratio,
        np.array(error),
        np.zeros(2),
        np.array([8.0, 60.0]),
        np.array(direction),
        np.array([0.2, 0.6]),
    )


@pytest.fixture
def walked(soon):
    """Plays a cell."""

    def walked(patient, *, law=FrictionLaw.PAPER, seed=1, duration_s=12.0, cadence_hz=0.25):
        return play(soon / "demo.toml", Cell(patient, cadence_hz, law, seed), duration_s)

    return walked


def test_the_plugin_exports_each_patient():
    for name in gaitd_lab.testing.__all__:
        assert getattr(gaitd_lab.testing, name) is not None
    assert gaitd_lab.testing.weak is weak


def test_an_able_patient_gives_the_need_and_corrects_errors():
    assert of_ability(0.5)(felt()) == pytest.approx([4.0, 30.0])
    assert of_ability(1.4)(felt(error=(0.1, 0.01))) == pytest.approx([19.6, 95.2])


def test_a_late_patient_gives_the_same_twelve_cycles_later():
    efforts = iter(range(1, 30))
    late = Late(lambda _: np.array([next(efforts), 0.0]))

    given = [late(felt())[0] for _ in range(15)]

    assert given == [0.0] * 12 + [1.0, 2.0, 3.0]


def test_a_weak_phase_has_no_effort_and_the_others_all_of_it():
    model = weak(of_ability(1.0))

    assert model(felt(phase_ratio=0.2)) == pytest.approx([0.0, 0.0])
    assert model(felt(phase_ratio=0.075)) == pytest.approx([4.0, 30.0])
    for phase_ratio in (0.0, 0.4, 0.9):
        assert model(felt(phase_ratio=phase_ratio)) == pytest.approx([8.0, 60.0])


def test_tremor_and_clonus_have_their_sizes():
    times_s = np.arange(0.0, 2.0, 0.01)
    tremor = np.array([trembling(felt(time_s)) for time_s in times_s])
    clonus = np.array([clonic(felt(time_s)) for time_s in times_s])

    assert np.sqrt(np.mean(tremor**2, axis=0)) == pytest.approx([3.0, 15.0])
    assert np.abs(clonus).max(axis=0) == pytest.approx([10.0, 50.0], rel=0.01)
    assert not clonus[times_s > 0.71].any()


def test_a_spasm_keeps_the_direction_of_its_begin():
    spasm = Spasm(1.0)

    assert spasm(felt(0.9)) == pytest.approx([0.0, 0.0])
    spasm(felt(1.0))
    assert spasm(felt(1.03, direction=(-1.0, 1.0))) == pytest.approx([-15.0, 75.0])
    assert spasm(felt(2.0)) == pytest.approx([-30.0, 150.0])
    assert spasm(felt(2.6)) == pytest.approx([-15.0, 75.0])
    assert spasm(felt(3.1)) == pytest.approx([0.0, 0.0])


def test_each_patient_and_each_control_has_its_cells():
    wanted = cells(2)

    assert len(wanted) == len(set(wanted)) == 2 * (10 * (len(MODELS) + 1) + len(CONTROLS))


@pytest.mark.parametrize(
    ("control", "cause"),
    [
        ("coarse encoder", "OBSERVER_INVALID"),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in (
                ("spasm", "SPASM"),
                ("wrong leg", "EFFORT_DEVIATION"),
                ("unknown jitter", "OBSERVER_INVALID"),
            )
        ),
    ],
)
def test_a_machine_that_must_stop_stops(walked, control, cause):
    played = walked(control)

    assert played.cause == cause
    assert played.stopped_s < 10.0


def test_a_row_says_what_a_cell_gives_and_the_observer_knows_the_bristles_of_its_machine(walked):
    played = walked("half", law=FrictionLaw.LUGRE, cadence_hz=0.5, duration_s=6.0)

    assert not played.cause
    assert played.stopped_s == pytest.approx(6.0, abs=0.5)
    assert played.hip.patient_si > 1.0
    assert played.slide.patient_si > 10.0
    (row,) = table("Medians", [played]).rows
    assert len(row) == len(HEAD)
    assert row[:5] == ("half", "0.5 Hz", "lugre", "none", "100.0")
    assert played.slide.error_si < 0.15 * played.slide.patient_si  # 0.22 with the paper's law


def test_a_refused_gait_is_a_row_too(walked):
    played = walked("half", cadence_hz=3.0)

    assert played.cause.startswith("refused: ")
    assert table("Medians", [played]).rows[0][3].startswith("refused: ")
