"""The end of a fork that runs a program: its exit code, as an interpreter would give it."""

import sys
import traceback
from collections.abc import Callable


def exit_code_of(program: Callable[[], object]) -> int:
    """Run it. A fork must not return into its parent's code, whatever happens."""
    try:
        program()
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:  # noqa: BLE001 - its traceback is printed, as an interpreter does
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0
