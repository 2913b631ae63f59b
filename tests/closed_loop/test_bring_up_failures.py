"""What fails in bringing up the drives, as an operator hears it: mode, verdict, events, exit."""

from dataclasses import replace

import msgspec
import pytest
from gaitd_names import Cause, EventCode, ExitCode, Mode
from sessions import new_session, reported

from drives.canopen.bus import Frame
from drives.errors import BootFailure
from gaitd_lab.lockstep import LockstepSession


def with_identity(session, **changes):
    """The same machine, and files that describe another hip drive."""
    leg = session.settings.legs[0]
    identity = msgspec.structs.replace(leg.hip.axis.identity, **changes)
    hip = replace(leg.hip, axis=msgspec.structs.replace(leg.hip.axis, identity=identity))
    settings = replace(session.settings, legs=(replace(leg, hip=hip),))
    return LockstepSession(settings, session.machine)


@pytest.mark.parametrize(
    ("changes", "failure"),
    [
        ({"vendor_id": 0x9A}, BootFailure.WRONG_VENDOR),
        ({"serial": 0x1234}, BootFailure.WRONG_SERIAL_NUMBER),
    ],
    ids=["vendor", "serial number"],
)
def test_a_refused_drive_ends_the_service_with_3_and_its_failure_is_in_verdict_and_events(
    changes, failure
):
    session = with_identity(new_session(), **changes)

    code = session.loop.run(lambda: False)

    record = session.record
    assert code == ExitCode.DRIVE == 3
    assert record.verdict.cause == Cause.BRING_UP_FAILED
    assert record.verdict.drive == "right/hip"
    assert record.verdict.said.startswith(str(failure))
    (failed,) = reported(session.records, EventCode.BRING_UP_FAILED)
    assert (failed.subject, failed.values) == ("right/hip", (Cause.BRING_UP_FAILED,))
    assert failed.said.startswith(str(failure))
    assert b"\x01\x05" not in [f.data for f in session.bus.sent if f.can_id == 0]


def test_a_silent_drive_is_mode_off_with_its_failure_told_once_and_looked_for_again():
    session = new_session()
    session.command("unplugged right/slide")

    session.run(5)

    record = session.record
    assert record.mode in {Mode.OFF, Mode.BRINGING_UP}
    assert record.verdict.cause == Cause.DRIVE_SILENT
    assert record.verdict.drive == "right/slide"
    assert record.verdict.said.startswith(str(BootFailure.NO_ANSWER))
    (failed,) = reported(session.records, EventCode.BRING_UP_FAILED)
    assert (failed.subject, failed.values) == ("right/slide", (Cause.DRIVE_SILENT,))
    session.command("clear unplugged right/slide")
    session.run_until(lambda r: r.mode == Mode.READY, within_s=20)


def test_another_master_keeps_the_drives_down_until_it_has_gone():
    session = new_session()
    bus = session.bus
    wait = bus.link.wait
    there = [True]

    def wait_beside_another(until_ns, *, for_frame):
        wait(until_ns, for_frame=for_frame)
        if there[0]:
            bus.seat.waiting.append(Frame(0x080, b""))

    bus.link.wait = wait_beside_another
    session.run(2)
    beside = session.record
    there[0] = False
    session.run_until(lambda record: record.mode == Mode.READY, within_s=20)

    assert beside.mode in {Mode.OFF, Mode.BRINGING_UP}
    assert beside.verdict.said.startswith(str(BootFailure.FOREIGN_MASTER))


def test_an_error_that_a_drive_came_with_is_told_and_stops_nothing_later():
    session = new_session()
    code = 0x8130

    def with_error(time_ns, advance=session.machine.world.advance_to):
        sent = advance(time_ns)
        booted = [frame for frame in sent if frame.can_id == 0x705 and frame.data == b"\0"]
        data = code.to_bytes(2, "little") + bytes((0x11, 0, 0, 0, 0, 0))
        return sent + [frame._replace(can_id=0x085, data=data) for frame in booted]

    session.machine.world.advance_to = with_error
    session.until_ready()

    (emergency,) = reported(session.records, EventCode.EMCY_IN_BRING_UP)
    assert (emergency.subject, emergency.values) == ("right/hip", (code,))
    assert session.record.verdict.cause == Cause.NONE
