from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.recording import COLUMNS, RecordingError, read_csv, recording

HEADER = ",".join(COLUMNS)


def write(folder: Path, *lines: str) -> Path:
    path = folder / "a.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read_csv(path)
    return str(caught.value)


def test_columns_are_found_by_name_in_any_order_and_extra_ones_ignored(tmp_path):
    path = write(
        tmp_path,
        "note,slide_force_n,hip_torque_nm,time_s,slide_position_m,hip_angle_rad",
        'start,40,8,0.00,0.5,0.1\n"a, b",41,9,0.01,0.51,0.11',
    )

    found = read_csv(path)

    assert found.time_s.tolist() == [0.0, 0.01]
    assert found.position.tolist() == [[0.1, 0.5], [0.11, 0.51]]
    assert found.effort.tolist() == [[8.0, 40.0], [9.0, 41.0]]


def test_quoted_cells_and_blanks_beside_them_are_read(tmp_path):
    path = write(
        tmp_path,
        '"time_s", "hip_angle_rad" , slide_position_m,hip_torque_nm,"slide_force_n", note',
        '"0.00", "0.1", 0.5 ,"8",40,"a, b"',
        '0.01,0.2,0.5,8,41, "c"',
    )

    found = read_csv(path)

    assert found.position.tolist() == [[0.1, 0.5], [0.2, 0.5]]
    assert found.effort.tolist() == [[8.0, 40.0], [8.0, 41.0]]


def test_an_empty_cell_is_a_missing_sample_and_nothing_else_changes(tmp_path):
    path = write(tmp_path, HEADER, "0,0.1,0.5,8,40", "0.01,, ,8,40", "0.02,0.1,0.5,,40")

    found = read_csv(path)

    assert np.isnan(found.position[1]).all()
    assert np.isnan(found.effort[2, 0])
    assert np.count_nonzero(np.isnan(found.position)) == 2
    assert np.count_nonzero(np.isnan(found.effort)) == 1


@pytest.mark.parametrize("mark", ["", "\ufeff"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"], ids=["unix", "windows"])
def test_files_of_other_systems_and_blank_lines_are_read(tmp_path, mark, ending):
    path = tmp_path / "a.csv"
    text = ending.join([mark + HEADER, "0,0.1,0.5,8,40", "", "0.01,0.1,0.5,8,40", "", ""])
    path.write_bytes(text.encode("utf-8"))

    assert len(read_csv(path).time_s) == 2


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "is empty; its first line must name the columns"),
        ([HEADER], "holds no rows, only its header"),
        (["time_s,hip_angle_rad", "0,0"], "lacks column slide_position_m, hip_torque_nm"),
        ([HEADER.replace(",", ";"), "0;0;0;0;0"], "columns are separated by commas"),
        ([HEADER + ",time_s", "0,0,0,0,0,0"], "names column time_s more than once"),
        ([HEADER, "0,0,0,0,0", "0.01,0,abc,0,0"], "a.csv:3: slide_position_m is 'abc'"),
        ([HEADER, "0,0,0,0,0", "", "0.01,0,0,0,1,", "0.02,0,0,0,1.2.3"], "a.csv:5: slide_force_n"),
        ([HEADER, "0,0,0,0,0", "0.01,0,0"], "a.csv:3: has 3 cells, too few"),
        (
            [HEADER, "0,0,0,0,0", "0.02,0,0,0,0", "0.01,0,0,0,0"],
            "a.csv:4: time_s goes from 0.02 to 0.01",
        ),
        ([HEADER, "", "0.02,0,0,0,0", "", "0.01,0,0,0,0"], "a.csv:5: time_s goes from 0.02"),
        ([HEADER, "0,0,0,0,0", "0,0,0,0,0"], "must increase from row to row"),
        ([HEADER, "0,0,0,0,0", ",0,0,0,0"], "a.csv:3: has no time_s but nan"),
        ([HEADER, "0,0,0,0,0", "0.01,0,0,inf,0"], "a.csv:3: hip_torque_nm is infinite"),
        ([HEADER, "0,0,0,0,0", "0.01,0,0,1e999,0"], "a.csv:3: hip_torque_nm is infinite"),
        ([HEADER, "0,0,0,0,0", "0.01,0,0,1_000,0"], "a.csv:3: hip_torque_nm is '1_000'"),
        ([HEADER, "0,0,0,0,0", "0,01,0,1,0,5,0,0"], "a.csv:3: has 8 cells, too many for 5"),
        ([HEADER, "0,01,0,1,0,5,0,0"], "decimals are written with a point"),
        ([HEADER + ",note", "0,0,0,0,0,a", "0.01,0,0,0,0"], "a.csv:3: has 5 cells, too few for 6"),
        ([HEADER, "0,0,0,,0", "0.01,0,0,,0"], "hip_torque_nm is empty in every row"),
        ([HEADER, "0,12,0,0,0", "0.01,12.5,0,0,0"], "degrees where radians should be"),
        ([HEADER, "0,0,500,0,0", "0.01,0,501,0,0"], "millimetres where metres should be"),
        ([HEADER, "0,0,0,8000,0", "0.01,0,0,8000,0"], "millinewton metres where newton metres"),
        ([HEADER, "0,0,0,0,0", "10,0,0,0,0", "20,0,0,0,0"], "milliseconds"),
        ([HEADER, "0,0,0,0,0", "1.6e-4,0,0,0,0", "3.3e-4,0,0,0,0"], "minutes or larger units"),
    ],
)
def test_a_broken_recording_is_refused_with_the_place_and_the_reason(tmp_path, lines, said):
    path = write(tmp_path, *lines) if lines else tmp_path / "a.csv"
    path.touch()

    message = refusal(path)

    assert said in message
    assert str(path) in message


