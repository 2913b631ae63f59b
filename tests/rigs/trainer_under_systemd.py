"""The service under a real systemd, step by step; runs inside the container, as root.

Each step brings the service to where it begins, does one thing to it, and returns what was seen;
all of it goes into one file, which `test_service_under_systemd.py` reads. A step that fails leaves
its reason in the place of what it saw, and the next ones go on.

Time is the computer's, and a container has no real-time scheduling: where the computer stalls, the
drives stop, rightly. So a mode is asked for again, a step is played a second time if it failed, and
nothing here depends on how long something takes.
"""

import contextlib
import json
import socket
import subprocess
import sys
import time
import traceback
import urllib.error
import urllib.request
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TypeVar

import msgspec
from gaitd_client import ClientError
from gaitd_client.connection import Target, open_session, query
from gaitd_names import Mode

from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RING_NAME, RingError, RingReader

RUNTIME = Path("/run/gaitd")
CONFIG = Path("/etc/gaitd/trainer.toml")
CONTROL = Path("/run/gaitd-sim/control")
BUS_DROP_IN = Path("/etc/systemd/system/gaitd-core.service.d/20-gaitd-bus.conf")
SIM_UNIT = Path("/etc/systemd/system/gaitd-sim.service")
ADMITTED = " --admit-simulated"
PAGES = {"patient": 8080, "therapist": 8443}
PAGES_FOLDER = Path("/etc/gaitd-display")
PASSWORD = "correct horse battery staple"
SESSION_TABLE = """
[session]
profile = "7f3k9m2q.toml"
history = "/var/lib/gaitd-patient/history.sqlite"
"""
TARGET = Target(("tcp/127.0.0.1:7447",), "trainer")
CORE, GATEWAY, SIM = "gaitd-core", "gaitd-gateway", "gaitd-sim"
POLL_S = 0.05
TIMEOUT_S = 90
TRIES = 6
STEP_TRIES = 2
GAIT = {"mode": "gait", "cadence_hz": 0.3, "amplitude_ratio": 0.6, "duration_s": 600.0}
SETTLED = {Mode.READY, Mode.FAULT, Mode.HOLD, Mode.GAIT}
OPERATION_ENABLED = 5
"""drives.signals.PowerState, as records have it."""
FAST, STILL = (0.1, 0.05), (0.05, 0.03)
"""rad/s and m/s."""
SILENT_S = 60
Seen = dict[str, object]
Found = TypeVar("Found")


# --- systemd ------------------------------------------------------------------------------------


def run(*words: str) -> str:
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    return (ended.stdout + ended.stderr).strip()


def shown(unit: str, name: str) -> str:
    return run("systemctl", "show", "--value", f"--property={name}", unit)


def status(unit: str, code: str) -> str:
    """Its STATUS=, if it ends with this code."""
    text = shown(unit, "StatusText")
    return text if text.endswith(f"[{code}]") else ""


def pid(unit: str) -> int:
    return int(shown(unit, "MainPID"))


def journal(unit: str) -> str:
    run("journalctl", "--sync")  # a program that has just ended may have words on their way
    return run("journalctl", "--no-pager", "--output=cat", f"--unit={unit}")


def wait(reached: Callable[[], Found], what: str, within_s: float = TIMEOUT_S) -> Found:
    """What it was, once there is anything of it."""
    end_s = time.monotonic() + within_s
    while time.monotonic() < end_s:
        with contextlib.suppress(FileNotFoundError, RingError):
            if found := reached():
                return found
        time.sleep(POLL_S)
    raise AssertionError(f"never: {what}; {shown(CORE, 'StatusText')}")


# --- the service --------------------------------------------------------------------------------


def newest() -> CycleRecord:
    with contextlib.closing(RingReader(RUNTIME / RING_NAME)) as ring:
        record = ring.read(ring.newest_seq())
    if record is None:
        raise FileNotFoundError("no record yet")
    return record


def records() -> list[CycleRecord]:
    with contextlib.closing(RingReader(RUNTIME / RING_NAME)) as ring:
        return ring.since(0)


def boot_id() -> str:
    with contextlib.closing(RingReader(RUNTIME / RING_NAME)) as ring:
        return ring.header.core_boot_id


