"""The physics tables of plant.toml: one struct per table, the range beside the name.

The mechanism and the friction levels come from a robot file of the plant's own (`robot`), so that
plant and observer can have different parameters. The tables here hold what only the plant has: the
friction law, mechanical stops, motors, the drives' inner loops, sensors, and the patient.
"""

from enum import Enum
from typing import Annotated

import msgspec
from msgspec import Meta


class FrictionLaw(Enum):
    """The plant's friction law; levels and speeds come from the robot file."""

    PAPER = "paper"
    """Eq. (11) to (13) as in the observer. Under load it creeps at rest."""
    PAPER_STICKING = "paper_sticking"
    """Eq. (11) and (12) while sliding, with ideal sticking: an axis at rest does not move."""
    LUGRE = "lugre"
    """Bristles: sticks elastically; a structure different from the observer's."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of the file."""


class Step(Table, frozen=True):
    """Fixed steps of the simulation."""

    physics_us: Annotated[int, Meta(ge=20, le=500)]
    drive_loop_us: Annotated[int, Meta(ge=20, le=1000)]
    """Period of the drives' position and velocity loops: a whole multiple of `physics_us`."""


class HipStart(Table, frozen=True):
    """The hip at power-on."""

    position_deg: Annotated[float, Meta(ge=-60, le=120)]


class SlideStart(Table, frozen=True):
    """The slide at power-on."""

    position_m: Annotated[float, Meta(ge=-1, le=2)]


class Start(Table, frozen=True):
    """Pose at power-on, at rest."""

    hip: HipStart
    slide: SlideStart


class HipBristles(Table, frozen=True):
    """LuGre's bristles at the hip; unused by the paper's law."""

    bristle_stiffness_nm_per_rad: Annotated[float, Meta(ge=1, le=1e5)]
    bristle_damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=1e3)]


class SlideBristles(Table, frozen=True):
    """LuGre's bristles at the slide; unused by the paper's law."""

    bristle_stiffness_n_per_m: Annotated[float, Meta(ge=10, le=1e7)]
    bristle_damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1e4)]


class PlantFriction(Table, frozen=True):
    """Law and bristles."""

    law: FrictionLaw
    hip: HipBristles
    slide: SlideBristles


class HipElasticity(Table, frozen=True):
    """An elastic transmission between the hip's drive and its joint."""

    stiffness_nm_per_rad: Annotated[float, Meta(ge=10, le=1e6)]
    damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=1e3)]
    backlash_rad: Annotated[float, Meta(ge=0, le=0.2)] = 0.0


class SlideElasticity(Table, frozen=True):
    """An elastic transmission between the slide's drive and the slide."""

    stiffness_n_per_m: Annotated[float, Meta(ge=100, le=1e8)]
    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1e5)]
    backlash_m: Annotated[float, Meta(ge=0, le=0.05)] = 0.0


class PlantTransmission(Table, frozen=True):
    """Both axes; one that is not named is rigid, and its drive's shaft moves with the joint."""

    hip: HipElasticity | None = None
    slide: SlideElasticity | None = None


class HipStop(Table, frozen=True):
    """Mechanical end stops of the hip: springs with dampers that only push."""

    min_deg: Annotated[float, Meta(ge=-90, le=120)]
    max_deg: Annotated[float, Meta(ge=-90, le=120)]
    stiffness_nm_per_rad: Annotated[float, Meta(ge=1, le=1e5)]
    damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=1e3)]


class SlideStop(Table, frozen=True):
    """Mechanical end stops of the slide."""

    min_m: Annotated[float, Meta(ge=-1, le=2)]
    max_m: Annotated[float, Meta(ge=-1, le=2)]
    stiffness_n_per_m: Annotated[float, Meta(ge=10, le=1e7)]
    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1e5)]


class AnkleStop(Table, frozen=True):
    """The rigid stop between shank and shoe, which keeps the mechanism off its singularity."""

    edge_ratio: Annotated[float, Meta(gt=0.02, lt=1)]
    """|sin| of the angle between shank and shoe where the stop begins."""


class Stops(Table, frozen=True):
    """All mechanical stops."""

    hip: HipStop
    slide: SlideStop
    ankle: AnkleStop


class Motor(Table, frozen=True):
    """One motor with its power stage."""

    current_time_constant_s: Annotated[float, Meta(ge=1e-6, le=0.05)]
    """Time constant of the closed current loop, a first-order lag."""
    resistance_ohm: Annotated[float, Meta(ge=1e-3, le=100)]
    thermal_resistance_k_per_w: Annotated[float, Meta(ge=1e-3, le=100)]
    thermal_time_constant_s: Annotated[float, Meta(ge=0.1, le=1e5)]


class Motors(Table, frozen=True):
    """Both motors and the ambient temperature."""

    ambient_degc: Annotated[float, Meta(ge=-20, le=60)]
    hip: Motor
    slide: Motor


class Loop(Table, frozen=True):
    """A drive's own position (P) and velocity (PI) loops, in joint units."""

    position_gain_per_s: Annotated[float, Meta(ge=0.01, le=500)]
    velocity_integral_s: Annotated[float, Meta(ge=1e-3, le=1e3)]


class HipLoop(Loop, frozen=True):
    """The hip drive's own loops."""

    velocity_gain_nm_s_per_rad: Annotated[float, Meta(ge=0.01, le=1e4)]
    position_deadband_rad: Annotated[float, Meta(ge=0, le=0.1)]
    """Position error that the drive cannot detect: one count of its encoder."""
    standstill_rad_per_s: Annotated[float, Meta(ge=1e-5, le=1)]
    """Below this speed a stopped axis is at standstill."""


