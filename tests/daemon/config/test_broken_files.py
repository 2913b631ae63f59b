"""A broken configuration is refused by file, key, value and what would be allowed.

Each row of BROKEN is one small change of the good files and the four things that the one line on
stderr must then say.
"""

import socket
import subprocess
import sys
from contextlib import nullcontext
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pytest
from config_files import CONFIGS, Change, changed, copied

from daemon.preflight.load import ConfigError, load
from daemon.system.lock import hold
from gaitd.__main__ import main


class Broken(NamedTuple):
    name: str
    change: Change
    file: str
    key: str
    value: str
    allowed: str


def broken(name: str, file: str, old: str, new: str, key: str, value: str, allowed: str) -> Broken:
    """A change whose fault is told of the changed file."""
    return Broken(name, Change(file, old, new), file, key, value, allowed)


def told_of(other: str, row: Broken) -> Broken:
    """The same, told of another file."""
    return row._replace(file=other)


ONE_FILE = [
    broken(
        "a syntax error",
        "limits.toml",
        "torque_max_nm = 62.0",
        "torque_max_nm = ",
        "line 10, column 31",
        "torque_max_nm =",
        "TOML syntax: Invalid value",
    ),
    broken(
        "a key that stands twice",
        "limits.toml",
        "torque_max_nm = 62.0",
        "power_max_w = 1.0\ntorque_max_nm = 62.0",
        "line 13, column 20",
        "power_max_w = 250.0",
        "Cannot overwrite a value",
    ),
    broken(
        "a misspelt key",
        "limits.toml",
        "torque_max_nm",
        "torque_max",
        "hip.torque_max",
        "62.0",
        "unknown key. Did you mean `torque_max_nm`?",
    ),
    broken(
        "a key too many",
        "demo.toml",
        "window_ms = 4.0",
        "window_ms = 4.0\nturbo = true",
        "cycle.turbo",
        "true",
        "unknown key. Known: period_ms, window_ms",
    ),
    broken(
        "a missing number",
        "robot.toml",
        "recline_deg",
        "# recline_deg",
        "geometry.recline_deg",
        "(missing)",
        "a number >= 0 and <= 90",
    ),
    broken(
        "a missing table",
        "robot.toml",
        "[shank]\nmass_kg = 2.5\ncom_ratio = 0.50\ncom_offset_deg = -5.0\n"
        "inertia_kg_m2 = 0.0431412512",
        "",
        "shank",
        "(missing)",
        "a table with mass_kg",
    ),
    broken(
        "text for a number",
        "limits.toml",
        "torque_max_nm = 62.0",
        'torque_max_nm = "62"',
        "hip.torque_max_nm",
        '"62"',
        "a number >= 0.5 and <= 120",
    ),
    broken(
        "a number for a switch",
        "limits.toml",
        "brake = false",
        "brake = 0",
        "hip.brake",
        "0",
        "true or false",
    ),
    broken(
        "a fraction for a whole number",
        "demo.toml",
        "ramp_strides = 2",
        "ramp_strides = 2.5",
        "gait.ramp_strides",
        "2.5",
        "a whole number >= 1 and <= 10",
    ),
    broken(
        "a torque beyond any leg",
        "limits.toml",
        "torque_max_nm = 62.0",
        "torque_max_nm = 300.0",
        "hip.torque_max_nm",
        "300.0",
        "a number >= 0.5 and <= 120",
    ),
    broken(
        "a negative mass",
        "robot.toml",
        "mass_kg = 4.0",
        "mass_kg = -4.0",
        "thigh.mass_kg",
        "-4.0",
        "a number >= 0 and <= 50",
    ),
    broken(
        "not a number",
        "limits.toml",
        "velocity_max_m_per_s = 3.5",
        "velocity_max_m_per_s = nan",
        "slide.velocity_max_m_per_s",
        "nan",
        "a number >= 0.02 and <= 5",
    ),
    broken(
        "infinity",
        "demo.toml",
        "duration_max_s = 25.0",
        "duration_max_s = inf",
        "excite.open_loop.duration_max_s",
        "inf",
        "a number >= 0.1 and <= 600",
    ),
    broken(
        "not a number inside a list",
        "demo.toml",
        "[20.129, -3.2]",
        "[20.129, nan]",
        "gait.hip.harmonics_deg[0][1]",
        "nan",
        "a number >= -180 and <= 180",
    ),
    broken(
        "a harmonic of one number",
        "demo.toml",
        "[20.129, -3.2]",
        "[20.129]",
        "gait.hip.harmonics_deg[0]",
        "[20.129]",
        "a list of 2",
    ),
    broken(
        "an unknown choice",
        "demo.toml",
        'guidance = "impedance"',
        'guidance = "assist"',
        "gait.guidance",
        '"assist"',
        'one of "impedance", "position"',
    ),
    broken(
        "explicit Euler",
        "robot.toml",
        'integrator = "rk4"',
        'integrator = "euler"',
        "observer.integrator",
        '"euler"',
        'one of "rk4", "semi_implicit"',
    ),
    broken(
        "another cycle than 10 ms",
        "demo.toml",
        "period_ms = 10",
        "period_ms = 5",
        "cycle.period_ms",
        "5",
        "one of 10",
    ),
    broken(
        "a detection slower than 100 ms",
        "demo.toml",
        "drive_detection_ms = 100",
        "drive_detection_ms = 150",
        "cycle.drive_detection_ms",
        "150",
        "a whole number >= 20 and <= 100",
    ),
    broken(
        "an address that is none",
        "demo.toml",
        "tcp/127.0.0.1:7447",
        "127.0.0.1:7447",
        "zenoh.listen[0]",
        '"127.0.0.1:7447"',
        "text that matches",
    ),
]

