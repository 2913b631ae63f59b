"""What the patient's page shows, for each state of the machine; without server and browser."""

import itertools

import display_bench as bench
import pytest
from gaitd_client import Cause, Event, Mode, Stage, Stride
from gaitd_display.patient_view import PatientState
from gaitd_display.scenes import Picture
from gaitd_display.settings import FAR_ARC_MIN, PatientSettings, Screen
from gaitd_display.training import Summary, TrainingView
from gaitd_display.walk import HIGH_RATIO, LOW_RATIO, height_of
from gaitd_display.way_out import ALONE, Step, Unstrap
from gaitd_display.words import UNBROKEN, Word, page_texts
from gaitd_session import Advice, Band, Button, Phase, Result, Why
from gaitd_session import Step as Walked
from gaitd_texts import CAUTIOUS, STOPS, Situation
from gaitd_toml import ConfigError

TEXTS = page_texts()
HEADING_MAX = 21
LAST_LINE_MAX = 39
"""Characters that fit at the size that is read from the chair."""
REASON = {"en": "the leg is too far", "de": "das Bein ist zu weit"}


class Shown:
    """The state of a page, fed with messages of a trainer."""

    def __init__(self, folder, legs=("right",), **table):
        self.trainer = bench.MessageTrainer(legs)
        made = bench.patient_table(folder, legs=legs, **table)
        self.state = PatientState(bench.settings_of(folder, made, PatientSettings), "run")
        self.state.use(self.trainer.configuration())
        self._activity = [(leg, self.trainer.activity(leg)) for leg in legs]
        self._safety = self.trainer.safety()
        axes = [f"{leg}/{axis}" for leg in legs for axis in ("hip", "slide")]
        self._drives = [self.trainer.drive(axis) for axis in axes]

        self.training = None

    def look(self):
        activities = [(leg, stream.newest()) for leg, stream in self._activity]
        drives = [stream.newest() for stream in self._drives]
        return self.state.take(activities, self._safety.newest(), drives, self.training)

    def after(self, mode, **given):
        self.trainer.cycles(mode, **given)
        return self.look()

    def walk(self, *shares, leg="right", against=0.0):
        """Steps of one leg, each with its share."""
        for share in shares:
            view = self.after(Mode.GAIT, stage=Stage.PLAYING)
            works = {"work_positive_j": 3.0, "work_negative_j": -against}
            given = {"leg": leg, "mode": "gait", "share_ratio": share, **works}
            self.state.take_stride(bench.filled(Stride, **given))
            view = self.look()
        return view


def said(view, language="en"):
    """All that is said, as the page fills it in."""
    texts = TEXTS[language] | {"page.help": "HELP", "page.unstrap": "UNSTRAP"}
    scene = view.scene
    phrases = [scene.heading, scene.line, scene.whole]
    for card in scene.cards:
        phrases += [card.title, card.text]
    phrases += [strip.text for strip in scene.strips]
    return [
        texts[one.key].format(**{"help": "HELP", **one.values})
        if one.said is None
        else one.said[language]
        for one in phrases
        if one is not None
    ]


@pytest.fixture
def screen(tmp_path):
    return Shown(tmp_path)


@pytest.mark.parametrize(
    ("mode", "stage", "word"),
    [
        (Mode.OFF, None, Word.WAIT),
        (Mode.BRINGING_UP, Stage.PREPARING, Word.WAIT),
        (Mode.READY, None, Word.READY),
        (Mode.HOLD, None, Word.HELD),
        (Mode.HOLD, Stage.PREPARING, Word.WAIT),
        (Mode.GAIT, Stage.ANNOUNCING, Word.SOON),
        (Mode.GAIT, Stage.APPROACHING, Word.TO_START),
        (Mode.GAIT, Stage.PLAYING, Word.GO_ON),
        (Mode.GAIT, Stage.ENDING, Word.ENDING),
        (Mode.HAND_GUIDING, Stage.PLAYING, Word.GUIDE),
        (Mode.SELF_TEST, Stage.PREPARING, Word.SOON),
        (Mode.SELF_TEST, Stage.PLAYING, Word.SELF_TEST),
        (Mode.STOPPING, None, Word.STOPPING),
        (Mode.FAULT, None, Word.STOPPED),
        (Mode.COMMISSION, Stage.PLAYING, Word.SERVICE),
        ("a mode of a later version", None, Word.SERVICE),
    ],
)
def test_each_mode_and_stage_has_its_word(screen, mode, stage, word):
    assert screen.after(mode, stage=stage).word == word


