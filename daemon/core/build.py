"""A core and its bring-up plans from the configuration: the only place that knows both."""

from dataclasses import dataclass

import msgspec

from daemon.config.axes import cycle_settings, drive_limits
from daemon.config.bundle import LegDrives, Settings
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Limits, Trainer
from daemon.core.limits import AxisLimits, Categories, Thresholds, hip_limits, slide_limits
from daemon.core.reference import gait_shape
from daemon.core.state import Axis, Core, CoreConfig, Leg
from daemon.core.stopping import StopRules
from daemon.seam import RingHeader
from drives.plan import CycleSettings, DrivePlan, plan
from drives.profile import DriveDescription
from drives.units import axis_scaling, expected_base
from observer.leg_observer import LegObserver
from observer.leg_smoother import LegSmoother
from observer.strides import StrideCounter

NS_PER_MS = 1_000_000
SECOND_LEG_PHASE = 0.5
"""The second leg walks half a stride behind the first."""


@dataclass(frozen=True, slots=True)
class Built:
    """A core that has not met its drives yet, and how to meet them."""

    core: Core
    plans: tuple[DrivePlan, ...]
    cycle: CycleSettings


def build(settings: Settings, boot_id: str) -> Built:
    """Everything of the core that the configuration decides."""
    friction = friction_parameters(settings.robot)
    limits = settings.limits
    by_axis = (
        hip_limits(limits, friction[0].stribeck),
        slide_limits(limits, friction[1].stribeck),
    )
    legs = tuple(
        _leg(settings, leg, by_axis, index * SECOND_LEG_PHASE)
        for index, leg in enumerate(settings.legs)
    )
    config = _core_config(settings.trainer, limits, settings.robot.patient is not None)
    cycle = cycle_settings(settings.trainer.cycle)
    hip, slide = drive_limits(limits)
    plans = tuple(
        one
        for leg in settings.legs
        for one in (plan(leg.hip, hip, cycle), plan(leg.slide, slide, cycle))
    )
    return Built(Core(boot_id=boot_id, config=config, legs=legs), plans, cycle)


def ring_header(settings: Settings, boot_id: str, start_utc_ns: int, version: str) -> RingHeader:
    """What a recording says of itself."""
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
    )


def _core_config(trainer: Trainer, limits: Limits, patient_configured: bool) -> CoreConfig:
    period_ms = trainer.cycle.period_ms
    communication, stop = limits.communication, limits.stop
    return CoreConfig(
        period_ns=period_ms * NS_PER_MS,
        thresholds=Thresholds(
            sample_age_max_cycles=communication.sample_age_max_cycles,
            heartbeat_timeout_ns=communication.heartbeat_timeout_ms * NS_PER_MS,
            gateway_silence_cycles=communication.gateway_silence_ms // period_ms,
            overruns_in_a_row=communication.overruns_in_a_row,
            encoder_frozen_cycles=communication.encoder_frozen_cycles,
            encoder_jump_ratio=communication.encoder_jump_ratio,
            singularity_stop_ratio=limits.singularity.stop_ratio,
            mode_switch_cycles=communication.mode_switch_cycles,
        ),
        categories=Categories(limits.stop_category),
        stop_rules=StopRules(
            obey_cycles=stop.obey_cycles,
            standstill_cycles=stop.standstill_cycles,
            ramp_margin_ratio=stop.ramp_margin_ratio,
            period_s=period_ms * 1e-3,
        ),
        hold=trainer.hold,
        gait=trainer.gait,
        excite=dict(trainer.excite),
        patient_configured=patient_configured,
    )


def _leg(
    settings: Settings, drives: LegDrives, bounds: tuple[AxisLimits, AxisLimits], phase: float
) -> Leg:
    parameters = leg_parameters(settings.robot)
    hip_friction, slide_friction = friction_parameters(settings.robot)
    observer = LegObserver(
        parameters, hip_friction, slide_friction, observer_tuning(settings.robot)
    )
    return Leg(
        name=drives.name,
        parameters=parameters,
        shape=gait_shape(settings.trainer.gait),
        axes=(_axis(drives.hip, bounds[0]), _axis(drives.slide, bounds[1])),
        observer=observer,
        smoother=LegSmoother(observer),
        strides=StrideCounter(drives.baseline),
        friction=(hip_friction, slide_friction),
        phase_offset_strides=phase,
    )


def _axis(drive: DriveDescription, bounds: AxisLimits) -> Axis:
    return Axis(
        name=drive.name,
        node_id=drive.node_id,
        limits=bounds,
        # Until the drive has told its torque base, the one that its file expects.
        scaling=axis_scaling(drive, expected_base(drive)),
    )
