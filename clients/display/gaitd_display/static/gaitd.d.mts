// Types of gaitd.mjs. Those of the messages are written by `make tables`.

/** Why nothing is known about a key at present. */
export interface Trouble {
  /**
   * silent: the trainer does not speak; unreadable; version: the server has another version of this
   * message; no_connection: the server is away, it is tried again; refused: a key that is not there.
   */
  kind: "silent" | "unreadable" | "version" | "no_connection" | "refused";
  text: string;
}

/** Gets a message and null, or null and the trouble. */
export type Handler<T> = (message: T | null, trouble: Trouble | null) => void;

export type Handlers = { [K in keyof Messages]?: Handler<Messages[K]> };

export interface Options {
  /** Of the display's server; by default that of the page, or ws://127.0.0.1:8090. */
  address?: string;
  /** Where there is no global one: before Node 22. */
  WebSocket?: unknown;
}

export interface Following {
  /** Messages that were replaced by newer ones before they were sent. */
  readonly droppedCount: number;
  close(): void;
}

/** Follow keys until `close()`; the connection comes back by itself. */
export function follow(handlers: Handlers, options?: Options): Following;

/* <!-- messages: begin -->
*/
/** The patient's activity in one leg, every cycle, for a display. */
export interface Activity {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number;
  /** right or left */
  leg: string;
  /** Mode of the service. */
  mode: "off" | "bringing_up" | "ready" | "stopping" | "fault" | "hold" | "gait" | "torque" | "excite" | "reference" | "commission" | "hand_guiding" | "self_test" | (string & {});
  /** What the observer says about this estimate, by name. */
  status: readonly ("valid" | "warm_up" | "predict_only" | "gated" | "standstill_hip" | "standstill_slide" | "near_singular" | "out_of_workspace" | "late" | "inconsistent" | "unreferenced" | "artificial" | "input_saturated" | "near_limit" | "uncalibrated" | "baseline" | (string & {}))[];
  /** The same as hexadecimal bits, as in recordings. */
  status_bits: string;
  /** The hip. */
  hip: AxisActivity;
  /** The slide. */
  slide: AxisActivity;
  /** Sum of both axes. */
  patient_power_w: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  patient_power_w_std: number | null;
  /** Phase 0..1 of this leg's stride; null when no gait plays. */
  gait_phase_ratio: number | null;
}
/** The patient's activity at one axis. */
export interface AxisActivity {
  /** ok; split_unobservable: at rest patient and friction cannot be separated, both are null and the net value is given; bad: all values of the axis are null. */
  validity: "ok" | "split_unobservable" | "bad" | (string & {});
  /** Patient's effort; positive drives the position up. */
  patient: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  patient_std: number | null;
  /** Patient's effort times velocity; positive: works along. */
  patient_power_w: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  patient_power_w_std: number | null;
  /** Patient minus friction: observable also at standstill. */
  net: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  net_std: number | null;
  /** Frequency of the patient's tremor, 3..12 Hz, where it stands out of the last seconds of valid estimates. Null: none does, or the axis is not ok. */
  tremor_frequency_hz?: number | null;
  /** Amplitude of the patient's effort at that frequency; null as that is. */
  tremor_amplitude?: number | null;
}
/** One axis in an estimate; all but the raw values is null where it is not valid. */
export interface AxisEstimate {
  /** ok; split_unobservable: at rest patient and friction cannot be separated, both are null and the net value is given; bad: all values of the axis are null. */
  validity: "ok" | "split_unobservable" | "bad" | (string & {});
  /** Angle of the hip, positive in flexion; place of the slide on its rail. */
  position: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  position_std: number | null;
  /** Change of the position. */
  velocity: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  velocity_std: number | null;
  /** Friction; positive opposes positive velocity. */
  friction: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  friction_std: number | null;
  /** Patient's effort; positive drives the position up. */
  patient: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  patient_std: number | null;
  /** Patient minus friction: observable also at standstill. */
  net: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  net_std: number | null;
  /** Measured minus predicted position, always given. */
  innovation: number | null;
  /** Raw; null: no sample. */
  measured_position: number | null;
  /** Drive's effort as the observer used it: over the past cycle. */
  effort: number | null;
  /** Frequency of the patient's tremor, 3..12 Hz, where it stands out of the last seconds of valid estimates. Null: none does, or the axis is not ok. */
  tremor_frequency_hz?: number | null;
  /** Amplitude of the patient's effort at that frequency; null as that is. */
  tremor_amplitude?: number | null;
  /** Artificial disturbance: effort = measured - this. */
  artificial: number | null;
  /** Position that the mode wants. */
  reference_position: number | null;
  /** A controller's assist in force, bounded; 0: none. */
  assist: number | null;
  /** What the motion of the reference needs beyond the load: inertia, Coriolis terms, dampers and friction of robot.toml, and what a passive baseline explains besides. Null: nothing is guided. */
  needed?: number | null;
}
/** Friction of one axis. */
export interface AxisFriction {
  /** ok; split_unobservable: at rest patient and friction cannot be separated, both are null and the net value is given; bad: all values of the axis are null. */
  validity: "ok" | "split_unobservable" | "bad" | (string & {});
  /** Friction; positive opposes positive velocity. */
  friction: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  friction_std: number | null;
  /** Patient's effort with the direction of motion, -1..1, over the last 20 s of motion. Above 0.8 with an empty machine: calibrate. */
  drift_correlation: number | null;
  /** Friction above its law, unless a patient pushes along. */
  friction_error: number | null;
}
/** The patient's estimated activity at one axis over one stride. */
export interface AxisStride {
  /** Work with the motion. */
  work_positive_j: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  work_positive_j_std: number | null;
  /** Work against the motion; not positive. */
  work_negative_j: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  work_negative_j_std: number | null;
  /** Effort along the motion, mean. */
  assist_mean: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  assist_mean_std: number | null;
  /** Effort along the motion, the largest in size. */
  assist_peak: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  assist_peak_std: number | null;
  /** Mean over the stride. */
  power_mean_w: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  power_mean_w_std: number | null;
  /** The largest in size, with its sign. */
  power_peak_w: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  power_peak_w_std: number | null;
  /** Patient's positive work over that of patient and drive; null below 0.5 J. */
  share_ratio: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  share_ratio_std: number | null;
  /** Mean tremor of the stride; null unless it stood out in more than half of its valid parts of 1.28 s. */
  tremor_frequency_hz?: number | null;
  /** Mean amplitude of the tremor; null as the frequency is. */
  tremor_amplitude?: number | null;
  /** Share of the stride's time in which the patient's effort was known; below 0.5, or with an invalid sample, the axis' other figures are null. */
  coverage_ratio: number;
}
/** The CAN controller and other nodes on the bus; counts since the core's start. */
export interface BusHealth {
  /** Fault confinement state, ISO 11898-1. */
  condition: "active" | "warning" | "error passive" | "bus-off" | (string & {});
  /** Times the controller left the bus. */
  bus_off_count: number;
  /** Reports of error passive. */
  passive_count: number;
  /** Reports of many errors. */
  warning_count: number;
  /** Times it was restarted after bus-off. */
  restart_count: number;
  /** Frames that no node acknowledged. */
  no_ack_count: number;
  /** Times the controller lost frames. */
  overflow_count: number;
  /** SYNCs of another master, and heartbeats with our node id. */
  foreign_master_count: number;
  /** Frames of unknown nodes, since bring-up. */
  stray_count: number;
  /** Measured in the last second, 0..1; bus_load_ratio is the worst. */
  load_ratio: number;
}
/** State of the controller that holds the lease, as it has reported it; usually each stride. The service has checked who reports, and not what. */
export interface ControllerState {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string | null;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number | null;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number | null;
  /** right or left */
  leg: string;
  /** Who holds the lease. */
  client: string;
  /** `cycle` to which the state belongs. */
  for_cycle: number | null;
  /** State of the leg. */
  values?: Record<string, number | readonly (number | null)[] | null>;
  /** State of the hip. */
  hip?: Record<string, number | readonly (number | null)[] | null>;
  /** State of the slide. */
  slide?: Record<string, number | readonly (number | null)[] | null>;
}
/** Communication with one drive. */
export interface DriveHealth {
  /** LEG/AXIS */
  name: string;
  /** Cycles without its sample, since gateway start. */
  missed_count: number;
  /** TPDOs after their window, since bring-up. */
  late_count: number;
  /** Missed and not late: never received. */
  lost_count: number;
  /** Frames that could not be used. */
  protocol_error_count: number;
  /** Since its last heartbeat. */
  heartbeat_age_ms: number | null;
}
/** One drive at 10 Hz, its values at the joint. Null: unknown. */
export interface DriveState {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number;
  /** LEG/AXIS, for example right/hip */
  name: string;
  /** CiA 301 state. */
  nmt_state: "boot_up" | "stopped" | "operational" | "pre_operational" | "unknown" | (string & {});
  /** CiA 402 state. */
  power_state: "unknown" | "not_ready_to_switch_on" | "switch_on_disabled" | "ready_to_switch_on" | "switched_on" | "operation_enabled" | "quick_stop_active" | "fault_reaction_active" | "fault" | (string & {});
  /** Object 6041h, hexadecimal. */
  statusword: string | null;
  /** Object 6061h: 10 torque, 8 position. */
  mode_display: number | null;
  /** All its samples arrived in this cycle's window. */
  fresh: boolean;
  /** Cycles since the last whole sample. */
  sample_age_cycles: number;
  /** TPDOs after their window, since bring-up. */
  late_count: number;
  /** Since its last heartbeat. */
  heartbeat_age_ms: number | null;
  /** Measured. */
  position: number | null;
  /** From encoder differences. */
  velocity: number | null;
  /** From measured current. */
  effort: number | null;
  /** Sent in this cycle. */
  target_effort: number | null;
  /** The axis is referenced. */
  referenced: boolean;
  /** As the drive input reads it. */
  hand_switch_closed: boolean | null;
  /** Safe torque off is not active. */
  sto_released: boolean | null;
  /** Temperature of the power stage. */
  temperature_degc: number | null;
  /** Newest EMCY code, hexadecimal; null when there is none. */
  emergency_code: string | null;
  /** Its meaning; empty when there is none. */
  emergency_text: string;
  /** EMCY messages since bring-up. */
  emergency_count: number;
  /** Frames that could not be used. */
  protocol_error_count: number;
  /** Torque and motion agree in sign; confirmed by a person, too. */
  sign_proven: boolean;
  /** EMCY messages since the core's start, the newest 32, oldest first. */
  emergencies: readonly (Emergency)[];
}
/** One EMCY message of a drive. */
export interface Emergency {
  /** UTC in ns since 1970, of its cycle. */
  time_ns: number;
  /** Hexadecimal. */
  code: string;
  /** Its meaning, by the drive's vendor. */
  text: string;
  /** What the drive does by itself. */
  reaction: string;
  /** True: it causes a stop; false: it is a warning. */
  alarm: boolean;
  /** The encoder's position is invalid since then. */
  loses_reference: boolean;
  /** Object 1001h, hexadecimal. */
  error_register: string;
  /** Five bytes of the vendor's, hexadecimal. */
  vendor_bytes: string;
}
/** The observer's complete estimate of one leg, every cycle, for a controller. */
export interface Estimate {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number;
  /** right or left */
  leg: string;
  /** Mode of the service. */
  mode: "off" | "bringing_up" | "ready" | "stopping" | "fault" | "hold" | "gait" | "torque" | "excite" | "reference" | "commission" | "hand_guiding" | "self_test" | (string & {});
  /** What the observer says about this estimate, by name. */
  status: readonly ("valid" | "warm_up" | "predict_only" | "gated" | "standstill_hip" | "standstill_slide" | "near_singular" | "out_of_workspace" | "late" | "inconsistent" | "unreferenced" | "artificial" | "input_saturated" | "near_limit" | "uncalibrated" | "baseline" | (string & {}))[];
  /** The same as hexadecimal bits, as in recordings. */
  status_bits: string;
  /** The hip. */
  hip: AxisEstimate;
  /** The slide. */
  slide: AxisEstimate;
  /** Lower triangle, row by row, 36 values, SI; order of the states: positions (hip, slide), velocities, frictions, patient. Null when an axis is bad. */
  covariance: readonly (number)[] | null;
  /** Normalised innovation squared; 2 on average. */
  nis: number | null;
  /** Forgetting mean of some 100 cycles: 1.72 to 2.28 in 95 % if as modelled. */
  mean_nis: number | null;
  /** Observable states of 8; one less for each axis with an unobservable split. */
  observable_rank: number;
  /** Phase 0..1 of this leg's stride; null when no gait plays. */
  gait_phase_ratio: number | null;
  /** True time since the SYNC before. */
  dt_s: number | null;
  /** In force, of the guidance's configured stiffness. */
  stiffness_ratio: number | null;
  /** `seq` of the newest setpoint that counts; null: none does. */
  setpoint_seq: number | null;
}
/** One event. A bounded history reaches late joiners (AdvancedSubscriber). */
export interface Event {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string | null;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number | null;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number | null;
  /** BOOT-RECORD-INDEX; the same if an event is sent twice. */
  id: string;
  /** UTC in ns since 1970. */
  time_ns: number;
  /** As in IEC 60601-1-8: high, medium, low; info is no alarm. */
  priority: "high" | "medium" | "low" | "info" | (string & {});
  /** What sort of event. */
  kind: "core" | "mode" | "stop" | "request" | "drive" | "emergency" | "input" | "note" | (string & {});
  /** What happened, for example mode_changed. */
  code: string;
  /** Cause of a stop; else null. */
  cause: "none" | "stop_requested" | "shutdown" | "gateway_silent" | "cycle_overrun" | "command_not_finite" | "last_end_unknown" | "hand_switch_open" | "sto_active" | "inputs_impossible" | "bus_down" | "drive_silent" | "heartbeat_lost" | "drive_rebooted" | "drive_not_operational" | "drive_fault" | "emergency" | "drive_left_enabled" | "mode_not_shown" | "not_following" | "bring_up_failed" | "bus_off" | "transmit_queue_full" | "drive_powered" | "unexpected_enable" | "encoder_frozen" | "encoder_jump" | "unreferenced" | "sign_wrong" | "effort_deviation" | "moved_against_drive" | "position_limit" | "velocity_limit" | "effort_limit" | "power_limit" | "tracking_limit" | "temperature_limit" | "singularity" | "limit_switch" | "energy_limit" | "stopping_path" | "observer_invalid" | "static_load_wrong" | "spasm" | "self_test_failed" | "clonus" | "stop_not_obeyed" | (string & {}) | null;
  /** Drive or leg; null if of none. */
  subject: string | null;
  /** Values of the code, by name. */
  values: Record<string, number | string | null>;
  /** What a drive or the operating system has said, or empty. */
  said: string;
}
/** Friction of one leg's axes, every cycle. */
export interface Friction {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number;
  /** right or left */
  leg: string;
  /** Mode of the service. */
  mode: "off" | "bringing_up" | "ready" | "stopping" | "fault" | "hold" | "gait" | "torque" | "excite" | "reference" | "commission" | "hand_guiding" | "self_test" | (string & {});
  /** What the observer says about this estimate, by name. */
  status: readonly ("valid" | "warm_up" | "predict_only" | "gated" | "standstill_hip" | "standstill_slide" | "near_singular" | "out_of_workspace" | "late" | "inconsistent" | "unreferenced" | "artificial" | "input_saturated" | "near_limit" | "uncalibrated" | "baseline" | (string & {}))[];
  /** The same as hexadecimal bits, as in recordings. */
  status_bits: string;
  /** The hip. */
  hip: AxisFriction;
  /** The slide. */
  slide: AxisFriction;
}
/** State of the service itself, once a second. */
export interface Health {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string | null;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number | null;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number | null;
  /** Upper bounds of the histogram's classes; one more: above. */
  lateness_bound_us: readonly (number)[];
  /** SYNCs per class of lateness since the core's start. */
  lateness_count: readonly (number)[];
  /** Median lateness of SYNC in the last second. */
  lateness_p50_us: number | null;
  /** Largest lateness of SYNC in the last second. */
  lateness_max_us: number | null;
  /** SYNC to last TPDO, last second. */
  collect_max_us: number | null;
  /** Python work of a cycle, last second. */
  work_max_us: number | null;
  /** Grid points missed since core start. */
  overrun_count: number | null;
  /** The same by the part of the cycle that took longest beyond what it may: wake_up, window, work, publish. */
  overrun_by_part: Record<string, number>;
  /** Ring, state file and systemd; last second. */
  publish_max_us: number | null;
  /** Records in the last second; 100 is right. */
  record_count: number;
  /** 0..1 of the CAN bit rate. */
  bus_load_ratio: number | null;
  /** Communication, by drive. */
  drives: readonly (DriveHealth)[];
  /** CAN frames not sent. */
  tx_dropped_count: number | null;
  /** Records that this gateway missed. */
  record_missed_count: number;
  /** Records too old to publish. */
  record_skipped_count: number;
  /** Gateway states that the core did not accept. */
  gateway_state_dropped_count: number;
  /** Queries never answered: too many. */
  request_dropped_count: number;
  /** Times that black box or request log could not be written. */
  not_kept_count: number;
  /** Longest work of the gateway on one wake, last second. */
  gateway_wake_max_us: number | null;
  /** Median from the gateway's wake to its first estimate, last second. */
  gateway_estimate_p50_us: number | null;
  /** The CAN controller; null: unknown. */
  bus: BusHealth | null;
  /** By the core, since its start. */
  setpoint_accepted_count: number | null;
  /** By reason (docs/control_by_others.md); gateway and core together. */
  setpoint_refused_count: Record<string, number>;
  /** Times that assist ended for want of a lease or setpoints. */
  assist_lapse_count: number | null;
  /** Clients, `gateway` or `authority`, whose certificate ends within 30 days. */
  keys_expiring?: readonly (string)[];
  /** The drives are virtual, and time is granted by `gaitd sim`. */
  time_is_simulated?: boolean | null;
}
/** The verdict: stop category, cause and finding; latched until reset. */
export interface Judgement {
  /** Stop category: S2 brake and hold, S1 quick stop, S0 voltage off, or none. */
  category: "none" | "S2" | "S1" | "S0" | (string & {});
  /** Cause of a stop, `none` if there is none. */
  cause: "none" | "stop_requested" | "shutdown" | "gateway_silent" | "cycle_overrun" | "command_not_finite" | "last_end_unknown" | "hand_switch_open" | "sto_active" | "inputs_impossible" | "bus_down" | "drive_silent" | "heartbeat_lost" | "drive_rebooted" | "drive_not_operational" | "drive_fault" | "emergency" | "drive_left_enabled" | "mode_not_shown" | "not_following" | "bring_up_failed" | "bus_off" | "transmit_queue_full" | "drive_powered" | "unexpected_enable" | "encoder_frozen" | "encoder_jump" | "unreferenced" | "sign_wrong" | "effort_deviation" | "moved_against_drive" | "position_limit" | "velocity_limit" | "effort_limit" | "power_limit" | "tracking_limit" | "temperature_limit" | "singularity" | "limit_switch" | "energy_limit" | "stopping_path" | "observer_invalid" | "static_load_wrong" | "spasm" | "self_test_failed" | "clonus" | "stop_not_obeyed" | (string & {});
  /** Drive or leg of the cause; null if of none. */
  drive: string | null;
  /** Measured value, in the unit of the limit. */
  value: number | null;
  /** The limit. */
  limit: number | null;
  /** What it was found by, or none. */
  finding: string;
  /** What the drive or the operating system has said, or empty. */
  said: string;
}
/** The present step of a bring-up or an exercise. A later version may send another code. */
export interface Progress {
  /** For example setting_up. */
  code: string;
  /** Drive or leg; null if of none. */
  subject: string | null;
  /** By name, for example `done_count`. */
  values: Record<string, number | string | null>;
}
/** Safety state of the machine: published on change, and once a second. */
export interface Safety {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string | null;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number | null;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number | null;
  /** False: no records from the core; all that follows is null, but `progress` while the core starts. */
  valid: boolean;
  /** Null when not valid. */
  mode: "off" | "bringing_up" | "ready" | "stopping" | "fault" | "hold" | "gait" | "torque" | "excite" | "reference" | "commission" | "hand_guiding" | "self_test" | (string & {}) | null;
  /** The drives are enabled on purpose. */
  active: boolean | null;
  /** Null when not valid. */
  verdict: Judgement | null;
  /** Null: no exercise, or not valid. */
  stage: "preparing" | "announcing" | "approaching" | "playing" | "ending" | "over" | (string & {}) | null;
  /** What the machine does now; null: nothing, or not known. */
  progress: Progress | null;
  /** Client that may command torque; null: none. */
  lease_holder: string | null;
  /** Age of the newest gateway state at the core. */
  gateway_age_cycles: number | null;
  /** Stop requests that the core has received. */
  stop_count: number | null;
  /** Limits in force: limits.toml as it was read. */
  limits: Record<string, unknown> | null;
}
/** The patient's estimated activity in one leg over one stride, published at its end. Computed from the estimate smoothed over 150 ms. It contains muscle force, passive tissue, and the errors of the models of leg and friction; `baseline_subtracted`: what a minute with a passive patient explains is taken off. */
export interface Stride {
  /** Counts the messages of this key; a gap is a loss. */
  seq: number;
  /** Changes when the core restarts. */
  core_boot_id: string;
  /** Cycle of the 10 ms grid since core start. */
  cycle: number;
  /** UTC of that cycle's SYNC in ns since 1970; for records only. */
  sample_time_ns: number;
  /** right or left */
  leg: string;
  /** Mode of the service. */
  mode: "off" | "bringing_up" | "ready" | "stopping" | "fault" | "hold" | "gait" | "torque" | "excite" | "reference" | "commission" | "hand_guiding" | "self_test" | (string & {});
  /** What the observer says about this estimate, by name. */
  status: readonly ("valid" | "warm_up" | "predict_only" | "gated" | "standstill_hip" | "standstill_slide" | "near_singular" | "out_of_workspace" | "late" | "inconsistent" | "unreferenced" | "artificial" | "input_saturated" | "near_limit" | "uncalibrated" | "baseline" | (string & {}))[];
  /** The same as hexadecimal bits, as in recordings. */
  status_bits: string;
  /** Counts the strides of this leg since core start, from 1. */
  number: number;
  /** From one rise of the hip to the next. */
  duration_s: number;
  /** Strides per second: 1 / duration. */
  cadence_hz: number;
  /** Cycles in the stride. */
  sample_count: number;
  /** The hip. */
  hip: AxisStride;
  /** The slide. */
  slide: AxisStride;
  /** Patient's work of both axes, with the motion. */
  work_positive_j: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  work_positive_j_std: number | null;
  /** Patient's work of both axes, against the motion. */
  work_negative_j: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  work_negative_j_std: number | null;
  /** Share of both axes; null below 0.5 J. */
  share_ratio: number | null;
  /** Standard deviation of the field of the same name; null where that is null. */
  share_ratio_std: number | null;
  /** A passive baseline is taken off. */
  baseline_subtracted: boolean;
}
export interface Messages {
  "right/estimate": Estimate;
  "left/estimate": Estimate;
  "right/activity": Activity;
  "left/activity": Activity;
  "right/friction": Friction;
  "left/friction": Friction;
  "right/stride": Stride;
  "left/stride": Stride;
  "right/controller": ControllerState;
  "left/controller": ControllerState;
  "drives/right/hip": DriveState;
  "drives/right/slide": DriveState;
  "drives/left/hip": DriveState;
  "drives/left/slide": DriveState;
  "safety": Safety;
  "events": Event;
  "health": Health;
}
/*
<!-- messages: end --> */