BANDS = {"right": Band(0.32, 0.44), "left": Band(0.2, 0.3)}


def training(phase, advice=Advice.LIE_STILL, **given):
    """What the page shows of a session in this phase."""
    told = {
        **{"buttons": (), "reason": None, "why": None, "is_kept": True, "number": 2, "count": 4},
        **{"plan_s": 1020.0, "block_left_s": 60.0, "block_s": 120.0, "announce_left_s": 0.0},
        **{"bands": BANDS, "steps": (), "valid_count": 0, "in_band_count": 0, "row_count": 0},
        **{"session_valid_count": 0, "session_in_band_count": 0, "summary": None},
    }
    return TrainingView(phase=phase, advice=advice, **(told | given))


@pytest.mark.parametrize(
    ("phase", "mode", "word"),
    [
        (Phase.WAITING, Mode.READY, Word.START),
        (Phase.WAITING, Mode.BRINGING_UP, Word.WAIT),
        (Phase.ENABLING, Mode.READY, Word.SOON),
        (Phase.ANNOUNCED, Mode.HOLD, Word.SOON),
        (Phase.STARTING, Mode.HOLD, Word.SOON),
        (Phase.PAUSED, Mode.HOLD, Word.ENDING),
        (Phase.REST, Mode.HOLD, Word.ENDING),
        (Phase.FINISHED, Mode.HOLD, Word.ENDING),
        (Phase.PAUSED, Mode.READY, Word.PAUSED),
        (Phase.REST, Mode.READY, Word.REST),
        (Phase.FINISHED, Mode.READY, Word.FINISHED),
        (Phase.WALKING, Mode.GAIT, Word.GO_ON),
    ],
)
def test_a_session_announces_motion_that_is_about_to_begin_and_each_rest_is_a_state_of_its_own(
    screen, phase, mode, word
):
    screen.training = training(phase)
    assert screen.after(mode, stage=Stage.PLAYING if mode is Mode.GAIT else None).word == word


def test_behind_a_rest_comes_the_next_part_and_a_refusal_says_what_to_do(screen):
    screen.training = training(Phase.REST, block_left_s=0.0)
    view = screen.after(Mode.READY)
    assert (view.word, said(view)[0]) == (Word.NEXT, "Part 2 of 4")
    for advice, word in (
        (Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT, Word.DAILY_TEST),
        (Advice.RELEASE_EMERGENCY_STOP, Word.RELEASE),
        (Advice.LET_GO_AND_HOLD_HAND_SWITCH, Word.LET_GO),
        (Advice.TRY_AGAIN_OR_CALL_THERAPIST, Word.FAILED),
    ):
        screen.training = training(Phase.WAITING, advice, reason=REASON)
        view = screen.after(Mode.READY)
        assert view.word == word
        assert len(view.scene.cards) >= 2
    assert "the leg is too far" in said(view)
    screen.training = training(Phase.WAITING, Advice.TRAINER_IS_USED)
    assert screen.after(Mode.HOLD).word == Word.USED


def test_a_pause_says_why_and_that_the_leg_is_not_held_only_where_the_drives_are_off(screen):
    begun = training(Phase.PAUSED, number=1, block_left_s=120.0, why=Why.LATE)
    screen.training = begun
    view = screen.after(Mode.READY)
    assert (view.word, said(view)[1]) == (Word.START, TEXTS["en"]["why_short.late"])
    screen.training = training(Phase.PAUSED)
    assert "held" not in " ".join(said(screen.after(Mode.HOLD)))
    assert said(screen.after(Mode.READY))[1] == "Your leg is not held."
    for why in Why:
        screen.training = training(Phase.PAUSED, why=why)
        told = screen.after(Mode.READY)
        assert said(told)[1] == TEXTS["en"][f"why_short.{why}"]
        assert len(said(told, "de")[1]) <= LAST_LINE_MAX


