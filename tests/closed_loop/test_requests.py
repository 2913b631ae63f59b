"""Every request in every mode is answered: done, or why not. And a stop stops in every mode."""

from functools import partial

import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RefusalCode, RequestKind
from reports import refusal_of
from sessions import changed_configs, elsewhere, new_session, reported

from daemon.core.modes.table import TRANSITIONS, trigger_of
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.reference.modes import REQUESTS

EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
)
INCREMENTAL = (
    ("drives/hip_epos4.toml", "absolute = true", "absolute = false"),
    ("drives/slide_epos4.toml", "absolute = true", "absolute = false"),
    ("plant.toml", 'encoder = "absolute"', 'encoder = "incremental"'),
)
BY_REQUEST = {
    Mode.EXCITE: ModeRequest(Mode.EXCITE, duration_s=10.0, scenario="open_loop"),
    Mode.HAND_GUIDING: ModeRequest(Mode.HAND_GUIDING),
    Mode.SELF_TEST: ModeRequest(Mode.SELF_TEST),
}
MODES = [mode for mode in Mode if mode not in {Mode.TORQUE, Mode.BRINGING_UP}]
"""Mode torque is entered with a lease; its tests are with those of leases. Bring-up has its own."""


FEW = (Mode.READY, Mode.HOLD, Mode.GAIT, Mode.FAULT)
"""One without power, two with, and after a stop; the others are played at night.

The rules of all are in `tests/daemon/core/modes`.
"""


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(mode, id=mode, marks=() if mode in FEW else pytest.mark.thorough)
        for mode in MODES
    ],
)
def warm_mode(request, tmp_path_factory) -> tuple[Mode, LockstepSession]:
    """A machine in each mode."""
    mode = request.param
    if mode in {Mode.REFERENCE, Mode.COMMISSION}:
        more = INCREMENTAL if mode == Mode.REFERENCE else ()
        folder = tmp_path_factory.mktemp(mode.name)
        session = new_session(changed_configs(folder, *EMPTY, *more)).until_ready()
        session.execute(RequestKind.MODE, ModeRequest(mode, axis="right/hip"))
    elif mode == Mode.OFF:
        session = new_session()
        session.command("unplugged *")
        session.run_until(lambda record: record.mode == mode, within_s=10)
    elif mode in {Mode.READY, Mode.HOLD, Mode.GAIT}:
        session = request.getfixturevalue(f"warm_{mode.name.lower()}")
    else:
        session = new_session().enable()
        if mode in BY_REQUEST:
            session.request(RequestKind.MODE, BY_REQUEST[mode])
        elif mode in {Mode.STOPPING, Mode.FAULT}:
            session.gateway.stop()
            session.run_until(lambda record: record.mode == mode, within_s=5)
    assert session.record.mode == mode
    return mode, session


def asked(kind: RequestKind, wanted: ModeRequest, session: LockstepSession):
    answer = session.request(kind, wanted, within_s=20)
    return answer, reported(session.records, EventCode.REQUEST_REFUSED)


def test_a_request_is_answered_with_done_or_why_not(warm_mode):
    mode, session = warm_mode
    for name, (kind, wanted) in REQUESTS.items():
        answer, events = elsewhere(session, partial(asked, kind, wanted))

        if (mode, trigger_of(kind, wanted)) not in TRANSITIONS:
            assert answer.outcome == Outcome.REFUSED, name
            assert answer.refusal.code is RefusalCode.NOT_IN_THIS_MODE, name
        if answer.outcome == Outcome.REFUSED:
            assert answer.refusal in map(refusal_of, events), name
        else:
            assert (answer.outcome, answer.refusal) == (Outcome.DONE, None), name


def test_a_request_while_the_drives_are_brought_up_is_refused_there_and_then():
    """Bring-up takes many cycles in one turn of the loop: it hears and answers meanwhile."""
    session = new_session()
    gateway, waiting, answers = session.gateway, list(REQUESTS.values()), []

    def ask_the_next(record):
        if record.mode != Mode.BRINGING_UP:
            return
        if (
            len(waiting) + len(answers) < len(REQUESTS)
            and gateway.outcome().outcome != Outcome.PENDING
        ):
            answers.append(gateway.outcome())
        if waiting and len(waiting) + len(answers) == len(REQUESTS):
            gateway.request(*waiting.pop())

    gateway._on_record = ask_the_next
    session.run_until(lambda record: record.mode == Mode.READY, within_s=10)

    assert len(answers) == len(REQUESTS)
    assert {answer.outcome for answer in answers} == {Outcome.REFUSED}
    assert {answer.refusal.code for answer in answers} == {RefusalCode.NOT_IN_THIS_MODE}
    assert {answer.refusal.values[1] for answer in answers} == {Mode.BRINGING_UP}


def test_a_stop_is_obeyed_in_every_mode_that_moves_and_harms_in_none(warm_mode):
    mode, session = warm_mode

    session.gateway.stop()
    session.run(0.4)

    record = session.record
    assert not record.mode.active
    if mode.active:
        assert record.verdict.cause == Cause.STOP_REQUESTED
        assert record.mode == Mode.FAULT


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.READY, Mode.FAULT, Mode.STOPPING])
def test_a_mode_that_cannot_be_asked_for_is_refused_by_name(warm_ready, mode):
    answer = warm_ready.request(RequestKind.MODE, ModeRequest(mode))

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.NO_SUCH_MODE, values=(mode,))


def test_a_request_made_long_ago_is_refused_with_both_cycles(warm_ready):
    warm_ready.run(1.0)
    gateway = warm_ready.gateway
    gateway.request(RequestKind.ENABLE)
    gateway._request = type(gateway._request)(gateway._request.id, RequestKind.ENABLE, 1)

    warm_ready.run(0.1)

    assert gateway.outcome().outcome == Outcome.REFUSED
    refusal = gateway.outcome().refusal
    for_cycle, cycle = refusal.values
    assert refusal.code is RefusalCode.OLD
    assert for_cycle == 1 < cycle <= warm_ready.record.cycle


def test_a_leg_near_its_singularity_is_not_enabled_though_each_axis_is_inside_its_range(tmp_path):
    stretched = ("plant.toml", "slide.position_m = 0.5905", "slide.position_m = 0.918")
    session = new_session(changed_configs(tmp_path, stretched))
    for drive in ("right/hip", "right/slide"):
        session.command(f"blocked_rotor {drive}")  # else it would sink away from there

    answer = session.until_ready().request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.OUTSIDE_RANGE, "right")
    assert session.record.mode == Mode.READY
