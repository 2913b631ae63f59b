"""A request is done when the drives show that it is, and refused with the drive's reason if not."""

import pytest
from gaitd_names import Cause, Finding, Mode, Outcome, RefusalCode, RequestKind
from sessions import new_session

from daemon.ipc.report import Refusal
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

FAULT_RESET = 0x80
SLIDE_WORDS = 0x206
"""COB-ID of the RPDO that carries the slide's controlword."""


def in_fault() -> LockstepSession:
    """Stopped by a fault of the slide's drive whose cause lasts."""
    session = new_session().until_ready()
    session.command("emcy right/slide - 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=1)
    return session


def edges(session: LockstepSession) -> int:
    words = [frame.data[0] for frame in session.bus.sent if frame.can_id == SLIDE_WORDS]
    return words.count(FAULT_RESET)


def test_a_reset_is_refused_with_the_drives_reason_while_fault_and_cause_persist():
    session = in_fault()

    answer = session.request(RequestKind.RESET)

    assert answer.outcome == Outcome.REFUSED
    verdict = session.record.verdict
    assert answer.refusal == Refusal(
        RefusalCode.STOPPED, "right/slide", verdict.values, verdict.said
    )
    assert session.record.mode == Mode.FAULT
    assert verdict.cause == Cause.DRIVE_FAULT
    assert (verdict.finding, verdict.value) == (Finding.ERROR_CODE, 0x2310)
    assert edges(session) == 1
    session.command("clear emcy right/slide")
    assert session.request(RequestKind.RESET).outcome == Outcome.DONE
    assert edges(session) == 2


def test_a_fault_that_comes_back_at_once_is_not_reset():
    session = in_fault()
    session.command("clear emcy right/slide")
    session.gateway.request(RequestKind.RESET)
    session.run_until(
        lambda record: (
            record.mode == Mode.READY
            and record.drives[1].power_state == PowerState.SWITCH_ON_DISABLED
        ),
        within_s=5,
    )
    session.run(0.1)
    session.command("emcy right/slide - 0x3210")

    session.run_until(lambda _: session.gateway.outcome().outcome != Outcome.PENDING, within_s=5)

    answer = session.gateway.outcome()
    assert answer.outcome == Outcome.REFUSED
    assert 0x3210 in answer.refusal.values
    assert edges(session) == 1


@pytest.mark.parametrize("slower", ["right/hip", "right/slide"])
def test_a_disable_is_done_when_both_drives_show_that_they_have_left_operation_enabled(
    warm_hold, slower
):
    warm_hold.command(f"slow_state {slower} - 100")

    assert warm_hold.request(RequestKind.DISABLE).outcome == Outcome.DONE

    states = {drive.power_state for drive in warm_hold.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}
