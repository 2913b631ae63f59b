"""Each rule of bring-up on a port on which time passes only while it waits: when, what, who."""

import dataclasses

import msgspec
import pytest
from bringup_bench import START, Bench, refused, silent
from drive_files import CYCLE, HIP_LIMITS, SLIDE_LIMITS, drive
from memory_bus import MS, ManualClock

from drives.bringup import bringup
from drives.bringup.bringup import DriveReport, bring_up
from drives.bringup.plan import plan
from drives.bringup.port import NodeTraffic
from drives.bringup.steps import Step, StepKind
from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusMonitor
from drives.canopen.nmt import SyncProducer
from drives.cia402.units import base_from_raw
from drives.errors import (
    BootFailure,
    BringUpRefused,
    BusError,
    DrivePowered,
    DriveSilent,
    SdoAborted,
    SdoTimeout,
)
from drives.signals import NmtState, PowerState

HIP, SLIDE = 5, 6
PLANS = (
    plan(drive("hip_epos4"), HIP_LIMITS, CYCLE),
    plan(drive("slide_epos4"), SLIDE_LIMITS, CYCLE),
)
OFF, ENABLED, BRAKING, SWITCHED_ON = 0x0240, 0x1637, 0x0617, 0x0233
POWER = Step(StepKind.POWER, "its power stage is off", 0x6041, bits=16)
SYNC = Frame(0x080, b"")


class Port:
    """Two nodes whose objects are numbers; things happen at their time while it waits."""

    def __init__(self):
        self.clock = ManualClock()
        self.began_ns = self.now_ns()
        self.nodes = {HIP: NodeTraffic(), SLIDE: NodeTraffic()}
        self.values = {(node, 0x6041): OFF for node in (HIP, SLIDE)}
        self.values |= {(node, 0x1018): 7 for node in (HIP, SLIDE)}
        self.sent, self.written, self.waits_ms = [], [], []
        self.refuses = {}
        """Errors of the transfers to a node."""
        self.at_sync = lambda: None
        self.sync, self.bus_state = SyncProducer(3), BusMonitor()
        self.foreign_sync_count = 0
        self.happens = []
        """Times in ms, and what happens then."""

    @property
    def now_ms(self):
        return (self.now_ns() - self.began_ns) / MS

    def now_ns(self):
        return self.clock.now_ns()

    def after(self, ms, what):
        self.happens.append((self.began_ns + ms * MS, what))
        self.happens.sort(key=lambda one: one[0])

    def wait(self, until_ns):
        """A frame ends a wait."""
        if self.happens and self.happens[0][0] <= until_ns:
            time_ns, what = self.happens.pop(0)
            self.clock.time_ns = max(self.now_ns(), time_ns)
            what()
        else:
            self.clock.time_ns = until_ns

    def send(self, frames):
        self.sent += frames
        if frames[0].can_id == SYNC.can_id:
            self.at_sync()

    def traffic(self, node_id):
        return self.nodes.setdefault(node_id, NodeTraffic())

    def read(self, node_id, index, sub):
        self._refuse(node_id)
        return self.values[node_id, index].to_bytes(4, "little")

    def write(self, node_id, index, sub, data):
        self._refuse(node_id)
        self.written.append((node_id, index, sub, data))
        self.values[node_id, index] = int.from_bytes(data, "little")

    def _refuse(self, node_id):
        if node_id in self.refuses:
            raise self.refuses[node_id]

    # --- what a node does -------------------------------------------------------------------------

    def boots(self, node=HIP):
        self.nodes[node].boot_up_count += 1

    def beats(self, state, node=HIP):
        self.nodes[node].nmt_state = state
        self.nodes[node].heartbeat_count += 1

    def samples(self, *can_ids, size=8):
        for can_id in can_ids:
            traffic = self.nodes[can_id & 0x7F]
            traffic.pdo_count[can_id] = traffic.pdo_count.get(can_id, 0) + 1
            traffic.pdo_data[can_id] = bytes(size)


@pytest.fixture
def port():
    return Port()


