"""What finds solutions of a task: its searches, its starts, and its proofs that there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.arrays import Indices, Vector
from baxter_kin.ik.closed_form import ClosedForm
from baxter_kin.ik.kernel import ArmNumbers
from baxter_kin.ik.reach import DECISION_LEVELS, ReachBound, ReachProof
from baxter_kin.ik.search import FINE_ROUNDS, SCATTERED_STARTS, Backend, Desk, Found, Lanes
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap, pose_features
from baxter_kin.ik.task import Task
from baxter_kin.ik.task_kernel import task_search_function
from baxter_kin.ik.tolerance import Tolerance
from baxter_kin.model import Arm
from baxter_kin.symbolic import Shape

_COAXIAL = 1e-9  # how far (m, and of a unit vector) an axis may be from the last joint's

_EXACT = Tolerance()


class TaskStarts:
    """Where to start for a task: as the null-space map, but for all poses that would do."""

    def __init__(self, map_: NullSpaceMap, task: Task) -> None:
        self._map = map_
        self._task = task
        self.setpoints = map_.setpoints
        self.coarse = _VariantStarts(map_.coarse, task)
        self.fine = _VariantStarts(map_.fine, task)
        self.scattered = map_.scattered

    def nearest(self, Ts: Vector) -> Indices:
        """The setpoints whose regions are nearest to any of the poses, nearest first.

        Args:
            Ts: requested poses of the tip, shape (m, 4, 4).

        Returns:
            Indices, shape (m, `MAP_STARTS`).
        """
        poses = self._task.gripper_poses(Ts)
        features = pose_features(poses.reshape(-1, 4, 4))
        squares = (self._map.middles**2).sum(axis=1) - 2 * features @ self._map.middles.T
        least = squares.reshape(*poses.shape[:2], -1).min(axis=1)
        order: Indices = least.argsort(axis=1)[:, :MAP_STARTS]
        return order


class _VariantStarts:
    """Computed starts for all poses that would do, taken in turns."""

    def __init__(self, closed_form: ClosedForm, task: Task) -> None:
        self._closed_form = closed_form
        self._task = task

    def starts(self, Ts: Vector, count: int) -> Vector:
        """Starts for poses, shape (m, 4, 4): shape (m, count, 7), rad."""
        poses = self._task.gripper_poses(Ts)
        each = -(-count // poses.shape[1])
        starts = self._closed_form.starts(poses.reshape(-1, 4, 4), each)
        in_turns: Vector = starts.reshape(len(Ts), -1, each, 7).transpose(0, 2, 1, 3)
        return in_turns.reshape(len(Ts), -1, 7)[:, :count]


@dataclass(frozen=True, slots=True)
class TaskEvaluator:
    """The search function of tasks, ready to run.

    Attributes:
        function: the function.
        desk: memory to evaluate it for one request.
        backend: what evaluates it.
        numbers: of the arm.
    """

    function: ca.Function
    desk: Desk
    backend: Backend
    numbers: ArmNumbers


@cache
def task_functions(shape: Shape) -> tuple[ca.Function, ...]:
    """The search of all arms of a shape, alone."""
    return (task_search_function(shape),)


class TaskSearcher:
    """The fast search of one arm for one task.

    Attributes:
        backend: where it runs.
        fine_rounds: how many starts computed with care it is given at once, round by round.
        scattered_starts: how many from all over the joint ranges, for poses that are left then.
    """

    fine_rounds: tuple[int, ...] = FINE_ROUNDS
    scattered_starts: int = SCATTERED_STARTS

    def __init__(
        self,
        arm: Arm,
        evaluator: TaskEvaluator,
        task: Task,
        starts: TaskStarts,
    ) -> None:
        """Bind the search function of an arm to a task.

        Args:
            arm: with the task's tip.
            evaluator: of the function that `baxter_kin.ik.task_kernel` makes.
            task: what is asked.
            starts: where to start.
        """
        self.backend, function = evaluator.backend, evaluator.function
        self._task, self._starts, self._desk = task, starts, evaluator.desk
        solved = arm.neutral, task.turned(arm.T_base_tip(arm.neutral).homogeneous)
        self._lanes = Lanes(function, solved)
        self._arm, self._numbers = evaluator.numbers.within(), evaluator.numbers
        T_last_tip = evaluator.numbers.T_last_tip.homogeneous @ task.tool
        self._given = T_last_tip, task.widths, np.array([float(task.roll_is_free)])

    def search_one(self, q_start: Vector, T_base_tip: pin.SE3) -> tuple[Vector, Vector]:
        """One search; as `Searcher.search_one`."""
        desk = self._desk
        request = q_start, self._task.turned(T_base_tip.homogeneous), *self._given
        for memory, value in zip(desk.request, request, strict=True):
            memory[:] = value
        desk.run()
        return desk.q, desk.report

    def search(self, q_starts: Vector, Ts: Vector, bounds: Vector | None = None) -> Found:
        """Many searches; as `Searcher.search`."""
        arm = self._arm if bounds is None else self._numbers.within(bounds)
        return self._lanes((q_starts, self._task.turned(Ts)), (*self._given, arm))

    def search_from_map(self, Ts: Vector) -> Found:
        """Searches for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""
        nearest, poses = self._starts.nearest(Ts), np.arange(len(Ts))
        found = self.search(self._starts.setpoints[nearest[:, 0]], Ts)
        for rank in range(1, MAP_STARTS):
            poses = poses[~found.is_valid[poses]]
            if not poses.size:
                break
            again = self.search(self._starts.setpoints[nearest[poses, rank]], Ts[poses])
            found.improve(poses, again)
        return found


