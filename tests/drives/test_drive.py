import copy
import struct

import pytest
from drive_files import axis_for, drive, join, table

from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusCondition
from drives.cia402.drive import Drive, DriveGroup
from drives.signals import (
    DriveCommand,
    Input,
    NmtState,
    OperationMode,
    PowerRequest,
    PowerState,
)

NOW = 5_000_000_000
GOOD_INPUTS = 0x00030000
ENABLED = 0x1637


def status(word=ENABLED, counts=100, mode=10, node=5):
    return Frame(0x180 + node, struct.pack("<Hib", word, counts, mode))


def torque(raw=250, inputs=GOOD_INPUTS, node=5):
    return Frame(0x280 + node, struct.pack("<iI", raw, inputs))


def sample(counts=100, raw=250, node=5, word=ENABLED):
    return [status(word, counts, node=node), torque(raw, node=node)]


def command(power, torque_permille=0, counts=0, mode=OperationMode.CYCLIC_SYNC_TORQUE):
    return DriveCommand(power, mode, counts, torque_permille)


def pair():
    return DriveGroup([Drive(drive("hip_epos4"), NOW), Drive(drive("slide_epos4"), NOW)])


def hip():
    return DriveGroup([Drive(drive("hip_epos4"), NOW)])


def window(group, frames, cycle=1, now=NOW):
    group.feed(frames, now)
    return group.end_of_window(cycle, now)[0]


# --- samples --------------------------------------------------------------------------------------


def test_a_complete_sample_is_fresh_and_decoded():
    group = hip()
    assert not group.feed(sample(), NOW)
    feedback = group.end_of_window(1, NOW)[0]

    assert feedback.fresh
    assert feedback.sample_age_cycles == 0
    assert feedback.protocol_error_count == 0
    assert (feedback.position_counts, feedback.torque_raw) == (100, 250)
    assert feedback.power_state is PowerState.OPERATION_ENABLED
    assert feedback.inputs == Input.HAND_SWITCH_CLOSED | Input.STO_RELEASED


def test_a_drive_that_has_sent_nothing_shows_nothing():
    feedback = hip().peek(NOW)[0]

    shown = (feedback.statusword, feedback.mode_display, feedback.temperature_degc)
    assert shown == (0, 0, None)
    assert (feedback.error_code, feedback.error_text) == (0, "")
    assert (feedback.position_counts, feedback.torque_raw) == (0, 0)
    assert feedback.sample_age_cycles == 0
    assert not feedback.rebooted


def test_before_the_first_sample_nothing_is_known_and_nothing_looks_young():
    feedback = window(hip(), [], cycle=8)

    assert not feedback.fresh
    assert feedback.sample_age_cycles == 1
    assert feedback.power_state is PowerState.UNKNOWN
    assert feedback.inputs == Input.NONE


@pytest.mark.parametrize("missing", [1, 2, 5])
def test_missing_samples_age_and_are_never_repeated_as_fresh(missing):
    group = hip()
    window(group, sample(counts=100), cycle=10)

    for cycle in range(11, 11 + missing):
        feedback = window(group, [], cycle)

        assert not feedback.fresh
        assert feedback.sample_age_cycles == cycle - 10
        assert feedback.position_counts == 100

    assert window(group, sample(counts=101), 11 + missing).fresh


def test_cycles_that_were_skipped_count_as_age():
    group = hip()
    window(group, sample(), cycle=10)

    assert window(group, [], cycle=15).sample_age_cycles == 5


@pytest.mark.parametrize("half", [0, 1])
def test_half_a_sample_is_no_sample(half):
    group = hip()
    window(group, sample(counts=100, raw=250), cycle=1)

    feedback = window(group, [sample(counts=999, raw=999)[half]], cycle=2)

    assert not feedback.fresh
    assert (feedback.position_counts, feedback.torque_raw) == (100, 250)


def test_the_order_of_tpdos_does_not_matter():
    assert window(hip(), sample()[::-1]).fresh


def test_a_late_tpdo_is_counted_and_not_used():
    group = hip()
    window(group, sample(counts=100), cycle=1)
    window(group, [], cycle=2)

    group.feed_between(sample(counts=200), NOW)
    feedback = window(group, [], cycle=3)

    assert feedback.late_count == 2
    assert not feedback.fresh
    assert feedback.position_counts == 100


def test_one_late_half_does_not_complete_the_next_sample():
    group = hip()
    group.feed_between([status(counts=7)], NOW)

    assert not window(group, [torque()], cycle=1).fresh


