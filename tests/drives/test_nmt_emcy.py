import canopen
import pytest
from canopen.emcy import EmcyError
from drive_files import drive

from drives.canopen.emcy import EmergencyLog, decode_emergency, is_alarm
from drives.canopen.emcy_codes import STANDARD, Reaction, meaning
from drives.canopen.nmt import HeartbeatWatch, NmtCommand, heartbeat_frame, nmt_frame
from drives.signals import NmtState

MS = 1_000_000
CODES = {
    "standard": STANDARD,
    "epos4": drive("hip_epos4").profile.emergency_codes,
    "elmo": drive("hip_elmo").profile.emergency_codes,
}
"""Meanings of EMCY codes by the shipped profile that has them."""


# --- NMT ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (NmtCommand.START, "OPERATIONAL"),
        (NmtCommand.STOP, "STOPPED"),
        (NmtCommand.ENTER_PRE_OPERATIONAL, "PRE-OPERATIONAL"),
        (NmtCommand.RESET_NODE, "RESET"),
        (NmtCommand.RESET_COMMUNICATION, "RESET COMMUNICATION"),
    ],
)
def test_nmt_commands_are_those_of_canopen(command, word):
    assert nmt_frame(command, 5)[:2] == (0x000, bytes((canopen.nmt.NMT_COMMANDS[word], 5)))


def test_our_heartbeat_says_operational():
    assert heartbeat_frame(1)[:2] == (0x701, b"\x05")


def test_a_watch_that_is_not_armed_starts_with_the_first_heartbeat():
    watch = HeartbeatWatch()

    assert watch.age_ns(10**12) == 0

    watch.feed(b"\x7f", 10**12)
    assert watch.age_ns(10**12 + 30 * MS) == 30 * MS


def test_a_watch_that_is_armed_misses_a_heartbeat_that_never_comes():
    watch = HeartbeatWatch(armed_ns=10**12)

    assert watch.age_ns(10**12 + 100 * MS) == 100 * MS


def test_a_boot_up_message_is_no_sign_of_life():
    watch = HeartbeatWatch(armed_ns=0)

    assert watch.feed(b"\x00", 50 * MS)

    assert watch.age_ns(60 * MS) == 60 * MS
    assert watch.boot_up_count == 1
    assert watch.state is NmtState.BOOT_UP


def test_the_toggle_bit_of_node_guarding_is_not_part_of_the_state():
    watch = HeartbeatWatch()

    watch.feed(b"\x85", 1)

    assert watch.state is NmtState.OPERATIONAL
    assert watch.strange_count == 0


def test_only_a_change_of_state_is_news():
    watch = HeartbeatWatch()

    news = [watch.feed(bytes((state,)), n) for n, state in enumerate((5, 5, 0x7F, 0x7F, 5))]

    assert news == [False, False, True, False, True]


# --- EMCY -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "code", [0x1080, 0x2080, 0x3080, 0x4080, 0x5080, 0x6080, 0x7080, 0x8080, 0x9080]
)
def test_error_classes_are_those_of_canopen(code):
    theirs = EmcyError(code, 0, b"", 0.0).get_desc().lower()

    assert meaning(code, CODES["standard"]).text == theirs


@pytest.mark.parametrize("table", CODES)
def test_every_code_means_something(table):
    for code in range(0x10000):
        assert meaning(code, CODES[table]).text


@pytest.mark.parametrize(
    ("code", "reaction"),
    [
        (0x8130, Reaction.ABORT_CONNECTION),
        (0x8250, Reaction.ABORT_CONNECTION),
        (0x8611, Reaction.FAULT_REACTION),
        (0x8A82, Reaction.FAULT_REACTION),
        (0x2310, Reaction.SWITCHED_OFF),
        (0x7388, Reaction.SWITCHED_OFF),
        (0xFF01, Reaction.WARNING),
        (0x1085, Reaction.SWITCHED_OFF),
        (0x6199, Reaction.SWITCHED_OFF),
    ],
)
def test_what_an_epos4_does_with_a_code_is_known(code, reaction):
    assert meaning(code, CODES["epos4"]).reaction is reaction


def test_one_code_may_mean_another_thing_to_another_maker():
    texts = {meaning(0xFF10, CODES[table]).text for table in CODES}

    assert texts == {"device specific", "controller gains", "motor cannot be started"}


@pytest.mark.parametrize(
    ("code", "reaction"),
    [
        (0x8130, Reaction.ABORT_CONNECTION),
        (0x8611, Reaction.SWITCHED_OFF),
        (0x5441, Reaction.SWITCHED_OFF),
        (0x8250, Reaction.ABORT_CONNECTION),  # not in its own table: the standard's
        (0xFF10, Reaction.UNKNOWN),
    ],
)
def test_what_an_elmo_does_with_a_code_is_known_where_its_table_says_so(code, reaction):
    assert meaning(code, CODES["elmo"]).reaction is reaction


