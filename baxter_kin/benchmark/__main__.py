"""`python -m baxter_kin.benchmark`, with one thread per numerical library."""

from baxter_kin.benchmark import limit_threads, main
from baxter_kin.command_line import run_process

if __name__ == "__main__":
    limit_threads()
    run_process(main, "baxter_kin.benchmark", failed=1)
