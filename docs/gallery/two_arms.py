"""
Two arms at one table
=====================

Four blocks are sorted by colour, with both arms at the same time. They work close to each other,
and are proven to keep clear at every instant.
"""

import matplotlib.pyplot as plt

from sim import EventKind, Workbench

bench = Workbench()
for name, place in {
    "red 1": (0.58, 0.10),
    "blue 1": (0.72, -0.12),
    "red 2": (0.72, 0.04),
    "blue 2": (0.58, -0.06),
}.items():
    bench.add_block(name, *place, edge_m=0.04, colour=name.split()[0])

# %%
# The left arm carries a red block while the right arm carries a blue one. Both motions are one
# program: how long each arm takes, and how long it waits, is chosen so that both are done soon.

tasks = []
for red, blue in (
    (("red 1", (0.60, 0.32)), ("blue 1", (0.60, -0.32))),
    (("red 2", (0.72, 0.32)), ("blue 2", (0.72, -0.32))),
):
    tasks += bench.carry_together(left=red, right=blue)
    print(*tasks[-2:], sep="\n")

# %%
# What it saves: the time in which an arm moves, and the same motions one after the other.

alone_s = sum(task.motion_s for task in tasks)
print(f"{bench.motion_s:.1f} s with both arms at once, {alone_s:.1f} s one after the other")

# %%
# The moves of both arms on their common clock.

figure, axes = plt.subplots(figsize=(7, 1.8), layout="constrained")
for event in bench.recording().events:
    if event.kind is EventKind.MOVE_STARTED:
        colour = {"left": "tab:blue", "right": "tab:orange"}[event.side]
        duration_s = event.move.trajectory.duration
        axes.barh(event.side, duration_s, left=event.time_s, color=colour, edgecolor="white")
axes.set(xlabel="time, s")
axes.invert_yaxis()
plt.show()

# %%

bench.replay()