@pytest.fixture
def drives():
    """Two drives of which nothing was received before their reset."""
    made = [bringup._DriveState(one) for one in PLANS]
    for one in made:
        one.boot_up_count = one.sdo_repeat_count = 0
    return made


def failure(steps, kind=DriveSilent, text=None):
    """The error with which steps end; how often they say their text before does not matter."""
    said = set()
    with pytest.raises(kind) as caught:
        for one in steps:
            said.add(one)
    assert text is None or said <= {text}
    return caught.value


# --- order and progress ---------------------------------------------------------------------------


@pytest.mark.parametrize("together", [False, True])
def test_the_order_of_all_steps_and_how_far_each_is(together):
    bench = Bench()
    bench.run(may_switch_off=together)
    hip, slide = ([(p.description.name, str(step)) for step in p.steps] for p in bench.plans)
    at = next(n for n, (_, text) in enumerate(hip) if text.startswith("power"))
    phases = [[0, 1], [1, at], [at, at + 1], [at + 1, None]] if together else [[0, 1], [1, None]]
    expected = [step for a, b in phases for step in hip[a:b] + slide[a:b]]
    total = len(expected) + 2

    order = list(dict.fromkeys((p.drive, p.text, p.done_count) for p in bench.progress))

    assert order == [
        ("", "listens for another master", 0),
        *((*step, done) for done, step in enumerate(expected)),
        ("", "NMT start", total - 2),
        ("", "first samples", total - 1),
    ]
    assert {p.total_count for p in bench.progress} == {total}


def test_the_power_of_all_drives_is_read_after_each_has_been_identified():
    assert [one.steps[n].kind for one in PLANS for n in (0, 1)] == [
        StepKind.RESET,
        StepKind.BOOT,
    ] * 2
    kinds = [step.kind for step in PLANS[0].steps]

    assert kinds.index(StepKind.POWER) > kinds.index(StepKind.ALONE)


FIRST_OF_KIND = {step.kind: step for step in reversed(PLANS[0].steps) if step.index}


@pytest.mark.parametrize("kind", [*FIRST_OF_KIND, StepKind.ALONE])
def test_each_step_touches_its_object(kind):
    step = FIRST_OF_KIND.get(kind)
    place = (0x1018, 4) if step is None else (step.index, step.sub)
    bench = Bench(hip={"mute": {place}})

    error = silent(bench)

    assert error.drive == "right/hip"
    assert f"{place[0]:04X}h:{place[1]:02X}" in error.what
    assert str(step or "alone")[:5] not in {p.text[:5] for p in bench.progress[-1:]}


def test_a_second_node_under_one_number_is_looked_for_before_the_drive_is_configured():
    bench = Bench(hip={"serials": (0x1111, 0x2222)})

    assert refused(bench).failure is BootFailure.DUPLICATE_NODE
    assert bench.hip.written == []


def test_a_drive_that_reboots_or_falls_silent_is_not_started():
    for misbehaves, kind in (
        ({"reboot_on_write": (0x6080, 0)}, BootFailure.REBOOTED),
        ({"no_heartbeat": True}, BootFailure.NO_HEARTBEAT),
    ):
        bench = Bench(hip=misbehaves)
        assert silent(bench).failure is kind
        assert START not in [data[:1] for data in bench.sent(0)]


@pytest.mark.parametrize("may_switch_off", [False, True])
def test_power_is_switched_off_where_that_was_requested(may_switch_off):
    bench = Bench(hip={"disabled_statusword": OFF})
    bench.hip.values[0x6041, 0] = ENABLED

    if may_switch_off:
        assert bench.run(may_switch_off=True)[0].statusword == OFF
        assert [w for w in bench.hip.written if w[0] == 0x6040] == [(0x6040, 0, 0x0000)]
        return
    assert failure(bring_up(bench.plans, bench.port, CYCLE), DrivePowered).drive == "right/hip"


# --- boot -----------------------------------------------------------------------------------------


