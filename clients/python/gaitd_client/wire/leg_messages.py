"""Messages about one leg: estimate, activity and friction in every cycle, and each stride.

Part of the wire contract; `messages.py` holds the rest and lists them all. Conventions are those of
`fields.py`: every number with its standard deviation, null for what is not valid.
"""

from typing import Annotated

import msgspec
from msgspec import Meta

from gaitd_client.wire.fields import (
    EFFORT,
    POSITION,
    VELOCITY,
    EffortStd,
    Estimated,
    FlagBits,
    Flags,
    FrictionEffort,
    ModeName,
    Net,
    Patient,
    Phase,
    PositionStd,
    Sampled,
    Stated,
    Std,
    ValidityName,
    VelocityStd,
    of_joint,
)

ReportedValues = Annotated[
    dict[
        Annotated[str, Meta(max_length=48, pattern="^[a-z][a-z0-9_]*$")],
        float | Annotated[tuple[float | None, ...], Meta(max_length=64)] | None,
    ],
    Meta(
        max_length=32,
        description="By names that end in their unit, but for positions, velocities and efforts of"
        " an axis; arrays are over the stride. Null: not known.",
    ),
]

TremorHz = Annotated[
    float | None,
    Meta(
        description="Frequency of the patient's tremor, 3..12 Hz, where it stands out of the last"
        " seconds of valid estimates. Null: none does, or the axis is not ok."
    ),
]
TremorAmplitude = Annotated[
    float | None,
    of_joint(EFFORT, "Amplitude of the patient's effort at that frequency; null as that is."),
]


class AxisEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """One axis in an estimate; all but the raw values is null where it is not valid."""

    validity: ValidityName
    position: Annotated[
        float | None,
        of_joint(
            POSITION, "Angle of the hip, positive in flexion; place of the slide on its rail."
        ),
    ]
    position_std: PositionStd
    velocity: Annotated[float | None, of_joint(VELOCITY, "Change of the position.")]
    velocity_std: VelocityStd
    friction: FrictionEffort
    friction_std: EffortStd
    patient: Patient
    patient_std: EffortStd
    net: Net
    net_std: EffortStd
    innovation: Annotated[
        float | None, of_joint(POSITION, "Measured minus predicted position, always given.")
    ]
    measured_position: Annotated[float | None, of_joint(POSITION, "Raw; null: no sample.")]
    effort: Annotated[
        float | None,
        of_joint(EFFORT, "Drive's effort as the observer used it: over the past cycle."),
    ]
    tremor_frequency_hz: TremorHz = None
    tremor_amplitude: TremorAmplitude = None
    artificial: Annotated[
        float | None, of_joint(EFFORT, "Artificial disturbance: effort = measured - this.")
    ]
    reference_position: Annotated[float | None, of_joint(POSITION, "Position that the mode wants.")]
    assist: Annotated[
        float | None, of_joint(EFFORT, "A controller's assist in force, bounded; 0: none.")
    ]
    needed: Annotated[
        float | None,
        of_joint(
            EFFORT,
            "What the motion of the reference needs beyond the load: inertia, Coriolis terms,"
            " dampers and friction of robot.toml, and what a passive baseline explains besides."
            " Null: nothing is guided.",
        ),
    ] = None


class Estimate(Estimated, frozen=True, kw_only=True):
    """The observer's complete estimate of one leg, every cycle, for a controller."""

    hip: Annotated[AxisEstimate, Meta(description="The hip.")]
    slide: Annotated[AxisEstimate, Meta(description="The slide.")]
    covariance: Annotated[
        tuple[float, ...] | None,
        Meta(
            description="Lower triangle, row by row, 36 values, SI; order of the states: positions"
            " (hip, slide), velocities, frictions, patient. Null when an axis is bad."
        ),
    ]
    nis: Annotated[float | None, Meta(description="Normalised innovation squared; 2 on average.")]
    mean_nis: Annotated[
        float | None,
        Meta(
            description="Forgetting mean of some 100 cycles: 1.72 to 2.28 in 95 % if as modelled."
        ),
    ]
    observable_rank: Annotated[
        int,
        Meta(
            description="Observable states of 8; one less for each axis with an unobservable split."
        ),
    ]
    gait_phase_ratio: Phase
    dt_s: Annotated[float | None, Meta(description="True time since the SYNC before.")]
    stiffness_ratio: Annotated[
        float | None, Meta(description="In force, of the guidance's configured stiffness.")
    ]
    setpoint_seq: Annotated[
        int | None, Meta(description="`seq` of the newest setpoint that counts; null: none does.")
    ]


class AxisActivity(msgspec.Struct, frozen=True, kw_only=True):
    """The patient's activity at one axis."""

    validity: ValidityName
    patient: Patient
    patient_std: EffortStd
    patient_power_w: Annotated[
        float | None, Meta(description="Patient's effort times velocity; positive: works along.")
    ]
    patient_power_w_std: Std
    net: Net
    net_std: EffortStd
    tremor_frequency_hz: TremorHz = None
    tremor_amplitude: TremorAmplitude = None


