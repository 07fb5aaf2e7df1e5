"""
A tower of three blocks
=======================

Three blocks lie askew on the table. Each is grasped along its own sides, whatever its rotation, and
put down straight on the previous one.
"""

# sphinx_gallery_thumbnail_path = "_static/tower.jpg"

import numpy as np

from sim import Workbench

# %%
# A `sim.Workbench` is Baxter at a table. Blocks are added by name, position (x and y in base, in
# metres), edge and rotation.

bench = Workbench()
rng = np.random.default_rng(1)
for name, edge_m, place in (
    ("red", 0.05, (0.60, 0.22)),
    ("yellow", 0.04, (0.72, 0.26)),
    ("blue", 0.03, (0.66, 0.10)),
):
    bench.add_block(name, *place, edge_m=edge_m, yaw_rad=rng.uniform(-0.7, 0.7))

# %%
# Each task is one line. It is planned, verified by independent code, and executed.

print(bench.carry("red", to=(0.70, -0.08), arm="left"))
print(bench.carry("yellow", onto="red", arm="left"))
print(bench.carry("blue", onto="yellow", arm="left"))
bench.withdraw("left")

# %%
# The recording plays below: drag to turn the view, scroll to zoom.

bench.replay()
