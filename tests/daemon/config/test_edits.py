"""An edit of a configuration changes one value, and is refused where it cannot."""

import shutil
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.config.edits import EditError, edit

CONFIGS = Path(__file__).parents[3] / "configs"
PLAIN = (bool, int, float, str)


def places(table, path=""):
    """Every key of a TOML tree that has a plain value and a line of its own."""
    for key, value in table.items():
        if isinstance(value, PLAIN):
            yield f"{path}{key}"
        elif isinstance(value, dict):
            yield from places(value, f"{path}{key}.")
        elif isinstance(value, list) and key in {"leg", "programme"}:
            for number, entry in enumerate(value):
                yield from places(entry, f"{path}{key}.{number}.")


def value_at(tree, key):
    for part in key.split("."):
        tree = tree[int(part)] if isinstance(tree, list) else tree[part]
    return tree


ALL = [
    (file.name, key)
    for file in sorted(CONFIGS.glob("*.toml"))
    for key in places(tomllib.loads(file.read_text()))
]
VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**53), 2**53),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=30),
)


@settings(max_examples=30)
@given(st.sampled_from(ALL), VALUES)
def test_any_value_reaches_its_key_and_nothing_else_changes(tmp_path_factory, place, value):
    name, key = place
    folder = tmp_path_factory.mktemp("edited")
    shutil.copy(CONFIGS / name, folder)
    before = tomllib.loads((folder / name).read_text())

    edit(folder, {name: {key: value}})

    after = tomllib.loads((folder / name).read_text())
    assert value_at(after, key) == value
    edit(folder, {name: {key: value_at(before, key)}})
    assert tomllib.loads((folder / name).read_text()) == before


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ({"none.toml": {"seed": 1}}, "there is no none.toml"),
        ({"plant.toml": {"sed": 1}}, "plant.toml has no key sed"),
        ({"plant.toml": {"start.seed": 1}}, "plant.toml has no key start.seed"),
        ({"demo.toml": {"gait.hip.harmonics_deg": 1}}, "does not stand on one line"),
        ({"demo.toml": {"leg.1.name": "left"}}, "demo.toml has no key leg.1.name"),
    ],
)
def test_what_cannot_be_changed_is_named(tmp_path, edits, said):
    folder = shutil.copytree(CONFIGS, tmp_path / "configs")

    with pytest.raises(EditError, match=said):
        edit(folder, edits)
