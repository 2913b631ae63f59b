"""Messages about one leg: estimate, activity and friction in every cycle, and each stride.

Part of the wire contract; `messages.py` holds the rest and lists them all. Conventions are those of
`fields.py`: every number with its standard deviation, null for what is not valid.
"""

from typing import Annotated

from msgspec import Meta

from gaitd_client.wire.fields import (
    Estimated,
    FlagBits,
    Flags,
    HipAngle,
    HipFriction,
    HipNet,
    HipPatient,
    ModeName,
    Phase,
    Sampled,
    SlideFriction,
    SlideNet,
    SlidePatient,
    SlidePosition,
    Stated,
    Std,
)

FrictionError = Annotated[
    float | None,
    Meta(description="Friction above its law, unless a patient pushes along."),
]
Artificial = Annotated[
    float | None, Meta(description="Artificial disturbance: used = measured - this.")
]
AssistInForce = Annotated[
    float | None, Meta(description="A controller's assist in force, bounded; 0: none.")
]
DriftCorrelation = Annotated[
    float | None,
    Meta(
        description="Patient's effort with the direction of motion, -1..1, over the last 20 s of"
        " motion. Above 0.8 with an empty machine: calibrate."
    ),
]

ReportedValues = Annotated[
    dict[
        Annotated[str, Meta(max_length=48, pattern="^[a-z][a-z0-9_]*$")],
        float | Annotated[tuple[float | None, ...], Meta(max_length=64)] | None,
    ],
    Meta(
        max_length=32,
        description="By names that end in their unit; arrays are over the stride. Null: not known.",
    ),
]


class Estimate(Estimated, frozen=True, kw_only=True):
    """The observer's complete estimate of one leg, every cycle, for a controller."""

    hip_angle_rad: HipAngle
    hip_angle_rad_std: Std
    slide_position_m: SlidePosition
    slide_position_m_std: Std
    hip_velocity_rad_per_s: Annotated[float | None, Meta(description="Speed of the hip angle.")]
    hip_velocity_rad_per_s_std: Std
    slide_velocity_m_per_s: Annotated[float | None, Meta(description="Speed of the slide.")]
    slide_velocity_m_per_s_std: Std
    hip_friction_nm: HipFriction
    hip_friction_nm_std: Std
    slide_friction_n: SlideFriction
    slide_friction_n_std: Std
    hip_patient_nm: HipPatient
    hip_patient_nm_std: Std
    slide_patient_n: SlidePatient
    slide_patient_n_std: Std
    hip_net_nm: HipNet
    hip_net_nm_std: Std
    slide_net_n: SlideNet
    slide_net_n_std: Std
    covariance: Annotated[
        tuple[float, ...] | None,
        Meta(
            description="Lower triangle, row by row, 36 values, SI; order of the states: hip angle,"
            " slide position, their velocities, frictions (hip, slide), patient (hip, slide)."
            " Null when an axis is bad."
        ),
    ]
    innovation_hip_rad: Annotated[float | None, Meta(description="Measured minus predicted.")]
    innovation_slide_m: Annotated[float | None, Meta(description="Measured minus predicted.")]
    nis: Annotated[float | None, Meta(description="Normalised innovation squared; 2 on average.")]
    mean_nis: Annotated[
        float | None,
        Meta(
            description="Forgetting mean of some 100 cycles: 1.72 to 2.28 in 95 % if as modelled."
        ),
    ]
    observable_rank: Annotated[
        int, Meta(description="Of 8 states; one less for each axis whose split is unobservable.")
    ]
    measured_hip_angle_rad: HipAngle
    measured_slide_position_m: SlidePosition
    hip_torque_nm: Annotated[
        float | None,
        Meta(description="Drive's torque at the hip as the observer used it: over the past cycle."),
    ]
    slide_force_n: Annotated[
        float | None,
        Meta(
            description="Drive's force at the slide as the observer used it: over the past cycle."
        ),
    ]
    artificial_hip_nm: Artificial
    artificial_slide_n: Artificial
    reference_hip_angle_rad: HipAngle
    reference_slide_position_m: SlidePosition
    gait_phase_ratio: Phase
    dt_s: Annotated[float | None, Meta(description="True time since the SYNC before.")]
    assist_hip_nm: AssistInForce
    assist_slide_n: AssistInForce
    stiffness_ratio: Annotated[
        float | None, Meta(description="In force, of the guidance's configured stiffness.")
    ]
    setpoint_seq: Annotated[
        int | None, Meta(description="Of the newest setpoint that counts; null: none does.")
    ]