def test_of_two_in_one_window_the_second_is_this_cycle_s():
    feedback = window(hip(), [status(counts=1), *sample(counts=2)])

    assert feedback.fresh
    assert feedback.position_counts == 2
    assert feedback.late_count == 1


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("length", [0, 1, 5, 8])
def test_a_tpdo_of_another_length_than_mapped_is_counted_and_not_used(number, length):
    group = DriveGroup([Drive(drive("hip_generic"), NOW)])
    frames = [status(), Frame(0x285, struct.pack("<hI", 250, GOOD_INPUTS))]
    frames[number] = Frame(frames[number].can_id, bytes(range(length)))

    assert not group.feed(frames, NOW)
    feedback = group.end_of_window(1, NOW)[0]

    assert not feedback.fresh
    assert feedback.protocol_error_count == 1
    assert (feedback.power_state is PowerState.UNKNOWN) is (number == 0)
    assert (feedback.inputs == Input.NONE) is (number == 1)


def test_a_statusword_that_the_standard_does_not_have_is_a_protocol_error():
    feedback = window(hip(), sample(word=0x0005))

    assert feedback.power_state is PowerState.UNKNOWN
    assert feedback.protocol_error_count == 1


@pytest.mark.parametrize(
    ("word", "mode", "following"),
    [
        *((0x1637, 8, True), (0x1637, 9, True), (0x1637, 10, True), (0x1637, 6, False)),
        *((0x0637, 10, False), (0x2637, 10, False)),
    ],
)
def test_following_is_bit_12_in_a_cyclic_mode_only(word, mode, following):
    feedback = window(hip(), [status(word, mode=mode), torque()])

    assert feedback.following is following
    assert feedback.mode_display == mode


@pytest.mark.parametrize(("word", "warning"), [(0x1637, False), (0x16B7, True), (0x0080, True)])
def test_a_warning_is_bit_7(word, warning):
    assert window(hip(), [status(word), torque()]).warning is warning


@pytest.mark.parametrize(
    ("bits", "inputs"),
    [
        (0x00000000, Input.NONE),
        (0x00010000, Input.HAND_SWITCH_CLOSED),
        (0x00020000, Input.STO_RELEASED),
        (0x00030003, Input(15)),
        (0x1FFC0004, Input.NONE),
        *((0x00030000 | 1 << bit, Input.IMPOSSIBLE) for bit in [*range(3, 16), 29, 30, 31]),
        (0xFFFFFFFF, Input.IMPOSSIBLE),
    ],
)
def test_inputs_are_the_bits_of_the_axis_file_and_no_others(bits, inputs):
    group = hip()

    assert not group.feed([status(), torque(inputs=bits)], NOW)

    assert group.end_of_window(1, NOW)[0].inputs == inputs


def test_an_input_whose_name_holds_at_the_low_level_is_read_so():
    profile = copy.deepcopy(table("profiles/generic.toml"))
    axis = axis_for(profile)
    axis["inputs"]["sto_released"]["level"] = 0
    group = DriveGroup([Drive(join(axis, profile, "hip"), NOW)])

    frames = [Frame(0x285, struct.pack("<hI", 0, bits)) for bits in (0x00010000, GOOD_INPUTS)]
    told = [window(group, [frame]).inputs & Input.STO_RELEASED for frame in frames]

    assert told == [Input.STO_RELEASED, Input.NONE]


def test_noise_on_inputs_without_a_name_fills_no_memory():
    group = hip()

    group.feed([torque(inputs=GOOD_INPUTS | 1 << bit) for bit in range(18, 29)], NOW)

    assert len(group.drives[0]._decoded_inputs) == 1


def mapped():
    """A drive whose TPDO3 carries temperature and error code."""
    profile = copy.deepcopy(table("profiles/generic.toml"))
    profile["temperature"] |= {"degc_per_count": 0.1}
    profile["torque_source"] |= {"bits": 32}
    return DriveGroup([Drive(join(axis_for(profile), profile, "hip"), NOW)])


def test_slow_values_come_when_they_come():
    group = mapped()

    assert not group.feed_between([Frame(0x385, struct.pack("<hH", 415, 0x8611))], NOW)
    feedback = window(group, sample())

    assert feedback.temperature_degc == pytest.approx(41.5)
    assert feedback.late_count == 0
    assert (feedback.error_code, feedback.error_text) == (0x8611, "following error")