def ask(name: str, **payload: object) -> dict[str, object]:
    data = msgspec.json.encode({"client": "tester", **payload} if payload else {})
    try:
        with open_session(TARGET) as session:
            return json.loads(query(session, TARGET, name, data))
    except ClientError:
        return {"outcome": "unanswered"}


def done(name: str, **payload: object) -> bool:
    return ask(name, **payload)["outcome"] == "done"


def inject(line: str) -> str:
    own = Path(f"/run/tester{time.monotonic_ns()}")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(own))
        own.chmod(0o666)
        end.settimeout(5)
        end.sendto(line.encode(), str(CONTROL))
        answer = end.recv(4096).decode()
    own.unlink()
    return answer


def still(record: CycleRecord) -> bool:
    return all(
        abs(one.velocity or 0.0) < speed for one, speed in zip(record.drives, STILL, strict=True)
    )


def walks(record: CycleRecord) -> bool:
    fast = any(
        abs(one.velocity or 0.0) > speed for one, speed in zip(record.drives, FAST, strict=True)
    )
    return record.mode == Mode.GAIT and fast


def heard() -> bool:
    """The gateway that runs now hears the core that runs now."""
    answer = ask("status")
    safety = answer.get("safety")
    return isinstance(safety, dict) and safety["valid"] and answer["core_boot_id"] == boot_id()


def bring(mode: Mode) -> None:
    """Into READY, HOLD or GAIT, from wherever it is; a stall of the computer costs another try."""
    for _ in range(TRIES):
        run("systemctl", "reset-failed", CORE, GATEWAY, SIM)
        run("systemctl", "start", SIM, "gaitd.target")
        wait(heard, "the gateway hears the core")
        wait(lambda: newest().mode in SETTLED, "the core has settled")
        if newest().mode == Mode.FAULT:
            wait(lambda: done("reset"), "a reset")
            wait(lambda: newest().mode in {Mode.READY, Mode.FAULT}, "ready after the reset")
        if _asked(mode):
            return
    raise AssertionError(f"never in {mode.name}: {newest().verdict}")


def nothing_runs() -> None:
    """As before the first start; new virtual drives have no faults."""
    run("systemctl", "stop", "gaitd.target", CORE, GATEWAY, SIM)
    run("systemctl", "reset-failed", CORE, GATEWAY, SIM)


def _asked(mode: Mode) -> bool:
    with contextlib.suppress(AssertionError):
        if mode == Mode.READY:
            return newest().mode == Mode.READY or done("disable")
        if newest().mode == Mode.READY:
            wait(lambda: done("enable") or newest().mode != Mode.READY, "enabled", 20)
        if newest().mode != mode and not done(
            "mode", **(GAIT if mode == Mode.GAIT else {"mode": "hold"})
        ):
            return False
        there = walks if mode == Mode.GAIT else still
        wait(lambda: there(newest()) or newest().mode == Mode.FAULT, mode.name, 30)
        return newest().mode == mode
    return False


# --- steps --------------------------------------------------------------------------------------


def a_typo() -> Seen:
    right = CONFIG.read_text()
    CONFIG.write_text(right.replace("period_ms = 10", "perod_ms = 10"))
    run("systemctl", "start", CORE, GATEWAY)
    seen = {
        name: {key: shown(name, key) for key in ("ExecMainStatus", "NRestarts", "ActiveState")}
        for name in (CORE, GATEWAY)
    }
    CONFIG.write_text(right)
    said = journal(CORE)
    run("systemctl", "reset-failed", CORE, GATEWAY)
    return {**seen, "said": said}


def start() -> Seen:
    nothing_runs()
    run("systemctl", "start", SIM)
    run("systemctl", "start", "gaitd.target")
    at_once = shown(CORE, "ActiveState")
    wait(lambda: newest().mode == Mode.READY, "ready")
    core = wait(lambda: status(CORE, "ready"), "a status that says so")
    gateway = wait(lambda: status(GATEWAY, "ready"), "a gateway that says so")
    process = Path(f"/proc/{pid(CORE)}/status").read_text().splitlines()
    return {
        "at_once": at_once,
        "active": [shown(name, "ActiveState") for name in ("gaitd.target", CORE, GATEWAY)],
        "core": core,
        "gateway": gateway,
        "process": dict(line.split(":\t", 1) for line in process if ":\t" in line),
        "users": {name: shown(name, "User") for name in (CORE, GATEWAY)},
    }


