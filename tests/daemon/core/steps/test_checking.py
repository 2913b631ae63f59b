"""What the safety checks read: each value is that of the axis, leg or service it belongs to."""

from types import SimpleNamespace

import pytest
from gaitd_names import Cause, Mode
from safety_inputs import CATEGORIES, FEEDBACK, JOINT, THRESHOLDS
from step_inputs import a_core, a_leg, an_axis, now_shows

from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.energy import StrideSum
from daemon.core.safety.inputs import AxisEstimateInputs, LegInputs, ServiceInputs
from daemon.core.slices import Estimated, Inputs, Monitored, Placed
from daemon.core.steps import checking
from daemon.core.tick import Tick
from daemon.ipc.cycle_timing import CycleTiming
from drives.signals import OperationMode

TICK = Tick(
    *(100, 0, 0, 0.01, CycleTiming(0, 0, 0, 0)),
    late=False,
    shutdown=True,
    overruns_in_a_row=3,
    bus_error="lost",
    tx_dropped_in_a_row=4,
)
MODES = OperationMode.CYCLIC_SYNC_POSITION, OperationMode.CYCLIC_SYNC_TORQUE
WATCHES = EffortWatch(sign_mismatch_cycles=1), EffortWatch(sign_mismatch_cycles=2)


@pytest.fixture
def core():
    """A core in GAIT whose hip and slide differ in all that is read of them."""
    axes = [
        an_axis(
            name,
            feedback=FEEDBACK._replace(alarm_count=number),
            joint=JOINT._replace(position_si=0.1 * number),
            referenced=number == 1,
            tracking_si=0.2 * number,
            wanted_velocity_si=0.3 * number,
            reached_enabled=number == 2,
            unready_cycles=number,
            unexpected_enable_cycles=10 * number,
            shown_unpowered=number == 1,
            emergencies_checked=1,
            sign_trusted=number == 2,
            bring_up_error=(number, "text"),
            mode=MODES[number - 1],
            position_si=1.0,
            reaction_cycles=20 * number,
            scaling=SimpleNamespace(counts_per_si=0.5 if number == 1 else -0.5),
            spasm=SimpleNamespace(cycles=number, rise_si=2.0 * number),
            clonus=SimpleNamespace(cycles=3 * number, swing_si=4.0 * number),
            energy=StrideSum(),
            residual=StrideSum(),
        )
        for number, name in enumerate(("right/hip", "right/slide"), 1)
    ]
    for number, axis in enumerate(axes, 1):
        axis.energy.add(5.0 * number)
    leg = a_leg(
        *axes,
        placed=Placed(0.6),
        monitored=Monitored(
            watches=WATCHES, stopping_end_si=(0.7, 0.8), stopping_ratio=0.5, window_cycles=9
        ),
        estimated=Estimated(bad_cycles=6),
    )
    return a_core(
        leg,
        mode=Mode.GAIT,
        drives=None,
        inputs=Inputs(stop=True, gateway_state_cycle=40),
        config=SimpleNamespace(thresholds=THRESHOLDS, categories=CATEGORIES),
    )


def test_of_the_service_gateway_bus_and_cycle_are_read(core):
    found = checking.safety_inputs(core, TICK)

    assert (found.thresholds, found.categories) == (core.config.thresholds, core.config.categories)
    assert found.driving
    assert found.service == ServiceInputs(
        stop_requested=True,
        shutdown_requested=True,
        gateway_age_cycles=60,
        overruns_in_a_row=3,
        bus_off=False,
        bus_error="lost",
        tx_dropped_in_a_row=4,
    )
    core.drives = SimpleNamespace(bus_state=SimpleNamespace(has_been_off=True))
    assert checking.safety_inputs(core, TICK).service.bus_off


