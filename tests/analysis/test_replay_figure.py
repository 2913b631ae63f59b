import numpy as np
import pytest

from analysis.drawing import BUCKETS, extremes
from analysis.recording import Recording
from analysis.replay_figure import _with_gaps, draw
from observer.offline.batch import BatchEstimates


def made(time_s: np.ndarray) -> tuple[Recording, BatchEstimates]:
    count = len(time_s)
    pair, eight = np.ones((count, 2)), np.ones((count, 8))
    flags = np.ones((count, 2), dtype=np.int64)
    estimates = BatchEstimates(
        eight,
        eight,
        np.ones((count, 36)),
        pair,
        np.ones(count),
        pair,
        pair,
        flags[:, 0],
        flags,
        pair,
    )
    return Recording("a.csv", time_s, pair, pair), estimates


@pytest.mark.parametrize("rows", [300, 20 * BUCKETS], ids=["short", "long"])
def test_no_line_leads_across_rows_that_are_missing(rows):
    time_s = np.arange(rows) * 0.01
    time_s[rows // 2 :] += 20.0

    recording, estimates = _with_gaps(*made(time_s))
    shown_s, values = extremes(recording.time_s, estimates.state[:, 0])

    inside = (shown_s > time_s[rows // 2 - 1]) & (shown_s < time_s[rows // 2])
    assert np.isnan(values[inside]).any()
    assert (np.diff(recording.time_s) > 0).all()


def test_without_gaps_nothing_is_changed():
    recording, estimates = made(np.arange(50) * 0.01)

    shown, same = _with_gaps(recording, estimates)

    assert np.array_equal(shown.time_s, recording.time_s)
    assert np.array_equal(same.state, estimates.state)


def test_a_recording_of_one_row_can_be_drawn(tmp_path):
    draw(*made(np.arange(1) * 0.01), tmp_path / "a.png")

    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
