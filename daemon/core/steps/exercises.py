"""The exercise of each leg: begun by a request, advanced once a cycle, ended in a hold.

This file is the only writer of `exercise`, `reference` and `takes_over` of a leg.
"""

from collections.abc import Sequence

from gaitd_names import EventCode, Mode, Stage

from daemon.core.exercises.exercise import LegSample, LegStart, Reference
from daemon.core.exercises.hold import Hold
from daemon.core.modes.table import rules_of
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety.limits import AxisLimits
from daemon.core.state import Axis, Core, Leg
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal
from drives.signals import OperationMode


def refusal(core: Core, wanted: Mode) -> Refusal | None:
    """The reason why there is no room for an exercise at the present pose; None if there is."""
    exercise = rules_of(wanted).exercise
    return None if exercise is None else exercise.may_begin(_starts(core), core.config)


def begin(core: Core, wanted: ModeRequest) -> None:
    """Begin the exercise of a mode with every leg; `refusal` has returned no reason."""
    if wanted.mode == Mode.HOLD:
        end(core)
        return
    exercise = rules_of(wanted.mode).exercise
    if exercise is None:
        raise RuntimeError(f"mode {wanted.mode.name} has no exercise: it was not refused")
    begun = exercise.begin(_starts(core), wanted, core.config)
    for leg, one in zip(core.legs, begun, strict=True):
        leg.exercise, leg.takes_over = one, exercise.continues_effort


def samples_of(core: Core, *, mode_changing: bool) -> list[LegSample]:
    """What the exercise of each leg reads in this cycle.

    `mode_changing`: a drive has not been sent the mode of operation of the exercise.
    """
    return [_sample(leg, mode_changing=mode_changing) for leg in core.legs]


def advance(core: Core, samples: Sequence[LegSample]) -> None:
    """Advance the exercise of each leg by one cycle, and publish changes of its stage."""
    for leg, sample in zip(core.legs, samples, strict=True):
        before = leg.exercise
        if before is None:
            continue
        after = before.advance(sample, core.config.period_s)
        leg.exercise = after
        if after.stage is not before.stage and after.stage is not None:
            values = core.mode, after.stage, after.failure
            core.report(EventCode.STAGE_CHANGED, leg.name, *values)
            leg.takes_over = leg.takes_over or after.continues_effort_at_stages


def is_over(core: Core) -> bool:
    """True if the exercise is over: with the first leg, or with the last where they take turns."""
    over = [leg.exercise is not None and leg.exercise.stage is Stage.OVER for leg in core.legs]
    first = core.legs[0].exercise
    return all(over) if first is not None and first.legs_in_turn else any(over)


def stage(core: Core) -> Stage | None:
    """The stage of the first leg whose exercise is not over; None where there are no stages."""
    stages = [None if leg.exercise is None else leg.exercise.stage for leg in core.legs]
    return next((one for one in stages if one is not Stage.OVER), Stage.OVER)


def progress(core: Core) -> Progress | None:
    """What happens in the exercise; None without stages."""
    first = core.legs[0].exercise
    if first is None or first.stage is None:
        return None
    if first.legs_in_turn:
        for leg in core.legs:
            if leg.exercise is not None and leg.exercise.stage is Stage.PLAYING:
                return leg.exercise.progress()
    return first.progress()


def update_references(core: Core, samples: Sequence[LegSample]) -> None:
    """Update the reference of each leg from its exercise, which may be another one by now."""
    for leg, sample in zip(core.legs, samples, strict=True):
        leg.reference = reference_of(leg, sample)


def reference_of(leg: Leg, sample: LegSample) -> Reference | None:
    """The reference of the leg's exercise in this cycle; None without an exercise."""
    return None if leg.exercise is None else leg.exercise.targets(sample)


# --- hold -----------------------------------------------------------------------------------------


def end(core: Core) -> None:
    """Brake each leg and hold it: from its reference if it is fully guided, else from where it is.

    A softly guided leg may be far from its reference; full stiffness must not pull it there. In
    position mode the drives' own loops take over without a step of torque.
    """
    for leg in core.legs:
        reference = leg.reference
        fully = leg.guidance_ratio == 1.0
        if reference is not None and reference.guided and fully:
            leg.exercise = Hold.braking(reference.position, reference.velocity, _limits(leg))
        else:
            leg.exercise = Hold.braking(measured(leg), _speeds(leg), _limits(leg))
        leg.takes_over = not core.config.by_position


def brake(core: Core) -> None:
    """Brake each leg from where it is: a stop does not first move to a reference.

    A leg that mode HOLD holds stays held at its pose: a person may lean on it, and would fall where
    the spring that carries them begins anew at the present pose.
    """
    for leg in core.legs:
        if not leg.is_held:
            leg.exercise = Hold.braking(measured(leg), _speeds(leg), _limits(leg))


def brake_and_hold(core: Core) -> None:
    """Brake each leg from where it is, with the effort that was sent last."""
    for leg in core.legs:
        leg.exercise = Hold.braking(measured(leg), _speeds(leg), _limits(leg))
        leg.takes_over = True


def hold_here(core: Core) -> None:
    """Hold each leg at its measured pose."""
    for leg in core.legs:
        leg.exercise = Hold.braking(measured(leg), (0.0, 0.0), _limits(leg))


def clear(core: Core) -> None:
    """No exercise: no drive is enabled."""
    for leg in core.legs:
        leg.exercise = None


def reset(core: Core) -> None:
    """Neither exercise nor reference: the drives have just been brought up."""
    clear(core)
    for leg in core.legs:
        leg.reference = None


def has_taken_over(core: Core) -> None:
    """The command of this cycle has continued the effort of the last one."""
    for leg in core.legs:
        leg.takes_over = False


# --- what an exercise reads -----------------------------------------------------------------------


def measured(leg: Leg) -> Pair:
    """Hip angle in rad and slide position in m from the raw encoders."""
    hip, slide = leg.axes
    return hip.sensed.joint.position_si, slide.sensed.joint.position_si


def _speeds(leg: Leg) -> Pair:
    hip, slide = leg.axes
    return hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si


def _limits(leg: Leg) -> tuple[AxisLimits, AxisLimits]:
    hip, slide = leg.axes
    return hip.limits, slide.limits


def _starts(core: Core) -> list[LegStart]:
    return [
        LegStart(
            name=leg.name,
            axis_names=(leg.axes[0].name, leg.axes[1].name),
            parameters=leg.parameters,
            shape=leg.shape,
            limits=_limits(leg),
            friction=leg.friction,
            over=leg.observers.over,
            effort_offset=leg.observers.effort_offset,
            phase_offset_strides=leg.phase_offset_strides,
            pose=(
                leg.reference.position
                if leg.reference is not None and leg.reference.guided
                else measured(leg)
            ),
        )
        for leg in core.legs
    ]


def _sample(leg: Leg, *, mode_changing: bool) -> LegSample:
    hip, slide = leg.axes
    return LegSample(
        position=measured(leg),
        velocity=_speeds(leg),
        excess=(
            hip.sensed.joint.effort_si - hip.sensed.gravity_si,
            slide.sensed.joint.effort_si - slide.sensed.gravity_si,
        ),
        fresh=(hip.sensed.joint.fresh, slide.sensed.joint.fresh),
        in_torque_mode=_in_torque_mode(hip) and _in_torque_mode(slide),
        mode_changing=mode_changing,
    )


def _in_torque_mode(axis: Axis) -> bool:
    wanted, feedback = OperationMode.CYCLIC_SYNC_TORQUE, axis.sensed.feedback
    return axis.sent.mode == wanted and feedback is not None and feedback.mode_display == wanted
