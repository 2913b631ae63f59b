"""An exception in a cycle is a bug of ours: it stops the machine before it ends the process."""

from unittest import mock

import pytest
from gaitd_names import Cause, ExitCode, Mode, RequestKind
from wire import rpdo1

from daemon.core.runtime.shutdown import STOP_WITHOUT_FEEDBACK_CYCLES
from daemon.core.safety import checks
from daemon.core.steps import estimation
from drives.signals import Input, PowerState

RESET_COMMUNICATION = 0x82
QUICK_STOP, DISABLE_VOLTAGE = 0x02, 0x00


def run_into_a_bug(session):
    """The frames that the core sends, and the code that it ends with."""
    before = len(session.bus.sent)
    with mock.patch.object(checks, "check_raw", side_effect=ZeroDivisionError("ours")):
        code = session.loop.run(lambda: False)
    return session.bus.sent[before:], code


def test_an_exception_in_a_cycle_stops_both_drives_and_ends_as_our_bug(warm_guided_gait, guidance):
    stood = [drive.sensed.feedback.position_counts for drive in warm_guided_gait.core.axes]

    sent, code = run_into_a_bug(warm_guided_gait)

    words = {
        int.from_bytes(frame.data[:2], "little") for frame in sent if frame.can_id in {0x205, 0x206}
    }
    truth = warm_guided_gait.truth.rows[-1]
    assert code == ExitCode.UNAVAILABLE
    assert isinstance(warm_guided_gait.loop.bug, ZeroDivisionError)
    assert words == {QUICK_STOP}
    for node, counts in zip((5, 6), stood, strict=True):
        told = rpdo1(sent, node)
        assert {one.mode for one in told} == {10 if guidance == "impedance" else 8}
        assert all(abs(one.target_counts - counts) < 200 for one in told)
    assert sum(frame.can_id == 0x080 for frame in sent) >= STOP_WITHOUT_FEEDBACK_CYCLES
    assert abs(truth.hip_velocity_rad_per_s) < 0.05
    assert abs(truth.slide_velocity_m_per_s) < 0.05


@pytest.mark.parametrize(("with_power", "watched"), [(True, {0x05, 0x06}), (False, set())])
def test_a_drive_that_holds_the_leg_after_a_stop_keeps_its_watch_on_the_core(
    warm_gait, with_power, watched
):
    session = warm_gait
    session.gateway.stop() if with_power else session.request(RequestKind.DISABLE)
    session.until(Mode.FAULT if with_power else Mode.READY)
    session.run(0.5)
    shown = {drive.power_state for drive in session.record.drives}
    assert (PowerState.OPERATION_ENABLED in shown) == with_power

    sent, _ = run_into_a_bug(session)

    nmt = [frame.data for frame in sent if frame.can_id == 0x000]
    reset = {node for command, node in nmt if command == RESET_COMMUNICATION}
    assert reset == {0x05, 0x06} - watched


def test_an_exception_in_the_estimate_loses_nothing_that_raw_values_of_its_cycle_show(warm_gait):
    session, estimate = warm_gait, estimation.estimate
    raised: list[int] = []

    def failing(*arguments):
        if any(Input.STO_RELEASED not in axis.sensed.feedback.inputs for axis in session.core.axes):
            raised.append(1)
            raise ZeroDivisionError("ours")
        return estimate(*arguments)

    session.command("sto_open *")
    sent = len(session.bus.sent)
    with mock.patch.object(estimation, "estimate", failing):
        code = session.loop.run(lambda: False)

    stored = session.core.persistent.latched
    assert (code, len(raised)) == (ExitCode.UNAVAILABLE, 1)
    assert (session.core.mode, stored.cause) == (Mode.STOPPING, Cause.STO_ACTIVE)
    assert session.state_file.persistent.latched == stored
    assert [rpdo1(session.bus.sent[sent:], node)[-1].controlword for node in (5, 6)] == [
        DISABLE_VOLTAGE
    ] * 2