class Activity(Estimated, frozen=True, kw_only=True):
    """The patient's activity in one leg, every cycle, for a display."""

    hip_patient_nm: HipPatient
    hip_patient_nm_std: Std
    slide_patient_n: SlidePatient
    slide_patient_n_std: Std
    hip_patient_power_w: Annotated[
        float | None, Meta(description="Patient's torque times hip speed; positive: works along.")
    ]
    hip_patient_power_w_std: Std
    slide_patient_power_w: Annotated[
        float | None, Meta(description="Patient's force times slide speed; positive: works along.")
    ]
    slide_patient_power_w_std: Std
    patient_power_w: Annotated[float | None, Meta(description="Sum of both axes.")]
    patient_power_w_std: Std
    hip_net_nm: HipNet
    hip_net_nm_std: Std
    slide_net_n: SlideNet
    slide_net_n_std: Std
    gait_phase_ratio: Phase


class Friction(Estimated, frozen=True, kw_only=True):
    """Friction of one leg's axes, every cycle."""

    hip_friction_nm: HipFriction
    hip_friction_nm_std: Std
    slide_friction_n: SlideFriction
    slide_friction_n_std: Std
    hip_drift_correlation: DriftCorrelation
    slide_drift_correlation: DriftCorrelation
    hip_friction_error_nm: FrictionError
    slide_friction_error_n: FrictionError


ShareRatio = Annotated[
    float | None,
    Meta(description="Patient's positive work over that of patient and drive; null below 0.5 J."),
]
WorkAgainst = Annotated[float | None, Meta(description="Work against the motion; not positive.")]
PeakAlong = Annotated[
    float | None, Meta(description="Effort along the motion, the largest in size.")
]
PeakPower = Annotated[float | None, Meta(description="The largest in size, with its sign.")]
Coverage = Annotated[
    float,
    Meta(
        description="Share of the stride's time in which the patient's effort was known; below 0.5,"
        " or with an invalid sample, the axis' other figures are null."
    ),
]


class Stride(Sampled, frozen=True, kw_only=True):
    """The patient's estimated activity in one leg over one stride, published at its end.

    Computed from the estimate smoothed over 150 ms. It contains muscle force, passive tissue, and
    the errors of the models of leg and friction; `baseline_subtracted`: a passive run's part is
    removed.
    """

    leg: Annotated[str, Meta(description="right or left")]
    mode: ModeName
    status: Flags
    status_bits: FlagBits
    number: Annotated[int, Meta(description="Of this leg since core start, from 1.")]
    duration_s: Annotated[float, Meta(description="From one rise of the hip to the next.")]
    cadence_hz: Annotated[float, Meta(description="Strides per second: 1 / duration.")]
    sample_count: Annotated[int, Meta(description="Cycles in the stride.")]
    hip_work_positive_j: Annotated[float | None, Meta(description="Work with the motion.")]
    hip_work_positive_j_std: Std
    hip_work_negative_j: WorkAgainst
    hip_work_negative_j_std: Std
    hip_assist_mean_nm: Annotated[float | None, Meta(description="Effort along the motion, mean.")]
    hip_assist_mean_nm_std: Std
    hip_assist_peak_nm: PeakAlong
    hip_assist_peak_nm_std: Std
    hip_power_mean_w: Annotated[float | None, Meta(description="Mean over the stride.")]
    hip_power_mean_w_std: Std
    hip_power_peak_w: PeakPower
    hip_power_peak_w_std: Std
    hip_share_ratio: ShareRatio
    hip_share_ratio_std: Std
    hip_coverage_ratio: Coverage
    slide_work_positive_j: Annotated[float | None, Meta(description="Work with the motion.")]
    slide_work_positive_j_std: Std
    slide_work_negative_j: WorkAgainst
    slide_work_negative_j_std: Std
    slide_assist_mean_n: Annotated[float | None, Meta(description="Effort along the motion, mean.")]
    slide_assist_mean_n_std: Std
    slide_assist_peak_n: PeakAlong
    slide_assist_peak_n_std: Std
    slide_power_mean_w: Annotated[float | None, Meta(description="Mean over the stride.")]
    slide_power_mean_w_std: Std
    slide_power_peak_w: PeakPower
    slide_power_peak_w_std: Std
    slide_share_ratio: ShareRatio
    slide_share_ratio_std: Std
    slide_coverage_ratio: Coverage
    work_positive_j: Annotated[float | None, Meta(description="Of both axes, with the motion.")]
    work_positive_j_std: Std
    work_negative_j: Annotated[float | None, Meta(description="Of both axes, against the motion.")]
    work_negative_j_std: Std
    share_ratio: Annotated[float | None, Meta(description="Of both axes; null below 0.5 J.")]
    share_ratio_std: Std
    baseline_subtracted: Annotated[bool, Meta(description="Of a passive run, per gait phase.")]


class ControllerState(Stated, frozen=True, kw_only=True):
    """State of the controller that holds the lease, as it has reported it; usually each stride.

    The service has checked who reports, and not what.
    """

    leg: Annotated[str, Meta(description="right or left")]
    client: Annotated[str, Meta(description="Who holds the lease.")]
    for_cycle: Annotated[int | None, Meta(description="`cycle` to which the state belongs.")]
    values: ReportedValues
