"""Tables of the configuration files: one struct per table, the range beside the name.

Unknown keys, missing keys and values out of range are refused. Nothing physical and nothing that
safety depends on has a default. `preflight/load.py` reads the files into one `Settings`.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

NodeId = Annotated[int, Meta(ge=1, le=127)]
Degrees = Annotated[float, Meta(ge=-180, le=180)]
Ratio = Annotated[float, Meta(ge=0, le=0.5)]
"""A standard deviation relative to its parameter."""
Harmonic = tuple[Degrees, Degrees]
Locator = Annotated[
    str, Meta(pattern=r"^(tcp|udp|tls|quic|ws)/.+:[0-9]{1,5}\Z|^unixsock-stream//.+\Z")
]
Text = Annotated[str, Meta(min_length=1)]


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of a file."""


# --- robot.toml -----------------------------------------------------------------------------


class Geometry(Table, frozen=True):
    """Link lengths, recline of the trunk from vertical, and the rail (observer.md 2.1)."""

    thigh_length_m: Annotated[float, Meta(gt=0.2, le=0.7)]
    """Hip axis to knee axis. Measure it on the exoskeleton with this patient. A centimetre
    wrong bends reference and gravity by some per cent."""
    shank_length_m: Annotated[float, Meta(gt=0.2, le=0.7)]
    """Knee axis to ankle axis."""
    shoe_length_m: Annotated[float, Meta(gt=0.05, le=0.5)]
    """Ankle axis to the joint on the slide, under the forefoot."""
    recline_deg: Annotated[float, Meta(ge=0, le=90)]
    """Angle of the trunk from the vertical; 90 is lying. The zero of the hip angle turns with
    it."""
    rail_x_m: Annotated[float, Meta(ge=-2, le=2)]
    """Where the slide position is 0, from the hip axis: forwards."""
    rail_y_m: Annotated[float, Meta(ge=-2, le=2)]
    """The same: upwards."""
    rail_angle_deg: Annotated[float, Meta(ge=-180, le=180)]
    """Direction of rising slide position, from the horizontal."""
    thigh_offset_deg: Annotated[float, Meta(ge=-45, le=45)]
    """Hip angle that the exoskeleton's thigh has when the patient's is 0."""


class Segment(Table, frozen=True):
    """One link of the exoskeleton; its centre of mass in link lengths from the proximal joint."""

    mass_kg: Annotated[float, Meta(ge=0, le=50)]
    """Mass of the exoskeleton's link alone; the patient's leg is added from `[patient]`."""
    com_ratio: Annotated[float, Meta(ge=0, le=1.5)]
    """Distance of the centre of mass from the upper joint, as a ratio of the link's length."""
    com_offset_deg: Annotated[float, Meta(ge=-180, le=180)]
    """Direction of the centre of mass, from the link's."""
    inertia_kg_m2: Annotated[float, Meta(ge=0, le=10)]
    """About the centre of mass."""


class Slide(Table, frozen=True):
    """The carriage: `mass_kg` has weight and inertia, the drive's reflected mass only inertia."""

    mass_kg: Annotated[float, Meta(ge=0, le=50)]
    """Mass of what moves along the rail and weighs along it."""
    drive_mass_kg: Annotated[float, Meta(ge=0, le=200)]
    """Reflected inertia of rotor and belt, as a mass that has no weight: rotor inertia times
    the square of the gear's rad/m."""


class Hip(Table, frozen=True):
    """The hip drive's inertia, reflected to the joint."""

    drive_inertia_kg_m2: Annotated[float, Meta(ge=0, le=20)]
    """Reflected inertia of rotor and gear: rotor inertia times the square of the gear's ratio."""


class HipSpring(Table, frozen=True):
    """Weight compensation at the hip drive; at the rest position the spring is slack."""

    stiffness_nm_per_rad: Annotated[float, Meta(ge=0, le=500)]
    """Stiffness of the spring that carries the leg; 0: none."""
    rest_rad: Annotated[float, Meta(ge=-20, le=20)]
    """Position at which the spring gives nothing. Set it so that the leg rests at the gait's
    mean pose; `gaitd check` prints where it rests."""


class SlideSpring(Table, frozen=True):
    """Weight compensation at the slide drive; at the rest position the spring is slack."""

    stiffness_n_per_m: Annotated[float, Meta(ge=0, le=5000)]
    rest_m: Annotated[float, Meta(ge=-20, le=20)]


