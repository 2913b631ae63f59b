"""The invariants with the limits and drives of a configuration."""

from functools import partial

import numpy as np

from daemon.config.bundle import Settings
from daemon.config.drive_plan import drive_limits, effort_per_motor_nm
from daemon.config.robot import leg_parameters
from drives.cia402.torque import count_nm
from drives.cia402.units import expected_base
from gaitd_lab.random_sessions.assisted import AssistBounds, AssistWatch
from gaitd_lab.random_sessions.invariants import Watch
from gaitd_lab.random_sessions.stops import OBEY_CYCLES, STEPS, StopWatch
from gaitd_lab.random_sessions.watched_drive import AxisRules, WatchedDrive
from observer.mechanism.mechanism import gravity
from observer.mechanism.parameters import LegParameters
from sim_drives.build import Machine
from sim_drives.plant.truth import Pair


def build_watch(settings: Settings, machine: Machine) -> Watch:
    """Build the checker of all invariants for a service and its virtual machine."""
    cycle = settings.trainer.cycle
    escalation_s = STEPS * OBEY_CYCLES * cycle.period_ms * 1e-3
    detection_s = cycle.drive_detection_ms * 1e-3
    rules = [rule for number in range(len(settings.legs)) for rule in _rules(settings, number)]
    return Watch(
        drives={rule.node_id: WatchedDrive(rule, machine.world.node(rule.name)) for rule in rules},
        period_s=cycle.period_ms * 1e-3,
        detection_s=detection_s,
        load_of=partial(_load, leg_parameters(settings.robot)),
        assist=AssistWatch(_assist_bounds(settings)),
        stops=StopWatch(escalation_s + detection_s),
    )


def _load(leg: LegParameters, position: Pair) -> Pair:
    """Return the effort that holds the leg still: N·m, N."""
    hip_nm, slide_n = gravity(leg, np.array(position))
    return float(hip_nm), float(slide_n)


def _assist_bounds(settings: Settings) -> AssistBounds:
    limits = settings.limits
    return AssistBounds(
        most_si=(limits.hip.assist_max_nm, limits.slide.assist_max_n),
        age_max_cycles=limits.assist.setpoint_age_max_cycles,
        fade_cycles=limits.stop.assist_fade_ms // settings.trainer.cycle.period_ms,
        first_cycles=limits.assist.first_setpoint_cycles,
    )


def _rules(settings: Settings, number: int) -> tuple[AxisRules, AxisRules]:
    limits, leg = settings.limits, settings.legs[number]
    rates = limits.hip.torque_rate_max_nm_per_s, limits.slide.force_rate_max_n_per_s
    hold = settings.trainer.hold
    dampings = hold.hip.damping_nm_s_per_rad, hold.slide.damping_n_s_per_m
    hip, slide = (
        AxisRules(
            name=drive.name,
            node_id=drive.node_id,
            axis=axis,
            leg=leg.name,
            low_si=written.position_min_si,
            high_si=written.position_max_si,
            effort_per_count_si=count_nm(drive.profile.target_torque, expected_base(drive))
            * effort_per_motor_nm(drive),
            rate_si_per_s=rates[axis],
            damping_si=dampings[axis],
        )
        for axis, (drive, written) in enumerate(
            zip((leg.hip, leg.slide), drive_limits(limits), strict=True)
        )
    )
    return hip, slide