def silent_drive() -> Seen:
    bring(Mode.HOLD)
    before, restarts = pid(CORE), shown(CORE, "NRestarts")
    answer = inject(f"silent right/hip {SILENT_S + 5}")
    wait(lambda: newest().mode == Mode.FAULT, "a fault")
    wait(lambda: still(newest()) and newest().drives[1].fresh, "the other axis at rest")
    begun_s, first, places = time.monotonic(), newest(), []
    while time.monotonic() < begun_s + SILENT_S:
        slide = newest().drives[1]
        places += [slide.position] if slide.fresh else []
        time.sleep(1)
    last = newest()
    safety = ask("status")["safety"]
    return {
        "answer": answer,
        "same_process": pid(CORE) == before and shown(CORE, "NRestarts") == restarts,
        "cycles": last.cycle - first.cycle,
        "slide_places_m": places,
        "slide_state": last.drives[1].power_state,
        "status": shown(CORE, "StatusText"),
        "published": safety,
        "watchdog": "Watchdog timeout" in journal(CORE),
    }


def reload() -> Seen:
    bring(Mode.READY)
    before = pid(CORE), pid(GATEWAY)
    run("systemctl", "reload", CORE, GATEWAY)
    said = ("reload requested: the core", "reloaded: ")
    wait(lambda: all(one in journal(GATEWAY) for one in said), "a word of it from each half")
    return {"same_processes": (pid(CORE), pid(GATEWAY)) == before}


def walk() -> Seen:
    bring(Mode.GAIT)
    text = wait(lambda: status(CORE, "gait"), "a status that says so")
    told = [record for record in records() if walks(record)]
    return {
        "walking_cycles": len(told),
        "enabled": all(one.power_state == OPERATION_ENABLED for one in told[-1].drives),
        "status": text,
    }


def _after_a_death(before: str) -> Seen:
    """What the next core does without a request."""
    wait(lambda: boot_id() != before, "another core")
    wait(lambda: newest().mode in {Mode.READY, Mode.FAULT}, "it has settled")
    time.sleep(2)
    told = records()
    return {
        "modes": list(dict.fromkeys(record.mode.name for record in told)),
        "enabled": any(one.power_state == OPERATION_ENABLED for one in newest().drives),
        "status": shown(CORE, "StatusText"),
        "active": shown(CORE, "ActiveState"),
        "restarts": int(shown(CORE, "NRestarts")),
    }


def watchdog() -> Seen:
    bring(Mode.GAIT)
    before, restarts, process = boot_id(), int(shown(CORE, "NRestarts")), pid(CORE)
    run("kill", "-STOP", str(process))
    seen = _after_a_death(before)
    return {
        **seen,
        "restarts": int(str(seen["restarts"])) - restarts,
        "journal": journal(CORE)[-4000:],
    }


def killed() -> Seen:
    bring(Mode.GAIT)
    before, restarts = boot_id(), int(shown(CORE, "NRestarts"))
    run("kill", "-KILL", str(pid(CORE)))
    seen = _after_a_death(before)
    return {**seen, "restarts": int(str(seen["restarts"])) - restarts}


def gateway_killed() -> Seen:
    bring(Mode.GAIT)
    core, gateway, before = pid(CORE), pid(GATEWAY), boot_id()
    run("kill", "-KILL", str(gateway))
    wait(lambda: newest().mode in {Mode.HOLD, Mode.FAULT} and still(newest()), "at rest")
    told = newest()
    wait(
        lambda: shown(GATEWAY, "ActiveState") == "active" and pid(GATEWAY) != gateway, "it is back"
    )
    wait(heard, "it hears the core")
    time.sleep(1)
    return {
        "same_core": pid(CORE) == core and boot_id() == before,
        "mode": told.mode.name,
        "mode_after": newest().mode.name,
        "cause": newest().verdict.cause.name,
    }


