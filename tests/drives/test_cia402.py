import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from drives.cia402.power_state import (
    CANNOT_EXERT_TORQUE,
    POWER_STAGE_OFF,
    STATUS_FOLLOWS,
    STATUS_WARNING,
    TRANSITIONS,
    ResetEdge,
    Sent,
    decode_statusword,
    homing_state,
    next_word,
)
from drives.signals import HomingState, PowerRequest, PowerState

S = PowerState
STATUSWORDS = {
    S.NOT_READY_TO_SWITCH_ON: 0x0000,
    S.SWITCH_ON_DISABLED: 0x0040,
    S.READY_TO_SWITCH_ON: 0x0021,
    S.SWITCHED_ON: 0x0023,
    S.OPERATION_ENABLED: 0x0027,
    S.QUICK_STOP_ACTIVE: 0x0007,
    S.FAULT_REACTION_ACTIVE: 0x000F,
    S.FAULT: 0x0008,
}
ENABLE_BIT = 0x0008
RESET_BIT = 0x0080
HALT_BIT = 0x0100
VOLTAGE_BIT = 0x0002
QUICK_STOP_BIT = 0x0004
STATES = list(PowerState)
REQUESTS = list(PowerRequest)
ENABLING = (PowerRequest.ENABLE, PowerRequest.HOME)
EVERY_SENT = [
    Sent(word, edge, was_enabled)
    for word in (0, 0x0F, 0x80)
    for edge in ResetEdge
    for was_enabled in (False, True)
]


class ModelDrive:
    """The drive's side of CiA 402, from the standard's table of commands; shares nothing with ours.

    `fourth` : does transition 4 by itself after 3 when the word allows it (most drives; not Elmo).
    `option_605a`: 2 ends in switch on disabled, 6 stays in quick stop active.
    """

    def __init__(self, *, fourth=True, option_605a=6):
        self.state = S.SWITCH_ON_DISABLED
        self.word = 0
        self.fourth = fourth
        self.option_605a = option_605a
        self.cause_gone = True
        self.reset_edges = 0

    def receive(self, word):
        rising = word & 0x80 and not self.word & 0x80
        self.word = word
        self.reset_edges += bool(rising)
        if self.state is S.FAULT:
            if rising and self.cause_gone:
                self.state = S.SWITCH_ON_DISABLED
            return
        if word & 0x80:
            return
        command = self._command(word)
        self.state = {
            ("shutdown", S.SWITCH_ON_DISABLED): S.READY_TO_SWITCH_ON,
            ("shutdown", S.SWITCHED_ON): S.READY_TO_SWITCH_ON,
            ("shutdown", S.OPERATION_ENABLED): S.READY_TO_SWITCH_ON,
            ("switch on", S.READY_TO_SWITCH_ON): S.SWITCHED_ON,
            ("switch on", S.OPERATION_ENABLED): S.SWITCHED_ON,
            ("enable", S.READY_TO_SWITCH_ON): S.OPERATION_ENABLED if self.fourth else S.SWITCHED_ON,
            ("enable", S.SWITCHED_ON): S.OPERATION_ENABLED,
            ("enable", S.QUICK_STOP_ACTIVE): (
                S.OPERATION_ENABLED if self.option_605a >= 5 else S.QUICK_STOP_ACTIVE
            ),
            ("disable voltage", S.READY_TO_SWITCH_ON): S.SWITCH_ON_DISABLED,
            ("disable voltage", S.SWITCHED_ON): S.SWITCH_ON_DISABLED,
            ("disable voltage", S.OPERATION_ENABLED): S.SWITCH_ON_DISABLED,
            ("disable voltage", S.QUICK_STOP_ACTIVE): S.SWITCH_ON_DISABLED,
            ("quick stop", S.READY_TO_SWITCH_ON): S.SWITCH_ON_DISABLED,
            ("quick stop", S.SWITCHED_ON): S.SWITCH_ON_DISABLED,
            ("quick stop", S.OPERATION_ENABLED): S.QUICK_STOP_ACTIVE,
        }.get((command, self.state), self.state)

    @staticmethod
    def _command(word):
        if not word & 0x02:
            return "disable voltage"
        if not word & 0x04:
            return "quick stop"
        if not word & 0x01:
            return "shutdown"
        return "enable" if word & 0x08 else "switch on"

    def stopped(self):
        """The quick-stop ramp has ended."""
        if self.state is S.QUICK_STOP_ACTIVE and self.option_605a < 5:
            self.state = S.SWITCH_ON_DISABLED

    def statusword(self):
        return STATUSWORDS[self.state]


