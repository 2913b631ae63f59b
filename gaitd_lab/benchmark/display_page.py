"""The patient's page in headless Chromium on a service in real time, with both legs walking.

Measured are the age of a sample when it is painted, and the frames per second: as they are, and in
a browser that is slowed to a sixth, like a cheap tablet.

The age is from the core's SYNC, by the computer's time of day, to the turn of the page's animation
loop that paints it. It contains the cycle, gateway, Zenoh, the display's server and the browser.
"""

# pyright: reportMissingImports=false
# Playwright is of the extra `rigs`; the types are checked without it as well.

import contextlib
import importlib.util
import shutil
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from gaitd_client import Mode, RequestRefusedError, Safety, Stage, Trainer
from gaitd_client.connection import Target

from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.demonstration.clients import address_of, patient_settings, start_client
from gaitd_lab.process_memory import sample
from gaitd_lab.processes import ServiceError, Tempo, free_port
from gaitd_lab.timed_service import timed_service, until_ready, warm_up

CHROMIUM: Final = "chromium"
BROWSER_ARGUMENTS: Final = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
READY_WITHIN_S: Final = 60.0
POLL_S: Final = 0.1
LOAD_TRIES: Final = 200
LOAD_POLL_MS: Final = 100
HIGH_RATIO: Final = 0.99
MS_PER_S: Final = 1000
SETTLE_MS: Final = 3000
TRAINER_FILE: Final = "two_legs.toml"
CADENCE_HZ: Final = 0.3
AMPLITUDE_RATIO: Final = 0.5
BEFORE_GAIT_S: Final = 60.0
"""Longest time from READY to a gait that plays."""
SLOWED: Final = 6
"""The browser's processor is slower by this factor."""
START: Final = "() => { painted.ages.length = 0; painted.frames = 0; }"
MEDIAN_MAX_MS: Final = 40.0
HIGH_MAX_MS: Final = 100.0
FRAMES_MIN_HZ: Final = 30.0
RESULT: Final = """() => ({
    ages: painted.ages, frames: painted.frames, layout: document.body.dataset.layout,
})"""


def lacks() -> str | None:
    """Return what this machine lacks for the measurement; None if nothing."""
    for package in ("playwright", "gaitd_display"):
        if importlib.util.find_spec(package) is None:
            return f"{package} is not installed"
    return None if shutil.which(CHROMIUM) else f"{CHROMIUM} is not installed"


def measure(configs: Path, seconds: float) -> list[Figure]:
    """Measure the page of a running service for so many seconds; nothing without a browser.

    Raises:
        ServiceError: a process ended, or the page did not come.
    """
    if (lack := lacks()) is not None:
        print(f"display: skipped, {lack}; `make rigs` installs what it needs", file=sys.stderr)
        return []
    warm_up(configs, TRAINER_FILE)
    port = free_port()
    with (
        timed_service(configs, Tempo(wall_clock=True), TRAINER_FILE) as made,
        contextlib.ExitStack() as ending,
    ):
        server = start_client("patient", made, patient_settings(made, port))
        ending.callback(server.end)
        until_ready(made, READY_WITHIN_S)
        _walk(made.target, seconds)
        server.check()
        return _page(address_of(port), server.pid, seconds)


def _walk(target: Target, seconds: float) -> None:
    """Begin a gait of both legs, which plays longer than what is measured.

    Raises:
        ServiceError: it did not begin.
    """
    with Trainer(target.endpoints[0], trainer=target.trainer) as trainer:
        asks: dict[str | None, Callable[[], object]] = {
            Mode.FAULT: trainer.reset,  # a computer that was busy for a moment has stopped it
            Mode.READY: trainer.enable,
            Mode.HOLD: lambda: trainer.mode(
                Mode.GAIT,
                cadence_hz=CADENCE_HZ,
                amplitude_ratio=AMPLITUDE_RATIO,
                duration_s=2 * seconds + BEFORE_GAIT_S,
            ),
        }
        safety, end_s = trainer.safety(), time.monotonic() + BEFORE_GAIT_S
        while time.monotonic() < end_s:
            now = safety.newest()
            if isinstance(now, Safety) and now.stage == Stage.PLAYING:
                return
            if isinstance(now, Safety) and now.mode in asks:
                with contextlib.suppress(RequestRefusedError):  # the leg does not rest yet
                    asks[now.mode]()
            time.sleep(POLL_S)
    raise ServiceError(f"no gait plays after {BEFORE_GAIT_S:g} s")