def test_the_card_of_what_is_to_be_done_now_follows_the_hand_switch(screen):
    screen.training = training(Phase.WAITING, Advice.HOLD_HAND_SWITCH)
    for is_held, first in ((False, Picture.SWITCH), (True, Picture.BUTTON)):
        view = screen.after(Mode.READY, switch=is_held)
        assert [card.picture for card in view.scene.cards if card.is_first] == [first]


def test_word_gauge_and_path_follow_from_the_newest_step(screen):
    assert screen.walk(0.38, 0.39).word == Word.GOOD
    odd = screen.walk(0.9)
    assert (odd.word, odd.steps[-1].result) == (Word.GOOD, Result.WITHIN)
    assert screen.walk(0.9).word == Word.GENTLY
    view = screen.walk(0.2, 0.2)
    assert (view.word, view.steps[-1].result, view.steps[-1].share_ratio) == (
        *(Word.MORE, Result.BELOW),
        0.2,
    )
    unknown = screen.walk(None)
    assert (unknown.word, unknown.steps[-1].height_ratio) == (Word.GO_ON, None)
    assert screen.walk(0.0, 0.0, 0.0).word == Word.MORE  # a low share is not work against
    assert screen.walk(0.0, 0.0, against=9.0).word == Word.RELAX
    assert screen.after(Mode.HOLD).steps == ()  # another gait begins anew


def test_without_a_target_the_share_is_shown_and_not_judged(tmp_path):
    screen = Shown(tmp_path, target=False)
    view = screen.walk(0.1, 0.9, 0.9)

    assert view.word == Word.GO_ON
    assert [(one.result, one.height_ratio) for one in view.steps[-2:]] == [
        (Result.UNJUDGED, 0.5),
        (Result.UNJUDGED, 0.9),
    ]
    assert view.legs[0].share_low_ratio is None


def test_with_two_legs_the_one_that_lacks_gives_the_word_and_each_has_its_target(tmp_path):
    screen = Shown(tmp_path, legs=("right", "left"), target=False)
    steps = (Walked("left", 0.1, Result.BELOW), Walked("right", 0.38, Result.WITHIN))
    screen.training = training(Phase.WALKING, steps=steps)
    view = screen.after(Mode.GAIT, stage=Stage.PLAYING)

    assert view.word == Word.MORE
    assert [leg.share_low_ratio for leg in view.legs] == [0.32, 0.2]
    assert [one.height_ratio for one in view.steps] == [
        pytest.approx(LOW_RATIO / 2, abs=1e-3),
        pytest.approx(0.5, abs=1e-3),
    ]


@pytest.mark.parametrize("band", [Band(0.32, 0.44), Band(0.0, 0.1), Band(0.9, 1.0)])
def test_the_target_is_the_middle_of_the_gauge_and_its_ends_are_nothing_and_all(band):
    assert height_of(band.low_ratio, band) == pytest.approx(LOW_RATIO)
    assert height_of(band.high_ratio, band) == pytest.approx(HIGH_RATIO)
    if band.low_ratio > 0:
        assert height_of(0.0, band) == 0.0
    if band.high_ratio < 1:
        assert height_of(1.0, band) == 1.0
    shares = [at / 100 for at in range(101)]
    heights = [height_of(share, band) for share in shares]
    assert heights == sorted(heights)
    assert all(0.0 <= height <= 1.0 for height in heights)


def test_the_power_is_a_glow_and_one_that_is_not_known_is_none(screen):
    for power_w, glow in ((0.0, 0.0), (None, 0.0), (4.0, 0.5), (-80.0, 0.0), (80.0, 1.0)):
        (leg,) = screen.after(Mode.HOLD, power_w=power_w).legs
        assert leg.glow_ratio == glow


def test_a_leg_has_a_pose_only_while_both_drives_measure_it(screen):
    (leg,) = screen.after(Mode.HOLD, pose=(0.2, 0.4)).legs
    assert (leg.hip_angle_rad, leg.slide_position_m) == (0.2, 0.4)
    for given in ({"pose": (0.2, None)}, {"fresh": False}):
        (leg,) = screen.after(Mode.HOLD, **given).legs
        assert (leg.hip_angle_rad, leg.slide_position_m) == (None, None)
    assert (
        screen.look().geometry.thigh_m == bench.tables("robot.toml")["geometry"]["thigh_length_m"]
    )


