"""A drive that takes long to enable, as its brake opens: its axis file says how long it may."""

from gaitd_names import Mode, Outcome, RequestKind
from sessions import changed_configs, new_session

HIP = "drives/hip_epos4.toml"
MAY = (HIP, "node_id = 5\n", "node_id = 5\nenable_max_ms = 1000\n")


def test_a_drive_that_may_take_a_second_is_enabled_and_held(tmp_path):
    session = new_session(changed_configs(tmp_path, MAY)).until_ready()
    session.command("slow_state right/hip - 300")  # each transition
    answer = session.request(RequestKind.ENABLE)
    session.run(0.5)

    assert (answer.outcome, session.record.mode) == (Outcome.DONE, Mode.HOLD)
    assert all(axis.sensed.reached_enabled for axis in session.core.axes)
