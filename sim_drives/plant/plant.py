"""The trainer behind one leg's two virtual drives: receives orders, returns encoder and current.

`Trainer` holds the arrays that the compiled loop of `dynamics.py` advances. It has no clock: time
is the argument of `advance`. All random values come from the seed, one stream for each axis.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.mechanism.friction import EVERYWHERE, FrictionParameters, OverPosition
from observer.mechanism.mechanism import singularity_ratio
from observer.mechanism.parameters import LegParameters
from sim_drives.plant.actuation import Actuation, AxisActuation, AxisSample
from sim_drives.plant.dynamics import WORK, Constants, State, advance_steps
from sim_drives.plant.led import LEAD, follow, unled
from sim_drives.plant.motor import DRIVE, ORDER, fresh_loops, take_order
from sim_drives.plant.patient import EFFORT, compile_programme, resting_stride
from sim_drives.plant.recorded import Values
from sim_drives.plant.settings import (
    HipEffort,
    Loops,
    Motor,
    Motors,
    PlantTables,
    Programme,
    SlideEffort,
    Steady,
)
from sim_drives.plant.stick_slip import JOINT, LAW_CODES, STICKING, Bristles
from sim_drives.plant.stops import joint_stops, leg_reach
from sim_drives.plant.transmission import Elasticity, shafts_of
from sim_drives.plant.truth import Truth

HIP: Final = 0
SLIDE: Final = 1
NS_PER_US: Final = 1000

COASTING: Final = AxisActuation(
    actuation=Actuation.COAST,
    target_effort_si=0.0,
    target_position_si=0.0,
    target_velocity_si=0.0,
    deceleration_si=1.0,
    interpolation_s=0.01,
    effort_limit_si=0.0,
    velocity_limit_si=math.inf,
    following_error_si=math.inf,
    following_error_time_s=0.0,
    position_min_si=-math.inf,
    position_max_si=math.inf,
)
"""The order of a drive at power-on: no torque."""

COMPUTED: Final = Programme(
    name="computed",
    effort=(
        Steady(
            at_s=0.0,
            until_s=math.inf,
            rise_s=0.0,
            fall_s=0.0,
            hip=HipEffort(torque_nm=0.0),
            slide=SlideEffort(force_n=0.0),
        ),
    ),
)
"""The programme of a patient whose effort is set by `Trainer.exert`."""


class PlantError(ValueError):
    """Operator error: plant.toml and its robot file contradict each other; names key and value."""


class UnknownProgrammeError(ValueError):
    """Operator error: no patient programme of that name."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"patient programme `{name}` is unknown; known: {', '.join(known)}")


def _drive_row(row: np.void, motor: Motor, effort_per_a: float) -> None:
    row["current_time_constant_s"] = motor.current_time_constant_s
    row["effort_per_a"] = effort_per_a
    row["heating_k_per_a2"] = motor.resistance_ohm * motor.thermal_resistance_k_per_w
    row["thermal_time_constant_s"] = motor.thermal_time_constant_s


def _drives(motors: Motors, loops: Loops, effort_per_a: tuple[float, float]) -> NDArray[np.void]:
    rows = np.zeros(2, DRIVE)
    hip, slide = loops.hip, loops.slide
    rows["position_gain"] = (hip.position_gain_per_s, slide.position_gain_per_s)
    rows["velocity_gain"] = (hip.velocity_gain_nm_s_per_rad, slide.velocity_gain_n_s_per_m)
    rows["velocity_integral_s"] = (hip.velocity_integral_s, slide.velocity_integral_s)
    rows["position_deadband"] = (hip.position_deadband_rad, slide.position_deadband_m)
    rows["standstill_speed"] = (hip.standstill_rad_per_s, slide.standstill_m_per_s)
    _drive_row(rows[HIP], motors.hip, effort_per_a[HIP])
    _drive_row(rows[SLIDE], motors.slide, effort_per_a[SLIDE])
    return rows


class Physics(NamedTuple):
    """The machine of the plant's own robot file. Pairs are hip and slide."""

    leg: LegParameters
    """Mechanism, with or without a patient's leg."""
    frictions: tuple[FrictionParameters, FrictionParameters]
    drive_inertia: tuple[float, float]
    """Reflected inertia of the drives, kg·m² and kg, which `leg` contains."""
    over_position: tuple[OverPosition, OverPosition] = (EVERYWHERE, EVERYWHERE)