def test_a_silent_trainer_has_no_value_no_stop_and_no_button_after_200_ms(screen):
    screen.after(Mode.FAULT, cause=Cause.ENCODER_FROZEN, power_w=3.0)
    screen.trainer.clock.ns += 200_000_000
    assert screen.look().word == Word.STOPPED
    screen.trainer.clock.ns += 1

    view = screen.look()

    assert (view.word, view.mode, view.cause, view.action) == (Word.NO_SIGNAL, None, None, None)
    assert (view.legs[0].hip_angle_rad, view.legs[0].glow_ratio) == (None, 0.0)
    assert view.sample_time_ms is None
    assert screen.after(Mode.READY).word == Word.READY


def test_the_alarm_is_one_for_each_stop_and_sounds_if_the_signal_is_lost_in_motion(screen):
    assert screen.after(Mode.GAIT, stage=Stage.PLAYING).alarm is None
    assert screen.after(Mode.STOPPING).alarm is None  # disabled on request: no cause
    first = screen.after(Mode.STOPPING, cause=Cause.SPASM).alarm
    assert first is not None
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).alarm == first
    assert screen.after(Mode.READY).alarm is None
    second = screen.after(Mode.FAULT, cause=Cause.SPASM).alarm
    assert second not in {None, first}

    screen.after(Mode.READY)
    screen.trainer.clock.ns += 300_000_000
    assert screen.look().alarm is None
    screen.after(Mode.HOLD)
    screen.trainer.clock.ns += 300_000_000
    assert screen.look().alarm not in {None, first, second}


def test_the_page_says_that_a_leg_is_held_only_while_every_drive_can_hold_it(screen):
    def told(**given):
        return " ".join(said(screen.after(Mode.FAULT, cause=Cause.SPASM, **given)))

    for power in ("operation_enabled", "quick_stop_active"):
        assert "Your leg is held." in told(power=power)
    for power in ("switch_on_disabled", "fault", "fault_reaction_active"):
        assert "Leg may move." in told(power=power)


def test_the_straps_are_told_behind_the_emergency_stop_unless_no_drive_has_power(screen):
    def unstrap(mode=Mode.FAULT, **given):
        view = screen.after(mode, cause=Cause.ENCODER_FROZEN, **given)
        told = said(view)
        assert ("UNSTRAP" in told) == (view.unstrap is Unstrap.NO_POWER)
        behind = TEXTS["en"]["straps_behind"]
        assert (behind in told) == (view.unstrap is Unstrap.BEHIND_EMERGENCY_STOP)
        if mode is Mode.FAULT:
            assert told.index("HELP") < len(told) - 1  # the help comes first
        return view.unstrap

    for power in ("operation_enabled", "quick_stop_active", "fault_reaction_active", "switched_on"):
        assert unstrap(power=power) is Unstrap.BEHIND_EMERGENCY_STOP
    for power in ("switch_on_disabled", "fault"):
        assert unstrap(power=power) is Unstrap.NO_POWER
    assert unstrap(Mode.STOPPING) is Unstrap.NOT_NOW
    # A drive that is not fresh, or says nothing, may have power.
    assert unstrap(power="fault", fresh=False) is Unstrap.BEHIND_EMERGENCY_STOP
    assert screen.after(Mode.READY).unstrap is Unstrap.NOT_NOW
    held = screen.after(Mode.FAULT, cause=Cause.SPASM)
    assert (held.step, held.unstrap) == (Step.RESET, Unstrap.NOT_NOW)
    screen.after(Mode.READY)
    preparing = screen.after(Mode.HOLD, stage=Stage.PREPARING)
    assert preparing.step is Step.WAIT  # the load of the drives is being compared
    held = screen.after(Mode.HOLD)
    assert (held.step, held.unstrap) == (Step.GUIDE, Unstrap.BEHIND_EMERGENCY_STOP)


