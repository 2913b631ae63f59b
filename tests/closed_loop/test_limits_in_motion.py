"""Limits that only motion shows: each is found, and none without a reason."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from gaitd_names import Cause, Mode, RequestKind
from sessions import (
    changed_configs,
    new_session,
    reaches_rest_in_fault,
)
from wire import change_what_drives_say

from daemon.core.period import PERIOD_S
from daemon.core.steps import monitors
from daemon.ipc.record import ModeRequest
from observer.filter.status import Status, Validity
from observer.mechanism.mechanism import singularity_ratio

HELD = (Mode.HOLD, Cause.NONE)


def stopped_by(session, within_s):
    return session.run_until(lambda record: not record.mode.active, within_s=within_s)


def test_no_shipped_patient_who_works_against_it_stops_the_gait(warm_fast_gait):
    session = warm_fast_gait

    for patient in ("resisting", "pushes"):  # tests of accuracy play the others
        session.command(f"patient {patient}")
        session.run(2.0)

    assert session.record.mode == Mode.GAIT


def test_quick_steps_and_sines_of_torque_are_followed(warm_hold):
    warm_hold.excite("delay", 3.0)

    warm_hold.run_until(lambda record: record.mode == Mode.HOLD, within_s=6.0)

    assert warm_hold.record.mode == Mode.HOLD


def test_a_current_sensor_that_shows_too_much_is_found_within_a_stride(warm_gait):
    """A larger step at once, 14 N m or 80 N, looks like a spasm and stops as one before that."""
    drive = "right/hip"
    warm_gait.run(1.0)

    warm_gait.command(f"torque_offset {drive} - -2000")
    stopped = stopped_by(warm_gait, 6.0)

    assert stopped.verdict.cause == Cause.EFFORT_DEVIATION
    assert stopped.verdict.drive == drive


def test_a_current_sensor_that_shows_torque_without_power_is_found_before_anything_moves(
    warm_ready,
):
    drive = "right/slide"
    warm_ready.command(f"torque_offset {drive} - 3000")
    warm_ready.run_until(lambda record: record.mode == Mode.FAULT, within_s=1)

    verdict = warm_ready.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.EFFORT_DEVIATION, drive)


def test_an_axis_that_sticks_while_the_other_one_moves_is_no_frozen_encoder(tmp_path):
    change = ("plant.toml", 'law = "paper"', 'law = "paper_sticking"')
    session = new_session(changed_configs(tmp_path, change)).walk(cadence_hz=0.5)

    session.command("patient resisting")
    session.run(2.0)

    assert session.record.mode == Mode.GAIT


def test_a_spasm_first_softens_the_guidance_and_then_stops(warm_fast_gait):
    session = warm_fast_gait
    session.run(0.3)
    leg = session.core.legs[0]
    assert leg.softened.spasm_ratio == 1.0

    session.command("patient spasm")
    session.run_until(lambda _: leg.softened.spasm_ratio < 1.0, within_s=1.0)
    begun = session.record
    stopped = stopped_by(session, 1.0)

    assert begun.mode == Mode.GAIT
    assert leg.softened.spasm_ratio == pytest.approx(0.5)
    assert stopped.verdict.cause == Cause.SPASM
    assert stopped.sync_mono_ns - begun.sync_mono_ns <= 420_000_000


LIMITS = {
    Cause.POSITION_LIMIT: ("position_max_si", lambda now: now.joint.position_si),
    Cause.VELOCITY_LIMIT: ("velocity_max_si", lambda now: abs(now.joint.velocity_si)),
    Cause.EFFORT_LIMIT: ("effort_max_si", lambda now: abs(now.joint.effort_si)),
    Cause.POWER_LIMIT: ("power_max_w", lambda now: now.joint.effort_si * now.joint.velocity_si),
    Cause.TEMPERATURE_LIMIT: ("temperature_max_degc", lambda now: now.feedback.temperature_degc),
}


@pytest.mark.parametrize("cause", LIMITS, ids=lambda cause: cause.name)
def test_a_gait_stops_in_the_cycle_that_shows_a_value_beyond_a_limit(warm_fast_gait, cause):
    session, (limit, value_of) = warm_fast_gait, LIMITS[cause]
    hip = session.core.legs[0].axes[0]
    session.run_until(lambda _: value_of(hip.sensed) > 0.0, within_s=2.0)

    hip.limits = hip.limits._replace(**{limit: 0.8 * value_of(hip.sensed)})
    session.run(PERIOD_S)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.drive) == (cause, "right/hip")


def test_a_gait_stops_in_the_cycle_that_shows_a_leg_nearer_to_its_singularity_than_allowed(
    warm_fast_gait,
):
    session = warm_fast_gait
    core, leg = session.core, session.core.legs[0]
    now = singularity_ratio(
        leg.parameters, np.array([axis.sensed.joint.position_si for axis in leg.axes])
    )

    thresholds = core.config.thresholds._replace(singularity_stop_ratio=1.05 * now)
    core.config = replace(core.config, thresholds=thresholds)
    session.run(PERIOD_S)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.SINGULARITY, "right")


def test_more_energy_in_a_stride_than_allowed_stops(warm_fast_gait):
    slide = warm_fast_gait.core.legs[0].axes[1]
    slide.limits = slide.limits._replace(stride_energy_max_j=100.0)

    stopped = stopped_by(warm_fast_gait, 2.0)

    assert (stopped.verdict.cause, stopped.verdict.drive) == (Cause.ENERGY_LIMIT, "right/slide")


def test_the_energy_of_the_gait_before_it_is_not_that_of_a_hold(warm_fast_gait):
    """Two strides of it, which the window of a hold is as long as, are more than one may have."""
    warm_fast_gait.run(4.0)

    warm_fast_gait.execute(RequestKind.MODE, ModeRequest(Mode.HOLD))
    warm_fast_gait.run(0.5)

    assert (warm_fast_gait.record.mode, warm_fast_gait.record.verdict.cause) == HELD


def test_a_step_of_the_encoder_is_counted_once_also_where_samples_are_lost(warm_fast_gait):
    """Two of three samples are lost: their cycles add no energy of their own."""
    samples = itertools.count()

    def lossy(frame):
        return None if frame.can_id == 0x186 and next(samples) % 3 else frame

    change_what_drives_say(warm_fast_gait, lossy)
    warm_fast_gait.run(3.0)

    assert warm_fast_gait.record.mode == Mode.GAIT


def test_a_leg_that_could_not_stop_inside_its_range_is_stopped_before_it_leaves(warm_fast_gait):
    hip = warm_fast_gait.core.legs[0].axes[0]

    # As if the drives' ramp were weaker than the gait: it then counts on more room than there is.
    hip.limits = hip.limits._replace(quick_stop_deceleration_si_per_s2=10.0)
    stopped = stopped_by(warm_fast_gait, 4.0)
    warm_fast_gait.run(1.0)

    assert (stopped.verdict.cause, stopped.verdict.drive) == (Cause.STOPPING_PATH, "right/hip")
    highest_rad = max(row.hip_angle_rad for row in warm_fast_gait.truth.rows)
    assert highest_rad < hip.limits.position_max_si


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
    leg = session.core.legs[0]
    constant = plausible(leg.observers.observer.step((0.24, 0.59), (0.0, 0.0), 0.01))
    monkeypatch.setattr(type(leg.observers.observer), "step", lambda *_, **__: constant)
    monkeypatch.setattr(type(leg.observers.smoother), "add", lambda *_: None)
    return session


NEEDS_MOTION = [
    ("right/slide", "frozen_encoder {}", Cause.ENCODER_FROZEN),
    ("right/slide", "encoder_glitch {} - 2000", Cause.ENCODER_JUMP),
    ("right/hip", "wrong_sign {}", Cause.SIGN_WRONG),
    ("right/hip", "torque_offset {} - 3000", Cause.EFFORT_DEVIATION),
]
"""Faults that the core finds in positions and efforts; a drive or the bus tells the others."""
OBSERVERS_OWN = {Cause.OBSERVER_INVALID, Cause.SPASM, Cause.CLONUS}


@pytest.mark.parametrize(("drive", "fault", "cause"), NEEDS_MOTION)
def test_an_observer_that_says_plausible_constants_hides_no_other_stop(
    warm_gait, drive, fault, cause, monkeypatch
):
    blind(warm_gait, monkeypatch)

    warm_gait.command(fault.format(drive))
    stopped_by(warm_gait, 6.0)
    reaches_rest_in_fault(warm_gait)

    verdict = warm_gait.record.verdict
    assert (verdict.cause, verdict.drive) == (cause, drive)


def test_a_spasm_is_the_observers_own(warm_gait, monkeypatch):
    session = blind(warm_gait, monkeypatch)

    session.command("patient spasm")
    session.run(1.2)

    assert monitors.stride_drift(session.core.legs[0], session.core.axes[0]) != 0
    assert session.record.verdict.cause not in OBSERVERS_OWN
