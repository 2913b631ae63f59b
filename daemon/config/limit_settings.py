"""Tables of limits.toml: one struct per table, the range beside the name (see `settings.py`).

Nothing here has a default: safety depends on all of it.
"""

from typing import Annotated, Literal

from msgspec import Meta

from daemon.config.settings import Table

Category = Literal["S2", "S1", "S0"]
"""Name of a `StopCategory`."""


class AxisLimits(Table, frozen=True):
    """What both axes have in the same unit and range."""

    temperature_max_degc: Annotated[float, Meta(gt=20, le=120)]
    """Temperature of the power stage; above: a stop. Below the drive's own limit, so that the stop
    is orderly."""
    brake: bool
    """True: the axis has a holding brake that the drive controls."""


class HipLimits(AxisLimits, frozen=True):
    """[hip] of limits.toml."""

    position_min_deg: Annotated[float, Meta(ge=-60, le=120)]
    """Lowest position of the machine, inside the mechanical stop. Outside: a stop. Written into
    the drive, too."""
    position_max_deg: Annotated[float, Meta(ge=-60, le=120)]
    """Highest position of the machine, inside the mechanical stop. Outside: a stop. Written
    into the drive, too."""
    soft_margin_deg: Annotated[float, Meta(ge=0.1, le=30)]
    """Distance from the hard limits at which the allowed speed begins to fall."""
    velocity_max_rad_per_s: Annotated[float, Meta(ge=0.05, le=6)]
    """Above: a stop. Above what the gait needs and overshoots to, as `gaitd check` prints it,
    and below what harms this person."""
    hand_guiding_speed_max_rad_per_s: Annotated[float, Meta(ge=0.05, le=3)]
    """In mode hand_guiding, where a person moves the leg."""
    torque_max_nm: Annotated[float, Meta(ge=0.5, le=120)]
    """Largest effort of the drive on this axis, in both directions: commands are clipped, and
    the drive's own limit is set to it."""
    torque_rate_max_nm_per_s: Annotated[float, Meta(ge=1, le=5000)]
    """Largest change of the commanded effort. Too small: guidance lags. Too large: a step that
    a person feels."""
    power_max_w: Annotated[float, Meta(ge=1, le=500)]
    """Above, into the leg: a stop. Above what the gait needs."""
    stride_energy_max_j: Annotated[float, Meta(ge=0.1, le=500)]
    """Net energy into the leg over one stride, or `watch.energy_window_ms`."""
    torque_deviation_max_nm: Annotated[float, Meta(ge=0.05, le=30)]
    """Between the torque sent in torque mode and the torque that the drive measures."""
    load_deviation_max_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Drive's torque minus what motion, load and friction require, mean over a stride."""
    sign_mismatch_torque_min_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Torque beyond the load, against the joint's acceleration, that indicates a wrong sign."""
    patient_torque_max_nm: Annotated[float, Meta(ge=0.1, le=200)]
    """Largest torque of a patient: a larger one does not explain motion against the drive."""
    tracking_max_deg: Annotated[float, Meta(ge=0.1, le=45)]
    """Distance to the reference in a gait; above: a stop. Above what a patient's allowed effort
    bends the guidance by."""
    hold_distance_max_deg: Annotated[float, Meta(ge=0.1, le=45)]
    """In place of `tracking_max_deg` in mode hold, half a second after the reference stands."""
    following_error_deg: Annotated[float, Meta(ge=0.1, le=45)]
    """Limit of the drive's position loop; written into the drive (6065h)."""
    quick_stop_deceleration_rad_per_s2: Annotated[float, Meta(ge=0.5, le=200)]
    """Written into the drive (6085h), and used for stopping paths."""
    static_load_tolerance_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Enable is refused when the load at hold differs from g(q) by more."""
    max_runaway_deg: Annotated[float, Meta(ge=1, le=180)]
    """How far the joint may go after the core has ended, before its drive has stopped it."""
    assist_max_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Maximum of a controller's setpoint, on top of g(q) and guidance; a larger one is refused."""
    assist_rate_max_nm_per_s: Annotated[float, Meta(ge=1, le=2000)]
    """Largest change of a controller's assist."""
    assist_power_max_w: Annotated[float, Meta(ge=0.1, le=250)]
    """Power of the assist alone, along the motion."""


