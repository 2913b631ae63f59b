"""What a record says in words has as many bytes as its slot has room for, and is always text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.ipc.record import TEXT_BYTES_MAX, clipped


@given(text=st.text(st.characters(), max_size=900), most=st.integers(0, TEXT_BYTES_MAX))
def test_a_clipped_text_is_a_beginning_that_fits(text, most):
    said = clipped(text, most)

    assert len(said.encode()) <= most
    whole = text.encode(errors="replace")
    assert whole.startswith(said.encode())
    assert len(whole) > most or said.encode() == whole


@pytest.mark.parametrize("text", ["\ud83d", "a\udcff"])
def test_what_is_no_text_is_made_one(text):
    assert clipped(text).encode()
