"""Both sides of the power state machine against a third model (`third_model.py`).

The virtual drives are walked through it by raw PDO frames, the master by scripted statuswords.
"""

import itertools
import struct
from functools import cache

import pytest
from drive_bench import Bench
from hypothesis import given, settings
from hypothesis import strategies as st
from third_model import ARROWS, STANDING, STATUS, WORDS, Model, command_of, state_of, statusword

from drives.cia402.power_state import Sent, decode_statusword, next_word
from drives.signals import PowerRequest


def test_the_table_itself_has_one_command_for_each_word_whose_bit_7_is_low():
    assert all(command_of(word) for word in range(0x80))
    assert not any(command_of(word) for word in range(0x80, 0x100))
    assert len({(source, command) for _, source, command, _ in ARROWS}) == len(ARROWS)


# --- the virtual drives, by raw frames --------------------------------------------------------

KINDS = {
    "epos4": ({}, 0x30D1_0220, True),
    "generic": ({"personality": "generic", "eds": "drives/generic402.eds"}, 0x6078_0010, False),
    "elmo": ({"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}, 0x6078_0010, False),
}
WAY = {
    "switch on disabled": (),
    "ready to switch on": (0x06,),
    "switched on": (0x06, 0x07),
    "operation enabled": (0x06, 0x07, 0x0F),
    "quick stop active": (0x06, 0x07, 0x0F, 0x02),
}


class PdoDrive:
    """A virtual drive that is driven and seen by PDOs alone: RPDO1 and SYNC in, TPDO1 out."""

    def __init__(self, kind, *, stays):
        changes, torque, self.automatic_4 = KINDS[kind]
        self.bench = Bench(hip=changes)
        self.bench.boot()
        for index, value in ((0x605B, 0), (0x605C, 0), (0x605A, 6 if stays else 2)):
            assert self.bench.write(index, 0, value, 2) == 0
        self.bench.go_operational(torque=torque)

    def take(self, *words):
        """Each word by RPDO1 and applied at the next SYNC."""
        for word in words:
            self.bench.send(0x205, struct.pack("<Hbi", word, 10, 0))
            self.bench.send(0x080)
            self.bench.run_ms(10)

    @property
    def state(self):
        """State in TPDO1 of one more SYNC, with which no controlword comes."""
        self.bench.forget()
        self.bench.send(0x080)
        self.bench.run_ms(10)
        (data,) = self.bench.frames(0x185)
        return state_of(struct.unpack_from("<H", data)[0])

    def start_again(self):
        """To switch on disabled from wherever the test before has left it."""
        self.bench.plant.velocity[0] = 0.0
        self.bench.world.command("clear emcy right/hip")
        self.bench.run_ms(50)
        self.take(0x00, 0x80, 0x00)
        assert self.state == "switch on disabled"


@cache
def shared_drive(kind, *, stays):
    """Building one costs more than a walk."""
    return PdoDrive(kind, stays=stays)


def in_state(kind, state, *, stays=True):
    drive = shared_drive(kind, stays=stays)
    drive.start_again()
    if state in WAY:
        drive.take(*WAY[state])
    else:
        drive.bench.world.command("emcy right/hip - 0x2310")
        drive.bench.run_ms(20)
    assert drive.state == state
    return drive


def ends(state, word, *, automatic_4):
    """The states in which a drive may be that got this controlword in this state."""
    model = Model(state, automatic_4=automatic_4)
    model.take(word & 0x7F)
    if word < 0x80:
        return {model.state}
    # No command of the table: it may take power away, and never gives it.
    takes_power = command_of(word & 0x7F) in ("disable voltage", "quick stop", "shutdown")
    return {state, model.state} if takes_power else {state}


@pytest.mark.parametrize("state", [*WAY, "fault"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_controlword_by_rpdo_leads_where_the_table_says(kind, state):
    for word in WORDS:
        drive = in_state(kind, state)

        drive.take(word)

        allowed = ends(state, word, automatic_4=drive.automatic_4)
        assert drive.state in allowed, f"{word:02X}h"


@pytest.mark.parametrize("kind", KINDS)
def test_fault_reaction_listens_to_no_controlword(kind):
    for word in WORDS:
        drive = in_state(kind, "operation enabled")
        drive.bench.write(0x6085, 0, 10_000, 4)
        drive.bench.plant.velocity[0] = 50.0
        drive.bench.world.command("emcy right/hip - 0x2310")

        drive.take(word)

        # The ramp takes longer than a cycle.
        assert drive.state == "fault reaction active", f"{word:02X}h"


@settings(deadline=None)
@given(
    kind=st.sampled_from(sorted(KINDS)),
    words=st.lists(st.sampled_from(range(16)), min_size=1, max_size=12),
    stays=st.booleans(),
)
def test_a_walk_of_any_controlwords_is_the_table_s_walk(kind, words, stays):
    stays = stays or kind == "epos4"  # whose 605Ah knows 6 alone
    drive = in_state(kind, "switch on disabled", stays=stays)
    model = Model("switch on disabled", automatic_4=drive.automatic_4, stays=stays)

    for word in words:
        drive.take(word)
        model.take(word)

    assert drive.state == model.state


# --- the master, by scripted statuswords ------------------------------------------------------

ALLOWED = {
    PowerRequest.ENABLE: {2, 3, 4, 12, 16},
    PowerRequest.HOME: {2, 3, 4, 12, 16},
    PowerRequest.HALT: set(),
    PowerRequest.READY: {2, 6, 8, 12},
    PowerRequest.QUICK_STOP: {7, 10, 11},
    PowerRequest.DISABLE_VOLTAGE: {7, 9, 10, 12},
    PowerRequest.FAULT_RESET: {7, 9, 10, 11, 12, 15},
}
"""The arrows that each request may cause; no other one, from whatever state."""
GOAL = {
    PowerRequest.ENABLE: {"operation enabled"},
    PowerRequest.HOME: {"operation enabled"},
    PowerRequest.READY: {"ready to switch on"},
    PowerRequest.QUICK_STOP: {"quick stop active", "switch on disabled"},
    PowerRequest.DISABLE_VOLTAGE: {"switch on disabled"},
    PowerRequest.FAULT_RESET: {"switch on disabled", "quick stop active"},
}


@given(st.sampled_from(sorted(STATUS)), st.integers(0, 0xFFFF))
def test_the_master_reads_every_statusword_as_the_table_does(state, spare):
    assert decode_statusword(statusword(state, spare)).name.lower().replace("_", " ") == state


def walk(model, request, *, resume, cycles=12):
    """The master's words against the table's drive; what was sent in which state."""
    sent, story = Sent(), []
    for _ in range(cycles):
        shown = decode_statusword(statusword(model.state, 0))
        sent = next_word(shown, request, sent, resume=resume)
        story.append((model.state, sent.controlword))
        model.take(sent.controlword)
    return story


@pytest.mark.parametrize("state", STANDING)
@pytest.mark.parametrize("request_", PowerRequest)
def test_the_master_causes_only_arrows_of_its_request_and_arrives(state, request_):
    for automatic_4, stays, resume in itertools.product((False, True), repeat=3):
        model = Model(state, automatic_4=automatic_4, stays=stays)

        story = walk(model, request_, resume=resume and stays)

        check(model, state, request_, story, stays=stays)


def check(model, state, request_, story, *, stays):
    assert set(model.numbers) <= ALLOWED[request_] | ({12} if not stays else set()), story
    if state not in ("fault", "fault reaction active"):
        # Halt moves nothing; a drive that does not stay in quick stop active leaves it by itself.
        ends = GOAL.get(request_, {state, model.state if 12 in model.numbers else state})
        assert model.state in ends, story
    elif request_ is PowerRequest.FAULT_RESET and state == "fault":
        assert model.state == "switch on disabled"
    else:
        assert model.state == state
    edges = sum(word & 0x80 != 0 for _, word in story)
    assert edges <= (request_ is PowerRequest.FAULT_RESET)
    raised_in = {shown for shown, word in story if word & 0x08}
    if request_ not in (PowerRequest.ENABLE, PowerRequest.HOME):
        assert raised_in <= ({"operation enabled"} if request_ is PowerRequest.HALT else set())
