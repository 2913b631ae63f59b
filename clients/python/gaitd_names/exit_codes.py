"""Exit codes, the same in every program; `docs/exit_codes.md` says what to do after each."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a program has ended. systemd starts a service again after each but 0, USAGE and DRIVE."""

    DONE = 0
    FAILED = 1
    """The answer is no: refused, different, missed, not as expected."""
    USAGE = 2
    """The command line, a configuration or a file: the same words fail again."""
    DRIVE = 3
    """A drive is not the one of the configuration, does not answer, or may have been left on."""
    UNAVAILABLE = 4
    """No answer of what is needed, or our own bug: the same words may work later."""
    TIME_OVER = 5
    """It has not happened within the time of `--timeout`."""
