"""The file of the controller, its log, and the rules of one leg that no patient shows."""

import json
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from assisted import SHIPPED, STIFFNESS, TRANSPARENCY, leg_controller, shipped
from display_bench import filled
from gaitd_assist import Memory, Sample, program
from gaitd_assist.journal import LINES_KEPT, Journal
from gaitd_assist.settings import check_caps, parse_settings, stiffness_of
from gaitd_client import Assist, AxisPlan, Mode, NoAnswerError, PlanLimits, Stage, Validity, wire
from gaitd_toml import ConfigError

BAD = {"validity": Validity.BAD}
PLAN = {"cadence_max_hz": 0.4, "amplitude_max_ratio": 1.0, "duration_max_s": 600.0}


def example(kind, **values):
    """A message of this leg with these fields; all others are empty."""
    return filled(kind, **{"core_boot_id": "boot", "leg": "right"} | values)


def estimate(cycle, hip=None, slide=None, **values):
    moved_rad = 0.005 * cycle
    well = {
        "hip": {
            "validity": Validity.OK,
            "position": 0.1 + moved_rad,
            "velocity": 1.0,
            "friction": 6.0,
            "reference_position": 0.3 + moved_rad,
        },
        "slide": {
            "validity": Validity.OK,
            "position": 0.5,
            "velocity": 0.5,
            "friction": 70.0,
            "reference_position": 0.5,
        },
        "mode": Mode.GAIT,
        "dt_s": 0.01,
        "gait_phase_ratio": cycle * 0.003 % 1.0,
    }
    axes = {"hip": well["hip"] | (hip or {}), "slide": well["slide"] | (slide or {})}
    return example(wire.Estimate, cycle=cycle, **well | axes | values)


def stride(number, cycle=1000):
    return example(wire.Stride, number=number, cycle=cycle)


def hip_nm(leg, cycles, stage=Stage.PLAYING, **values):
    return [leg.answer(estimate(cycle, **values), stage).hip_nm for cycle in cycles]


def help_of(leg):
    return leg.laws[0].state()


def test_a_leg_learns_only_while_the_gait_plays_and_its_pose_is_known():
    leg = leg_controller()
    assert hip_nm(leg, range(386))[0] == 0.0
    learned = help_of(leg)
    assert max(learned.hip["assist"]) > 1.0

    assert leg.answer(estimate(400), Stage.PLAYING) == Assist()
    assert hip_nm(leg, [386], hip={"position": None}) == [0.0]
    assert hip_nm(leg, [387], dt_s=0.0) == [0.0]
    hip_nm(leg, range(388, 600), hip=BAD, slide=BAD)
    assert help_of(leg) == learned
    # At rest, where patient and friction cannot be separated, the pose is known.
    for cycle in range(600, 900):
        at = {"validity": Validity.SPLIT_UNOBSERVABLE, "position": 0.3 + 0.005 * cycle}
        leg.answer(estimate(cycle, hip=at), Stage.PLAYING)
    assert sum(help_of(leg).hip["assist"]) < sum(learned.hip["assist"])


@pytest.mark.parametrize(
    ("later", "boot", "is_kept"),
    [(10_000, "boot", True), (70_000, "boot", False), (10_000, "another", False)],
)
def test_help_is_kept_from_block_to_block_but_not_for_another_patient(later, boot, is_kept):
    leg = leg_controller()
    hip_nm(leg, range(700))
    learned = help_of(leg)
    hip_nm(leg, [700], stage=Stage.ENDING)
    hip_nm(leg, [700 + later], core_boot_id=boot)

    assert (help_of(leg) == learned) == is_kept
    assert (max(help_of(leg).hip["assist"]) > 0.0) == is_kept


@pytest.mark.parametrize(("cadence_hz", "is_assisted"), [(0.35, True), (0.37, False)])
def test_a_gait_that_is_too_fast_is_not_assisted(cadence_hz, is_assisted):
    leg = leg_controller()
    answers = [
        leg.answer(estimate(cycle, gait_phase_ratio=(cycle * cadence_hz / 100) % 1), Stage.PLAYING)
        for cycle in range(900)
    ]

    assert (answers[-1] != Assist()) == is_assisted


@pytest.mark.parametrize("stage", [None, Stage.ANNOUNCING, Stage.ENDING])
def test_without_a_playing_gait_the_answer_is_neutral(stage):
    leg = leg_controller()
    hip_nm(leg, range(700))

    assert leg.answer(estimate(701), stage) == Assist()
    assert leg.end_stride(stride(2)) is None
    assert leg.answer(estimate(702), Stage.PLAYING).hip_nm > 0.5


def test_a_stride_has_one_line():
    leg = leg_controller()
    for cycle in range(100, 800):
        leg.answer(estimate(cycle, hip={"reference_position": 0.11 + 0.005 * cycle}), Stage.PLAYING)
    assert leg.end_stride(stride(3, cycle=100)) is None  # of before the first answer
    line = leg.end_stride(stride(4))

    assert line is not None
    assert (line.number, line.learned) == (4, True)
    assert line.hip["error_rms"] == pytest.approx(0.01)
    assert line.values["stiffness_ratio"] < 1.0
    assert leg.end_stride(stride(4)) is None


