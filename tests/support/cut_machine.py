"""Inside the machine whose power is cut: one life of it, from its boot until it is killed.

    python cut_machine.py PHASE      the service with its files on DISK, brought into PHASE

Each line of JSON on stdout is something said to the host (`said`), which must not be lost with this
machine: the host judges it, and after the kill the disk. Beside the service run its recorder, a
program that keeps sessions and keys by the product's own functions, and a watch of the ring. Their
programs are forked, as `rig_service.py` has it; of them only what is on DISK outlives the kill.
"""

import gc
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gaitd_names import Mode
from rig_service import Inside, _import_all, warm
from scenarios import GAIT, MEMORY, cycles, ready_again, shell, walks

from daemon.core.runtime.texts import verdict_text
from daemon.ipc.record import CycleRecord
from daemon.ipc.ring_clip import FOLDER, SUFFIX
from daemon.ipc.transport import RingError
from daemon.keys.folder import CLIENTS, ISSUED, read_keys
from daemon.keys.issuing import init, issue
from drives.signals import PowerState

DISK = Path("/run/disk")
"""Where the image is mounted."""
PROFILE = "patient"
PULSE_S = 0.1
KEEP_S = 0.5
SETTLED_S = 1.0
"""After this a line of the request log is on the disk (docs/black_box.md)."""
REST_CYCLES = 100
PHASES = ("starting", "ready", "hold", "gait", "stop")
LAST = "end"
"""The life that is not killed."""


def said(**facts: object) -> None:
    """Say it to the host, with the time of this machine; one write, so that no line is cut."""
    os.write(1, (json.dumps({"at_s": time.monotonic(), **facts}) + "\n").encode())


def beside(job: Callable[[], None]) -> int:
    """A process that does something until this machine has no power; its process id."""
    pid = os.fork()
    if pid == 0:
        try:
            job()
        except BaseException:  # noqa: BLE001 - a child must not return into its parent's code
            said(trouble=traceback.format_exc())
        os._exit(1)
    return pid


def clips() -> list[str]:
    return sorted(path.name for path in (DISK / "state" / FOLDER).glob(f"*{SUFFIX}"))


def watch(service: Inside) -> None:
    """What the core does and which clips there are, again and again."""
    while True:
        time.sleep(PULSE_S)
        try:
            record = service.newest()
        except (FileNotFoundError, RingError):
            continue
        said(
            pulse=record.mode.name,
            cause=record.verdict.cause.name,
            utc_ns=record.sync_utc_ns,
            clips=clips(),
        )


def keep() -> None:
    """Sessions and keys: what the disk has of those of before, and then ever more of them."""
    from gaitd_session.store import SessionRow, Store, StrideRow

    now, keys = datetime.now(UTC), DISK / "keys"
    with Store(DISK / "sessions.db", is_writer=True) as store:
        strides = [row[8] for row in store.strides(PROFILE)]
        if not (keys / CLIENTS).exists():
            init(keys, "trainer", (), now, 10)
        clients = [client.name for client in read_keys(keys).register.clients]
        said(strides=strides, clients=[one for one in clients if (keys / ISSUED / one).is_dir()])
        store.write([SessionRow(PROFILE, "trainer", time.time_ns())])
        number = max(strides, default=0)
        while True:
            number += 1
            stride = StrideRow(1, "right", number, 2.0, 0.5, 0.1, 1.0, -1.0, is_valid=True)
            store.write([stride])
            said(stride=number)
            issue(keys, f"display.n{number}", (), "trainer", now, 10, remote=False)
            said(client=f"display.n{number}")
            time.sleep(KEEP_S)


def asked(service: Inside, name: str, wanted: str = "done", **payload: object) -> None:
    """Ask until it is answered as wanted; each answer is said."""

    def answered() -> bool:
        answer = service.request(name, **payload)
        said(asked=name, outcome=answer["outcome"], refusal=answer["refusal"])
        return answer["outcome"] == wanted

    service.wait(answered)


def found(service: Inside) -> CycleRecord:
    """What this start has made of the end before it; nothing moves and nothing may be enabled."""
    begun = service.until(lambda record: record.mode in {Mode.READY, Mode.FAULT})
    cycles(service, REST_CYCLES)
    if begun.mode == Mode.FAULT:
        asked(service, "enable", "refused")
    records = service.records(begun.seq - 1)
    said(
        found=begun.mode.name,
        cause=begun.verdict.cause.name,
        verdict=verdict_text(begun.verdict),
        modes=sorted({record.mode.name for record in records}),
        powers=sorted({PowerState(d.power_state).name for r in records for d in r.drives}),
        path_si=[
            max(positions) - min(positions)
            for positions in zip(
                *(tuple(d.position or 0.0 for d in r.drives) for r in records), strict=True
            )
        ],
        core=service.log("core"),
        gateway=service.log("gateway"),
    )
    return begun


def recorder_said(service: Inside) -> list[dict[str, Any]]:
    return [json.loads(one) for one in service.log("record").splitlines() if one.startswith("{")]


def live(phase: str) -> None:
    """The whole life; returns only if it is the last one."""
    service = Inside(MEMORY / "power")
    for name in ("state", "recordings"):
        (DISK / name).mkdir(exist_ok=True)
    (service.folder / "state").mkdir()
    shell(f"mount --bind {DISK}/state {service.folder}/state")
    try:
        said(mounted=shell("dmesg | grep EXT4-fs").splitlines())
        service.start_drives()
        helpers = [beside(lambda: watch(service)), beside(keep)]
        said(started=True)
        service.start("core")
        service.start("gateway")
        service.until(lambda record: record.mode in {Mode.READY, Mode.FAULT})
        service.start("record", "--output", str(DISK / "recordings"), "--json")
        _go(service, phase, helpers)
    except BaseException:
        said(
            trouble=traceback.format_exc(), logs={part: service.log(part) for part in service.parts}
        )
        raise


def _go(service: Inside, phase: str, helpers: list[int]) -> None:
    if found(service).mode == Mode.FAULT:
        ready_again(service)
    service.wait(lambda: any(one["event"] == "begun" for one in recorder_said(service)))
    said(recorder=recorder_said(service))
    asked(service, "enable")
    service.until(lambda record: record.mode == Mode.HOLD)
    if phase == LAST:
        _end(service, helpers)
        return
    if phase == "ready":
        asked(service, "disable")
        service.until(lambda record: record.mode == Mode.READY)
    elif phase in {"gait", "stop"}:
        asked(service, "mode", **GAIT)
        service.until(walks)
    said(phase=phase)
    if phase == "stop":
        # The clip of this start's verdict; then what was said is on the disk, and the stop is not.
        service.wait(clips)
        time.sleep(SETTLED_S)
        asked(service, "stop")
    while True:
        time.sleep(1.0)


def _end(service: Inside, helpers: list[int]) -> None:
    for pid in helpers:
        os.kill(pid, 9)
        os.waitpid(pid, 0)
    for part in ("record", "core", "gateway", "sim"):
        service.kill(part, 15)
        said(ended=part, exit_code=service.parts[part].wait())
    said(recorder=recorder_said(service))
    shell(f"umount {service.folder}/state; umount {DISK}")


def main() -> None:
    import gaitd_record  # noqa: F401 - before the fork, as everything that is slow to import
    import gaitd_session.store  # noqa: F401

    import gaitd.record  # noqa: F401

    _import_all()
    warm()
    gc.freeze()
    live(sys.argv[1])


if __name__ == "__main__":
    main()
