"""`gaitd run`: core and gateway in one command, for a desk or a demonstration.

It is a supervisor of a real machine and shares nothing with the processes of tests and benchmarks
(`gaitd_lab/processes.py`): its output is the terminal's, it restarts the gateway, and if it is
killed the kernel ends its processes by SIGTERM, so that the core stops the axes. It prints that the
core starts, then the core's status, for example that it waits for can0, as systemd would show it.
"""

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from types import FrameType

import typer
from gaitd_names import ExitCode

from gaitd.command_line import JSON, ConfigFile, JsonLinesOption, json_on_stdout

POLL_S = 0.05
GATEWAY_RESTART_S = 1.0
CORE_END_S = 10.0
"""Longer than the core needs to stop both axes (up to three seconds) and to switch off power."""
GATEWAY_END_S = 5.0
PR_SET_PDEATHSIG = 1
STARTING = "starting; the core compiles its cycle on the first start, a minute or two"
STATUS = "STATUS="
"""Beginning of the status line in a message of sd_notify(3)."""
NOTICE_BYTES = 4096


def command(
    config: ConfigFile,
    as_json: JsonLinesOption = False,
) -> None:
    """Run the service: start, supervise and end core and gateway together."""
    with json_on_stdout(as_json) as write:
        words = ("--config", str(config), *((JSON,) if as_json else ()))
        code = _Supervisor(words, write).run()
        write({"event": "ended", "part": "run", "exit_code": code})
    raise typer.Exit(code)


class _Supervisor:
    """Ends with the core, with its exit code; restarts a gateway that has ended.

    While the gateway is away the core stops the machine and holds it. The gateway's return enables
    no drive again.
    """

    def __init__(self, words: tuple[str, ...], write: Callable[[object], None]) -> None:
        """`words` are the options of core and gateway; `write` gets the events for programs."""
        self._words, self._write = words, write
        self._ending = False
        self._status = ""
        self._notices = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._notices.bind("")  # the kernel chooses a name
        signal.signal(signal.SIGTERM, self._end)
        signal.signal(signal.SIGINT, self._end)

    def run(self) -> int:
        self._show(STARTING)
        core = self._start("core")
        gateway = self._start("gateway")
        gateway_ended_s: float | None = None
        try:
            while core.poll() is None and not self._ending:
                time.sleep(POLL_S)
                self._print_status()
                if gateway.poll() is None:
                    continue
                now_s = time.monotonic()
                if gateway_ended_s is None:
                    gateway_ended_s = now_s
                    if gateway.returncode == ExitCode.USAGE:
                        break
                    print(f"gaitd: gateway ended with {gateway.returncode}", file=sys.stderr)
                    code = gateway.returncode
                    self._write({"event": "ended", "part": "gateway", "exit_code": code})
                elif now_s - gateway_ended_s > GATEWAY_RESTART_S:
                    gateway, gateway_ended_s = self._start("gateway"), None
        finally:
            code = _finish(core, CORE_END_S)
            self._print_status()
            gateway_code = _finish(gateway, GATEWAY_END_S)
        if code:
            return code if code > 0 else ExitCode.UNAVAILABLE  # a signal has ended it
        return ExitCode.USAGE if gateway_code == ExitCode.USAGE else ExitCode.DONE

    def _start(self, part: str) -> subprocess.Popen[bytes]:
        # A session of its own: Ctrl-C reaches the supervisor alone, which ends core and gateway in
        # order.
        arguments = [sys.executable, "-m", "gaitd", part, *self._words]
        address = os.fsdecode(self._notices.getsockname()).replace("\0", "@")
        return subprocess.Popen(
            arguments,
            # A supervisor above this one keeps its own notifications.
            env={"NOTIFY_SOCKET": address, **os.environ} if part == "core" else None,
            start_new_session=True,
            preexec_fn=_end_with_parent,  # noqa: PLW1509 - this process has one thread
        )

    def _print_status(self) -> None:
        """Print the newest status line of the core if it has changed."""
        newest = self._status
        with contextlib.suppress(BlockingIOError):
            while True:
                for line in self._notices.recv(NOTICE_BYTES).decode().splitlines():
                    if line.startswith(STATUS):
                        newest = line.removeprefix(STATUS)
        if newest != self._status:
            self._show(newest)

    def _show(self, status: str) -> None:
        self._status = status
        print(f"gaitd: {status}", file=sys.stderr, flush=True)
        self._write({"event": "status", "part": "core", "text": status})

    def _end(self, _signal: int, _frame: FrameType | None) -> None:
        self._ending = True


def _end_with_parent() -> None:
    """Ask the kernel for SIGTERM when the supervisor ends, by whatever cause."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _finish(process: subprocess.Popen[bytes], timeout_s: float) -> int:
    """End a process with SIGTERM, and with SIGKILL after `timeout_s`; return its exit code.

    A process that SIGTERM ends before it has a handler has done nothing yet: 0.
    """
    if process.poll() is not None:
        return process.returncode
    process.send_signal(signal.SIGTERM)
    try:
        code = process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        print(f"gaitd: pid {process.pid} did not end and is killed", file=sys.stderr)
        process.kill()
        return process.wait()
    return 0 if code == -signal.SIGTERM else code
