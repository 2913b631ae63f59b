"""A training session of `gaitd demo --session` with both pages open in a browser.

Screenshots are written to out/display; with --write-pages that of README to docs/patient.png.
"""

import re
import subprocess
import sys
from types import SimpleNamespace

import browser as rig
import pytest
from documents import PROJECT

from gaitd_lab.processes import free_port

pytestmark = [pytest.mark.rig_browser, pytest.mark.timeout(600)]
SIZE = (1280, 800)


@pytest.fixture(scope="module")
def chromium():
    with rig.chromium() as chromium:
        yield chromium


def until(demo, text):
    """Read what the demonstration prints, until a line has this text; return the line."""
    for line in demo.stdout:
        if text in line:
            return line
    raise AssertionError(f"the demonstration has ended without {text!r}")


def opened(chromium, demo, page, folder):
    """A page of the demonstration, once its server listens."""
    line = until(demo, f"the {page}'s page: ")
    site = SimpleNamespace(address=re.search(r"http://\S+(?=/)", line)[0])
    return line, lambda: rig.Tab(chromium, site, folder, size=SIZE)


@pytest.mark.thorough
def test_both_pages_show_a_session_that_is_walked(chromium, pytestconfig):
    ports = (str(free_port()) for _ in range(2))
    words = [sys.executable, "-u", "-m", "gaitd", "demo", "--session", "--headless"]
    for option, port in zip(("--patient-port", "--therapist-port"), ports, strict=True):
        words += [option, port]
    for_readme = PROJECT / "docs" if pytestconfig.option.write_pages else rig.SHOTS
    with subprocess.Popen(
        [*words, "--engineer-port", "0"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as demo:
        _, open_patient = opened(chromium, demo, "patient", for_readme)
        told, open_therapist = opened(chromium, demo, "therapist", rig.SHOTS)
        until(demo, "daily test")
        patient, therapist = open_patient(), open_therapist()
        therapist.page.fill("input[type=password]", told.split()[-1])
        therapist.page.keyboard.press("Enter")
        until(demo, "block 2 of 3")
        patient.until("document.body.dataset.word === 'good'", within_s=60)
        patient.shot("patient")
        therapist.shot("therapist_session")
        assert therapist.page.locator("input[type=password]").count() == 0
        until(demo, "3 blocks walked, no interruption")
        for tab in (patient, therapist):
            assert tab.errors == []
            assert tab.foreign == []
            tab.page.close()
    assert demo.returncode == 0