def _page(address: str, server_pid: int, seconds: float) -> list[Figure]:
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        program = shutil.which(CHROMIUM)
        before_pids = _pids(CHROMIUM)
        browser = playwright.chromium.launch(executable_path=program, args=list(BROWSER_ARGUMENTS))
        try:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            for _ in range(LOAD_TRIES):
                try:
                    page.goto(address)
                    break
                except Error:
                    page.wait_for_timeout(LOAD_POLL_MS)
            page.wait_for_timeout(SETTLE_MS)
            pids = _pids(CHROMIUM) - before_pids
            before = _cpu_s((server_pid,)), _cpu_s(pids)
            page.evaluate(START)
            page.wait_for_timeout(seconds * MS_PER_S)
            found: dict[str, Any] = page.evaluate(RESULT)
            after = _cpu_s((server_pid,)), _cpu_s(pids)
            used = before, after
            server_mb = _memory_mb((server_pid,))
            wire = page.context.new_cdp_session(page)
            wire.send("Emulation.setCPUThrottlingRate", {"rate": SLOWED})
            page.evaluate(START)
            page.wait_for_timeout(seconds * MS_PER_S)
            slowed: dict[str, Any] = page.evaluate(RESULT)
        finally:
            browser.close()
    if slowed["layout"] != "walk":
        raise ServiceError("the gait has ended before the measurement has: was the computer busy?")
    ages = sorted(found["ages"])
    if not ages:
        raise ServiceError("the page painted no sample: has the service messages?")
    what = "sample when painted on the patient's page, age"
    high_ms = ages[int(HIGH_RATIO * (len(ages) - 1))]
    slow = f"frames in a browser slowed {SLOWED} times"
    server_ratio, browser_ratio = (
        (end - begun) / seconds for begun, end in zip(*used, strict=True)
    )
    return [
        Figure(
            what=f"{what}, median", value=statistics.median(ages), unit="ms", at_most=MEDIAN_MAX_MS
        ),
        Figure(what=f"{what}, 99 %", value=high_ms, unit="ms", at_most=HIGH_MAX_MS),
        Figure(
            what="frames of the page",
            value=found["frames"] / seconds,
            unit="/s",
            at_least=FRAMES_MIN_HZ,
        ),
        Figure(what=slow, value=slowed["frames"] / seconds, unit="/s", at_least=FRAMES_MIN_HZ),
        Figure(what="server of the page", value=100 * server_ratio, unit="% of a processor"),
        Figure(what="browser", value=100 * browser_ratio, unit="% of a processor"),
        Figure(what="memory of the server", value=server_mb, unit="MB"),
    ]


def _pids(program: str) -> frozenset[int]:
    """Processes whose executable has this name."""
    found = set[int]()
    for place in Path("/proc").iterdir():
        if place.name.isdigit():
            try:
                name = (place / "comm").read_text().strip()
            except (FileNotFoundError, ProcessLookupError):
                continue
            if name == program:
                found.add(int(place.name))
    return frozenset(found)


def _cpu_s(pids: Sequence[int] | frozenset[int]) -> float:
    return sum(one.cpu_s for pid in pids if (one := sample(pid, 0.0)) is not None)


def _memory_mb(pids: Sequence[int] | frozenset[int]) -> float:
    """Resident memory; pages that several processes share count for each."""
    return sum(one.rss_mb for pid in pids if (one := sample(pid, 0.0)) is not None)
