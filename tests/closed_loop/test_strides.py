"""Strides through CAN frames: the patient's work beside the true one, once for each stride."""

import numpy as np
import pytest

from observer.smoother import LAG


def pushed(session, seconds):
    session.command("patient active")
    session.run(seconds)
    return session


def strides_of(session, leg=0):
    return [
        (index, record.legs[leg].stride)
        for index, record in enumerate(session.records)
        if record.legs and record.legs[leg].stride is not None
    ]


def true_work(session, index, stride):
    """Work of the plant's patient with the motion, over the samples of the stride."""
    records = session.records[index - LAG - stride.sample_count : index - LAG]
    rows = {row.sync_mono_ns: row for row in session.truth.rows}
    truth = [rows[record.sync_mono_ns] for record in records]
    hip = [row.hip_patient_nm * row.hip_velocity_rad_per_s for row in truth]
    slide = [row.slide_patient_n * row.slide_velocity_m_per_s for row in truth]
    return np.sum(np.maximum((hip, slide), 0.0), axis=1) * 0.01


def test_strides_are_as_long_as_the_gait_says_and_their_work_is_right_within_two_percent(
    warm_fast_gait,
):
    session = pushed(warm_fast_gait, 8.0)

    found = strides_of(session)
    assert [stride.number for _, stride in found] == list(range(1, len(found) + 1))
    assert len(found) >= 3
    for index, stride in found[2:]:
        hip_j, slide_j = true_work(session, index, stride)
        assert stride.hip.work_positive_j == pytest.approx(hip_j, rel=0.02)
        assert stride.slide.work_positive_j == pytest.approx(slide_j, rel=0.02)
        assert stride.duration_s == pytest.approx(2.0, rel=0.03)
        assert stride.hip.coverage_ratio > 0.75
        assert stride.slide.coverage_ratio > 0.95