def test_a_stop_at_rest_is_shown_with_help_and_alarm_unless_the_machine_was_never_up(screen):
    first = screen.after(Mode.OFF, cause=Cause.BRING_UP_FAILED)
    assert (first.word, first.step, first.alarm) == (Word.STOPPED, Step.HELP, None)
    assert first.cause == Cause.BRING_UP_FAILED
    screen.after(Mode.READY)

    for mode in (Mode.OFF, Mode.BRINGING_UP):
        view = screen.after(mode, cause=Cause.DRIVE_SILENT)
        assert (view.word, view.step, view.action) == (Word.STOPPED, Step.HELP, None)
        assert view.cause == Cause.DRIVE_SILENT
        assert view.alarm is not None


def test_a_page_without_requests_shows_a_stop_until_it_is_reset(tmp_path):
    screen = Shown(tmp_path, way_out=False)
    for mode in (Mode.FAULT, Mode.READY):
        view = screen.after(mode, cause=Cause.SPASM)
        assert (view.word, view.step, view.action) == (Word.STOPPED, Step.HELP, None)
    assert screen.after(Mode.READY).word == Word.READY


def test_the_emergency_stop_pressed_as_a_session_advises_is_named_and_sounds_no_alarm(screen):
    screen.training = training(Phase.PAUSED, Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT)
    screen.after(Mode.READY)
    screen.training = training(Phase.STOPPED, Advice.PRESS_START_TO_RESET)
    assert screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault").alarm is None
    pressed = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", sto=True, count=30)
    released = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault")

    for view in (pressed, released):
        assert (view.step, view.action, view.alarm) == (Step.START, None, None)
        assert said(view)[1] == "The emergency stop was pressed."
        assert "HELP" in " ".join(said(view))
    screen.after(Mode.READY)
    assert screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault").alarm is None
    fault = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", count=30)
    assert fault.alarm is not None
    screen.after(Mode.GAIT, stage=Stage.PLAYING)
    assert screen.after(Mode.STOPPING, cause=Cause.STO_ACTIVE, sto=True).alarm is not None


def test_a_cause_of_a_later_version_is_told_as_the_gravest(screen):
    view = screen.after(Mode.FAULT, cause="of_a_later_version")
    assert said(view, "de")[0] == "Gerätestörung"
    assert [card.picture for card in view.scene.cards if card.is_first] == [
        *(Picture.EMERGENCY_STOP, Picture.TELEPHONE),
    ]
    assert (view.action, view.alarm is None) == (None, False)


def test_headings_of_stops_and_last_lines_fit_on_the_page():
    for texts in (TEXTS["en"], TEXTS["de"]):
        headings = [text for key, text in texts.items() if key.startswith("stop.")]
        assert len(headings) == len(Cause)  # one for each but none, and for one of a later version
        assert max(map(len, headings)) <= HEADING_MAX
        assert max(len(texts[f"last.{one}"]) for one in Situation) <= LAST_LINE_MAX


def test_whatever_is_said_has_a_text_in_both_languages_that_is_wholly_filled_in(tmp_path):
    screens = [Shown(tmp_path), Shown(tmp_path, way_out=False)]
    views = []
    summary = Summary(
        **{"walked_s": 60.0, "valid_count": 3, "in_band_count": 2, "best_row_count": 2},
        **{"share_ratio": 0.3, "past_share_ratios": (), "best_share_ratio": None},
    )
    for screen in screens:
        causes = ["of a later version", *Cause]
        views += [screen.after(Mode.FAULT, cause=cause) for cause in causes]
        views += [screen.after(Mode.FAULT, cause=cause, power="fault") for cause in causes]
        views += [screen.after(mode) for mode in Mode]
    given = {"buttons": tuple(Button), "summary": summary, "reason": REASON}
    for phase, advice in itertools.product(Phase, Advice):
        screen.training = training(phase, advice, **given)
        for mode in (Mode.READY, Mode.HOLD, Mode.FAULT):
            views.append(
                screen.after(mode, cause=Cause.SPASM if mode is Mode.FAULT else Cause.NONE)
            )
    for view in views:
        for language in ("en", "de"):
            assert not [text for text in said(view, language) if not text or "{" in text]