def test_a_reset_counts_from_what_was_received_before_it(port, drives):
    drive_state = drives[0]
    port.after(0, port.boots)
    port.nodes[HIP].sdo_repeat_count = 4
    port.clock.time_ns += 3 * MS

    bringup._reset(drive_state, port)

    assert drive_state.reset_ns == port.began_ns + 3 * MS
    assert (drive_state.boot_up_count, drive_state.sdo_repeat_count) == (1, 4)
    assert port.sent == [Frame(0, bytes((0x82, HIP)))]


@pytest.mark.parametrize("boot_ms", [1, 1999, 2000])
def test_a_boot_up_message_is_waited_for_and_then_settles(port, drives, boot_ms):
    drive_state = drives[0]
    bringup._reset(drive_state, port)
    port.clock.time_ns += 500_000  # the reset counts, not the beginning of the wait
    port.after(boot_ms, port.boots)
    port.after(boot_ms + 50, port.boots)
    assert not drive_state.booted

    texts = set(bringup._await_boot(drive_state, port, "boots"))

    assert texts == {"boots"}
    assert port.now_ms == boot_ms + 50
    assert (drive_state.booted, drive_state.boot_up_count) == (True, 2)


@pytest.mark.parametrize("alone", [False, True])
def test_a_drive_that_does_not_boot_in_time_is_told_with_what_to_look_for(port, drives, alone):
    bringup._reset(drives[0], port)
    port.bus_state.alone = alone
    port.after(2001, port.boots)

    error = failure(bringup._await_boot(drives[0], port, "boots"))

    assert port.now_ms == 2000
    assert error.drive == "right/hip"
    assert error.failure is (BootFailure.NO_NODE if alone else BootFailure.NO_ANSWER)
    waited = "no boot-up message within 2 s of NMT reset communication"
    assert error.what == waited + (
        ", and no frame is acknowledged: is any drive powered and connected?"
        if alone
        else ": no power, no cable, another node id or bit rate?"
    )


# --- the same node, and no second one -------------------------------------------------------------


@pytest.mark.parametrize("booted", [False, True])
def test_another_boot_up_message_is_a_reboot_once_the_drive_has_booted(port, drives, booted):
    drives[0].booted = booted
    port.boots()

    if not booted:
        assert list(bringup._check_same(drives[0], port, "checks")) == []
        return
    error = failure(bringup._check_same(drives[0], port, "checks"))

    assert (error.drive, error.failure) == ("right/hip", BootFailure.REBOOTED)
    assert error.what == "it sent a boot-up message during bring-up, and has lost its configuration"
    assert port.now_ms == 40  # it was asked twice who it is


def test_a_drive_that_has_not_booted_again_is_not_asked(port, drives):
    drives[0].booted, drives[0].boot_up_count = True, 1
    port.boots()

    assert list(bringup._check_same(drives[0], port, "checks")) == []
    assert port.now_ms == 0


def test_a_reboot_of_a_drive_that_is_silent_is_told_as_a_reboot(port, drives):
    drives[0].booted = True
    port.boots()
    port.refuses[HIP] = SdoTimeout(0x1018, 4, 300 * MS)

    assert failure(bringup._check_same(drives[0], port, "checks")).failure is BootFailure.REBOOTED


def test_a_second_answer_since_the_reset_is_refused_whether_it_has_booted_or_not(port, drives):
    port.nodes[HIP].sdo_repeat_count = 4
    drives[0].sdo_repeat_count = 4
    assert list(bringup._check_same(drives[0], port, "checks")) == []

    port.nodes[HIP].sdo_repeat_count = 5
    error = failure(bringup._check_same(drives[0], port, "checks"), BringUpRefused)
    assert error.failure is BootFailure.DUPLICATE_NODE
    assert "node 5" in error.reason
    assert failure(bringup._alone(drives[0], port, "asks"), BringUpRefused).reason == error.reason


# --- power ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("may_switch_off", [False, True])
@pytest.mark.parametrize("statusword", [OFF, 0x0231, 0x0218])
def test_a_drive_without_power_is_left_as_it_is(port, drives, statusword, may_switch_off):
    port.values[HIP, 0x6041] = statusword
    port.values[SLIDE, 0x6041] = ENABLED

    allowed = drives if may_switch_off else ()

    assert list(bringup._without_power(POWER, drives[0], allowed, port)) == []
    assert port.written == []


