"""`gaitd rig`: a command in another world, its output and its exit code in this one."""

import json
import shlex
from pathlib import Path
from types import MappingProxyType

import pytest
import typer
from command_line import gaitd

from gaitd.command_line import CommandError
from gaitd_lab.commands.rig import Name, command
from gaitd_lab.testing import rigs


class Here(rigs.Rig):
    """No world at all: the script runs as it is."""

    set_up = "echo set up\n"

    def __init__(self, lack=None, instead=None):
        self.lack, self.instead, self.writable = lack, instead, ()

    def lacks(self):
        return self.lack

    def command(self, script, folder, also=()):
        self.writable = also
        return self.instead or [str(script)]


def ran(monkeypatch, rig, *words):
    monkeypatch.setattr(rigs, "RIGS", MappingProxyType({"vcan": rig}))
    with pytest.raises(typer.Exit) as ended:
        command(Name.VCAN, list(words))
    return ended.value.exit_code


def test_a_command_runs_in_this_folder_after_the_world_is_set_up(
    monkeypatch, tmp_path, capfdbinary
):
    monkeypatch.chdir(tmp_path)
    here = Here()

    code = ran(monkeypatch, here, "sh", "-c", "pwd; echo 'a  b' > written; exit 7")

    assert code == 7
    assert capfdbinary.readouterr().out.decode() == f"set up\n{tmp_path}\n"
    assert (tmp_path / "written").read_text() == "a  b\n"
    assert here.writable == (tmp_path,)


def test_with_json_the_output_of_the_command_goes_to_stderr(monkeypatch, tmp_path):
    monkeypatch.setattr(rigs, "RIGS", MappingProxyType({"vcan": Here()}))

    ended = gaitd("rig", "vcan", "--json", "--", "echo", "--json", folder=tmp_path)

    assert json.loads(ended.out) == {"rig": "vcan", "command": ["echo", "--json"], "exit_code": 0}
    assert "set up\n--json\n" in ended.err


def test_what_the_machine_lacks_is_one_line_with_the_way_to_have_it(monkeypatch):
    with pytest.raises(CommandError) as refused:
        ran(monkeypatch, Here("no kernel in /boot"), "true")

    said = str(refused.value)
    assert refused.value.code == 2
    assert "\n" not in said
    assert "gaitd rig vcan: no kernel in /boot" in said
    assert "make rigs" in said


def test_a_world_that_does_not_come_to_life_says_its_last_words(monkeypatch):
    broken = Here(instead=["sh", "-c", "echo no such boot; exit 1"])

    with pytest.raises(CommandError, match="no such boot") as ended:
        ran(monkeypatch, broken, "true")

    assert ended.value.code == 4


def test_what_python_reads_from_is_there_once_and_never_inside_what_may_be_written(tmp_path):
    places = rigs._read_from((tmp_path,))

    assert any(rigs.SOURCES.is_relative_to(place) for place in places)
    assert not [
        (one, other) for one in places for other in places if one != other and one in other.parents
    ]
    assert not any(place.is_relative_to(rigs.SOURCES) for place in rigs._read_from((rigs.SOURCES,)))


class Machine(rigs.SocketCan):
    """The virtual machine, also where this kernel has SocketCAN."""

    def native(self):
        return False


def test_in_the_machine_a_writable_folder_is_put_over_the_read_only_ones_last(tmp_path):
    folder, inside = tmp_path / "a folder", rigs.SOURCES / "tests"
    folder.mkdir()

    words = Machine().command(folder / "outer", folder, (inside,))

    lines = (folder / "begin").read_text().splitlines()
    targets = [shlex.split(line)[-1] for line in lines if line.startswith("mount")]
    assert targets[-2:] == [str(folder), str(inside)]
    assert "/usr" in targets
    assert any(inside.is_relative_to(target) for target in targets[3:-2])
    assert shlex.split(lines[-1]) == [str(folder / "outer")]
    # Only this is in the words of the kernel, which are 2,048 characters at most.
    assert shlex.split(words[-1]) == ["sh", str(folder / "begin")]


def test_in_the_machine_nothing_read_only_is_put_inside_a_writable_folder(tmp_path):
    Machine().command(tmp_path / "outer", tmp_path, (Path("/"),))

    lines = (tmp_path / "begin").read_text().splitlines()
    targets = [shlex.split(line)[-1] for line in lines if line.startswith("mount")]
    assert [one for one in targets if not one.startswith("/run/")] == [str(tmp_path), "/"]