class SlideLimits(AxisLimits, frozen=True):
    """[slide] of limits.toml."""

    position_min_m: Annotated[float, Meta(ge=-1, le=2)]
    position_max_m: Annotated[float, Meta(ge=-1, le=2)]
    soft_margin_m: Annotated[float, Meta(ge=0.001, le=0.3)]
    velocity_max_m_per_s: Annotated[float, Meta(ge=0.02, le=5)]
    hand_guiding_speed_max_m_per_s: Annotated[float, Meta(ge=0.02, le=3)]
    """In mode hand_guiding, where a person moves the leg."""
    force_max_n: Annotated[float, Meta(ge=5, le=1500)]
    force_rate_max_n_per_s: Annotated[float, Meta(ge=10, le=50000)]
    power_max_w: Annotated[float, Meta(ge=1, le=2000)]
    stride_energy_max_j: Annotated[float, Meta(ge=0.1, le=2000)]
    force_deviation_max_n: Annotated[float, Meta(ge=0.5, le=300)]
    load_deviation_max_n: Annotated[float, Meta(ge=1, le=600)]
    sign_mismatch_force_min_n: Annotated[float, Meta(ge=1, le=600)]
    patient_force_max_n: Annotated[float, Meta(ge=1, le=1500)]
    tracking_max_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    hold_distance_max_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    following_error_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    quick_stop_deceleration_m_per_s2: Annotated[float, Meta(ge=0.5, le=200)]
    static_load_tolerance_n: Annotated[float, Meta(ge=1, le=600)]
    max_runaway_m: Annotated[float, Meta(ge=0.01, le=2)]
    assist_max_n: Annotated[float, Meta(ge=1, le=700)]
    assist_rate_max_n_per_s: Annotated[float, Meta(ge=10, le=20000)]
    assist_power_max_w: Annotated[float, Meta(ge=0.1, le=1000)]


class Singularity(Table, frozen=True):
    """Distance to the mechanism's singularity as |sin| of the angle between shank and shoe."""

    soft_ratio: Annotated[float, Meta(ge=0.01, lt=1)]
    """sin of the angle between shank and shoe below which the leg is braked. 1 is a right
    angle, 0 is stretched."""
    stop_ratio: Annotated[float, Meta(ge=0.01, lt=1)]
    """Below: a stop, because a small force at the slide is a large torque at the knee."""


class HipSoftLimit(Table, frozen=True):
    """Damping of outward motion at the hip."""

    damping_nm_s_per_rad: Annotated[float, Meta(ge=0, le=200)]
    """Damping of a leg that is near a limit and moves towards it."""


class SlideSoftLimit(Table, frozen=True):
    """Damping of outward motion at the slide."""

    damping_n_s_per_m: Annotated[float, Meta(ge=0, le=3000)]


class SoftLimit(Table, frozen=True):
    """Damping of outward motion, rising from 0 at the soft margin to this at the hard limit."""

    hip: HipSoftLimit
    slide: SlideSoftLimit


class Watch(Table, frozen=True):
    """Durations before a deviation is a fault, and the time window of energy without a stride."""

    deviation_cycles: Annotated[int, Meta(ge=1, le=20)]
    """Cycles in a row with too large a deviation of effort that are a stop."""
    sign_mismatch_cycles: Annotated[int, Meta(ge=1, le=20)]
    """Cycles in a row with an effort against the motion's need that are a stop."""
    energy_window_ms: Annotated[int, Meta(ge=500, le=10000)]
    """Window of the energy limit where no gait says how long a stride is."""


class HipSpasm(Table, frozen=True):
    """Rise of the hip's torque that is a spasm."""

    rise_nm: Annotated[float, Meta(ge=0.5, le=60)]
    """Rise of the patient's effort within the window that counts as a spasm. Above what a
    voluntary step does."""


class SlideSpasm(Table, frozen=True):
    """Rise of the slide's force that is a spasm."""

    rise_n: Annotated[float, Meta(ge=5, le=600)]


class Spasm(Table, frozen=True):
    """A fast rise of the estimated effort against the motion, beyond work: yield, then stop."""

    hip: HipSpasm
    slide: SlideSpasm
    rise_window_ms: Annotated[int, Meta(ge=20, le=500)]
    """Window in which the patient's effort must rise so far. Shorter: only quicker spasms count."""
    stiffness_ratio: Annotated[float, Meta(ge=0, lt=1)]
    """Stiffness of guidance while a spasm lasts, of the configured one."""
    softening_ms: Annotated[int, Meta(ge=20, le=2000)]
    """Time from full stiffness to none."""
    recovery_ms: Annotated[int, Meta(ge=100, le=10000)]
    """Time from none to full, once the effort is gone."""
    patience_ms: Annotated[int, Meta(ge=20, le=5000)]
    """How long it may last before the machine stops."""


