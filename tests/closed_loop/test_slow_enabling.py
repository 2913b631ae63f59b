"""A drive that takes long to enable, as its brake opens: its axis file says how long it may."""

from gaitd_names import Cause, Mode, Outcome, RequestKind
from sessions import changed_configs, new_session

HIP = "drives/hip_epos4.toml"
MAY = (HIP, "node_id = 5\n", "node_id = 5\nenable_max_ms = 1000\n")


def enabling(configs):
    """Each transition of the hip's drive takes 300 ms."""
    session = new_session(configs).until_ready()
    session.command("slow_state right/hip - 300")
    return session, session.request(RequestKind.ENABLE)


def test_a_drive_that_may_take_a_second_is_enabled_and_held(tmp_path):
    session, answer = enabling(changed_configs(tmp_path, MAY))
    session.run(1.2)

    assert (answer.outcome, session.record.mode) == (Outcome.DONE, Mode.HOLD)
    assert all(axis.sensed.reached_enabled for axis in session.core.axes)


def test_one_that_takes_longer_than_its_file_says_is_a_stop(tmp_path):
    less = (*MAY[:2], "node_id = 5\nenable_max_ms = 400\n")
    session, _ = enabling(changed_configs(tmp_path, less))
    session.run(1.2)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.DRIVE_LEFT_ENABLED, "right/hip")
