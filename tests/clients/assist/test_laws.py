"""Each law alone, with numbers that can be computed by hand."""

import math
from dataclasses import replace

import pytest
from gaitd_assist import PhaseHelp, Sample, Transparency
from gaitd_assist.lack import Guided, helping, lacking, weight
from gaitd_assist.phase_help import ASSISTED, BINS, HelpRules
from gaitd_assist.transparency import TransparencyRules
from gaitd_client import Assist

BAND = (0.04, 0.03)
HELP = HelpRules(
    dead_band=BAND,
    cap=(20.0, 150.0),
    forgetting_ratio=0.8,
    release_ratio=0.5,
    stiffness_gain_ratio=0.5,
    floor_ratio=0.1,
    gain=(100.0, 1000.0),
    lead_s=0.0,
)
TRANSPARENCY = TransparencyRules(
    friction_max=(7.0, 75.0),
    full_speed=(0.15, 0.06),
    tank_j=(0.2, 0.5),
    feedforward_ratio=0.8,
    error_ratio=0.2,
)
AT = Sample(
    dt_s=0.01,
    phase_ratio=0.25,
    cadence_hz=0.25,
    error=(0.0, 0.0),
    error_rate=(0.0, 0.0),
    velocity=(1.0, 1.0),
    friction=(None, None),
    learns=(True, True),
)
UNKNOWN = (False, False)
CYCLES = 400
"""Cycles of a stride at this cadence."""


def walked(strides, error=(0.0, 0.0), law=None, **values):
    """The law after strides with this error, and the setpoints of the last one.

    A new law walks one before them, which teaches nothing.
    """
    first, law = law is None, law or PhaseHelp(HELP)
    # The next stride's first cycle ends the last bin.
    for cycle in range(CYCLES * (strides + first) + 1):
        sample = AT._replace(phase_ratio=cycle / CYCLES % 1.0, error=error, **values)
        setpoint = law.answer(sample, Assist())
    return law, setpoint


def stiffness(law):
    return law.state().values["stiffness_ratio"]


def test_help_fades_faster_the_smaller_the_error_is_down_to_the_floor():
    assert walked(1)[0].stiffness == pytest.approx([0.5] * BINS)
    half, edge = walked(2, (0.02, 0.0))[0], walked(2, (0.04, 0.03))[0]
    assert half.stiffness[3] == pytest.approx(0.65**2)
    assert edge.stiffness[3] == pytest.approx(0.8**2)
    assert walked(20)[0].stiffness == pytest.approx([0.1] * BINS)


def test_guidance_grows_with_the_error_of_the_worse_axis_up_to_one():
    law = walked(4)[0]
    before = law.stiffness[3]
    walked(1, (0.0, 0.045), law)
    assert law.stiffness[3] == pytest.approx(0.8 * before + 0.5 * 0.5)
    walked(2, (1.0, 0.0), law)
    assert stiffness(law) == 1.0


def test_assist_is_learned_beyond_a_wider_band_and_acts_along_the_reference():
    law, setpoint = walked(1, (0.1, -0.06), velocity=(1.0, -1.0))
    beyond = 0.1 - ASSISTED * 0.04, 0.06 - ASSISTED * 0.03
    assert law.assist[0][3] == pytest.approx(100.0 * beyond[0])
    assert law.assist[1][3] == pytest.approx(1000.0 * beyond[1])
    walked(1, (0.1, -0.06), law, velocity=(1.0, -1.0))
    assert law.assist[0][3] == pytest.approx(1.8 * 100.0 * beyond[0])
    assert (setpoint.hip_nm > 1.0, setpoint.slide_n < -1.0) == (True, True)

    assert walked(3, (1.1 * 0.04, 1.1 * 0.03))[1][:2] == (0.0, 0.0)


def test_assist_is_learned_as_far_as_the_leg_is_guided():
    law, _ = walked(20)
    walked(1, (0.1, 0.0), law)

    assert law.assist[0][3] == pytest.approx(0.1 * 100.0 * (0.1 - ASSISTED * 0.04))


