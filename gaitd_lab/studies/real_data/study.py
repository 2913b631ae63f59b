"""The report of `gaitd real-data`: a recorded servo axis, and strides with a measured patient."""

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from daemon.config.settings import Robot
from gaitd_lab.studies.real_data import emps, hip_moment, strides
from gaitd_lab.studies.real_data.comparison import CALIBRATED, Comparison, compare
from gaitd_lab.studies.real_data.figures import draw_axis, draw_speed
from gaitd_lab.studies.real_data.judgement import Score
from gaitd_lab.studies.real_data.measured_patient import CADENCES_HZ, record
from gaitd_lab.studies.report import Cell, Report, Table

HEAD: Final = (
    *("estimator", "no pulses, N", "pulses left in, N", "as disturbance, N", "50 ms, N"),
    *("reversals, N", "3σ", "3σ, reversals", "σ, N", "NIS", "NIS, pulses left in", "NIS ≤ 3.84"),
    *("50 %, ms", "90 %, ms", "with edges, N", "× gaitd"),
)


def study(
    recordings: Path, robot: Robot, config: Path, stage: Callable[[str], Callable[..., Any]]
) -> Report:
    """Judge the observer on both recordings.

    Args:
        recordings: folder with emps/ and gait_falisse/.
        robot: of the empty machine.
        config: trainer file of the virtual trainer that walks with the measured patient.
        stage: begins a stage of the work by its title; returns what is called with its progress.

    Raises:
        OSError: a file cannot be opened.
        RecordingError: a file is none of the data sets'.
        TrialError: the service refused a gait.
    """
    records = emps.read(recordings / "emps")
    moment = hip_moment.read(recordings / "gait_falisse" / hip_moment.FILE)
    update = stage("calibrating")
    found = compare(records, robot, lambda _, share: update(share))
    with TemporaryDirectory() as folder:
        file = Path(folder) / "moment.csv"
        hip_moment.write(moment, file)
        walked = [
            strides.row(cadence_hz, [*map(strides.judged, record(config, file, cadence_hz, stage))])
            for cadence_hz in CADENCES_HZ
        ]
    tables = (
        axis_table(found),
        Table("Calibrated on the record without pulses", ("", "", "published"), [*_found(found)]),
        Table("Strides of a patient with a measured hip moment", strides.HEAD, walked),
    )
    figures = {"slide": draw_axis(found), "speed": draw_speed(found)}
    return Report("real_data", "The observer on recordings of real machines", tables, figures)


def axis_table(found: Comparison) -> Table:
    """Return one row for each estimator, on the recorded axis."""
    reference = found.scores[CALIBRATED][-1].false_n
    rows = [_row(name, scores, reference) for name, scores in found.scores.items()]
    return Table("Rms error of the external force on the recorded axis", HEAD, rows)


def _row(name: str, scores: tuple[Score, ...], reference: float) -> tuple[Cell, ...]:
    clean, left_in, disturbed = scores
    return (
        name,
        clean.whole_n,
        left_in.whole_n,
        disturbed.false_n,
        disturbed.early_n,
        disturbed.slow_n,
        disturbed.covered_ratio,
        disturbed.slow_covered_ratio,
        disturbed.sigma_n,
        disturbed.nis,
        left_in.nis,
        disturbed.nis_usual_ratio,
        1e3 * disturbed.half_s,
        1e3 * disturbed.ninety_s,
        disturbed.whole_n,
        disturbed.false_n / reference,
    )


def _found(found: Comparison) -> Iterator[tuple[Cell, ...]]:
    values = {
        one.quantity.label: one.value for one in found.calibration.fit.results if one.calibrated
    }
    noise, observer = found.calibration.process_noise, found.calibration.robot.observer
    velocity_um = 1e6 * noise["slide.process_velocity_m_per_s"]
    yield "Coulomb friction, N", values["slide coulomb"], emps.PUBLISHED_COULOMB_N
    yield "viscous friction, N s/m", values["slide viscous"], emps.PUBLISHED_VISCOUS_N_S_PER_M
    yield "mass, kg", values["slide drive mass"], emps.PUBLISHED_MASS_KG
    yield "constant force, N", found.offset_n, emps.PUBLISHED_OFFSET_N
    yield "encoder noise, µm", 1e6 * values["slide encoder noise"], None
    yield "process noise of velocity, µm/s a step", velocity_um, None
    yield "process noise of friction, N a step", noise["slide.process_friction_n"], None
    yield "error of the friction law at standstill, N", observer.slide.law_n, None
    for name, bandwidth in found.bandwidths.items():
        least_n = min(error_n for _, error_n in found.trade[name])
        yield f"{name}: bandwidth, rad/s", bandwidth, None
        yield f"{name}: least error at any bandwidth, N", least_n, None
