"""The plans: the daily self-test, one axis, and the acceptance of a first machine.

An acceptance is all that a first machine should show, step by step:

    objects        read from each drive: identity, units, option codes, all that bring-up has set;
                   nothing moves if one is wrong
    sign           the service's sign test of each axis, and what the operator saw
    units          the operator moves the axis by hand between two marks; the drives have no power
    position       home of each axis that has no valid position
    self-test      load and friction of each axis against the robot file
    stops          in gait: by request (S2), hand switch (S1) and emergency stop (S0), of each leg

What of it has shown a limit to act, and what was not shown, and why, are findings as well.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

from gaitd_client import Mode
from msgspec.structs import replace

from analysis.acceptance.record import FindingCode, Section
from gaitd.commissioning import measures, stages
from gaitd.commissioning.messages import Instruction, InstructionCode, Request
from gaitd.commissioning.procedure import Task, not_measured
from gaitd.commissioning.stops import STOPS, StopRules

if TYPE_CHECKING:
    from daemon.config.bundle import Settings
    from daemon.core.state import Axis

HOMING_MAX_S: Final = 360.0
"""Longer than any homing may take."""
PUSH_MAX_S: Final = 60.0
GAIT_S: Final = 120.0
NOT_SHOWN: Final = (
    FindingCode.TORQUE_LIMIT,
    FindingCode.SPEED_LIMIT,
    FindingCode.POSITION_LIMITS,
    FindingCode.FOLLOWING_ERROR,
    FindingCode.HEARTBEAT,
)
"""Limits that an acceptance does not approach; their values are read back."""


class Gait(NamedTuple):
    """The gait in which the machine is stopped."""

    cadence_hz: float
    amplitude_ratio: float


def self_test() -> tuple[Task, ...]:
    """The daily test. It enables, and resets nothing: a latched stop is for the operator."""
    test = Task(
        stages.DAILY_TEST,
        Section.SELF_TEST,
        axes=("",),  # those that the service has
        announced=Instruction(InstructionCode.SELF_TEST_BEGINS),
        request=Request("mode", {"mode": Mode.SELF_TEST}),
        judge=measures.self_test_findings,
    )
    return (test,)


def one_axis(mode: Mode, axis: str) -> tuple[Task, ...]:
    """The homing (mode reference) or the sign test (mode commission) of one axis."""
    is_sign = mode is Mode.COMMISSION
    task = Task(
        stages.SIGN_TEST if is_sign else stages.HOMING,
        Section.SIGN if is_sign else Section.POSITION,
        axes=(axis,),
        announced=Instruction(InstructionCode.WATCH_AXIS, axis) if is_sign else None,
        request=Request("mode", {"mode": mode, "axis": axis}),
        run_max_s=HOMING_MAX_S,
        judge=measures.own_findings,
    )
    return (task,)


def acceptance(settings: "Settings", gait: Gait) -> tuple[Task, ...]:
    """All that a first machine should show, step by step."""
    from daemon.core.modes.persistent_state import PersistentState
    from daemon.core.runtime.build import build  # takes a second: the other plans do not need it

    axes = {axis.name: axis for axis in build(settings, "", PersistentState()).core.axes}
    not_shown = (not_measured((name,), Section.LIMITS, code) for name in axes for code in NOT_SHOWN)
    return (
        Task((stages.READY,)),
        *(Task((stages.OBJECTS,), is_always_done=True, axes=(name,)) for name in axes),
        *map(_sign, axes.values()),
        *map(_units, axes.values()),
        *map(_position, axes),
        _self_test(settings, tuple(axes)),
        *_stops(settings, axes, gait),
        Task((stages.LEFT,), is_always_done=True, axes=tuple(axes), missing=sum(not_shown, ())),
    )


def _sign(axis: "Axis") -> Task:
    values = {"effort_max_si": axis.push.effort_max_si, "motion_si": axis.push.motion_si}
    return Task(
        stages.SIGN,
        Section.SIGN,
        axes=(axis.name,),
        announced=Instruction(InstructionCode.PUSH_AXIS, axis.name, values),
        request=Request("mode", {"mode": Mode.COMMISSION, "axis": axis.name}),
        run_max_s=PUSH_MAX_S,
        judge=partial(measures.sign_findings, axis=axis),
    )


def _units(axis: "Axis") -> Task:
    judge = partial(measures.unit_findings, axis=axis)
    return Task(stages.UNITS, Section.UNITS, axes=(axis.name,), judge=judge)


def _position(axis: str) -> Task:
    return Task(
        stages.POSITION,
        Section.POSITION,
        axes=(axis,),
        announced=Instruction(InstructionCode.HOME_AXIS, axis),
        request=Request("mode", {"mode": Mode.REFERENCE, "axis": axis}),
        run_max_s=HOMING_MAX_S,
        judge=measures.position_findings,
    )


def _self_test(settings: "Settings", axes: tuple[str, ...]) -> Task:
    rules = settings.trainer.self_test
    loads_si = {"hip": rules.hip.load_tolerance_nm, "slide": rules.slide.load_tolerance_n}
    limits = {
        "friction_min_ratio": rules.friction_min_ratio,
        "friction_max_ratio": rules.friction_max_ratio,
    }
    motions = {"hip_motion_deg": rules.hip.motion_deg, "slide_motion_m": rules.slide.motion_m}
    missing = (
        replace(one, values={**limits, "load_tolerance_si": loads_si[one.drive.rpartition("/")[2]]})
        for one in not_measured(axes, Section.SELF_TEST, FindingCode.LOAD)
    )
    return Task(
        stages.SELF_TEST,
        Section.SELF_TEST,
        axes=axes,
        announced=Instruction(InstructionCode.SELF_TEST, values=motions),
        request=Request("mode", {"mode": Mode.SELF_TEST}),
        judge=measures.self_test_findings,
        missing=tuple(missing),
    )


def _stops(settings: "Settings", axes: Mapping[str, "Axis"], gait: Gait) -> Iterator[Task]:
    walk = {"mode": Mode.GAIT, "duration_s": GAIT_S, **gait._asdict()}
    values = {**gait._asdict(), "announce_s": settings.trainer.gait.announce_s}
    stride_s = 1 / gait.cadence_hz
    for leg in settings.legs:
        names = (leg.hip.name, leg.slide.name)
        rules = tuple(_stop_rules(settings, axes[name]) for name in names)
        for way in STOPS:
            told = {**values, "when_fast": way.cause}
            acts = (measures.stop_acts(name, way) for name in names)
            yield Task(
                stages.STOP_IN_GAIT,
                way.section,
                axes=names,
                announced=Instruction(InstructionCode.WALK, leg.name, told),
                request=Request("mode", walk),
                judge=partial(measures.stop_findings, way=way, rules=rules),
                missing=(*not_measured(names, way.section), *acts),
                stride_s=stride_s,
                ramp_s=settings.trainer.gait.ramp_strides * stride_s,
                stop=way,
            )


def _stop_rules(settings: "Settings", axis: "Axis") -> StopRules:
    from daemon.core.safety.stop_sequence import HOLD_GRACE_CYCLES

    stop = settings.limits.stop
    period_s = settings.trainer.cycle.period_ms * 1e-3
    return StopRules(
        axis=axis.name,
        deceleration_si_per_s2=axis.limits.quick_stop_deceleration_si_per_s2,
        standstill_si_per_s=axis.limits.standstill_si_per_s,
        standstill_cycles=stop.standstill_cycles,
        obey_s=stop.obey_cycles * period_s,
        hold_obey_s=(stop.obey_cycles + HOLD_GRACE_CYCLES) * period_s,
        margin_ratio=stop.ramp_margin_ratio,
        effort_free_si=axis.limits.effort_deviation_max_si,
    )