TOGETHER = [
    broken(
        "a file that is not there",
        "demo.toml",
        '"robot.toml"',
        '"robot_80kg.toml"',
        "robot",
        "robot_80kg.toml",
        "a file that exists",
    ),
    told_of(
        "drives/hip_epos4.toml",
        broken(
            "an EDS that is not there",
            "drives/hip_epos4.toml",
            "epos4.eds",
            "epos5.eds",
            "eds",
            "epos5.eds",
            "a file that exists",
        ),
    ),
    broken(
        "two legs of one name",
        "demo.toml",
        "[hold]",
        '[[leg]]\nname = "right"\nhip = "drives/hip_epos4.toml"\n'
        'slide = "drives/slide_epos4.toml"\n\n[hold]',
        "leg[1].name",
        '"right"',
        "another name than the other leg's",
    ),
    told_of(
        "drives/hip_epos4.toml",
        broken(
            "two drives with one node id",
            "demo.toml",
            "[hold]",
            '[[leg]]\nname = "left"\nhip = "drives/hip_epos4.toml"\n'
            'slide = "drives/slide_epos4.toml"\n\n[hold]',
            "node_id",
            "5",
            "a unique node id; this one is that of right/hip",
        ),
    ),
    told_of(
        "drives/hip_epos4.toml",
        broken(
            "a drive with the master's node id",
            "demo.toml",
            "master_node_id = 1",
            "master_node_id = 5",
            "node_id",
            "5",
            "this one is that of the master",
        ),
    ),
    told_of(
        "drives/slide_epos4.toml",
        broken(
            "the slide's drive at the hip",
            "demo.toml",
            "drives/hip_epos4.toml",
            "drives/slide_epos4.toml",
            "transmission.kind",
            '"linear"',
            '"rotary" for the hip',
        ),
    ),
    broken(
        "a torque base of another motor",
        "drives/hip_epos4.toml",
        "rated_torque_raw = 278680",
        "rated_torque_raw = 512871",
        "motor.rated_torque_raw",
        "512871",
        "about 278680",
    ),
    broken(
        "a unit of torque that no drive has",
        "drives/profiles/epos4.toml",
        'unit = "milliampere"\nfactor = 1.0\nsign',
        'unit = "newton"\nfactor = 1.0\nsign',
        "torque_source.unit",
        '"newton"',
        'one of "ampere", "milliampere", "permille_of_rated_current"',
    ),
    broken(
        "a torque object without its factor",
        "drives/profiles/epos4.toml",
        "factor = 1.0\nsign = 1\n",
        "sign = 1\n",
        "torque_source.factor",
        "(missing)",
        "a number >= 1e-09 and <= 1000",
    ),
    broken(
        "a factor of nothing",
        "drives/profiles/epos4.toml",
        "factor = 1.0\nsign = 1\n",
        "factor = 0.0\nsign = 1\n",
        "torque_source.factor",
        "0.0",
        "a number >= 1e-09 and <= 1000",
    ),
    broken(
        "a factor that is no number",
        "drives/profiles/epos4.toml",
        "factor = 1.0\nsign = 1\n",
        "factor = nan\nsign = 1\n",
        "torque_source.factor",
        "nan",
        "a number >= 1e-09 and <= 1000",
    ),
    broken(
        "an optional object that is not mentioned",
        "drives/profiles/epos4.toml",
        "polarity = false",
        "# polarity = false",
        "optional_objects.polarity",
        "(missing)",
        "true or false",
    ),
    broken(
        "an EMCY code made milder",
        "drives/profiles/epos4.toml",
        'text = "overcurrent", reaction = "switched_off"',
        'text = "overcurrent", reaction = "warning"',
        "emergencies[2310h].reaction",
        '"warning"',
        "a stop: only FFxxh, which CiA 301 leaves to the maker, may be a warning",
    ),
    broken(
        "a drive without any sign of silence",
        "drives/profiles/epos4.toml",
        "consumer_entries = 2",
        "consumer_entries = 0",
        "heartbeat.consumer_entries",
        "0",
        "a drive must detect the loss of its master",
    ),
    broken(
        "a quick stop that lets the leg fall",
        "drives/profiles/epos4.toml",
        "value = 6\nlegal = [6]",
        "value = 0\nlegal = [0, 6]",
        "written[605Ah].value",
        "0",
        "not 0: a quick stop that only switches off lets the leg fall",
    ),
    broken(
        "an interface that is no name of one",
        "demo.toml",
        'interface = "simulated"',
        'interface = "Simulated!"',
        "bus.interface",
        '"Simulated!"',
        "simulated, socketcan, or another interface of python-can by its own name",
    ),
    broken(
        "a bus too slow for its frames",
        "demo.toml",
        "bitrate_bit_per_s = 1_000_000",
        "bitrate_bit_per_s = 250_000",
        "bus.bitrate_bit_per_s",
        "250000",
        "at least 26",
    ),
    broken(
        "a SYNC counter of one",
        "demo.toml",
        "master_node_id = 1",
        "master_node_id = 1\nsync_counter = 1",
        "cycle.sync_counter",
        "1",
        "2 to 240",
    ),
    broken(
        "a SYNC counter that a drive does not know",
        "demo.toml",
        "master_node_id = 1",
        "master_node_id = 1\nsync_counter = 10",
        "cycle.sync_counter",
        "10",
        "says it has no 1019h",
    ),
    broken(
        "a SYNC window in which our commands have no place",
        "demo.toml",
        "master_node_id = 1",
        "master_node_id = 1\nsync_window_ms = 3.0",
        "cycle.sync_window_ms",
        "3.0",
        "above cycle.window_ms = 4",
    ),
    broken(
        "a detection that two lost heartbeats set off",
        "demo.toml",
        "master_heartbeat_ms = 20",
        "master_heartbeat_ms = 50",
        "cycle.drive_detection_ms",
        "100",
        ">= 150 and <= 100",
    ),
    broken(
        "a heartbeat off the grid",
        "demo.toml",
        "master_heartbeat_ms = 20",
        "master_heartbeat_ms = 25",
        "cycle.master_heartbeat_ms",
        "25",
        "a multiple of cycle.period_ms = 10",
    ),
    broken(
        "a timeout shorter than two heartbeats",
        "limits.toml",
        "heartbeat_timeout_ms = 150",
        "heartbeat_timeout_ms = 60",
        "communication.heartbeat_timeout_ms",
        "60",
        ">= 110",
    ),
    broken(
        "an unknown cause",
        "limits.toml",
        "stop_requested =",
        "stop_button =",
        "stop_category.stop_button",
        '"S2"',
        "unknown cause. Known: stop_requested",
    ),
    broken(
        "a cause without a category",
        "limits.toml",
        "velocity_limit =",
        "# velocity_limit =",
        "stop_category.velocity_limit",
        "(missing)",
        "one of S2, S1, S0",
    ),
    broken(
        "doubtful feedback made harmless",
        "limits.toml",
        "[stop_category]",
        '[stop_category]\nencoder_jump = "S2"',
        "stop_category.encoder_jump",
        '"S2"',
        "fixed at S0, because an axis never holds by an encoder that is not reliable",
    ),
    broken(
        "a lost drive made harmless",
        "limits.toml",
        "[stop_category]",
        '[stop_category]\ndrive_silent = "S2"',
        "stop_category.drive_silent",
        '"S2"',
        "fixed at S1, because when one drive is lost the others ramp down at once",
    ),
    broken(
        "the hand switch made harmless",
        "limits.toml",
        "[stop_category]",
        '[stop_category]\nhand_switch_open = "S2"',
        "stop_category.hand_switch_open",
        '"S2"',
        "fixed at S1",
    ),
    broken(
        "a drive in fault asked to hold",
        "limits.toml",
        'drive_fault = "S1"',
        'drive_fault = "S2"',
        "stop_category.drive_fault",
        '"S2"',
        "S1 or S0: the drive in fault cannot hold",
    ),
    broken(
        "a range upside down",
        "limits.toml",
        "position_max_deg = 40.0",
        "position_max_deg = -30.0",
        "hip.position_max_deg",
        "-30",
        "> hip.position_min_deg = -20",
    ),
    broken(
        "margins that leave no range",
        "limits.toml",
        "position_max_deg = 40.0",
        "position_max_deg = -13.0",
        "hip.soft_margin_deg",
        "4",
        "< 3.5, half of the range",
    ),
    broken(
        "a soft limit behind the hard one",
        "limits.toml",
        "soft_ratio = 0.3",
        "soft_ratio = 0.1",
        "singularity.soft_ratio",
        "0.1",
        "> singularity.stop_ratio = 0.15",
    ),
    broken(
        "a patience with clonus that no window holds",
        "limits.toml",
        "patience_ms = 1500",
        "patience_ms = 10000",
        "clonus.patience_ms",
        "10000",
        "< clonus.window_ms = 10000",
    ),
    broken(
        "more torque than the drive has",
        "limits.toml",
        "torque_max_nm = 62.0",
        "torque_max_nm = 80.0",
        "hip.torque_max_nm",
        "80",
        "<= 66.9, what right/hip has at 12 A",
    ),
    broken(
        "a standstill below the encoder's noise",
        "limits.toml",
        "slide.standstill_m_per_s = 0.03",
        "slide.standstill_m_per_s = 0.004",
        "stop.slide.standstill_m_per_s",
        "0.004",
        ">= 0.0098, 2 counts of right/slide per cycle",
    ),
    broken(
        "friction whose hump turns over",
        "robot.toml",
        "stribeck_nm = 7.0",
        "stribeck_nm = 6.0",
        "friction.hip.stribeck_nm",
        "6",
        "> 6.039",
    ),
    broken(
        "a load check that friction alone fails",
        "limits.toml",
        "static_load_tolerance_n = 110.0",
        "static_load_tolerance_n = 70.0",
        "slide.static_load_tolerance_n",
        "70",
        "> 75, which friction alone can hide at rest",
    ),
    told_of(
        "limits.toml",
        broken(
            "a load check that friction alone fails at the end of the slide",
            "robot.toml",
            "slide.slope_per_m = 0.0",
            "slide.slope_per_m = 1.5",
            "slide.static_load_tolerance_n",
            "110",
            "> 111.9, which friction alone can hide at rest",
        ),
    ),
    broken(
        "too few substeps for steep friction",
        "robot.toml",
        "transition_m_per_s = 0.004\npeak_m_per_s = 0.02\nedge_m_per_s = 0.012\n"
        "time_constant_s = 0.02",
        "transition_m_per_s = 0.0004\npeak_m_per_s = 0.02\nedge_m_per_s = 0.0012\n"
        "time_constant_s = 0.001",
        "observer.substeps",
        "2",
        "<= 10: rk4 with this friction is unstable below",
    ),
    broken(
        "friction too steep for any substeps",
        "robot.toml",
        "transition_rad_per_s = 0.01\npeak_rad_per_s = 0.05\nedge_rad_per_s = 0.03\n"
        "time_constant_s = 0.02",
        "transition_rad_per_s = 0.0001\npeak_rad_per_s = 0.05\nedge_rad_per_s = 0.0001\n"
        "time_constant_s = 0.0001",
        "observer.integrator",
        "rk4",
        "too steep for 10 substeps",
    ),
    broken(
        "damping of bristles that are not there",
        "robot.toml",
        "bristle_damping_n_s_per_m = 0.0",
        "bristle_damping_n_s_per_m = 300.0",
        "friction.slide.bristle_damping_n_s_per_m",
        "300.0",
        "0 while bristle_stiffness_n_per_m is 0",
    ),
    broken(
        "bristles with rk4",
        "robot.toml",
        "bristle_stiffness_n_per_m = 0.0",
        "bristle_stiffness_n_per_m = 1e5",
        "observer.integrator",
        "rk4",
        "semi_implicit, because bristles follow",
    ),
    broken(
        "bristles too stiff for any substeps",
        "robot.toml",
        "bristle_stiffness_n_per_m = 0.0",
        "bristle_stiffness_n_per_m = 1e8",
        "friction.slide.bristle_stiffness_n_per_m",
        "100000000.0",
        "10 substeps of semi_implicit are unstable above",
    ),
    broken(
        "bristles whose damping alone is too much for any substeps",
        "robot.toml",
        "bristle_stiffness_n_per_m = 0.0    # as for the hip\nbristle_damping_n_s_per_m = 0.0",
        "bristle_stiffness_n_per_m = 1e5\nbristle_damping_n_s_per_m = 1e5",
        "friction.slide.bristle_damping_n_s_per_m",
        "100000.0",
        "10 substeps of semi_implicit are unstable above",
    ),
    broken(
        "assist beyond all that the axis may give",
        "limits.toml",
        "assist_max_n = 150.0 ",
        "assist_max_n = 481.0 ",
        "slide.assist_max_n",
        "481",
        "at most slide.force_max_n = 480",
    ),
    broken(
        "a fade faster than assist may change",
        "limits.toml",
        "assist_fade_ms = 200",
        "assist_fade_ms = 99",
        "stop.assist_fade_ms",
        "99",
        "at least 100, the time in which the hip reaches zero at assist_rate_max",
    ),
    broken(
        "setpoints that outlive a silent gateway",
        "limits.toml",
        "setpoint_age_max_cycles = 10",
        "setpoint_age_max_cycles = 30",
        "assist.setpoint_age_max_cycles",
        "30",
        "less than communication.gateway_silence_ms = 300",
    ),
    broken(
        "a lease that ends before its setpoints are stale",
        "demo.toml",
        "duration_ms = 500 ",
        "duration_ms = 99 ",
        "lease.duration_ms",
        "99",
        "at least 100",
    ),
    broken(
        "a longest lease that is shorter than the usual one",
        "demo.toml",
        "duration_max_ms = 5000",
        "duration_max_ms = 499",
        "lease.duration_max_ms",
        "499",
        "at least lease.duration_ms = 500",
    ),
]

