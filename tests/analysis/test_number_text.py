"""The compiled writer gives the bytes that Python's own formatting gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.number_text import csv_bytes

doubles = st.floats(allow_infinity=True, allow_nan=True)
everyday = st.floats(-1e3, 1e3)
ties = st.builds(
    lambda digits, shift: (digits + 0.5) / 2.0**shift,
    st.integers(0, 10**9),
    st.integers(0, 30),
)
decimals = st.builds(lambda whole, power: whole * 10.0**power, st.integers(), st.integers(-12, 3))
times = st.one_of(
    st.integers(0, 10**6).map(lambda row: row * 0.01),
    st.integers(0, 10**6).map(lambda row: 1.7e9 + row / 100),
    st.floats(allow_infinity=False, allow_nan=False),
)


def as_python_writes(time: float, numbers: list[float], status: int) -> str:
    cells = ["" if np.isnan(value) else f"{value:.9g}" for value in numbers]
    return ",".join([repr(time), *cells, f"0x{status:04x}"]) + "\n"


@settings(derandomize=True, max_examples=300, deadline=None)
@given(
    times,
    st.lists(st.one_of(doubles, everyday, ties, decimals), min_size=3, max_size=3),
    st.integers(0, 2**40),
)
def test_every_number_is_written_as_python_writes_it(time, numbers, status):
    written = csv_bytes(np.array([time]), np.array([numbers]), np.array([status]))

    assert written.decode() == as_python_writes(time, numbers, status)


def test_a_hundred_thousand_numbers_of_every_size_are_written_as_python_writes_them():
    draw = np.random.default_rng(11)
    numbers = draw.normal(size=(5000, 20)) * 10.0 ** draw.uniform(-15, 11, size=(5000, 20))
    numbers[::7] = np.round(numbers[::7], 2)
    numbers[::11, ::3] = np.nan
    time_s = np.arange(5000) * 0.01 + 1.7e9 * (np.arange(5000) > 2500)
    status = draw.integers(0, 2**17, size=5000)

    written = csv_bytes(time_s, numbers, status).decode()

    rows = zip(time_s.tolist(), numbers.tolist(), status.tolist(), strict=True)
    assert written == "".join(as_python_writes(*row) for row in rows)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "-0"),
        (0.0001, "0.0001"),
        (9.999999999e-5, "0.0001"),
        (1e-5, "1e-05"),
        (-1.25e-13, "-1.25e-13"),
        (9.9999999996e-14, "1e-13"),
        (999999999.5, "1e+09"),
        (123456789.0, "123456789"),
        (0.9999999999, "1"),
        (100.0, "100"),
        (2.5, "2.5"),
        (np.nan, ""),
    ],
)
def test_numbers_at_the_edges_of_their_notations(value, text):
    written = csv_bytes(np.zeros(1), np.array([[value]]), np.zeros(1, dtype=np.int64))

    assert written.decode() == f"0.0,{text},0x0000\n"


def test_no_rows_are_no_bytes():
    assert csv_bytes(np.empty(0), np.empty((0, 3)), np.empty(0, dtype=np.int64)) == b""
