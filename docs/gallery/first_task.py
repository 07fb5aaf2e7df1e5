"""
A first task of your own
========================

Baxter at a table, a block, and a place for it: four lines, and then what the arm did.
"""

from sim import Workbench, plot_recording

# %%
# Places are x and y in the robot's frame `base`, in metres. The arm that is faster takes the block.

bench = Workbench()
bench.add_block("red", 0.70, 0.15)
task = bench.carry("red", to=(0.75, -0.05))
print(task)

# %%
# The robot did not move by luck: the plan was proven to keep clear of everything, and then verified
# by code that did not make it.

plan = task.plan
print(f"{1e3 * plan.proven_clearance_m:.1f} mm from everything, at every instant")

# %%
# Every joint against its limits, up to jerk. Most of the time one of them is at a limit: that is
# what time-optimal means.

plot_recording(bench.recording(), task.arm)

# %%
# And the motion itself. Drag to look around; the panel shows joints and clearance as they change.

bench.replay()