def drive_through(drive, request, cycles=10, *, resume=True, sent=None):
    """Hold a request as a level for some cycles; every word that went out."""
    sent, words = sent or Sent(), []
    for _ in range(cycles):
        sent = next_word(decode_statusword(drive.statusword()), request, sent, resume=resume)
        words.append(sent.controlword)
        drive.receive(sent.controlword)
    return words


# --- statuswords ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("state", "word"), STATUSWORDS.items())
def test_a_state_is_read_whatever_the_bits_that_do_not_belong_to_it(state, word):
    free = 0xFF90 if state in {
        S.READY_TO_SWITCH_ON,
        S.SWITCHED_ON,
        S.OPERATION_ENABLED,
        S.QUICK_STOP_ACTIVE,
    } else 0xFFB0  # fmt: skip

    for others in (0, free, 0x5590 & free, 0xAAA0 & free):
        assert decode_statusword(word | others) is state


def test_a_pattern_that_the_standard_does_not_have_is_unknown_and_no_state():
    known = {0x00, 0x40, 0x0F, 0x08}
    exact = {0x21, 0x23, 0x27, 0x07}

    for word in range(0x80):
        unknown = word & 0x4F not in known and word & 0x6F not in exact
        assert (decode_statusword(word) is S.UNKNOWN) == unknown


def test_warning_is_bit_7_and_follows_is_bit_12_of_the_statusword():
    assert (STATUS_WARNING, STATUS_FOLLOWS) == (1 << 7, 1 << 12)


# --- the table ------------------------------------------------------------------------------------


def test_enable_operation_is_asked_for_only_by_enable_and_only_from_switched_on_on():
    for state, request, sent, resume in itertools.product(
        STATES, REQUESTS, EVERY_SENT, (False, True)
    ):
        word = next_word(state, request, sent, resume=resume).controlword

        if word & ENABLE_BIT and request is PowerRequest.HALT:
            assert state is S.OPERATION_ENABLED
        elif word & ENABLE_BIT:
            assert request in ENABLING
            assert state in {S.SWITCHED_ON, S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE}
            assert resume or state is not S.QUICK_STOP_ACTIVE


def test_no_request_but_fault_reset_raises_the_reset_bit_and_none_uses_any_other_bit():
    for state, request, sent, resume in itertools.product(
        STATES, REQUESTS, EVERY_SENT, (False, True)
    ):
        word = next_word(state, request, sent, resume=resume).controlword

        assert word & ~(0x019F if request is PowerRequest.HOME else 0x018F) == 0
        assert (word & HALT_BIT != 0) == (
            request is PowerRequest.HALT and state is S.OPERATION_ENABLED
        )
        if word & RESET_BIT:
            assert request is PowerRequest.FAULT_RESET
            assert state is S.FAULT
            assert word == RESET_BIT


