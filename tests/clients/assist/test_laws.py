"""Each law alone, with numbers that can be computed by hand."""

import math

import pytest
from gaitd_assist import Guidance, PhaseAssist, Sample, Transparency
from gaitd_assist.guidance import GuidanceRules
from gaitd_assist.phase_assist import PhaseRules
from gaitd_assist.transparency import TransparencyRules
from gaitd_client import Assist

BAND = (0.04, 0.03)
GUIDANCE = GuidanceRules(dead_band=BAND, forgetting_ratio=0.8, gain_ratio=0.5, floor_ratio=0.1)
PHASE = PhaseRules(
    dead_band=BAND,
    cap=(20.0, 150.0),
    floor_ratio=0.1,
    basis_count=16,
    gain=(100.0, 1000.0),
    learning_s=1.0,
    lead_s=0.1,
    forgetting_s=5.0,
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
    velocity=(0.0, 0.0),
    friction=(None, None),
    learns=(True, True),
)
FROZEN = (False, False)


def strides_of(law, errors, *, learns=(True, True), cycles=10):
    """The stiffness after each stride of a constant error."""
    made = []
    for error in errors:
        for _ in range(cycles):
            law.answer(AT._replace(error=error, learns=learns), Assist())
        law.end_stride()
        made.append(law.stiffness_ratio)
    return made


def test_stiffness_is_forgotten_within_the_dead_band_down_to_the_floor():
    ratios = strides_of(Guidance(GUIDANCE), [(-0.04, 0.03)] * 20)

    assert ratios[:3] == pytest.approx([0.8, 0.64, 0.512])
    assert ratios[-1] == 0.1


def test_stiffness_grows_with_the_error_of_the_worse_axis_up_to_one():
    law = Guidance(GUIDANCE)
    strides_of(law, [(0.0, 0.0)] * 3)

    # 0.8 * 0.512 + 0.5 * (0.045 / 0.03 - 1)
    assert strides_of(law, [(0.0, 0.045)]) == pytest.approx([0.6596])
    assert strides_of(law, [(1.0, 0.0)]) == [1.0]


def test_a_stride_that_is_mostly_unknown_changes_no_stiffness_and_one_axis_is_enough():
    law = Guidance(GUIDANCE)

    assert strides_of(law, [(0.0, 0.0)] * 3, learns=FROZEN) == [1.0] * 3
    assert strides_of(law, [(0.0, 9.0)], learns=(True, False)) == pytest.approx([0.8])


def test_assist_at_a_phase_rises_by_gain_and_error_and_is_forgotten_without():
    law = PhaseAssist(PHASE)
    pushed = AT._replace(error=(0.05, -0.05), error_rate=(0.1, 0.0))

    first = law.answer(pushed, Assist())
    # 10 ms of 100 N m/rad/s on 0.01 rad beyond the band and 0.1 s of 0.1 rad/s; of 1000 N/m/s
    assert first[:2] == pytest.approx((0.01 * 100 * 0.02, -0.01 * 1000 * 0.02))
    for _ in range(300):
        risen = law.answer(pushed, Assist())
    for _ in range(500):
        faded = law.answer(AT, Assist())
    assert faded.hip_nm == pytest.approx(risen.hip_nm * math.exp(-1), rel=0.01)


@pytest.mark.parametrize(("stiffness_ratio", "learned_share"), [(1, 1), (0.55, 0.5), (0.1, 0)])
def test_assist_is_learned_as_far_as_the_leg_is_guided(stiffness_ratio, learned_share):
    law = PhaseAssist(PHASE)
    guided = Assist(0.0, 0.0, stiffness_ratio)

    setpoint = law.answer(AT._replace(error=(0.05, 0.05)), guided)
    assert setpoint[:2] == pytest.approx((learned_share * 0.01, learned_share * 0.2))


def test_assist_belongs_to_its_phase_across_the_end_of_a_stride():
    law = PhaseAssist(PHASE)
    for _ in range(100):
        law.answer(AT._replace(phase_ratio=0.99, error=(0.2, 0.0)), Assist())

    def assist_nm(phase_ratio):
        return law.answer(AT._replace(phase_ratio=phase_ratio, learns=FROZEN), Assist()).hip_nm

    assert assist_nm(0.01) == pytest.approx(assist_nm(0.97), rel=0.05)
    assert assist_nm(0.5) < 1e-6 * assist_nm(0.99)


def test_assist_is_capped_and_frozen_where_nothing_is_learned_and_gone_with_a_new_gait():
    law = PhaseAssist(PHASE)
    for _ in range(20000):
        capped = law.answer(AT._replace(error=(1.0, -1.0)), Assist())
    frozen = [law.answer(AT._replace(error=(-1.0, 1.0), learns=FROZEN), Assist()) for _ in "ab"]
    law.begin_gait()

    assert capped[:2] == pytest.approx((20.0, -150.0), rel=1e-3)
    assert frozen == [capped, capped]
    assert law.answer(AT, Assist()) == Assist()


@pytest.mark.parametrize("law", [Guidance(GUIDANCE), PhaseAssist(PHASE)])
def test_without_a_gait_these_laws_add_nothing(law):
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