def _constants(settings: PlantTables, physics: Physics) -> Constants:
    hip, slide = settings.friction.hip, settings.friction.slide
    step = settings.step
    if step.drive_loop_us % step.physics_us != 0:
        raise PlantError(
            f"`step.drive_loop_us` = {step.drive_loop_us} must be a whole multiple of "
            f"`step.physics_us` = {step.physics_us}"
        )
    return Constants(
        leg=physics.leg,
        frictions=physics.frictions,
        over_position=physics.over_position,
        bristles=(
            Bristles(hip.bristle_stiffness_nm_per_rad, hip.bristle_damping_nm_s_per_rad),
            Bristles(slide.bristle_stiffness_n_per_m, slide.bristle_damping_n_s_per_m),
        ),
        stops=joint_stops(settings.stops.hip, settings.stops.slide),
        reach=leg_reach(settings.stops.ankle, physics.leg),
        law=LAW_CODES[settings.friction.law],
        step_s=step.physics_us * 1e-6,
        loop_steps=step.drive_loop_us // step.physics_us,
        activation_s=settings.patient.activation_s,
    )


def _elastic(
    settings: PlantTables, inertia: tuple[float, float]
) -> tuple[Elasticity | None, Elasticity | None]:
    """What of [transmission] is not rigid."""
    hip, slide = settings.transmission.hip, settings.transmission.slide
    made = (
        None
        if hip is None
        else Elasticity(
            hip.stiffness_nm_per_rad, hip.damping_nm_s_per_rad, hip.backlash_rad, inertia[HIP]
        ),
        None
        if slide is None
        else Elasticity(
            slide.stiffness_n_per_m, slide.damping_n_s_per_m, slide.backlash_m, inertia[SLIDE]
        ),
    )
    for name, one in zip(("hip", "slide"), made, strict=True):
        if one is not None and one.inertia_si <= 0.0:
            raise PlantError(
                f"`transmission.{name}` needs a drive with inertia, and the robot file's has none"
            )
    return made


def _start_state(
    settings: PlantTables, constants: Constants, elastic: tuple[Elasticity | None, ...]
) -> State:
    pose = (math.radians(settings.start.hip.position_deg), settings.start.slide.position_m)
    for name, value, stop in zip(
        ("start.hip.position_deg", "start.slide.position_m"), pose, constants.stops, strict=True
    ):
        if not stop.low_si <= value <= stop.high_si:
            raise PlantError(
                f"`{name}` lies outside its stops, {stop.low_si:.4g} to {stop.high_si:.4g}"
            )
    ratio = singularity_ratio(constants.leg, np.array(pose))
    if ratio <= settings.stops.ankle.edge_ratio:
        raise PlantError(
            f"`start`: |sin(shank, shoe)| = {ratio:.3f} at this pose, inside "
            f"`stops.ankle.edge_ratio` = {settings.stops.ankle.edge_ratio} (0: out of reach)"
        )
    joints = np.zeros(2, JOINT)
    joints["position"] = pose
    joints["stuck"] = int(constants.law == STICKING)
    return State(
        joints=joints,
        loops=fresh_loops(),
        stride=resting_stride(pose[HIP]),
        work=np.zeros(1, WORK),
        leads=np.zeros(2, LEAD),
        shafts=shafts_of(pose, elastic),
        patient=np.zeros(2),
        speed=np.zeros(2),
    )