class HipClonus(Table, frozen=True):
    """Swing of the hip's torque that is clonus."""

    swing_nm: Annotated[float, Meta(ge=0.1, le=60)]
    """Amplitude of the estimated effort from which a half-wave counts."""


class SlideClonus(Table, frozen=True):
    """Swing of the slide's force that is clonus."""

    swing_n: Annotated[float, Meta(ge=1, le=600)]


class Clonus(Table, frozen=True):
    """Effort that swings to and fro at 5 to 8 Hz: guidance softens as in a spasm, then a stop."""

    hip: HipClonus
    slide: SlideClonus
    window_ms: Annotated[int, Meta(ge=1000, le=10000)]
    """Window in which the swings of clonus are counted."""
    patience_ms: Annotated[int, Meta(ge=200, le=10000)]
    """Sum of its time within the window before the machine stops."""


class Communication(Table, frozen=True):
    """Limits on missing samples, heartbeats, gateway states and cycles."""

    sample_age_max_cycles: Annotated[int, Meta(ge=1, le=10)]
    """Oldest sample of a drive with which a leg is moved on; an older one is a stop."""
    heartbeat_timeout_ms: Annotated[int, Meta(ge=20, le=500)]
    """Timeout for a drive's heartbeat at the core."""
    gateway_silence_ms: Annotated[int, Meta(ge=50, le=1000)]
    """Silence of the gateway after which a moving leg is stopped. Above the gateway's longest
    pause under load."""
    overruns_in_a_row: Annotated[int, Meta(ge=1, le=20)]
    """Late cycles in a row that are a stop."""
    mode_switch_cycles: Annotated[int, Meta(ge=2, le=20)]
    """Cycles within which a drive must show the mode that was commanded."""
    encoder_frozen_cycles: Annotated[int, Meta(ge=2, le=200)]
    """Cycles with the same count, while the leg must move, after which the encoder counts as
    frozen."""
    encoder_jump_ratio: Annotated[float, Meta(gt=1, le=10)]
    """A step between two SYNCs larger than this many times velocity_max is a jump."""


class HipStop(Table, frozen=True):
    """Checks of stopping at the hip."""

    standstill_rad_per_s: Annotated[float, Meta(ge=0.001, le=0.5)]
    """Speed below which an axis is at rest. Above the noise of the velocity at rest."""
    patient_nm: Annotated[float, Meta(ge=0, le=60)]
    """The patient's effort along the motion, against which a quick stop must keep to its ramp."""


class SlideStop(Table, frozen=True):
    """Checks of stopping at the slide."""

    standstill_m_per_s: Annotated[float, Meta(ge=0.001, le=0.5)]
    patient_n: Annotated[float, Meta(ge=0, le=600)]


class Stop(Table, frozen=True):
    """Checks of stopping (escalation: daemon/core/safety/stop_sequence.py)."""

    obey_cycles: Annotated[int, Meta(ge=1, le=20)]
    """Cycles until a drive must show the commanded state."""
    standstill_cycles: Annotated[int, Meta(ge=1, le=100)]
    """Cycles in a row below the speed of standstill until a leg is at rest."""
    hip: HipStop
    slide: SlideStop
    ramp_margin_ratio: Annotated[float, Meta(gt=1, le=5)]
    """A speed of this many times what the quick-stop ramp allows counts as disobeyed; so does a
    loss of speed below that of the ramp over this."""
    assist_fade_ms: Annotated[int, Meta(ge=20, le=2000)]
    """Time in which assist fades when its lease or its setpoints end."""


class Assist(Table, frozen=True):
    """A controller's setpoints in the core (daemon/core/motion/assist.py)."""

    setpoint_age_max_cycles: Annotated[int, Meta(ge=2, le=50)]
    """Cycles after that of the answered estimate; then a setpoint is stale, and assist lapses."""
    first_setpoint_cycles: Annotated[int, Meta(ge=5, le=500)]
    """Time that mode torque waits for its first setpoint, in cycles."""
    stiffness_rate_max_ratio_per_s: Annotated[float, Meta(ge=0.01, le=10)]
    """Largest change of the stiffness that a controller asks for."""


class Limits(Table, frozen=True):
    """limits.toml. `stop_category` names every cause that a category may be chosen for."""

    hip: HipLimits
    slide: SlideLimits
    singularity: Singularity
    soft_limit: SoftLimit
    watch: Watch
    spasm: Spasm
    clonus: Clonus
    communication: Communication
    stop: Stop
    assist: Assist
    stop_category: dict[str, Category]
    """Stop category of causes that may have more than one; a milder one than the least allowed
    is refused."""
