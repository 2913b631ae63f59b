"""What an estimator sees in each situation, and the true external force."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.motion import REST
from analysis.recording import Recording
from analysis.replay import Source
from gaitd_lab.studies.real_data.emps import Record

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]

START_S: Final = 0.5
"""Excluded time: the estimators have just begun."""


class Situation(NamedTuple):
    """A recording as seen, and the truth about it."""

    name: str
    source: Source
    """Efforts as the drive reports them, less the artificial disturbance."""
    truth_n: Values
    """Shape (n,): the external force."""
    edges_s: Values
    """Times at which the force of the drive or the external force steps."""

    @property
    def position_m(self) -> Values:
        """Shape (n,)."""
        return self.source.recording.position[:, 1]

    @property
    def force_n(self) -> Values:
        """Shape (n,)."""
        return self.source.recording.effort[:, 1]

    @property
    def velocity(self) -> Values:
        """Shape (n,), m/s: central differences, which no estimator has."""
        return np.gradient(self.position_m, self.source.recording.time_s)

    def moving(self) -> Flags:
        """Mark where the axis moves, after the start."""
        return self._begun() & (np.abs(self.velocity) > 2.0 * REST[1])

    def slow(self) -> Flags:
        """Mark where it rests or reverses, after the start."""
        return self._begun() & (np.abs(self.velocity) <= 2.0 * REST[1])

    def _begun(self) -> Flags:
        return self.source.recording.time_s >= START_S

    def beyond(self, after_s: float, before_s: float = 0.0) -> Flags:
        """Mark the rows at least so long after the last edge, and before the next one."""
        time_s = self.source.recording.time_s
        edges_s = np.concatenate(([-np.inf], self.edges_s, [np.inf]))
        following = np.searchsorted(edges_s, time_s, side="right")
        since_s, left_s = time_s - edges_s[following - 1], edges_s[following] - time_s
        return (since_s >= after_s) & (left_s >= before_s)


def clean(record: Record, offset_n: float) -> Situation:
    """A record as it is: no external force; pulses, if any, are in the seen effort.

    Args:
        record: of the benchmark.
        offset_n: constant force that the drive's command contains, taken off.
    """
    name = "pulses left in the force" if np.any(record.pulses_n) else "no pulses"
    return _situation(name, record, np.zeros(len(record.pulses_n)), offset_n)


def disturbed(record: Record, offset_n: float) -> Situation:
    """The paper's artificial disturbance: the seen effort lacks the pulses, which act."""
    return _situation("pulses as a disturbance", record, record.pulses_n, offset_n)


def _situation(name: str, record: Record, truth_n: Values, offset_n: float) -> Situation:
    made = record.recording
    effort = made.effort.copy()
    effort[:, 1] -= offset_n + truth_n
    seen = Recording(made.source, made.time_s, made.position, effort)
    return Situation(name, Source(seen, None, "", None), truth_n, record.edges_s)
