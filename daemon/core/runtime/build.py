"""Build a core and its bring-up plans from the configuration: the only file that imports both."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from daemon.config.bundle import LegDrives, Settings
from daemon.config.drive_plan import cycle_settings, drive_limits
from daemon.config.limit_settings import Limits
from daemon.config.robot import (
    considered,
    friction_parameters,
    frictional,
    leg_parameters,
    observer_tuning,
)
from daemon.config.settings import Commissioning, Reference, Robot, Trainer
from daemon.core.core_config import CoreConfig
from daemon.core.exercises.single_axis import HomingRules, PushRules, SingleAxis
from daemon.core.modes.persistent_state import PersistentState, PoseRules, Wiring
from daemon.core.motion.assist import AssistRules
from daemon.core.motion.gait_shape import gait_shape
from daemon.core.safety.clonus import ClonusWatch
from daemon.core.safety.limits import AxisLimits, Categories, axis_limits, thresholds
from daemon.core.safety.spasm import SpasmRules, SpasmWatch
from daemon.core.safety.stop_sequence import StopRules
from daemon.core.state import Axis, Core, Leg, Observers
from daemon.core.steps import passive
from daemon.ipc.transport import RingHeader
from drives.bringup.plan import CycleSettings, DrivePlan, homing_plan, plan, single_axis_plan
from drives.cia402.profile import DriveDescription
from drives.cia402.units import axis_scaling, expected_base
from observer.filter.leg_observer import LegObserver
from observer.leg_smoother import LegSmoother
from observer.strides import StrideCounter

NS_PER_MS = 1_000_000
HOMING_SPEED_RATIO = 3.0
"""Speed limit of a homing, as a multiple of its search speed."""
LEG_DIGEST_LENGTH = 16
"""Number of hexadecimal digits that distinguish two robot files."""
SECOND_LEG_PHASE = 0.5
"""Phase of the second leg relative to the first, in strides."""


@dataclass(frozen=True, slots=True)
class Plans:
    """Bring-up plans of the drives: usual ones, and special ones for homing and sign test."""

    usual: tuple[DrivePlan, ...]
    homing: Mapping[str, DrivePlan]
    """Plan of the homed axis, by its name."""
    commissioning: Mapping[str, DrivePlan]
    """Plan of the axis whose sign is tested, by its name."""

    def of(self, run: SingleAxis | None) -> tuple[DrivePlan, ...]:
        """The plans of all drives for the next homing or sign test, or the usual ones."""
        if run is None or run.is_over:
            return self.usual
        special = (self.homing if run.by_drive else self.commissioning)[run.axis]
        return tuple(special if one.description.name == run.axis else one for one in self.usual)


@dataclass(frozen=True, slots=True)
class Built:
    """A core before bring-up, with the plans for its bring-up."""

    core: Core
    plans: Plans
    cycle: CycleSettings


def build(settings: Settings, boot_id: str, persistent: PersistentState) -> Built:
    """Build a core from the configuration and the persistent state of its last run."""
    limits = settings.limits
    by_axis = axis_limits(limits, settings.robot)
    legs = tuple(
        _leg(settings, leg, by_axis, index * SECOND_LEG_PHASE)
        for index, leg in enumerate(settings.legs)
    )
    patient_configured = settings.robot.patient is not None
    leg_digest = settings.hashes[str(settings.file.robot)][:LEG_DIGEST_LENGTH]
    trainer = settings.trainer
    if patient_configured and settings.robot.calibration is not None:
        # A calibration that missed a limit moves no patient before a self-test has passed on it.
        tested = msgspec.structs.replace(trainer.self_test, required="daily")
        trainer = msgspec.structs.replace(trainer, self_test=tested)
    config = _core_config(trainer, limits, patient_configured, leg_digest)
    cycle = cycle_settings(settings.trainer.cycle)
    return Built(
        Core(boot_id=boot_id, config=config, legs=legs, persistent=persistent),
        _plans(settings, cycle),
        cycle,
    )


def _plans(settings: Settings, cycle: CycleSettings) -> Plans:
    limits = drive_limits(settings.limits)
    pushes = _pushes(settings.trainer.commissioning)
    axes = [
        axis
        for leg in settings.legs
        for axis in zip((leg.hip, leg.slide), limits, pushes, strict=True)
    ]
    return Plans(
        usual=tuple(plan(drive, bounds, cycle) for drive, bounds, _ in axes),
        homing={
            drive.name: homing_plan(drive, bounds, cycle)
            for drive, bounds, _ in axes
            if drive.axis.homing is not None
        },
        commissioning={
            drive.name: single_axis_plan(drive, bounds, cycle, push.effort_max_si)
            for drive, bounds, push in axes
        },
    )


def _pushes(commissioning: Commissioning) -> tuple[PushRules, PushRules]:
    return (
        PushRules(
            commissioning.hip.torque_max_nm,
            commissioning.hip.torque_rate_nm_per_s,
            math.radians(commissioning.hip.motion_deg),
        ),
        PushRules(
            commissioning.slide.force_max_n,
            commissioning.slide.force_rate_n_per_s,
            commissioning.slide.motion_m,
        ),
    )


def _poses(reference: Reference) -> tuple[PoseRules, PoseRules]:
    believed = reference.without_stored_pose == "believe"
    return (
        PoseRules(math.radians(reference.hip.pose_tolerance_deg), believed),
        PoseRules(reference.slide.pose_tolerance_m, believed),
    )


def ring_header(settings: Settings, boot_id: str, start_utc_ns: int, version: str) -> RingHeader:
    """The header of the ring: identity, configuration and names for readers of the records."""
    return RingHeader(
        core_boot_id=boot_id,
        start_utc_ns=start_utc_ns,
        period_ns=settings.trainer.cycle.period_ms * NS_PER_MS,
        trainer=settings.trainer.zenoh.trainer,
        drive_names=tuple(drive.name for drive in settings.drives),
        leg_names=tuple(leg.name for leg in settings.legs),
        config_hashes=dict(settings.hashes),
        version=version,
        robot=msgspec.to_builtins(settings.robot),
        limits=msgspec.to_builtins(settings.limits),
        guidance=msgspec.to_builtins(settings.trainer.gait.impedance),
    )


def _core_config(
    trainer: Trainer, limits: Limits, patient_configured: bool, leg_digest: str
) -> CoreConfig:
    period_ms = trainer.cycle.period_ms
    stop = limits.stop
    return CoreConfig(
        period_ns=period_ms * NS_PER_MS,
        period_s=period_ms * NS_PER_MS * 1e-9,
        thresholds=thresholds(limits, period_ms),
        categories=Categories(limits.stop_category),
        stop_rules=StopRules(
            obey_cycles=stop.obey_cycles,
            standstill_cycles=stop.standstill_cycles,
            ramp_margin_ratio=stop.ramp_margin_ratio,
            period_s=period_ms * 1e-3,
            reaction_cycles=0,  # set per axis
        ),
        spasm=SpasmRules(
            window_cycles=limits.spasm.rise_window_ms // period_ms,
            stiffness_ratio=limits.spasm.stiffness_ratio,
            softening_ratio=period_ms / limits.spasm.softening_ms,
            recovery_ratio=period_ms / limits.spasm.recovery_ms,
        ),
        assist_rules=AssistRules(
            age_max_cycles=limits.assist.setpoint_age_max_cycles,
            start_cycles=limits.assist.first_setpoint_cycles,
            fade_cycles=max(stop.assist_fade_ms // period_ms, 1),
            stiffness_step_ratio=limits.assist.stiffness_rate_max_ratio_per_s * period_ms * 1e-3,
        ),
        hold=trainer.hold,
        gait=trainer.gait,
        excite=dict(trainer.excite),
        hand_guiding=trainer.hand_guiding,
        self_test=trainer.self_test,
        leg_digest=leg_digest,
        patient_configured=patient_configured,
        signs_must_be_proven=trainer.commissioning.signs == "proven",
    )


def _leg(
    settings: Settings, drives: LegDrives, bounds: tuple[AxisLimits, AxisLimits], phase: float
) -> Leg:
    parameters = leg_parameters(settings.robot)
    hip_friction, slide_friction = friction_parameters(settings.robot)
    tuning = observer_tuning(settings.robot)
    observer = LegObserver(
        parameters, hip_friction, slide_friction, tuning, considered(settings.robot)
    )
    trainer = settings.trainer
    rules = tuple(
        zip(bounds, _poses(trainer.reference), _pushes(trainer.commissioning), strict=True)
    )
    return Leg(
        name=drives.name,
        parameters=parameters,
        shape=gait_shape(settings.trainer.gait),
        axes=(
            _axis(drives.hip, *rules[0], trainer.cycle.period_ms, settings.limits),
            _axis(drives.slide, *rules[1], trainer.cycle.period_ms, settings.limits),
        ),
        observers=Observers(
            observer,
            LegSmoother(observer),
            StrideCounter(),
            (hip_friction, slide_friction),
            tuning.friction_over_position,
            tuning.effort_offset,
            _slope_std(settings.robot),
            frictional(settings.robot),
        ),
        passive=passive.from_file(drives.baseline),
        phase_offset_strides=phase,
    )


def _slope_std(robot: Robot) -> tuple[float, float] | None:
    """How sure an empty machine's friction over position is; None with a patient."""
    if robot.patient is not None:
        return None
    unsure = robot.uncertainty
    return unsure.hip.friction_slope_per_rad, unsure.slide.friction_slope_per_m


