"""Tables of numbers as CSV text, compiled: the bytes that `%.9g` and `repr` would give.

A double times a power of ten up to 1e22 is two doubles exactly (Dekker 1971), so the ninth digit is
rounded exactly, ties to the even digit as in C's printf. A time that is a decimal of at most
fifteen digits is its own shortest text. Other numbers (very large, very small, a time with sixteen
digits) are rare, and Python formats them.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.jit import inline, kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

DIGITS: Final = 9
POWERS: Final = np.array([float(f"1e{power}") for power in range(23)])
"""Powers of ten that a double holds exactly."""
WHOLE_POWERS: Final = 10 ** np.arange(19, dtype=np.int64)
SMALLEST: Final = 1e-13
"""Times 1e22 the number still has nine digits before the point."""
LARGEST: Final = 999_999_999.0
TIME_DECIMALS: Final = 6
TIME_SMALLEST: Final = 1e-4
"""Below it `repr` writes an exponent."""
TIME_LARGEST: Final = 9e8
"""Times 1e6 the number has fifteen digits; up to there doubles distinguish all decimals."""
EPOCH_DECIMALS: Final = 5
EPOCH_LARGEST: Final = 9e9
CELL_BYTES: Final = 26
"""Maximum length of a cell, including its comma."""
SPLITTER: Final = 134217729.0
COMMA, NEWLINE, POINT, MINUS, ZERO = b",\n.-0"
LETTER_A, LETTER_E, LETTER_X = b"aex"


def csv_bytes(time_s: Floats, numbers: Floats, status: Integers) -> bytes:
    """Rows of CSV, each ended by a newline.

    Args:
        time_s: shape (n,), finite; written as `repr` writes it.
        numbers: shape (n, m); written as `%.9g` writes them, NaN as nothing.
        status: shape (n,), not negative; written as `0x%04x`.
    """
    numbers = np.ascontiguousarray(numbers, dtype=np.float64)
    times = np.ascontiguousarray(time_s, dtype=np.float64)
    hard_times, hard_numbers = _hard(times, numbers)
    texts, ends = _texts(times[hard_times], numbers[hard_numbers[:, 0], hard_numbers[:, 1]])
    room = numbers.shape[0] * (numbers.shape[1] + 2) * CELL_BYTES
    out = np.empty(room, dtype=np.uint8)
    bits = np.ascontiguousarray(status, dtype=np.int64)
    return out[: _fill(out, times, numbers, bits, texts, ends)].tobytes()


def _texts(times: Floats, numbers: Floats) -> tuple[Bytes, Integers]:
    """Format with Python: all texts joined, and where each ends."""
    texts = [repr(value) for value in times.tolist()]
    texts += [f"{value:.{DIGITS}g}" for value in numbers.tolist()]
    ends = np.cumsum(np.array([0, *map(len, texts)], dtype=np.int64))
    return np.frombuffer("".join(texts).encode("ascii"), dtype=np.uint8), ends


@inline
def _time_decimals(time: float) -> int:
    """Number of decimals that give the time exactly; -1 if Python must format it."""
    size = abs(time)
    if not (TIME_SMALLEST <= size < EPOCH_LARGEST):
        return -1
    decimals = TIME_DECIMALS if size < TIME_LARGEST else EPOCH_DECIMALS
    return decimals if np.rint(size * POWERS[decimals]) / POWERS[decimals] == size else -1


@inline
def _is_hard(value: float) -> bool:
    size = abs(value)
    return size != 0.0 and not np.isnan(size) and not (SMALLEST <= size < LARGEST)


@kernel
def _hard(times: Floats, numbers: Floats) -> tuple[Integers, Integers]:
    """Rows of the times, and row and column of the numbers, that Python must format."""
    hard_times = np.empty(times.size, dtype=np.int64)
    time_count = 0
    count = 0
    for row in range(times.size):
        if _time_decimals(times[row]) < 0:
            hard_times[time_count] = row
            time_count += 1
        for column in range(numbers.shape[1]):
            count += _is_hard(numbers[row, column])
    places = np.empty((count, 2), dtype=np.int64)
    count = 0
    for row in range(times.size):
        for column in range(numbers.shape[1]):
            if _is_hard(numbers[row, column]):
                places[count, 0] = row
                places[count, 1] = column
                count += 1
    return hard_times[:time_count], places


@kernel
def _fill(
    out: Bytes, times: Floats, numbers: Floats, status: Integers, texts: Bytes, ends: Integers
) -> int:
    """Write all rows; return the number of bytes."""
    digits = np.empty(20, dtype=np.uint8)
    at = 0
    hard_time = 0
    hard_number = 0  # their texts follow those of all times
    for row in range(times.size):
        hard_number += _time_decimals(times[row]) < 0
    for row in range(times.size):
        decimals = _time_decimals(times[row])
        if decimals < 0:
            at = _copy(out, at, texts, ends[hard_time], ends[hard_time + 1])
            hard_time += 1
        else:
            at = _write_time(out, at, times[row], decimals, digits)
        for column in range(numbers.shape[1]):
            out[at] = COMMA
            value = numbers[row, column]
            if _is_hard(value):
                at = _copy(out, at + 1, texts, ends[hard_number], ends[hard_number + 1])
                hard_number += 1
            else:
                at = _write_number(out, at + 1, value, digits)
        at = _write_status(out, at, status[row])
    return at


@inline
def _copy(out: Bytes, at: int, texts: Bytes, begin: int, end: int) -> int:
    for index in range(begin, end):
        out[at] = texts[index]
        at += 1
    return at


@inline
def _sign(out: Bytes, at: int, value: float) -> int:
    if np.copysign(1.0, value) < 0:
        out[at] = MINUS
        at += 1
    return at


@inline
def _write_time(out: Bytes, at: int, time: float, decimals: int, digits: Bytes) -> int:
    at = _sign(out, at, time)
    units = int(np.rint(abs(time) * POWERS[decimals]))
    whole = units // WHOLE_POWERS[decimals]
    part = units - whole * WHOLE_POWERS[decimals]
    count = 0
    while whole > 0 or count == 0:
        digits[count] = whole % 10
        whole //= 10
        count += 1
    for index in range(count):
        out[at] = ZERO + digits[count - 1 - index]
        at += 1
    out[at] = POINT
    at += 1
    for index in range(decimals):
        digits[decimals - 1 - index] = part % 10
        part //= 10
    last = decimals - 1
    while last > 0 and digits[last] == 0:
        last -= 1
    for index in range(last + 1):
        out[at] = ZERO + digits[index]
        at += 1
    return at


@inline
def _nine_digits(size: float) -> tuple[int, int]:
    """Nine digits as one integer, and the power of ten of the first."""
    power = int(np.floor(np.log10(size)))
    scaled = _scaled(size, power)
    # Near a power of ten the logarithm may be wrong by one, and rounding may carry into it.
    if scaled < WHOLE_POWERS[DIGITS - 1]:
        power -= 1
        scaled = _scaled(size, power)
    if scaled >= WHOLE_POWERS[DIGITS]:
        power += 1
        scaled = _scaled(size, power)
    return scaled, power


@inline
def _scaled(size: float, power: int) -> int:
    """Return the size over 10^(power - 8), rounded to an integer, ties to even."""
    factor = POWERS[DIGITS - 1 - power]
    high = size * factor
    # Dekker's product: high + low is size times factor, exactly.
    split = SPLITTER * size
    size_high = split - (split - size)
    size_low = size - size_high
    split = SPLITTER * factor
    factor_high = split - (split - factor)
    factor_low = factor - factor_high
    low = (
        (size_high * factor_high - high) + size_high * factor_low + size_low * factor_high
    ) + size_low * factor_low
    whole = np.floor(high)
    rest = high - whole - 0.5
    units = int(whole)
    # Without a tie in `high` its sign decides, for `low` is too small to change it.
    above = rest > 0.0 or (rest == 0.0 and (low > 0.0 or (low == 0.0 and units % 2 == 1)))
    return units + int(above)


@inline
def _write_number(out: Bytes, at: int, value: float, digits: Bytes) -> int:
    if np.isnan(value):
        return at
    at = _sign(out, at, value)
    if value == 0.0:
        out[at] = ZERO
        return at + 1
    scaled, power = _nine_digits(abs(value))
    for index in range(DIGITS):
        digits[DIGITS - 1 - index] = scaled % 10
        scaled //= 10
    count = DIGITS
    while count > 1 and digits[count - 1] == 0:
        count -= 1
    if power < -4:
        return _write_exponent(out, at, digits, count, power)
    if power < 0:
        out[at] = ZERO
        out[at + 1] = POINT
        at += 2
        for _ in range(-power - 1):
            out[at] = ZERO
            at += 1
        point = count
    else:
        point = power + 1
    for index in range(max(count, point)):
        if index == point:
            out[at] = POINT
            at += 1
        out[at] = ZERO + digits[index]
        at += 1
    return at


@inline
def _write_exponent(out: Bytes, at: int, digits: Bytes, count: int, power: int) -> int:
    """Write the exponent of a number below 1e-4 and not below 1e-13."""
    out[at] = ZERO + digits[0]
    at += 1
    if count > 1:
        out[at] = POINT
        at += 1
    for index in range(1, count):
        out[at] = ZERO + digits[index]
        at += 1
    out[at] = LETTER_E
    out[at + 1] = MINUS
    out[at + 2] = ZERO + (-power) // 10
    out[at + 3] = ZERO + (-power) % 10
    return at + 4


@inline
def _write_status(out: Bytes, at: int, status: int) -> int:
    out[at] = COMMA
    out[at + 1] = ZERO
    out[at + 2] = LETTER_X
    at += 3
    places = 4
    while status >> (4 * places) > 0:
        places += 1
    for index in range(places):
        nibble = (status >> (4 * (places - 1 - index))) & 15
        out[at] = ZERO + nibble if nibble < 10 else LETTER_A + nibble - 10
        at += 1
    out[at] = NEWLINE
    return at + 1
