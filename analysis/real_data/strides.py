"""Strides of a trial beside the truth: the patient's work and share at the hip."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from analysis import markdown
from analysis.replay import Source, columns_of, estimate_smoothed
from analysis.trial import Trial
from observer.filter.states import PATIENT, VELOCITY
from observer.strides import strides_of

SIGMAS: Final = 3.0
BEGIN_STRIDES: Final = 2
"""First strides, in which the patient's script begins to follow the gait."""
HEAD: Final = (
    *("cadence", "seeds", "strides", "true work, J", "work error", "worst", "3σ covers"),
    *("against, J", "error, J", "true share", "share error", "worst share", "correlation"),
)


class JudgedStride(NamedTuple):
    """Hip of one stride, found and true; sigma is the observer's own."""

    work_j: float
    work_std_j: float
    true_work_j: float
    against_j: float
    true_against_j: float
    share_ratio: float
    true_share_ratio: float


def judged(trial: Trial) -> list[JudgedStride]:
    """Compare the strides of a trial, from the third one on, with the truth of all their samples.

    A share is None on the wire where there is hardly any work; it is NaN here.
    """
    source = Source(trial.recording, None, "", None)
    found = strides_of(estimate_smoothed(source, trial.robot), columns_of(source))
    steps_s = np.diff(trial.recording.time_s, prepend=trial.recording.time_s[0])
    made: list[JudgedStride] = []
    for begin, stride in found[BEGIN_STRIDES:]:
        rows = slice(begin, begin + stride.sample_count)
        way = trial.truth[rows, VELOCITY][:, 0] * steps_s[rows]
        patient_j = trial.truth[rows, PATIENT][:, 0] * way
        drive_j = float(np.sum(np.maximum(trial.recording.effort[rows, 0] * way, 0.0)))
        true_j = float(np.sum(np.maximum(patient_j, 0.0)))
        share = stride.hip.share_ratio
        made.append(
            JudgedStride(
                stride.hip.work_positive_j,
                stride.hip.work_positive_j_std,
                true_j,
                stride.hip.work_negative_j,
                float(np.sum(np.minimum(patient_j, 0.0))),
                math.nan if share is None else share,
                true_j / (true_j + drive_j),
            )
        )
    return made


def row(cadence_hz: float, seeds: Sequence[Sequence[JudgedStride]]) -> tuple[str, ...]:
    """One row of the table, over the strides of all seeds."""
    table = np.array([stride for one in seeds for stride in one])
    work, std, true, against, true_against, share, true_share = table.T
    error, share_error = work / true - 1.0, 100.0 * (share - true_share)
    return (
        f"{cadence_hz:g} Hz",
        str(len(seeds)),
        str(len(table)),
        f"{true.min():.1f} to {true.max():.1f}",
        f"{100.0 * error.mean():+.1f} ± {100.0 * error.std():.1f} %",
        f"{100.0 * error[np.argmax(np.abs(error))]:+.1f} %",
        f"{100.0 * np.mean(np.abs(work - true) <= SIGMAS * std):.0f} %",
        f"{true_against.min():.1f} to {true_against.max():.1f}",
        f"{np.mean(against - true_against):+.2f} ± {np.std(against - true_against):.2f}",
        f"{100.0 * true_share.min():.0f} to {100.0 * true_share.max():.0f} %",
        f"{np.nanmean(share_error):+.1f} ± {np.nanstd(share_error):.1f} points",
        f"{share_error[np.nanargmax(np.abs(share_error))]:+.1f} points",
        f"{np.corrcoef(work, true)[0, 1]:.3f}",
    )


TEXT: Final = """## A patient with a measured hip moment

A. Falisse and others (J. R. Soc. Interface 16 (2019) 20190402, data under the MIT licence)
measured 11 strides of a walking person; the folder `gait_falisse` of the recordings has their
`ExperimentalData.mat`. The hip moment of each stride in turn, over the phase of the hip, is what
the patient of the virtual trainer exerts here, scaled so that the largest is {hip_nm:g} N·m: its
shape is a person's, its size is that of a patient in this trainer, and strides differ as much as
that person's. The work and share that the observer finds are judged against the plant's.

{table}

Hip, from the third stride on: work with the motion, then against it. Errors are mean ± standard
deviation over all strides, and the worst stride. The truth has all samples of a stride, the
observer's figures those in which patient and friction can be separated: part of what is missing
are samples near reversals. The last column is the correlation of found and true work over the
strides. Seeds differ in the noise of the sensors and the delays of the drives.

`gaitd real-data RECORDINGS --patient moment.csv` writes the file of this patient. In plant.toml

```toml
[[patient.programme]]
name = "measured"

[[patient.programme.effort]]
kind = "recorded"
file = "moment.csv"                    # relative to plant.toml
at_s = 0.0
until_s = 86400.0
rise_s = 1.0
fall_s = 1.0
hip_nm = 10.0                          # the largest of the file; it keeps the file's shape
slide_n = 0.0                          # the same, where the file has slide_force_n
```

makes a patient of it, and `gaitd sim patient measured` starts it. Any CSV file will do that has the
columns `stride_index` (the same in all rows of a stride), `stride_ratio` (0 to 1 over a stride),
`hip_angle_rad` (of which only the phase is used), `hip_torque_nm`, and where there is one
`slide_force_n`: 1 to 16 strides of 20 rows or more.
"""


def section(hip_nm: float, rows: Sequence[tuple[str, ...]]) -> str:
    """Part of the page."""
    return TEXT.format(hip_nm=hip_nm, table=markdown.table(HEAD, rows, 1))
