"""Requests of clients: checked by the guards of `table.py`, and answered.

The supervisor executes what is accepted. This file is the only writer of `request` and `result`.
"""

from typing import Final

from gaitd_names import Cause, EventCode, Failure, Mode, Outcome, RefusalCode, RequestKind

from daemon.core.exercises.guards import GuardInputs
from daemon.core.modes import roles, table
from daemon.core.period import cycles
from daemon.core.safety.joints import is_at_rest
from daemon.core.state import Axis, Core
from daemon.core.steps import exercises, single_axis
from daemon.ipc.record import Request, RequestResult
from daemon.ipc.report import Refusal
from drives.signals import Input, PowerState

STALE_REQUEST_CYCLES: Final = cycles(1.0)
"""Largest age of a request in cycles.

An older request was made for another situation. A request for a future cycle is refused too.
"""


def receive(core: Core, cycle: int) -> Request | None:
    """Check a new request; returns it if it is accepted. `finish` publishes its outcome."""
    request = core.inputs.request
    if request is None:
        return None
    if core.request is not None:
        busy = Refusal(RefusalCode.BUSY, values=(core.request.kind,))
        core.result = RequestResult(request.id, Outcome.REFUSED, busy)
        return None
    refused = _refusal(core, request, cycle, stop=core.inputs.stop)
    if refused is not None:
        core.result = RequestResult(request.id, Outcome.REFUSED, refused)
        _report_refusal(core, request, refused)
        return None
    core.request = request
    core.result = RequestResult(request.id)
    wanted = request.mode
    core.report(EventCode.REQUEST_RECEIVED, wanted.axis, request.kind, wanted.mode)
    return request


def _report_refusal(core: Core, request: Request, refused: Refusal) -> None:
    """Publish a refusal: the values of its code come after those of the request."""
    values = request.kind, request.mode.mode, refused.code, *refused.values
    core.report(EventCode.REQUEST_REFUSED, refused.subject, *values, said=refused.said)


def _refusal(core: Core, request: Request, cycle: int, *, stop: bool) -> Refusal | None:
    if stop and (request.kind == RequestKind.ENABLE or is_of_single_axis(request)):
        return Refusal(RefusalCode.STOP_REQUESTED)
    if not 0 <= cycle - request.for_cycle <= STALE_REQUEST_CYCLES:
        return Refusal(RefusalCode.OLD, values=(request.for_cycle, cycle))
    now = _guard_inputs(core, cycle)
    refused = table.refusal(request.kind, request.mode, now) or roles.refusal(request, now)
    if refused is None and request.kind == RequestKind.MODE:
        refused = exercises.refusal(core, request.mode.mode)
    if refused is None and is_of_single_axis(request):
        refused = single_axis.refusal(core, request.mode, cycle)
    return refused


def is_of_single_axis(request: Request) -> bool:
    """True if it requests a homing, a sign test or the confirmation of a sign test."""
    return request.kind == RequestKind.MODE and request.mode.mode in single_axis.SINGLE_AXIS_MODES


def _guard_inputs(core: Core, cycle: int) -> GuardInputs:
    config = core.config
    fresh = [
        axis for axis in core.axes if axis.sensed.feedback is not None and axis.sensed.joint.fresh
    ]
    age_max_cycles = config.thresholds.sample_age_max_cycles
    # A single lost sample keeps the last inputs; those of a lost drive, or that cannot be, are not
    # used.
    inputs = [
        axis.sensed.feedback.inputs
        for axis in core.axes
        if axis.sensed.feedback is not None
        and axis.sensed.feedback.sample_age_cycles <= age_max_cycles
        and Input.IMPOSSIBLE not in axis.sensed.feedback.inputs
    ]
    gateway_age_cycles = cycle - core.inputs.gateway_state_cycle
    return GuardInputs(
        mode=core.mode,
        gateway_alive=gateway_age_cycles <= config.thresholds.gateway_silence_cycles,
        at_rest=all(is_at_rest(axis.sensed.joint, axis.limits) for axis in fresh),
        hand_switch_closed=all(Input.HAND_SWITCH_CLOSED in one for one in inputs),
        hand_switch_known=bool(inputs),
        sto_released=all(Input.STO_RELEASED in one for one in inputs),
        unreferenced=tuple(
            (axis.name, axis.sensed.doubt) for axis in core.axes if not axis.sensed.referenced
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
        lease_held=core.inputs.lease != 0,
        unsampled=tuple(axis.name for axis in core.axes if not axis.sensed.joint.fresh),
        lost=frozenset(axis.name for axis in core.axes if _is_lost(core, axis)),
    )


def _is_lost(core: Core, axis: Axis) -> bool:
    feedback = axis.sensed.feedback
    if core.drives is None or feedback is None:
        return True
    return feedback.sample_age_cycles > core.config.thresholds.sample_age_max_cycles


def _outside(core: Core) -> tuple[str, ...]:
    axes = tuple(
        axis.name
        for axis in core.axes
        if not axis.limits.position_min_si
        <= axis.sensed.joint.position_si
        <= axis.limits.position_max_si
    )
    stop_ratio = core.config.thresholds.singularity_stop_ratio
    return axes + tuple(leg.name for leg in core.legs if leg.placed.singularity_ratio < stop_ratio)


def finish(core: Core) -> None:
    """Publish the outcome of the accepted request as soon as it is known."""
    if core.request is None:
        return
    request = core.request
    outcome, refused = _outcome(core, request)
    if outcome == Outcome.PENDING:
        return
    # A newer request has replaced the result: no client waits for this one any more.
    if request.id == core.result.id:
        core.result = RequestResult(request.id, outcome, refused)
    if refused is None:
        core.report(EventCode.REQUEST_DONE, request.mode.axis, request.kind, request.mode.mode)
    else:
        _report_refusal(core, request, refused)
    core.request = None


def _begun(core: Core, mode: Mode) -> tuple[Outcome, Refusal | None]:
    run = core.single_axis
    if core.mode == mode:
        return Outcome.DONE, None
    if run is None or run.is_over:
        why = Failure.NOT_READY if run is None else run.why
        return Outcome.REFUSED, Refusal(RefusalCode.FAILED, values=(why,))
    return Outcome.PENDING, None


def _outcome(core: Core, request: Request) -> tuple[Outcome, Refusal | None]:
    kind, verdict = request.kind, core.verdict
    if verdict.cause != Cause.NONE:
        stopped = Refusal(RefusalCode.STOPPED, verdict.drive, verdict.values, verdict.said)
        return Outcome.REFUSED, stopped
    if is_of_single_axis(request) and not request.mode.witnessed:
        return _begun(core, request.mode.mode)
    # The state that the drives show decides, not the command. A drive that keeps showing another
    # state soon causes a verdict.
    shown = [axis.sensed.feedback for axis in core.axes if axis.sensed.feedback is not None]
    pushing = any(one.power_state == PowerState.OPERATION_ENABLED for one in shown)
    faulty = any(one.in_fault for one in shown)
    done = {
        RequestKind.ENABLE: core.load_checked,
        RequestKind.DISABLE: core.mode == Mode.READY and not pushing,
        RequestKind.RESET: core.mode == Mode.READY and core.reset_cycles_left == 0 and not faulty,
        RequestKind.MODE: True,
    }
    return (Outcome.DONE if done[kind] else Outcome.PENDING), None