def test_one_glitch_is_no_reason_to_refuse_a_recording():
    values = np.zeros((1000, 5))
    values[:, 0] = np.arange(1000) * 0.01
    values[500, 1] = 100.0

    assert recording("a", values).position[500, 0] == 100.0


def test_degrees_in_one_second_of_a_long_recording_are_found():
    values = np.zeros((100_000, 5))
    values[:, 0] = np.arange(100_000) * 0.01
    values[40_000:40_100, 1] = np.linspace(3, 30, 100)

    with pytest.raises(
        RecordingError, match=r"row 40001: hip_angle_rad is 3, reaches 30 .*degrees"
    ):
        recording("a", values)


def test_gait_in_degrees_that_passes_through_small_angles_is_found():
    values = np.zeros((600, 5))
    values[:, 0] = np.arange(600) * 0.01
    values[:, 1] = 14 + 20 * np.sin(values[:, 0])

    with pytest.raises(RecordingError, match="degrees where radians should be"):
        recording("a", values)


def test_a_sensor_that_sticks_beyond_its_range_for_a_second_is_no_unit():
    values = np.zeros((100_000, 5))
    values[:, 0] = np.arange(100_000) * 0.01
    values[40_000:40_100, 1] = 65.535

    assert recording("a", values).position[40_050, 0] == 65.535


def test_missing_samples_are_words_empty_cells_or_blanks_and_lines_may_end_as_windows_does(
    tmp_path,
):
    path = tmp_path / "a.csv"
    rows = [HEADER, "0,0.1,0.5,8,40", "0.01,nan,NaN,8,40", "0.02,, ,,", "0.03,0.1,0.5,8,"]
    path.write_bytes("\r\n".join([*rows, ""]).encode())

    found = read_csv(path)

    gaps = np.isnan(np.hstack([found.position, found.effort]))
    assert gaps.tolist() == [
        [False] * 4,
        [True, True, False, False],
        [True] * 4,
        [False, False, False, True],
    ]


def test_empty_cells_behind_the_last_column_are_no_harm(tmp_path):
    path = write(tmp_path, HEADER, "0,0.1,0.5,8,40,", "0.01,0.1,0.5,8,41,, ")

    assert read_csv(path).effort[:, 1].tolist() == [40.0, 41.0]


def test_text_of_another_encoding_is_refused_by_name(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(HEADER + "\n0,0,0,0,0\n", encoding="utf-16")

    assert "not a text file" in refusal(path)


def test_a_file_that_is_not_there_or_no_text_is_refused_by_name(tmp_path):
    binary = tmp_path / "b.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01")

    assert "No such file" in refusal(tmp_path / "missing.csv")
    assert "not a text file" in refusal(binary)


cells = st.one_of(st.just(""), st.floats(-2, 2).map(repr), st.floats(-2, 2).map("{:.3e}".format))


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.lists(st.tuples(cells, cells, cells, cells), min_size=1, max_size=20))
def test_every_number_arrives_as_written(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("recordings") / "a.csv"
    rows = [("0", "0", "0", "0"), *rows]
    text = [HEADER, *(",".join([repr(i * 0.01), *row]) for i, row in enumerate(rows))]
    path.write_text("\n".join(text), encoding="utf-8")

    found = read_csv(path)

    wanted = [[float(cell) if cell else np.nan for cell in row] for row in rows]
    assert np.array_equal(np.hstack([found.position, found.effort]), wanted, equal_nan=True)


def test_more_rows_than_fit_into_memory_are_refused_before_all_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.recording.ROWS_MAX", 4)
    monkeypatch.setattr("analysis.recording.CHUNK_LINES", 2)
    rows = [f"{row * 0.01},0,0,0,0" for row in range(6)]

    assert len(read_csv(write(tmp_path, HEADER, *rows[:4])).time_s) == 4
    assert "a.csv: has more than 4 rows" in refusal(write(tmp_path, HEADER, *rows, "a", "b"))


def test_progress_rises_to_one(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.recording.CHUNK_LINES", 10)
    path = write(tmp_path, HEADER, *(f"{i * 0.01},0,0,0,0" for i in range(95)))
    told: list[float] = []

    found = read_csv(path, told.append)

    assert len(found.time_s) == 95
    assert told == sorted(told)
    assert 0.9 < told[-1] <= 1.0
