"""An axis never holds alone: when one has to be taken further, the other leaves its hold too."""

from gaitd_names import Cause, EventCode, StopCategory
from sessions import reported

from drives.signals import PowerState


def test_a_hold_that_one_axis_does_not_obey_is_a_quick_stop_of_both_in_the_same_cycle(warm_hold):
    warm_hold.gateway.stop()
    warm_hold.run(0.5)
    assert warm_hold.record.verdict.category == StopCategory.S2

    begun = len(warm_hold.bus.sent)
    warm_hold.command("patient spasm")
    warm_hold.command("wrong_sign right/slide 1.0")
    disobeyed = warm_hold.run_until(
        lambda record: record.verdict.cause == Cause.STOP_NOT_OBEYED, within_s=5
    )
    warm_hold.run(0.05)

    sent = warm_hold.bus.sent[begun:]
    last_enabled_ns = {
        node: max(
            frame.time_ns
            for frame in sent
            if frame.can_id == 0x200 + node and frame.data[0] & 0x8F == 0x0F
        )
        for node in (5, 6)
    }
    assert disobeyed.verdict.drive in {"right/hip", "right/slide"}
    assert last_enabled_ns[5] == last_enabled_ns[6]
    states = {drive.power_state for drive in warm_hold.record.drives}
    assert PowerState.OPERATION_ENABLED not in states


def test_two_axes_that_fail_in_the_same_cycle_are_each_stopped_by_their_own_cause(warm_hold):
    warm_hold.command("encoder_glitch right/hip - 3000")
    warm_hold.command("encoder_glitch right/slide - 30000")
    warm_hold.run(1)

    also = reported(warm_hold.records, EventCode.FURTHER_CAUSE)
    states = {drive.power_state for drive in warm_hold.record.drives}
    assert warm_hold.record.verdict.cause == Cause.ENCODER_JUMP
    assert "right/slide" in {event.subject for event in also}
    # No axis is asked to hold by an encoder that cannot be trusted.
    assert states <= {PowerState.SWITCH_ON_DISABLED, PowerState.FAULT}


def test_two_drives_that_are_lost_together_are_both_told_to_stop(warm_hold):
    warm_hold.command("silent right/hip")
    warm_hold.command("silent right/slide")
    warm_hold.run(0.5)

    stops = {
        frame.data[1] for frame in warm_hold.bus.sent if frame.can_id == 0 and frame.data[0] == 2
    }
    assert stops == {5, 6}