WORDS = {
    # unknown, not ready, disabled, ready, on, enabled, quick stop, reaction, fault
    PowerRequest.DISABLE_VOLTAGE: (0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00),
    PowerRequest.QUICK_STOP: (0x02, 0x02, 0x02, 0x02, 0x02, 0x02, 0x02, 0x02, 0x02),
    PowerRequest.READY: (0x02, 0x00, 0x06, 0x06, 0x06, 0x06, 0x00, 0x00, 0x00),
    PowerRequest.ENABLE: (0x02, 0x00, 0x06, 0x07, 0x0F, 0x0F, 0x00, 0x00, 0x00),
    PowerRequest.HOME: (0x02, 0x00, 0x06, 0x07, 0x0F, 0x1F, 0x00, 0x00, 0x00),
    PowerRequest.HALT: (0x02, 0x00, 0x00, 0x06, 0x07, 0x10F, 0x02, 0x00, 0x00),
    PowerRequest.FAULT_RESET: (0x02, 0x00, 0x00, 0x00, 0x00, 0x02, 0x02, 0x00, 0x00),
}
COMMANDS = {
    # The standard's table of commands: name, bits that count, their values (CiA 402-2).
    "shutdown": (0x87, 0x06),
    "switch on": (0x8F, 0x07),
    "enable operation": (0x8F, 0x0F),
    "disable voltage": (0x82, 0x00),
    "quick stop": (0x86, 0x02),
    "fault reset": (0x80, 0x80),
}
STEPS = {
    # What the next transition towards each request is, by the standard's figure; a dash: none.
    PowerRequest.DISABLE_VOLTAGE: dict.fromkeys(STATES, "disable voltage"),
    PowerRequest.QUICK_STOP: dict.fromkeys(STATES, "quick stop"),
    PowerRequest.READY: {
        S.SWITCH_ON_DISABLED: "shutdown",
        S.SWITCHED_ON: "shutdown",
        S.OPERATION_ENABLED: "shutdown",
        S.QUICK_STOP_ACTIVE: "disable voltage",
    },
    PowerRequest.ENABLE: {
        S.SWITCH_ON_DISABLED: "shutdown",
        S.READY_TO_SWITCH_ON: "switch on",
        S.SWITCHED_ON: "enable operation",
        S.OPERATION_ENABLED: "enable operation",
        S.QUICK_STOP_ACTIVE: "disable voltage",
    },
    PowerRequest.HOME: {
        S.SWITCH_ON_DISABLED: "shutdown",
        S.READY_TO_SWITCH_ON: "switch on",
        S.SWITCHED_ON: "enable operation",
        S.OPERATION_ENABLED: "enable operation",
        S.QUICK_STOP_ACTIVE: "disable voltage",
    },
    PowerRequest.HALT: {S.OPERATION_ENABLED: "enable operation"},
    PowerRequest.FAULT_RESET: {S.FAULT: "disable voltage", S.OPERATION_ENABLED: "quick stop"},
}


def state_of(low_bits):
    """By the standard's two masks, written again."""
    for state, word in STATUSWORDS.items():
        mask = 0x6F if word & 0x21 == 0x21 or word == 0x07 else 0x4F
        if low_bits & mask == word:
            return state
    return S.UNKNOWN


@pytest.mark.parametrize("request_", REQUESTS)
def test_every_state_request_and_statusword_gives_the_word_of_the_standard(request_):
    for low_bits, high_bits in itertools.product(range(0x100), (0x00, 0x16, 0x37, 0xFF)):
        statusword = high_bits << 8 | low_bits
        state = state_of(low_bits)
        assert decode_statusword(statusword) is state

        for resume in (False, True):
            sent = next_word(state, request_, Sent(), resume=resume)
            step = STEPS[request_].get(state)
            if resume and request_ in ENABLING and state is S.QUICK_STOP_ACTIVE:
                step = "enable operation"
            if state is S.UNKNOWN and request_ is not PowerRequest.DISABLE_VOLTAGE:
                step = "quick stop"
            if step is not None:
                mask, value = COMMANDS[step]
                assert sent.controlword & mask == value, (state, request_)


ARROWS = {
    # The standard's figure, written again: number, from, to, and the command that does it.
    1: (S.NOT_READY_TO_SWITCH_ON, S.SWITCH_ON_DISABLED, None),
    2: (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, "shutdown"),
    3: (S.READY_TO_SWITCH_ON, S.SWITCHED_ON, "switch on"),
    4: (S.SWITCHED_ON, S.OPERATION_ENABLED, "enable operation"),
    5: (S.OPERATION_ENABLED, S.SWITCHED_ON, "switch on"),
    6: (S.SWITCHED_ON, S.READY_TO_SWITCH_ON, "shutdown"),
    7: (S.READY_TO_SWITCH_ON, S.SWITCH_ON_DISABLED, "quick stop"),
    8: (S.OPERATION_ENABLED, S.READY_TO_SWITCH_ON, "shutdown"),
    9: (S.OPERATION_ENABLED, S.SWITCH_ON_DISABLED, "disable voltage"),
    10: (S.SWITCHED_ON, S.SWITCH_ON_DISABLED, "quick stop"),
    11: (S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE, "quick stop"),
    12: (S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED, "disable voltage"),
    13: (S.OPERATION_ENABLED, S.FAULT_REACTION_ACTIVE, None),
    14: (S.FAULT_REACTION_ACTIVE, S.FAULT, None),
    15: (S.FAULT, S.SWITCH_ON_DISABLED, "fault reset"),
    16: (S.QUICK_STOP_ACTIVE, S.OPERATION_ENABLED, "enable operation"),
}


