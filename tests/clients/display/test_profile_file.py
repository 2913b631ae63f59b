"""A program changes a profile: comments stay, and a reader never meets half a file or none."""

import json
import os
import re
import tempfile
from pathlib import Path

import pytest
from gaitd_display.profile_file import (
    Bounds,
    ConflictError,
    NotWrittenError,
    WrongValuesError,
    bounds,
    change_profile,
    read_text,
    values_of,
)
from gaitd_session.profile import parse_profile, read_profile
from gaitd_toml import ConfigError
from other_user import forked, result
from training import PASSIVE, PROFILE

COMMENTED = "# of a person\n" + re.sub(r"(?m)^(\S+ = .*)$", r"\1  # as agreed", PROFILE)
COMMENTS = re.compile(r"#.*")
THERAPIST, PATIENT, GROUP = 64011, 64012, 64013


@pytest.fixture
def file(tmp_path):
    made = tmp_path / "her.toml"
    made.write_text(COMMENTED, encoding="utf-8")
    made.chmod(0o640)
    return made


def changed(file, change):
    """Change the values of the form as `change` does, and save it."""
    read = read_text(file)
    values = json.loads(json.dumps(values_of(read.profile)))  # as the page has them
    change(values)
    return change_profile(file, read.sha256, values)


def less(values):
    values["range"]["cadence_max_hz"] = 0.45
    values["assist"]["hip"]["max_nm"] = 8
    for walk in (values["plan"]["warm_up"], values["plan"]["block"][0]):
        walk["cadence_hz"] = 0.4


def test_a_change_is_told_with_old_and_new_and_comments_and_rights_stay(file):
    assert [tuple(one) for one in changed(file, less)] == [
        ("range.cadence_max_hz", 0.5, 0.45),
        ("assist.hip.max_nm", 10.0, 8),
        ("plan.warm_up.cadence_hz", 0.5, 0.4),
        ("plan.block[0].cadence_hz", 0.5, 0.4),
    ]
    made = file.read_text(encoding="utf-8")
    assert COMMENTS.findall(made) == COMMENTS.findall(COMMENTED)
    assert "cadence_max_hz = 0.45  # as agreed" in made
    assert read_profile(file).assist.hip.max_nm == 8.0
    assert f"{file.stat().st_mode & 0o777:o}" == "640"
    assert [one.name for one in file.parent.iterdir()] == [file.name]


def test_parts_are_added_and_removed_and_the_passive_minute_comes_and_goes(file):
    def more(values):
        block = values["plan"]["block"]
        block += [{**block[0], "duration_s": 20.0}, {**block[0], "rest_s": 0.0}]
        values["plan"]["passive"] = {**block[0], "duration_s": 80.0}

    def fewer(values):
        values["plan"]["passive"] = None
        del values["plan"]["block"][1:]

    added = changed(file, more)
    assert [walk.duration_s for walk in read_profile(file).plan.block] == [12.0, 20.0, 12.0]
    assert ("plan.passive.duration_s", None, 80.0) in added
    removed = changed(file, fewer)
    assert {(one.key, one.after) for one in removed} == {(one.key, None) for one in added}
    assert read_profile(file) == parse_profile(PROFILE, file)
    with_minute = PROFILE.replace("[plan.warm_up]", f"{PASSIVE}\n[plan.warm_up]")
    file.write_text(with_minute, encoding="utf-8")
    changed(file, fewer)
    assert read_profile(file) == parse_profile(PROFILE, file)


def test_the_same_values_touch_nothing(file):
    before = file.stat()
    assert changed(file, lambda _: None) == []
    assert file.stat() == before


def put(key, value):
    def change(values):
        *path, last = re.findall(r"\w+", key)
        at = values
        for name in path:
            at = at[int(name) if name.isdigit() else name]
        at[last] = value

    return change


