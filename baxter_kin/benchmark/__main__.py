"""`python -m baxter_kin.benchmark`."""

from __future__ import annotations

import os
import signal
import sys
from typing import NoReturn

from baxter_kin.benchmark import EXIT_INTERRUPTED, main
from baxter_kin.benchmark.threads import limit_threads


def run_process() -> NoReturn:
    """Run the benchmark as a program of its own, with one thread per numerical library."""
    limit_threads()
    try:
        status = main()
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done; leave in peace
    if status == EXIT_INTERRUPTED:
        os._exit(status)  # or CPython may end by the signal; see baxter_kin/demo/__main__.py
    sys.exit(status)


if __name__ == "__main__":
    run_process()