def test_the_transitions_are_those_of_the_standards_figure_in_their_order():
    assert [t.number for t in TRANSITIONS] == list(ARROWS)
    for transition in TRANSITIONS:
        source, target, command = ARROWS[transition.number]
        assert (transition.source, transition.target) == (source, target)
        assert transition.meaning
        if command is None:
            assert transition.controlword is None
        else:
            mask, value = COMMANDS[command]
            assert transition.controlword & mask == value
            assert transition.controlword & ~0x8F == 0


def test_every_transition_that_a_master_commands_is_asked_for_by_some_request():
    reached = set()
    for state, request, resume in itertools.product(STATUSWORDS, REQUESTS, (False, True)):
        drive = ModelDrive()
        drive.state = state
        sent = Sent(0, ResetEdge.LOWERED)
        drive.receive(next_word(state, request, sent, resume=resume).controlword)
        reached.add((state, drive.state))

    # Transition 5 (disable operation) leaves the power on without torque: no request of ours.
    wanted = {t for t in TRANSITIONS if t.controlword is not None and t.number != 5}
    assert {(t.source, t.target) for t in wanted} <= reached


def test_quick_stop_from_every_state_never_sets_bit_3():
    for state, sent, resume in itertools.product(STATES, EVERY_SENT, (False, True)):
        word = next_word(state, PowerRequest.QUICK_STOP, sent, resume=resume).controlword

        assert word & (ENABLE_BIT | QUICK_STOP_BIT) == 0
        assert word & VOLTAGE_BIT


@pytest.mark.parametrize("state", STATUSWORDS)
def test_disable_voltage_beats_quick_stop(state):
    word = next_word(state, PowerRequest.DISABLE_VOLTAGE, Sent(), resume=True).controlword
    drive = ModelDrive()
    drive.state = state

    drive.receive(word)

    assert word & (VOLTAGE_BIT | QUICK_STOP_BIT) == 0
    assert drive.state is not S.QUICK_STOP_ACTIVE


@pytest.mark.parametrize("request_", REQUESTS)
def test_every_word_of_the_table_is_meant(request_):
    sent = [next_word(state, request_, Sent(), resume=False).controlword for state in STATES]

    assert tuple(sent) == WORDS[request_]


@pytest.mark.parametrize("request_", [PowerRequest.QUICK_STOP, PowerRequest.DISABLE_VOLTAGE])
@pytest.mark.parametrize("state", STATUSWORDS)
@pytest.mark.parametrize("fourth", [False, True])
def test_a_stop_never_energises_from_any_state(request_, state, fourth):
    drive = ModelDrive(fourth=fourth)
    drive.state = state

    drive_through(drive, request_)

    assert drive.state is not S.OPERATION_ENABLED
    assert drive.state in {state, S.SWITCH_ON_DISABLED, S.QUICK_STOP_ACTIVE}


@pytest.mark.parametrize("fourth", [False, True])
def test_enabling_walks_one_transition_at_a_time_with_and_without_the_automatic_fourth(fourth):
    drive = ModelDrive(fourth=fourth)

    words = drive_through(drive, PowerRequest.ENABLE, 5)

    assert words == [0x06, 0x07, 0x0F, 0x0F, 0x0F]
    assert drive.state is S.OPERATION_ENABLED


def test_a_slow_drive_gets_the_same_word_until_it_has_moved():
    sent = Sent()
    words = []
    for shown in [S.SWITCH_ON_DISABLED] * 3 + [S.READY_TO_SWITCH_ON] * 4 + [S.SWITCHED_ON] * 2:
        sent = next_word(shown, PowerRequest.ENABLE, sent, resume=True)
        words.append(sent.controlword)

    assert words == [0x06] * 3 + [0x07] * 4 + [0x0F] * 2


@pytest.mark.parametrize(("option", "end"), [(2, S.SWITCH_ON_DISABLED), (6, S.QUICK_STOP_ACTIVE)])
def test_a_quick_stop_ends_as_605a_says_and_stays_there(option, end):
    drive = ModelDrive(option_605a=option)
    drive.state = S.OPERATION_ENABLED

    drive_through(drive, PowerRequest.QUICK_STOP, 3)
    drive.stopped()
    drive_through(drive, PowerRequest.QUICK_STOP, 3)

    assert drive.state is end