@pytest.mark.parametrize(
    ("key", "value", "low", "high"),
    [
        ("range.cadence_min_hz", 2.5, 0.01, 2.0),
        ("assist.slide.max_n", -1, 0, 1500),
        ("plan.block[0].rest_s", 3601, 0, 3600),
        ("plan.block[0].duration_s", None, 5, 3600),
        ("plan.warm_up.duration_s", True, 5, 3600),
        # allowed alone, and not beside another one
        ("range.amplitude_max_ratio", 0.2, 0.3, 1.0),
        ("goal.share_start_ratio", 0.7, 0.1, 0.6),
        ("plan.block[0].cadence_hz", 0.6, 0.2, 0.5),
    ],
)
def test_a_wrong_value_says_key_value_and_what_is_allowed_and_nothing_is_written(
    file, key, value, low, high
):
    with pytest.raises(WrongValuesError) as refused:
        changed(file, put(key, value))

    first = refused.value.wrong[0]
    assert (first.key, first.value, first.value_low, first.value_high) == (key, value, low, high)
    assert file.read_text(encoding="utf-8") == COMMENTED


def test_all_wrong_values_are_told_at_once(file):
    def change(values):
        put("goal.band_width_ratio", 0)(values)
        put("plan.block[0].rest_s", -1)(values)

    with pytest.raises(WrongValuesError) as refused:
        changed(file, change)
    assert [one.key for one in refused.value.wrong] == [
        "goal.band_width_ratio",
        "plan.block[0].rest_s",
    ]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda values: values["goal"].pop("share_min_ratio"), "share_min_ratio"),
        (put("goal.more", 1.0), "more"),
        (lambda values: values["plan"]["block"].clear(), "length"),
        (put("plan.block[0].rest_s", 1e-12), "at least 1e-09"),
    ],
)
def test_what_no_form_sends_is_refused_too(file, change, said):
    with pytest.raises(WrongValuesError, match=said):
        changed(file, change)
    assert file.read_text(encoding="utf-8") == COMMENTED


def test_a_file_that_was_changed_meanwhile_or_is_no_profile_is_left_alone(file):
    read = read_text(file)
    file.write_text(f"{COMMENTED}# by another person\n", encoding="utf-8")
    with pytest.raises(ConflictError):
        change_profile(file, read.sha256, values_of(read.profile))
    file.write_bytes(b"# \xff\n" + COMMENTED.encode())
    with pytest.raises(ConfigError, match="UTF-8"):
        change_profile(file, read.sha256, values_of(read.profile))
    assert [one.name for one in file.parent.iterdir()] == [file.name]


def test_a_disk_that_is_full_leaves_the_old_file_and_nothing_beside_it(file, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(NotWrittenError, match="No space left"):
        changed(file, less)
    assert file.read_text(encoding="utf-8") == COMMENTED
    assert [one.name for one in file.parent.iterdir()] == [file.name]


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be two other users")
@pytest.mark.parametrize(
    ("owner", "group", "mode", "refusal"),
    [
        (PATIENT, GROUP, 0o660, ""),
        (PATIENT, GROUP, 0o640, "not writable"),
        (PATIENT, PATIENT, 0o666, "group cannot be kept"),
    ],
)
def test_another_user_changes_a_file_only_if_its_readers_keep_it(owner, group, mode, refusal):
    # Not in pytest's folder, which is for its own user.
    folder = Path(tempfile.mkdtemp())
    os.chown(folder, PATIENT, GROUP)
    folder.chmod(0o770)
    file = folder / "her.toml"
    file.write_text(PROFILE, encoding="utf-8")
    os.chown(file, owner, group)
    file.chmod(mode)
    values = values_of(parse_profile(PROFILE, file))
    less(values)

    def write():
        try:
            change_profile(file, read_text(file).sha256, values)
        except NotWrittenError as error:
            return refusal in str(error)
        return refusal == ""

    assert result(forked(THERAPIST, GROUP, write)) == 1
    is_less = (PATIENT, group, lambda: read_profile(file).range.cadence_max_hz == 0.45)
    assert result(forked(*is_less)) == (not refusal)
    assert file.stat().st_gid == group
    assert file.stat().st_mode & 0o777 == mode


def test_the_bounds_are_those_of_the_profile():
    found = bounds()
    assert found["plan.block.duration_s"] == Bounds(5.0, 3600)
    assert found["assist.slide.max_n"] == Bounds(0, 1500)
    assert len(found) == 4 + 2 + 7 + 3 * 4
