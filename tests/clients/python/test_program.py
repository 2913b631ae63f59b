"""Each program of clients/ has the same parser, one line for an error, and the same exit codes."""

import re
import socket

import gaitd_assist.program
import gaitd_display.__main__
import gaitd_session.program
import pytest
from assisted import SHIPPED as ASSIST
from command_line import ran
from documents import PROJECT
from gaitd_names import ExitCode
from training import PROFILE

PATIENT = PROJECT / "clients" / "display" / "configs" / "patient.toml"
MAINS = {
    "gaitd-assist": gaitd_assist.program.main,
    "gaitd-display": gaitd_display.__main__.main,
    "gaitd-session": gaitd_session.program.main,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    (folder / "away.toml").write_text(ASSIST.read_text().replace("127.0.0.1:7447", "127.0.0.1:1"))
    (folder / "her.toml").write_text(PROFILE)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        (folder / "taken.toml").write_text(
            PATIENT.read_text().replace("port = 8080", f"port = {port}")
        )
        yield folder


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("gaitd-assist run --config none.toml", ExitCode.USAGE, "none.toml: no such file"),
        ("gaitd-assist run --config away.toml", ExitCode.UNAVAILABLE, "no service listens"),
        ("gaitd-display patient --config none.toml", ExitCode.USAGE, "none.toml: no such file"),
        ("gaitd-display patient --config taken.toml", ExitCode.UNAVAILABLE, "already in use"),
        ("gaitd-session summary --profile none.toml", ExitCode.USAGE, "none.toml: no such file"),
        (
            "gaitd-session run --profile her.toml --endpoint tcp/127.0.0.1:1",
            *(ExitCode.UNAVAILABLE, "no service listens"),
        ),
    ],
)
def test_an_error_is_one_line_and_its_exit_code(folder, line, code, said):
    program, *words = line.split()

    ended = ran(MAINS[program], program, *words, folder=folder)

    assert (ended.code, said in ended.err) == (code, True), ended.err
    assert ended.err.count("\n") == 1


def test_the_page_of_exit_codes_has_each_of_them():
    table = (PROJECT / "docs" / "exit_codes.md").read_text().partition("\n\nA machine")[0]

    told = [int(code) for code in re.findall(r"^\| (\d+) \|", table, re.MULTILINE)]
    assert told == [*ExitCode, 130]


@pytest.mark.parametrize("program", MAINS)
def test_help_version_and_a_wrong_option_are_as_in_gaitd(program):
    assert ran(MAINS[program], program, "--version").out == f"{program} 0.1.0\n"
    assert ran(MAINS[program], program, "-h").out.count("Commands") == 1
    wrong = ran(MAINS[program], program, "--no-such-option")
    assert (wrong.code, "--no-such-option" in wrong.err) == (ExitCode.USAGE, True)
