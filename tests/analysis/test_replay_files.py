from pathlib import Path

import pytest

from analysis.replay_files import FileError, Targets, Wanted, appearing, check, targets_of

NOTHING = Wanted(None, None, None)


def test_one_recording_of_one_leg_keeps_the_plain_names():
    found = targets_of(NOTHING, [(Path("a/b.csv"), "")], many=False)

    assert found == [Targets(Path("a/b.csv.estimates.csv"), None, None)]


def test_legs_of_one_ring_are_told_apart_in_every_file(tmp_path):
    results = [(Path("run.ring"), "left"), (Path("run.ring"), "right")]
    wanted = Wanted(Path("out.csv"), Path("p.png"), tmp_path)

    assert targets_of(wanted, results, many=False) == [
        Targets(Path("out.left.csv"), Path("p.left.png"), tmp_path / "run.ring.left.strides.csv"),
        Targets(
            Path("out.right.csv"), Path("p.right.png"), tmp_path / "run.ring.right.strides.csv"
        ),
    ]
    assert [one.output.name for one in targets_of(NOTHING, results, many=False)] == [
        "run.ring.left.estimates.csv",
        "run.ring.right.estimates.csv",
    ]


def test_recordings_of_one_name_are_refused_in_one_folder(tmp_path):
    results = [(Path("a/run.csv"), ""), (Path("b/run.csv"), "")]
    found = targets_of(Wanted(tmp_path, None, None), results, many=True)

    with pytest.raises(FileError, match=r"run\.csv\.estimates\.csv: is the file of --output too"):
        check(found, [])


def test_a_hard_link_to_the_recording_is_the_recording(tmp_path):
    recorded, link = tmp_path / "a.csv", tmp_path / "b.csv"
    recorded.touch()
    link.hardlink_to(recorded)

    with pytest.raises(FileError, match="is the recording itself; --output must be another file"):
        check([Targets(link, None, None)], [recorded])


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("before")

    with pytest.raises(ZeroDivisionError), appearing(path) as draft:
        draft.write_text("half")
        _ = 1 / 0

    assert path.read_text() == "before"
    with appearing(path) as draft:
        draft.write_text("after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert list(tmp_path.iterdir()) == [path]
