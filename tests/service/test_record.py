"""`gaitd record` beside a running service: real processes, in simulated time."""

import json
import shutil
import time

import msgspec
import pyarrow.parquet as pq
import pytest
from command_line import gaitd
from gaitd_client import NotValid, wire
from gaitd_names import Mode
from gaitd_record import MESSAGES, PART, finish
from mcap.reader import make_reader
from small_disk import fill

from analysis.replay import estimate, read

KEPT = 200_000
POLL_S = 0.05


class Beside:
    """The recorder's process, and a client that gets the same messages."""

    def __init__(self, service, folder, *words):
        self.service, self.folder = service, folder
        self.process = service.start("record", "--output", str(folder), "--json", *words)
        # Not `service.wait`: it lets time pass as fast as both processors can.
        while "listening" not in self.process.output():
            self.process.check()
            time.sleep(POLL_S)

    def events(self):
        return [json.loads(line) for line in self.process.output().splitlines() if "{" in line]

    def part(self):
        return next(iter(self.folder.glob(f"*{PART}")), None)

    def end(self):
        self.process.terminate()
        self.service.wait(lambda: self.process.poll() is not None, 60)
        del self.service.parts["record"]
        return self.events()


def cycles_of(path):
    return pq.read_table(path / "right.estimates.parquet")["cycle"].to_pylist()


def copied(part, folder):
    """What a kill would leave now."""
    shutil.rmtree(folder, ignore_errors=True)
    finished = finish(shutil.copytree(part, folder / f"copy{PART}"))
    return cycles_of(finished.path) if (finished.path / "right.estimates.parquet").exists() else []


def newest_copied(beside, tmp_path):
    """The newest cycle of such a copy that has one from now on.

    The recorder's timer is the computer's: it writes while simulated time stands. A message may be
    lost on its way, so it is not a certain cycle that is waited for.
    """
    now, kept = beside.service.newest().cycle, []

    def is_kept():
        kept[:] = copied(beside.part(), tmp_path / "copy")
        return kept and kept[-1] >= now

    beside.service.wait(is_kept, 60)
    return kept[-1]


@pytest.mark.parametrize("cycles", [137, pytest.param(411, marks=pytest.mark.thorough)])
def test_a_killed_recorder_has_all_that_was_on_the_disk_and_nothing_else(
    long_service, tmp_path, cycles
):
    long_service.bring(Mode.GAIT)
    beside = Beside(long_service, tmp_path / "recordings")
    with long_service.client("observer") as trainer:
        published = []
        trainer.estimate("right", keep=KEPT).call(published.append)
        long_service.wait(beside.part, 60)
        begun = long_service.newest().cycle
        long_service.wait(lambda: long_service.newest().cycle > begun + cycles, 60)
        with long_service.held():
            last = newest_copied(beside, tmp_path)
        long_service.wait(lambda: long_service.newest().cycle > last + cycles // 5, 60)
        long_service.kill("record")
        del long_service.parts["record"]

    part = beside.part()
    ran = gaitd("record", "--finish", "--output", tmp_path / "recordings", "--json")

    (finished,) = map(json.loads, ran.out.splitlines())
    assert finished["ended"].startswith("torn")
    kept = cycles_of(part.with_suffix(""))
    assert last in kept
    seen = {one.cycle: one for one in published if not isinstance(one, NotValid)}
    assert kept == sorted(set(kept))
    missing = [cycle for cycle in seen if kept[0] <= cycle <= last and cycle not in kept]
    assert len(missing) <= finished["lost"].get("right/estimate", 0)


def test_a_full_disk_ends_the_recorder_with_2_and_its_part_is_finished_once_there_is_room(
    long_service, small, tmp_path
):
    disk = small("disk", "80m")
    long_service.bring(Mode.GAIT)
    beside = Beside(long_service, disk)
    long_service.wait(beside.part, 60)
    begun = long_service.newest().cycle
    long_service.wait(lambda: long_service.newest().cycle > begun + 100, 60)
    with long_service.held():
        last = newest_copied(beside, tmp_path)
        fill(disk)
    long_service.wait(lambda: beside.process.poll() is not None, 60)
    del long_service.parts["record"]
    part = beside.part()

    full = gaitd("record", "--finish", "--output", disk)
    (disk / "rubbish").unlink()
    freed = gaitd("record", "--finish", "--output", disk, "--json")

    assert beside.process.poll() == 2
    assert "No space left on device" in beside.process.output()
    assert full.code == 2
    assert "No space left on device" in full.err
    assert "Traceback" not in beside.process.output() + full.err
    assert (freed.code, json.loads(freed.out)["path"]) == (0, str(part.with_suffix("")))
    kept = cycles_of(part.with_suffix(""))
    assert last in kept
    assert kept == sorted(set(kept))


def test_a_training_is_recorded_from_enable_to_disable_and_replayed(long_service, tmp_path):
    long_service.bring(Mode.READY)
    beside = Beside(long_service, tmp_path / "recordings", "--for", "training")
    with long_service.client("observer") as trainer:
        published = []
        trainer.activity("right", keep=KEPT).call(published.append)
        long_service.bring(Mode.GAIT)
        long_service.run(1.0)
        long_service.bring(Mode.READY)
        long_service.run(3.0)
        long_service.wait(lambda: len(beside.events()) > 2, 60)
        _, begun, finished = beside.end()

    assert (begun["event"], finished["event"]) == ("begun", "finished")
    assert finished["ended"] == "in order"
    with (beside.folder / finished["path"] / MESSAGES).open("rb") as file:
        reader = make_reader(file)
        told = [
            msgspec.json.decode(message.data, type=wire.Activity)
            for _, channel, message in reader.iter_messages()
            if channel.topic == "/right/activity"
        ]
        (attached,) = reader.iter_attachments()
    seen = {one.cycle: one for one in published if not isinstance(one, NotValid)}
    assert all(seen[one.cycle] == one for one in told if one.cycle in seen)
    modes = {one.mode for one in told}
    assert {"hold", "gait"} <= modes
    assert json.loads(attached.data)["robot"]["geometry"]
    source = read(beside.folder / finished["path"])
    assert len(estimate(source, source.robot).state) == len(source.recording.time_s)