def test_each_state_has_its_heading_and_what_is_not_known_is_told_most_cautiously():
    for language, texts in TEXTS.items():
        if language != "cautious":
            assert {f"word.{word}" for word in Word} <= set(texts)
    unbroken = {language: text.replace("Not-Halt", UNBROKEN) for language, text in CAUTIOUS.items()}
    assert TEXTS["cautious"] == unbroken


# --- the way out alone ------------------------------------------------------------------------


def test_the_way_out_is_led_step_by_step_and_only_with_the_hand_switch(screen):
    stopped = {"cause": Cause.SPASM}
    assert screen.after(Mode.FAULT, **stopped, switch=False).step == Step.SWITCH
    assert screen.after(Mode.FAULT, **stopped).action == "reset"
    screen.state.way_out.reset_is_asked()
    assert screen.after(Mode.FAULT, **stopped).step == Step.WAIT  # not yet published
    assert screen.after(Mode.OFF).step == Step.WAIT
    assert screen.after(Mode.BRINGING_UP).step == Step.WAIT
    screen.state.way_out.reset_is_answered()
    assert screen.after(Mode.READY, switch=False).step == Step.SWITCH
    assert screen.after(Mode.READY).action == "enable"
    assert screen.after(Mode.HOLD).action == "hand_guiding"
    assert screen.after(Mode.HAND_GUIDING).action == "hold"
    assert screen.after(Mode.HOLD).step == Step.GUIDE
    assert screen.after(Mode.GAIT, stage=Stage.ANNOUNCING).step == Step.NONE
    assert screen.after(Mode.HOLD).step == Step.NONE


def test_the_way_out_goes_on_without_an_answer_to_reset_and_offers_it_again_if_it_was_lost(screen):
    screen.after(Mode.FAULT, cause=Cause.SPASM)
    screen.state.way_out.reset_is_asked()
    screen.state.way_out.reset_is_answered()
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).action == "reset"
    screen.state.way_out.reset_is_asked()
    assert screen.after(Mode.OFF).step == Step.WAIT
    screen.state.way_out.reset_is_answered()
    assert screen.after(Mode.OFF, cause=Cause.BRING_UP_FAILED).step == Step.HELP
    assert screen.after(Mode.READY).action == "enable"


@pytest.mark.parametrize(
    ("cause", "boot", "seen", "action"),
    [
        (Cause.SPASM, "boot", (), "enable"),
        (Cause.SPASM, "boot", (Mode.GAIT,), None),
        (Cause.SPASM, "of the core before", (), None),
        (Cause.ENCODER_FROZEN, "boot", (), None),
    ],
)
def test_a_server_that_starts_behind_reset_takes_the_step_from_the_events(
    screen, cause, boot, seen, action
):
    for event in ("stop", cause), ("note", None):
        screen.state.take_event(stop_event(*event, boot))
    assert screen.after(Mode.READY).action is None
    for mode in seen:
        screen.after(mode)
    screen.state.take_event(stop_event("stop", None, boot))
    assert screen.after(Mode.READY).action == action
    assert screen.after(Mode.HAND_GUIDING, pose=(1.5, 0.4)).action == (action and "hold")


def stop_event(kind, cause, boot):
    given = {"id": "1", "priority": "low"}
    return bench.filled(Event, kind=kind, cause=cause, core_boot_id=boot, **given)


def test_a_session_that_goes_on_ends_the_way_out(screen):
    screen.after(Mode.FAULT, cause=Cause.SPASM)
    screen.training = training(Phase.PAUSED, Advice.PRESS_START)
    assert screen.after(Mode.READY).action == "enable"
    screen.training = training(Phase.ENABLING)
    assert screen.after(Mode.READY).step == Step.NONE
    assert screen.after(Mode.HOLD).step == Step.NONE
    screen.training = training(Phase.PAUSED)
    assert screen.after(Mode.HOLD).step == Step.NONE


def test_without_a_stop_of_its_own_the_page_offers_no_request(screen):
    for mode in Mode:
        if mode is not Mode.FAULT:
            assert screen.after(mode).action is None


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause is not Cause.NONE])
def test_reset_is_offered_after_the_causes_of_person_and_motion_alone(screen, cause):
    view = screen.after(Mode.FAULT, cause=cause)

    assert view.step == (Step.RESET if cause in ALONE else Step.HELP)
    assert cause not in ALONE or STOPS[cause].situation is Situation.HELD


