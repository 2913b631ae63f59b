"""What each drive should do, from mode, stop and single axis."""

from types import SimpleNamespace

import pytest
from gaitd_names import Mode
from step_inputs import a_core, a_leg, an_axis

from daemon.core.safety.stop_sequence import Step
from daemon.core.steps import wanted
from drives.signals import OperationMode

CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION
HOMING = OperationMode.HOMING


def stopped(step):
    return None if step is None else SimpleNamespace(step=step)


def core_of(*steps, mode=Mode.HOLD, guidance="impedance", run=None, sent=HOMING):
    """A core whose hip and slide have these steps of a stop, and were sent this mode."""
    axes = [
        an_axis(name, stop=stopped(step), node_id=node_id, mode=sent)
        for name, node_id, step in zip(("right/hip", "right/slide"), (5, 6), steps, strict=True)
    ]
    config = SimpleNamespace(by_position=guidance == "position")
    return a_core(a_leg(*axes), mode=mode, single_axis=run, config=config)


@pytest.mark.parametrize(
    ("mode", "step", "is_driving", "enable"),
    [
        (Mode.READY, None, False, False),
        (Mode.HOLD, None, True, True),
        (Mode.GAIT, None, True, True),
        (Mode.TORQUE, None, True, True),
        (Mode.OFF, None, False, False),
        (Mode.STOPPING, None, True, False),
        (Mode.STOPPING, Step.HOLD, True, True),
        (Mode.STOPPING, Step.QUICK_STOP, True, False),
        (Mode.FAULT, None, False, False),
        (Mode.FAULT, Step.HOLD, True, True),
        (Mode.FAULT, Step.QUICK_STOP, True, False),
        (Mode.FAULT, Step.DISABLE, False, False),
        (Mode.BRINGING_UP, Step.HOLD, False, True),
        (Mode.READY, Step.QUICK_STOP, False, False),
    ],
)
def test_drives_are_driven_while_a_mode_or_a_stop_keeps_their_power(mode, step, is_driving, enable):
    core = core_of(None, step, mode=mode)

    assert wanted.is_driving(core) is is_driving
    assert wanted.enable_wanted(core, core.axes[1]) is enable


@pytest.mark.parametrize(
    ("axis", "enable"), [("right/hip", [True, False]), ("right/slide", [False, True])]
)
def test_a_single_axis_alone_is_enabled(axis, enable):
    core = core_of(None, None, mode=Mode.REFERENCE, run=SimpleNamespace(axis=axis))

    assert [wanted.enable_wanted(core, one) for one in core.axes] == enable


@pytest.mark.parametrize(
    ("step", "nmt_stopped", "silenced"),
    [
        (None, (), False),
        (Step.DISABLE, (), False),
        (Step.NMT_STOP, (6,), False),
        (Step.SILENCE, (6,), True),
    ],
)
def test_the_last_steps_of_a_stop_name_its_drives(step, nmt_stopped, silenced):
    core = core_of(None, step)

    assert wanted.nmt_stopped(core) == nmt_stopped
    assert wanted.is_silenced(core) is silenced


@pytest.mark.parametrize(
    ("mode", "guidance", "step", "run", "of_hip", "of_slide"),
    [
        (Mode.HOLD, "impedance", None, None, CST, CST),
        (Mode.HOLD, "position", None, None, CSP, CSP),
        (Mode.READY, "position", None, None, CSP, CSP),
        (Mode.HOLD, "position", Step.HOLD, None, HOMING, CSP),
        (Mode.TORQUE, "position", None, None, CST, CST),
        (Mode.COMMISSION, "position", None, False, CST, CST),
        (Mode.READY, "position", None, False, CST, CST),
        (Mode.REFERENCE, "position", None, True, HOMING, CST),
    ],
)
def test_the_mode_of_operation_follows_from_mode_guidance_and_single_axis(
    mode, guidance, step, run, of_hip, of_slide
):
    made = None if run is None else SimpleNamespace(axis="right/hip", by_drive=run)
    core = core_of(step, None, mode=mode, guidance=guidance, run=made)

    assert [wanted.mode_wanted(core, axis) for axis in core.axes] == [of_hip, of_slide]


@pytest.mark.parametrize(
    ("sent", "by_position", "changing"),
    [
        ((CST, CST), False, False),
        ((CSP, CST), False, True),
        ((CST, HOMING), False, True),
        ((CST, CSP), True, True),
    ],
)
def test_a_mode_is_changing_until_each_drive_has_been_sent_it(sent, by_position, changing):
    axes = [an_axis(mode=one) for one in sent]
    core = a_core(a_leg(*axes), config=SimpleNamespace(by_position=by_position))

    assert wanted.is_mode_changing(core) is changing


@pytest.mark.parametrize(
    ("steps", "wants"),
    [
        ((None, None), True),
        ((Step.DISABLE, None), True),
        ((None, Step.DISABLE), True),
        ((Step.DISABLE, Step.DISABLE), False),
    ],
)
def test_a_leg_is_enabled_if_one_of_its_drives_is(steps, wants):
    core = core_of(*steps)

    assert wanted.enable_wanted_of(core, core.legs[0]) is wants