@pytest.mark.parametrize("statusword", [SWITCHED_ON, ENABLED, BRAKING])
def test_a_drive_with_power_is_not_switched_off_unless_that_was_requested(port, drives, statusword):
    port.values[HIP, 0x6041] = statusword

    error = failure(bringup._without_power(POWER, drives[0], (), port), DrivePowered)

    assert error.drive == "right/hip"
    powered = PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE
    assert error.state in powered
    assert port.written == []


@pytest.mark.parametrize("slide", [OFF, ENABLED])
def test_all_drives_with_power_are_switched_off_at_once_and_no_other(port, drives, slide):
    port.values[HIP, 0x6041], port.values[SLIDE, 0x6041] = BRAKING, slide
    port.after(2999.9, lambda: port.values.update({(HIP, 0x6041): OFF}))

    texts = set(bringup._without_power(POWER, drives[0], drives, port))

    assert texts == {str(POWER)}
    assert port.now_ms == 2999.9
    powered = [HIP, SLIDE] if slide == ENABLED else [HIP]
    assert port.written == [(node, 0x6040, 0, b"\0\0") for node in powered]


def test_a_drive_that_keeps_its_power_is_told_with_its_state(port, drives):
    port.values[HIP, 0x6041] = BRAKING

    error = failure(bringup._without_power(POWER, drives[0], drives, port))

    assert port.now_ms == 3000
    assert (error.drive, error.failure) == ("right/hip", BootFailure.WRONG_STATE)
    assert error.what == "it stays in QUICK_STOP_ACTIVE after disable voltage"


@pytest.mark.parametrize(
    "refusal", [SdoTimeout(0x6040, 0, 300 * MS), SdoAborted(0x6040, 0, 0x0800_0000, "general")]
)
def test_disable_voltage_goes_to_every_drive_whatever_one_of_them_answers(port, drives, refusal):
    port.refuses[HIP] = refusal

    bringup._leave_without_power(drives, port)

    assert port.written == [(SLIDE, 0x6040, 0, b"\0\0")]


def test_disable_voltage_is_told_with_its_object(port, drives):
    port.refuses[HIP] = SdoAborted(0x6040, 0, 0x0800_0000, "general")
    port.values[HIP, 0x6041] = ENABLED
    steps = bringup._without_power(POWER, drives[0], drives, port)
    read = port.read
    port.read = lambda *place: bytes((0x37, 0x16))

    error = failure(steps, BringUpRefused)

    port.read = read
    assert (error.drive, error.place, error.value) == ("right/hip", "6040h:00", "0000h")
    assert error.reason == "refused with 08000000h, general (disable voltage)"


@pytest.mark.parametrize("may_switch_off", [False, True])
@pytest.mark.parametrize(
    ("misbehaves", "kind"),
    [
        ({"mute": {(0x6085, 0)}}, DriveSilent),
        ({"abort_write": {(0x6085, 0): 0x0609_0030}}, BringUpRefused),
    ],
)
def test_after_a_failure_nothing_but_a_requested_disable_voltage_is_sent(
    misbehaves, kind, may_switch_off
):
    bench = Bench(slide=misbehaves)

    with pytest.raises(kind):
        bench.run(may_switch_off=may_switch_off)

    for node in (bench.hip, bench.slide):
        words = [value for index, _, value in node.written if index == 0x6040]
        assert words == ([0] if may_switch_off else [])


def powered_bench():
    bench = Bench(
        hip={"disabled_statusword": OFF, "mute": {(0x6085, 0)}},
        slide={"disabled_statusword": OFF},
    )
    bench.hip.values[0x6041, 0] = bench.slide.values[0x6041, 0] = ENABLED
    return bench


def words_of_power(bench):
    return [
        [value for index, _, value in node.written if index == 0x6040]
        for node in (bench.hip, bench.slide)
    ]


