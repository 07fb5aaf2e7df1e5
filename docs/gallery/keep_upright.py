"""
Keep it upright
===============

A cup has to go over a wall. The fastest way tilts it; an upright one costs hardly any time.
"""

import math

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, pose_from_quaternion
from planner import (
    Body,
    Cylinder,
    Manipulator,
    Part,
    PickAndPlace,
    Scene,
    Upright,
    load_object,
    make_block,
    plan_pick_and_place,
    tilt_of,
    verify,
)
from sim import Replay


def at(x, y, z):
    return pin.SE3(np.eye(3), np.array([x, y, z]))


robot = Baxter.load()
arm = Manipulator.of(robot, "left")
cup = Body(
    "cup",
    (Part(Cylinder(0.025, 0.10), pin.SE3.Identity(), (0.1, 0.4, 0.8, 1.0)),),
    at(0.70, 0.25, -0.105),
    is_movable=True,
)
wall = make_block("wall", at(0.70, 0.08, -0.015), edge_m=(0.30, 0.02, 0.28), is_movable=False)
scene = Scene.of([load_object("table", at(1.0, 0.0, -0.93)), cup, wall])

# %%
# The same task without a requirement, and with the axis of the cup within 5 deg of the vertical.

DOWN = (0.0, 1.0, 0.0, 0.0)  # x, y, z, w
pick, place = (pose_from_quaternion((0.70, y, -0.08), DOWN) for y in (0.25, -0.10))
plans = {}
for name, upright in (
    ("fastest", None),
    ("upright", Upright((0.0, 0.0, 1.0), math.radians(5.0))),
):
    task = PickAndPlace("cup", pick, place, upright=upright)
    plans[name] = plan_pick_and_place(task, arm, scene, arm.arm.start)
    leans_deg = math.degrees(tilt_of(plans[name]))
    print(f"{name}: {plans[name].motion_time_s:.2f} s, leans by up to {leans_deg:.1f} deg")
print(verify(plans["upright"]).verdict)

# %%
# How far the cup leans while it is carried. The cone is proven at every instant.

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for name, plan in plans.items():
    time_s = 0.0
    for move in plan.moves:
        if move.state.holding("left"):
            times_s = np.linspace(0.0, move.trajectory.duration, 200)
            tips = arm.arm.T_base_tips(move.trajectory.sample(times_s).q)
            leans = np.degrees(np.arccos(np.clip(-tips[:, 2, 2], -1.0, 1.0)))
            axes.plot(time_s + times_s, leans, color={"fastest": "C1", "upright": "C0"}[name])
        time_s += move.trajectory.duration
    axes.plot([], [], color={"fastest": "C1", "upright": "C0"}[name], label=name)
axes.axhline(5.0, color="0.5", linestyle="--")
axes.set(xlabel="time, s", ylabel="lean, deg")
axes.legend()
plt.show()

# %%
# The upright plan, with the fastest one as a ghost.

Replay(plans["upright"], compare=plans["fastest"])
