"""
Out of a shelf
==============

An item stands under a roof, where no hand can come from above. The hand goes in from the front,
lifts the item by a centimetre, draws it out, and puts it on the table.
"""

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from planner import (
    Line,
    Manipulator,
    PickAndPlace,
    Scene,
    load_object,
    make_block,
    plan_pick_and_place,
    verify,
)
from sim import Replay


def at(x, y, z):
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def board(name, centre, edges):
    return make_block(name, at(*centre), edge_m=edges, is_movable=False)


# %%
# A bin of five boards, open towards the robot.

robot = Baxter.load()
arm = Manipulator.of(robot, "left")
front, floor = 0.77, 0.10  # m, in base
boards = [
    board("floor", (front + 0.185, 0.08, floor - 0.005), (0.37, 0.29, 0.01)),
    board("roof", (front + 0.185, 0.08, floor + 0.225), (0.37, 0.29, 0.01)),
    board("back", (front + 0.375, 0.08, floor + 0.11), (0.01, 0.27, 0.22)),
    board("left wall", (front + 0.185, 0.22, floor + 0.11), (0.37, 0.01, 0.22)),
    board("right wall", (front + 0.185, -0.06, floor + 0.11), (0.37, 0.01, 0.22)),
]
item = make_block("item", at(front + 0.15, 0.08, floor + 0.07), edge_m=(0.05, 0.05, 0.14))
scene = Scene.of([*boards, load_object("table", at(1.0, 0.0, -0.93)), item])

# %%
# Lines say along which way the tip comes and goes, in base or along the axis of the hand ("tool").

level = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the hand points forwards
out = 0.21  # m: past the front of the bin
task = PickAndPlace(
    "item",
    T_base_pick=pin.SE3(level, np.array([front + 0.15, 0.08, floor + 0.07])),
    T_base_place=pin.SE3(pin.utils.rotate("z", 0.3) @ level, np.array([0.74, 0.40, -0.085])),
    approach=Line((1.0, 0.0, 0.0), out),
    retreat=[Line((0.0, 0.0, 1.0), 0.01), Line("tool", out)],
    place_retreat=Line("tool", 0.12),
)
plan = plan_pick_and_place(task, arm, scene, arm.arm.start)
print(verify(plan).verdict)

# %%
# The path of the tip from the side: lines in orange, and free moves between them in blue.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for each in boards[:3]:
    (x0, x1), (z0, z1) = each.extent_m((1.0, 0.0, 0.0)), each.extent_m((0.0, 0.0, 1.0))
    axes.add_patch(plt.Rectangle((x0, z0), x1 - x0, z1 - z0, color="0.6"))
for move in plan.moves:
    times_s = np.linspace(0.0, move.trajectory.duration, 100)
    tips = arm.arm.T_base_tips(move.trajectory.sample(times_s).q)[:, :3, 3]
    axes.plot(tips[:, 0], tips[:, 2], color="C1" if move.is_straight else "C0")
axes.axhline(-0.155, color="0.3")
axes.set(xlabel="x in base, m", ylabel="z in base, m", aspect="equal")
plt.show()

# %%

Replay(plan)