def test_whatever_ends_a_bring_up_after_a_reset_leaves_no_drive_with_power():
    bench = powered_bench()
    read = bench.port.read

    def failing(node_id, index, sub):
        if index == 0x6502:
            raise ZeroDivisionError("ours")
        return read(node_id, index, sub)

    bench.port.read = failing
    with pytest.raises(ZeroDivisionError):
        bench.run(may_switch_off=True)

    assert words_of_power(bench) == [[0], [0]]


def test_what_fails_again_while_one_drive_is_switched_off_keeps_no_other_one_with_power():
    bench = powered_bench()
    steps = bring_up(bench.plans, bench.port, CYCLE, may_switch_off=True)
    while next(steps).done_count < 2:
        pass

    def failing():
        raise OSError("the disk is full")

    bench.port._meanwhile = failing
    with pytest.raises(OSError, match="full"):
        steps.close()

    assert words_of_power(bench) == [[0], [0]]


def test_a_bring_up_that_is_given_up_between_two_steps_leaves_no_drive_with_power():
    bench = powered_bench()
    steps = bring_up(bench.plans, bench.port, CYCLE, may_switch_off=True)
    while next(steps).done_count < 2:
        pass

    steps.close()

    assert words_of_power(bench) == [[0], [0]]


def test_a_bus_that_once_takes_no_frames_ends_a_bring_up_and_leaves_no_drive_with_power():
    bench = powered_bench()
    send = bench.bus.send_urgent
    steps = bring_up(bench.plans, bench.port, CYCLE, may_switch_off=True)
    while next(steps).done_count < 2:
        pass

    def full(frames, *_):
        bench.bus.send_urgent = send
        return len(frames)

    bench.bus.send_urgent = full
    with pytest.raises(BusError, match="transmit queue"):
        list(steps)

    assert words_of_power(bench) == [[0], [0]]


def test_after_the_controller_has_left_the_bus_nothing_is_sent():
    bench = Bench()
    bench.bus.put(Frame(0x040, bytes(8), is_error=True), 150 * MS)

    with pytest.raises(BusError):
        bench.run(may_switch_off=True)

    assert not bench.touched_power()


# --- heartbeat and start --------------------------------------------------------------------------


def test_a_new_heartbeat_in_pre_operational_is_waited_for(port, drives):
    port.beats(NmtState.PRE_OPERATIONAL)
    port.after(30, lambda: port.beats(NmtState.STOPPED))
    port.after(80, lambda: port.beats(NmtState.PRE_OPERATIONAL))

    assert set(bringup._await_heartbeat(drives[0], port, CYCLE, "hears")) == {"hears"}
    assert port.now_ms == 80


@pytest.mark.parametrize("beats", [False, True])
def test_without_a_heartbeat_in_pre_operational_it_is_told_what_came_instead(port, drives, beats):
    port.beats(NmtState.PRE_OPERATIONAL)
    if beats:
        port.after(30, lambda: port.beats(NmtState.STOPPED))
    port.after(81, lambda: port.beats(NmtState.PRE_OPERATIONAL))

    error = failure(bringup._await_heartbeat(drives[0], port, CYCLE, "hears"))

    assert port.now_ms == 80
    assert error.drive == "right/hip"
    assert error.failure is (BootFailure.WRONG_STATE if beats else BootFailure.NO_HEARTBEAT)
    shown = "STOPPED" if beats else "PRE_OPERATIONAL"
    assert error.what == f"no heartbeat in PRE-OPERATIONAL (it shows {shown})"


def test_all_drives_are_started_at_once_and_share_the_time_to_become_operational(port, drives):
    port.sync.frame()
    port.after(30, lambda: port.beats(NmtState.OPERATIONAL, HIP))
    port.after(80, lambda: port.beats(NmtState.OPERATIONAL, SLIDE))

    texts = list(bringup._start(drives, port, CYCLE))

    assert set(texts) == {"NMT start"}
    assert port.now_ms == 80
    assert port.sent == [Frame(0, b"\x01\x05"), Frame(0, b"\x01\x06")]
    assert port.sync.frame() == Frame(0x080, b"\x01")


