"""Limits that only motion shows: found with every make of drive, and never without a reason."""

from itertools import product

import pytest
from sessions import Session, changed_configs, elmo_drives, generic_drives, position_guidance
from stopping_faults import FAULTS

from daemon.core import cycle, watching
from daemon.record import Cause, Mode, ModeRequest, Outcome, RequestKind, StopCategory
from drives.signals import PowerState
from observer.status import Status, Validity

DRIVES = ("right/hip", "right/slide")
PATIENTS = ("active", "resisting", "pushes")
MAKES = {"generic": generic_drives, "elmo": elmo_drives, "position": position_guidance}


def stopped_by(session, within_s):
    return session.lockstep.run_until(lambda record: not record.mode.active, within_s=within_s)


@pytest.mark.parametrize("cadence_hz", [0.25, 0.5])
def test_no_shipped_patient_stops_the_gait(cadence_hz):
    session = Session().walking(cadence_hz=cadence_hz, warm_s=4.0)

    for patient in ("passive", *PATIENTS):
        session.machine.command(f"patient {patient}")
        session.lockstep.run(6.0)

    assert session.lockstep.record.mode == Mode.GAIT


@pytest.mark.parametrize("make", MAKES)
def test_no_make_of_drive_nor_its_own_loops_stop_the_gait(make, tmp_path):
    session = Session(MAKES[make](tmp_path)).walking(cadence_hz=0.5, warm_s=4.0)

    session.machine.command("patient active")
    session.lockstep.run(8.0)

    assert session.lockstep.record.mode == Mode.GAIT


@pytest.mark.parametrize("scenario", ["open_loop", "delay"])
def test_quick_steps_and_sines_of_torque_are_followed(scenario):
    session = Session().exciting(scenario, 8.0)

    session.lockstep.run(9.0)

    assert session.lockstep.record.mode == Mode.HOLD


@pytest.mark.parametrize(
    ("drive", "value_ma"),
    [("right/hip", -2000), ("right/hip", 2000), ("right/slide", -2500), ("right/slide", 2500)],
)
def test_a_current_sensor_that_shows_too_much_is_found_within_a_stride(drive, value_ma):
    """A larger step at once, 14 N m or 80 N, looks like a spasm and stops as one before that."""
    session = Session().walking(warm_s=6.0)

    session.machine.command(f"torque_offset {drive} - {value_ma}")
    stopped = stopped_by(session, 6.0)

    assert stopped.verdict.cause == Cause.EFFORT_DEVIATION
    assert stopped.verdict.drive == drive


@pytest.mark.parametrize("drive", DRIVES)
def test_a_current_sensor_that_shows_torque_without_power_is_found_before_anything_moves(drive):
    session = Session().until_ready()

    session.machine.command(f"torque_offset {drive} - 3000")
    session.lockstep.run_until(lambda record: record.mode == Mode.FAULT, within_s=1)

    verdict = session.lockstep.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.EFFORT_DEVIATION, drive)


@pytest.mark.parametrize(
    ("fault", "drive", "warm_s"),
    list(product(("wrong_sign", "encoder_reversed"), DRIVES, (3.5, 4.3))),
)
def test_an_axis_that_is_wired_the_wrong_way_round_is_named_and_loses_its_power(
    fault, drive, warm_s
):
    session = Session().walking(warm_s=warm_s)

    session.machine.command(f"{fault} {drive}")
    stopped = stopped_by(session, 1.0)
    session.lockstep.run(0.1)

    verdict = stopped.verdict
    assert (verdict.cause, verdict.drive) == (Cause.SIGN_WRONG, drive)
    assert verdict.category == StopCategory.S0
    states = {one.name: one.power_state for one in session.lockstep.record.drives}
    other = next(name for name in DRIVES if name != drive)
    assert states[drive] == PowerState.SWITCH_ON_DISABLED
    assert states[other] == PowerState.QUICK_STOP_ACTIVE


@pytest.mark.parametrize("law", ["paper_sticking", "lugre"])
def test_an_axis_that_sticks_while_the_other_one_moves_is_no_frozen_encoder(law, tmp_path):
    change = ("plant.toml", 'law = "paper"', f'law = "{law}"')
    session = Session(changed_configs(tmp_path, change)).walking(warm_s=4.0)

    session.machine.command("patient resisting")
    session.lockstep.run(8.0)

    assert session.lockstep.record.mode == Mode.GAIT


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("guidance", ["impedance", "position"])
def test_a_frozen_encoder_is_found_by_whoever_guides(guidance, drive, tmp_path):
    make = position_guidance if guidance == "position" else changed_configs
    session = Session(make(tmp_path)).walking(warm_s=3.5)

    session.machine.command(f"frozen_encoder {drive}")
    stopped_by(session, 3.0)
    session.lockstep.run(3.0)

    assert session.lockstep.record.verdict.cause == Cause.ENCODER_FROZEN
    assert session.lockstep.record.verdict.drive == drive