class Springs(Table, frozen=True):
    """Weight compensation at both drives."""

    hip: HipSpring
    slide: SlideSpring


class Dampers(Table, frozen=True):
    """Passive joint dampers, of the relative angular velocity of the two links."""

    hip_nm_s_per_rad: Annotated[float, Meta(ge=0, le=50)]
    """Viscous friction of the hip joint, without the drive's, which is in `[friction]`. `gaitd
    calibrate` finds it with the rest."""
    knee_nm_s_per_rad: Annotated[float, Meta(ge=0, le=50)]
    """Damping of the knee."""
    ankle_nm_s_per_rad: Annotated[float, Meta(ge=0, le=50)]
    """Damping of the ankle."""
    slide_joint_nm_s_per_rad: Annotated[float, Meta(ge=0, le=50)]
    """Damping of the joint between shoe and slide."""


class HipFriction(Table, frozen=True):
    """Friction law (13) at the hip and its time constant, eq. (11).

    With bristles the time constant does not act on friction, and (13) gives their level; the edge
    still decides what counts as standstill, and the time constant how long after it the split
    between friction and patient is not valid.
    """

    stribeck_nm: Annotated[float, Meta(ge=0.01, le=100)]
    """Level at the peak, just before the axis slides: breakaway friction. From `gaitd
    calibrate`; too low, and friction is told as the patient's effort."""
    coulomb_nm: Annotated[float, Meta(ge=0.01, le=100)]
    """Level at speed, without the viscous part; at most the level at the peak."""
    viscous_nm_s_per_rad: Annotated[float, Meta(ge=0, le=100)]
    """Rise with speed."""
    transition_rad_per_s: Annotated[float, Meta(ge=1e-4, le=1)]
    """Speed scale of the change of sign at rest. Smaller is sharper, and needs more steps of
    the integrator."""
    peak_rad_per_s: Annotated[float, Meta(ge=1e-3, le=2)]
    """Speed of the largest friction."""
    edge_rad_per_s: Annotated[float, Meta(ge=1e-4, le=2)]
    """Speed scale of the fall from the peak to the level at speed."""
    time_constant_s: Annotated[float, Meta(ge=1e-4, le=1)]
    """Time in which friction follows its law after a change of speed (equation 11 of the paper)."""
    bristle_stiffness_nm_per_rad: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Bristles (LuGre) instead of eq. (11), with integrator = "semi_implicit"; 0: none."""
    bristle_damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=1e4)] = 0.0
    """Damping of the bristles; of no effect without their stiffness."""


class SlideFriction(Table, frozen=True):
    """Friction law (13) at the slide and its time constant, eq. (11); bristles as at the hip."""

    stribeck_n: Annotated[float, Meta(ge=0.1, le=1000)]
    coulomb_n: Annotated[float, Meta(ge=0.1, le=1000)]
    viscous_n_s_per_m: Annotated[float, Meta(ge=0, le=2000)]
    transition_m_per_s: Annotated[float, Meta(ge=1e-4, le=1)]
    peak_m_per_s: Annotated[float, Meta(ge=1e-3, le=2)]
    edge_m_per_s: Annotated[float, Meta(ge=1e-4, le=2)]
    time_constant_s: Annotated[float, Meta(ge=1e-4, le=1)]
    bristle_stiffness_n_per_m: Annotated[float, Meta(ge=0, le=1e8)] = 0.0
    """Bristles (LuGre) instead of eq. (11), with integrator = "semi_implicit"; 0: none."""
    bristle_damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1e6)] = 0.0


class Friction(Table, frozen=True):
    """Friction of both axes."""

    hip: HipFriction
    slide: SlideFriction


class Patient(Table, frozen=True):
    """Body data from which the leg's segments are added to the exoskeleton's (Winter's table)."""

    mass_kg: Annotated[float, Meta(ge=20, le=160)]
    """Whole body, with clothes. The leg's masses follow from it by anthropometric tables."""
    height_m: Annotated[float, Meta(ge=1.0, le=2.2)]
    """Standing. The leg's inertia follows from it; the lengths of the links are in `[geometry]`."""


class HipNoise(Table, frozen=True):
    """Standard deviations per 10 ms step and of the measurement (observer.md 3.1)."""

    process_angle_rad: Annotated[float, Meta(ge=1e-9, le=0.1)]
    """Noise of the position's model in a cycle, one standard deviation."""
    process_velocity_rad_per_s: Annotated[float, Meta(ge=1e-7, le=10)]
    """Noise of the velocity's model: what the equation of motion misses."""
    process_friction_nm: Annotated[float, Meta(ge=1e-5, le=100)]
    """Noise of friction about its law. Larger: friction is believed less, and the patient's sigma
    grows at low speed."""
    process_patient_nm: Annotated[float, Meta(ge=1e-5, le=100)]
    """How far the patient's effort may change in a cycle. Larger follows faster and is noisier."""
    measurement_angle_rad: Annotated[float, Meta(ge=1e-8, le=0.1)]
    """Noise of the encoder: about a third of a count for a coarse one. Too small, and valid samples
    are refused."""
    ripple_nm: Annotated[float, Meta(ge=0, le=50)] = 0.0
    """Ripple of one sample of torque about its mean over the cycle; widens sigma."""
    law_nm: Annotated[float, Meta(ge=0, le=50)] = 0.0
    """Standard deviation of the friction law near reversals; widens the sigma of friction and
    patient there, and nothing else."""


class SlideNoise(Table, frozen=True):
    """Standard deviations as at the hip."""

    process_position_m: Annotated[float, Meta(ge=1e-9, le=0.1)]
    process_velocity_m_per_s: Annotated[float, Meta(ge=1e-7, le=10)]
    process_friction_n: Annotated[float, Meta(ge=1e-4, le=1000)]
    process_patient_n: Annotated[float, Meta(ge=1e-4, le=1000)]
    measurement_position_m: Annotated[float, Meta(ge=1e-8, le=0.1)]
    ripple_n: Annotated[float, Meta(ge=0, le=500)] = 0.0
    law_n: Annotated[float, Meta(ge=0, le=500)] = 0.0


class ObserverTuning(Table, frozen=True):
    """Noise of both axes, the model's integrator, and the gate."""

    hip: HipNoise
    slide: SlideNoise
    coriolis: bool
    """True: velocity products of the mechanism are computed. False is faster, and wrong at a
    fast gait."""
    velocity_gated: bool
    """At rest changes are assigned to friction (Fig. 5), and the split is uncertain."""
    integrator: Literal["semi_implicit", "rk4"]
    """`rk4`, or `semi_implicit`, which stays stable with a steep law of friction."""
    substeps: Annotated[int, Meta(ge=1, le=10)]
    """Steps of the integrator in a cycle. `gaitd check` refuses too few for the law of friction."""
    gate_nis: Annotated[float, Meta(ge=20, le=1000)]
    """Normalised innovation above which a sample is not believed. Too low: quick patients count
    as wrong samples."""
    patient_noise_max_ratio: Annotated[float, Meta(ge=1, le=30)] = 1.0
    """How far the noise of the patient's effort may grow while innovations of one sign follow each
    other, and the effort go on at its rate; 1: neither. Larger follows a working patient with less
    lag, and a larger sigma."""
    viscous_outside: bool = False
    """True: the viscous part of friction acts at once, outside of the time constant of (11)."""
    effort_delay_ms: Annotated[float, Meta(ge=0, le=30)] = 0.0
    """How much later than its SYNC an effort acts, from `gaitd delay`."""
    sample_jitter_us: Annotated[float, Meta(ge=0, le=2000)] = 0.0
    """Standard deviation of the instant at which a drive samples its position, from `gaitd
    delay` or the drive's manual."""


class HipTransmission(Table, frozen=True):
    """How the hip's transmission gives way between the encoder and the joint."""

    stiffness_nm_per_rad: Annotated[float, Meta(ge=0, le=1e7)]
    """0: rigid."""
    backlash_rad: Annotated[float, Meta(ge=0, le=0.1)]
    """Play between drive and joint, from side to side; 0: none. [Theory](theory.md) says how to
    measure it."""


class SlideTransmission(Table, frozen=True):
    """How the slide's transmission gives way."""

    stiffness_n_per_m: Annotated[float, Meta(ge=0, le=1e9)]
    """0: rigid."""
    backlash_m: Annotated[float, Meta(ge=0, le=0.02)]


class Transmission(Table, frozen=True):
    """Both transmissions.

    They widen the sigma of friction, patient and net where they give way, most after a reversal.
    Gate, validity and stops do not read them.
    """

    hip: HipTransmission
    slide: SlideTransmission


class HipEffortOffset(Table, frozen=True):
    """What the hip's drive shows at no torque."""

    torque_nm: Annotated[float, Meta(ge=-20, le=20)]
    """Effort that the drive shows when its motor gives none: taken off what the observer reads."""


class SlideEffortOffset(Table, frozen=True):
    """What the slide's drive shows at no force."""

    force_n: Annotated[float, Meta(ge=-200, le=200)]


class EffortOffset(Table, frozen=True):
    """What the drives show at no effort: the observer takes it off; limits and monitors do not."""

    hip: HipEffortOffset
    slide: SlideEffortOffset


class HipOverPosition(Table, frozen=True):
    """How Coulomb's level and the hump of friction rise along the hip."""

    slope_per_rad: Annotated[float, Meta(ge=-2, le=2)]
    """Relative to the levels of [friction.hip]."""
    middle_rad: Annotated[float, Meta(ge=-1, le=2)]
    """Where the levels are those of [friction.hip]."""


class SlideOverPosition(Table, frozen=True):
    """How Coulomb's level and the hump of friction rise along the slide."""

    slope_per_m: Annotated[float, Meta(ge=-2, le=2)]
    """Relative to the levels of [friction.slide]."""
    middle_m: Annotated[float, Meta(ge=-1, le=2)]
    """Where the levels are those of [friction.slide]."""


class FrictionOverPosition(Table, frozen=True):
    """Friction that is not the same everywhere, as by a seal or a rail that is not straight."""

    hip: HipOverPosition
    slide: SlideOverPosition


class HipUncertainty(Table, frozen=True):
    """Standard deviations of what is known of the hip's spring, friction, drive and encoder."""

    spring_ratio: Ratio
    """The spring's stiffness, relative."""
    spring_rest_rad: Annotated[float, Meta(ge=0, le=1)]
    """The position at which the spring is slack."""
    friction_ratio: Ratio
    """Coulomb's and Stribeck's level together, relative."""
    viscous_ratio: Ratio
    """Viscous friction, relative."""
    friction_slope_per_rad: Annotated[float, Meta(ge=0, le=2)]
    """`friction_over_position.hip.slope_per_rad`."""
    torque_ratio: Ratio
    """The torque constant, relative."""
    torque_offset_nm: Annotated[float, Meta(ge=0, le=50)]
    """The torque that the drive shows at no torque."""
    angle_deg: Annotated[float, Meta(ge=0, le=5)]
    """The zero of the joint's angle."""


class SlideUncertainty(Table, frozen=True):
    """Standard deviations as at the hip."""

    spring_ratio: Ratio
    """The spring's stiffness, relative."""
    spring_rest_m: Annotated[float, Meta(ge=0, le=1)]
    """The position at which the spring is slack."""
    friction_ratio: Ratio
    """Coulomb's and Stribeck's level together, relative."""
    viscous_ratio: Ratio
    """Viscous friction, relative."""
    friction_slope_per_m: Annotated[float, Meta(ge=0, le=2)]
    """`friction_over_position.slide.slope_per_m`."""
    force_ratio: Ratio
    """The force constant, relative."""
    force_offset_n: Annotated[float, Meta(ge=0, le=500)]
    """The force that the drive shows at no force."""
    position_m: Annotated[float, Meta(ge=0, le=0.1)]
    """The zero of the slide's position."""


class Uncertainty(Table, frozen=True):
    """How sure the parameters of this file are: one standard deviation each; 0: certain.

    The sigma of patient, friction and net holds them where it is published. Gate, validity and
    stops do not read them.
    """

    length_m: Annotated[float, Meta(ge=0, le=0.1)]
    """The length of thigh, shank and shoe, each by itself."""
    rail_m: Annotated[float, Meta(ge=0, le=0.1)]
    """`rail_x_m` and `rail_y_m`, each by itself."""
    recline_deg: Annotated[float, Meta(ge=0, le=10)]
    """The trunk's recline."""
    rail_angle_deg: Annotated[float, Meta(ge=0, le=10)]
    """The rail's angle."""
    machine_mass_ratio: Ratio
    """The mass of links and carriage together, relative."""
    body_segment_ratio: Ratio
    """The mass of the patient's thigh, shank and foot, each by itself, against the table."""
    drive_inertia_ratio: Ratio
    """The reflected inertia of both drives together, relative."""
    damping_ratio: Ratio
    """All dampers together, relative."""
    hip: HipUncertainty
    slide: SlideUncertainty


MissedLimit = Literal["mechanism", "two_optima", "other_effect", "false_effort"]
"""A limit of `gaitd calibrate` that a result missed: another number of the mechanism is wrong,
other values explain the recording as well, more effort is left than friction can leave, or the
false effort on held-out data has grown."""


class AcceptedCalibration(Table, frozen=True):
    """Written by `gaitd calibrate --accept`: with it and a patient a self-test is always due."""

    missed_limits: Annotated[tuple[MissedLimit, ...], Meta(min_length=1)]
    """Limits that the calibration missed."""


class Robot(Table, frozen=True):
    """robot.toml."""

    geometry: Geometry
    thigh: Segment
    shank: Segment
    shoe: Segment
    slide: Slide
    hip: Hip
    springs: Springs
    dampers: Dampers
    friction: Friction
    observer: ObserverTuning
    uncertainty: Uncertainty
    transmission: Transmission
    effort_offset: EffortOffset
    friction_over_position: FrictionOverPosition
    patient: Patient | None = None
    calibration: AcceptedCalibration | None = None


# --- trainer file (demo.toml, vcan.toml, trainer.toml) ---------------------------------------


class Bus(Table, frozen=True):
    """The CAN bus: `simulated` is the bus of `gaitd sim`; other interfaces are python-can's."""

    interface: Text
    """`simulated`, `socketcan` on a trainer, or another interface of python-can. A wrong one is
    refused at the start."""
    channel: Text
    """Name of the interface, `can0`; for `simulated` the path of the bus that `gaitd sim`
    serves."""
    bitrate_bit_per_s: Literal[125_000, 250_000, 500_000, 800_000, 1_000_000]
    """As set in every drive, and on the interface by systemd-networkd or `ip link`. With a
    wrong one no frame arrives: bring-up fails."""
    load_max_ratio: Annotated[float, Meta(ge=0.01, le=0.8)]
    """Largest computed share of time in which the bus is busy; above, `gaitd check` refuses.
    0.4 leaves room for the answers of every drive within the window."""
    virtual_drives: bool | tuple[Text, ...] = False
    """Which drives on a bus of the kernel are those of `gaitd sim`: true for all, a bench on which
    nothing moves; or LEG/AXIS of some, beside real ones."""


class Cycle(Table, frozen=True):
    """The cycle grid. The drives' 60C2h is written from `period_ms`."""

    period_ms: Literal[10]
    """Time from one SYNC to the next."""
    window_ms: Annotated[float, Meta(ge=1, le=8)]
    """Time for the drives' answers to a SYNC. Longer than `gaitd check` computes for the frames
    of a cycle, and short enough that the computation ends before the next SYNC. Too short:
    samples count as late."""
    master_node_id: NodeId
    """Node id of this service on the bus; no drive may have it."""
    master_heartbeat_ms: Annotated[int, Meta(ge=10, le=100)]
    """Interval of this service's heartbeat. At most a third of `drive_detection_ms`, so that
    one lost frame stops nothing."""
    drive_heartbeat_ms: Annotated[int, Meta(ge=10, le=200)]
    """Interval of the drives' heartbeats, written to 1017h. A drive that is silent for longer
    than its limit is a stop."""
    drive_detection_ms: Annotated[int, Meta(ge=20, le=100)]
    """1016h in the drives: the master's silence until they stop by themselves."""
    rpdo_timeout_ms: Annotated[int, Meta(ge=20, le=100)]
    """Silence of commands after which a drive stops by itself, written where a drive has such
    an object. Longer than a few cycles, shorter than `drive_detection_ms`."""
    realtime_priority: Annotated[int, Meta(ge=0, le=90)]
    """SCHED_FIFO priority of the core where the machine allows it; 0 requests none."""
    realtime_cpus: tuple[Annotated[int, Meta(ge=0, le=1023)], ...] = ()
    """Processors that the cycle may run on; empty: those that the system gives the process."""
    sync_counter: Annotated[int, Meta(ge=0, le=240)] = 0
    """1019h: SYNC counts from 1 to this, 2 at least; 0: SYNC without counter."""
    sync_window_ms: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """1007h in the drives that have it, for their answers and our commands; 0: no window."""


class Leg(Table, frozen=True):
    """One leg: two drive files and an optional baseline, by path relative to this file."""

    name: Literal["right", "left"]
    """Side of the leg; part of the names of drives and keys."""
    hip: Text
    """File of the hip's drive, relative to this file."""
    slide: Text
    """File of the slide's drive, relative to this file."""
    baseline: Text | None = None
    """File of `gaitd baseline`, taken off the estimate; none if absent."""


class HipImpedance(Table, frozen=True):
    """A spring and a damper about the hip's reference."""

    stiffness_nm_per_rad: Annotated[float, Meta(ge=0.1, le=1000)]
    """Spring about the reference. Stiffer: the leg follows more closely, and a patient moves it
    less. Choose it so that the effort at the expected distance stays below the limit of effort."""
    damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=100)]
    """Damper about the reference's velocity; near critical for the moved inertia. `gaitd check`
    refuses one that is unstable with the loop's delay."""