def test_assist_that_is_cut_is_not_learned_any_farther_and_a_late_one_is_not_cut():
    def learned_nm(share, late_cycles=1):
        leg, asked_nm = leg_controller(), [0.0] * late_cycles
        for cycle in range(1200):
            # The leg lags in a quarter of the stride, so the assist rises and falls within a bin.
            error_rad = 0.08 if cycle % 333 < 83 else 0.0
            given = estimate(
                cycle,
                hip={
                    "reference_position": 0.1 + error_rad + 0.005 * cycle,
                    "assist": share * asked_nm[-late_cycles],
                },
            )
            asked_nm.append(leg.answer(given, Stage.PLAYING).hip_nm)
        return help_of(leg).hip["assist"]

    whole_nm = learned_nm(1.0)
    assert sum(learned_nm(0.5)) < 0.7 * sum(whole_nm)
    assert learned_nm(1.0, late_cycles=8) == whole_nm


def test_all_laws_together_stay_within_the_cap_and_in_torque_only_friction_acts():
    text = SHIPPED.read_text().replace("hip.max_nm = 20.0", "hip.max_nm = 5.0") + TRANSPARENCY
    leg = parse_settings(text, SHIPPED).controller(STIFFNESS)

    assert max(hip_nm(leg, range(700))) == 5.0
    assert leg.end_stride(stride(1)).hip["tank_j"] == pytest.approx(0.2)
    floating = leg.answer(estimate(700, mode=Mode.TORQUE, gait_phase_ratio=None), Stage.PLAYING)
    assert floating == pytest.approx(Assist(0.6 * 6.0, 0.6 * 70.0, 1.0))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("hip.max_nm = 20.0", "hip.max_nm = -1.0", "cap.hip.max_nm = -1.0: a number >= 0"),
        ("floor_ratio = 0.1\n", "", r"help.floor_ratio = \(missing\): a number >= 0.05 and < 1"),
        ("[cap]", "[cap]\nhips = 1.0", "cap.hips = 1.0: unknown key"),
        ('legs = ["right"]', "legs = []", r"legs = \[\]: a list with 1 or more"),
        ("[cap]", "[cap", "line"),
        ('law = "estimate"', 'law = "error"', r'help.law = "error": one of "estimate", "stray"'),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_file_key_and_value(old, new, text):
    with pytest.raises(ConfigError, match=rf"assist.toml: .*{text}"):
        shipped((old, new))


def test_a_file_that_the_service_would_refuse_is_refused_before():
    limits = {"hip": {"assist_max_nm": 15.0}, "slide": {"assist_max_n": 150.0}}
    known = example(wire.Configuration, leg_names=("right",), limits=limits)

    with pytest.raises(ConfigError, match=r"cap.hip.max_nm = 20.0: at most 15"):
        check_caps(shipped(), SHIPPED, known, None)
    left = shipped(('legs = ["right"]', 'legs = ["left"]'))
    with pytest.raises(ConfigError, match=r"legs = \['left'\]: the trainer has \['right'\]"):
        check_caps(left, SHIPPED, known, None)
    weak = shipped(("hip.max_nm = 20.0", "hip.max_nm = 15.0"))
    check_caps(weak, SHIPPED, known, PlanLimits(**PLAN, slide=AxisPlan(assist_max=150.0)))
    of_plan = r"slide.max_n = 150.0: at most 80 \(slide.assist_max_n of the released plan\)"
    with pytest.raises(ConfigError, match=of_plan):
        check_caps(weak, SHIPPED, known, PlanLimits(**PLAN, slide=AxisPlan(assist_max=80.0)))


def test_a_service_without_a_core_is_named_and_not_the_file():
    gone = SimpleNamespace(
        target="gaitd/trainer",
        wait_for_core=lambda _: None,
        configuration=lambda: example(wire.Configuration, leg_names=()),
    )

    with pytest.raises(NoAnswerError, match="the core does not run: start it first"):
        program.run(shipped(), SHIPPED, gone)


def test_a_service_that_does_not_tell_its_guidance_is_refused_by_the_law_that_asks_for_it():
    told = {"hip": {"stiffness_nm_per_rad": 300.0}, "slide": {"stiffness_n_per_m": 4000.0}}
    known = example(wire.Configuration, guidance=told, version="0.1")

    assert stiffness_of(shipped(), SHIPPED, known) == STIFFNESS
    older = msgspec.structs.replace(known, guidance={})
    with pytest.raises(ConfigError, match=r'help.law = "estimate": "stray": version 0.1'):
        stiffness_of(shipped(), SHIPPED, older)
    assert stiffness_of(shipped(('"estimate"', '"stray"')), SHIPPED, older) is None


def test_the_law_of_the_readme_is_one():
    text = (SHIPPED.parents[1] / "README.md").read_text()
    scope = {"Sample": Sample, "Assist": Assist, "Memory": Memory}
    exec(text.partition("```python\n")[2].partition("```")[0], scope)
    leg = leg_controller()
    leg.laws.append(scope["Push"]())

    assert hip_nm(leg, [0, 1, 2], hip={"reference_position": 0.1}) == [0.0, 2.0, 2.0]
    assert hip_nm(leg, [3], hip={"reference_position": 0.1}, gait_phase_ratio=0.6) == [0.0]


def test_the_log_is_appended_to_and_counts_what_it_loses(tmp_path):
    leg = leg_controller()
    hip_nm(leg, range(10))
    line = leg.end_stride(stride(1))
    file = tmp_path / "assist.jsonl"
    for _ in "ab":
        with Journal(file) as journal:
            journal.add(line)
    with Journal(file) as journal:
        for _ in range(LINES_KEPT + 3):
            journal.add(line)

    assert journal.lost_count == 3
    with pytest.raises(OSError, match="/dev/full"), Journal(Path("/dev/full")) as full:
        full.add(line)
    lines = file.read_text().splitlines()
    assert len(lines) == LINES_KEPT + 2
    assert msgspec.json.decode(lines[0], type=type(line)) == line
    assert len(json.loads(lines[0])["hip"]["assist"]) == 16
