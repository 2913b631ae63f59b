"""docs/csv_columns.md: the columns of every CSV file, by the names that its writer uses.

A column without a text is an error of `make tables`. Written by `make tables`.
"""

from collections.abc import Sequence
from typing import Final

from analysis import estimates, markdown, recording, stop_tables, stride_table
from observer.filter.status import Status
from sim_drives.plant.truth import TruthRow

TEXTS: Final = {
    "time_s": "time of the sample; `gaitd sim`: since the first row",
    "hip_angle_rad": "hip angle",
    "slide_position_m": "slide position",
    "hip_torque_nm": "torque of the drive at the joint, mean from the row before to this one",
    "slide_force_n": "force of the drive along the rail, mean from the row before to this one",
    "hip_velocity_rad_per_s": "speed of the hip angle",
    "slide_velocity_m_per_s": "speed of the slide",
    "hip_friction_nm": "friction, positive against positive speed",
    "slide_friction_n": "friction, positive against positive speed",
    "hip_patient_nm": "effort of the patient, positive towards a larger angle",
    "slide_patient_n": "effort of the patient, positive towards a larger position",
    "hip_net_nm": "patient minus friction; known at rest, too",
    "slide_net_n": "patient minus friction; known at rest, too",
    "nis": "normalised innovation squared: 2 on average for a consistent filter",
    "status": "bits, hexadecimal: below",
    "from_stop_s": "time from the stop; negative before it",
    "mode": "mode of the service",
    "category": "stop category in force: none, S2, S1, S0",
    "cause": "cause of the stop in force",
    "hip_contact_nm": "effort of end stops and of a blocked axis",
    "slide_contact_n": "effort of end stops and of a blocked axis",
    "hip_sticking": "1: friction holds the axis",
    "slide_sticking": "1: friction holds the axis",
    "sync_count": "number of the SYNC",
    "sync_mono_ns": "time of the SYNC on the clock of the drives",
    "programme": "what the virtual patient does",
    "number": "number of the stride in the recording, from 1",
    "begin_s": "time of the stride's begin",
    "duration_s": "duration of the stride",
    "cadence_hz": "strides per second; in an export of a session the requested ones",
    "sample_count": "samples of the stride",
    "work_positive_j": "the patient's work with the motion",
    "work_negative_j": "the patient's work against the motion, 0 or less",
    "assist_mean_nm": "torque signed by the direction of motion, mean over known samples",
    "assist_mean_n": "force signed by the direction of motion, mean over known samples",
    "assist_peak_nm": "the largest in size, with its sign",
    "assist_peak_n": "the largest in size, with its sign",
    "power_mean_w": "net work over duration",
    "power_peak_w": "the largest power in size, with its sign",
    "share_ratio": "the patient's positive work over that of patient and drive together",
    "coverage_ratio": "share of the time in which the patient was known",
    "baseline_subtracted": "1: the passive baseline is subtracted",
    "profile": "id of the patient's profile",
    "session": "number of the session in this history",
    "begun_utc_ns": "begin of the session, ns since 1970",
    "block": "number of the block in the plan",
    "kind": "warm_up or block",
    "amplitude_ratio": "requested amplitude, 0 to 1",
    "leg": "right or left",
    "end_utc_ns": "end of the stride, ns since 1970",
    "is_valid": "1: counts for the goal",
    "band_middle_ratio": "middle of the target band of the share",
}
"""Meaning of a column; axis and `_std` are taken off its name where it has no text of its own."""


def page(exported: Sequence[str]) -> str:
    """Return docs/csv_columns.md; `exported` are the columns of `gaitd-session export`."""
    read = recording.COLUMNS
    bits = [(f"`0x{bit.value:04x}`", bit.name or "") for bit in Status]
    return markdown.page(
        "# Columns of CSV files",
        "Written by `make tables` from the names that the writers use. A unit is the end of a name;"
        " a column `..._std` is one standard deviation of the one before. Columns are found by"
        " name, in any order; an empty cell is a number that is not known. Decimal point, comma"
        " between cells, UTF-8.",
        "## Recording: input of `gaitd replay`, `calibrate`, `delay` and `baseline`",
        "`gaitd blackbox show --csv` and the truth of `gaitd sim` have these columns, too, so each"
        " is a recording. Others are ignored.",
        _table(read),
        "## Estimates: `gaitd replay --output`",
        _table(estimates.COLUMNS),
        "### Bits of `status`",
        markdown.table(("bit", "name"), bits),
        "## Strides: `gaitd replay --strides`",
        "One row for each stride, explained in [strides.md](strides.md).",
        _table(stride_table.columns()),
        "## A stop: `gaitd blackbox show --csv`",
        _table((*read, *stop_tables.MORE_COLUMNS)),
        "## Truth of the virtual machine: `gaitd sim --truth`",
        "One row for each SYNC.",
        _table(TruthRow._fields),
        "## History of training: `gaitd-session export`",
        "One row for each stride.",
        _table(exported),
    )


def _table(columns: Sequence[str]) -> str:
    names = [name for name in columns if not name.endswith("_std")]
    rows = [(f"`{name}`" + _std(name, columns), text_of(name)) for name in names]
    return markdown.table(("column", "meaning"), rows)


def _std(name: str, columns: Sequence[str]) -> str:
    return f", `{name}_std`" if f"{name}_std" in columns else ""


def text_of(column: str) -> str:
    """Meaning of a column.

    Raises:
        KeyError: it has none; add it to TEXTS.
    """
    if column in TEXTS:
        return TEXTS[column]
    return TEXTS[column.removeprefix("hip_").removeprefix("slide_")]