def stop() -> Seen:
    bring(Mode.GAIT)
    said: list[str] = []

    def inactive() -> bool:
        said.append(shown(CORE, "StatusText"))
        return all(shown(name, "ActiveState") == "inactive" for name in (CORE, GATEWAY))

    # It waits for the target alone, not for what is part of it.
    run("systemctl", "stop", "gaitd.target")
    wait(inactive, "both halves have stopped")
    told = records()[-300:]
    walked = max(at for at, record in enumerate(told) if record.mode == Mode.GAIT)
    last = told[walked + 1 :]
    stamps = {
        f"{name} {key}": int(shown(name, f"{key}TimestampMonotonic"))
        for name in (CORE, GATEWAY)
        for key in ("InactiveEnter", "ActiveExit")
    }
    return {
        "said": list(dict.fromkeys([*said, shown(CORE, "StatusText")])),
        "modes": list(dict.fromkeys(record.mode.name for record in last)),
        "at_rest": still(told[-1]),
        "powered_while_moving": all(
            any(one.power_state in {OPERATION_ENABLED, 6} for one in record.drives)
            for record in last
            if not still(record)
        ),
        "enabled": any(one.power_state == OPERATION_ENABLED for one in told[-1].drives),
        "stamps": stamps,
        "result": [shown(name, "Result") for name in (CORE, GATEWAY)],
        "status": [shown(name, "ExecMainStatus") for name in (CORE, GATEWAY)],
    }


def wrong_drive() -> Seen:
    nothing_runs()
    bring(Mode.READY)
    inject("wrong_identity right/hip - 4711")
    run("systemctl", "stop", CORE)
    run("systemctl", "start", CORE)
    wait(lambda: shown(CORE, "ActiveState") == "failed", "refused")
    time.sleep(3)
    seen = {key: shown(CORE, key) for key in ("ExecMainStatus", "NRestarts", "ActiveState")}
    return {**seen, "said": journal(CORE)[-3000:]}


def simulated_time() -> Seen:
    """What the core says of a simulated bus: as shipped, and where only the drop-in admits it."""
    nothing_runs()
    with _changed(BUS_DROP_IN, ADMITTED, ""):
        run("systemctl", "start", CORE)
        wait(lambda: shown(CORE, "ActiveState") == "failed", "refused")
        refused = {key: shown(CORE, key) for key in ("ExecMainStatus", "NRestarts")}
    nothing_runs()
    with _changed(SIM_UNIT, " --wall-clock", ""):
        run("systemctl", "start", SIM, CORE)
        waits = wait(lambda: _says("--wall-clock"), "a status that says why")
        restarts = shown(CORE, "NRestarts")
        nothing_runs()
    return {"refused": refused, "said": journal(CORE)[-3000:], "waits": waits, "restarts": restarts}


def _says(word: str) -> str:
    text = shown(CORE, "StatusText")
    return text if word in text else ""


@contextlib.contextmanager
def _changed(drop_in: Path, old: str, new: str) -> Generator[None]:
    right = drop_in.read_text()
    assert old in right, drop_in
    drop_in.write_text(right.replace(old, new))
    run("systemctl", "daemon-reload")
    try:
        yield
    finally:
        drop_in.write_text(right)
        run("systemctl", "daemon-reload")


def pages() -> Seen:
    """Both servers as they are shipped, with a profile; the history is that of the patient's."""
    sys.path.insert(0, "/opt/source/tests/support")
    from training import PROFILE

    made = subprocess.run(
        ("/opt/gaitd/bin/gaitd-display", "password"),
        input=PASSWORD + "\n",
        capture_output=True,
        text=True,
        check=True,
    )
    profile = PAGES_FOLDER / "7f3k9m2q.toml"
    profile.write_text(PROFILE)
    run("chgrp", "gaitd-training", str(profile))
    profile.chmod(0o640)
    for name in PAGES:
        file = PAGES_FOLDER / f"{name}.toml"
        text = file.read_text().replace('password_hash = "scrypt$"', made.stdout.splitlines()[-1])
        file.write_text(text + SESSION_TABLE)
    run("systemctl", "start", *(f"gaitd-{name}" for name in PAGES))
    alive = {name: wait(lambda name=name: _answer(name, "/alive")[0], name) for name in PAGES}
    _, cookie = _answer("therapist", "/login", {"password": PASSWORD})
    progress = json.loads(_answer("therapist", "/progress.json", cookie=cookie)[0])
    users = {name: shown(f"gaitd-{name}", "User") for name in PAGES}
    run("systemctl", "stop", *(f"gaitd-{name}" for name in PAGES))
    results = {name: shown(f"gaitd-{name}", "Result") for name in PAGES}
    return {"alive": alive, "progress": progress, "users": users, "results": results}


