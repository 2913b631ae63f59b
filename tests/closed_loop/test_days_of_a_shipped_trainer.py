"""The first days of a real trainer, with the settings of configs/trainer.toml as they are shipped.

Other tests use demo.toml, whose virtual machine is allowed much that a real one is not: any pose,
signs that were never proven, no daily test. Here only the bus is another one, and the drives
are mounted the other way round, with their zero elsewhere.
"""

import math

import pytest
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind
from msgspec.structs import replace
from sessions import changed_configs, single_axis_run

from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession

HIP, SLIDE = "right/hip", "right/slide"
VIRTUAL = (
    ("trainer.toml", "announce_s = 3.0", "announce_s = 0.5"),
    ("trainer.toml", '"socketcan"\nchannel = "can0"', '"simulated"\nchannel = "bus"'),
    ("trainer.toml", 'limits = "limits.toml"', 'limits = "limits.toml"\nsim = "plant.toml"'),
)
HIP_FILE, SLIDE_FILE = "drives/hip_epos4.toml", "drives/slide_epos4.toml"
MIRRORED = (
    (HIP_FILE, "\nsign = 1", "\nsign = -1"),
    (HIP_FILE, "offset_rad = 0.0", "offset_rad = 1.3"),
    (HIP_FILE, "method = 17 ", "method = 18 "),
    (SLIDE_FILE, "\nsign = -1", "\nsign = 1"),
    (SLIDE_FILE, "offset_m = 0.0", "offset_m = -0.37"),
    (SLIDE_FILE, "method = 18 ", "method = 17 "),
    ("plant.toml", "\nsign = -1", "\nsign = +1"),  # the slide's
    ("plant.toml", "\nsign = 1", "\nsign = -1"),  # the hip's
    ("plant.toml", "offset_rad = 0.0", "offset_rad = 1.3"),
    ("plant.toml", "offset_m = 0.0", "offset_m = -0.37"),
)
EMPTY = (
    ("trainer.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
    # A search three times as fast, which finds its switch sooner.
    (HIP_FILE, "search_speed_si_per_s = 0.1", "search_speed_si_per_s = 0.3"),
    (SLIDE_FILE, "search_speed_si_per_s = 0.05", "search_speed_si_per_s = 0.15"),
)
START = {HIP: math.radians(13.98), SLIDE: 0.5905}
"""Where the leg of plant.toml is strapped in."""
DAY_NS = 86_400_000_000_000
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=1.0, duration_s=60.0)
INPUTS = ("hand_switch_open *", "sto_open *")


def refused(session, kind, wanted=None):
    answer = session.request(kind, wanted)
    assert answer.outcome == Outcome.REFUSED
    return answer.refusal.code


def ready(session):
    assert session.record.mode == Mode.READY
    assert session.record.verdict.cause == Cause.NONE
    assert all(drive.referenced and drive.sign_proven for drive in session.record.drives)
    if session.truth.rows:
        truth, (hip, slide) = session.truth.rows[-1], session.record.drives
        assert hip.position == pytest.approx(truth.hip_angle_rad, abs=2e-3)
        assert slide.position == pytest.approx(truth.slide_position_m, abs=1e-3)


@pytest.fixture(scope="module")
def warm_commissioned(tmp_path_factory):
    """An engineer has proven and homed both axes of the empty machine, and ended the service."""
    configs = changed_configs(tmp_path_factory.mktemp("empty"), *VIRTUAL, *MIRRORED, *EMPTY)
    session = LockstepSession(load(configs / "trainer.toml")).until_ready()
    assert refused(session, RequestKind.ENABLE) is RefusalCode.SIGN_NOT_PROVEN
    for axis in (HIP, SLIDE):
        single_axis_run(session, Mode.COMMISSION, axis)
        session.execute(RequestKind.MODE, ModeRequest(Mode.COMMISSION, axis=axis, witnessed=True))
        single_axis_run(session, Mode.REFERENCE, axis)
    session.run(0.1)
    ready(session)
    session.shut_down()
    return session.state_file.persistent


def prepared(session):
    """The daily test of hand switch, emergency stop and both axes; then both axes hold."""
    session.until_ready()
    ready(session)
    assert refused(session, RequestKind.ENABLE) is RefusalCode.INPUT_UNTESTED
    for order in INPUTS:
        session.command(order)
        session.run(0.3)
        session.command(f"clear {order}")
        session.run(0.3)
    session.execute(RequestKind.RESET)
    session.until_ready()
    session.execute(RequestKind.ENABLE)
    assert refused(session, RequestKind.MODE, GAIT) is RefusalCode.SELF_TEST_DUE
    session.execute(RequestKind.MODE, ModeRequest(Mode.SELF_TEST))
    session.run_until(lambda record: record.mode != Mode.SELF_TEST, within_s=60.0)
    assert session.record.mode == Mode.HOLD


def test_a_trainer_is_commissioned_and_trains_a_day_through_a_stop_and_is_tested_the_next(
    warm_commissioned, tmp_path
):
    settings = load(changed_configs(tmp_path, *VIRTUAL, *MIRRORED) / "trainer.toml")
    axes = warm_commissioned.axes
    left = {name: replace(axes[name], position_si=START[name]) for name in axes}
    session = LockstepSession(settings, persistent=replace(warm_commissioned, axes=left))
    session.clock.utc_stepped_ns = DAY_NS
    prepared(session)
    session.execute(RequestKind.MODE, GAIT)
    session.run_until(lambda record: record.gait_phase >= 0.3, within_s=30.0)
    session.command("sto_open *")
    session.until(Mode.FAULT, within_s=5.0)
    assert session.record.verdict.cause == Cause.STO_ACTIVE
    session.command("clear sto_open *")
    session.run(0.3)
    session.execute(RequestKind.RESET)
    session.until_ready()
    ready(session)
    session.run(1.0)  # without power the leg sinks into its springs
    session.execute(RequestKind.ENABLE)
    session.execute(RequestKind.DISABLE)
    session.shut_down()

    next_day = LockstepSession(settings, session.machine, persistent=session.state_file.persistent)
    next_day.clock.utc_stepped_ns = 2 * DAY_NS
    for axis in (HIP, SLIDE):
        next_day.command(f"reboot {axis}")
    next_day.until_ready()

    ready(next_day)
    assert refused(next_day, RequestKind.ENABLE) is RefusalCode.INPUT_UNTESTED