MOVING = [
    broken(
        "a limit that the leg never reaches",
        "limits.toml",
        "position_max_m = 0.95",
        "position_max_m = 1.3",
        "slide.position_max_m",
        "1.3",
        "a position that the mechanism reaches",
    ),
    told_of(
        "demo.toml",
        broken(
            "a gait outside the limits",
            "limits.toml",
            "position_max_deg = 40.0",
            "position_max_deg = 33.0",
            "gait.hip.harmonics_deg",
            "(hip -9.735 to 31.97 deg)",
            "-16 to 29 deg",
        ),
    ),
    told_of(
        "demo.toml",
        broken(
            "a gait inside the soft margin",
            "limits.toml",
            "soft_margin_m = 0.015",
            "soft_margin_m = 0.03",
            "gait.knee.harmonics_deg",
            "(slide 0.05269 to 0.931 m)",
            "0.03 to 0.92 m",
        ),
    ),
    broken(
        "a gait that the mechanism cannot do",
        "demo.toml",
        "knee.mean_deg = 22.349",
        "knee.mean_deg = 122.349",
        "gait.knee.harmonics_deg",
        "((-7.272, -21.49)",
        "a gait that the mechanism of",
    ),
    broken(
        "a cadence that asks too much speed",
        "demo.toml",
        "cadence_max_hz = 0.5",
        "cadence_max_hz = 0.9",
        "gait.cadence_max_hz",
        "0.9",
        "<= 0.736, where the leg reaches 3.5 m/s",
    ),
    told_of(
        "demo.toml",
        broken(
            "a ramp too gentle to stop the gait in time",
            "limits.toml",
            "quick_stop_deceleration_m_per_s2 = 15.4",
            "quick_stop_deceleration_m_per_s2 = 5.0",
            "gait.cadence_max_hz",
            "0.5",
            "a cadence whose quick stops stay inside the limits",
        ),
    ),
    broken(
        "a scenario that ends before it begins",
        "demo.toml",
        "start_s = 2.0, end_s = 2.4",
        "start_s = 2.0, end_s = 1.4",
        "excite.open_loop.torque[0].end_s",
        "1.4",
        "> start_s = 2",
    ),
    broken(
        "a part that never plays",
        "demo.toml",
        "duration_max_s = 25.0",
        "duration_max_s = 2.0",
        "excite.open_loop.torque[0].start_s",
        "2.0",
        "< duration_max_s = 2",
    ),
    broken(
        "a sine without a frequency",
        "demo.toml",
        "frequency_hz = 0.3, start_s = 2.4",
        "frequency_hz = 0.0, start_s = 2.4",
        "excite.open_loop.torque[1].frequency_hz",
        "0.0",
        "> 0 for a sine",
    ),
    broken(
        "a scenario's window outside the limits",
        "demo.toml",
        "hip.window_deg = 24.0",
        "hip.window_deg = 35.0",
        "excite.open_loop.hip.window_deg",
        "35",
        "<= 26: from the gait's mean pose",
    ),
    broken(
        "a scenario's torque that would be cut off",
        "demo.toml",
        "amplitude_si = -95.0",
        "amplitude_si = -495.0",
        "excite.open_loop.torque",
        "(slide 495 N)",
        "<= 480 N beside what holds the leg",
    ),
    *(
        broken(name, "demo.toml", old, new, f"self_test.{key}", value, allowed)
        for name, old, new, key, value, allowed in (
            (
                "a self-test of the hip that is too fast for its way",
                "hip.speed_rad_per_s = 0.1 ",
                "hip.speed_rad_per_s = 0.175 ",
                "hip.speed_rad_per_s",
                "0.175",
                "at most 0.174 with hip.motion_deg = 4",
            ),
            (
                "a self-test of the slide that is too fast for its way",
                "slide.speed_m_per_s = 0.05 ",
                "slide.speed_m_per_s = 0.101 ",
                "slide.speed_m_per_s",
                "0.101",
                "at most 0.1 with slide.motion_m = 0.04",
            ),
            (
                "a self-test whose way is too short for its speed",
                "hip.motion_deg = 4.0 ",
                "hip.motion_deg = 1.0 ",
                "hip.speed_rad_per_s",
                "0.1",
                "at most 0.043 with hip.motion_deg = 1",
            ),
        )
    ),
]