class SlideImpedance(Table, frozen=True):
    """A spring and a damper about the slide's reference."""

    stiffness_n_per_m: Annotated[float, Meta(ge=1, le=20000)]
    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=2000)]


class Impedance(Table, frozen=True):
    """Guidance of `gait` and position hold."""

    hip: HipImpedance
    slide: SlideImpedance


class Curve(Table, frozen=True):
    """The periodic angle of a joint: harmonics in degrees, [a_k, b_k] per harmonic."""

    mean_deg: Degrees
    """Mean of the angle over a stride; flexion is positive."""
    harmonics_deg: Annotated[tuple[Harmonic, ...], Meta(min_length=1, max_length=12)]
    """Cosine and sine of each harmonic of the stride, from the first."""


class HipGait(Curve, frozen=True):
    """The hip's angle over the stride, and its speed to the beginning of a gait."""

    approach_rad_per_s: Annotated[float, Meta(ge=0.001, le=1)]
    """Speed of the way to the first pose of the gait. Slow enough for a person who does not
    expect it."""


class SlideGait(Table, frozen=True):
    """The slide's speed to the beginning of a gait; its position follows from hip and knee."""

    approach_m_per_s: Annotated[float, Meta(ge=0.001, le=1)]


class Gait(Table, frozen=True):
    """The periodic reference of hip and knee, and how a gait begins."""

    guidance: Literal["impedance", "position"]
    """`impedance`: the core computes the torque, and assist is possible. `position`: the
    drives' own loops follow the reference, without assist."""
    announce_s: Annotated[float, Meta(ge=0.5, le=30)]
    """Time from the request to the first motion, in which displays announce it."""
    ramp_strides: Annotated[int, Meta(ge=1, le=10)]
    """Strides in which the amplitude grows from 0 to the requested one."""
    cadence_max_hz: Annotated[float, Meta(ge=0.01, le=1)]
    """Fastest gait that a request may ask for. `gaitd check` computes speed and effort that it
    needs."""
    hip: HipGait
    knee: Curve
    slide: SlideGait
    impedance: Impedance