class Trainer:
    """Mechanism, two motors with their inner loops, friction, stops and patient of one leg."""

    def __init__(
        self,
        settings: PlantTables,
        physics: Physics,
        effort_per_a: tuple[float, float],
        seed: int,
        start_ns: int,
        recorded: Mapping[str, Values] | None = None,
    ) -> None:
        """Build the plant at rest in its start pose, both power stages off.

        Args:
            settings: physics tables of plant.toml.
            physics: the machine of the plant's own robot file.
            effort_per_a: joint effort per ampere, N·m/A and N/A, positive: k_t gear (2 pi / lead).
            seed: seed of noise and jitter; another leg takes another one.
            start_ns: the time now; the physics grid begins here.
            recorded: strides (`recorded.read_strides`) by the file of a patient's recorded effort.

        Raises:
            PlantError: the tables contradict each other or the robot file.
            UnknownProgrammeError: `patient.start` names none.
        """
        self._settings = settings
        self._constants = _constants(settings, physics)
        elastic = _elastic(settings, physics.drive_inertia)
        self._state = _start_state(settings, self._constants, elastic)
        # Python's floats by `item`: several times as fast as the fields of a record.
        self._joints = _fields(self._state.joints)
        self._shafts = _fields(self._state.shafts)
        self._loops = _fields(self._state.loops)
        self._flags = self._loops["flags"]
        self._drives = _drives(settings.motor, settings.loop, effort_per_a)
        self._effort_per_a = effort_per_a
        self._orders = np.zeros(2, ORDER)
        self._order_fields = tuple(_fields(self._orders).values())
        self._ordered = [
            AxisActuation(Actuation(actuation), *numbers)
            for actuation, *numbers in self._orders.tolist()
        ]
        self._step_ns = settings.step.physics_us * NS_PER_US
        self._start_ns = start_ns
        self._step_index = 0
        self._now_ns = start_ns
        self._noise = [np.random.default_rng((seed, axis)) for axis in (HIP, SLIDE)]
        self._programmes = {programme.name: programme for programme in settings.patient.programme}
        self._recorded = recorded or {}
        self._programme_name = ""
        self._programme = np.zeros(0, EFFORT)
        self._programme_start = 0
        self._repeat_s = math.inf
        for axis in (HIP, SLIDE):
            self.set_axis(axis, COASTING)
        self.patient(settings.patient.start)

    @property
    def now_ns(self) -> int:
        """The simulated time of the plant."""
        return self._now_ns

    @property
    def programmes(self) -> tuple[str, ...]:
        """Names of the programmes that `patient` accepts."""
        return tuple(self._programmes)

    def set_axis(self, axis: int, actuation: AxisActuation) -> None:
        """Give an axis a new order; it acts from the next step of the grid.

        Sending the same order again changes nothing; a new position target starts a new line from
        the present set point. Another actuation clears the flags of the last one.
        """
        loop, before = self._state.loops[axis], self._ordered[axis]
        take_order(self._order_fields, axis, loop, actuation, before)
        self._ordered[axis] = actuation

    def block_rotor(self, axis: int, blocked: bool) -> None:
        """Block an axis's rotor from outside, or free it. A moving axis stops in one step."""
        self._state.joints[axis]["blocked"] = int(blocked)

    def lead(self, axis: int, period_s: float) -> None:
        """Move an axis by the positions that `follow` gets, once a cycle; until then it rests."""
        self._state.leads[axis] = unled(period_s)
        self._state.joints[axis]["led"] = 1

    def follow(self, axis: int, sampled_ns: int, position: float) -> None:
        """Take the position of a led axis, sampled by its drive at a SYNC."""
        stop = self._constants.stops[axis]
        follow(
            self._state.leads[axis],
            (sampled_ns - self._start_ns) * 1e-9,
            position,
            float(self._state.joints[axis]["position"]),
            (stop.low_si, stop.high_si),
        )

    def wire_motor(self, axis: int, sense: int) -> None:
        """Connect the motor: +1 with the right sign, -1 inverted."""
        self._state.loops[axis]["motor_sense"] = sense

    def wire_encoder(self, axis: int, sense: int) -> None:
        """Connect the encoder: +1 with the right sign, -1 inverted from its last value on."""
        loop = self._state.loops[axis]
        position = self._state.shafts[axis]["position"]
        seen = loop["encoder_sense"] * position + loop["encoder_shift"]
        loop["encoder_sense"] = sense
        loop["encoder_shift"] = 0.0 if sense > 0 else seen - sense * position

    def offset_current(self, axis: int, offset_a: float) -> None:
        """Add an offset to the current sensor's value, joint sign."""
        self._state.loops[axis]["sensed_too_much"] = offset_a * self._drives[axis]["effort_per_a"]

    def patient(self, name: str) -> None:
        """Start a programme of the patient now.

        Raises:
            UnknownProgrammeError: the settings have none of that name.
        """
        if name not in self._programmes:
            raise UnknownProgrammeError(name, self.programmes)
        self._start_programme(self._programmes[name])

    def exert(self, hip_nm: float, slide_n: float) -> None:
        """Set the patient's effort until the next call; replaces the programme.

        For a patient who is computed elsewhere, for example one who reacts to the motion.
        """
        if self._programme_name != COMPUTED.name:
            self._start_programme(COMPUTED)
        self._programme["peak"] = (hip_nm, slide_n)

    def advance(self, to_ns: int) -> int:
        """Advance the plant to `to_ns`, or until a flag newly rises on either axis.

        Returns: the time reached, `to_ns` or the end of the step in which the flag rose.

        Raises:
            ValueError: `to_ns` lies in the past (a bug of the caller).
        """
        if to_ns < self._now_ns:
            raise ValueError(f"the plant is at {self._now_ns} ns and cannot go back to {to_ns} ns")
        step_count = (to_ns - self._start_ns) // self._step_ns - self._step_index
        rose = False
        if step_count > 0:
            done, rose = advance_steps(
                self._constants,
                self._drives,
                self._orders,
                self._state,
                self._programme,
                self._programme_start,
                self._repeat_s,
                self._step_index,
                step_count,
            )
            self._step_index += done
        self._now_ns = self._grid_ns if rose else to_ns
        return self._now_ns

    def sample(self, axis: int) -> AxisSample:
        """Sample the drive's sensors now; every call draws new noise and jitter."""
        noise = self._noise[axis]
        sensor = self._settings.sensor
        jitter_s = sensor.latch_jitter_us * 1e-6 * noise.random()
        position, velocity = _motion(self._shafts, axis, self._since_grid_s + jitter_s)
        spread = sensor.hip.position_noise_rad if axis == HIP else sensor.slide.position_noise_m
        current = sensor.hip if axis == HIP else sensor.slide
        loops = self._loops
        unpowered = loops["acting"].item(axis) == Actuation.COAST
        too_much = loops["sensed_too_much"].item(axis) if unpowered else 0.0
        current_a = (loops["effort"].item(axis) + too_much) / self._effort_per_a[axis]
        sense = loops["encoder_sense"].item(axis)
        seen = sense * position + loops["encoder_shift"].item(axis)
        return AxisSample(
            position_si=seen + spread * noise.standard_normal(),
            velocity_si=sense * velocity,
            current_a=current_a + current.current_noise_a * noise.standard_normal(),
            temperature_degc=self._settings.motor.ambient_degc + loops["warming_k"].item(axis),
        )

    def flags(self, axis: int) -> int:
        """Return the present flags of the axis, bits of `AxisFlag`."""
        return self._flags.item(axis)

    def truth(self) -> Truth:
        """Return the present true state, including what no drive measures."""
        joints, since_s = self._joints, self._since_grid_s
        effort = self._true_effort(HIP), self._true_effort(SLIDE)
        impulse = _pair(joints["effort_impulse"])
        stuck = joints["stuck"]
        hip, slide = (_motion(joints, axis, since_s) for axis in (HIP, SLIDE))
        return Truth(
            time_ns=self._now_ns,
            position=(hip[0], slide[0]),
            velocity=(hip[1], slide[1]),
            patient=_pair(joints["patient"]),
            friction=_pair(joints["friction"]),
            effort=effort,
            contact=_pair(joints["contact"]),
            effort_impulse=(impulse[0] + effort[0] * since_s, impulse[1] + effort[1] * since_s),
            sticking=(bool(stuck.item(HIP)), bool(stuck.item(SLIDE))),
            programme=self._programme_name,
        )

    def _true_effort(self, axis: int) -> float:
        """As `motor.joint_effort` of what the drive measures; a call of the kernel costs more."""
        loops = self._loops
        effort = loops["effort"].item(axis)
        if loops["acting"].item(axis) != Actuation.COAST:
            effort -= loops["sensed_too_much"].item(axis)
        return loops["motor_sense"].item(axis) * effort

    def work(self) -> dict[str, float]:
        """Work done on the mechanism since the start, J: by drives, patient, friction, contact."""
        return {name: float(self._state.work[name][0]) for name in WORK.fields or ()}

    def _start_programme(self, programme: Programme) -> None:
        self._programme, self._repeat_s = compile_programme(programme, self._recorded)
        self._programme_name = programme.name
        self._programme_start = self._step_index

    @property
    def _grid_ns(self) -> int:
        return self._start_ns + self._step_index * self._step_ns

    @property
    def _since_grid_s(self) -> float:
        return (self._now_ns - self._grid_ns) * 1e-9


def _motion(parts: Mapping[str, NDArray[Any]], axis: int, ahead_s: float) -> tuple[float, float]:
    """Position and velocity of a joint or a shaft a fraction of a step after the grid."""
    grid_velocity = parts["velocity"].item(axis)
    velocity = grid_velocity + parts["acceleration"].item(axis) * ahead_s
    position = parts["position"].item(axis) + ahead_s * (grid_velocity + velocity) * 0.5
    return position, velocity


def _fields(records: NDArray[np.void]) -> dict[str, NDArray[Any]]:
    """Views of the fields of records."""
    return {name: records[name] for name in records.dtype.names or ()}


def _pair(values: NDArray[np.float64]) -> tuple[float, float]:
    return values.item(0), values.item(1)
