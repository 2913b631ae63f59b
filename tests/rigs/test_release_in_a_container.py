"""A release: made twice with the same bytes, and installed in an empty container without a clone.

The container has this machine's /usr, and nothing else of it. Its package registry is a folder of
what pip has fetched outside; the commands are those of docs/release.md.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from documents import commands

PROJECT = Path(__file__).parents[2]
TIMEOUT_S = 2400
pytestmark = [
    pytest.mark.rig_systemd,
    pytest.mark.thorough,  # two builds of the Debian package
    pytest.mark.timeout(2 * TIMEOUT_S),
]


def released(clone: Path) -> Path:
    """Make a release of a clone that uses the programs of this environment."""
    environment = clone / ".venv"
    environment.mkdir()
    (environment / "bin").symlink_to(Path(sys.executable).parent)
    for stamp in ("run.stamp", "dev.stamp"):
        (environment / stamp).touch()  # nothing of the clone is installed into it
    made = subprocess.run(
        ("bash", "scripts/release.sh"), cwd=clone, check=False, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stdout + made.stderr
    assert "git tag --annotate v" in made.stdout
    return clone / "out" / "release"


@pytest.fixture(scope="module")
def releases(tmp_path_factory):
    """Two releases of this commit, each from a clone of its own."""
    made, source = [], PROJECT
    for name in ("first", "second"):
        clone = tmp_path_factory.mktemp("release") / name
        subprocess.run(("git", "clone", "--quiet", source, clone), check=True)
        made.append(released(clone))
        source = clone  # so that a commit meanwhile makes no difference
    return made


def test_a_release_made_twice_has_the_same_bytes(releases):
    first, second = ((one / "SHA256SUMS").read_text().splitlines() for one in releases)

    assert len(first) > len(list(PROJECT.glob("clients/*/pyproject.toml")))
    assert first == second


def in_an_empty_container(rig_type, release, wheels):
    """The rig without the project and its environment, and without a network."""

    class Empty(rig_type):
        def command(self, script, folder, also=()):
            words = super().command(script, folder, also)
            words = [word for word in words if not word.startswith("--bind-ro=")]
            at = words.index("--boot")
            binds = [f"--bind-ro={release}:/release", f"--bind-ro={wheels}:/wheels"]
            return [*words[:at], "--private-network", *binds, *words[at:]]

    return Empty()


def test_the_demonstration_is_played_in_two_commands_without_a_clone(
    systemd_rig, releases, tmp_path
):
    release, wheels = releases[0], tmp_path / "wheels"
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    fetch = (*pip, "download", "--require-hashes", "-r", "demo.txt", "-d", str(wheels))
    subprocess.run(fetch, cwd=release, check=True)
    lines = [one.text for one in commands(PROJECT / "docs" / "release.md")]
    outside = tmp_path / "seen"
    outside.mkdir()
    script = "\n".join(
        (
            f"! test -e {PROJECT}",
            "export PATH=/usr/bin:/bin HOME=/srv/user PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels",
            "ip link set lo up",
            "mkdir -p /srv/user && cp -r /release /srv/user/release && cd /srv/user/release",
            *lines,
            f"cp out/demo.png {outside}",
        )
    )

    finished = in_an_empty_container(type(systemd_rig), release, wheels).run(
        script, outside, TIMEOUT_S
    )

    assert finished.exit_code == 0, finished.output[-4000:]
    assert (outside / "demo.png").stat().st_size > 0
