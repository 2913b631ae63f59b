"""A request is done when the drives show that it is, and refused with the drive's reason if not."""

from gaitd_names import Cause, Finding, Mode, Outcome, RefusalCode, RequestKind

from daemon.ipc.report import Refusal
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

FAULT_RESET = 0x80
SLIDE_WORDS = 0x206
"""COB-ID of the RPDO that carries the slide's controlword."""


def edges(session: LockstepSession) -> int:
    words = [frame.data[0] for frame in session.bus.sent if frame.can_id == SLIDE_WORDS]
    return words.count(FAULT_RESET)


def test_a_reset_is_refused_with_the_drives_reason_while_fault_and_cause_persist(warm_ready):
    session = warm_ready
    session.command("emcy right/slide - 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=1)

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


def test_a_disable_is_done_when_both_drives_show_that_they_have_left_operation_enabled(warm_hold):
    warm_hold.command("slow_state right/slide - 100")

    assert warm_hold.request(RequestKind.DISABLE).outcome == Outcome.DONE

    states = {drive.power_state for drive in warm_hold.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}