@pytest.mark.parametrize(
    "drift", [{"hip_moved_deg": 1.1}, {"slide_moved_m": 0.011}, {"reaches_limit": True}]
)
def test_where_the_drift_is_not_harmless_reset_is_not_offered_unless_brakes_hold(tmp_path, drift):
    screen = Shown(tmp_path, **drift)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP

    screen.trainer.brakes = True
    screen.state.use(screen.trainer.configuration())
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.RESET


def test_reset_is_not_offered_for_another_configuration_another_pose_or_without_rules(tmp_path):
    screen = Shown(tmp_path)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM, pose=(0.7, 0.4)).step == Step.HELP
    assert screen.after(Mode.FAULT, cause=Cause.SPASM, pose=(0.2, None)).step == Step.HELP
    screen.state.use(None)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP
    other = bench.msgspec.structs.replace(
        screen.trainer.configuration(), config_hashes={**bench.HASHES, "robot.toml": "0c"}
    )
    screen.state.use(other)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP

    without = Shown(tmp_path, way_out=False)
    assert without.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP


# --- settings ---------------------------------------------------------------------------------


def change(table, path, value):
    *parents, last = path.split(".")
    for parent in parents:
        table = table[int(parent) if parent.isdigit() else parent]
    table[last] = value


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("web.host", "0.0.0.0", "web.certificate"),
        ("web.certificate", "cert.pem", "web.certificate and web.key together"),
        ("web.unknown", 1, "unknown"),
        ("leg.0.glow_full_w", 0.0, "glow_full_w"),
        ("leg", [{"name": "right", "glow_full_w": 8.0}] * 2, "each leg once"),
        ("target.share_low_ratio", 0.5, "> target.share_low_ratio"),
        ("target", {"share_low_ratio": 0.1}, "share_high_ratio"),
        ("session", {"profile": "a", "history": "b"}, "a session has its own target"),
        ("screen", {"distance_m": 2.0}, "distance_m up to 1.53, or diagonal_in from 13.1"),
        ("screen", {"diagonal_in": 4.0}, "diagonal_in"),
        ("page.switch_hand", "both", "both"),
        ("page.unstrap", {"en": "x" * 65, "de": "x"}, "64"),
        ("page.language", "fr", "fr"),
        ("page.help", {"en": "only one language"}, "de"),
        ("way_out.check", "nowhere.json", "gaitd check --json"),
    ],
)
def test_a_wrong_file_is_refused_with_its_key(tmp_path, path, value, named):
    table = bench.patient_table(tmp_path)
    change(table, path, value)

    with pytest.raises(ConfigError, match=named):
        PatientState(bench.settings_of(tmp_path, table, PatientSettings), "run")


def test_a_screen_is_allowed_where_its_smallest_text_can_have_16_minutes_of_arc(tmp_path):
    assert Screen(diagonal_in=10.0, distance_m=1.53).arc_min(1.1) >= FAR_ARC_MIN
    assert Screen(diagonal_in=10.0, distance_m=1.54).arc_min(1.1) < FAR_ARC_MIN
    table = bench.patient_table(tmp_path)
    table["screen"] = {"diagonal_in": 24.0, "distance_m": 3.0}
    settings = bench.settings_of(tmp_path, table, PatientSettings)
    assert settings.screen.arc_min(1.0) > FAR_ARC_MIN


def test_beyond_loopback_origins_are_mandatory_and_the_page_only_shows_and_stops(tmp_path):
    table = bench.patient_table(tmp_path)
    table["web"] |= {"host": "192.0.2.1", "certificate": "c.pem", "key": "k.pem"}
    with pytest.raises(ConfigError, match="origins"):
        bench.settings_of(tmp_path, table, PatientSettings)
    table["web"]["origins"] = ["https://trainer.lan:8443"]
    settings = bench.settings_of(tmp_path, table, PatientSettings)
    screen = Shown(tmp_path)
    screen.state = PatientState(settings, "run")
    screen.state.use(screen.trainer.configuration())

    assert settings.web.allowed_origins == {"https://trainer.lan:8443"}
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP
