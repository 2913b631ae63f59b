"""What the patient's page shows, for each state of the machine; without server and browser."""

import display_bench as bench
import pytest
from gaitd_client import Cause, Event, Mode, Stage
from gaitd_display.cause_texts import CAUSE_TEXTS, Situation, patient_text
from gaitd_display.patient_view import PatientState
from gaitd_display.settings import PatientSettings, SettingsError
from gaitd_display.texts import EXPLAINED, WORDS, Word, page_texts
from gaitd_display.training import TrainingView
from gaitd_display.way_out import ALONE, Step, Unstrap
from gaitd_session import Advice, Phase

from daemon.wire.cause_texts import CAUSE_TEXT, DANGER, HELD, LOOSE

STRIDE = 50
"""Cycles of a stride."""


class Screen:
    """The state of a page, fed with messages of a trainer."""

    def __init__(self, folder, legs=("right",), **table):
        self.trainer = bench.MessageTrainer(legs)
        made = bench.patient_table(folder, legs=legs, **table)
        self.state = PatientState(bench.settings_of(folder, made, PatientSettings), "run")
        self.state.configuration = self.trainer.configuration()
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

    def walk(self, top_w, strides=1, known_of=1):
        """Strides whose power reaches `top_w`; every `known_of`th message has a value."""
        for cycle in range(strides * STRIDE):
            phase = (cycle % STRIDE) / STRIDE
            power_w = top_w if 0.2 < phase < 0.4 else 0.0
            view = self.after(
                Mode.GAIT,
                stage=Stage.PLAYING,
                phase=phase,
                power_w=power_w if cycle % known_of == 0 else None,
            )
        return view


@pytest.fixture
def screen(tmp_path):
    return Screen(tmp_path)


@pytest.mark.parametrize(
    ("mode", "stage", "word"),
    [
        (Mode.OFF, None, Word.WAIT),
        (Mode.BRINGING_UP, Stage.PREPARING, Word.WAIT),
        (Mode.READY, None, Word.READY),
        (Mode.HOLD, None, Word.REST),
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


def training(phase, advice=Advice.LIE_STILL):
    """What the page shows of a session in this phase."""
    given = {"reason": "", "is_kept": True, "left_s": 60.0, "bands": (), "summary": None}
    return TrainingView(phase=phase, advice=advice, buttons=(), why=None, **given)


@pytest.mark.parametrize(
    ("phase", "mode", "word"),
    [
        (Phase.ENABLING, Mode.READY, Word.SOON),
        (Phase.ANNOUNCED, Mode.HOLD, Word.SOON),
        (Phase.STARTING, Mode.HOLD, Word.SOON),
        (Phase.PAUSED, Mode.HOLD, Word.REST),
        (Phase.PAUSED, Mode.READY, Word.READY),
        (Phase.REST, Mode.READY, Word.REST),
        (Phase.WALKING, Mode.GAIT, Word.GO_ON),
    ],
)
def test_a_session_announces_motion_that_is_about_to_begin_and_says_when_to_rest(
    screen, phase, mode, word
):
    screen.training = training(phase)
    assert screen.after(mode, stage=Stage.PLAYING if mode is Mode.GAIT else None).word == word


def test_the_word_follows_the_highest_power_of_the_last_whole_stride(screen):
    assert screen.walk(3.0).word == Word.GO_ON  # the first may have begun before the page
    assert screen.walk(3.0, strides=2).word == Word.GOOD
    assert screen.walk(1.0, strides=2).word == Word.STRONGER
    assert screen.walk(6.0, strides=2).word == Word.GENTLY
    assert screen.walk(6.0, strides=2, known_of=3).word == Word.GO_ON


def test_with_two_legs_the_weaker_one_gives_the_word(tmp_path):
    screen = Screen(tmp_path, legs=("right", "left"))
    screen.walk(3.0, strides=3)
    left = screen.state._legs["left"]
    left.result = type(left.result).BELOW

    assert screen.look().word == Word.STRONGER


def test_a_value_that_is_not_valid_is_none_and_never_zero(screen):
    assert screen.after(Mode.HOLD, power_w=0.0).bars[0].value_ratio == 0.0
    assert screen.after(Mode.HOLD, power_w=None).bars[0].value_ratio is None
    assert screen.after(Mode.HOLD, power_w=4.0).bars[0].value_ratio == 0.5
    assert screen.after(Mode.HOLD, power_w=-80.0).bars[0].value_ratio == -0.25
    assert screen.after(Mode.HOLD, power_w=80.0).bars[0].value_ratio == 1.0


def test_a_silent_trainer_has_no_value_no_stop_and_no_button_after_200_ms(screen):
    screen.after(Mode.FAULT, cause=Cause.SPASM, power_w=3.0)
    screen.trainer.clock.ns += 200_000_000
    assert screen.look().word == Word.STOPPED
    screen.trainer.clock.ns += 1

    view = screen.look()

    assert (view.word, view.mode, view.stop, view.action) == (Word.NO_SIGNAL, None, None, None)
    assert view.bars[0].value_ratio is None
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
    def instructions(**given):
        view = screen.after(Mode.FAULT, cause=Cause.SPASM, **given)
        return " ".join(text.en for text in view.stop.instructions)

    for power in ("operation_enabled", "quick_stop_active"):
        assert "Your leg is held." in instructions(power=power)
    for power in ("switch_on_disabled", "fault", "fault_reaction_active"):
        assert "Your leg may not be held" in instructions(power=power)


def test_the_straps_are_told_behind_the_emergency_stop_unless_no_drive_has_power(screen):
    def unstrap(mode=Mode.FAULT, **given):
        return screen.after(mode, cause=Cause.ENCODER_FROZEN, **given).unstrap

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
    held = screen.after(Mode.HOLD)
    assert (held.step, held.unstrap) == (Step.GUIDE, Unstrap.BEHIND_EMERGENCY_STOP)


def test_a_stop_at_rest_is_shown_with_help_and_alarm_unless_the_machine_was_never_up(screen):
    first = screen.after(Mode.OFF, cause=Cause.BRING_UP_FAILED)
    assert (first.word, first.step, first.alarm) == (Word.STOPPED, Step.HELP, None)
    assert first.stop.cause == Cause.BRING_UP_FAILED
    screen.after(Mode.READY)

    for mode in (Mode.OFF, Mode.BRINGING_UP):
        view = screen.after(mode, cause=Cause.DRIVE_SILENT)
        assert (view.word, view.step, view.action) == (Word.STOPPED, Step.HELP, None)
        assert view.stop.cause == Cause.DRIVE_SILENT
        assert view.alarm is not None


def test_the_emergency_stop_pressed_as_a_session_advises_is_named_and_sounds_no_alarm(screen):
    screen.training = training(Phase.PAUSED, Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT)
    screen.after(Mode.READY)
    screen.training = training(Phase.STOPPED, Advice.PRESS_START_TO_RESET)
    assert screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault").alarm is None
    pressed = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", sto=True, count=30)
    released = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault")

    for view in (pressed, released):
        assert (view.step, view.action, view.alarm) == (Step.START, None, None)
        assert view.stop.happened.en == "The emergency stop was pressed."
    screen.after(Mode.READY)
    assert screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault").alarm is None
    fault = screen.after(Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", count=30)
    assert fault.alarm is not None
    screen.after(Mode.GAIT, stage=Stage.PLAYING)
    assert screen.after(Mode.STOPPING, cause=Cause.STO_ACTIVE, sto=True).alarm is not None


def test_every_cause_has_its_text_in_both_languages_for_the_situation_that_the_service_names():
    situation = {HELD: Situation.HELD, LOOSE: Situation.LOOSE, DANGER: Situation.DANGER}
    for cause, told in CAUSE_TEXT.items():
        if cause.name == "NONE":
            continue
        text = CAUSE_TEXTS[Cause[cause.name]]
        assert text.situation == situation.get(told.first, Situation.AT_REST), cause
        for spoken in (text.happened, *(() if text.advice is None else (text.advice,))):
            assert spoken.en
            assert spoken.de
            assert spoken.en != spoken.de
    assert len(CAUSE_TEXTS) == len(CAUSE_TEXT) - 1
    assert patient_text("of a later version").situation is Situation.DANGER


def test_all_words_and_labels_are_there_in_both_languages():
    texts = page_texts()

    assert set(WORDS) == set(Word)
    assert set(EXPLAINED) == set(Word) - {Word.STOPPED}
    assert set(texts["en"]) == set(texts["de"])
    assert all(text.strip() for language in texts.values() for text in language.values())


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
    given = {"id": "1", "text": "text", "priority": "low"}
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
    assert cause not in ALONE or CAUSE_TEXTS[cause].situation is Situation.HELD


@pytest.mark.parametrize(
    "drift", [{"hip_moved_deg": 1.1}, {"slide_moved_m": 0.011}, {"reaches_limit": True}]
)
def test_where_the_drift_is_not_harmless_reset_is_not_offered_unless_brakes_hold(tmp_path, drift):
    screen = Screen(tmp_path, **drift)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP

    screen.trainer.brakes = True
    screen.state.configuration = screen.trainer.configuration()
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.RESET


def test_reset_is_not_offered_for_another_configuration_another_pose_or_without_rules(tmp_path):
    screen = Screen(tmp_path)
    assert screen.after(Mode.FAULT, cause=Cause.SPASM, pose=(0.7, 0.4)).step == Step.HELP
    assert screen.after(Mode.FAULT, cause=Cause.SPASM, pose=(0.2, None)).step == Step.HELP
    screen.state.configuration = None
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP
    other = bench.msgspec.structs.replace(
        screen.trainer.configuration(), config_hashes={**bench.HASHES, "robot.toml": "0c"}
    )
    screen.state.configuration = other
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP

    without = Screen(tmp_path, way_out=False)
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
        ("web.certificate", "cert.pem", "belong together"),
        ("web.unknown", 1, "unknown"),
        ("bar.0.target_low_w", 6.0, "low < high <= full"),
        ("page.language", "fr", "fr"),
        ("page.help", {"en": "only one language"}, "de"),
        ("way_out.check", "nowhere.json", "gaitd check --json"),
    ],
)
def test_a_wrong_file_is_refused_with_its_key(tmp_path, path, value, named):
    table = bench.patient_table(tmp_path)
    change(table, path, value)

    with pytest.raises(SettingsError, match=named):
        PatientState(bench.settings_of(tmp_path, table, PatientSettings), "run")


def test_beyond_loopback_origins_are_mandatory_and_the_page_only_shows_and_stops(tmp_path):
    table = bench.patient_table(tmp_path)
    table["web"] |= {"host": "192.0.2.1", "certificate": "c.pem", "key": "k.pem"}
    with pytest.raises(SettingsError, match="origins"):
        bench.settings_of(tmp_path, table, PatientSettings)
    table["web"]["origins"] = ["https://trainer.lan:8443"]
    settings = bench.settings_of(tmp_path, table, PatientSettings)
    screen = Screen(tmp_path)
    screen.state = PatientState(settings, "run")
    screen.state.configuration = screen.trainer.configuration()

    assert settings.web.allowed_origins == {"https://trainer.lan:8443"}
    assert screen.after(Mode.FAULT, cause=Cause.SPASM).step == Step.HELP
