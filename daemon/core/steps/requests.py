"""Requests of clients: checked by the guards of `table.py`, and answered.

The supervisor executes what is accepted. This file is the only writer of `request` and `result`.
"""

from daemon.core.exercises.guards import GuardInputs
from daemon.core.inputs import CommandInputs
from daemon.core.modes import roles, table
from daemon.core.safety.joints import is_at_rest
from daemon.core.state import Axis, Core
from daemon.core.steps import exercises, single_axis
from daemon.core.steps.status import describe
from daemon.ipc.record import (
    Cause,
    Mode,
    ModeRequest,
    Outcome,
    Request,
    RequestKind,
    RequestResult,
)
from drives.signals import Input, PowerState

STALE_REQUEST_CYCLES = 100
"""Largest age of a request in cycles.

An older request was made for another situation. A request for a future cycle is refused too.
"""


def receive(core: Core, command_inputs: CommandInputs, cycle: int) -> Request | None:
    """Check a new request; returns it if it is accepted. `finish` publishes its outcome."""
    request = command_inputs.request
    if request is None:
        return None
    if core.request is not None:
        core.result = RequestResult(request.id, Outcome.REFUSED, "another request is outstanding")
        return None
    now = _guard_inputs(core, cycle)
    reason = table.refusal(request.kind, request.mode, now) or roles.refusal(request, now)
    if not 0 <= cycle - request.for_cycle <= STALE_REQUEST_CYCLES:
        reason = f"made for cycle {request.for_cycle}, it is {cycle} now"
    if command_inputs.stop and (request.kind == RequestKind.ENABLE or is_of_single_axis(request)):
        reason = "a stop was requested at the same time"
    if not reason and request.kind == RequestKind.MODE:
        reason = exercises.refusal(core, request.mode.mode)
    if not reason and is_of_single_axis(request):
        reason = single_axis.refusal(core, request.mode, cycle)
    if reason:
        core.result = RequestResult(request.id, Outcome.REFUSED, reason)
        core.report(f"{request.kind.name.lower()} refused: {reason}")
        return None
    core.request = request
    core.result = RequestResult(request.id)
    core.report(_requested(request.kind, request.mode))
    return request


def is_of_single_axis(request: Request) -> bool:
    """True if it requests a homing, a sign test or the confirmation of a sign test."""
    return request.kind == RequestKind.MODE and request.mode.mode in single_axis.SINGLE_AXIS_MODES


def _requested(kind: RequestKind, wanted: ModeRequest) -> str:
    if kind != RequestKind.MODE:
        return f"{kind.name.lower()} requested"
    return f"mode {wanted.mode.name.lower()} requested {wanted.axis}".rstrip()


def _guard_inputs(core: Core, cycle: int) -> GuardInputs:
    config = core.config
    fresh = [axis for axis in core.axes if axis.feedback is not None and axis.joint.fresh]
    age_max_cycles = config.thresholds.sample_age_max_cycles
    # A single lost sample keeps the last inputs; those of a lost drive, or that cannot be, are not
    # used.
    inputs = [
        axis.feedback.inputs
        for axis in core.axes
        if axis.feedback is not None
        and axis.feedback.sample_age_cycles <= age_max_cycles
        and Input.IMPOSSIBLE not in axis.feedback.inputs
    ]
    return GuardInputs(
        mode=core.mode,
        gateway_alive=cycle - core.gateway_state_cycle <= config.thresholds.gateway_silence_cycles,
        at_rest=all(is_at_rest(axis.joint, axis.limits) for axis in fresh),
        hand_switch_closed=all(Input.HAND_SWITCH_CLOSED in one for one in inputs),
        hand_switch_known=bool(inputs),
        sto_released=all(Input.STO_RELEASED in one for one in inputs),
        unreferenced=tuple(
            f"{axis.name} ({axis.unreferenced_why})" for axis in core.axes if not axis.referenced
        ),
        outside=_outside(core),
        drives_powered=core.load_checked,
        cadence_max_hz=config.gait.cadence_max_hz,
        scenarios={name: one.duration_max_s for name, one in config.excite.items()},
        artificial=frozenset(name for name, one in config.excite.items() if one.artificial),
        patient_configured=config.patient_configured,
        guidance=config.gait.guidance,
        inputs_untested=core.inputs_untested,
        self_test_due=core.self_test_due,
        unproven=tuple(
            axis.name for axis in core.axes if config.signs_must_be_proven and not axis.sign_proven
        ),
        lease_held=core.lease != 0,
        unsampled=tuple(axis.name for axis in core.axes if not axis.joint.fresh),
        lost=frozenset(axis.name for axis in core.axes if _is_lost(core, axis)),
    )


def _is_lost(core: Core, axis: Axis) -> bool:
    feedback = axis.feedback
    if core.drives is None or feedback is None:
        return True
    return feedback.sample_age_cycles > core.config.thresholds.sample_age_max_cycles


def _outside(core: Core) -> tuple[str, ...]:
    axes = tuple(
        axis.name
        for axis in core.axes
        if not axis.limits.position_min_si <= axis.joint.position_si <= axis.limits.position_max_si
    )
    stop_ratio = core.config.thresholds.singularity_stop_ratio
    return axes + tuple(leg.name for leg in core.legs if leg.singularity_ratio < stop_ratio)


def finish(core: Core) -> None:
    """Publish the outcome of the accepted request as soon as it is known."""
    if core.request is None:
        return
    outcome, reason = _outcome(core, core.request)
    if outcome == Outcome.PENDING:
        return
    # A newer request has replaced the result: no client waits for this one any more.
    if core.request.id == core.result.id:
        core.result = RequestResult(core.request.id, outcome, reason)
    core.report(f"{core.request.kind.name.lower()} {outcome.name.lower()} {reason}".strip())
    core.request = None


def _begun(core: Core, mode: Mode) -> tuple[Outcome, str]:
    run = core.single_axis
    if core.mode == mode:
        return Outcome.DONE, ""
    if run is None or run.is_over:
        return Outcome.REFUSED, run.why if run is not None else "the drives could not be prepared"
    return Outcome.PENDING, ""


def _outcome(core: Core, request: Request) -> tuple[Outcome, str]:
    kind = request.kind
    if core.verdict.cause != Cause.NONE:
        return Outcome.REFUSED, describe(core.verdict)
    if is_of_single_axis(request) and not request.mode.witnessed:
        return _begun(core, request.mode.mode)
    # The state that the drives show decides, not the command. A drive that keeps showing another
    # state soon causes a verdict.
    shown = [axis.feedback for axis in core.axes if axis.feedback is not None]
    pushing = any(one.power_state == PowerState.OPERATION_ENABLED for one in shown)
    faulty = any(one.in_fault for one in shown)
    done = {
        RequestKind.ENABLE: core.load_checked,
        RequestKind.DISABLE: core.mode == Mode.READY and not pushing,
        RequestKind.RESET: core.mode == Mode.READY and core.reset_cycles_left == 0 and not faulty,
        RequestKind.MODE: True,
    }
    return (Outcome.DONE if done[kind] else Outcome.PENDING), ""
