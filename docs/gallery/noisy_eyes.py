"""
Noisy perception
================

A camera observes the block with an error of some millimetres. The fingers miss it; the loop detects
the miss, observes again and retries.
"""

import matplotlib.pyplot as plt
import numpy as np

from baxter_kin import Baxter, pose_from_quaternion
from planner import Manipulator, load_object, make_block
from sim import (
    ClosedLoop,
    Noise,
    NoisyPoses,
    Recorder,
    Replay,
    Simulation,
    Transfer,
    TruePoses,
    World,
)

UPRIGHT, DOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)  # x, y, z, w

robot = Baxter.load()
world, recorder = World(robot), Recorder(robot)
simulation = Simulation(world, [recorder])
simulation.spawn(load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT)))
simulation.spawn(make_block("red", pose_from_quaternion((0.70, -0.10, -0.13), UPRIGHT)))

# %%
# The camera's error is 4 mm along each axis (standard deviation), and one observation in five
# detects nothing. The open hand leaves 3.5 mm on either side of the block.

block = world.body("red")
grasp = pose_from_quaternion(block.centre_base, DOWN)
goal = pose_from_quaternion((0.70, 0.20, -0.13), UPRIGHT)
transfer = Transfer("red", T_body_tip=block.T_base_body.inverse() * grasp, T_base_goal=goal)
eyes = NoisyPoses(TruePoses(world), Noise(position_m=0.004, dropout=0.2), np.random.default_rng(6))
loop = ClosedLoop(simulation, Manipulator.of(robot, "left"), eyes, retries=5)
result = loop.pick_and_place(transfer)
for number, attempt in enumerate(result.attempts, start=1):
    print(f"attempt {number}:", attempt.failure or "placed")

# %%
# Fifty observations of this camera, seen from above, and the tolerance of the open hand.

looks = [eyes.observe("red", simulation.time_s) for _ in range(50)]
seen = np.array([look.body.centre_base for look in looks if look is not None])
off_mm = 1e3 * (seen - world.body("red").centre_base)
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.plot(*off_mm[:, :2].T, "o", label="observed")
axes.plot(0, 0, "r+", markersize=14, label="true position")
axes.axhspan(-3.5, 3.5, color="tab:green", alpha=0.15, label="fits between the fingers")
axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
axes.legend()
plt.show()

# %%
# The miss and the second attempt.

Replay(recorder.recording(), robot)