def test_the_newest_error_code_is_told_whatever_the_temperature_is():
    group = mapped()

    for code, text in (
        (0x8611, "following error"),
        (0x3210, "DC link overvoltage"),
        (0, "error reset or no error"),
    ):
        group.feed_between([Frame(0x385, struct.pack("<hH", 0, code))], NOW)
        feedback = group.peek(NOW)[0]
        assert (feedback.error_code, feedback.error_text) == (code, text)


def test_an_error_code_that_an_emcy_has_told_is_told_no_more():
    group = mapped()
    emcy = Frame(0x085, struct.pack("<HB5x", 0x8611, 0x21))

    group.feed_between([Frame(0x385, struct.pack("<hH", 415, 0x8611)), emcy], NOW)
    feedback = window(group, sample())

    assert feedback.error_code == 0
    assert feedback.emergency.code == 0x8611


def test_slow_values_are_unknown_once_three_of_them_stayed_away_and_known_again_with_the_next():
    group = mapped()
    slow = Frame(0x385, struct.pack("<hH", 415, 0x8611))
    silent = mapped()
    overdue = [window(silent, sample(), cycle).temperature_overdue for cycle in range(1, 33)]
    assert overdue == [False] * 30 + [True] * 2

    group.feed_between([slow], NOW)
    told = [window(group, sample(), cycle) for cycle in range(1, 33)]

    assert [one.temperature_degc is None for one in told] == [False] * 30 + [True] * 2
    assert [one.temperature_overdue for one in told] == [False] * 30 + [True] * 2
    assert (told[-1].error_code, told[-1].error_text) == (0, "")
    # Of another length it tells nothing; and windows that were left out do not count.
    for data in (b"\1", bytes(8)):
        group.feed_between([slow._replace(data=data)], NOW)
    missed = window(group, sample(), 33)
    assert (missed.temperature_overdue, missed.protocol_error_count) == (True, 2)
    group.feed_between([slow], NOW)
    again = window(group, sample(), 500)
    assert (again.temperature_overdue, again.temperature_degc) == (False, pytest.approx(41.5))


def test_the_cia_402_drive_sends_a_shorter_torque_frame():
    group = DriveGroup([Drive(drive("hip_generic"), NOW)])

    feedback = window(group, [status(), Frame(0x285, struct.pack("<hI", -321, GOOD_INPUTS))])

    assert feedback.fresh
    assert feedback.torque_raw == -321


# --- heartbeat, boot-up, EMCY ---------------------------------------------------------------------


def test_the_age_of_a_heartbeat_counts_from_the_end_of_bring_up():
    group = hip()

    assert group.peek(NOW + 70_000_000)[0].heartbeat_age_ns == 70_000_000

    group.feed_between([Frame(0x705, b"\x05")], NOW + 80_000_000)
    feedback = group.peek(NOW + 90_000_000)[0]
    assert feedback.heartbeat_age_ns == 10_000_000
    assert feedback.nmt_state is NmtState.OPERATIONAL


def test_a_boot_up_message_is_an_alarm_and_stays_known():
    group = hip()
    group.feed([Frame(0x705, b"\x05")], NOW)

    assert group.feed_between([Frame(0x705, b"\x00")], NOW)

    group.feed([Frame(0x705, b"\x05")], NOW)
    assert window(group, sample()).rebooted


def test_a_node_that_leaves_operational_is_an_alarm():
    group = hip()
    group.feed([Frame(0x705, b"\x05")], NOW)

    assert not group.feed_between([Frame(0x705, b"\x05")], NOW)
    assert group.feed_between([Frame(0x705, b"\x7f")], NOW)
    assert group.peek(NOW)[0].nmt_state is NmtState.PRE_OPERATIONAL


def test_a_frame_that_is_no_heartbeat_is_a_protocol_error_and_no_sign_of_life():
    group = hip()

    group.feed([Frame(0x705, b"\x33"), Frame(0x705, b""), Frame(0x705, b"\x01")], NOW + 50_000_000)
    feedback = group.peek(NOW + 60_000_000)[0]

    assert feedback.protocol_error_count == 3
    assert feedback.heartbeat_age_ns == 60_000_000


def test_an_emcy_is_an_alarm_in_words_until_it_is_cleared():
    group = hip()

    assert group.feed_between([Frame(0x085, bytes.fromhex("1186210000000000"))], NOW)
    feedback = group.peek(NOW)[0]
    assert feedback.emergency is not None
    assert feedback.emergency.code == 0x8611
    assert "following error" in feedback.emergency.text

    assert not group.feed_between([Frame(0x085, bytes(8))], NOW)
    assert group.peek(NOW)[0].emergency is None
    assert group.peek(NOW)[0].emergency_count == 1


