"""The reader of files alone: what it says of a value that it does not take."""

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from gaitd_toml import SMALLEST, ConfigError, Document, PlainText, decoded, load_toml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec import Meta


class Inner(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    speed_rpm: Annotated[float, Meta(gt=0, le=10)]
    count: Annotated[int, Meta(ge=1)] = 1


class Outer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    inner: Inner
    parts: tuple[Inner, ...] = ()
    kind: Literal["a", "b"] = "a"
    choices: dict[str, Literal["S1", "S2"]] = {}
    pair: tuple[float, float] = (0.0, 0.0)
    maybe: Inner | None = None
    names: Annotated[tuple[str, ...], Meta(min_length=1)] = ("x",)


GOOD = {"inner": {"speed_rpm": 1.0}}


def refused(table: dict[str, object]) -> ConfigError:
    with pytest.raises(ConfigError) as error:
        decoded(Document(Path("x.toml"), "", table), Outer)
    return error.value


@pytest.mark.parametrize(
    ("table", "key", "value", "allowed"),
    [
        ({"inner": {"speed_rpm": 11}}, "inner.speed_rpm", "11", "a number > 0 and <= 10"),
        ({"inner": {}}, "inner.speed_rpm", "(missing)", "a number > 0 and <= 10"),
        ({"inner": 3}, "inner", "3", "a table with speed_rpm, count"),
        ({}, "inner", "(missing)", "a table with speed_rpm, count"),
        (GOOD | {"parts": [GOOD["inner"], {"speed_rpm": -1}]}, "parts[1].speed_rpm", "-1", "> 0"),
        (GOOD | {"parts": {"speed_rpm": 1}}, "parts", "{speed_rpm}", "a list, each a table"),
        (GOOD | {"kind": "c"}, "kind", '"c"', 'one of "a", "b"'),
        (GOOD | {"choices": {"fall": "S3"}}, "choices.fall", '"S3"', 'one of "S1", "S2"'),
        (GOOD | {"pair": [1.0, math.inf]}, "pair[1]", "inf", "a number, and finite"),
        (GOOD | {"pair": [1.0]}, "pair", "[1.0]", "a list of 2"),
        (GOOD | {"maybe": {"count": 0}}, "maybe.count", "0", "a whole number >= 1"),
        (GOOD | {"maybe": {"count": 1.5}}, "maybe.count", "1.5", "a whole number >= 1"),
        (GOOD | {"names": []}, "names", "[]", "a list with 1 or more entries, each text"),
        (GOOD | {"nmes": ["x"]}, "nmes", "['x']", "unknown key. Did you mean `names`?"),
    ],
)
def test_a_refusal_names_key_value_and_range(table, key, value, allowed):
    error = refused(table)

    assert (error.file, error.key, error.value) == ("x.toml", key, value)
    assert allowed in error.allowed


def test_what_is_good_is_decoded_and_nothing_is_made_up():
    outer = decoded(Document(Path("x.toml"), "", GOOD | {"maybe": {"speed_rpm": 2}}), Outer)

    assert outer == Outer(inner=Inner(speed_rpm=1.0), maybe=Inner(speed_rpm=2.0))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Annotated[float, Meta(ge=0, lt=1)], "a number >= 0 and < 1"),
        (Annotated[int, Meta(gt=3)], "a whole number > 3"),
        (bool, "true or false"),
        (Path, "the name of a file or folder"),
        (Annotated[str, Meta(min_length=10)], "text with 10 or more characters"),
        (Annotated[str, Meta(pattern="^a")], "text that matches ^a"),
        (dict[str, Annotated[int, Meta(ge=2)]], "a table, each a whole number >= 2"),
        (
            Annotated[tuple[int, ...], Meta(min_length=1, max_length=2)],
            "a list with 1 or more entries and with 2 or fewer entries, each a whole number",
        ),
    ],
)
def test_a_missing_value_is_described_by_its_type_and_bounds(kind, words):
    table = msgspec.defstruct("Table", [("key", kind)])

    with pytest.raises(ConfigError) as error:
        decoded(Document(Path("x.toml"), "", {}), table)

    assert (error.value.key, error.value.allowed) == ("key", words)


def test_all_mistakes_of_a_file_are_found_at_once_in_its_order():
    wrong = {"kind": "c", "inner": {"speed_rpm": 0, "coumt": 1}, "parts": [{}, {"count": 0}]}

    error = refused(wrong)

    assert [one.key for one in (error, *error.more)] == [
        *("kind", "inner.speed_rpm", "inner.coumt"),
        *("parts[0].speed_rpm", "parts[1].count", "parts[1].speed_rpm"),
    ]


def test_a_path_is_relative_to_the_folder_of_its_file():
    table = msgspec.defstruct("Table", [("file", Path)])

    found = decoded(Document(Path("folder/x.toml"), "", {"file": "y"}), table)

    assert found.file == Path("folder/y")


def test_a_long_value_is_cut_and_a_path_is_not():
    long = Path("/" + "folder/" * 20)

    assert len(ConfigError("f", "k", "x" * 500, "less").value) == 60
    assert ConfigError("f", "k", long, "there").value == str(long)
    assert ConfigError("f", "k", PlainText("(as it is)"), "").value == "(as it is)"


@settings(derandomize=True)
@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_is_taken_exactly_if_it_is_in_its_range(value):
    table = {"inner": {"speed_rpm": value}}

    if SMALLEST <= value <= 10:
        assert decoded(Document(Path("x.toml"), "", table), Outer).inner.speed_rpm == value
    else:
        assert refused(table).key == "inner.speed_rpm"


json_like = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(derandomize=True, max_examples=100)
@given(st.sampled_from(Outer.__struct_fields__), json_like)
def test_any_table_is_either_decoded_or_refused_with_a_key(name, value):
    assume(value is not None)

    try:
        decoded(Document(Path("x.toml"), "", GOOD | {name: value}), Outer)
    except ConfigError as error:
        assert error.key.startswith(name)


@pytest.mark.parametrize(
    ("text", "place", "reason"),
    [
        ("a = \n", "line 1, column 5", "Invalid value"),
        ("a = 1\nb = [1, 2\n", "end of document", "Unclosed array"),
        ("[inner]\nspeed_rpm = 1\n[inner]\n", "line 3, column 7", "Cannot declare"),
        ('a = "open\n', "line 1, column 10", "Illegal character"),
    ],
)
def test_a_syntax_error_is_told_with_line_and_column(tmp_path, text, place, reason):
    file = tmp_path / "x.toml"
    file.write_text(text)

    with pytest.raises(ConfigError) as error:
        load_toml(file, Outer)

    assert error.value.key == place
    assert reason in error.value.allowed
