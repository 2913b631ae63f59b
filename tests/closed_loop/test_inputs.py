"""The inputs that the drives see (60FDh): hand switch, STO, limit switches; both kinds of drive."""

from functools import partial

import pytest
from gaitd_names import Cause, Mode, RequestKind, Stage
from sessions import (
    changed_configs,
    elsewhere,
    new_session,
    reaches_rest_in_fault,
)
from wire import change_what_drives_say

from daemon.ipc.record import ModeRequest

INPUT_BITS = {"hand_switch_closed": 16, "sto_released": 17}


def wired_the_other_way(folder):
    """A session whose inputs are low where they were high, in axis files and on the wire."""
    changes = [
        (
            f"drives/{axis}_epos4.toml",
            *(f"{name} = {{ bit = {bit}, level = {level} }}" for level in (1, 0)),
        )
        for axis in ("hip", "slide")
        for name, bit in INPUT_BITS.items()
    ]
    session = new_session(changed_configs(folder, *changes))

    def invert(frame):
        if frame.can_id not in {0x285, 0x286}:
            return frame
        inputs = int.from_bytes(frame.data[4:], "little") ^ sum(
            1 << bit for bit in INPUT_BITS.values()
        )
        return frame._replace(data=frame.data[:4] + inputs.to_bytes(4, "little"))

    change_what_drives_say(session, invert)
    return session


def walking(session):
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=60.0)
    session.execute(RequestKind.MODE, gait)
    session.run(1.0)


def guided_by_hand(session):
    session.execute(RequestKind.MODE, ModeRequest(Mode.HAND_GUIDING))
    session.run_until(lambda record: record.stage is Stage.PLAYING, within_s=2)


@pytest.mark.parametrize(
    ("guidance", "begin", "axis"),
    [
        ("impedance", guided_by_hand, "right/slide"),
        ("position", walking, "right/hip"),
    ],
)
def test_inputs_that_no_wiring_can_produce_are_a_quick_stop_of_both_drives(
    warm_guided_hold, begin, axis
):
    begin(warm_guided_hold)

    warm_guided_hold.command(f"tpdo_all_ones {axis} - 2")
    warm_guided_hold.run(0.03)

    record = warm_guided_hold.record
    assert (record.verdict.cause, record.verdict.drive) == (Cause.INPUTS_IMPOSSIBLE, axis)
    reaches_rest_in_fault(warm_guided_hold)
    drive = next(drive for drive in warm_guided_hold.record.drives if drive.name == axis)
    assert not drive.hand_switch_closed
    assert not drive.sto_released


def test_a_drive_whose_inputs_cannot_be_is_a_fault_before_it_has_power(warm_ready):
    warm_ready.command("tpdo_all_ones right/hip - 2")
    warm_ready.run(0.05)

    record = warm_ready.record
    assert (record.mode, record.verdict.cause) == (Mode.FAULT, Cause.INPUTS_IMPOSSIBLE)
    stored = warm_ready.core.persistent.inputs.get("right/hip")
    assert stored is None or not (stored.hand_switch_open_utc_ns or stored.sto_active_utc_ns)
    warm_ready.command("clear tpdo_all_ones right/hip")
    warm_ready.execute(RequestKind.RESET)
    warm_ready.until_ready().enable()


def with_effort(raw):
    return lambda frame: (
        frame._replace(data=raw.to_bytes(4, "little", signed=True) + frame.data[4:])
        if frame.can_id == 0x285
        else frame
    )


def test_an_effort_that_no_drive_gives_is_no_effort_and_accuses_no_encoder(warm_hold):
    change_what_drives_say(warm_hold, with_effort(-(2**31)))
    warm_hold.run(0.03)

    verdict = warm_hold.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.EFFORT_DEVIATION, "right/hip")


def test_an_effort_that_stays_the_same_while_the_joint_moves_is_not_measured(warm_position_gait):
    change_what_drives_say(warm_position_gait, with_effort(900))
    stopped = warm_position_gait.run_until(lambda record: not record.mode.active, within_s=2.5)

    assert stopped.verdict.drive == "right/hip"
    assert stopped.verdict.cause == Cause.EFFORT_DEVIATION


def stopped_by(fault, session):
    session.command(f"{fault} right/hip")
    stopped = session.run_until(lambda record: not record.mode.active, within_s=1)
    session.run(0.05)
    return stopped.mode, session.record.verdict.cause


def test_an_input_of_the_other_level_means_the_same(tmp_path):
    session = wired_the_other_way(tmp_path).enable()

    for fault, cause in (
        ("hand_switch_open", Cause.HAND_SWITCH_OPEN),
        ("sto_open", Cause.STO_ACTIVE),
    ):
        assert elsewhere(session, partial(stopped_by, fault)) == (Mode.STOPPING, cause)


def test_a_joint_that_stands_on_its_limit_switch_may_be_enabled_and_moves_away(tmp_path):
    """It stands above mid pose with its upper switch pressed: downwards is free, upwards is not."""
    session = new_session(
        changed_configs(
            tmp_path, ("plant.toml", "hip.position_deg = 13.98", "hip.position_deg = 20.0")
        )
    )

    def press(frame):
        if frame.can_id != 0x285:
            return frame
        inputs = int.from_bytes(frame.data[4:], "little") | 0b10
        return frame._replace(data=frame.data[:4] + inputs.to_bytes(4, "little"))

    change_what_drives_say(session, press)
    session.enable()
    begun_rad = session.record.legs[0].hip.measured_position
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=1.0, duration_s=20.0)
    session.request(RequestKind.MODE, gait)
    session.run_until(lambda record: record.stage is Stage.PLAYING, within_s=20)
    away_rad = session.record.legs[0].hip.measured_position

    stopped = session.run_until(lambda record: not record.mode.active, within_s=10)

    assert away_rad < begun_rad - 0.05
    assert stopped.verdict.cause == Cause.LIMIT_SWITCH