BROKEN = ONE_FILE + TOGETHER + MOVING


@pytest.mark.parametrize("row", BROKEN, ids=[row.name for row in BROKEN])
def test_a_broken_configuration_is_refused_by_file_key_value_and_allowed(tmp_path, row):
    demo = changed(copied(tmp_path), row.change)

    with pytest.raises(ConfigError) as refused:
        load(demo)

    line = refused.value.lines
    assert line.startswith(f"configuration error: {demo.parent / row.file}: {row.key} = ")
    assert row.value in refused.value.value
    assert row.allowed in refused.value.allowed
    assert line.count("\n") == len(refused.value.more)


def test_a_gait_near_the_singularity_is_refused(tmp_path):
    demo = changed(
        copied(tmp_path),
        Change("limits.toml", "soft_ratio = 0.3", "soft_ratio = 0.65"),
        Change("limits.toml", "position_max_m = 0.95", "position_max_m = 0.933"),
        Change("limits.toml", "soft_margin_m = 0.015", "soft_margin_m = 0.001"),
    )

    with pytest.raises(ConfigError) as refused:
        load(demo)

    assert refused.value.file == str(demo)
    assert refused.value.key == "gait.knee.harmonics_deg"
    assert refused.value.value == "(|sin| of shank and shoe 0.640)"
    assert refused.value.allowed == ">= singularity.soft_ratio = 0.65"


