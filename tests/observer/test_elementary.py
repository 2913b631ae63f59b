"""The branch-free functions against the C library's, within two units in the last place."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.mechanism.elementary import cos_sin, expm1_of_negative, tanh

RANDOM = np.random.default_rng(11)


def in_last_places(ours, theirs):
    return abs(ours - theirs) / np.spacing(abs(theirs))


def test_expm1_is_exact_to_two_last_places_over_three_hundred_magnitudes():
    for x in -(10.0 ** RANDOM.uniform(-300.0, 2.8, 20_000)):
        assert in_last_places(expm1_of_negative(x), math.expm1(x)) <= 2.0


@pytest.mark.parametrize(("x", "value"), [(0.0, 0.0), (-1e6, -1.0), (-1e300, -1.0)])
def test_expm1_is_exact_at_its_ends(x, value):
    assert expm1_of_negative(x) == value


def test_tanh_is_exact_to_four_last_places():
    for x in 10.0 ** RANDOM.uniform(-300.0, 2.5, 20_000):
        assert in_last_places(tanh(x), math.tanh(x)) <= 4.0


@given(x=st.floats(allow_nan=False, allow_infinity=False))
@settings(derandomize=True, deadline=None)
def test_tanh_is_odd_and_bounded(x):
    assert tanh(-x) == -tanh(x)
    assert abs(tanh(x)) <= 1.0


def test_cosine_and_sine_are_exact_to_one_last_place_of_one():
    for angle in RANDOM.uniform(-2000.0, 2000.0, 20_000):
        cosine, sine = cos_sin(angle)

        assert cosine == pytest.approx(math.cos(angle), abs=2.3e-16)
        assert sine == pytest.approx(math.sin(angle), abs=2.3e-16)


def test_the_first_turn_is_exact_to_two_last_places_of_each():
    for angle in RANDOM.uniform(-math.pi, math.pi, 20_000):
        cosine, sine = cos_sin(angle)

        assert in_last_places(cosine, math.cos(angle)) <= 2.0
        assert in_last_places(sine, math.sin(angle)) <= 2.0
