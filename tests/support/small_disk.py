"""File systems of some megabytes that are really full; only root may mount them."""

import subprocess

import pytest


def mount(place, size, *options):
    place.mkdir(parents=True, exist_ok=True)
    settings = ",".join((f"size={size}", *options))
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", settings, "tmpfs", str(place)],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode != 0:
        pytest.skip(f"no file system may be mounted here: {made.stderr.strip()}")


def unmount(place):
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def fill(place):
    """Not a byte is left."""
    with (place / "rubbish").open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(65536))
        except OSError:
            pass
