"""
Two arms at one table
=====================

Four blocks are sorted by colour. Both arms work in turn, and each is an obstacle for the other.
"""

import matplotlib.pyplot as plt

from sim import Workbench

bench = Workbench()
for name, place in {
    "red 1": (0.58, 0.10),
    "blue 1": (0.72, -0.12),
    "red 2": (0.72, 0.04),
    "blue 2": (0.58, -0.06),
}.items():
    bench.add_block(name, *place, edge_m=0.04, colour=name.split()[0])

# %%
# Each task is given to the arm that needs the least time for it. The arm then withdraws beside the
# table, because the other arm could not pass it.

tasks = []
for name, place in {
    "red 1": (0.60, 0.32),
    "blue 1": (0.60, -0.32),
    "red 2": (0.72, 0.32),
    "blue 2": (0.72, -0.32),
}.items():
    tasks.append(bench.carry(name, to=place))
    print(tasks[-1])
    bench.withdraw("left")
    bench.withdraw("right")

# %%
# The arm that did each task, and the time it took.

figure, axes = plt.subplots(figsize=(7, 2.5), layout="constrained")
for task in tasks:
    colour = {"left": "tab:blue", "right": "tab:orange"}[task.arm]
    axes.barh(task.block, task.motion_s, color=colour)
    axes.text(0.05, task.block, f"{task.arm} arm", color="white", va="center")
axes.set(xlabel="motion, s")
axes.invert_yaxis()
plt.show()

# %%

bench.replay()