def test_there_are_more_than_twenty_kinds_of_broken_files():
    assert len({row.name for row in BROKEN}) == len(BROKEN) > 20


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        (
            'state = "../out/demo/state"',
            'state = "/dev/shm/gaitd-demo/state"',
            "paths.state",
            "outside",
        ),
        (
            'runtime = "/dev/shm/gaitd-demo"',
            'runtime = "demo.toml"',
            "paths.runtime",
            "a directory",
        ),
        (
            'runtime = "/dev/shm/gaitd-demo"',
            f'runtime = "../{"long" * 30}"',
            "paths.runtime",
            "bytes, because it holds the sockets of core and gateway",
        ),
    ],
)
def test_a_directory_that_cannot_work_is_refused(tmp_path, old, new, key, allowed):
    demo = changed(copied(tmp_path), Change("demo.toml", old, new))

    with pytest.raises(ConfigError) as refused:
        load(demo)

    assert (refused.value.file, refused.value.key) == (str(demo), key)
    assert allowed in refused.value.allowed


def test_a_trainer_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml: no such file or directory"):
        load(tmp_path / "nowhere.toml")


def test_a_file_that_is_not_text_is_named_with_its_line(tmp_path):
    demo = copied(tmp_path) / "demo.toml"
    demo.write_bytes(b'robot = "robot.toml"\nlimits = "\xff"\n')

    with pytest.raises(ConfigError, match=r"demo\.toml: line 2 = \(not UTF-8\): .*UTF-8"):
        load(demo)