class Activity(Estimated, frozen=True, kw_only=True):
    """The patient's activity in one leg, every cycle, for a display."""

    hip: Annotated[AxisActivity, Meta(description="The hip.")]
    slide: Annotated[AxisActivity, Meta(description="The slide.")]
    patient_power_w: Annotated[float | None, Meta(description="Sum of both axes.")]
    patient_power_w_std: Std
    gait_phase_ratio: Phase


class AxisFriction(msgspec.Struct, frozen=True, kw_only=True):
    """Friction of one axis."""

    validity: ValidityName
    friction: FrictionEffort
    friction_std: EffortStd
    drift_correlation: Annotated[
        float | None,
        Meta(
            description="Patient's effort with the direction of motion, -1..1, over the last 20 s"
            " of motion. Above 0.8 with an empty machine: calibrate."
        ),
    ]
    friction_error: Annotated[
        float | None, of_joint(EFFORT, "Friction above its law, unless a patient pushes along.")
    ]


class Friction(Estimated, frozen=True, kw_only=True):
    """Friction of one leg's axes, every cycle."""

    hip: Annotated[AxisFriction, Meta(description="The hip.")]
    slide: Annotated[AxisFriction, Meta(description="The slide.")]


WorkAlong = Annotated[float | None, Meta(description="Work with the motion.")]
WorkAgainst = Annotated[float | None, Meta(description="Work against the motion; not positive.")]
ShareRatio = Annotated[
    float | None,
    Meta(description="Patient's positive work over that of patient and drive; null below 0.5 J."),
]


class AxisStride(msgspec.Struct, frozen=True, kw_only=True):
    """The patient's estimated activity at one axis over one stride."""

    work_positive_j: WorkAlong
    work_positive_j_std: Std
    work_negative_j: WorkAgainst
    work_negative_j_std: Std
    assist_mean: Annotated[float | None, of_joint(EFFORT, "Effort along the motion, mean.")]
    assist_mean_std: EffortStd
    assist_peak: Annotated[
        float | None, of_joint(EFFORT, "Effort along the motion, the largest in size.")
    ]
    assist_peak_std: EffortStd
    power_mean_w: Annotated[float | None, Meta(description="Mean over the stride.")]
    power_mean_w_std: Std
    power_peak_w: Annotated[float | None, Meta(description="The largest in size, with its sign.")]
    power_peak_w_std: Std
    share_ratio: ShareRatio
    share_ratio_std: Std
    tremor_frequency_hz: Annotated[
        float | None,
        Meta(
            description="Mean tremor of the stride; null unless it stood out in more than half of"
            " its valid parts of 1.28 s."
        ),
    ] = None
    tremor_amplitude: Annotated[
        float | None, of_joint(EFFORT, "Mean amplitude of the tremor; null as the frequency is.")
    ] = None
    coverage_ratio: Annotated[
        float,
        Meta(
            description="Share of the stride's time in which the patient's effort was known; below"
            " 0.5, or with an invalid sample, the axis' other figures are null."
        ),
    ]


class Stride(Sampled, frozen=True, kw_only=True):
    """The patient's estimated activity in one leg over one stride, published at its end.

    Computed from the estimate smoothed over 150 ms. It contains muscle force, passive tissue, and
    the errors of the models of leg and friction; `baseline_subtracted`: what a minute with a
    passive patient explains is taken off.
    """

    leg: Annotated[str, Meta(description="right or left")]
    mode: ModeName
    status: Flags
    status_bits: FlagBits
    number: Annotated[
        int, Meta(description="Counts the strides of this leg since core start, from 1.")
    ]
    duration_s: Annotated[float, Meta(description="From one rise of the hip to the next.")]
    cadence_hz: Annotated[float, Meta(description="Strides per second: 1 / duration.")]
    sample_count: Annotated[int, Meta(description="Cycles in the stride.")]
    hip: Annotated[AxisStride, Meta(description="The hip.")]
    slide: Annotated[AxisStride, Meta(description="The slide.")]
    work_positive_j: Annotated[
        float | None, Meta(description="Patient's work of both axes, with the motion.")
    ]
    work_positive_j_std: Std
    work_negative_j: Annotated[
        float | None, Meta(description="Patient's work of both axes, against the motion.")
    ]
    work_negative_j_std: Std
    share_ratio: Annotated[float | None, Meta(description="Share of both axes; null below 0.5 J.")]
    share_ratio_std: Std
    baseline_subtracted: Annotated[bool, Meta(description="A passive baseline is taken off.")]


class ControllerState(Stated, frozen=True, kw_only=True):
    """State of the controller that holds the lease, as it has reported it; usually each stride.

    The service has checked who reports, and not what.
    """

    leg: Annotated[str, Meta(description="right or left")]
    client: Annotated[str, Meta(description="Who holds the lease.")]
    for_cycle: Annotated[int | None, Meta(description="`cycle` to which the state belongs.")]
    values: Annotated[ReportedValues, Meta(description="State of the leg.")] = msgspec.field(
        default_factory=dict
    )
    hip: Annotated[ReportedValues, Meta(description="State of the hip.")] = msgspec.field(
        default_factory=dict
    )
    slide: Annotated[ReportedValues, Meta(description="State of the slide.")] = msgspec.field(
        default_factory=dict
    )
