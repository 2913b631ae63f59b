"""One compiled loop: the mechanism, both motors, friction, stops and patient, step by step.

A step of the physics, order 2 in the smooth forces:

    half a step of position at the old velocity
    forces there: bias (Coriolis, dampers, gravity, springs), motors, patient, stops
    the whole step of velocity, with friction solved at velocity level (stick_slip.py)
    half a step of position at the new velocity; a led axis is where it is led

A shaft behind an elastic transmission (transmission.py) takes the same half steps.

Velocity-dependent forces take the velocity extrapolated by half a step. Steps lie on a fixed grid,
so advancing in one go or in pieces gives the same bits.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel
from observer.mechanism.friction import FrictionParameters, OverPosition, at_position
from observer.mechanism.linkage import dynamics
from observer.mechanism.parameters import LegParameters
from sim_drives.plant.actuation import Actuation
from sim_drives.plant.led import led_motion
from sim_drives.plant.motor import (
    STOP_NEGATIVE,
    STOP_POSITIVE,
    lag_current,
    run_loops,
    set_flag,
    warm,
)
from sim_drives.plant.patient import follow_stride, script
from sim_drives.plant.stick_slip import Bristles, slide_or_stick
from sim_drives.plant.stops import Reach, Stop, keep_in_reach, stop_effort
from sim_drives.plant.transmission import go_along, transmit

Records = NDArray[np.void]

WORK: Final = np.dtype([("drives", "f8"), ("patient", "f8"), ("friction", "f8"), ("contact", "f8")])
"""Work done on the mechanism since the start, J."""


class Constants(NamedTuple):
    """Constant parameters of a plant."""

    leg: LegParameters
    frictions: tuple[FrictionParameters, FrictionParameters]
    over_position: tuple[OverPosition, OverPosition]
    bristles: tuple[Bristles, Bristles]
    stops: tuple[Stop, Stop]
    reach: Reach
    law: int
    step_s: float
    loop_steps: int
    activation_s: float


class State(NamedTuple):
    """Arrays of records that the kernels write; one record for each axis unless noted."""

    joints: Records
    loops: Records
    stride: Records
    """One record."""
    work: Records
    """One record."""
    leads: Records
    """LEAD records (led.py)."""
    shafts: Records
    """SHAFT records (transmission.py)."""
    patient: NDArray[np.float64]
    """Effort of the script, shape (2,), scratch."""
    speed: NDArray[np.float64]
    """Shape (2,), scratch."""


@kernel
def _run_drives(
    drives: Records, orders: Records, state: State, tick: bool, loop_s: float, step_s: float
) -> None:
    """Run the drives' loops; a torque target reaches the current loop without their tick."""
    for axis in range(2):
        torque_only = orders[axis]["actuation"] <= Actuation.TORQUE
        if tick or torque_only:
            shaft, loop = state.shafts[axis], state.loops[axis]
            seen = loop["encoder_sense"] * shaft["position"] + loop["encoder_shift"]
            speed = loop["encoder_sense"] * shaft["velocity"]
            run_loops(loop, drives[axis], orders[axis], seen, speed, loop_s, step_s)


@kernel
def _move_patient(constants: Constants, state: State, programme: Records, elapsed_s: float) -> None:
    """Compute the script, then the muscle activation: first order, exact for a constant script."""
    joints = state.joints
    state.speed[0] = joints[0]["velocity"]
    state.speed[1] = joints[1]["velocity"]
    follow_stride(state.stride[0], joints[0]["position"], constants.step_s)
    script(programme, state.stride[0], elapsed_s, state.speed, state.patient)
    share = 1.0
    if constants.activation_s > 0.0:
        share = 1.0 - math.exp(-constants.step_s / constants.activation_s)
    for axis in range(2):
        joints[axis]["patient"] += share * (state.patient[axis] - joints[axis]["patient"])


@kernel
def _touch_stops(constants: Constants, state: State, rates: tuple[float, float]) -> None:
    """Compute the contact efforts of both axes' end stops, and their flags."""
    for axis in range(2):
        stop = constants.stops[axis]
        joint = state.joints[axis]
        position = joint["position"]
        joint["contact"] = stop_effort(stop, position, rates[axis])
        set_flag(state.loops[axis], STOP_NEGATIVE, position < stop.low_si)
        set_flag(state.loops[axis], STOP_POSITIVE, position > stop.high_si)


@kernel
def _midpoint_speed(joint: np.void, step_s: float) -> float:
    return joint["velocity"] + 0.5 * step_s * joint["acceleration"]


