import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.accuracy import nearest, score

times = st.lists(st.integers(0, 10**9), max_size=30)


@settings(derandomize=True, deadline=None)
@given(times, times, st.integers(0, 10**8))
def test_the_nearest_sample_is_taken_or_none(wanted, offered, tolerance):
    offered = sorted(set(offered))

    index = nearest(np.array(wanted, np.int64), np.array(offered, np.int64), tolerance)

    for time, found in zip(wanted, index, strict=True):
        distance = min((abs(time - one) for one in offered), default=math.inf)
        if distance <= tolerance:
            assert abs(offered[found] - time) == distance
        else:
            assert found == -1


def test_an_estimate_that_is_the_truth_scores_perfectly():
    truth = np.sin(np.linspace(0, 6, 100))

    found = score(truth.copy(), truth)

    assert found.rms == 0.0
    assert found.worst == 0.0
    assert found.correlation == pytest.approx(1.0)
    assert found.covered_ratio == 1.0


def test_a_sample_without_an_estimate_counts_against_coverage_alone():
    truth = np.ones(10)
    estimate = np.ones(10) + 0.5
    estimate[:4] = np.nan

    found = score(estimate, truth)

    assert found.sample_count == 6
    assert found.covered_ratio == 0.6
    assert found.rms == pytest.approx(0.5)
    assert found.bias == pytest.approx(0.5)
    assert math.isnan(found.correlation)


def test_nothing_to_compare_is_nan_and_not_zero():
    found = score(np.full(3, np.nan), np.zeros(3))

    assert found.sample_count == 0
    assert math.isnan(found.rms)
    assert math.isnan(found.worst)


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(-100, 100), min_size=3, max_size=50), st.floats(-5, 5))
def test_a_constant_error_is_bias_rms_and_worst_at_once(values, error):
    truth = np.array(values)

    found = score(truth + error, truth)

    assert found.rms == pytest.approx(abs(error), abs=1e-9)
    assert found.bias == pytest.approx(error, abs=1e-9)
    assert found.worst == pytest.approx(abs(error), abs=1e-9)
