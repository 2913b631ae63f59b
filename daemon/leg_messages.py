"""What is said of one leg, every cycle: for a controller, for a display, and of friction.

Part of the wire contract; `daemon/wire.py` holds the rest and names them all. Conventions are those
of `daemon/words.py`: every number with its standard deviation, null for what is not valid.
"""

from typing import Annotated

from msgspec import Meta

from daemon.words import (
    Estimated,
    HipAngle,
    HipFriction,
    HipNet,
    HipPatient,
    Phase,
    SlideFriction,
    SlideNet,
    SlidePatient,
    SlidePosition,
    Std,
)

DriftCorrelation = Annotated[
    float | None,
    Meta(
        description="Patient's effort with the direction of motion, -1..1, over the last 20 s of"
        " motion. Beyond 0.8 with nobody in the machine: calibrate."
    ),
]


class Estimate(Estimated, frozen=True, kw_only=True):
    """Everything that the observer knows of one leg, every cycle, for a controller."""

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
        int, Meta(description="Of 8 states; one less for each axis whose split cannot be told.")
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
    artificial_hip_nm: Annotated[
        float | None, Meta(description="Artificial disturbance: used = measured - this.")
    ]
    artificial_slide_n: Annotated[
        float | None, Meta(description="Artificial disturbance: used = measured - this.")
    ]
    reference_hip_angle_rad: HipAngle
    reference_slide_position_m: SlidePosition
    gait_phase_ratio: Phase
    dt_s: Annotated[float | None, Meta(description="True time since the SYNC before.")]


class Activity(Estimated, frozen=True, kw_only=True):
    """What the patient does with one leg, every cycle, for a display."""

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
    hip_friction_error_nm: Annotated[
        float | None,
        Meta(description="Friction above its law, unless a patient pushes along."),
    ]
    slide_friction_error_n: Annotated[
        float | None,
        Meta(description="Friction above its law, unless a patient pushes along."),
    ]
