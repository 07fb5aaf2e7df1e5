"""
A first task of your own
========================

Baxter at a table, a block, and a goal for it: four lines, and then the result.
"""

from sim import Workbench, plot_recording

# %%
# Goals are x and y in the robot's frame `base`, in metres. The faster arm carries the block.

bench = Workbench()
bench.add_block("red", 0.70, 0.15)
task = bench.carry("red", to=(0.75, -0.05))
print(task)

# %%
# Before the arm moved, the plan was proven to stay clear of everything, and then verified by
# independent code.

plan = task.plan
print(f"{1e3 * plan.proven_clearance_m:.1f} mm from everything, at every instant")

# %%
# Every joint with its limits, up to jerk. In a time-optimal motion some joint is at a limit most of
# the time.

plot_recording(bench.recording(), task.arm)

# %%
# The motion itself. Drag to turn the view; the panel plots joints and clearance.

bench.replay()