class TaskReach:
    """Proofs that no pose that would do is within reach."""

    def __init__(self, bound: ReachBound, task: Task) -> None:
        self._bound = bound
        self._T_tip_gripper = task.T_gripper_tip.inverse()
        self._leeway_m = float(np.linalg.norm(task.tolerance.position_m))
        self._wrist_leeway_m = self._leeway_m + _wrist_turns_m(bound, task)
        self._is_posed = _fixes_gripper(bound, task)
        self._is_roll_free = task.roll_is_free

    def proof(self, T_base_tip: pin.SE3, *, is_thorough: bool = False) -> ReachProof | None:
        """Why the arm cannot do the task at a pose, or None when that is not proved.

        Args:
            T_base_tip: the tip seen from base.
            is_thorough: whether it may take a second.
        """
        T_base_gripper = T_base_tip * self._T_tip_gripper
        if self._is_posed:
            proof = self._bound.proof(
                T_base_gripper, is_roll_free=self._is_roll_free, is_thorough=is_thorough
            )
            return _less(proof, self._leeway_m)
        tool_m = float(np.linalg.norm(self._T_tip_gripper.translation))
        position = self._bound.proof_of_position(T_base_tip.translation)
        wrist = self._bound.proof_of_wrist(T_base_gripper)
        proofs = _less(position, self._leeway_m + tool_m), _less(wrist, self._wrist_leeway_m)
        return max(filter(None, proofs), key=lambda proof: proof.excess_m, default=None)

    def are_outside_shells(self, Ts: Vector) -> NDArray[np.bool_]:
        """Which poses, shape (m, 4, 4), are so far away that it is proven in no time."""
        if not self._is_posed or self._leeway_m > 0.0:
            return np.zeros(len(Ts), dtype=np.bool_)
        return self._bound.are_outside_shells(Ts @ self._T_tip_gripper.homogeneous)

    def are_proven(self, Ts: Vector, levels: int = DECISION_LEVELS) -> NDArray[np.bool_]:
        """Which of them are out of reach, by what is proven for many at a time."""
        if not self._is_posed or self._leeway_m > 0.0:
            return np.array([self.proof(pin.SE3(T)) is not None for T in Ts], dtype=np.bool_)
        return self._bound.are_proven(Ts @ self._T_tip_gripper.homogeneous, levels)

    def are_beyond_limits(self, Ts: Vector) -> NDArray[np.bool_]:
        """Which of them are out of reach, by what takes milliseconds for each."""
        if not self._is_posed or self._leeway_m > 0.0 or self._is_roll_free:
            return np.zeros(len(Ts), dtype=np.bool_)
        return self._bound.are_beyond_limits(Ts @ self._T_tip_gripper.homogeneous)


def _less(proof: ReachProof | None, leeway_m: float) -> ReachProof | None:
    return None if proof is None else proof.less(leeway_m)


def _wrist_turns_m(bound: ReachBound, task: Task) -> float:
    """How far the wrist can get from where the pose puts it by what the tip is turned.

    A rotation by an angle moves a point by its distance times the chord, 2 sin(angle / 2). Where
    the rotation about an axis is free, that holds for the part along the axis, and the part across
    goes anywhere: it moves by up to twice its length.
    """
    wrist = (bound.T_last_tip * task.T_gripper_tip).inverse().translation
    along, across = float(np.linalg.norm(wrist)), 0.0
    if task.tolerance.free_axis is not None:
        axis = np.eye(3)[task.tolerance.free_axis]
        along, across = abs(float(axis @ wrist)), float(np.linalg.norm(np.cross(axis, wrist)))
    return 2.0 * along * math.sin(0.5 * task.tolerance.most_turned_rad) + 2.0 * across


def _fixes_gripper(bound: ReachBound, task: Task) -> bool:
    """Whether the tip's pose gives the gripper's, but for its roll about the last joint's axis."""
    tolerance = replace(task.tolerance, position_m=_EXACT.position_m)
    T = bound.T_last_tip * task.T_gripper_tip
    if tolerance == _EXACT:
        return True
    is_coaxial = np.hypot(*T.translation[:2]) + np.hypot(*T.rotation[:2, 2]) <= _COAXIAL
    return bool(is_coaxial) and tolerance == Tolerance.about("z")
