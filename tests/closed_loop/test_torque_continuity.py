"""No change of mode that keeps power is a jump of torque: on the wire, and in the plant itself."""

import itertools

import pytest

from daemon.record import Mode, ModeRequest, Outcome, RequestKind

STEPS = (
    ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=0.6, duration_s=60.0),
    ModeRequest(Mode.HOLD),
    ModeRequest(Mode.EXCITE, duration_s=20.0, scenario="open_loop"),
    ModeRequest(Mode.HOLD),
    ModeRequest(Mode.RELEASE),
    ModeRequest(Mode.HOLD),
    ModeRequest(Mode.SELF_TEST),
)
PERIOD_S = 0.01


@pytest.mark.parametrize(("guidance", "end"), [("impedance", "stop"), ("position", "disable")])
def test_torque_never_rises_faster_than_its_rate_over_any_switch_that_keeps_power(
    warm_guided_hold, end
):
    lockstep = warm_guided_hold.lockstep
    begun, begun_rows = len(lockstep.records), len(warm_guided_hold.truth.rows)
    for wanted in STEPS:
        answer = lockstep.request(RequestKind.MODE, wanted)
        assert answer.outcome == Outcome.DONE, answer.reason
        lockstep.run(5.0 if wanted.mode in {Mode.GAIT, Mode.EXCITE} else 1.0)
    lockstep.run_until(lambda record: record.mode == Mode.HOLD, within_s=20)
    lockstep.request(RequestKind.MODE, STEPS[0])
    lockstep.run(5.0)
    ended_rows = len(warm_guided_hold.truth.rows)
    if end == "disable":
        lockstep.gateway.ask(RequestKind.DISABLE)
    else:
        lockstep.gateway.stop()
    lockstep.run(0.05)

    limits = [axis.limits for axis in lockstep.core.axes]
    powered = [record for record in lockstep.records[begun:] if record.mode >= Mode.STOPPING]
    assert {record.mode for record in powered} >= {wanted.mode for wanted in STEPS}
    rows = warm_guided_hold.truth.rows[begun_rows : ended_rows + 4]
    for index, limit in enumerate(limits):
        step_si = limit.effort_rate_max_si_per_s * PERIOD_S
        sent = [record.drives[index].target_effort_si for record in powered]
        name = ("hip_torque_nm", "slide_force_n")[index]
        given = [getattr(row, name) for row in rows]
        assert steepest(sent) <= step_si * 1.001
        # The current loop is not ours: its ripple and its sampling are in what the plant feels.
        assert steepest(given) <= step_si * 1.5


def steepest(values: list[float]) -> float:
    return max(abs(later - before) for before, later in itertools.pairwise(values))
