"""A function in a process of another user."""

import os
import traceback

FAILED = 255


def forked(user, group, function):
    """A process of another user, which ends with the number that the function returns."""
    child = os.fork()
    if child == 0:
        code = FAILED
        try:
            os.setgroups([])
            os.setresgid(group, group, group)
            os.setresuid(user, user, user)
            os.umask(0o007)
            code = int(function())
        finally:
            if code == FAILED:
                os.write(2, traceback.format_exc().encode())
            os._exit(code)
    return child


def result(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