def _answer(page: str, path: str, body: Seen | None = None, *, cookie: str = "") -> tuple[str, str]:
    """Body and cookie of an answer; empty while nothing listens."""
    origin = f"http://127.0.0.1:{PAGES[page]}"
    data = None if body is None else json.dumps(body).encode()
    asked = urllib.request.Request(origin + path, data, {"Origin": origin, "Cookie": cookie})
    try:
        with urllib.request.urlopen(asked, timeout=TIMEOUT_S) as answer:
            return answer.read().decode(), (answer.headers["set-cookie"] or "").partition(";")[0]
    except urllib.error.HTTPError:
        raise
    except urllib.error.URLError:
        return "", ""


UNITS = Path("/usr/lib/systemd/system")
RUNTIME_UNITS = Path("/run/systemd/system")
OUT_OF_PROBES = ("ExecStart=", "Type=", "Watchdog", "Restart", "NotifyAccess", "PartOf=", "After=")
PROBE = "ExecStart=/opt/gaitd/bin/python /opt/source/tests/rigs/probe.py"


def probes() -> Seen:
    """From inside: what the unit of each half allows as it is shipped, and what any other unit."""
    bring(Mode.READY)
    ask("stop", client="tester")
    wait(Path("/var/lib/gaitd/requests.jsonl").exists, "a request log")
    other = "[Service]\nUser=nobody\n"
    texts = {name: (UNITS / f"{name}.service").read_text() for name in (CORE, GATEWAY)}
    seen = {name: _probe(name, text) for name, text in {**texts, "other": other}.items()}
    return {**seen, "any_unit": shown("gaitd-probe-other", "RestrictAddressFamilies")}


def _probe(name: str, text: str) -> object:
    """The unit with another program, and with the drop-ins that are shipped for it, no others."""
    unit = f"gaitd-probe-{name}"
    kept = [line for line in text.splitlines() if not line.startswith(OUT_OF_PROBES)]
    at = kept.index("[Service]") + 1
    kept[at:at] = [PROBE, "Type=oneshot", "LimitRTPRIO=0", "LimitMEMLOCK=8M"]
    own = [
        line
        for line in kept
        if not line.startswith("LimitRTPRIO=6") and line != "LimitMEMLOCK=infinity"
    ]
    (RUNTIME_UNITS / f"{unit}.service").write_text("\n".join(own) + "\n")
    shipped = UNITS / f"{name}.service.d" / "10-gaitd-no-can.conf"
    if shipped.exists():
        folder = RUNTIME_UNITS / f"{unit}.service.d"
        folder.mkdir(exist_ok=True)
        (folder / shipped.name).write_text(shipped.read_text())
    run("systemctl", "daemon-reload")
    run("systemctl", "start", unit)
    said = [line for line in journal(unit).splitlines() if line.startswith("{")]
    return json.loads(said[-1]) if said else journal(unit)


STEPS = (
    pages,
    a_typo,
    start,
    probes,
    reload,
    silent_drive,
    walk,
    gateway_killed,
    watchdog,
    killed,
    stop,
)


def played(step: Callable[[], Seen]) -> Seen:
    """What it saw; with the reason of a first try that failed, or of both."""
    failures: list[str] = []
    for _ in range(STEP_TRIES):
        try:
            return {**step(), "failed_before": failures}
        except Exception:  # noqa: BLE001 - told in the place of what was to be seen
            log = run("journalctl", "--no-pager", "--lines=60")
            failures.append(traceback.format_exc() + log)
    return {"failed": "\n".join(failures)}


def main(path: Path) -> None:
    seen: dict[str, Seen] = {}
    for step in (*STEPS, wrong_drive, simulated_time):
        begun_s = time.monotonic()
        seen[step.__name__] = {**played(step), "took_s": round(time.monotonic() - begun_s, 1)}
        path.write_text(json.dumps(seen, indent=1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