class Sinusoid(Table, frozen=True):
    """One part of an excite scenario, between two times; parts of one axis add up.

    A sine is amplitude * sin(2 pi f (t - start)); a step is the amplitude, and has frequency 0.
    """

    axis: Literal["hip", "slide"]
    """Axis that it acts on."""
    kind: Literal["sine", "step"]
    """`sine`, or `step`: constant from start to end."""
    amplitude_si: Annotated[float, Meta(ge=-1500, le=1500)]
    """Amplitude, N·m at the hip and N at the slide. Above breakaway friction, or nothing moves."""
    frequency_hz: Annotated[float, Meta(ge=0, le=5)]
    """Frequency of the sine; 0 for a step."""
    start_s: Annotated[float, Meta(ge=0, le=600)]
    """Begin, after the start of the run."""
    end_s: Annotated[float, Meta(ge=0.01, le=600)]
    """End, after the start of the run; after `start_s`."""


class HipWindow(Table, frozen=True):
    """How far an open-loop scenario may move the hip."""

    window_deg: Annotated[float, Meta(ge=0.1, le=40)]
    """Distance from the pose at the start at which the run ends in a stop. Within the
    mechanical range on the empty machine."""


class SlideWindow(Table, frozen=True):
    """How far an open-loop scenario may move the slide."""

    window_m: Annotated[float, Meta(ge=0.001, le=0.6)]


