"""
Around a wall
=============

A wall stands between the block and its goal. The planner finds a way around it and proves it clear.
"""

import matplotlib.pyplot as plt
import numpy as np

from baxter_kin import Baxter, pose_from_quaternion
from planner import Manipulator, PickAndPlace, load_object, make_block, plan_pick_and_place, verify
from sim import Replay, Simulation, World

UPRIGHT, DOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)  # x, y, z, w

robot = Baxter.load()
world = World(robot)
simulation = Simulation(world)
simulation.spawn(load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT)))
simulation.spawn(make_block("red", pose_from_quaternion((0.70, 0.25, -0.13), UPRIGHT)))
size = (0.30, 0.02, 0.28)
centre = (0.70, 0.08, -0.155 + size[2] / 2)
wall = make_block("wall", pose_from_quaternion(centre, UPRIGHT), edge_m=size, is_movable=False)
simulation.spawn(wall)

# %%
# Plan the same task twice: with the wall and without it.

arm, q_now = Manipulator.of(robot, "left"), world.arm_q("left")
task = PickAndPlace(
    "red",
    T_base_pick=pose_from_quaternion((0.70, 0.25, -0.13), DOWN),
    T_base_place=pose_from_quaternion((0.70, -0.10, -0.13), DOWN),
)
plan = plan_pick_and_place(task, arm, world.scene, q_now, margin_m=0.01)
free = plan_pick_and_place(task, arm, world.scene.without("wall"), q_now, margin_m=0.01)
print(verify(plan).verdict)
print(f"{plan.motion_time_s:.2f} s, without the wall {free.motion_time_s:.2f} s")

# %%
# The path of the tip, seen from the front: over the wall, and no higher than necessary.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for shown, label in ((free, "without the wall"), (plan, "with the wall")):
    tip = []
    for move in shown.moves:
        times = np.linspace(0.0, move.trajectory.duration, 50)
        tip += [arm.arm.T_base_tip(move.trajectory.sample(t)[0]).translation for t in times]
    axes.plot(*np.array(tip)[:, 1:].T, label=label)
y, z = centre[1] - size[1] / 2, centre[2] - size[2] / 2
axes.add_patch(plt.Rectangle((y, z), size[1], size[2], color="0.6", label="wall"))
axes.axhline(z, color="0.3")
axes.set(xlabel="y in base, m", ylabel="z in base, m", aspect="equal")
axes.legend()
plt.show()

# %%
# You can watch a plan before anything has moved.

Replay(plan)