@pytest.mark.parametrize(("resume", "words"), [(True, [0x0F]), (False, [0x00, 0x06, 0x07, 0x0F])])
def test_leaving_quick_stop_goes_by_transition_16_or_12_as_the_profile_says(resume, words):
    drive = ModelDrive()
    drive.state = S.QUICK_STOP_ACTIVE

    sent = drive_through(drive, PowerRequest.ENABLE, len(words), resume=resume)

    assert sent == words
    assert drive.state is S.OPERATION_ENABLED


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("left_to", sorted(set(STATES) - {S.OPERATION_ENABLED}))
def test_a_drive_that_left_operation_enabled_is_not_enabled_again_by_the_same_request(
    left_to, resume
):
    """Not from the first state that it then shows, and not from any that it shows after that."""
    sent = Sent()
    for request in (PowerRequest.ENABLE, PowerRequest.HOME):
        sent = next_word(S.OPERATION_ENABLED, request, sent, resume=resume)
    for shown in (left_to, S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON):
        sent = next_word(shown, PowerRequest.ENABLE, sent, resume=resume)
        assert sent.controlword == 0x02

    ended = next_word(S.SWITCH_ON_DISABLED, PowerRequest.DISABLE_VOLTAGE, sent, resume=resume)
    again = next_word(S.SWITCHED_ON, PowerRequest.ENABLE, ended, resume=resume)
    assert again.controlword == 0x0F


@pytest.mark.parametrize("state", STATUSWORDS)
def test_halt_changes_no_state_and_is_sent_until_it_is_released(state):
    drive = ModelDrive()
    drive.state = state

    words = drive_through(drive, PowerRequest.HALT)

    assert drive.state is state
    assert set(words) == ({0x010F} if state is S.OPERATION_ENABLED else {words[0] & ~HALT_BIT})
    if state is S.OPERATION_ENABLED:
        assert drive_through(drive, PowerRequest.ENABLE, 1) == [0x000F]


@pytest.mark.parametrize("state", STATUSWORDS)
def test_ready_prepares_without_torque(state):
    drive = ModelDrive()
    drive.state = state

    words = drive_through(drive, PowerRequest.READY)

    assert not any(word & ENABLE_BIT for word in words)
    expected = S.READY_TO_SWITCH_ON
    if state in {S.NOT_READY_TO_SWITCH_ON, S.FAULT, S.FAULT_REACTION_ACTIVE}:
        expected = state
    assert drive.state is expected


@pytest.mark.parametrize("request_", [r for r in REQUESTS if r is not PowerRequest.FAULT_RESET])
def test_a_drive_in_fault_stays_there_until_a_reset_is_asked_for(request_):
    drive = ModelDrive()
    drive.state = S.FAULT

    drive_through(drive, request_)

    assert drive.state is S.FAULT
    assert drive.reset_edges == 0


def test_nothing_is_energised_before_the_first_word():
    assert Sent() == Sent(controlword=0x0000, edge=ResetEdge.IDLE)


# --- fault reset ----------------------------------------------------------------------------------


def test_one_request_makes_one_edge_and_lowers_the_bit_again():
    drive = ModelDrive()
    drive.state = S.FAULT
    drive.cause_gone = False

    words = drive_through(drive, PowerRequest.FAULT_RESET)

    assert words == [0x00, 0x80] + [0x00] * 8
    assert drive.state is S.FAULT


def test_a_second_request_makes_a_second_edge():
    drive = ModelDrive()
    drive.state = S.FAULT
    drive.cause_gone = False
    drive_through(drive, PowerRequest.FAULT_RESET)
    drive_through(drive, PowerRequest.QUICK_STOP, 1)
    drive.cause_gone = True

    drive_through(drive, PowerRequest.FAULT_RESET)

    assert drive.reset_edges == 2
    assert drive.state is S.SWITCH_ON_DISABLED


def test_a_fault_that_goes_ends_in_switch_on_disabled_and_goes_no_further():
    drive = ModelDrive()
    drive.state = S.FAULT

    words = drive_through(drive, PowerRequest.FAULT_RESET)

    assert drive.state is S.SWITCH_ON_DISABLED
    assert not any(word & 0x0F for word in words)


def test_the_edge_waits_for_the_fault_reaction_to_end():
    sent = Sent()
    words = []
    for shown in [S.FAULT_REACTION_ACTIVE] * 4 + [S.FAULT] * 3:
        sent = next_word(shown, PowerRequest.FAULT_RESET, sent, resume=True)
        words.append(sent.controlword)

    assert words == [0x00] * 4 + [0x80, 0x00, 0x00]