class Excite(Table, frozen=True):
    """An open-loop scenario about g(q), with or without an artificial disturbance."""

    hip: HipWindow
    slide: SlideWindow
    duration_max_s: Annotated[float, Meta(ge=0.1, le=600)]
    """Longest run; then the leg is held."""
    torque: tuple[Sinusoid, ...]
    artificial: tuple[Sinusoid, ...] = ()


class HipGuiding(Table, frozen=True):
    """Hand guiding at the hip."""

    damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=50)]
    """Damping below the slow speed. Small enough for the hand, large enough that the leg does
    not run away."""
    slow_rad_per_s: Annotated[float, Meta(ge=0.001, le=1)]
    """Above this speed, the damping below is added for the excess."""
    damping_beyond_nm_s_per_rad: Annotated[float, Meta(ge=0.01, le=60)]
    """Damping that is added above the slow speed. `gaitd check` refuses one that is unstable
    with the loop's delay."""
    edge_nm: Annotated[float, Meta(ge=0, le=100)]
    """Effort that leads back in at a hard limit; it grows from zero over the soft margin."""


class SlideGuiding(Table, frozen=True):
    """Hand guiding at the slide."""

    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=1000)]
    slow_m_per_s: Annotated[float, Meta(ge=0.001, le=1)]
    damping_beyond_n_s_per_m: Annotated[float, Meta(ge=0.1, le=1500)]
    edge_n: Annotated[float, Meta(ge=0, le=1000)]