@pytest.mark.parametrize("velocity", [1.0, -1.0])
def test_a_leg_that_leads_its_reference_gets_no_assist_and_less_guidance(velocity):
    law, setpoint = walked(3, (-0.1 * velocity, 0.0), velocity=(velocity, 1.0))

    assert setpoint[:2] == (0.0, 0.0)
    assert law.stiffness[3] == pytest.approx(0.5**3)


def test_assist_is_zero_where_the_reference_turns_and_does_not_ask_the_leg():
    law, _ = walked(3, (0.2, 0.2))
    turning = AT._replace(error=(0.2, 0.2), error_rate=(0.5, 0.5), velocity=(-0.5, -0.5))

    assert law.answer(turning, Assist())[:2] == (0.0, 0.0)
    half = law.answer(turning._replace(error_rate=(1.0, 0.5)), Assist()).hip_nm
    whole = law.answer(turning._replace(error_rate=(1.5, 0.5)), Assist()).hip_nm
    assert half == pytest.approx(whole / 2)


@pytest.mark.parametrize(
    ("lead_s", "begin_ratio", "end_ratio", "bins"),
    [(0.0, 0.5, 0.625, (8, 9)), (0.25, 0.5, 0.625, (7, 8)), (0.25, 0.0, 0.0625, (15,))],
)
def test_help_belongs_to_its_phase_and_what_comes_later_is_learned_earlier(
    lead_s, begin_ratio, end_ratio, bins
):
    law = PhaseHelp(replace(HELP, lead_s=lead_s))
    for cycle in range(3 * CYCLES + 1):
        phase_ratio = cycle / CYCLES % 1.0
        error = (0.2 if begin_ratio <= phase_ratio < end_ratio else 0.0, 0.0)
        law.answer(AT._replace(phase_ratio=phase_ratio, error=error), Assist())

    assert tuple(at for at, size in enumerate(law.assist[0]) if size > 0.0) == bins


def test_guidance_rises_before_the_bin_that_needs_it_as_fast_as_the_service_allows():
    law, _ = walked(20)
    law.stiffness[8] = 1.0

    def guided(phase_ratio):
        at = AT._replace(phase_ratio=phase_ratio, learns=UNKNOWN)
        return law.answer(at, Assist()).stiffness_ratio

    # A bin lasts 0.25 s, in which 0.8 per second are 0.2.
    assert [guided((at + 0.5) / BINS) for at in (9, 8, 7, 6, 3)] == pytest.approx(
        [0.1, 1.0, 0.8, 0.6, 0.1]
    )


def test_a_leg_that_strays_far_is_guided_at_once():
    law, _ = walked(20)

    def guided(error):
        return law.answer(AT._replace(error=error), Assist()).stiffness_ratio

    assert guided((0.06, 0.0)) == pytest.approx(0.1)
    assert guided((0.0, 0.069)) == pytest.approx(0.8)
    assert guided((0.2, 0.0)) == 1.0
    assert guided((-0.2, 0.0)) == pytest.approx(0.1)


def test_assist_is_capped_and_not_learned_while_it_is_cut():
    assert walked(40, (1.0, 1.0))[0].assist[0][3] == 20.0
    law, _ = walked(2, (0.1, 0.1))
    before = law.assist[0][3]
    walked(3, (0.2, 0.1), law, is_cut=(True, False))
    assert law.assist[0][3] < before
    assert law.assist[1][3] > 1000.0 * 0.06


def test_guidance_does_not_fade_where_the_assist_is_cut_and_the_leg_strays():
    law, _ = walked(3)
    walked(6, (0.06, 0.0), law, is_cut=(True, False))

    assert stiffness(law) > 0.9
    assert law.assist[0] == [0.0] * BINS


def test_what_is_not_known_teaches_nothing_and_one_axis_is_enough():
    law, _ = walked(2, (0.1, 0.0))
    before = law.state()
    assert walked(2, (9.0, 9.0), law, learns=UNKNOWN)[0].state() == before
    walked(2, (0.0, 0.0), law, learns=(False, True))
    assert law.state().hip == before.hip
    assert stiffness(law) < before.values["stiffness_ratio"]


