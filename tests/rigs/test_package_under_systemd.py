"""The Debian package under a real systemd: `make deb` three times, and one container for all tests.

The first package is of this commit. In the second, a key of a configuration file that is not edited
has another name; in the third, a key of the trainer file that the container has edited.
`package_under_systemd.sh` installs, upgrades, removes and purges; each test looks at what it saw.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PROJECT = HERE.parents[1]
TIMEOUT_S = 2400
VERSION = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["version"]
SECOND, THIRD = f"{VERSION}.1", f"{VERSION}.2"
pytestmark = [
    pytest.mark.rig_systemd,
    pytest.mark.thorough,  # three builds take as long as all other rigs
    pytest.mark.timeout(2 * TIMEOUT_S),
]


def run(*words: str, folder: Path) -> str:
    return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True).stdout


def built(clone: Path, name: Path) -> None:
    made = subprocess.run(
        ("make", "deb", "LEVEL=1"), cwd=clone, check=False, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stdout + made.stderr
    (package,) = (clone / "out").glob("*.deb")
    package.rename(name)


def released(clone: Path, version: str, key: str, renamed: str) -> None:
    """A commit with another version and another name of a key, everywhere, and its tag."""
    files = run("git", "grep", "-lwI", key, folder=clone).split()
    run("sed", "-i", rf"s/\b{key}\b/{renamed}/g", *files, folder=clone)
    run(
        "sed",
        "-i",
        f's/^version = .*/version = "{version}"/',
        "pyproject.toml",
        folder=clone,
    )
    author = ("-c", "user.name=rig", "-c", "user.email=rig@example.org")
    run("git", *author, "commit", "--quiet", "--all", "--message", version, folder=clone)
    run("git", "tag", f"v{version}", folder=clone)


def on_disk(rig_type, folder):
    """The rig with a /usr that can be written, /opt on the disk, this machine's dpkg database."""

    class OnDisk(rig_type):
        def command(self, script, folder, *also):
            words = super().command(script, folder, *also)
            at = words.index("--boot")
            binds = [f"--bind={folder}/opt:/opt", "--bind-ro=/var/lib/dpkg:/srv/dpkg"]
            return [*words[:at], "--overlay=/usr::/usr", "--private-network", *binds, *words[at:]]

    (folder / "opt").mkdir()
    return OnDisk()


@pytest.fixture(scope="module")
def story(systemd_rig, tmp_path_factory):
    """The folder with what was seen, once the story came to its end."""
    folder = tmp_path_factory.mktemp("package")
    clone = folder / "clone"
    run("git", "clone", "--quiet", str(PROJECT), str(clone), folder=folder)
    built(clone, folder / "first.deb")
    released(clone, SECOND, "counts_per_rev", "counts_per_revolution")
    built(clone, folder / "second.deb")
    released(clone, THIRD, "announce_s", "announcement_s")
    built(clone, folder / "third.deb")
    wheel = (sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder))
    run(*wheel, folder=PROJECT / "gaitd_lab")
    rig = on_disk(type(systemd_rig), folder)
    script = f"project={PROJECT}\n" + (HERE / "package_under_systemd.sh").read_text()
    finished = rig.run(script, folder, TIMEOUT_S)
    assert finished.exit_code == 0, finished.output[-4000:]
    return folder


def lines(story, name):
    return (story / name).read_text().splitlines()


def test_an_installation_leaves_everything_stopped_and_disabled(story):
    assert lines(story, "after_install") == ["disabled"] * 7 + ["inactive"] * 7
    assert lines(story, "install")[-1].startswith(f"installed {VERSION}")
    assert lines(story, "installed")[0] == f"gaitd {VERSION}"
    assert lines(story, "installed")[1].startswith("environments: gaitd")


def test_each_file_of_settings_is_readable_for_its_own_user(story):
    assert lines(story, "owners") == [
        "root gaitd 640",
        "root gaitd-patient 640",
        "root gaitd-assist 640",
        "root gaitd-record 640",
    ]


def test_commands_have_manual_pages_and_completion_and_kernels_are_compiled(story):
    assert {"gaitd.1.gz", "gaitd-check.1.gz", "gaitd-session-run.1.gz", "gaitd", "_gaitd"} <= set(
        lines(story, "manual")
    )
    assert int((story / "compiled").read_text()) > 10


def test_a_running_machine_is_not_touched(story):
    for name in ("upgrade_of_a_running", "removal_of_a_running"):
        said = (story / name).read_text()
        assert re.search(r"gaitd-\w+ runs: `systemctl stop gaitd.target", said)
        assert lines(story, name)[-2] == "failed"
        assert lines(story, name)[-1] == lines(story, "install")[-1]
    assert lines(story, "running") == lines(story, "still_running")
    assert lines(story, "running").count("ActiveState=active") == 2


def test_a_process_that_was_started_by_hand_is_not_touched_either(story):
    assert re.search(
        r"process \d+ runs from /opt/gaitd", (story / "upgrade_beside_a_process").read_text()
    )
    assert lines(story, "upgrade_beside_a_process")[-1] == lines(story, "install")[-1]


def test_a_version_whose_check_refuses_the_configuration_leaves_the_old_one_in_place(story):
    said = (story / "refused").read_text()
    assert "announce_s" in said and "unknown key" in said
    assert "the old version stays" in said
    assert lines(story, "refused")[-1] == lines(story, "install")[-1]
    assert lines(story, "before") == lines(story, "after_refused")


def test_an_upgrade_replaces_what_is_not_edited_and_keeps_the_rest(story):
    assert lines(story, "upgraded")[-1] == f"installed {SECOND}"
    assert lines(story, "after_upgrade")[0] == f"gaitd {SECOND}"
    assert lines(story, "after_upgrade")[1].startswith("environments: gaitd")
    assert lines(story, "edited") == []
    assert lines(story, "replaced") == ["1"]
    assert lines(story, "runs_again").count("ActiveState=active") == 2


def test_a_removal_leaves_configuration_and_state(story):
    assert lines(story, "removed")[-1] == f"config-files {SECOND}"
    left = [one for one in lines(story, "left_by_removal") if not one.startswith("/etc/systemd")]
    assert left == [
        "/etc/gaitd",
        "/etc/gaitd-assist",
        "/etc/gaitd-display",
        "/etc/gaitd-record",
        "/var/lib/gaitd",
    ]


def test_a_purge_leaves_nothing(story):
    assert lines(story, "left_by_purge") == []