@pytest.mark.parametrize("index", [0, 1])
def test_of_an_axis_its_own_values_are_read(core, index):
    (leg,) = core.legs
    axis, number = leg.axes[index], index + 1

    found = checking.safety_inputs(core, TICK).axes[index]

    assert (found.name, found.limits) == (axis.name, axis.limits)
    assert (found.feedback, found.joint) == (axis.sensed.feedback, axis.sensed.joint)
    assert (found.referenced, found.preparing, found.homing) == (number == 1, False, False)
    assert found.tracking_si == 0.2 * number
    assert found.wanted_velocity_si == 0.3 * number
    assert found.counts_sign == (1 if number == 1 else -1)
    assert (found.enable_wanted, found.reached_enabled) == (True, number == 2)
    assert (found.unready_cycles, found.unexpected_enable_cycles) == (number, 10 * number)
    assert (found.shown_unpowered, found.reaction_cycles) == (number == 1, 20 * number)
    assert found.mode_wanted == MODES[index]
    assert (found.new_emergency, found.sign_trusted) == (number == 2, number == 2)
    assert found.watch is WATCHES[index]
    assert (found.stride_energy_j, found.stride_drift_si) == (5.0 * number, 0.0)
    assert found.stopping_end_si == (0.7, 0.8)[index]
    assert (found.held, found.bring_up_error) == (False, (number, "text"))


@pytest.mark.parametrize(
    ("mode", "tracking_si"),
    [(Mode.STOPPING, [0.0, 0.0]), (Mode.TORQUE, [0.2, 0.4]), (Mode.GAIT, [0.2, 0.4])],
)
def test_a_distance_to_the_reference_means_nothing_while_the_leg_stops(core, mode, tracking_si):
    core.mode = mode

    assert [one.tracking_si for one in checking.safety_inputs(core, TICK).axes] == tracking_si


@pytest.mark.parametrize(("alarms", "is_new"), [(1, False), (2, False), (3, True)])
def test_an_alarm_is_new_above_the_count_that_was_checked(core, alarms, is_new):
    feedback = FEEDBACK._replace(alarm_count=alarms)
    now_shows(core.axes[0], feedback=feedback, emergencies_checked=2)

    assert checking.safety_inputs(core, TICK).axes[0].new_emergency is is_new


def test_a_leg_that_is_held_is_held_at_both_axes(core):
    core.legs[0].is_held = True

    assert all(one.held for one in checking.safety_inputs(core, TICK).axes)


@pytest.mark.parametrize("name", ["right/hip", "right/slide", "left/hip"])
def test_a_leg_seeks_home_while_a_drive_moves_one_of_its_axes_by_its_homing(core, name):
    (leg,) = checking.safety_inputs(core, TICK).legs
    assert leg == LegInputs("right", 0.6, 0.5, seeks_home=False)
    core.single_axis = SimpleNamespace(
        axis=name, by_drive=True, step=None, limits=lambda usual, moving: usual
    )

    found = checking.safety_inputs(core, TICK)

    assert found.legs[0].seeks_home is name.startswith("right")
    assert [one.homing for one in found.axes] == [one.name == name for one in found.axes]
    assert all(one.preparing for one in found.axes)


def test_an_axis_that_was_not_sensed_is_not_judged(core):
    now_shows(core.axes[1], feedback=None)

    with pytest.raises(RuntimeError, match="right/slide is judged before it was sensed"):
        checking.safety_inputs(core, TICK)


def test_each_alarm_is_checked_once(core):
    found = checking.check_raw(core, TICK)

    assert Cause.STOP_REQUESTED in {one.cause for one in found}
    assert [axis.sensed.emergencies_checked for axis in core.axes] == [1, 2]


def test_the_estimate_is_judged_while_a_drive_has_power(core, monkeypatch):
    given = []
    monkeypatch.setattr(checking.checks, "check_estimate", lambda *all_of: given.append(all_of))

    checking.check_estimate(core)

    (((leg,), thresholds, categories),) = given
    assert (thresholds, categories) == (core.config.thresholds, core.config.categories)
    assert (leg.name, leg.observer_bad_cycles, leg.seeks_home) == ("right", 6, False)
    assert list(leg.axes) == [
        AxisEstimateInputs(
            name=axis.name,
            limits=axis.limits,
            spasm_cycles=number,
            spasm_rise_si=2.0 * number,
            clonus_cycles=3 * number,
            clonus_swing_si=4.0 * number,
        )
        for number, axis in enumerate(core.axes, 1)
    ]
    core.mode = Mode.READY
    assert checking.check_estimate(core) == ()