def test_the_first_stride_after_help_begins_teaches_nothing():
    law, _ = walked(2, (0.1, 0.1))
    before = law.state()
    law.begin_gait()
    assert walked(1, (1.0, 1.0), law)[0].state() == before
    assert walked(1, (1.0, 1.0), law)[0].assist[0][3] > before.hip["assist"][3]


def test_a_ramp_of_the_cadence_teaches_nothing():
    law = PhaseHelp(HELP)
    phase = 0.0
    while phase < 3.0:  # the first stride teaches nothing anyhow
        cadence_hz = 0.125 * (1.0 + phase / 2)
        phase += 0.01 * cadence_hz
        sample = AT._replace(phase_ratio=phase % 1.0, cadence_hz=cadence_hz, error=(1.0, 1.0))
        law.answer(sample, Assist())

    assert law.state() == PhaseHelp(HELP).state()


def test_the_help_of_one_gait_goes_on_in_the_next_and_less_of_it_in_a_slower_or_smaller_one():
    law, setpoint = walked(3, (0.1, 0.1))
    law.begin_gait()

    def again(speed):
        return law.answer(AT._replace(phase_ratio=0.0, velocity=(speed, speed)), Assist())

    assert again(1.0) == again(2.0) == setpoint
    assert again(0.5)[:2] == pytest.approx((setpoint.hip_nm / 2, setpoint.slide_n / 2))
    law.forget()
    assert law.state() == PhaseHelp(HELP).state()


def test_what_a_slower_pass_needs_is_learned_from_what_it_got():
    law, _ = walked(3, (0.1, 0.1))

    def hip_nm(speed):
        return law.answer(AT._replace(velocity=(speed, speed), learns=UNKNOWN), Assist()).hip_nm

    edge = (ASSISTED * 0.04, ASSISTED * 0.03)  # nothing is gained, and 0.8 is kept
    before_nm = hip_nm(0.5)
    walked(1, edge, law, velocity=(0.5, 0.5))
    assert hip_nm(0.5) == hip_nm(1.0) == pytest.approx(0.8 * before_nm)
    assert hip_nm(0.25) == pytest.approx(0.8 * before_nm / 2)
    walked(1, edge, law)
    assert hip_nm(1.0) == pytest.approx(0.8**2 * before_nm)


@pytest.mark.parametrize(
    ("needed", "patient", "lack"),
    [
        (10.0, 0.0, 10.0),
        (10.0, 4.0, 6.0),
        (10.0, 14.0, 0.0),  # who gives more is not braked
        (10.0, -7.0, 10.0),  # resistance counts as 0
        (-5.0, 0.0, 0.0),  # a motion that has to be braked lacks nothing along it
        (-5.0, -7.0, 0.0),
    ],
)
def test_what_is_lacking_is_between_nothing_and_the_need(needed, patient, lack):
    assert lacking(needed, patient) == lack


@pytest.mark.parametrize(
    ("lack", "assist", "stray_ratio", "help_"),
    [
        (22.0, 0.0, 5.0, 0.8 * 10.0),
        (22.0, 3.0, 1.5, 3.0 + 0.5 * 0.5 * 12.0),  # no more than the pass has shown
        (22.0, 3.0, 1.0, 3.0),
        (22.0, 1.0, 0.5, 0.0),
        (12.0, 9.0, 5.0, 0.0),  # guidance gives that
    ],
)
def test_help_is_what_guidance_does_not_give_and_no_more_than_the_stray_shows(
    lack, assist, stray_ratio, help_
):
    guided = Guided(effort=12.0, settled_ratio=0.8, stiffness_ratio=0.5)

    assert helping(lack, assist, stray_ratio, guided) == pytest.approx(help_)


def test_an_estimate_counts_by_its_inverse_variance():
    assert weight(0.0, 12.0) == 1.0
    assert weight(12.0 / math.sqrt(3.0), 12.0) == pytest.approx(0.5)
    assert weight(1e9, 12.0) < 1e-12


BY_ESTIMATE = replace(HELP, stiffness=(200.0, 3000.0))
TOLERATED_NM = ASSISTED * 0.04 * 200.0
SETTLED_RATIO = 100.0 / (100.0 + 0.2 * 200.0)