def wiring_of(drive: DriveDescription) -> Wiring:
    """The settings of a drive for which the proof of its sign is valid."""
    transmission = drive.axis.transmission
    return Wiring(
        drive.node_id,
        transmission.sign,
        transmission.gear_ratio,
        transmission.lead_m,
        transmission.counts_per_rev,
    )


def _axis(
    drive: DriveDescription,
    bounds: AxisLimits,
    poses: PoseRules,
    push: PushRules,
    period_ms: int,
    limits: Limits,
) -> Axis:
    homing = drive.axis.homing
    return Axis(
        name=drive.name,
        node_id=drive.node_id,
        limits=bounds._replace(enable_max_cycles=drive.axis.enable_max_ms // period_ms),
        # The torque base of the drive file is used until bring-up has read that of the drive.
        scaling=axis_scaling(drive, expected_base(drive)),
        wiring=wiring_of(drive),
        poses=poses,
        push=push,
        homing=None
        if homing is None
        else HomingRules(
            homing.effort_max_si,
            HOMING_SPEED_RATIO * homing.search_speed_si_per_s,
            round(homing.timeout_s * 1000 / period_ms),
        ),
        torque_sampling=drive.profile.torque_source.sampling,
        spasm=SpasmWatch(limits.spasm.rise_window_ms // period_ms),
        clonus=ClonusWatch(period_ms, limits.clonus.window_ms),
        reaction_cycles=drive.profile.fault_reaction_max_ms // period_ms,
    )
