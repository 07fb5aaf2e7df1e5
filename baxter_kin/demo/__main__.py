"""`python -m baxter_kin.demo`, and the console script `baxter-demo`."""

from __future__ import annotations

import os
import signal
import sys
from typing import NoReturn

from baxter_kin.demo import EXIT_INTERRUPTED, main


def run_process() -> NoReturn:
    """Run the demo as a program of its own."""
    try:
        status = main()
        if sys.stdout is not None:  # as when the caller has closed it
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        status = 1
    except OSError as cause:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        print(f"baxter-demo: cannot write its output: {cause.strerror}", file=sys.stderr)
        status = 1
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done; leave in peace
    if status == EXIT_INTERRUPTED:
        # CPython remembers a KeyboardInterrupt inside exec(), which every dataclass uses, and would
        # end by the signal instead of with the status, although it was handled.
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    run_process()
