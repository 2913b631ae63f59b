"""The parts of a gateway, each without the others."""

from types import SimpleNamespace

import pytest
from gaitd_client import wire
from gaitd_names import Mode

from daemon.gateway import events
from daemon.gateway.control import Control, Ending
from daemon.gateway.core_view import SILENCE_NS, CoreView
from daemon.gateway.events import EventLog
from daemon.gateway.machine_messages import DRIVES_PERIOD_NS, MachineMessages
from daemon.ipc.transport import RingError

UTC_NS = 1_760_000_000_000_000_000
CLOCK = SimpleNamespace(utc_ns=lambda: UTC_NS)
LEASES = SimpleNamespace(holder=None)


class Link:
    """A core's channel that fails, or has the records that a test gives."""

    header = None
    starting = False
    error = ""

    def records(self):
        if self.error:
            raise RingError(self.error)
        return []


@pytest.fixture
def outlet(bench):
    bench.outlet.said.clear()
    return bench.outlet


@pytest.fixture
def core(make_record):
    view = CoreView(Link())
    view.boot_id, view.newest = "boot", make_record(7)
    view.records_arrive(0)
    return view


def test_the_core_falls_silent_once_and_its_newest_record_is_kept(core):
    assert not core.falls_silent(SILENCE_NS)
    assert core.record is core.newest

    assert [core.falls_silent(SILENCE_NS + 1) for _ in range(2)] == [True, False]

    assert core.record is None
    assert core.newest is not None
    assert (core.stamp.core_boot_id, core.stamp.cycle) == ("boot", 7)


def test_a_ring_that_cannot_be_read_is_logged_once_until_it_is_read_again(core, caplog):
    for error in ("torn", "torn", "", "torn"):
        core.link.error = error
        assert core.read() == []

    assert [line.message for line in caplog.records] == ["torn", "torn"]


def test_events_are_numbered_from_one_after_each_record(core, outlet, make_record):
    log = EventLog(outlet, core, CLOCK)
    log.publish([events.CORE_BACK, events.CORE_BACK])
    core.newest = make_record(8)
    log.publish([events.CORE_BACK], time_ns=5)

    made = list(log.history)
    assert [event.id for event in made] == ["boot-7-1", "boot-7-2", "boot-8-1"]
    assert [event.time_ns for event in made] == [UTC_NS, UTC_NS, 5]
    assert outlet.events[-3:] == made


def test_drives_are_published_when_they_are_due_and_safety_when_it_changes(core, outlet):
    machine = MachineMessages(outlet, core, LEASES)
    for now_ns in (DRIVES_PERIOD_NS, DRIVES_PERIOD_NS + 1, 2 * DRIVES_PERIOD_NS):
        machine.publish_drives(now_ns)
        machine.publish_safety(is_due=False)
    assert len(outlet.on("drives/right/hip")) == 2
    assert len(outlet.on("safety")) == 1

    core.falls_silent(SILENCE_NS + 1)
    machine.publish_safety(is_due=False)
    machine.publish_safety(is_due=True)
    assert [said.valid for said in outlet.on("safety")] == [True, False, False]


@pytest.mark.parametrize(
    ("mode", "is_waiting", "trouble", "code"),
    [
        (Mode.GAIT, False, "", "would_stop"),
        (Mode.STOPPING, False, "", "would_stop"),
        (Mode.READY, True, "", "answer_outstanding"),
        (Mode.READY, False, "no key", "keys_unusable"),
        (Mode.READY, False, "", None),
    ],
)
def test_a_restart_that_could_do_harm_is_refused(
    core, make_record, mode, is_waiting, trouble, code
):
    core.newest = make_record(8, mode=mode)
    queue = SimpleNamespace(is_waiting=is_waiting)
    ending = Ending(core, queue, lambda: trouble)

    refusal = ending.request_restart()

    assert (refusal and refusal.code) == code
    assert ending.restart_requested == ending.may_end == (code is None)
    assert (ending.refusal and ending.refusal.code) == (None if code else "gateway_restarts")


def test_a_query_that_fails_is_answered_and_the_next_is_served(core, outlet, ask):
    def inform(name, head):
        if name == "config":
            raise ZeroDivisionError("a bug")
        return wire.Schemas(**head, schemas={})

    clients = SimpleNamespace(have_keys=False, role=lambda name, client: None)
    queue = SimpleNamespace(withdraw=lambda ticket: None)
    log = EventLog(outlet, core, CLOCK)
    control = Control(outlet, core, log, queue, None, clients, None, None, inform)
    broken, served = ask("config"), ask("schema")

    control.receive([broken, served], 0)

    assert broken.failed
    assert broken.replies[0].refusal.code == "gateway_failed"
    assert isinstance(served.replies[0], wire.Schemas)
    assert log.history[-1].code == "query_failed"
