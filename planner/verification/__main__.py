"""`python -m planner.verification`."""

from __future__ import annotations

import os
import signal
import sys
from typing import NoReturn

from planner.verification.command_line import EXIT_INTERRUPTED, EXIT_USAGE, main


def run_process() -> NoReturn:
    """Check a saved plan as a program of its own."""
    try:
        status = main()
        if sys.stdout is not None:  # as when the caller has closed it
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe has seen enough, but not the verdict
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        status = EXIT_USAGE
    except OSError as cause:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        print(f"planner.verification: cannot write: {cause.strerror}", file=sys.stderr)
        status = EXIT_USAGE
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done; leave in peace
    if status == EXIT_INTERRUPTED:
        os._exit(status)  # or CPython may end by the signal; see baxter_kin/demo/__main__.py
    sys.exit(status)


if __name__ == "__main__":
    run_process()