@pytest.mark.parametrize("cadence_hz", [0.25, 0.5])
def test_a_spasm_first_softens_the_guidance_and_then_stops(cadence_hz):
    session = Session().walking(cadence_hz=cadence_hz, warm_s=4.3)
    leg = session.lockstep.core.legs[0]
    assert leg.spasm_ratio == 1.0

    session.machine.command("patient spasm")
    session.lockstep.run_until(lambda _: leg.spasm_ratio < 1.0, within_s=1.0)
    begun = session.lockstep.record
    stopped = stopped_by(session, 1.0)

    assert begun.mode == Mode.GAIT
    assert leg.spasm_ratio == pytest.approx(0.5)
    assert stopped.verdict.cause == Cause.SPASM
    assert stopped.sync_mono_ns - begun.sync_mono_ns <= 420_000_000


def test_more_energy_in_a_stride_than_allowed_stops(tmp_path):
    change = ("limits.toml", "stride_energy_max_j = 400.0", "stride_energy_max_j = 100.0")
    session = Session(changed_configs(tmp_path, change)).enabled()

    begin_walking(session)
    stopped = stopped_by(session, 30.0)

    assert (stopped.verdict.cause, stopped.verdict.drive) == (Cause.ENERGY_LIMIT, "right/slide")


def test_a_leg_that_could_not_stop_inside_its_range_is_stopped_before_it_leaves():
    session = Session().walking(cadence_hz=0.5, warm_s=4.0)
    hip = session.lockstep.core.legs[0].axes[0]

    # As if the drives' ramp were weaker than the gait: it then counts on more room than there is.
    hip.limits = hip.limits._replace(quick_stop_deceleration_si_per_s2=10.0)
    stopped = stopped_by(session, 4.0)
    session.lockstep.run(1.0)

    assert (stopped.verdict.cause, stopped.verdict.drive) == (Cause.STOPPING_PATH, "right/hip")
    highest_rad = max(row.hip_angle_rad for row in session.truth.rows)
    assert highest_rad < hip.limits.position_max_si


def begin_walking(session):
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=1.0, duration_s=60.0)
    answer = session.lockstep.request(RequestKind.MODE, gait)
    assert answer.outcome == Outcome.DONE, answer.reason


# --- without the observer -------------------------------------------------------------------------


def plausible(estimate):
    """What an observer would say that sees nothing at all."""
    return type(estimate)(
        state=(0.24, 0.59, 0.1, 0.1, 6.0, 60.0, 0.0, 0.0),
        std=(1e-4, 1e-4, 0.01, 0.01, 0.1, 1.0, 0.1, 1.0),
        covariance=tuple(0.0 for _ in range(36)),
        innovation=(0.0, 0.0),
        nis=2.0,
        mean_nis=2.0,
        net=(0.0, 0.0),
        net_std=(0.1, 1.0),
        validity=(Validity.OK, Validity.OK),
        status=Status.VALID,
    )


def blind(session, monkeypatch):
    """From now on the observer says plausible constants."""
    leg = session.lockstep.core.legs[0]
    constant = plausible(leg.observer.step((0.24, 0.59), (0.0, 0.0), 0.01))
    monkeypatch.setattr(type(leg.observer), "step", lambda *_, **__: constant)
    monkeypatch.setattr(cycle, "look_back", lambda *_: None)
    return session


OBSERVERS_OWN = {Cause.OBSERVER_INVALID, Cause.SPASM}
BLIND_FAULTS = [
    *FAULTS,
    ("wrong_sign {}", {Cause.SIGN_WRONG}),
    ("encoder_reversed {}", {Cause.SIGN_WRONG}),
    ("torque_offset {} - 3000", {Cause.EFFORT_DEVIATION}),
]


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize(
    ("fault", "causes"), BLIND_FAULTS, ids=[text.split()[0] for text, _ in BLIND_FAULTS]
)
def test_an_observer_that_says_plausible_constants_hides_no_other_stop(
    fault, causes, drive, monkeypatch
):
    session = blind(Session().walking(warm_s=3.5), monkeypatch)

    session.machine.command(fault.format(drive))
    stopped_by(session, 6.0)
    session.lockstep.run(3.0)

    record = session.lockstep.record
    assert record.mode == Mode.FAULT
    assert record.verdict.cause in causes - OBSERVERS_OWN
    assert record.verdict.drive == drive


def test_only_a_spasm_and_a_bad_estimate_are_the_observers_own(monkeypatch):
    session = blind(Session().walking(warm_s=3.5), monkeypatch)

    session.machine.command("patient spasm")
    session.lockstep.run(1.2)

    assert watching.stride_drift(session.lockstep.core.legs[0], session.lockstep.core.axes[0]) != 0
    assert session.lockstep.record.verdict.cause not in OBSERVERS_OWN