class SlideLoop(Loop, frozen=True):
    """The slide drive's own loops."""

    velocity_gain_n_s_per_m: Annotated[float, Meta(ge=0.1, le=1e5)]
    position_deadband_m: Annotated[float, Meta(ge=0, le=0.1)]
    standstill_m_per_s: Annotated[float, Meta(ge=1e-5, le=1)]


class Loops(Table, frozen=True):
    """Both drives' loops."""

    hip: HipLoop
    slide: SlideLoop


class Sensor(Table, frozen=True):
    """Noise (standard deviations) before quantisation."""

    current_noise_a: Annotated[float, Meta(ge=0, le=10)]


class HipSensor(Sensor, frozen=True):
    """Noise of the hip."""

    position_noise_rad: Annotated[float, Meta(ge=0, le=0.1)]


class SlideSensor(Sensor, frozen=True):
    """Noise of the slide."""

    position_noise_m: Annotated[float, Meta(ge=0, le=0.1)]


class Sensors(Table, frozen=True):
    """The drives' sensors."""

    latch_jitter_us: Annotated[float, Meta(ge=0, le=1000)]
    """A drive latches its encoder up to this much after the SYNC, at its own loop's next tick."""
    hip: HipSensor
    slide: SlideSensor


# --- the patient ------------------------------------------------------------------------------


class HipEffort(Table, frozen=True):
    """The patient's torque at the hip."""

    torque_nm: Annotated[float, Meta(ge=-100, le=100)]


class SlideEffort(Table, frozen=True):
    """The patient's force at the slide."""

    force_n: Annotated[float, Meta(ge=-1000, le=1000)]


class HipWave(HipEffort, frozen=True):
    """A torque at the hip that swings."""

    phase_deg: Annotated[float, Meta(ge=-360, le=360)]


class SlideWave(SlideEffort, frozen=True):
    """A force at the slide that swings."""

    phase_deg: Annotated[float, Meta(ge=-360, le=360)]


class HipPush(HipEffort, frozen=True):
    """A torque at a hip that stands."""

    rest_rad_per_s: Annotated[float, Meta(ge=0.001, le=10)]


class SlidePush(SlideEffort, frozen=True):
    """A force at a slide that stands."""

    rest_m_per_s: Annotated[float, Meta(ge=0.001, le=10)]


class Effort(Table, frozen=True):
    """One part of a programme; parts that overlap add up. Positive acts along the positive axis."""

    at_s: Annotated[float, Meta(ge=0, le=1e6)]
    """Time since the programme began."""
    until_s: Annotated[float, Meta(ge=0.001, le=1e6)]
    rise_s: Annotated[float, Meta(ge=0, le=1e6)]
    fall_s: Annotated[float, Meta(ge=0, le=1e6)]
    hip: HipEffort
    slide: SlideEffort


class Steady(Effort, frozen=True, tag_field="kind", tag="steady"):
    """A step, or with a long `rise_s` a ramp."""


class Sine(Effort, frozen=True, tag_field="kind", tag="sine"):
    """An effort over time: cos(2 pi f t + phase)."""

    frequency_hz: Annotated[float, Meta(ge=0.001, le=10)]
    hip: HipWave
    slide: SlideWave


class Gait(Effort, frozen=True, tag_field="kind", tag="gait"):
    """An effort over the stride: cos(n theta + phase), theta = 0 at the largest hip flexion.

    The plant does not use the service's phase; it estimates theta from the hip's motion, and the
    effort is zero while the hip does not swing.
    """

    harmonic: Annotated[int, Meta(ge=1, le=4)]
    hip: HipWave
    slide: SlideWave


class Push(Effort, frozen=True, tag_field="kind", tag="push"):
    """A push while the axis stands; it is weaker where the axis moves faster than `rest`."""

    hip: HipPush
    slide: SlidePush


class Spasm(Effort, frozen=True, tag_field="kind", tag="spasm"):
    """An effort against the motion at its onset, for all its duration; short `rise_s`."""


class Recorded(Effort, frozen=True, tag_field="kind", tag="recorded"):
    """Measured efforts over the stride, from a file (recorded.py): those of each stride in turn.

    They are scaled: `hip.torque_nm` and `slide.force_n` are the sizes of the largest ones. As with
    `Gait` the phase is that of the hip's motion, and the effort is zero while the hip does not
    swing.
    """

    file: Annotated[str, Meta(min_length=1)]
    """Path relative to plant.toml."""


class Programme(Table, frozen=True):
    """A programme, started by `gaitd sim`'s command `patient NAME`. No effort: passive patient."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9_-]+\Z")]
    repeat_s: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None
    """The programme repeats after this time; without it, it runs once."""
    effort: tuple[Steady | Sine | Gait | Recorded | Push | Spasm, ...] = ()


class Patient(Table, frozen=True):
    """The patient: muscles with a first-order activation, and programmes to choose from."""

    start: str
    activation_s: Annotated[float, Meta(ge=0, le=10)]
    """Time constant between the script and the torque; 0 for none."""
    programme: Annotated[tuple[Programme, ...], Meta(min_length=1)]


class PlantTables(Table, frozen=True, kw_only=True):
    """The physics half of plant.toml."""

    robot: str
    """The plant's own robot file, by path relative to this file."""
    seed: Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]
    step: Step
    start: Start
    friction: PlantFriction
    stops: Stops
    motor: Motors
    loop: Loops
    sensor: Sensors
    patient: Patient
    transmission: PlantTransmission = PlantTransmission()
