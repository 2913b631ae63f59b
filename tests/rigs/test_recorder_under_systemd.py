"""`gaitd-record.service` under a real systemd: what its unit forbids, a recording does not need."""

from pathlib import Path

import pytest
from whole_machine import whole_machine

HERE = Path(__file__).parent
TIMEOUT_S = 600
pytestmark = [pytest.mark.rig_systemd, pytest.mark.timeout(TIMEOUT_S + 100)]


def test_the_recorder_records_is_killed_finishes_what_is_left_and_ends_in_order(
    systemd_rig, tmp_path
):
    script = (HERE / "recorder_under_systemd.sh").read_text()

    finished = whole_machine(type(systemd_rig)).run(script, tmp_path, TIMEOUT_S)

    assert finished.exit_code == 0, finished.output[-4000:]
    journal = (tmp_path / "journal").read_text()
    assert (tmp_path / "before").read_text().split() == ["disabled", "inactive"]
    assert (tmp_path / "result").read_text().split() == ["success", "0"]
    assert "torn: the recorder was killed" in journal
    assert journal.count("finished     /var/lib/gaitd-record/") >= 2
    left = (tmp_path / "left").read_text().splitlines()
    assert not [name for name in left if ".part" in name]
    assert len([name for name in left if name.endswith("right.recording.parquet")]) >= 2
    assert {line.split()[0] for line in (tmp_path / "owners").read_text().splitlines()} == {
        "gaitd-record"
    }
    assert "rows" in (tmp_path / "replayed").read_text()
