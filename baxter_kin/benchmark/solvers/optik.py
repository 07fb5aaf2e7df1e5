"""OptIK: SLSQP on the logarithm of the pose error, with random restarts, in Rust.

It reads the stock robot's URDF, so with a robot of one's own it does not take part. Its forward
kinematics of Baxter differs from Pinocchio's by a constant transform before the first joint (42.6
mm, no rotation). The transform is determined when the solver is set up, and every pose is corrected
for it before it is passed to OptIK; the correction is not timed.
"""

from __future__ import annotations

from functools import partial
from importlib.metadata import version

import numpy as np
import pinocchio as pin
from optik import Robot, SolverConfig

from baxter_kin.benchmark.entrants import Contestant, short
from baxter_kin.description import StockFiles
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

TOLERANCE = 1e-12
"""On the squared length of the pose error (m and rad mixed): the loosest that implies 1e-6. The
default, 1e-6, leaves errors of 1e-3."""

MAX_TIME_S = 0.1
"""Its default."""


def contestant(arm: Arm) -> Contestant:
    """The solver."""
    robot = Robot.from_urdf_file(str(StockFiles.installed().urdf), "base", arm.tip_frame)
    robot.set_parallelism(1)  # one thread, as the others; with more it is not deterministic
    config = SolverConfig(solution_mode="speed", max_time=MAX_TIME_S, tol_f=TOLERANCE)
    T_base_root = _root_offset(arm, robot)
    T_root_base = np.linalg.inv(T_base_root)

    def prepare(pose: pin.SE3, q_seed: FloatArray) -> tuple[FloatArray, FloatArray]:
        return T_root_base @ pose.homogeneous, q_seed.copy()

    return Contestant(
        name=f"OptIK (tol {short(TOLERANCE)})",
        version=f"optik-py {version('optik-py')}",
        settings=f"`Robot.ik`, speed, 1 thread, {1e3 * MAX_TIME_S:g} ms, tol_f "
        f"{short(TOLERANCE)}; poses corrected by the constant offset of its base",
        prepare=prepare,
        call=partial(robot.ik, config),
        read=lambda answer: None if answer is None else np.array(answer[0]),
        forward=lambda q: T_base_root @ np.array(robot.fk(q)),
    )


def _root_offset(arm: Arm, robot: Robot) -> FloatArray:
    """Pose of the frame that OptIK takes for base, seen from base, a 4 x 4 matrix.

    It is measured at the middle of the joint ranges. That it is the same everywhere is checked when
    the solver enters the benchmark.
    """
    q = 0.5 * (arm.limits.q_min + arm.limits.q_max)
    T_base_root: FloatArray = arm.T_base_tip(q).homogeneous @ np.linalg.inv(np.array(robot.fk(q)))
    return T_base_root