def test_a_drive_that_does_not_start_is_named(port, drives):
    port.after(30, lambda: port.beats(NmtState.OPERATIONAL, HIP))
    port.after(40, lambda: port.beats(NmtState.STOPPED, SLIDE))

    error = failure(bringup._start(drives, port, CYCLE))

    assert port.now_ms == 80
    assert (error.drive, error.failure) == ("right/slide", BootFailure.WRONG_STATE)
    assert error.what == "it does not become OPERATIONAL after NMT start"


@pytest.mark.parametrize("number", [0, 1])
def test_each_drive_that_has_started_must_be_the_same_still(port, drives, number):
    for node in (HIP, SLIDE):
        port.beats(NmtState.OPERATIONAL, node)
    drives[number].booted = True
    port.boots((HIP, SLIDE)[number])

    error = failure(bringup._start(drives, port, CYCLE), text="NMT start")

    assert (error.drive, error.failure) == (drives[number].name, BootFailure.REBOOTED)


def test_that_drives_have_started_is_told_even_if_nothing_was_waited_for(port, drives):
    for node in (HIP, SLIDE):
        port.beats(NmtState.OPERATIONAL, node)

    assert list(bringup._start(drives, port, CYCLE)) == ["NMT start"]


# --- first samples --------------------------------------------------------------------------------

ALL_PDOS = (0x185, 0x285, 0x186, 0x286)


def sized(port, drives):
    """What each drive sends after a SYNC, in the lengths that are mapped."""
    for one in drives:
        for layout in bringup._cyclic(one):
            port.samples(layout.can_id, size=layout.size)


@pytest.mark.parametrize("needed", [1, 2, 20])
def test_samples_of_all_drives_after_one_of_twenty_syncs(port, drives, needed):
    port.at_sync = lambda: sized(port, drives) if len(port.sent) >= needed else None

    assert set(bringup._first_samples(drives, port, CYCLE)) == {"first samples"}
    assert port.sent == [Frame(0x080, bytes((1 + n % 3,))) for n in range(needed)]
    assert port.now_ms == 10 * needed


@pytest.mark.parametrize("left_out", ALL_PDOS)
def test_a_drive_of_which_a_part_of_the_sample_is_missing_is_named(port, drives, left_out):
    pdos = [one for one in ALL_PDOS if one != left_out]
    port.samples(*ALL_PDOS)  # from before
    port.at_sync = lambda: port.samples(*pdos)

    error = failure(bringup._first_samples(drives, port, CYCLE))

    assert port.now_ms == 200
    assert error.drive == ("right/hip" if left_out & 0x7F == HIP else "right/slide")
    assert error.failure is BootFailure.NO_SAMPLES
    assert error.what == "no complete sample within 20 SYNCs"


@pytest.mark.parametrize("number", [0, 1])
def test_each_drive_that_has_sent_its_sample_must_be_the_same_still(port, drives, number):
    port.at_sync = lambda: sized(port, drives)
    drives[number].booted = True
    port.boots((HIP, SLIDE)[number])

    error = failure(bringup._first_samples(drives, port, CYCLE), text="first samples")

    assert (error.drive, error.failure) == (drives[number].name, BootFailure.REBOOTED)


@pytest.mark.parametrize("can_id", ALL_PDOS)
@pytest.mark.parametrize("more", [-1, 1])
def test_a_sample_of_another_length_than_mapped_is_refused(port, drives, can_id, more):
    sized(port, drives)
    data = port.nodes[can_id & 0x7F].pdo_data
    size = len(data[can_id])
    data[can_id] = bytes(size + more)
    port.at_sync = lambda: None if len(port.sent) > 1 else counted()

    def counted():
        for one in ALL_PDOS:
            port.nodes[one & 0x7F].pdo_count[one] += 1

    error = failure(bringup._first_samples(drives, port, CYCLE), BringUpRefused)

    assert error.drive == ("right/hip" if can_id & 0x7F == HIP else "right/slide")
    assert error.failure is BootFailure.CONFIGURATION
    found = f"TPDO{can_id >> 8}"
    assert found in error.reason
    assert f"has {size + more} bytes instead of the {size} that are mapped" in error.reason


