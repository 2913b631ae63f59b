"""No change of mode that keeps power is a jump of torque: on the wire, and in the plant itself."""

import itertools

import pytest
from gaitd_names import Mode, Outcome, RequestKind

from daemon.ipc.record import ModeRequest

HOLD = ModeRequest(Mode.HOLD)
STEPS = (
    HOLD,
    ModeRequest(Mode.EXCITE, duration_s=20.0, scenario="open_loop"),
    HOLD,
    ModeRequest(Mode.HAND_GUIDING),
    HOLD,
    ModeRequest(Mode.SELF_TEST),
    HOLD,
)
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=0.6, duration_s=60.0)
PERIOD_S = 0.01


def assert_no_jump(session, begun, begun_rows, ended_rows):
    """Neither what was sent since then jumps, nor what the plant felt from then to then."""
    powered = [
        one
        for one in session.records[begun:]
        if one.mode.active or one.mode in {Mode.STOPPING, Mode.FAULT}
    ]
    rows = session.truth.rows[begun_rows:ended_rows]
    for index, axis in enumerate(session.core.axes):
        step_si = axis.limits.effort_rate_max_si_per_s * PERIOD_S
        name = ("hip_torque_nm", "slide_force_n")[index]
        assert steepest([one.drives[index].target_effort for one in powered]) <= step_si * 1.001
        # The current loop is not ours: its ripple and its sampling are in what the plant feels.
        assert steepest([getattr(row, name) for row in rows]) <= step_si * 1.5


def end_by(session, end):
    if end == "disable":
        session.gateway.request(RequestKind.DISABLE)
    else:
        session.gateway.stop()
    session.run(0.05)


@pytest.mark.parametrize(
    ("guidance", "end"),
    [("impedance", "stop"), ("position", "disable")],
)
def test_torque_never_rises_faster_than_its_rate_over_any_switch_that_keeps_power(
    warm_guided_gait, guidance, end
):
    session = warm_guided_gait
    begun, begun_rows = len(session.records), len(session.truth.rows)
    for wanted in STEPS:
        answer = session.request(RequestKind.MODE, wanted)
        assert answer.outcome == Outcome.DONE, answer.refusal
        session.run(1.2 if wanted.mode in {Mode.EXCITE, Mode.SELF_TEST} else 0.4)
    session.request(RequestKind.MODE, GAIT)
    session.run(6.5 if guidance == "position" else 1.0)
    ended_rows = len(session.truth.rows)
    end_by(session, end)

    modes = {record.mode for record in session.records[begun:]}
    assert modes >= {Mode.GAIT} | {wanted.mode for wanted in STEPS}
    assert_no_jump(session, begun, begun_rows, ended_rows + 4)


def test_nor_does_it_at_the_disable_of_a_gait_of_impedance(session):
    begun, begun_rows = len(session.records) - 10, len(session.truth.rows)
    end_by(session, "disable")

    assert_no_jump(session, begun, begun_rows - 10, begun_rows + 4)


def steepest(values: list[float]) -> float:
    return max(abs(later - before) for before, later in itertools.pairwise(values))