def test_a_flood_of_emcy_fills_nothing_and_is_counted_exactly():
    group = hip()

    for n in range(500):
        group.feed_between([Frame(0x085, struct.pack("<HB5s", 0x1000, 1, bytes([n % 256])))], NOW)
    group.feed_between([Frame(0x085, bytes(8))], NOW)

    log = group.drives[0].emergencies
    assert group.peek(NOW)[0].emergency_count == 500
    assert len(log.ring) == 32
    assert log.ring[-1].vendor_bytes[0] == 499 % 256
    assert group.peek(NOW)[0].emergency is None


def test_an_emcy_of_another_length_is_a_protocol_error():
    group = hip()

    assert not group.feed([Frame(0x085, bytes(3))], NOW)
    assert group.peek(NOW)[0].protocol_error_count == 1


def test_a_peek_between_windows_is_never_news():
    group = hip()
    window(group, sample())

    assert not group.peek(NOW)[0].fresh


# --- the group ------------------------------------------------------------------------------------


def test_frames_find_their_drive_and_strangers_are_counted():
    group = pair()

    group.feed([*sample(counts=11), *sample(counts=22, node=6), Frame(0x187, bytes(7))], NOW)
    first, second = group.end_of_window(1, NOW)

    assert (first.position_counts, second.position_counts) == (11, 22)
    assert group.stray_count == 1


def test_the_group_knows_what_a_complete_window_contains():
    assert pair().cyclic_ids == {0x185, 0x285, 0x186, 0x286}


def test_bus_off_is_an_alarm():
    group = pair()

    assert group.feed_between([Frame(0x040, bytes(8), is_error=True)], NOW)
    assert group.bus_state.condition is BusCondition.OFF


def test_an_error_frame_is_no_frame_of_a_drive_and_ends_no_batch():
    group = hip()

    feedback = window(group, [Frame(0x040, bytes(8), is_error=True), *sample()])

    assert feedback.fresh
    assert group.stray_count == 0


# --- commands -------------------------------------------------------------------------------------


def test_controlword_mode_and_target_leave_in_one_frame():
    group = hip()
    window(group, sample())

    frames = group.frames([command(PowerRequest.ENABLE, torque_permille=-200, counts=4321)])

    assert frames == [
        Frame(0x205, struct.pack("<Hbi", 0x000F, 10, 4321)),
        Frame(0x305, struct.pack("<h", -200)),
    ]


def test_controlwords_of_all_drives_leave_before_any_torque():
    group = pair()

    frames = group.frames([command(PowerRequest.QUICK_STOP)] * 2)

    assert [frame.can_id for frame in frames] == [0x205, 0x206, 0x305, 0x306]


@pytest.mark.parametrize("request_", list(PowerRequest))
def test_no_command_enables_a_drive_that_has_shown_nothing_yet(request_):
    group = hip()

    control, _ = group.frames([command(request_)])

    assert control.data[0] & 0x08 == 0


def test_the_state_that_counts_is_the_one_last_shown():
    group = hip()
    words = []
    for cycle, shown in enumerate([0x0240, 0x0231, 0x0233, 0x1637], start=1):
        window(group, sample(word=shown), cycle)
        control, _ = group.frames([command(PowerRequest.ENABLE)])
        words.append(struct.unpack("<H", control.data[:2])[0])

    assert words == [0x06, 0x07, 0x0F, 0x0F]
    assert group.drives[0].controlword == 0x0F


# --- drives with less in their PDOs ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("temperature", "error_code", "data", "shown"),
    [
        (True, True, struct.pack("<hH", 412, 0x8130), (41.2, 0x8130)),
        (True, False, struct.pack("<h", -50), (-5.0, 0)),
        (False, True, struct.pack("<H", 0x8130), (None, 0x8130)),
    ],
)
def test_the_slow_pdo_is_decoded_as_the_drive_has_it(temperature, error_code, data, shown):
    profile = copy.deepcopy(table("profiles/generic.toml"))
    profile["pdo"]["error_code"] = error_code
    if temperature:
        profile["temperature"] |= {"bits": 16, "signed": True, "degc_per_count": 0.1}
    else:
        del profile["temperature"]
    one = Drive(join(axis_for(profile), profile, "hip"), NOW)
    group = DriveGroup([one])

    group.feed([Frame(0x380 + one.node_id, data)], NOW)
    feedback = group.end_of_window(1, NOW)[0]

    assert feedback.temperature_degc == (shown[0] and pytest.approx(shown[0]))
    assert feedback.error_code == shown[1]
    assert feedback.protocol_error_count == 0