REFUSED_BY_WHAT_IS_SWEPT = {
    "the springs of a patient at the empty machine": (
        Change("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
        Change("robot_empty.toml", "hip.rest_rad = 1.0601", "hip.rest_rad = 2.3132"),
        Change("robot_empty.toml", "slide.rest_m = 1.1442", "slide.rest_m = 1.3247"),
    ),
    "a drive that its EDS denies": (
        Change("drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "generic402.eds"'),
    ),
    "an EDS that is none": (
        Change("drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "hip_epos4.toml"'),
    ),
    "a homing that the springs alone stop": (
        Change("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
        Change("drives/hip_epos4.toml", "effort_max_si = 50.0", "effort_max_si = 40.0"),
    ),
    "a dead core that runs too far": (
        Change("limits.toml", "max_runaway_deg = 70.0", "max_runaway_deg = 50.0"),
    ),
    "a ramp that the torque cannot give": (
        Change("limits.toml", "rad_per_s2 = 14.8", "rad_per_s2 = 200.0"),
    ),
    "an endpoint that other machines can reach": (
        Change("demo.toml", "tcp/127.0.0.1:7447", "tcp/192.168.1.5:7447"),
    ),
}
"""Files that can be loaded: only the judgement refuses them."""

ONE_OF_EACH_FILE = {
    (number, row.file): row
    for number, rows in enumerate((ONE_FILE, TOGETHER, MOVING))
    for row in rows
}
"""One row for each file and stage of the check: `check` and core share the rest of the way."""
REFUSED = REFUSED_BY_WHAT_IS_SWEPT | {row.name: (row.change,) for row in ONE_OF_EACH_FILE.values()}


def ended(monkeypatch, capfd, *words: str) -> tuple[int, str]:
    """How a command line ends, in this process: its exit code and what it says on stderr."""
    monkeypatch.setattr(sys, "argv", ["gaitd", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0), capfd.readouterr().err


@pytest.fixture
def started(monkeypatch) -> list[object]:
    """The settings that a core would have been started with."""
    settings: list[object] = []

    def run_core(*arguments: object, **_: object) -> int:
        settings.append(arguments[0])
        return 0

    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("JOURNAL_STREAM", "")
    monkeypatch.setattr("daemon.core.runtime.process.run_core", run_core)
    monkeypatch.setattr("daemon.ipc.starting.said", lambda _: nullcontext(lambda: None))
    monkeypatch.setattr("daemon.system.lock.hold", lambda *_: nullcontext())
    return settings


@pytest.mark.parametrize("name", REFUSED)
def test_the_core_refuses_what_check_refuses_with_the_same_text(
    tmp_path, monkeypatch, capfd, started, name
):
    demo = str(changed(copied(tmp_path), *REFUSED[name]))

    checked = ended(monkeypatch, capfd, "check", "--config", demo)
    core = ended(monkeypatch, capfd, "core", "--config", demo)

    assert core == checked
    assert core[0] == 2
    assert all(line.startswith("configuration error: ") for line in core[1].splitlines())
    assert not started


@pytest.mark.parametrize("trainer", ["demo", "trainer", "two_legs", "vcan"])
def test_the_core_starts_with_every_shipped_configuration(monkeypatch, capfd, started, trainer):
    config = str(CONFIGS / f"{trainer}.toml")

    assert ended(monkeypatch, capfd, "check", "--config", config) == (0, "")
    assert ended(monkeypatch, capfd, "core", "--config", config) == (0, "")
    assert len(started) == 1


@pytest.mark.parametrize(("name", "key"), [("run", "paths.runtime"), ("state", "paths.state")])
def test_a_directory_that_another_core_holds_is_refused_before_the_files_are_checked(
    tmp_path, monkeypatch, capfd, name, key
):
    demo = changed(
        copied(tmp_path),
        Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{tmp_path}/run"'),
        Change("demo.toml", '"../out/demo/state"', f'"{tmp_path}/state"'),
    )
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setattr("daemon.preflight.acceptance.accepted", lambda _: pytest.fail("checked"))

    with hold(demo, key, tmp_path / name, "core"):
        code, said = ended(monkeypatch, capfd, "core", "--config", str(demo))

    assert (code, f"{key} = " in said, "a gaitd core with pid" in said) == (2, True, True)


def run_of(tmp_path, endpoint, *changes):
    """`gaitd run` of the demonstration's files with these changes, until it ends by itself."""
    with TemporaryDirectory(dir="/dev/shm") as folder:  # the sockets' path must be short
        demo = changed(
            copied(tmp_path),
            *changes,
            Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{folder}/run"'),
            Change("demo.toml", '"../out/demo/state"', f'"{tmp_path}/state"'),
            Change("demo.toml", "tcp/127.0.0.1:7447", endpoint or f"unixsock-stream/{folder}/z"),
        )
        run = subprocess.run(
            [sys.executable, "-m", "gaitd", "run", "--config", str(demo)],
            capture_output=True,
            text=True,
            check=False,
        )
        return demo, run


def test_run_ends_with_the_refusal_of_its_core(tmp_path):
    demo, run = run_of(tmp_path, "", *REFUSED_BY_WHAT_IS_SWEPT["an EDS that is none"])

    assert run.returncode == 2
    starting, refused = run.stderr.splitlines()
    assert starting.startswith("gaitd: starting")
    assert refused.startswith(f"configuration error: {demo.parent / 'drives/hip_epos4.toml'}: eds")


def test_run_ends_with_a_configuration_error_where_another_program_has_the_port(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        _, run = run_of(tmp_path, endpoint)

    assert run.returncode == 2
    assert f"gaitd gateway: cannot listen on {endpoint}" in run.stderr