def test_an_encoder_that_cannot_be_believed_loses_its_reference():
    assert meaning(0x7382, CODES["epos4"]).loses_reference
    assert meaning(0x7305, CODES["standard"]).loses_reference
    assert meaning(0x7380, CODES["elmo"]).loses_reference
    assert meaning(0x7305, CODES["elmo"]).loses_reference
    assert not meaning(0x8130, CODES["epos4"]).loses_reference


@pytest.mark.parametrize("length", [0, 3, 7, 9])
def test_an_emcy_that_has_not_eight_bytes_is_none(length):
    assert decode_emergency(bytes(length), 5, CODES["epos4"], 1) is None


def test_an_emcy_is_taken_apart_as_the_standard_says():
    emergency = decode_emergency(bytes.fromhex("30 81 11 01 02 03 04 05"), 5, CODES["epos4"], 7)

    assert emergency is not None
    assert (emergency.node_id, emergency.code, emergency.error_register) == (5, 0x8130, 0x11)
    assert emergency.vendor_bytes == b"\x01\x02\x03\x04\x05"
    assert "heartbeat" in emergency.text
    assert emergency.time_ns == 7


def test_no_error_clears_the_open_one_and_is_not_counted_as_an_error():
    log = EmergencyLog(5, CODES["epos4"])
    log.feed(bytes.fromhex("3081110000000000"), 1)
    log.feed(bytes.fromhex("1186210000000000"), 2)

    assert log.open is not None
    assert log.open.code == 0x8611
    log.feed(bytes(8), 3)

    assert log.open is None
    assert log.count == 2
    assert [entry.code for entry in log.ring] == [0x8130, 0x8611]


def emcy(code, register=0x01):
    return code.to_bytes(2, "little") + bytes((register, 0, 0, 0, 0, 0))


@pytest.mark.parametrize(
    ("code", "reaction", "loses_reference"),
    [
        (0x8130, Reaction.ABORT_CONNECTION, False),
        (0x8611, Reaction.FAULT_REACTION, False),
        (0x7320, Reaction.SWITCHED_OFF, True),
        (0xFF01, Reaction.WARNING, False),
    ],
)
def test_an_emcy_says_what_the_drive_does_by_itself_and_whether_it_knows_its_position(
    code, reaction, loses_reference
):
    emergency = decode_emergency(emcy(code), 5, CODES["epos4"], 0)

    assert emergency is not None
    assert emergency.reaction is reaction
    assert emergency.loses_reference is loses_reference


@pytest.mark.parametrize("table", CODES)
def test_only_what_is_known_to_be_a_warning_asks_for_no_stop(table):
    warnings = []
    for code in range(0x10000):
        emergency = decode_emergency(emcy(code), 5, CODES[table], 0)
        assert emergency is not None
        if code and not is_alarm(emergency):
            warnings.append(code)

    assert all(meaning(code, CODES[table]).reaction is Reaction.WARNING for code in warnings)
    assert len(warnings) < 100


def test_a_warning_is_counted_and_kept_and_hides_no_alarm():
    log = EmergencyLog(5, CODES["epos4"])

    log.feed(emcy(0xFF01), 1)
    first = log.open
    log.feed(emcy(0x8611), 2)
    log.feed(emcy(0xFF01), 3)

    assert first is not None
    assert first.code == 0xFF01
    assert log.open is not None
    assert log.open.code == 0x8611
    assert (log.count, log.alarm_count) == (3, 1)
    assert [entry.code for entry in log.ring] == [0xFF01, 0x8611, 0xFF01]


def test_an_alarm_that_was_taken_back_is_remembered_and_no_warning_takes_its_place():
    log = EmergencyLog(5, CODES["epos4"])

    for code in (0x8611, 0x0000, 0xFF01):
        log.feed(emcy(code), 0)

    assert log.alarm is not None
    assert log.alarm.code == 0x8611
    assert log.open is not None
    assert log.open.code == 0xFF01
    assert log.alarm_count == 1


def test_a_code_that_is_still_open_asks_for_nothing_new():
    log = EmergencyLog(5, CODES["epos4"])
    asked = []
    for code in (0x8611, 0x8611, 0x2310, 0x8611, 0x0000, 0x8611, 0xFF01):
        log.feed(emcy(code), 0)
        asked.append(log.has_alarm)

    assert asked == [True, False, True, False, False, True, False]


def test_the_news_of_a_cycle_are_the_newest_and_are_told_once():
    log = EmergencyLog(5, CODES["epos4"])
    for code in (0x1000, 0x8611, 0x2310, 0x8611):
        log.feed(emcy(code), 0)

    assert [(entry.code, again) for entry, again in log.take_news()] == [
        (0x2310, False),
        (0x8611, True),
    ]
    assert log.take_news() == ()


def test_a_reference_that_is_lost_stays_lost_when_the_error_goes():
    log = EmergencyLog(5, CODES["epos4"])
    log.feed(emcy(0x7388), 0)
    log.feed(emcy(0x0000), 1)

    assert log.reference_lost