def test_a_reset_asked_of_a_drive_that_carries_a_load_keeps_it_stopped_and_powered():
    for state in (S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE):
        word = next_word(state, PowerRequest.FAULT_RESET, Sent(), resume=True).controlword

        assert word == 0x0002


# --- laws -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "transition", [t for t in TRANSITIONS if t.controlword is not None], ids=lambda t: f"{t.number}"
)
def test_every_transition_of_the_table_is_the_standard_s(transition):
    drive = ModelDrive(option_605a=6)
    drive.state = transition.source

    drive.receive(transition.controlword)

    assert drive.state is transition.target


@settings(derandomize=True, deadline=None)
@given(
    start=st.sampled_from(sorted(STATUSWORDS)),
    requests=st.lists(st.sampled_from(REQUESTS), min_size=1, max_size=40),
    fourth=st.booleans(),
    option=st.sampled_from([2, 6]),
    resume=st.booleans(),
)
def test_torque_comes_on_only_while_enable_is_asked_for(start, requests, fourth, option, resume):
    drive = ModelDrive(fourth=fourth, option_605a=option)
    drive.state = start
    sent = Sent()

    for request in requests:
        before = drive.state
        sent = next_word(decode_statusword(drive.statusword()), request, sent, resume=resume)
        drive.receive(sent.controlword)
        if drive.state is S.OPERATION_ENABLED and before is not S.OPERATION_ENABLED:
            assert request in ENABLING


class PowerStage(RuleBasedStateMachine):
    """Any order of requests, faults, lost cycles and slow drives."""

    def __init__(self):
        super().__init__()
        self.drive = ModelDrive()
        self.sent = Sent()
        self.last_request = None
        self.energised_by = None
        self.resets_asked = 0

    @rule(request=st.sampled_from(REQUESTS), heard=st.booleans())
    def cycle(self, request, heard):
        if request is PowerRequest.FAULT_RESET and self.last_request is not request:
            self.resets_asked += 1
        self.last_request = request
        shown = decode_statusword(self.drive.statusword())
        self.sent = next_word(shown, request, self.sent, resume=True)
        if heard:
            before = self.drive.state
            self.drive.receive(self.sent.controlword)
            if self.drive.state is S.OPERATION_ENABLED is not before:
                self.energised_by = request

    @rule()
    def fault(self):
        self.drive.state = S.FAULT
        self.drive.cause_gone = False

    @rule()
    def cause_goes_away(self):
        self.drive.cause_gone = True

    @rule()
    def ramp_ends(self):
        self.drive.stopped()

    @invariant()
    def only_enable_energises(self):
        assert self.energised_by in (None, *ENABLING)

    @invariant()
    def at_most_one_edge_for_each_request(self):
        assert self.drive.reset_edges <= self.resets_asked


TestPowerStage = PowerStage.TestCase
TestPowerStage.settings = settings(derandomize=True, max_examples=60, deadline=None)


# --- homing ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bits", "state"),
    [
        (0x0000, HomingState.IN_PROGRESS),
        (0x0400, HomingState.NOT_STARTED),
        (0x1000, HomingState.ATTAINED),
        (0x1400, HomingState.DONE),
        (0x2000, HomingState.FAILED_MOVING),
        (0x2400, HomingState.FAILED),
    ],
)
def test_bits_10_12_and_13_say_how_far_a_homing_is(bits, state):
    assert homing_state(0x0237 | bits) is state


def test_an_error_beats_an_attained_home():
    assert homing_state(0x3400) is HomingState.FAILED
    assert homing_state(0x3000) is HomingState.FAILED_MOVING


def test_what_proves_that_there_is_no_torque_and_no_power_is_the_standard_s():
    """CiA 402-2: power may be applied from switched on, the drive function from enabled on."""
    without_power = {
        PowerState.NOT_READY_TO_SWITCH_ON,
        PowerState.SWITCH_ON_DISABLED,
        PowerState.READY_TO_SWITCH_ON,
        PowerState.FAULT,
    }

    assert without_power == POWER_STAGE_OFF
    assert without_power | {PowerState.SWITCHED_ON} == CANNOT_EXERT_TORQUE