@kernel
def _book_work(state: State, effort: float, axis: int, step_s: float) -> None:
    joint, shaft = state.joints[axis], state.shafts[axis]
    way = 0.5 * (joint["velocity"] + joint["next_velocity"]) * step_s
    turned = way
    if shaft["elastic"]:  # its velocity is already that after the step
        turned = (shaft["velocity"] - 0.5 * step_s * shaft["acceleration"]) * step_s
    work = state.work[0]
    work["drives"] += effort * turned
    work["patient"] += joint["patient"] * way
    work["friction"] -= joint["friction"] * way
    work["contact"] += joint["contact"] * way
    joint["effort_impulse"] += effort * step_s


@kernel
def _step(constants: Constants, drives: Records, state: State) -> None:
    """Compute one step of the physics with the present orders of the drives and the patient."""
    step_s = constants.step_s
    joints, shafts = state.joints, state.shafts
    for axis in range(2):
        joints[axis]["position"] += 0.5 * step_s * joints[axis]["velocity"]
        shafts[axis]["position"] += 0.5 * step_s * shafts[axis]["velocity"]
    rates = (_midpoint_speed(joints[0], step_s), _midpoint_speed(joints[1], step_s))
    _touch_stops(constants, state, rates)
    d = dynamics(
        constants.leg, joints[0]["position"], joints[1]["position"], rates[0], rates[1], 1.0
    )
    mass = (
        d.m11 - shafts[0]["elastic"] * shafts[0]["inertia"],
        d.m12,
        d.m22 - shafts[1]["elastic"] * shafts[1]["inertia"],
    )
    effort = (
        lag_current(state.loops[0], drives[0], step_s),
        lag_current(state.loops[1], drives[1], step_s),
    )
    bias = (d.bias_hip, d.bias_slide)
    for axis in range(2):
        joint, shaft = joints[axis], shafts[axis]
        reaching = effort[axis]
        if shaft["elastic"]:
            reaching = transmit(shaft, joint, effort[axis], step_s)
        joint["load"] = reaching + joint["patient"] + joint["contact"] - bias[axis]
    frictions = (
        at_position(constants.frictions[0], constants.over_position[0], joints[0]["position"]),
        at_position(constants.frictions[1], constants.over_position[1], joints[1]["position"]),
    )
    slide_or_stick(constants.law, frictions, constants.bristles, joints, mass, step_s)
    struck = keep_in_reach(constants.leg, constants.reach, joints, mass, step_s)
    for axis in range(2):
        _book_work(state, effort[axis], axis, step_s)
        joint = joints[axis]
        change = joint["next_velocity"] - joint["velocity"]
        # A collision ends with its step: its acceleration must not be extrapolated.
        smooth = joint["led"] or (joint["held"] == 0 and not struck)
        joint["acceleration"] = change / step_s if smooth else 0.0
        joint["velocity"] = joint["next_velocity"]
        joint["position"] += 0.5 * step_s * joint["velocity"]
        if joint["led"]:
            joint["position"] = joint["led_position"]
        if shafts[axis]["elastic"]:
            shafts[axis]["position"] += 0.5 * step_s * shafts[axis]["velocity"]
        else:
            go_along(shafts[axis], joint)
        warm(state.loops[axis], drives[axis], step_s)


@kernel
def _lead(state: State, end_s: float) -> None:
    """Give the led axes the motion that they have at the end of the step, `end_s` since start."""
    for axis in range(2):
        joint, lead = state.joints[axis], state.leads[axis]
        if joint["led"]:
            position, velocity = led_motion(lead, end_s, joint["position"])
            joint["led_position"], joint["led_velocity"] = position, velocity


@kernel
def advance_steps(
    constants: Constants,
    drives: Records,
    orders: Records,
    state: State,
    programme: Records,
    programme_start: int,
    repeat_s: float,
    first_step: int,
    step_count: int,
) -> tuple[int, bool]:
    """Advance by up to `step_count` steps; stops after the step in which a flag rose.

    Args:
        constants: parameters of the plant.
        drives: two DRIVE records.
        orders: two ORDER records.
        state: written.
        programme: the patient's efforts.
        programme_start: step at which the programme began.
        repeat_s: the programme's repetition, infinite for none.
        first_step: index of the first step on the grid.
        step_count: steps to do.

    Returns: steps done, and whether a flag rose in the last one.
    """
    loop_s = constants.loop_steps * constants.step_s
    for done in range(step_count):
        index = first_step + done
        before = (state.loops[0]["flags"], state.loops[1]["flags"])
        tick = index % constants.loop_steps == 0
        _run_drives(drives, orders, state, tick, loop_s, constants.step_s)
        elapsed_s = (index - programme_start) * constants.step_s
        if elapsed_s >= repeat_s:
            elapsed_s -= math.floor(elapsed_s / repeat_s) * repeat_s
        _move_patient(constants, state, programme, elapsed_s)
        _lead(state, (index + 1) * constants.step_s)
        _step(constants, drives, state)
        rose = (state.loops[0]["flags"] & ~before[0]) | (state.loops[1]["flags"] & ~before[1])
        if rose != 0:
            return done + 1, True
    return step_count, False