# --- other masters --------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["listens", "reset", "NMT start", "first samples"])
@pytest.mark.parametrize("foreign", [SYNC, Frame(0x701, b"\x05")])
def test_another_master_is_found_at_whatever_step_it_begins(text, foreign):
    bench = Bench()
    steps = bring_up(bench.plans, bench.port, CYCLE)
    while not next(steps).text.startswith(text):
        pass
    bench.bus.put(foreign)
    bench.port.wait(bench.clock.now_ns())

    with pytest.raises(DriveSilent) as caught:
        next(steps)

    error = caught.value
    assert (error.drive, error.failure) == ("", BootFailure.FOREIGN_MASTER)


# --- report ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "torque"), [("epos4", (0x30D1, 2)), ("generic", (0x6077, 0))])
def test_a_report_says_what_the_drive_has_shown(kind, torque):
    bench = Bench(kind, hip={"stored": {(0x1018, 4): 0x1234}})
    values = bench.hip.values
    values[0x6041, 0], values[0x6064, 0], values[torque] = 0x8218, -4096, -7
    values[0x603F, 0], values[0x1001, 0] = 0x8130, 0x11
    for number, code in enumerate(("0000", "3081", "2073")):
        data = bytes.fromhex(code) + bytes((0x11, 0, 0, 0, 0, 0))
        bench.bus.put(Frame(0x085, data), (10 + number) * MS)
    bench.bus.put(Frame(0x085, b"\x30\x81"), 20 * MS)

    hip, slide = bench.run()

    description = bench.plans[0].description
    refs = description.profile.torque_base
    raw = (
        None if ref is None else values[ref.index, ref.sub]
        for ref in (refs.rated_torque, refs.rated_current, refs.torque_constant)
    )
    text, *_ = [one.text for one in hip.emergencies]
    assert hip == DriveReport(
        name="right/hip",
        base=base_from_raw(description, *raw),
        power_state=PowerState.FAULT,
        statusword=0x8218,
        position_counts=-4096,
        torque_raw=-7,
        absolute=description.axis.encoder.absolute,
        serial_number=0x1234,
        homed=kind == "epos4",
        error_register=0x11,
        error_code=0x8130,
        error_text=text,
        emergencies=hip.emergencies,
        reference_lost=any(one.loses_reference for one in hip.emergencies),
    )
    assert [(one.node_id, one.code, one.time_ns) for one in hip.emergencies] == [
        (HIP, 0x8130, 0),
        (HIP, 0x7320, 0),
    ]
    assert "heartbeat" in hip.error_text
    assert hip.reference_lost
    assert (slide.error_code, slide.error_text, slide.emergencies) == (0, "", ())
    assert (slide.homed, slide.reference_lost) == (False, False)


@pytest.mark.parametrize(("statusword", "homed"), [(0x1240, True), (0x2A40, False)])
def test_the_bit_that_the_profile_names_says_whether_the_drive_is_homed(statusword, homed):
    bench = Bench()
    description = bench.plans[0].description
    profile = msgspec.structs.replace(description.profile, referenced_bit=12)
    description = dataclasses.replace(description, profile=profile)
    bench.plans = (plan(description, HIP_LIMITS, CYCLE), bench.plans[1])
    bench.hip.values[0x6041, 0] = statusword

    hip, _ = bench.run()

    assert hip.homed is homed


def test_a_position_of_too_few_bytes_is_refused(port, drives):
    port.read = lambda *place: b"\0\0"
    seed = FIRST_OF_KIND[StepKind.SEED_POSITION]

    error = failure(bringup._run(seed, drives[0], (), port, CYCLE), BringUpRefused)

    assert (error.place, error.reason) == ("6064h:00", "2 bytes instead of 4 (position)")


@pytest.mark.parametrize("position", [-30_000, -100, 30_000])
def test_the_target_is_seeded_within_the_limits(position):
    bench = Bench()
    bench.hip.values[0x6064, 0] = position

    bench.run()

    low, high = bench.hip.values[0x607D, 1], bench.hip.values[0x607D, 2]
    assert bench.hip.values[0x607A, 0] == min(max(position, low), high)
    assert low < -100 < high