def estimating(patient_nm, std_nm=0.0, velocity=1.0):
    """The fields of a sample whose leg strays along a velocity and lacks at the hip."""
    return {
        "error": (0.15 * velocity, 0.0),
        "velocity": (velocity, 1.0),
        "needed": (15.0 * velocity, 0.0),
        "patient": (patient_nm * velocity, 0.0),
        "patient_std": (std_nm, 1.0),
    }


@pytest.mark.parametrize("velocity", [1.0, -1.0])
@pytest.mark.parametrize(("patient_nm", "lack_nm"), [(0.0, 15.0), (3.0, 12.0), (-9.0, 15.0)])
def test_assist_is_what_the_patient_lacks_after_one_pass(patient_nm, lack_nm, velocity):
    fields, rest = estimating(patient_nm, velocity=velocity), AT._replace(error=(0.0, 0.0))
    law, _ = walked(2, law=PhaseHelp(BY_ESTIMATE), **fields)

    size_nm = SETTLED_RATIO * (lack_nm - TOLERATED_NM)
    assert law.assist[0] == pytest.approx([size_nm] * BINS)
    setpoint = law.answer(rest._replace(velocity=(velocity, 1.0)), Assist())
    assert setpoint.hip_nm == pytest.approx(size_nm * velocity)


def test_an_estimate_that_is_not_sure_leaves_assist_to_the_stray():
    by_stray, _ = walked(2, error=(0.15, 0.0), law=PhaseHelp(HELP))
    unsure, _ = walked(2, law=PhaseHelp(BY_ESTIMATE), **estimating(0.0, std_nm=1e6))
    unknown = estimating(0.0) | {"patient": (None, None)}
    without, _ = walked(2, law=PhaseHelp(BY_ESTIMATE), **unknown)
    half = TOLERATED_NM / math.sqrt(3.0)
    mixed, _ = walked(2, law=PhaseHelp(BY_ESTIMATE), **estimating(0.0, std_nm=half))

    assert unsure.assist[0] == pytest.approx(by_stray.assist[0])
    assert without.state() == by_stray.state()
    size_nm = SETTLED_RATIO * (15.0 - TOLERATED_NM)
    assert mixed.assist[0] == pytest.approx([(size_nm + by_stray.assist[0][3]) / 2.0] * BINS)
    assert mixed.stiffness == by_stray.stiffness


def test_what_is_lacking_later_is_given_before():
    law = PhaseHelp(replace(BY_ESTIMATE, lead_s=0.25))
    for cycle in range(3 * CYCLES + 1):
        phase_ratio = cycle / CYCLES % 1.0
        lacks = 0.5 <= phase_ratio < 0.5625  # the whole bin 8
        sample = AT._replace(phase_ratio=phase_ratio, **estimating(0.0 if lacks else 15.0))
        law.answer(sample, Assist())

    assert tuple(at for at, size in enumerate(law.assist[0]) if size > 0.0) == (7, 8)


def test_without_a_gait_help_adds_nothing():
    law, _ = walked(3, (0.1, 0.1))
    before = Assist(1.0, 2.0, 0.5)

    assert law.answer(AT._replace(phase_ratio=None, error=(1.0, 1.0)), before) == before


@pytest.mark.parametrize(
    ("friction", "velocity", "hip_nm"),
    [
        (6.0, 1.0, 0.8 * 6.0),
        (-6.0, -1.0, -0.8 * 6.0),
        (6.0, 0.075, 0.8 * 6.0 / 2),  # half of the speed from which it is whole
        (60.0, 1.0, 0.8 * 7.0),  # no more than the calibrated level
        (6.0, 0.0, 0.0),
        (None, 1.0, 0.0),  # at rest, or not ok
        (6.0, -1.0, 0.0),  # it would push along with itself
    ],
)
def test_friction_is_fed_forward_only_along_the_motion(friction, velocity, hip_nm):
    sample = AT._replace(friction=(friction, None), velocity=(velocity, 0.0))

    assert Transparency(TRANSPARENCY).answer(sample, Assist())[:2] == pytest.approx((hip_nm, 0.0))
