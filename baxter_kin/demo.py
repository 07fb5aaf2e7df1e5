"""`python -m baxter_kin.demo`: starts `sim.demo`, which stands where all that it needs does."""

import runpy

if __name__ == "__main__":
    runpy.run_module("sim.demo", run_name="__main__")
