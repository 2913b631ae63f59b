"""What the core asks of the kernel and of Python, seen in a process of its own."""

import json
import os
import resource
import subprocess
import sys

import pytest

ASKS = """
import gc, json, mmap, os, sys
from pathlib import Path
from daemon.core.runtime import realtime
refused = realtime.prepare({priority}, {processors})
untouched = mmap.mmap(-1, {room_kb} << 10)
print(json.dumps({{
    "refused": {{event.code.name: event.values or event.said for event in refused}},
    "frozen": gc.get_freeze_count() > 0,
    "collects": gc.isenabled(),
    "switch_s": sys.getswitchinterval(),
    "class": os.sched_getscheduler(0),
    "priority": os.sched_getparam(0).sched_priority,
    "processors": sorted(os.sched_getaffinity(0)),
    "status": Path("/proc/self/status").read_text(),
}}))
"""
ROOM_KB = 1 << 18
SOME = max(os.sched_getaffinity(0))


def asked(priority=0, processors=(), before=None):
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            ASKS.format(room_kb=ROOM_KB, priority=priority, processors=tuple(processors)),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        preexec_fn=before,
    )
    return json.loads(ran.stdout)


def limit(resource_number):
    return resource.getrlimit(resource_number)[0]


def test_the_collector_is_frozen_and_off_and_no_thread_is_waited_for():
    verdicts = asked()

    assert verdicts["frozen"]
    assert not verdicts["collects"]
    assert verdicts["switch_s"] == 1.0


def test_memory_is_locked_as_it_is_touched_or_the_refusal_says_the_limit():
    verdicts = asked()

    locked_kb = int(verdicts["status"].split("VmLck:")[1].split()[0])
    resident_kb = int(verdicts["status"].split("VmRSS:")[1].split()[0])
    size_kb = int(verdicts["status"].split("VmSize:")[1].split()[0])
    if "MEMORY_NOT_LOCKED" in verdicts["refused"]:
        assert verdicts["refused"]["MEMORY_NOT_LOCKED"] == [limit(resource.RLIMIT_MEMLOCK)]
    else:
        assert locked_kb > 0
        assert size_kb > ROOM_KB > resident_kb


def test_the_real_time_class_is_asked_for_with_reset_on_fork_or_the_refusal_says_the_limit():
    verdicts = asked(priority=10)

    if "PRIORITY_REFUSED" in verdicts["refused"]:
        assert verdicts["refused"]["PRIORITY_REFUSED"] == [10, limit(resource.RLIMIT_RTPRIO)]
    else:
        assert verdicts["class"] == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        assert verdicts["priority"] == 10


def test_priority_0_asks_for_no_real_time_class():
    assert asked(priority=0)["class"] == os.SCHED_OTHER


def test_the_processors_of_the_configuration_are_the_ones_it_runs_on():
    assert asked(processors=[SOME])["processors"] == [SOME]


@pytest.mark.parametrize("missing", [[1023], [SOME, 5000]])
def test_processors_that_are_not_there_are_refused_and_those_that_are_given_are_named(missing):
    verdicts = asked(processors=missing)

    if missing == [1023]:
        given = ", ".join(map(str, verdicts["processors"]))
        assert verdicts["refused"]["PROCESSORS_REFUSED"] == given
    assert set(verdicts["processors"]) <= os.sched_getaffinity(0)
    assert verdicts["processors"]


def test_a_child_of_the_real_time_class_has_none():
    code = ASKS.format(room_kb=ROOM_KB, priority=10, processors=()) + (
        "child = os.fork()\n"
        "if child == 0:\n    os._exit(os.sched_getscheduler(0) != os.SCHED_OTHER)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )

    assert ran.stdout.splitlines()[-1] == "0"