class HandGuiding(Table, frozen=True):
    """Hand guiding: damping of the leg's motion, and the maximum duration."""

    hip: HipGuiding
    slide: SlideGuiding
    duration_max_s: Annotated[float, Meta(ge=0.1, le=600)]
    """After this time the leg is held again."""


class HipTest(Table, frozen=True):
    """The daily test of the hip."""

    motion_deg: Annotated[float, Meta(gt=0.5, le=15)]
    """Motion forth and back, from where the leg is held."""
    speed_rad_per_s: Annotated[float, Meta(ge=0.001, le=0.5)]
    """At most the motion in rad / 0.4 s, or too little of it is averaged."""
    load_tolerance_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Deviation of the mean effort over both ways from g(q); friction cancels in this mean."""


class SlideTest(Table, frozen=True):
    """The daily test of the slide."""

    motion_m: Annotated[float, Meta(gt=0.005, le=0.2)]
    speed_m_per_s: Annotated[float, Meta(ge=0.001, le=0.5)]
    """At most the motion / 0.4 s."""
    load_tolerance_n: Annotated[float, Meta(ge=1, le=600)]


class SelfTest(Table, frozen=True):
    """The daily test: which checks must have passed before a leg is moved."""

    required: Literal["daily", "never"]
    """`daily`: without a valid test nothing but hand guiding moves a leg. `never`: for virtual
    drives and a bench."""
    valid_h: Annotated[float, Meta(ge=0.01, le=48)]
    """How long hand switch, STO and a passed test remain valid."""
    hip: HipTest
    slide: SlideTest
    friction_min_ratio: Annotated[float, Meta(ge=0.01, lt=1)]
    """Ratio of half the difference of the efforts forth and back to the friction of robot.toml."""
    friction_max_ratio: Annotated[float, Meta(gt=1, le=10)]
    """Largest friction of the test, as a ratio of the law's. Above: a dirty rail or a worn
    bearing; the test fails."""


class HipReference(Table, frozen=True):
    """When the hip is where it was."""

    pose_tolerance_deg: Annotated[float, Meta(ge=0.01, le=360)]
    """How far the hip may be from its stored position."""


class SlideReference(Table, frozen=True):
    """When the slide is where it was."""

    pose_tolerance_m: Annotated[float, Meta(ge=1e-4, le=2)]
    """How far the slide may be from its stored position."""


class Reference(Table, frozen=True):
    """Conditions for trusting an absolute encoder after a start (docs/first_start.md)."""

    hip: HipReference
    slide: SlideReference
    without_stored_pose: Literal["believe", "home"]
    """Whether an absolute encoder is trusted at a first start, when no pose is stored."""


class HipSignTest(Table, frozen=True):
    """How the sign of the hip is proven."""

    torque_max_nm: Annotated[float, Meta(ge=0.1, le=40)]
    """Largest effort of the proof of signs. Above breakaway friction and what the springs
    leave, below what could hurt."""
    torque_rate_nm_per_s: Annotated[float, Meta(ge=0.1, le=100)]
    """Rate at which the effort of the proof rises. Slow enough to see the axis begin to move."""
    motion_deg: Annotated[float, Meta(ge=0.05, le=10)]
    """The torque is removed after this motion."""


class SlideSignTest(Table, frozen=True):
    """How the sign of the slide is proven."""

    force_max_n: Annotated[float, Meta(ge=1, le=400)]
    force_rate_n_per_s: Annotated[float, Meta(ge=1, le=1000)]
    motion_m: Annotated[float, Meta(ge=5e-4, le=0.1)]


class Commissioning(Table, frozen=True):
    """How the sign of an axis is proven, and whether it must be before anything is enabled."""

    signs: Literal["proven", "assumed"]
    """"proven": an axis whose sign is not proven cannot be enabled."""
    hip: HipSignTest
    slide: SlideSignTest


class Lease(Table, frozen=True):
    """Duration of a controller's lease without an accepted setpoint (docs/control_by_others.md).

    The assist itself ends earlier: `setpoint_age_max_cycles` of limits.toml.
    """

    duration_ms: Annotated[int, Meta(ge=50, le=5000)]
    """Validity of a lease; each accepted setpoint renews it. Longer than a few cycles of the
    controller; a controller that hangs ends its help after this time at the latest."""
    duration_max_ms: Annotated[int, Meta(ge=50, le=60_000)]
    """Upper limit of the duration that a client may request."""


class Zenoh(Table, frozen=True):
    """Where the gateway listens: loopback or a Unix socket, unless the file allows more."""

    trainer: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+\Z")]
    """TRAINER in the keys `gaitd/TRAINER/...`. Another one for each machine in a network."""
    listen: Annotated[tuple[Locator, ...], Meta(min_length=1)]
    """Endpoints at which clients connect, `tcp/127.0.0.1:7447`. An address that other machines
    can reach needs keys (`gaitd keys`)."""
    listen_beyond_loopback: bool = False
    """Only with true may `listen` hold endpoints that other machines can reach; needs `keys`."""
    keys: Text | None = None
    """Folder of `gaitd keys`, relative to this file; absent: every local client may do all."""


class Paths(Table, frozen=True):
    """Directories of the service, relative to the trainer file."""

    runtime: Text
    """A directory on a tmpfs: the ring and the sockets of the IPC channel."""
    state: Text
    """A directory that survives a restart: stored pose and latched verdict."""


class Shutdown(Table, frozen=True):
    """The operator's knowledge about a stop: printed by `check`, and sent in STATUS= at the end."""

    effect: Annotated[str, Meta(min_length=10)]
    """What the machine does when the service ends, in a sentence for the operator; `gaitd
    check` prints it beside the computed motion of the leg."""


class Log(Table, frozen=True):
    """Lowest severity of the gateway's events in the log; all events are published regardless."""

    level: Literal["debug", "info", "warning", "error"] = "info"
    """Least severe messages that go to the journal."""


class Trainer(Table, frozen=True):
    """The file that `--config` names."""

    robot: Text
    """File of the mechanism and the patient, relative to this file."""
    limits: Text
    """File of the limits, relative to this file."""
    bus: Bus
    cycle: Cycle
    leg: Annotated[tuple[Leg, ...], Meta(min_length=1, max_length=2)]
    hold: Impedance
    gait: Gait
    excite: dict[str, Excite]
    hand_guiding: HandGuiding
    self_test: SelfTest
    reference: Reference
    commissioning: Commissioning
    lease: Lease
    zenoh: Zenoh
    paths: Paths
    shutdown: Shutdown
    log: Log = Log()
    sim: Text | None = None
    """plant.toml of the virtual drives, for `gaitd sim` and `demo`; the service ignores it."""
